"""What the geometry determines: information left for the boresight, and the two refusals."""

from dataclasses import replace

import numpy as np
import pytest

from paperrepro.errors import NoConvergence, RankDefect
from paperrepro.method.adjustment.observability import (
    Observability,
    boresight_information,
    no_convergence,
    require_determined,
)


@pytest.fixture
def S():
    """Information of three angles and two offsets, as normal equations have it."""
    A = np.random.default_rng(3).normal(size=(20, 5))
    return A.T @ A


def seen(sigma_deg, condition=10.0):
    """An `Observability` whose weakest direction is mostly pitch."""
    weakest = np.array([0.1, 0.98, 0.17])
    return Observability(3, condition, weakest, np.deg2rad(sigma_deg), 0)


def test_information_of_the_boresight_is_the_inverse_of_its_covariance(S):
    expected = np.linalg.inv(np.linalg.inv(S)[:3, :3])
    np.testing.assert_allclose(boresight_information(S), expected, rtol=1e-10)


def test_information_without_offsets_is_that_of_the_angles(S):
    np.testing.assert_array_equal(boresight_information(S[:3, :3]), S[:3, :3])


def test_the_weakest_direction_is_the_covariance_s_longest_axis(S):
    weight = np.array([0, 0, 0, 2.0, 2.0])
    observed = Observability.of(S, weight)
    variances, axes = np.linalg.eigh(np.linalg.inv(S + np.diag(weight))[:3, :3])
    assert observed.weakest_sigma == pytest.approx(np.sqrt(variances[-1]))
    assert observed.condition == pytest.approx(variances[-1] / variances[0])
    assert abs(observed.weakest @ axes[:, -1]) == pytest.approx(1)
    assert observed.rank == 3


def test_an_angle_in_no_condition_is_told_without_a_division_by_zero():
    observed = Observability.of(np.diag([4.0, 4.0, 0.0]), np.zeros(3))
    assert (observed.rank, observed.weakest_word) == (2, "yaw")
    with pytest.raises(RankDefect, match="boresight's yaw"):
        require_determined(observed)


def test_offsets_determined_are_those_that_outweigh_the_pseudo_observation():
    S = np.diag([1.0, 1, 1, 5, 50, 500])
    assert [
        Observability.of(S, np.r_[np.zeros(3), np.full(3, w)]).offsets_determined
        for w in (1, 10, 100, 1000)
    ] == [3, 2, 1, 0]


def test_a_direction_wider_than_a_degree_is_refused():
    require_determined(seen(0.99))
    with pytest.raises(RankDefect) as error:
        require_determined(seen(1.5))
    for fact in ("boresight's pitch", "at least 1.50 deg", "expected at most 1 deg", "add strips"):
        assert fact in str(error.value)


def test_iterations_without_end_are_the_geometry_s_fault_where_it_is_bad():
    error = no_convergence(seen(0.5, condition=5e3), 50, 2e-4, 1e-10)
    assert isinstance(error, RankDefect)
    for fact in ("50 iterations", "2.00e-04", "limit 1e-10", "boresight's pitch", "add strips"):
        assert fact in str(error)


def test_iterations_without_end_are_the_matches_fault_otherwise():
    error = no_convergence(replace(seen(0.5)), 50, 2e-4, 1e-10)
    assert isinstance(error, NoConvergence)
    for fact in ("50 iterations", "2.00e-04", "limit 1e-10", "wrong matches"):
        assert fact in str(error)
