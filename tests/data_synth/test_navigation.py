"""The error of the GNSS/INS is the process it claims to be."""

import numpy as np
import pytest

from data_synth.navigation import (
    ATTITUDE_SIGMA,
    CORRELATION_TIME,
    POSITION_SIGMA,
    WHITE_SIGMA,
    apx15,
    disturb,
    gauss_markov,
)
from paperrepro.survey import Trajectory


def straight_flight(duration: float, step: float) -> Trajectory:
    time = np.arange(0.0, duration, step)
    return Trajectory(time, np.zeros((len(time), 3)), np.zeros((len(time), 3)))


def test_variance_and_correlation_time():
    """Long enough that 6 x 4000 correlation times bound the estimates to a few percent."""
    step, tau = 0.1, 2.0
    x = gauss_markov(80_000, step, tau, np.random.default_rng(0))
    np.testing.assert_allclose(x.var(axis=0), 1.0, atol=0.1)
    for lag in (0.5, 1.0, 2.0):
        shift = round(lag * tau / step)
        correlation = (x[:-shift] * x[shift:]).mean() / x.var()
        assert correlation == pytest.approx(np.exp(-lag), abs=0.03)


def test_stationary_from_the_first_record_and_at_any_step():
    for step in (0.005, 30.0):
        ends = [
            gauss_markov(20, step, 30.0, np.random.default_rng(seed))[[0, -1]]
            for seed in range(400)
        ]
        np.testing.assert_allclose(np.std(ends, axis=0).mean(axis=1), 1.0, atol=0.05)


def test_components_are_independent():
    x = gauss_markov(200_000, 1.0, 2.0, np.random.default_rng(1))
    assert np.abs(np.corrcoef(x.T) - np.eye(6)).max() < 0.02


def test_errors_have_the_specified_sigmas():
    """Every 5 correlation times a fresh error: 4000 of them give sigma to 3 %."""
    flight = straight_flight(20_000 * CORRELATION_TIME, CORRELATION_TIME)
    seen = disturb(flight, 1.0, np.random.default_rng(2))
    expected = np.hypot(np.concatenate([POSITION_SIGMA, ATTITUDE_SIGMA]), WHITE_SIGMA)
    error = np.column_stack([seen.position, seen.attitude])
    np.testing.assert_allclose(error.std(axis=0), expected, rtol=0.03)


def test_noise_scale_scales_and_zero_is_the_truth():
    flight = straight_flight(10.0, 0.005)
    once, twice, none = (disturb(flight, s, np.random.default_rng(3)) for s in (1.0, 2.0, 0.0))
    np.testing.assert_allclose(twice.position, 2 * once.position, rtol=1e-12)
    np.testing.assert_allclose(twice.attitude, 2 * once.attitude, atol=1e-15)
    np.testing.assert_array_equal(none.position, flight.position)
    np.testing.assert_array_equal(apx15(2.0).attitude_sigma, 2 * ATTITUDE_SIGMA)
