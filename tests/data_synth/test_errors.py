"""Each error of scanner, mounting and motion does what its name says, and nothing else."""

import json
from dataclasses import replace

import numpy as np
import pytest

from data_synth import make_config
from data_synth.evaluation import trajectory_error
from data_synth.flight import TABLE_1
from data_synth.motion import UNSEEN_BAND, UNSEEN_PER_DEGREE, draw_unseen_vibration
from data_synth.operator import Site, truth_text
from data_synth.sensors import N_RINGS, ScannerErrors, range_noise_factor
from data_synth.simulation import STREAMS, draw_scanner_errors
from paperrepro.method.georeference import georeference
from paperrepro.survey import Rays


def columns_equal(one, other, names) -> bool:
    pairs = zip(one.strips, other.strips, strict=True)
    return all(np.array_equal(getattr(a, n), getattr(b, n)) for a, b in pairs for n in names)


def residuals(survey, truth, errors=None, k: int = 0) -> np.ndarray:
    """Distances m of strip k's roof points from the truth planes, with ``errors`` taken off."""
    errors = ScannerErrors() if errors is None else errors
    index = truth.labels[k] >= 0
    strip = survey.strips[k].take(index)
    offset = truth.range_offsets[strip.ring]
    rho = (strip.rho + offset) / (1 + errors.range_scale) - offset
    rays = Rays(
        truth.motion.at(strip.time - errors.clock_delay),
        strip.ring,
        strip.azimuth + errors.azimuth_offsets[strip.ring],
        survey.scanner.beam_elevations[strip.ring] + errors.elevation_offsets[strip.ring],
        rho,
    )
    p_m, face = georeference(rays, truth.mounting), truth.labels[k][index]
    planes = np.array([[*f.normal, f.d] for f in truth.faces])[face]
    return np.einsum("ij,ij->i", planes[:, :3], p_m) - planes[:, 3]


@pytest.fixture(scope="module")
def late(thin):
    return thin(clock_delay_s=0.02, lever_arm_sigma_m=0.05, navigation="smoother", noise_scale=1.0)


def test_a_late_clock_moves_the_stamps_and_nothing_measured(late, plain):
    assert columns_equal(late[0], plain[0], ("ring", "azimuth", "rho"))
    for a, b in zip(late[0].strips, plain[0].strips, strict=True):
        np.testing.assert_allclose(a.time - b.time, 0.02, atol=1e-9)


def test_a_late_clock_shifts_points_by_velocity_times_delay(late):
    """Poses at the stamps are 20 ms ahead: 4.5 m/s make 9 cm north on the first line; gusts add
    some on average, and turns of the body scatter them."""
    survey, truth = late
    strip, mounting = survey.strips[0], truth.mounting
    elevation = survey.scanner.beam_elevations[strip.ring]
    at_stamp, at_shot = (
        georeference(
            Rays(truth.motion.at(time), strip.ring, strip.azimuth, elevation, strip.rho), mounting
        )
        for time in (strip.time, strip.time - truth.scanner_errors.clock_delay)
    )
    shift = (at_stamp - at_shot).mean(axis=0)
    np.testing.assert_allclose(shift, (0.0, 0.02 * 4.5, 0.0), atol=0.005)
    assert np.abs(residuals(survey, truth, truth.scanner_errors)).max() < 1e-8


def test_the_operator_is_told_another_lever_arm(late, plain):
    np.testing.assert_array_equal(late[1].lever_arm, plain[1].lever_arm)
    error = late[0].mounting.lever_arm - late[1].lever_arm
    assert 0.005 < np.sqrt((error**2).mean()) < 0.15
    np.testing.assert_array_equal(plain[0].mounting.lever_arm, plain[1].lever_arm)


def test_another_navigation_error_leaves_the_flight_alone(late, plain):
    np.testing.assert_array_equal(late[1].trajectory.position, plain[1].trajectory.position)
    error = trajectory_error(*late)
    assert (error.std(axis=0)[:3] < 0.05).all()
    assert not trajectory_error(*plain)[:, :3].any()


@pytest.fixture(scope="module")
def crooked(thin):
    return thin(
        beam_elevation_sigma_deg=0.05,
        beam_azimuth_sigma_deg=0.05,
        range_scale_ppm=400.0,
        unseen_vibration_deg=0.1,
    )


def test_the_scanner_errors_of_the_truth_explain_every_point(crooked):
    survey, truth = crooked
    assert np.abs(residuals(survey, truth, truth.scanner_errors)).max() < 1e-8
    for silenced in ("elevation_offsets", "azimuth_offsets"):
        less = replace(truth.scanner_errors, **{silenced: np.zeros(N_RINGS)})
        assert residuals(survey, truth, less).std() > 2e-3
    less = replace(truth.scanner_errors, range_scale=0.0)
    bias = residuals(survey, truth, less)
    assert np.abs(bias).mean() == pytest.approx(400e-6 * 32.0 * 0.8, rel=0.25)


