"""Contradictions of the model: none on a good flight, and each named where it is put in."""

from dataclasses import replace

import numpy as np
import pytest

from paperrepro.method.adjustment.model_checks import Check, model_checks
from paperrepro.method.adjustment.scenarios import calibrate as calibrate_paper
from paperrepro.method.adjustment.trajectory_equations import Clock
from paperrepro.method.adjustment.trajectory_errors import calibrate_with_trajectory, find_noise
from tests.paperrepro.labelled import SCANNER, survey_of
from tests.paperrepro.method.adjustment.flying import flown


def adjusted(tie_planes, truth):
    found = find_noise(survey_of(), tie_planes, truth.boresight)
    return calibrate_with_trajectory(survey_of(), tie_planes, found=found, near=truth.boresight)


@pytest.fixture(scope="module")
def good():
    tie_planes, truth = flown(4, count=160)
    return adjusted(tie_planes, truth), truth


def failed(result, sl=None):
    return {c.name for c in model_checks(result, survey_of(), sl) if not c.passed}


def test_a_good_flight_contradicts_nothing(good):
    result, truth = good
    assert failed(result, truth.boresight) == set()


def test_only_d_is_checked():
    tie_planes, _ = flown(4, count=60)
    sl = calibrate_paper(survey_of(), tie_planes, "SL")
    assert model_checks(sl, survey_of()) == ()


def test_a_wrong_beam_table_is_named():
    tie_planes, truth = flown(4, count=160)
    error = np.deg2rad(0.05) * np.random.default_rng(3).standard_normal(SCANNER.n_rings)
    rays = tie_planes.rays
    wrong = replace(tie_planes, rays=replace(rays, elevation=rays.elevation + error[rays.ring]))
    result = adjusted(wrong, truth)
    assert "beams" in failed(result)
    # to be added to what the rays say; all beams together cannot be told from the boresight
    left = result.beams.errors[:, 0] + error
    assert np.std(left) < np.std(error) / 5
    assert (np.abs(result.beams.errors[:, 1]) < 4 * result.beams.sigma[:, 1]).all()
    assert np.abs((result.boresight - truth.boresight) / result.sigma).max() < 3
    assert result.rmse_after < 1.05 * adjusted(tie_planes, truth).rmse_after


def test_noise_of_the_laser_is_named_in_either_direction():
    for factor, seed in ((0.4, 1), (2.5, 2)):
        tie_planes, truth = flown(seed, count=80, range_sigma=factor * SCANNER.range_sigma)
        assert "residuals" in failed(adjusted(tie_planes, truth))


def test_what_the_result_says_is_judged(good):
    result, truth = good
    late = replace(result, clock=Clock(0.005, 0.0002))
    assert "clock" in failed(late)
    assert "clock" not in failed(replace(result, clock=Clock(0.0005, 0.0002)))
    better = replace(result, components=result.components | {"heading": 0.2, "height_fast": 0.5})
    assert {"specified_heading", "fast_height"} <= failed(better)
    far = replace(result, range_offsets=np.r_[0.5, result.range_offsets[1:]])
    assert "range_offsets" in failed(far)
    sl = truth.boresight + np.array([0, 0, 20]) * result.sigma
    assert failed(result, sl) == {"scenarios_yaw"}
    told = tuple(replace(p, sigma=p.sigma / 4) for p in result.trajectory.processes)
    restless = replace(result, trajectory=replace(result.trajectory, processes=told))
    assert "process_up" in failed(restless)


def test_a_sentence_says_the_value_and_what_to_do(good):
    result, _ = good
    for check in model_checks(result, survey_of()):
        assert isinstance(check, Check)
        assert any(character.isdigit() for character in check.sentence)
        assert check.sentence.endswith(".")


def test_a_trajectory_that_steps_is_named(good):
    result, _ = good
    errors = result.trajectory
    stepped = errors.error.copy()
    stepped[len(stepped) // 2 :, 0, 5] += 2 * errors.prior_sigma[5]
    stepped = replace(result, trajectory=replace(errors, error=stepped))
    assert "steps" in failed(stepped)
