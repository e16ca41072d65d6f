"""From a survey to a calibration, by the method's own segmentation and matching."""

from dataclasses import replace

import numpy as np
import pytest

from data_synth import make_config, simulate
from data_synth.evaluation import false_pairs, judge_views
from paperrepro.errors import BadInput, EmptyStrip, OutsideTrajectory, TooFewPlanes
from paperrepro.method import calibrate_all, calibrate_survey, coarse_to_fine, refine_all
from paperrepro.method.coarse_to_fine import RoofSearch, find_candidates, find_roofs, planes_under
from paperrepro.method.parameters import Parameters
from paperrepro.survey import Strip, Trajectory

SCENARIOS = ("SL", "A", "B", "C")
#: Noise-free, from own segmentation, degrees: a few points of chimneys and edges remain on faces.
OWN_SEGMENTATION_DEG = 1e-3


def noise_free(boresight_deg, offsets_sigma, seed=1):
    config = make_config(
        noise_scale=0.0, sensor_noise=False, boresight_deg=boresight_deg,
        range_offset_sigma_m=offsets_sigma, seed=seed,
    )  # fmt: skip
    survey, truth = simulate(config)
    # a scanner without noise says so, or the pseudo-observations of the offsets would pull
    scanner = replace(survey.scanner, range_sigma=1e-4, angle_sigma=1e-7)
    return replace(survey, scanner=scanner), truth


@pytest.mark.slow
@pytest.mark.parametrize("boresight_deg", [(1.1, -0.8, 1.3), (3.0, -3.0, -3.0), (-3.0, 3.0, 3.0)])
def test_noise_free_every_scenario_finds_the_boresight_from_zero(boresight_deg):
    survey, truth = noise_free(boresight_deg, offsets_sigma=0.0)
    found = find_roofs(survey)
    np.testing.assert_array_equal(survey.mounting.boresight, 0)
    for name, result in calibrate_all(survey, found, SCENARIOS).items():
        error = np.rad2deg(result.boresight - truth.boresight)
        assert np.abs(error).max() < OWN_SEGMENTATION_DEG, name
    views = judge_views(survey, truth, found.views)
    assert len(false_pairs(views, found.tie_planes.pairs)) == 0


@pytest.mark.slow
def test_noise_free_b_and_c_find_the_range_offsets():
    survey, truth = noise_free((1.1, -0.8, 1.3), offsets_sigma=0.015, seed=2)
    found = find_roofs(survey)
    for name, result in calibrate_all(survey, found, ("B", "C")).items():
        error = result.range_offsets - truth.range_offsets
        assert np.abs(np.rad2deg(result.boresight - truth.boresight)).max() < 1e-3, name
        assert np.abs(error - error.mean()).max() < 2e-4, name  # up to their datum
        assert truth.range_offsets.std() > 0.01


def test_the_passes_settle_near_the_truth(flown):
    boresights = np.rad2deg(flown.found.boresights)
    assert (boresights[0] == 0).all()
    assert np.abs(np.diff(boresights[-2:], axis=0)).max() < 0.02
    # one realisation of 0.025 and 0.08 deg of attitude error, averaged over eight strips
    assert (np.abs(boresights[-1] - (1.1, -0.8, 1.3)) < (0.05, 0.05, 0.1)).all()


def test_matched_faces_agree_with_the_roofs_they_come_from(flown):
    tie_planes, found = flown.found.tie_planes, flown.found
    assert len(tie_planes.ranges) == len(found.keys) == len(tie_planes.strips)
    for (strip, face), (first, last) in zip(found.keys, tie_planes.ranges, strict=True):
        assert last - first == len(found.surfaces[strip].faces[face].points)
    strips_of_tie = [[strip for strip, _ in tie] for tie in found.ties]
    assert all(len(set(strips)) == len(strips) >= 2 for strips in strips_of_tie)


def test_refinement_extracts_anew_and_stays_at_the_noise(flown):
    results = calibrate_all(flown.survey, flown.found, ("A",))
    refined = refine_all(flown.survey, flown.points, results)["A"]
    change = np.rad2deg(refined.boresight - results["A"].boresight)
    assert 0 < np.abs(change).max() < 0.05
    assert refined.range_offsets is None


def test_same_seed_same_numbers(flown):
    again = find_roofs(flown.survey, flown.points)
    np.testing.assert_array_equal(again.boresights, flown.found.boresights)
    np.testing.assert_array_equal(again.tie_planes.rays.rho, flown.found.tie_planes.rays.rho)


def test_a_strip_of_another_flight_is_named(flown):
    late = flown.survey.strips[2]
    late = Strip(late.name, late.time + 1e5, late.ring, late.azimuth, late.rho)
    survey = replace(flown.survey, strips=(flown.survey.strips[0], late))
    with pytest.raises(OutsideTrajectory, match="F3"):
        find_candidates(survey)


def test_an_empty_strip_is_named(flown):
    none = np.empty(0)
    empty = Strip("F9", none, none.astype(np.uint8), none, none)
    with pytest.raises(EmptyStrip, match="F9"):
        find_candidates(replace(flown.survey, strips=(*flown.survey.strips[:1], empty)))