def test_the_trajectory_does_not_report_the_unseen_vibration(crooked, plain):
    np.testing.assert_array_equal(crooked[0].trajectory.position, plain[0].trajectory.position)
    np.testing.assert_array_equal(crooked[0].trajectory.attitude, plain[0].trajectory.attitude)
    error = trajectory_error(*crooked)
    np.testing.assert_allclose(error.std(axis=0), 0.1 * UNSEEN_PER_DEGREE, rtol=0.03)


def test_truth_json_says_what_was_realised(crooked, late):
    content = json.loads(truth_text(*crooked, Site()))
    errors = crooked[1].scanner_errors
    np.testing.assert_allclose(
        np.radians(content["beam_elevation_offsets_deg"]), errors.elevation_offsets
    )
    np.testing.assert_allclose(
        np.radians(content["beam_azimuth_offsets_deg"]), errors.azimuth_offsets
    )
    assert content["range_scale_ppm"] == pytest.approx(400.0)
    np.testing.assert_allclose(content["trajectory_rms"]["attitude_deg"], 0.1, rtol=0.03)
    content = json.loads(truth_text(*late, Site()))
    assert content["clock_delay_s"] == 0.02
    np.testing.assert_array_equal(content["lever_arm_m"], late[1].lever_arm)


def test_the_unseen_vibration_stays_in_its_band():
    step = 2e-3
    value, _ = draw_unseen_vibration(0.2, np.random.default_rng(0)).at(step * np.arange(100_000))
    power = np.abs(np.fft.rfft(value, axis=0)) ** 2
    frequency = np.fft.rfftfreq(len(value), step)
    low, high = UNSEEN_BAND[0]
    inside = (frequency > low - 0.5) & (frequency < high + 0.5)
    assert (power[inside].sum(axis=0) > 0.99 * power[1:].sum(axis=0)).all()


def test_beams_and_lever_arm_have_the_spread_asked_for_and_streams_of_their_own():

    def drawn(**sizes):
        seeds = np.random.SeedSequence(3).spawn(len(STREAMS))
        rng = {name: np.random.default_rng(s) for name, s in zip(STREAMS, seeds, strict=True)}
        return draw_scanner_errors(make_config(**sizes), rng)

    one = drawn(beam_elevation_sigma_deg=0.05)
    assert not one.azimuth_offsets.any()
    both = drawn(beam_elevation_sigma_deg=0.05, beam_azimuth_sigma_deg=0.1)
    np.testing.assert_array_equal(both.elevation_offsets, one.elevation_offsets)
    assert abs(np.corrcoef(both.elevation_offsets, both.azimuth_offsets)[0, 1]) < 0.7
    rng = {name: np.random.default_rng(1) for name in STREAMS}
    many = [
        draw_scanner_errors(make_config(beam_elevation_sigma_deg=0.05), rng) for _ in range(500)
    ]
    spread = np.std([errors.elevation_offsets for errors in many])
    assert np.degrees(spread) == pytest.approx(0.05, rel=0.03)


@pytest.mark.parametrize(
    ("reflectivity", "degrees", "distance", "growth", "expected"),
    [
        (0.4, 0.0, 30.0, 1.0, 1.0),
        (0.4, 0.0, 60.0, 1.0, 2.0),
        (0.1, 0.0, 30.0, 1.0, 2.0),
        (0.4, 60.0, 30.0, 1.0, np.sqrt(2.0)),
        (0.4, 60.0, 30.0, 2.0, 2.0),
        (0.1, 60.0, 80.0, 0.0, 1.0),
    ],
)
def test_the_law_of_the_range_noise(reflectivity, degrees, distance, growth, expected):
    factor = range_noise_factor(reflectivity, np.cos(np.radians(degrees)), distance, growth)
    assert factor == pytest.approx(expected, rel=1e-12)


def test_range_noise_grows_to_the_rim_of_the_swath(thin):
    """Level ground of reflectivity 0.45: at nadir the noise shrinks by 6 %, at 55 degrees it grows
    to 1.245 / cos²; both from the same draws."""
    level = {"sensor_noise": True, "ground_relief": 0.0, "gust_scale": 0.0}
    one_line = TABLE_1.only("F1")
    even, grown = (thin(plan=one_line, **level, range_noise_growth=growth) for growth in (0.0, 1.0))
    assert columns_equal(even[0], grown[0], ("time", "ring", "azimuth"))
    excess = grown[0].strips[0].rho - even[0].strips[0].rho
    azimuth = np.degrees(np.abs(even[0].strips[0].azimuth))
    ground = even[1].classes[0] == 0
    for low, high, factor in ((0, 10, 0.0), (54, 56, 1.0)):
        chosen = ground & (azimuth > low) & (azimuth < high)
        incidence = np.cos(np.radians(0.5 * (low + high)))
        expected = np.sqrt(0.4 / 0.45) / incidence**1.5 - 1.0
        assert excess[chosen].std() == pytest.approx(0.02 * abs(expected), rel=0.15), factor
