"""Flights that do not determine an angle say which and why; none gives a confident number."""

from dataclasses import replace

import numpy as np
import pytest

from paperrepro.errors import RankDefect, TooFewPlanes
from paperrepro.method.adjustment.calibrate import SCENARIO_NAMES, calibrate
from tests.paperrepro.labelled import matched_faces, survey_of
from tests.paperrepro.method.adjustment.flying import flown

ONE_WAY = (0.0, 0.0)


@pytest.mark.parametrize("scenario", SCENARIO_NAMES)
@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0])
def test_one_heading_over_roofs_of_one_azimuth(scenario, azimuth_deg):
    tie_planes, _ = flown(1, headings=ONE_WAY, azimuth_deg=azimuth_deg, count=60)
    if scenario == "A":
        with pytest.raises(RankDefect, match=r"do not determine the boresight's (yaw|pitch)"):
            calibrate(survey_of(), tie_planes, scenario)
        return
    seen = calibrate(survey_of(), tie_planes, scenario).observability
    assert "roll" in seen.undetermined
    assert "roll is not determined: sigma 0." in str(seen)


def test_what_the_flight_leaves_open_the_mounting_holds():
    tie_planes, _ = flown(1, headings=ONE_WAY, azimuth_deg=90.0, count=60)
    survey = survey_of()
    known = replace(survey.mounting, known_to=np.deg2rad(1.0))
    result = calibrate(replace(survey, mounting=known), tie_planes, "A")
    seen, sigma_deg = result.observability, np.rad2deg(result.sigma)
    assert seen.weakest_sigma <= np.deg2rad(1.0) * (1 + 1e-9)
    assert seen.weakest_word != "roll"
    assert sigma_deg[0] < 0.1  # roll is told
    assert (sigma_deg[1:] > 0.2).all()  # of yaw and pitch together nothing but the mounting's word


def test_what_is_known_before_hardly_moves_what_the_flight_determines():
    tie_planes, _ = flown(1, count=60)
    survey = survey_of()
    known = replace(survey.mounting, known_to=np.deg2rad(1.0))
    for scenario in ("C", "D"):
        free = calibrate(survey, tie_planes, scenario)
        held = calibrate(replace(survey, mounting=known), tie_planes, scenario)
        assert (np.abs(held.boresight - free.boresight) < 0.1 * free.sigma).all()


def test_what_d_says_of_such_a_flight_is_true():
    standardised = []
    for seed in range(8):
        tie_planes, truth = flown(seed, headings=ONE_WAY, azimuth_deg=90.0, count=40)
        result = calibrate(survey_of(), tie_planes, "D")
        assert result.sigma[0] > np.deg2rad(0.05)
        standardised.append((result.boresight - truth.boresight) / result.sigma)
    assert np.square(standardised).mean() < 2


def test_sl_is_confident_and_wrong_there_and_its_observability_says_so():
    errors = []
    for seed in range(6):
        tie_planes, truth = flown(seed, headings=ONE_WAY, azimuth_deg=90.0, count=40)
        result = calibrate(survey_of(), tie_planes, "SL")
        errors.append(np.abs(result.boresight - truth.boresight)[0] / result.sigma[0])
        assert "roll" in result.observability.undetermined
    assert np.median(errors) > 3


@pytest.mark.parametrize("scenario", SCENARIO_NAMES)
def test_opposite_and_crossing_lines_determine_all(scenario):
    tie_planes, _ = flown(1, count=60)
    seen = calibrate(survey_of(), tie_planes, scenario).observability
    assert seen.undetermined == ()
    assert "not determined" not in str(seen)


@pytest.mark.parametrize("scenario", SCENARIO_NAMES)
def test_one_strip_is_refused(scenario):
    tie_planes, _ = flown(0, headings=(0.0,), count=40)
    with pytest.raises(TooFewPlanes, match="two strips or more see, got 0 of 12"):
        calibrate(survey_of(), tie_planes, scenario)


def test_without_times_nothing_is_said_of_lasting_errors():
    tie_planes, _, _ = matched_faces(0, count=40)
    seen = calibrate(survey_of(), tie_planes, "SL").observability
    assert seen.lasting_sigma is None
    assert seen.undetermined == ()
