"""The smoother's error: its mechanics by hand, and its own covariance by many missions."""

import numpy as np
import pytest

from data_synth import inertial
from data_synth.flight import flight_plan, fly
from data_synth.inertial import (
    ACCELEROMETER,
    ATTITUDE,
    GNSS_SIGMA,
    GYRO,
    POSITION,
    STEP,
    VELOCITY,
    draw_errors,
    error_model,
    smooth,
    smoother_error,
)
from paperrepro.frames import attitude_matrix
from paperrepro.survey import Trajectory

G = 9.80665


def hover(seconds: float, heading: float = 0.0):
    count = round(seconds / STEP) + 1
    R_b_m = np.broadcast_to(attitude_matrix(0.0, 0.0, heading), (count, 3, 3))
    return error_model(np.zeros((count, 3)), R_b_m)


def carried(model, state: slice, value) -> np.ndarray:
    """The errors (18,) at the end that one error at the start leads to."""
    x = np.zeros(18)
    x[state] = value
    for transition in model.transition:
        x = transition @ x
    return x


def test_a_tilt_to_the_east_accelerates_the_ins_to_the_south():
    """psi about east takes the specific force, up, to -north: half g psi t² in position."""
    x = carried(hover(10.0), ATTITUDE, (1e-3, 0.0, 0.0))
    np.testing.assert_allclose(x[VELOCITY], (0.0, -G * 1e-3 * 10.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(x[POSITION], (0.0, -0.5 * G * 1e-3 * 100.0, 0.0), rtol=1e-6)


def test_biases_act_along_the_axes_of_the_body():
    """Heading east: forward is east, right is south; biases fade with their correlation time."""
    model = hover(10.0, np.pi / 2)
    x = carried(model, ACCELEROMETER, (0.01, 0.0, 0.0))
    assert x[VELOCITY][0] == pytest.approx(0.1, rel=0.02)
    np.testing.assert_allclose(x[VELOCITY][1:], 0.0, atol=1e-12)
    x = carried(model, GYRO, (0.0, 1e-4, 0.0))
    assert x[ATTITUDE][1] == pytest.approx(-1e-3, rel=0.02)
    np.testing.assert_allclose(x[ATTITUDE][[0, 2]], 0.0, atol=1e-12)


@pytest.fixture(scope="module")
def flown():
    """A model of forty seconds of the mission, a turn among them."""
    lines = flight_plan()
    time = lines[0].end_time - 15.0 + STEP * np.arange(800)
    pose = fly(lines, np.random.default_rng(1)).at(time)
    return error_model(pose[:, :3], attitude_matrix(*pose[:, 3:].T))


def nees(model, missions: int, rng) -> np.ndarray:
    """Normalised squares of the errors, (epochs, missions), divided by their number."""
    x, z = draw_errors(model, missions, rng)
    estimate, covariance = smooth(model, z)
    left, out = x - estimate, []
    for k in range(0, len(x), 100):
        scale = 1.0 / np.sqrt(np.diag(covariance[k]))
        scaled = scale[:, None] * left[k]
        correlation = covariance[k] * np.outer(scale, scale)
        out.append((scaled * np.linalg.solve(correlation, scaled)).sum(axis=0) / len(scaled))
    return np.array(out)


def test_the_smoother_is_honest(flown):
    """Mean NEES of 300 missions of 18 states: 1 to 0.02 by chance, at every epoch."""
    mean = nees(flown, 300, np.random.default_rng(0)).mean(axis=1)
    np.testing.assert_allclose(mean, 1.0, atol=0.08)


def test_a_filter_told_half_the_noise_is_found_out(flown, monkeypatch):
    rng = np.random.default_rng(0)
    x, z = draw_errors(flown, 100, rng)
    monkeypatch.setattr(inertial, "GNSS_SIGMA", 0.5 * GNSS_SIGMA)
    estimate, covariance = smooth(flown, z)
    left = (x - estimate)[400][POSITION]
    told = np.diag(covariance[400])[POSITION]
    assert ((left**2).mean(axis=1) / told > 1.3).any()


def test_smoothing_takes_the_white_part_of_gnss_away(flown):
    """Not the correlated one, which lasts longer than the flight: 1 of sqrt(2) stays."""
    x, z = draw_errors(flown, 50, np.random.default_rng(2))
    left = (x - smooth(flown, z)[0])[:, POSITION]
    raw = z - x[:, POSITION]
    assert (left.std(axis=(0, 2)) < 0.9 * raw.std(axis=(0, 2))).all()


def test_along_a_mission_the_error_is_small_smooth_and_of_its_size():
    """Level and straight, roll and pitch are known to some hundredths of a degree, position to
    GNSS's own error."""
    lines = flight_plan()[:2]
    truth = fly(lines, np.random.default_rng(1)).record()
    error, time, sigma = smoother_error(truth, np.random.default_rng(0))
    assert error.shape == (len(truth.time), 6)
    rms = np.sqrt((error**2).mean(axis=0))
    assert (rms[:3] < 2 * GNSS_SIGMA).all()
    assert (np.degrees(rms[3:5]) < 0.03).all()
    assert np.degrees(rms[5]) < 0.3
    assert np.abs(np.diff(error[:, :3], axis=0)).max() < 1e-3
    ratio = error[:: round(STEP / 0.005)] / sigma
    assert len(time) == len(sigma) == len(ratio)
    assert (np.sqrt(np.square(ratio).mean(axis=0)) > 0.3).all()
    assert (np.sqrt(np.square(ratio).mean(axis=0)) < 2.5).all()


def test_small_turns_become_roll_pitch_and_heading(monkeypatch):
    """Heading east and level: east is forward, north is left, up is minus down."""
    count = 201
    truth = Trajectory(
        0.005 * np.arange(count),
        np.zeros((count, 3)),
        np.column_stack([np.zeros((count, 2)), np.full(count, np.pi / 2)]),
    )
    psi = np.array([1e-3, 2e-3, -3e-3])

    def drawn(model, missions, rng):
        x = np.zeros((len(model.transition) + 1, 18, 1))
        x[:, ATTITUDE, 0] = psi
        return x, None

    monkeypatch.setattr(inertial, "draw_errors", drawn)
    known = np.array([3e-3, 1e-3, 2e-3])  # of a turn about east, north, up
    P = np.zeros((21, 18, 18))
    P[:, ATTITUDE, ATTITUDE] = np.diag(known**2)
    monkeypatch.setattr(inertial, "smooth", lambda model, z: (0.0, P))
    error, _, sigma = smoother_error(truth, None)
    np.testing.assert_allclose(sigma[:, 3:], np.tile(known, (21, 1)))  # forward is east
    before, after = (
        attitude_matrix(*angles) for angles in (truth.attitude[0], truth.attitude[0] + error[0, 3:])
    )
    turn = after @ before.T
    seen = 0.5 * np.array(
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    )
    np.testing.assert_allclose(seen, psi, atol=1e-8)
    np.testing.assert_allclose(error[0, 3:], (1e-3, -2e-3, 3e-3), atol=1e-5)
