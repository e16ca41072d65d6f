"""The Gauss-Markov prior, its nodes, and the block-tridiagonal algebra under it."""

import numpy as np
import pytest

from paperrepro.method.adjustment.trajectory_equations import GaussMarkov, Nodes
from paperrepro.method.adjustment.trajectory_windows import Factor


def dense(D, E):
    K, b = D.shape[:2]
    out = np.zeros((K * b, K * b))
    for k in range(K):
        out[k * b : (k + 1) * b, k * b : (k + 1) * b] = D[k]
        if k + 1 < K:
            out[k * b : (k + 1) * b, (k + 1) * b : (k + 2) * b] = E[k]
            out[(k + 1) * b : (k + 2) * b, k * b : (k + 1) * b] = E[k].T
    return out


def random_system(K=7, b=6):
    rng = np.random.default_rng(0)
    E = rng.normal(size=(K - 1, b, b))
    D = rng.normal(size=(K, b, b))
    return D @ D.transpose(0, 2, 1) + 30 * np.eye(b), E


def test_solution_determinant_and_inverse_equal_dense_algebra():
    D, E = random_system()
    M, right = dense(D, E), np.random.default_rng(1).normal(size=(7, 6, 3))
    expected = np.linalg.solve(M, right.reshape(42, 3)).reshape(7, 6, 3)
    factor = Factor.of(D, E, right)
    np.testing.assert_allclose(factor.backward(right), expected, rtol=1e-10, atol=1e-13)
    assert factor.log_det == pytest.approx(np.linalg.slogdet(M)[1], rel=1e-12)
    blocks = np.linalg.inv(M).reshape(7, 6, 7, 6)
    every, other = np.arange(6), np.array([3, 1, 5, 0, 4, 2])
    diagonal, beside = factor.inverse_blocks(other)
    for k in range(7):
        np.testing.assert_allclose(diagonal[k], blocks[k, every, k, other], rtol=1e-9, atol=1e-13)
    for k in range(6):
        expected = blocks[k, every, k + 1, other]
        np.testing.assert_allclose(beside[k], expected, rtol=1e-9, atol=1e-13)


def test_an_indefinite_matrix_is_refused():
    D, E = random_system()
    D[3] -= 200 * np.eye(6)
    with pytest.raises(np.linalg.LinAlgError):
        Factor.of(D, E, np.zeros((7, 6, 1)))


PROFILE = np.array([0.0, 10.0, 30.0]), np.random.default_rng(1).uniform(0.3, 3, (3, 6))


@pytest.mark.parametrize("profile", [None, PROFILE])
def test_information_is_the_inverse_of_the_exponential_covariance(profile):
    time = np.array([0.0, 0.4, 1.0, 21.0, 22.0, 22.5])
    process = GaussMarkov(np.arange(1.0, 7.0), np.linspace(5, 40, 6), profile)
    factor = process.factor(time)
    diagonal, beside, log_det = process.information(time)
    total = 0.0
    for c in range(6):
        lag = np.abs(time[:, None] - time)
        covariance = process.sigma[c] ** 2 * np.exp(-lag / process.correlation_time[c])
        covariance *= np.outer(factor[:, c], factor[:, c])
        information = np.diag(diagonal[:, c]) + np.diag(beside[:, c], 1) + np.diag(beside[:, c], -1)
        np.testing.assert_allclose(information @ covariance, np.eye(6), atol=1e-10)
        total -= np.linalg.slogdet(covariance)[1]
    assert log_det == pytest.approx(total, rel=1e-12)


def test_nodes_cover_the_points_and_nothing_else():
    time = np.array([10.1, 10.2, 10.9, 50.3])
    nodes = Nodes.covering(time, 0.25)
    np.testing.assert_allclose(nodes.time, [10.0, 10.25, 10.75, 11.0, 50.25, 50.5])
    before, share = nodes.locate(time)
    np.testing.assert_allclose(nodes.time[before] + 0.25 * share, time)
    assert ((share >= 0) & (share <= 1)).all()
