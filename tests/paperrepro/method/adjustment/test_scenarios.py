"""SL, A, B, C: recovery of known boresights, honest covariance, and refusals with a reason."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from paperrepro import _compiled
from paperrepro.errors import BadInput, RankDefect, TooFewPlanes
from paperrepro.method.adjustment.calibrate import calibrate as estimate
from paperrepro.method.adjustment.scenarios import SCENARIOS, Scenario, calibrate
from tests.paperrepro.labelled import (
    HEADINGS_DEG,
    SCANNER,
    matched_faces,
    scaled,
    survey_of,
    with_noise,
    with_offsets,
)

#: Up to 3 deg about each axis, every sign with every other.
BORESIGHTS_DEG = [(3, 3, 3), (-3, 2, 1), (2.5, -3, -3), (-1, -2, 3), (0.5, 3, -3), (0, 0, 0)]
OFFSETS = np.random.default_rng(9).uniform(-0.03, 0.03, 16)
#: Points without noise determine the offsets: the pseudo-observation must not pull.
UNPULLED = replace(SCANNER, range_sigma=1e-4, range_offset_sigma=1e3)


def offsets_of(scenario):
    """A cannot estimate offsets, so the scanner must have none."""
    return OFFSETS if SCENARIOS[scenario].range_offsets == "per_ring" else None


# --- noise-free ----------------------------------------------------------------------------------


@pytest.mark.parametrize("boresight_deg", BORESIGHTS_DEG, ids=str)
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_points_without_noise_return_the_boresight(scenario, boresight_deg):
    tie_planes, truth, _ = matched_faces(
        boresight_deg=boresight_deg, offsets=offsets_of(scenario), count=40
    )
    result = calibrate(survey_of(scanner=UNPULLED), tie_planes, scenario)
    error_deg = np.rad2deg(result.boresight - truth.boresight)
    np.testing.assert_allclose(error_deg, 0, atol=1e-8)
    if result.range_offsets is not None:
        np.testing.assert_allclose(result.range_offsets, OFFSETS, rtol=0, atol=1e-9)


@pytest.mark.parametrize("scenario", ["SL", "C"])
def test_points_without_noise_return_the_planes(scenario):
    tie_planes, _, planes = matched_faces(offsets=offsets_of(scenario), count=40)
    result = calibrate(survey_of(scanner=UNPULLED), tie_planes, scenario)
    np.testing.assert_allclose(result.planes, planes, rtol=0, atol=1e-8)


def test_a_common_offset_is_found_where_every_ring_has_the_same():
    scenario = Scenario("common", "common", free_planes=True, points=None, centroids=False)
    tie_planes, _, _ = matched_faces(offsets=np.full(16, 0.025), count=40)
    result = calibrate(survey_of(scanner=UNPULLED), tie_planes, scenario)
    np.testing.assert_allclose(result.range_offsets, 0.025, rtol=0, atol=1e-9)
    assert result.covariance.shape == (4, 4)


@pytest.mark.parametrize("scenario", ["SL without offsets", "A"])
def test_known_offsets_are_kept_where_none_are_estimated(scenario):
    tie_planes, truth, _ = matched_faces(offsets=OFFSETS, count=40)
    start = truth.with_calibration(np.zeros(3), OFFSETS)
    result = calibrate(survey_of(start), tie_planes, scenario)
    np.testing.assert_allclose(result.boresight, truth.boresight, rtol=0, atol=1e-10)
    assert result.range_offsets is None


# --- noise ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("start_deg", [(1.1, -0.8, 1.3), (-3, 3, -3)], ids=["truth", "far"])
def test_the_estimate_does_not_depend_on_the_start(scenario, start_deg):
    tie_planes, truth, _ = matched_faces(offsets=offsets_of(scenario), count=40)
    tie_planes = with_noise(tie_planes, np.random.default_rng(6))
    start = truth.with_calibration(np.deg2rad(start_deg))
    one, other = (calibrate(survey_of(s), tie_planes, scenario) for s in (None, start))
    np.testing.assert_allclose(one.boresight, other.boresight, rtol=0, atol=1e-10)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-6, atol=1e-16)


N_SEEDS = 300


@pytest.fixture(scope="module", params=["SL", "C"])
def errors(request):
    """Errors and results over `N_SEEDS` draws of white noise, and of offsets where estimated."""
    base, truth, _ = matched_faces(count=30, n_roofs=3)
    rows = []
    for seed in range(N_SEEDS):
        rng = np.random.default_rng(seed)
        offsets = rng.normal(0, SCANNER.range_offset_sigma, 16)
        offsets *= SCENARIOS[request.param].range_offsets == "per_ring"
        tie_planes = with_noise(with_offsets(base, offsets), rng)
        result = calibrate(survey_of(), tie_planes, request.param)
        error = np.append(result.boresight - truth.boresight, offsets)
        if result.range_offsets is not None:
            error[3:] = result.range_offsets - offsets
        rows.append((error[: len(result.covariance)], result))
    return rows


def share(error, covariance):
    """Squared error in units of its covariance, one on average."""
    return error @ np.linalg.solve(covariance, error) / len(error)


def chi_square_band(n):
    """99.9 % of means of squared standardised errors over `N_SEEDS` draws of n unknowns."""
    return chi2.ppf([0.0005, 0.9995], N_SEEDS * n) / (N_SEEDS * n)


def test_white_noise_gives_the_errors_that_the_covariance_promises(errors):
    """The honest check of variance propagation: sigmas 8 % too small or large fail."""
    mean = np.mean([share(e[:3], result.covariance[:3, :3]) for e, result in errors])
    low, high = chi_square_band(3)
    assert low < mean < high
    assert high < 1.08**2


def test_all_unknowns_keep_what_the_covariance_promises(errors):
    """C counts each point in a centroid too, a thirtieth of its weight: 1.5 times that is free."""
    mean = np.mean([share(e, result.covariance) for e, result in errors])
    low, high = chi_square_band(len(errors[0][0]))
    assert low - 0.05 < mean < high + 0.05


def test_the_variance_factor_of_white_noise_is_one(errors):
    """C's centroids have the variance of one pose but the mean of thirty: a little below one."""
    squares = np.array([result.sigma0**2 for _, result in errors])
    allowed = 4 * np.sqrt(2 / errors[0][1].dof / N_SEEDS)
    least = 1 - allowed - (0.05 if errors[0][1].scenario == "C" else 0)
    assert least < squares.mean() < 1 + allowed


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_sigma_grows_with_the_noise_when_the_specification_knows(scenario):
    """2 %: twice the noise is linearised elsewhere."""
    base, _, _ = matched_faces(count=40)
    results = [
        calibrate(survey_of(**scaled(k)), with_noise(base, np.random.default_rng(3), k), scenario)
        for k in (1, 2)
    ]
    np.testing.assert_allclose(results[1].sigma / results[0].sigma, 2, rtol=0.02)
    assert results[1].sigma0 == pytest.approx(results[0].sigma0, rel=0.01)


