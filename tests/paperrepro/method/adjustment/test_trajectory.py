"""Scenario D: the textbook solution, exactness without noise, sigma that hold with it."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from paperrepro.errors import BadInput
from paperrepro.method.adjustment import trajectory_solver
from paperrepro.method.adjustment.block_cholesky import BlockCholesky
from paperrepro.method.adjustment.result import TrajectoryErrors
from paperrepro.method.adjustment.scenarios import calibrate as calibrate_paper
from paperrepro.method.adjustment.trajectory_components import (
    _PRIOR_SIGMA,
    Likelihood,
    VarianceComponents,
)
from paperrepro.method.adjustment.trajectory_equations import Cells, GaussMarkov
from paperrepro.method.adjustment.trajectory_errors import (
    calibrate_with_trajectory,
    find_noise,
    specified_process,
)
from paperrepro.method.adjustment.trajectory_solver import (
    Noise,
    State,
    TrajectoryModel,
    _turned,
    eliminate,
    iterate,
    prior_chi2,
)
from paperrepro.method.adjustment.trajectory_windows import dissection, windows
from paperrepro.method.georeference import georeference
from paperrepro.survey import Mounting, Rays
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


PROCESSES = (
    specified_process(NAVIGATION),
    GaussMarkov(0.3 * specified_process(NAVIGATION).sigma, np.full(6, 4.0)),
)
CONSTANT = np.r_[0.01, 0.01, 0.02, np.deg2rad([0.01, 0.01, 0.03])]
NOISE = Noise(PROCESSES, CONSTANT, surface=0.004, roughness=0.003)


def dense_normals(model, noise, state):
    """Normal equations of everything by differences of the conditions, nothing eliminated:
    x, planes, constants, then nodes with all processes, surface errors and one offset a cell."""
    u, G, F, K, P = (
        len(state.x), len(state.planes), len(state.surface), len(state.error), len(noise.processes),
    )  # fmt: skip
    sizes = [u, 3 * G, 6, 6 * K * P, 3 * F, len(model.cells.ranges)]
    ends = np.cumsum(sizes)
    cells, sorted_rays = model.cells, model.tie_planes.rays.take(model.cells.order)
    cell = np.repeat(np.arange(len(cells.ranges)), np.diff(cells.ranges, axis=1)[:, 0])
    pose_rate = cells.rate if len(cells.rate) else np.zeros((len(cell), 6))

    def conditions(z, rho):
        x, planes, constant, error, surface, rough = np.split(z, ends[:-1])
        moved = State(
            state.x + x,
            _turned(state.planes, model.bases(state.planes), planes.reshape(-1, 3)),
            state.error + error.reshape(state.error.shape), state.constant + constant,
            state.surface + surface.reshape(-1, 3),
        )  # fmt: skip
        before, share = moved.correction[cells.node[cell]], cells.share[:, None]
        pose = sorted_rays.pose + (1 - share) * before
        pose = pose + share * moved.correction[cells.node[cell] + 1]
        pose = pose + model.unknowns.clock_delay(moved.x) * pose_rate
        offsets = moved.x[3 : model.unknowns.kept]
        mounting = Mounting(lever_arm=LEVER_ARM, boresight=moved.x[:3], range_offsets=offsets)
        p = georeference(replace(sorted_rays, pose=pose, rho=rho), mounting)
        plane, face = model.view_planes(moved)[cells.face[cell]], cells.face[cell]
        p = p - model.origin[model.tie_planes.plane[face]]
        return np.einsum("na,na->n", p, plane[:, :3]) - plane[:, 3] - rough[cell]

    # ranges are the only observations: adjusted, they put each point on its plane
    h, here, rho = 1e-6, np.zeros(ends[-1]), sorted_rays.rho
    w = conditions(here, rho)
    B = (conditions(here, rho + h) - conditions(here, rho - h)) / (2 * h)
    rho = rho - w / B
    A = np.column_stack(
        [(conditions(h * e, rho) - conditions(-h * e, rho)) / (2 * h) for e in np.eye(ends[-1])]
    )
    weight = 1 / np.square(B * SCANNER.range_sigma)
    N, t = A.T @ (weight[:, None] * A), A.T @ (weight * w)
    L = dense_prior(model, noise, K, F, ends)
    values = np.concatenate(
        [state.x, np.zeros(3 * G), state.constant, state.error.ravel(), state.surface.ravel(),
         np.zeros(sizes[-1])]
    )  # fmt: skip
    return N + L, t + L @ values, ends, float(w @ (weight * w))


def dense_prior(model, noise, K, F, ends):
    L = np.zeros((ends[-1], ends[-1]))
    u = ends[0]
    L[:u, :u] = np.diag(model.pseudo_weight)
    L[ends[1] : ends[2], ends[1] : ends[2]] = np.diag(noise.constant_weight)
    for p, process in enumerate(noise.processes):
        lag = np.abs(model.nodes.time[:, None] - model.nodes.time)
        for c in COMPONENTS:
            covariance = process.sigma[c] ** 2 * np.exp(-lag / process.correlation_time[c])
            at = ends[2] + 6 * (len(noise.processes) * np.arange(K) + p) + c
            L[np.ix_(at, at)] = np.linalg.inv(covariance)
    for first, last, weight in (
        (ends[3], ends[4], noise.surface_weight), (ends[4], ends[5], noise.roughness_weight),
    ):  # fmt: skip
        L[first:last, first:last] = weight * np.eye(last - first)
    return L


@pytest.fixture(scope="module")
def small():
    """A model with all that can be unknown, and a state off its solution."""
    # encoder noise off: a dense row then has the range's variance alone
    survey = survey_of(scanner=replace(SCANNER, angle_sigma=0.0))
    tie_planes, _ = flown(3, count=15, n_roofs=3)
    model = TrajectoryModel.prepare(survey, tie_planes, "per_ring", 2.0)
    rate = np.random.default_rng(0).normal(
        0, [4, 4, 1, 0.05, 0.05, 0.02], (len(tie_planes.rays), 6)
    )
    unknowns = replace(model.unknowns, clock=True)
    model = replace(
        model, unknowns=unknowns, cells=Cells.of(tie_planes, model.nodes, lambda _: rate),
        pseudo_weight=unknowns.pseudo_weight(SCANNER.range_offset_sigma),
    )  # fmt: skip
    cut = windows(model.cells, model.nodes, tie_planes.plane, model.to_plane, least=3)
    model = replace(model, windows=cut, order=dissection(cut, model.origin))
    state = iterate(model, NOISE, model.start(unknowns.start(), 2)).state
    return model, replace(state, x=state.x + 1e-5, constant=state.constant + 1e-4)


def test_windows_are_cut_where_no_view_is(small):
    model, _ = small
    assert len(model.windows) > 1
    assert sorted(np.concatenate([w.cells for w in model.windows])) == list(
        range(len(model.cells.ranges))
    )
    faces = np.concatenate([w.faces for w in model.windows])
    assert len(np.unique(faces)) == len(faces)


def test_elimination_equals_the_dense_system(small):
    model, state = small
    data = model.normals(state, NOISE)
    step = eliminate(data, model, NOISE, state)
    N, t, ends, chi2 = dense_normals(model, NOISE, state)
    solution, Q = -np.linalg.solve(N, t), np.linalg.inv(N)
    sigma, size = np.sqrt(np.diag(Q)), ends[2]
    ours = np.concatenate([step.dy, step.d_error.ravel(), step.d_surface.ravel()])
    known = sigma[: ends[4]]
    # differences of 1e-6 leave seven digits
    np.testing.assert_allclose(ours / known, solution[: ends[4]] / known, atol=1e-4)
    outer = np.outer(sigma[:size], sigma[:size])
    np.testing.assert_allclose(
        step.columns(size)[:size] / outer, Q[:size, :size] / outer, atol=1e-4
    )
    own = ends[0] + np.arange(3 * len(state.planes)).reshape(-1, 3)
    of_planes = Q[own[:, :, None], own[:, None]] / (sigma[own][:, :, None] * sigma[own][:, None])
    scaled = step.of_planes() / (sigma[own][:, :, None] * sigma[own][:, None])
    np.testing.assert_allclose(scaled, of_planes, atol=1e-4)
    variance, beside, surface = step.covariance()
    K, P = variance.shape[:2]
    of_nodes = np.diag(Q)[size : ends[3]].reshape(K, P, 6)
    np.testing.assert_allclose(variance, of_nodes, rtol=1e-4)
    at = np.arange(size, ends[3]).reshape(K, P, 6)
    np.testing.assert_allclose(beside, Q[at[:-1], at[1:]], rtol=1e-3, atol=1e-4 * of_nodes.max())
    np.testing.assert_allclose(surface.ravel(), np.diag(Q)[ends[3] : ends[4]], rtol=1e-4)
    mixed, mixed_beside, _ = step.covariance(1)
    other, most = np.roll(at, -1, axis=1), 1e-4 * of_nodes.max()
    np.testing.assert_allclose(mixed, Q[at, other], rtol=1e-3, atol=most)
    np.testing.assert_allclose(mixed_beside, Q[at[:-1], other[1:]], rtol=1e-3, atol=most)
    # determinant, and by how much the sum of squares falls
    rough = (ends[5] - ends[4]) * np.log(NOISE.roughness_weight)
    assert step.log_det == pytest.approx(np.linalg.slogdet(N)[1] - rough, abs=1e-3)
    fall = t @ np.linalg.solve(N, t) - (chi2 - data.chi2)
    assert step.decrement == pytest.approx(fall, rel=1e-4)


def test_of_the_inverse_no_more_is_made_than_is_asked_for(monkeypatch):
    """At no size a dense inverse, nor columns of it for all unknowns."""
    tie_planes, _ = flown(0, count=20, n_roofs=12)
    solved, inverted, solve, inv = [], [], BlockCholesky.solve, np.linalg.inv
    monkeypatch.setattr(
        BlockCholesky, "solve", lambda self, b: solved.append(b.shape[1]) or solve(self, b)
    )
    monkeypatch.setattr(np.linalg, "inv", lambda a: inverted.append(len(a)) or inv(a))
    result = calibrate_with_trajectory(survey_of(), tie_planes, near=np.zeros(3))
    assert result.covariance_planes.shape == (24, 4, 4)
    assert max(solved) == 3
    assert max(inverted) < 3 * 24 + 6  # planes and constants alone are as many


def test_control_points_equal_the_dense_system(small):
    """Planes that go through known points within 5 mm and 2 cm: by differences of how far up the
    points lie over the planes."""
    free, state = small
    G, u = len(state.planes), len(state.x)
    control = np.full((G, 4), np.nan)
    control[1] = [*free.origin[1] + [0.4, -0.3, 0.05], 0.005]
    control[G - 1] = [*free.origin[-1] + [-0.2, 0.5, -0.02], 0.02]
    model = replace(free, tie_planes=replace(free.tie_planes, control=control))

    def heights(turns):
        planes = _turned(state.planes, free.bases(state.planes), turns.reshape(-1, 3))
        step = control[[1, -1], :3] - free.origin[[1, -1]]
        plane = planes[[1, -1]]
        return (np.einsum("ca,ca->c", plane[:, :3], step) - plane[:, 3]) / plane[:, 2]

    h, at, weight = 1e-6, u + np.arange(3 * G), control[[1, -1], 3] ** -2.0
    A = [(heights(h * e) - heights(-h * e)) / (2 * h) for e in np.eye(3 * G)]
    A, miss = np.transpose(A), heights(np.zeros(3 * G))
    N, t, ends, _ = dense_normals(free, NOISE, state)
    N[np.ix_(at, at)] += A.T @ (weight[:, None] * A)
    t[at] += A.T @ (weight * miss)
    step, Q = eliminate(model.normals(state, NOISE), model, NOISE, state), np.linalg.inv(N)
    sigma, size = np.sqrt(np.diag(Q)), ends[2]
    np.testing.assert_allclose(step.dy / sigma[:size], -(Q @ t)[:size] / sigma[:size], atol=1e-4)
    outer = np.outer(sigma[:size], sigma[:size])
    np.testing.assert_allclose(
        step.columns(size)[:size] / outer, Q[:size, :size] / outer, atol=1e-4
    )
    without = eliminate(free.normals(state, NOISE), free, NOISE, state)
    assert np.abs(without.dy - step.dy).max() > 1e-3  # it does say something
    more = prior_chi2(model, NOISE, state) - prior_chi2(free, NOISE, state)
    assert more == pytest.approx(weight @ miss**2)


def test_gradient_of_the_likelihood_is_that_of_its_values(small):
    model, state = small
    specified = specified_process(NAVIGATION)
    middle = VarianceComponents().logs
    likelihood = Likelihood(model, specified, state, model.blocks(state), 1.0).at(middle[-1])
    logs = middle + np.random.default_rng(1).normal(0, 0.2, len(middle))
    logs[-1] = middle[-1]
    _, gradient = likelihood(logs)
    for k in range(len(logs) - 1):
        h = 1e-4 * (np.arange(len(logs)) == k)
        slope = (likelihood(logs + h)[0] - likelihood(logs - h)[0]) / 2e-4
        assert gradient[k] == pytest.approx(slope, rel=1e-3, abs=0.02)


def test_average_information_is_that_of_the_squares(small):
    """Where variances have logarithms, half the second derivatives of the weighted squares, but for
    what the curvature of the exponential adds."""
    model, state = small
    middle = VarianceComponents().logs
    likelihood = Likelihood(
        model, specified_process(NAVIGATION), state, model.blocks(state), 1.0
    ).at(middle[-1])

    def squares(*moves):
        step, _, before = likelihood.step(middle + 0.01 * np.sum(moves, axis=0))
        return before - step.decrement

    _, _, information = likelihood.information(middle)
    information -= 2 * np.diag(_PRIOR_SIGMA**-2.0)
    unit = np.eye(len(middle))
    for i, j in ((0, 0), (0, 1), (1, 1), (2, 2), (2, 5), (0, 3), (6, 3), (6, 10), (12, 12)):
        mixed = sum(a * b * squares(a * unit[i], b * unit[j]) for a in (1, -1) for b in (1, -1))
        slope = (squares(unit[i]) - squares(-unit[i])) / 0.02 if i == j else 0.0
        assert information[i, j] == pytest.approx(mixed / 8e-4 - slope, rel=2e-3, abs=0.02)


def test_flat_roofs_have_no_surface_error_and_the_model_costs_nothing():
    surface, rough, ratio = [], [], []
    for seed in range(4):
        tie_planes, _ = flown(seed, count=80)
        found = find_noise(survey_of(), tie_planes, np.zeros(3))
        surface.append(found.components.surface)
        rough.append(found.components.roughness)
        model = TrajectoryModel.prepare(survey_of(), tie_planes, "per_ring", 0.5)
        state = model.start(model.unknowns.start())
        flat = Noise((specified_process(NAVIGATION),), np.zeros(6), 0.0)
        bumpy = replace(flat, surface=surface[-1], roughness=rough[-1])
        sigma = [
            np.sqrt(np.diag(eliminate(model.normals(state, noise), model, noise, state).columns(3)))
            for noise in (flat, bumpy)
        ]
        ratio.append(sigma[1] / sigma[0])
    assert np.max(surface) < 0.002
    assert np.mean(ratio) < 1.03


def test_surface_errors_are_found_as_large_as_they_are():
    found = []
    for seed in range(4):
        tie_planes, truth = flown(seed, count=80)
        bumpy = with_surface_errors(tie_planes, truth, np.random.default_rng(seed), 0.015)
        found.append(find_noise(survey_of(), bumpy, truth.boresight).components.surface)
    assert np.mean(found) == pytest.approx(0.015, rel=0.25)


def with_surface_errors(tie_planes, truth, rng, sigma):
    """Each view moved by an offset and two tilts, by its ranges."""
    rays = tie_planes.rays
    p = georeference(rays, truth)
    per_metre = georeference(replace(rays, rho=rays.rho + 1.0), truth) - p
    rho = rays.rho.copy()
    for rows in (slice(*view) for view in tie_planes.ranges):
        about = p[rows] - p[rows].mean(axis=0)
        _, spread, axes = np.linalg.svd(about, full_matrices=False)
        extent = np.sqrt(np.square(spread[:2]).sum() / len(about) / 2)
        offset, *tilts = rng.normal(0, sigma, 3)
        moved = offset + about @ axes[:2].T @ tilts / extent
        rho[rows] += moved / (per_metre[rows] @ axes[2])
    return replace(tie_planes, rays=replace(rays, rho=rho))


def test_a_late_clock_is_found():
    tie_planes, truth = flown(2, count=80)
    rate = np.random.default_rng(5).normal(0, [4, 4, 1, 0.3, 0.3, 0.1], (len(tie_planes.rays), 6))
    rays = replace(tie_planes.rays, pose=tie_planes.rays.pose - 0.005 * rate)
    late = replace(tie_planes, rays=rays)
    span = np.array([rays.time.min() - 1, rays.time.max() + 1])
    survey = replace(survey_of(), trajectory=Rated(rays, rate, span))
    found = find_noise(survey, late, truth.boresight)
    clock = calibrate_with_trajectory(survey, late, found=found, near=truth.boresight).clock
    assert clock.delay == pytest.approx(0.005, abs=4 * clock.sigma)
    assert clock.sigma < 0.0005


@dataclass(frozen=True)
class Rated:
    """A trajectory whose rates are given, point by point."""

    rays: Rays
    values: np.ndarray
    time: np.ndarray

    def rate(self, time):
        return self.values

    def at(self, time):
        late = self.rays.time.min() - 1 - self.time[0]
        return self.rays.pose + (time + late - self.rays.time)[:, None] * self.values


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


def test_errors_between_nodes_are_those_of_the_processes():
    """Mean and sigma at any time are what the Gauss-Markov covariances make of the nodes'."""
    rng, time = np.random.default_rng(2), np.array([10.0, 10.5, 18.0])
    worse = np.array([0.0, 40.0]), np.array([np.full(6, 0.5), np.full(6, 2.5)])
    processes = GaussMarkov(np.full(6, 2.0), np.full(6, 20.0), worse), GaussMarkov(*np.ones((2, 6)))
    prior = [process_covariance(process, time, time) for process in processes]
    prior = np.block([[prior[0], np.zeros((3, 3))], [np.zeros((3, 3)), prior[1]]])
    gain = rng.normal(0, 0.3, (4, 6))  # four observations of the sums' errors
    posterior = prior - prior @ gain.T @ np.linalg.solve(gain @ prior @ gain.T + np.eye(4),
                                                         gain @ prior)  # fmt: skip
    mean = rng.normal(size=6)  # process by process
    blocks = posterior.reshape(2, 3, 2, 3)
    same = np.array([[[blocks[p, k, (p + s) % 2, k] for p in (0, 1)] for k in range(3)]
                     for s in (0, 1)])  # fmt: skip
    beside = np.array([[[blocks[p, k, (p + s) % 2, k + 1] for p in (0, 1)] for k in range(2)]
                       for s in (0, 1)])  # fmt: skip
    spread = [np.repeat(part[..., None], 6, axis=-1) for part in (same, beside)]
    errors = TrajectoryErrors(
        time, np.repeat(mean.reshape(2, 3).T[..., None], 6, axis=-1), *spread, processes,
        np.full(6, 0.1), np.zeros(6),
    )  # fmt: skip
    asked = np.array([5.0, 10.0, 10.1, 12.0, 17.9, 18.0, 30.0, 1e4])
    across = [process_covariance(process, asked, time) for process in processes]
    A = np.concatenate(across, axis=1) @ np.linalg.inv(prior)
    variance = 4 * processes[0].factor(asked)[:, 0] ** 2 + 1
    variance -= np.einsum("nk,kl,nl->n", A, prior - posterior, A)
    found, sigma = errors.at(asked)
    np.testing.assert_allclose(found[:, 3], 0.1 + A @ mean, atol=1e-12)
    np.testing.assert_allclose(sigma[:, 3] ** 2, variance, rtol=1e-10)
    np.testing.assert_allclose(errors.at(time)[1], errors.sigma, rtol=1e-10)
    assert found[-1] == pytest.approx(np.full(6, 0.1))


