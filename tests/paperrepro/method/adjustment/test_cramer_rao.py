"""The bound: what scenario D comes near to and nobody undercuts."""

import numpy as np
import pytest

from paperrepro.method.adjustment.quality import TrueNoise, cramer_rao_bound
from paperrepro.method.adjustment.scenarios import calibrate
from paperrepro.method.adjustment.trajectory_equations import GaussMarkov
from paperrepro.method.adjustment.trajectory_errors import (
    calibrate_with_trajectory,
    specified_process,
)
from tests.paperrepro.labelled import NAVIGATION, SCANNER, survey_of
from tests.paperrepro.method.adjustment.flying import flown

NOISE = TrueNoise(specified_process(NAVIGATION), SCANNER.range_offset_sigma)


def bound_of(tie_planes, truth, noise=NOISE, **options):
    return np.sqrt(np.diag(cramer_rao_bound(survey_of(), tie_planes, truth, noise, **options)))


def test_it_is_the_formal_sigma_of_an_adjustment_that_knows_the_noise():
    tie_planes, truth = flown(4, count=40)
    formal = calibrate_with_trajectory(survey_of(), tie_planes).sigma
    np.testing.assert_allclose(bound_of(tie_planes, truth), formal, rtol=0.03)


def test_closer_nodes_change_it_no_more():
    tie_planes, truth = flown(4, count=40)
    finer = bound_of(tie_planes, truth, spacing=0.025)
    np.testing.assert_allclose(bound_of(tie_planes, truth), finer, rtol=0.002)


def test_more_noise_and_fewer_points_raise_it():
    tie_planes, truth = flown(4, count=40)
    least = bound_of(tie_planes, truth)
    twice = GaussMarkov(2 * NOISE.process.sigma, NOISE.process.correlation_time)
    assert (bound_of(tie_planes, truth, TrueNoise(twice, NOISE.range_offset_sigma)) > least).all()
    assert (bound_of(tie_planes.thinned(10), truth) > least).all()


@pytest.mark.slow
def test_no_scenario_undercuts_it_over_many_seeds():
    squares, bounds = {"SL": [], "D": []}, []
    for seed in range(20):
        tie_planes, truth = flown(seed, count=40)
        bounds.append(np.square(bound_of(tie_planes, truth)))
        squares["D"].append(
            np.square(
                calibrate_with_trajectory(survey_of(), tie_planes).boresight - truth.boresight
            )
        )
        squares["SL"].append(
            np.square(calibrate(survey_of(), tie_planes, "SL").boresight - truth.boresight)
        )
    ratio = {name: np.sqrt(np.sum(s) / np.sum(bounds)) for name, s in squares.items()}
    assert 0.85 < ratio["D"] < 1.15
    assert ratio["SL"] > 1.3