@pytest.mark.parametrize("scenario", ["SL without offsets", "A"])
def test_the_variance_factor_grows_when_the_specification_does_not_know(scenario):
    """Where no pseudo-observation takes part; 2 % as above."""
    base, _, _ = matched_faces(count=40)
    one, two = (
        calibrate(survey_of(), with_noise(base, np.random.default_rng(3), k), scenario)
        for k in (1, 2)
    )
    assert two.sigma0 / one.sigma0 == pytest.approx(2, rel=0.02)
    np.testing.assert_allclose(two.sigma / one.sigma, 2, rtol=0.03)


# --- the result ----------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=SCENARIOS)
def noisy_result(request):
    tie_planes, _, _ = matched_faces(offsets=offsets_of(request.param), count=40)
    tie_planes = with_noise(tie_planes, np.random.default_rng(7))
    return calibrate(survey_of(), tie_planes, request.param), tie_planes


def test_a_result_counts_its_conditions(noisy_result):
    """12 planes of 4 faces of 40 points, 6 pairs each."""
    result, tie_planes = noisy_result
    points, centroids = {"SL": (1920, 0), "A": (0, 72), "B": (2880, 72), "C": (1920, 48)}[
        result.scenario
    ]
    unknowns = {"SL": 3 + 36, "A": 3, "B": 3, "C": 3 + 36}[result.scenario]
    assert result.n_conditions == points + centroids
    assert result.dof == points + centroids - unknowns
    assert (result.n_planes, result.n_points) == (12, len(tie_planes.rays))


def test_a_result_tells_what_the_calibration_gained(noisy_result):
    """A degree of boresight throws strips decimetres apart; afterwards noise is left."""
    result, _ = noisy_result
    noise = np.hypot(SCANNER.range_sigma, 0.04)
    assert result.rmse_before > 0.2
    assert 0.5 * noise < result.rmse_after < 1.5 * noise
    pooled = np.average(result.rms_after**2, weights=result.points_per_plane)
    assert result.rmse_after == pytest.approx(np.sqrt(pooled))