def process_covariance(process, one, other):
    lag = np.abs(one[:, None] - other)
    sigma = (process.sigma[0] * process.factor(time)[:, :1] for time in (one, other))
    return next(sigma) * next(sigma).T * np.exp(-lag / process.correlation_time[0])


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
        tie_planes, truth = flown(seed, scale=0.5)
        components = find_noise(survey_of(), tie_planes, truth.boresight).components
        found.append([components.range, *components.sigma])
    middle = np.exp(np.log(found).mean(axis=0))
    assert middle[0] == pytest.approx(1.0, abs=0.03)
    # the prior draws towards 1, four lines of half a minute hold few independent errors
    assert (np.abs(np.log(middle[1:] / 0.5)) < np.log(1.5)).all()


def test_what_the_components_leave_open_widens_sigma():
    tie_planes, truth = flown(1)
    found = find_noise(survey_of(), tie_planes, truth.boresight)
    assert (np.linalg.eigvalsh(found.open) >= -1e-18).all()
    told = replace(found, open=np.zeros((3, 3)))
    wide, narrow = (
        calibrate_with_trajectory(survey_of(), tie_planes, found=f, near=truth.boresight)
        for f in (found, told)
    )
    assert (wide.sigma > narrow.sigma).all()
    np.testing.assert_array_equal(wide.boresight, narrow.boresight)


