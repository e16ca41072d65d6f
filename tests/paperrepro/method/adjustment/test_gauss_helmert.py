"""The solver against the textbook: the same estimate and covariance without any elimination."""

import numpy as np
import pytest

from paperrepro.method.adjustment.scenarios import SCENARIOS, Scenario, calibrate
from tests.paperrepro.labelled import matched_faces, survey_of, with_noise
from tests.paperrepro.method.adjustment import dense

FREE = [
    SCENARIOS["SL"],
    Scenario("common offset", "common", free_planes=True, points=None, centroids=False),
    Scenario("offsets", "per_ring", free_planes=True, points=None, centroids=False),
    SCENARIOS["C"],
]
REFERENCE = [
    SCENARIOS["A"],
    SCENARIOS["B"],
    Scenario("points", "none", free_planes=False, points=None, centroids=False),
]
OFFSETS = np.random.default_rng(9).normal(0, 0.02, 16)


def named(scenario):
    return scenario.name


@pytest.fixture(scope="module")
def noisy():
    """Four planes from three strips, eight points each: 96 points with nine observations."""
    tie_planes, _, _ = matched_faces(
        n_roofs=2, headings=(0.0, 180.0, 90.0), count=8, offsets=OFFSETS
    )
    return with_noise(tie_planes, np.random.default_rng(4))


@pytest.fixture(scope="module", params=FREE, ids=named)
def free(request, noisy):
    scenario, survey = request.param, survey_of()
    problem = dense.Problem.of(survey, noisy, scenario.range_offsets)
    return calibrate(survey, noisy, scenario), dense.adjust_free(problem, scenario.centroids)


@pytest.fixture(scope="module", params=REFERENCE, ids=named)
def reference(request, noisy):
    scenario, survey = request.param, survey_of()
    problem = dense.Problem.of(survey, noisy, scenario.range_offsets)
    expected = dense.adjust_reference(problem, scenario.has_points, scenario.centroids)
    return calibrate(survey, noisy, scenario), expected


def unknowns(result):
    """x as estimated: a common offset appears once."""
    offsets = np.zeros(0) if result.range_offsets is None else result.range_offsets
    return np.append(result.boresight, offsets)[: len(result.covariance)]


def relative(covariance, expected):
    """Difference of two covariances in units of the standard deviations."""
    sigma = np.sqrt(np.diag(expected))
    return np.abs((covariance - expected) / np.outer(sigma, sigma)).max()


def test_free_planes_give_the_dense_estimate(free):
    result, expected = free
    np.testing.assert_allclose(unknowns(result), expected.x, rtol=0, atol=1e-10)


def test_free_planes_give_the_dense_covariance(free):
    result, expected = free
    assert relative(result.covariance, expected.sigma0**2 * expected.Q) < 1e-9


def test_free_planes_are_the_dense_planes_in_the_map_frame(free):
    result, expected = free
    np.testing.assert_allclose(result.planes, expected.planes, rtol=0, atol=1e-10)


def test_free_planes_have_the_dense_covariance_in_the_map_frame(free):
    result, expected = free
    for ours, theirs in zip(result.covariance_planes, expected.Q_planes, strict=True):
        assert relative(ours, expected.sigma0**2 * theirs) < 1e-9


def test_free_planes_give_the_dense_variance_factor(free):
    result, expected = free
    assert result.sigma0 == pytest.approx(expected.sigma0, rel=1e-10)
    assert result.dof == expected.dof


def test_reference_planes_give_the_brute_force_estimate(reference):
    result, expected = reference
    np.testing.assert_allclose(unknowns(result), expected.x, rtol=0, atol=1e-9)


def test_reference_planes_give_the_brute_force_covariance(reference):
    """1e-6: the brute force differentiates by central differences."""
    result, expected = reference
    assert relative(result.covariance, expected.sigma0**2 * expected.Q) < 1e-6


def test_reference_planes_give_the_brute_force_variance_factor(reference):
    result, expected = reference
    assert result.sigma0 == pytest.approx(expected.sigma0, rel=1e-8)
    assert result.dof == expected.dof