def test_a_result_s_planes_have_unit_normals_that_point_up(noisy_result):
    planes = noisy_result[0].planes
    np.testing.assert_allclose((planes[:, :3] ** 2).sum(axis=1), 1, atol=1e-12)
    assert (planes[:, 2] > 0).all()


def test_a_result_s_sigma_and_correlation_are_those_of_its_covariance(noisy_result):
    result, _ = noisy_result
    np.testing.assert_allclose(np.diag(result.correlation), 1)
    assert np.abs(result.correlation).max() <= 1 + 1e-12
    all_sigma = np.sqrt(np.diag(result.covariance))
    np.testing.assert_array_equal(result.sigma, all_sigma[:3])
    if result.range_offsets is None:
        assert result.sigma_offsets is None
    else:
        np.testing.assert_array_equal(result.sigma_offsets, all_sigma[3:])


# --- determinism ---------------------------------------------------------------------------------


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_the_same_input_gives_the_same_bits(scenario):
    tie_planes = with_noise(matched_faces(count=40)[0], np.random.default_rng(2))
    one, other = (calibrate(survey_of(), tie_planes, scenario) for _ in range(2))
    for name in ("boresight", "covariance", "planes", "covariance_planes", "rms_after"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert (one.sigma0, one.iterations) == (other.sigma0, other.iterations)


@pytest.mark.parametrize("scenario", ["SL", "A", "B", "C"])
def test_one_thread_or_two_give_the_same(scenario, monkeypatch):
    tie_planes = with_noise(matched_faces(count=40)[0], np.random.default_rng(2))
    found = []
    for threads in (1, 2):
        monkeypatch.setattr(_compiled, "threads", lambda threads=threads: threads)
        result = calibrate(survey_of(), tie_planes, scenario)
        found.append((result.boresight, result.covariance))
    np.testing.assert_array_equal(found[0][0], found[1][0])
    np.testing.assert_array_equal(found[0][1], found[1][1])


# --- refusals ------------------------------------------------------------------------------------


def refused(error, tie_planes, scenario, *facts, survey=None):
    with pytest.raises(error) as raised:
        calibrate(survey or survey_of(), tie_planes, scenario)
    for fact in facts:
        assert fact in str(raised.value)


def test_an_unknown_scenario():
    refused(BadInput, matched_faces(count=10)[0], "D4", "'D4'", "expected one of SL, A, B, C")


@pytest.mark.parametrize("scenario", ["A", "B"])
def test_no_pairs_for_reference_planes(scenario):
    tie_planes = replace(matched_faces(count=10)[0], pairs=np.zeros((0, 2), int))
    refused(TooFewPlanes, tie_planes, scenario, f"scenario {scenario}", "pairs of faces", "match")


def test_no_more_conditions_than_unknowns():
    """Three pairs for three angles: an estimate without a check. Six pairs on each plane."""
    tie_planes = matched_faces(count=40)[0]
    three = replace(tie_planes, pairs=tie_planes.pairs[[1, 19, 37]])
    refused(TooFewPlanes, three, "A", "3 conditions", "0 degrees of freedom", "more faces")


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_parallel_planes(scenario):
    """Flat roofs of one slope and azimuth, at several heights."""
    tie_planes, _, _ = matched_faces(count=20)
    same = np.flatnonzero(tie_planes.plane == 0)
    ranges, plane = tie_planes.ranges[np.tile(same, 4)], np.repeat(np.arange(4), len(same))
    pairs = np.array([(len(same) * k, len(same) * k + 1) for k in range(4)])
    rows = np.concatenate([np.arange(first, stop) for first, stop in ranges])
    stops = np.cumsum(np.diff(ranges, axis=1))
    parallel = replace(
        tie_planes, rays=tie_planes.rays.take(rows), plane=plane, pairs=pairs,
        ranges=np.column_stack([np.r_[0, stops[:-1]], stops]), strips=tie_planes.strips[:16],
    )  # fmt: skip
    facts = ("all 4 planes are parallel", "expected roofs of several slopes and azimuths")
    refused(RankDefect, parallel, scenario, *facts)


@pytest.mark.parametrize("scenario", ["SL", "C"])
@pytest.mark.parametrize("noise", [0.0, 1.0], ids=["exact", "noisy"])
@pytest.mark.parametrize("count", [30, 1500])
def test_one_heading_does_not_show_the_roll(scenario, noise, count):
    """A roll of the mounting turns everything seen from one straight line as a whole.

    Noise must not pass for geometry either, neither in few points nor in so many that their formal
    standard deviation falls below the limit.
    """
    tie_planes, _, _ = matched_faces(headings=(0.0,), gusts=False, count=count)
    tie_planes = with_noise(tie_planes, np.random.default_rng(1), noise)
    refused(
        RankDefect, tie_planes, scenario, "boresight's roll", "opposite and a crossing direction"
    )


def test_opposite_headings_on_one_line_hide_the_yaw_from_centroids():
    tie_planes, _, _ = matched_faces(headings=HEADINGS_DEG[:2], count=40)
    tie_planes = with_noise(tie_planes, np.random.default_rng(1))
    refused(RankDefect, tie_planes, "A", "boresight's yaw", "expected at most 1 deg", "crossing")


def test_the_weakest_direction_is_told_with_a_result():
    tie_planes, _, _ = matched_faces(headings=HEADINGS_DEG[:2], count=40)
    seen = calibrate(survey_of(), tie_planes, "C").observability
    assert "mostly yaw" in str(seen)
    assert seen.rank == 3
    np.testing.assert_allclose(seen.weakest, [0, 0, 1], atol=0.1)
    assert np.rad2deg(seen.weakest_sigma) == pytest.approx(0.09, abs=0.02)


def test_range_offsets_that_the_data_determine_are_counted():
    """A ring that saw nothing is known by its pseudo-observation alone."""
    tie_planes, _, _ = matched_faces(count=120)
    assert calibrate(survey_of(), tie_planes, "C").observability.offsets_determined == 16
    blind = replace(
        tie_planes, rays=replace(tie_planes.rays, ring=np.maximum(tie_planes.rays.ring, 1))
    )
    assert calibrate(survey_of(), blind, "C").observability.offsets_determined == 15


@pytest.mark.parametrize(
    ("scenario", "what"), [("SL", "plane 0"), ("A", "face 0 of F1"), ("B", "face 0 of F1")]
)
@pytest.mark.parametrize("shape", ["point", "line"])
def test_faces_that_are_lines_or_points(scenario, what, shape):
    """All points of the first plane on one spot, or 6 m along the strike of its roof."""
    tie_planes, _, planes = matched_faces(count=20)
    rows = np.arange(len(tie_planes.rays))
    rows[:80] = 0
    pose = tie_planes.rays.pose[rows]
    strike = np.cross(planes[0, :3], [0, 0, 1])
    reach = 3.0 if shape == "line" else 0.0
    pose[:80, :3] += np.linspace(-reach, reach, 80)[:, None] * strike / np.linalg.norm(strike)
    narrow = replace(tie_planes, rays=replace(tie_planes.rays.take(rows), pose=pose))
    facts = (what, "on a line or in a point", "expected a width of 5 cm", "got 0.0 cm", "leave")
    refused(RankDefect, narrow, scenario, *facts)


@pytest.mark.parametrize("scenario", ["SL", "B", "C"])
def test_few_points_a_face_pose_few_conditions_and_find_the_same_boresight(scenario):
    """Without noise the number of points is of no matter; the sigmas grow as conditions go."""
    tie_planes, truth, _ = matched_faces(count=60)
    found = {n: estimate(survey_of(), tie_planes, f"{scenario} {n}") for n in (3, 20, "all")}
    for n, result in found.items():
        assert result.scenario == f"{scenario} {n}"
        np.testing.assert_allclose(result.boresight, truth.boresight, atol=1e-9)
    dof = [found[n].dof for n in (3, 20, "all")]
    assert dof[0] < dof[1] < dof[2]


@pytest.mark.parametrize(
    "scenario", ["E", "SL 0", "C 0", "B few", "B 3 4", "SL offsets", "", "B -1"]
)
def test_variants_that_make_no_sense_are_refused(scenario):
    with pytest.raises(BadInput, match="expected one of SL, A, B, C, D"):
        estimate(survey_of(), matched_faces()[0], scenario)


def test_centroids_alone_of_b_are_the_conditions_of_a():
    tie_planes, _, _ = matched_faces(count=60)
    tie_planes = with_noise(tie_planes, np.random.default_rng(2))
    a = estimate(survey_of(), tie_planes, "A")
    b = estimate(survey_of(), tie_planes, "B 0 without offsets")
    np.testing.assert_allclose(b.boresight, a.boresight, atol=1e-12)
    np.testing.assert_allclose(b.covariance, a.covariance, rtol=1e-9)
