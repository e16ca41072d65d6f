"""The error of the GNSS/INS is the process it claims to be."""

import numpy as np
import pytest

from data_synth.navigation import (
    ATTITUDE_SIGMA,
    CONSTANT_SHARE,
    CORRELATION_TIME,
    NAVIGATION,
    OUTAGE_FACTOR,
    OUTAGE_TIME,
    POSITION_SIGMA,
    PROCESSES,
    SLOW_TIMES,
    STEP_INTERVAL,
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
    seen, _ = disturb(flight, 1.0, np.random.default_rng(2))
    expected = np.hypot(np.concatenate([POSITION_SIGMA, ATTITUDE_SIGMA]), WHITE_SIGMA)
    error = np.column_stack([seen.position, seen.attitude])
    np.testing.assert_allclose(error.std(axis=0), expected, rtol=0.03)


def test_noise_scale_scales_and_zero_is_the_truth():
    flight = straight_flight(10.0, 0.005)
    once, twice, none = (disturb(flight, s, np.random.default_rng(3))[0] for s in (1.0, 2.0, 0.0))
    np.testing.assert_allclose(twice.position, 2 * once.position, rtol=1e-12)
    np.testing.assert_allclose(twice.attitude, 2 * once.attitude, atol=1e-15)
    np.testing.assert_array_equal(none.position, flight.position)
    np.testing.assert_array_equal(apx15(2.0).attitude_sigma, 2 * ATTITUDE_SIGMA)


def covariances(kind: str, lag: float, count: int = 20_000) -> np.ndarray:
    """Variance, and covariance at ``lag`` s, (2, 6), over many short missions."""
    rng = np.random.default_rng(4)
    pairs = np.array([PROCESSES[kind](2, lag, rng) for _ in range(count)])
    return np.array([(pairs[:, 0] * pairs[:, k]).mean(axis=0) for k in (0, 1)])


@pytest.mark.parametrize(
    ("kind", "lag", "expected"),
    [
        ("gauss-markov", 15.0, np.exp(-0.5)),
        ("constant", 1e4, CONSTANT_SHARE),
        ("constant", 30.0, CONSTANT_SHARE + (1 - CONSTANT_SHARE) * np.exp(-1.0)),
        ("slow", 30.0, np.exp(-30.0 / SLOW_TIMES)),
        ("two-scale", 10.0, 0.8 * np.exp(-10 / 300)),
        ("two-scale", 0.5, 0.8 * np.exp(-0.5 / 300) + 0.2 * np.exp(-0.5)),
        ("steps", 45.0, np.exp(-45.0 / STEP_INTERVAL)),
    ],
)
def test_each_kind_has_the_specified_variance_and_its_own_correlation(kind, lag, expected):
    """20 000 missions give a covariance to 0.01, and the worst of six within 0.04."""
    variance, covariance = covariances(kind, lag)
    np.testing.assert_allclose(variance, 1.0, atol=0.04)
    np.testing.assert_allclose(covariance, np.broadcast_to(expected, 6), atol=0.04)


def test_steps_are_level_between_jumps_of_all_components():
    step, duration = 0.05, 6000.0
    x = PROCESSES["steps"](round(duration / step), step, np.random.default_rng(5))
    jumped = np.diff(x, axis=0) != 0
    assert (jumped.all(axis=1) == jumped.any(axis=1)).all()
    assert jumped[:, 0].sum() == pytest.approx(duration / STEP_INTERVAL, abs=5 * 10)


def test_an_outage_exceeds_the_specification_for_its_time_and_nowhere_else():
    step, count = 0.5, 800
    length = round(OUTAGE_TIME / step)
    extra = []
    for seed in range(300):
        x, plain = (
            PROCESSES[kind](count, step, np.random.default_rng(seed))
            for kind in ("outage", "gauss-markov")
        )
        inside = np.flatnonzero((x != plain).any(axis=1))
        assert length - 2 <= np.ptp(inside) + 1 <= length
        extra.append(np.abs(x - plain)[inside].max(axis=0))
    rms = np.sqrt((np.array(extra) ** 2).mean(axis=0))
    np.testing.assert_allclose(rms, OUTAGE_FACTOR, rtol=0.15)


@pytest.mark.parametrize("kind", NAVIGATION)
def test_every_kind_scales_with_the_noise_scale(kind):
    flight = straight_flight(20.0, 0.005)
    once, none = (disturb(flight, s, np.random.default_rng(3), kind)[0] for s in (1.0, 0.0))
    twice, _ = disturb(flight, 2.0, np.random.default_rng(3), kind)
    np.testing.assert_allclose(twice.position, 2 * once.position, rtol=1e-12)
    np.testing.assert_allclose(twice.attitude, 2 * once.attitude, atol=1e-12)
    np.testing.assert_array_equal(none.position, flight.position)
    assert (once.position.std(axis=0) > 1e-4).all()