def test_one_strip_alone_matches_nothing(flown):
    survey = replace(flown.survey, strips=flown.survey.strips[:1])
    points = find_candidates(survey)
    with pytest.raises(TooFewPlanes, match="two strips share"):
        planes_under(survey, points, survey.mounting, RoofSearch().coarse())


def test_a_trajectory_with_a_hole_is_refused(flown):
    trajectory, strip = flown.survey.trajectory, flown.survey.strips[0]
    middle = strip.time.mean()
    kept = np.abs(trajectory.time - middle) > 2.0
    cut = Trajectory(trajectory.time[kept], trajectory.position[kept], trajectory.attitude[kept])
    with pytest.raises(OutsideTrajectory, match="gap of"):
        find_candidates(replace(flown.survey, trajectory=cut, strips=(strip,)))


def test_the_seven_steps_in_one_are_the_same_steps(flown):
    told = []
    done = calibrate_survey(flown.survey, "A", progress=told.append)
    steps = calibrate_all(flown.survey, flown.found, ("A",))
    np.testing.assert_array_equal(done.result.boresight, steps["A"].boresight)
    refined = refine_all(flown.survey, flown.points, steps)["A"]
    np.testing.assert_array_equal(done.refined.boresight, refined.boresight)
    assert any("points above the ground" in words for words in told)
    assert told[-1] == "refinement"


def test_residuals_of_a_view_can_be_asked_for(flown):
    result = calibrate_all(flown.survey, flown.found, ("D",))["D"]
    planes = flown.found.tie_planes
    residuals, views = result.residuals(planes), result.residuals_of_views(planes)
    assert len(residuals) == len(planes.rays)
    assert len(views) == len(planes.ranges)
    first, last = planes.ranges[3]
    assert views[3] == pytest.approx(residuals[first:last].mean())
    assert np.sqrt(np.mean(residuals**2)) < 0.04  # range noise; the trajectory's error is removed
    with pytest.raises(BadInput, match="expected the"):
        result.residuals(planes.thinned(10))


def test_parameters_are_those_of_the_last_pass_by_default():
    assert Parameters().search == RoofSearch()
    assert Parameters.read("growing_angle_deg=2, ransac_min_inliers=20").search.roofs.growing == (
        replace(RoofSearch().roofs.growing, angle_deg=2.0)
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("growing_angel_deg=2", "expected one of outlier_neighbours"),
        ("growing_angle_deg=two", "expected a number"),
        ("ransac_min_inliers=2.5", "expected a whole number"),
        ("ground_windows=square", "expected 'linear'"),
        ("ransac_max_slope_deg=200", "at most 90"),
        ("outlier_alpha=inf", "finite"),
        ("growing_min_points=4000", "less than growing_max_points"),
        ("nowhere.toml", "expected a TOML file"),
    ],
)
def test_parameters_that_make_no_sense_are_refused(text, said):
    with pytest.raises(BadInput, match=said):
        Parameters.read(text)


def test_a_strip_judged_in_pieces_keeps_what_stands_on_the_ground(flown, monkeypatch):
    survey = replace(flown.survey, strips=flown.survey.strips[:1])
    (whole,) = find_candidates(survey).index.values()
    monkeypatch.setattr(coarse_to_fine, "PIECE", len(survey.strips[0]) // 3)
    (pieces,) = find_candidates(survey).index.values()
    assert len(np.setdiff1d(whole, pieces)) < 0.02 * len(whole)
    assert len(np.setdiff1d(pieces, whole)) < 0.02 * len(whole)


def test_a_strip_that_stands_nowhere_above_the_ground_has_no_roof(flown):
    points = flown.points
    first = points.survey.strips[0].name
    none = {name: slice(0, 0) if name == first else slice(None) for name in points.index}
    found = planes_under(flown.survey, points.chosen(none), flown.truth.mounting, RoofSearch())
    assert not found.surfaces[first].faces
    assert first not in {strip for strip, _ in found.views}


def test_tie_planes_hold_no_more_points_than_fit(flown, monkeypatch):
    all_of_them = flown.found.tie_planes
    monkeypatch.setattr(coarse_to_fine, "MOST_OF_PLANES", len(all_of_them.rays) // 4)
    found = planes_under(flown.survey, flown.points, flown.found.mounting, RoofSearch())
    few = found.tie_planes
    assert 0.9 < 4 * len(few.rays) / len(all_of_them.rays) <= 1
    assert few.strips == all_of_them.strips
    np.testing.assert_array_equal(
        np.diff(few.ranges, axis=1)[:, 0], [len(v) for _, v in found.views]
    )
    count, all_counts = (np.diff(t.ranges, axis=1)[:, 0] for t in (few, all_of_them))
    assert (count[all_counts <= count.max()] == all_counts[all_counts <= count.max()]).all()
    assert np.ptp(count[all_counts > count.max()]) == 0  # as many of each larger one


def test_rays_of_candidates_are_those_of_their_strips(flown):
    points = flown.points
    name = flown.survey.strips[2].name
    rays = flown.survey.rays(flown.survey.strip(name), points.index[name])
    np.testing.assert_array_equal(points.rays[name].pose, rays.pose)
    np.testing.assert_array_equal(points.rays_of(name, slice(5, 9)).rho, rays.rho[5:9])
    assert list(points.rays) == [strip.name for strip in flown.survey.strips]
    assert "F99" not in points.rays
