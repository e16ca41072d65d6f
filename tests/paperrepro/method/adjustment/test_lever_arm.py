"""The lever arm as an unknown: found where body tilts and opposite lines show it, else said."""

from dataclasses import replace

import numpy as np
import pytest

from paperrepro.method.adjustment.calibrate import calibrate
from paperrepro.method.adjustment.trajectory_equations import PRIOR_SIGMA
from paperrepro.method.adjustment.trajectory_errors import calibrate_with_trajectory
from paperrepro.survey import Mounting
from tests.paperrepro.labelled import HEADINGS_DEG, LEVER_ARM, matched_faces, survey_of
from tests.paperrepro.method.adjustment.flying import flown, with_times

WRONG = np.array([0.04, -0.03, 0.02])


def test_an_error_of_the_lever_arm_is_found_within_its_sigma():
    standardised = []
    for seed in range(10):
        tie_planes, truth = flown(seed, count=60)
        start = survey_of(start=Mounting(lever_arm=LEVER_ARM + WRONG))
        arm = calibrate_with_trajectory(start, tie_planes, lever_arm=True).lever_arm
        standardised.append((arm.value - truth.lever_arm)[:2] / arm.sigma[:2])
    assert np.abs(standardised).max() < 4
    assert np.square(standardised).mean() == pytest.approx(1.0, abs=0.7)


def test_without_noise_the_lever_arm_is_found_with_the_boresight():
    tie_planes, truth = flown(1, scale=1e-4, count=120, range_sigma=1e-5)
    survey = survey_of(start=Mounting(lever_arm=LEVER_ARM + WRONG))
    navigation = replace(
        survey.navigation,
        position_sigma=1e-4 * survey.navigation.position_sigma,
        attitude_sigma=1e-4 * survey.navigation.attitude_sigma,
    )
    scanner = replace(survey.scanner, range_sigma=1e-5, angle_sigma=1e-7)
    survey = replace(survey, navigation=navigation, scanner=scanner)
    result = calibrate(survey, tie_planes, "D", robust=False, lever_arm=True)
    np.testing.assert_allclose(result.lever_arm.value, truth.lever_arm, atol=1e-4)
    np.testing.assert_allclose(result.calibrated.lever_arm, truth.lever_arm, atol=1e-4)
    np.testing.assert_allclose(result.boresight, truth.boresight, atol=1e-6)
    assert len(result.covariance) == 3 + survey.scanner.n_rings


def test_a_flight_without_tilts_does_not_determine_its_height_and_says_so():
    tie_planes, _, _ = matched_faces(0, gusts=False)
    result = calibrate_with_trajectory(
        survey_of(), with_times(tie_planes, HEADINGS_DEG), lever_arm=True
    )
    arm = result.lever_arm
    assert list(arm.determined) == [True, True, False]
    assert arm.sigma[2] == pytest.approx(PRIOR_SIGMA, rel=0.05)
    assert "down" in str(arm).split("not determined")[0].split(", ")[-1]


def test_the_others_hold_it():
    tie_planes, _ = flown(0, count=40)
    assert calibrate(survey_of(), tie_planes, "D").lever_arm is None
    assert calibrate(survey_of(), tie_planes, "SL").lever_arm is None
