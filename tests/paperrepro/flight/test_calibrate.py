"""An operator's flight calibrated: choice of planes, overlap, distances, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from data_synth import make_config, simulate
from paperrepro import _compiled
from paperrepro.errors import BadInput
from paperrepro.flight.calibrate import calibrate_flight
from paperrepro.method.accuracy import overlaps, pair_distances, rmse
from paperrepro.method.adjustment.calibrate import calibrate
from paperrepro.method.adjustment.screening import screen
from paperrepro.method.coarse_to_fine import find_planes, sample_rays
from paperrepro.study.variants import with_wrong_match


def part(survey, *names):
    return replace(survey, strips=tuple(survey.strip(name) for name in names))


def within(own, truth, sigmas=3.0):
    error = own.result.boresight - truth.boresight
    return (np.abs(error) < sigmas * own.result.sigma).all()


@pytest.fixture(scope="module")
def few(flown):
    return part(flown.survey, "F1", "F2", "F7", "F8")


@pytest.fixture(scope="module", autouse=True)
def fewer_planes():
    """Enough for these tests, and ten times as fast as the usual number."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("paperrepro.method.coarse_to_fine.MOST_PLANES", 60)
        yield


@pytest.fixture(scope="module")
def any_planes(few):
    return calibrate_flight(few, "D", "any")


def test_planes_of_any_kind_find_the_truth(any_planes, flown):
    assert any_planes.planes == "any"
    assert within(any_planes, flown.truth)
    assert (np.rad2deg(any_planes.result.sigma) < (0.04, 0.04, 0.08)).all()
    slope = np.degrees(np.arccos(any_planes.result.planes[:, 2]))
    assert (slope < 6).any()  # ground
    assert (slope > 80).any()  # walls
    assert ((slope > 10) & (slope < 60)).sum() > 10


def test_any_number_of_threads_gives_the_same_bits(any_planes, few, monkeypatch):
    """BLAS's and ours: the whole calibration."""
    blas = {
        library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"
    }
    others = 1 if max(blas) > 1 else 2
    monkeypatch.setattr(_compiled, "threads", lambda: others)
    with threadpool_limits(others, "blas"):
        again = calibrate_flight(few, "D", "any")
    for name in ("boresight", "range_offsets", "covariance", "planes"):
        np.testing.assert_array_equal(getattr(again.result, name), getattr(any_planes.result, name))
    for pair, before in zip(again.distances, any_planes.distances, strict=True):
        np.testing.assert_array_equal(pair.after, before.after)


def test_faces_that_were_rejected_are_known_by_those_kept(flown):
    found = flown.found.tie_planes
    wrong = with_wrong_match(found, flown.found.mounting)
    result = calibrate(flown.survey, wrong, "SL")
    kept = result.adjusted(wrong)
    assert len(kept.ranges) == len(wrong.ranges) - len(result.rejected) < len(wrong.ranges)
    np.testing.assert_array_equal(screen(flown.survey, wrong).kept, result.kept)
    assert len(result.residuals(kept)) == result.n_points
    assert calibrate(flown.survey, found, "SL", robust=False).adjusted(found) is found


def test_fewer_than_four_strips_leave_the_noise_as_specified_and_say_so(any_planes, flown):
    assert any_planes.result.components["heading"] != 1
    assert not any("do not show it" in remark for remark in any_planes.remarks)
    three = calibrate_flight(part(flown.survey, "F1", "F2", "F7"), "D", "any")
    assert three.result.components["heading"] == 1
    assert three.result.components["range"] != 1
    assert any("3 strips do not show it" in remark for remark in three.remarks)


def test_gables_serve_by_default_where_there_are_enough(few, flown):
    said = []
    own = calibrate_flight(few, progress=said.append)
    assert own.planes == "gables"
    assert within(own, flown.truth)
    assert any("pass 1" in words for words in said)


def test_too_few_gables_turn_to_planes_of_any_kind(few, flown, monkeypatch):
    monkeypatch.setattr("paperrepro.flight.calibrate.ENOUGH_GABLES", 1000)
    own = calibrate_flight(few, "SL")
    assert own.planes == "any"
    assert "gable" in own.remarks[0]


def test_passes_settle_from_two_degrees_off(flown):
    survey = part(flown.survey, "F1", "F2", "F7", "F8")
    off = flown.truth.boresight + np.radians([2.0, -2.0, 2.0])
    start = replace(survey, mounting=survey.mounting.with_calibration(off))
    found = find_planes(start)
    assert np.abs(np.rad2deg(found.boresights[-1] - flown.truth.boresight)).max() < 0.1


def test_level_ground_alone_is_no_error_and_says_what_was_taken_for_known():
    """Wide swaths at several places of the flight line tell yaw from level ground, too."""
    config = make_config(scene="fields", ground_relief=0.0, profile="quick", seed=1)
    survey, truth = simulate(config)
    own = calibrate_flight(part(survey, "F1", "F2"), "D", "any")
    assert "parallel" in own.remarks[0]
    assert "right to 1°" in own.remarks[0]
    assert within(own, truth)


def test_gables_are_found_from_ten_degrees_off(few, flown):
    off = flown.truth.boresight + np.radians([6.0, -6.0, 6.0])
    own = calibrate_flight(replace(few, mounting=few.mounting.with_calibration(off)), "SL")
    assert own.planes == "gables"
    error = np.rad2deg(own.result.boresight - flown.truth.boresight)
    assert (np.abs(error) < (0.05, 0.05, 0.1)).all()


def test_the_distances_between_the_strips_fall_on_the_same_points(any_planes):
    assert len(any_planes.distances) == 6
    for pair in any_planes.distances:
        assert len(pair.before) == len(pair.after) > 1000
        assert rmse(pair.after) < 0.5 * rmse(pair.before)


def test_what_is_said_of_before_is_under_the_nominal_mounting(any_planes):
    assert any_planes.result.rmse_before > 0.2
    assert any_planes.result.rmse_after < 0.06
    np.testing.assert_array_equal(any_planes.result.mounting.boresight, 0)


def test_true_mounting_against_itself_has_equal_distances(few, flown):
    samples, mounting = sample_rays(few), flown.truth.mounting
    for pair in pair_distances(samples, overlaps(samples.rays, mounting), mounting, mounting):
        np.testing.assert_array_equal(pair.before, pair.after)


def test_one_strip_is_refused(flown):
    with pytest.raises(BadInput, match="at least two that overlap"):
        calibrate_flight(part(flown.survey, "F1"))


def test_strips_apart_are_refused(flown):
    with pytest.raises(BadInput, match="F4, F6: expected strips that overlap"):
        calibrate_flight(part(flown.survey, "F4", "F6"))


@pytest.mark.parametrize("words", [{"scenario": "E"}, {"planes": "roofs"}])
def test_unknown_words_are_refused_before_any_work(few, words, monkeypatch):
    monkeypatch.setattr("paperrepro.flight.calibrate.sample_rays", None)
    with pytest.raises(BadInput, match="expected one of"):
        calibrate_flight(few, **words)