def test_constants_are_what_the_processes_leave_of_the_specification():
    specified = specified_process(NAVIGATION)
    quiet = VarianceComponents(
        VarianceComponents().logs - np.log(5) * np.isin(np.arange(15), range(2, 6))
    )
    left = quiet.constant(specified)
    assert (left[:3] == 0).all()
    expected = specified.sigma[3:] * np.sqrt(1 - 0.04)
    np.testing.assert_allclose(left[3:], expected)
    assert not VarianceComponents().constant(specified).any()


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


def test_a_specification_of_no_error_at_all_is_no_obstacle():
    tie_planes, truth = flown(2, scale=0.0, count=80)
    survey = survey_of()
    exact = replace(NAVIGATION, position_sigma=np.zeros(3), attitude_sigma=np.zeros(3))
    survey = replace(survey, navigation=exact)
    found = find_noise(survey, tie_planes, truth.boresight)
    result = calibrate_with_trajectory(survey, tie_planes, found=found, near=truth.boresight)
    assert nees(result, truth) < 16.3  # once in a thousand


def test_a_constant_is_part_of_what_a_pose_has():
    """Else an angle known as well as a pose were called undetermined by too few lines."""
    tie_planes, truth = flown(1, scale=0.2, count=80)
    found = find_noise(survey_of(), tie_planes, truth.boresight)
    result = calibrate_with_trajectory(survey_of(), tie_planes, found=found, near=truth.boresight)
    assert result.trajectory.constant_sigma[3] > 0.5 * NAVIGATION.attitude_sigma[0]
    assert result.observability.attitude_sigma[0] > result.trajectory.constant_sigma[3]
    assert not result.observability.undetermined


def test_steps_that_swing_about_the_minimum_are_halved(monkeypatch):
    """Uneven faces make steps nearly twice too long: whole ones would not end in fifty."""

    def too_long(data, model, noise, state):
        dz = np.array([-1.98 * state])
        return SimpleNamespace(dz=dz, dy=dz, d_error=dz, decrement=float(dz @ dz))

    model = SimpleNamespace(
        blocks=lambda state, final_m: state,
        assemble=lambda blocks, noise: blocks,
        moved=lambda state, step, share=1.0: state + share * step.dz[0],
    )
    monkeypatch.setattr(trajectory_solver, "eliminate", too_long)
    solution = iterate(model, None, 1.0)
    assert abs(solution.state) < 1e-9
    assert solution.iterations < 12
