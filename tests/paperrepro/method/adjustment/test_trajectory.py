"""Scenario D: the textbook solution, exactness without noise, sigma that hold with it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from paperrepro.errors import BadInput
from paperrepro.method.adjustment.quality import estimate
from paperrepro.method.adjustment.scenarios import calibrate as calibrate_paper
from paperrepro.method.adjustment.trajectory_errors import (
    calibrate_with_trajectory,
    specified_process,
)
from paperrepro.method.adjustment.trajectory_solver import TrajectoryModel, eliminate, iterate
from paperrepro.method.georeference import georeference
from paperrepro.survey import Mounting
from tests.paperrepro.labelled import (
    HEADINGS_DEG,
    LEVER_ARM,
    NAVIGATION,
    SCANNER,
    matched_faces,
    survey_of,
)
from tests.paperrepro.method.adjustment.flying import flown, with_times

SEEDS = range(30)
COMPONENTS = np.arange(6)


@pytest.fixture(scope="module")
def noisy():
    """Results of D and truths over the seeds, points only 40 a face: quick, and noise enough."""
    pairs = [flown(seed, count=40) for seed in SEEDS]
    return [(calibrate_with_trajectory(survey_of(), m), truth, m) for m, truth in pairs]


def nees(result, truth):
    error = result.boresight - truth.boresight
    return error @ np.linalg.solve(result.covariance[:3, :3], error)


def dense_normals(model, prior, state):
    """Normal equations of y and all nodes by differences of the conditions, nothing eliminated."""
    size, K = len(state.x) + 3 * len(state.planes), len(state.error)

    cells, sorted_rays = model.cells, model.tie_planes.rays.take(model.cells.order)
    cell = np.repeat(np.arange(len(cells.ranges)), np.diff(cells.ranges, axis=1)[:, 0])

    def conditions(z, rho):
        moved = state.moved(z[:size], z[size:].reshape(K, 6))
        before, share = moved.error[cells.node[cell]], cells.share[:, None]
        pose = sorted_rays.pose + (1 - share) * before
        pose = pose + share * moved.error[cells.node[cell] + 1]
        mounting = Mounting(lever_arm=LEVER_ARM, boresight=moved.x[:3], range_offsets=moved.x[3:])
        rays = replace(sorted_rays, pose=pose, rho=rho)
        p = georeference(rays, mounting) - model.origin[cells.plane[cell]]
        plane = moved.planes[cells.plane[cell]]
        return np.einsum("na,na->n", p, plane[:, :3]) - plane[:, 3]

    # ranges are the only observations: adjusted, they put each point on its plane
    h, here, rho = 1e-6, np.zeros(size + 6 * K), sorted_rays.rho
    w = conditions(here, rho)
    B = (conditions(here, rho + h) - conditions(here, rho - h)) / (2 * h)
    rho = rho - w / B
    columns = np.eye(size + 6 * K)
    A = np.column_stack(
        [(conditions(h * e, rho) - conditions(-h * e, rho)) / (2 * h) for e in columns]
    )
    weight = 1 / np.square(B * SCANNER.range_sigma)
    N, t = A.T @ (weight[:, None] * A), A.T @ (weight * w)
    diagonal, beside, _ = prior.information(model.nodes.time)
    for k in range(K):
        here = size + 6 * k + COMPONENTS
        N[here, here] += diagonal[k]
        t[here] += diagonal[k] * state.error[k]
        if k + 1 < K:
            N[here, here + 6] += beside[k]
            N[here + 6, here] += beside[k]
            t[here] += beside[k] * state.error[k + 1]
            t[here + 6] += beside[k] * state.error[k]
    u = len(state.x)
    N[np.arange(u), np.arange(u)] += model.pseudo_weight
    t[:u] += model.pseudo_weight * state.x
    return N, t, size


def test_elimination_equals_the_dense_system():
    # encoder noise off: a dense row then has the range's variance alone
    survey = survey_of(scanner=replace(SCANNER, angle_sigma=0.0))
    tie_planes, _ = flown(3, count=15, n_roofs=3)
    model = TrajectoryModel.prepare(survey, tie_planes, "per_ring", 2.0)
    prior = specified_process(NAVIGATION)
    state = iterate(model, prior, model.start(model.unknowns.start())).state
    state = replace(state, x=state.x + 1e-5)  # away from the solution: a step that is not zero
    step = eliminate(model.normals(state), prior, model.nodes.time, state, model.pseudo_weight)
    N, t, size = dense_normals(model, prior, state)
    solution, Q = -np.linalg.solve(N, t), np.linalg.inv(N)
    sigma = np.sqrt(np.diag(Q))
    correlation = Q / np.outer(sigma, sigma)
    # differences of 1e-6 leave seven digits
    np.testing.assert_allclose(step.dy / sigma[:size], solution[:size] / sigma[:size], atol=1e-5)
    np.testing.assert_allclose(
        step.d_error.ravel() / sigma[size:], solution[size:] / sigma[size:], atol=1e-5
    )
    ours = np.linalg.inv(step.S) / np.outer(sigma[:size], sigma[:size])
    np.testing.assert_allclose(ours, correlation[:size, :size], atol=1e-5)


def test_without_noise_as_exact_as_the_others():
    offsets = np.random.default_rng(5).normal(0, 0.015, 16)
    tie_planes, truth, _ = matched_faces(offsets=offsets, boresight_deg=(3, -3, 2))
    scanner = replace(SCANNER, range_sigma=1e-5, angle_sigma=1e-9)
    navigation = replace(NAVIGATION, position_sigma=np.zeros(3), attitude_sigma=np.zeros(3))
    survey = survey_of(scanner=scanner, navigation=navigation)
    result = calibrate_with_trajectory(survey, with_times(tie_planes, HEADINGS_DEG))
    assert np.abs(np.rad2deg(result.boresight - truth.boresight)).max() < 1e-6
    np.testing.assert_allclose(result.range_offsets, offsets, atol=1e-6)
    assert np.abs(result.trajectory.correction).max() < 1e-6


def test_sigma_hold_under_time_correlated_noise(noisy):
    total = sum(nees(result, truth) for result, truth, _ in noisy)
    low, high = stats.chi2.ppf([0.001, 0.999], 3 * len(noisy))
    assert low < total < high


def test_those_of_the_others_do_not(noisy):
    ratios = [nees(calibrate_paper(survey_of(), m, "SL"), truth) / 3 for _, truth, m in noisy[:10]]
    assert np.mean(ratios) > 10


def test_errors_are_smaller_than_those_of_sl(noisy):
    d = np.array([result.boresight - truth.boresight for result, truth, _ in noisy])
    sl = np.array(
        [calibrate_paper(survey_of(), m, "SL").boresight - t.boresight for _, t, m in noisy]
    )
    assert (np.square(d).mean(axis=0) < np.square(sl).mean(axis=0)).all()


def test_sigma_grow_with_the_noise():
    one, _ = flown(0)
    half = replace(
        NAVIGATION,
        position_sigma=NAVIGATION.position_sigma / 2,
        attitude_sigma=NAVIGATION.attitude_sigma / 2,
    )
    full = calibrate_with_trajectory(survey_of(), one)
    less = calibrate_with_trajectory(survey_of(navigation=half), one)
    assert (less.sigma < full.sigma).all()
    assert (less.sigma > full.sigma / 2.2).all()


def test_variance_components_correct_a_prior_wrong_by_two():
    found = []
    for seed in range(6):
        tie_planes, _ = flown(seed, scale=0.5)
        model = TrajectoryModel.prepare(survey_of(), tie_planes, "per_ring", 0.5)
        start = model.start(model.unknowns.start())
        components, _ = estimate(model, specified_process(NAVIGATION), start)
        found.append([components.range, components.position, components.attitude])
    middle = np.exp(np.log(found).mean(axis=0))
    assert middle[0] == pytest.approx(1.0, abs=0.03)
    # the prior draws towards 1, four lines of half a minute hold few independent errors
    assert (np.abs(np.log(middle[1:] / 0.5)) < np.log(1.4)).all()


def test_trajectory_errors_are_found(noisy):
    result, truth, tie_planes = noisy[0]
    corrected = result.trajectory.apply(tie_planes.rays)
    mounting = truth.with_calibration(result.boresight, result.range_offsets)

    def spread(rays):
        p = georeference(rays, mounting)
        plane = result.planes[np.repeat(tie_planes.plane, np.diff(tie_planes.ranges, axis=1)[:, 0])]
        return np.std(np.einsum("na,na->n", p, plane[:, :3]) - plane[:, 3])

    assert spread(corrected) < 0.8 * spread(tie_planes.rays)


def test_a_flight_along_one_heading_says_what_it_sees_badly():
    one_way, _ = flown(1, headings=(0.0, 0.0))
    crossing, _ = flown(1)
    poor = calibrate_with_trajectory(survey_of(), one_way)
    good = calibrate_with_trajectory(survey_of(), crossing)
    assert poor.observability.weakest_word == "roll"
    assert poor.sigma[0] > 2 * good.sigma[0]


def test_rays_without_times_are_refused():
    tie_planes, _, _ = matched_faces()
    with pytest.raises(BadInput, match="times"):
        calibrate_with_trajectory(survey_of(), tie_planes)
