"""The least eigenpair against LAPACK's, over matrices from round to flat to nothing."""

import numpy as np
import pytest

from paperrepro.method.planes import least_eigenpair


@pytest.mark.parametrize("flatness", [1.0, 1e-3, 1e-8, 0.0])
def test_is_that_of_lapack(flatness):
    rng = np.random.default_rng(1)
    for _ in range(200):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        S = axes @ np.diag([flatness * rng.uniform(0.1, 0.9), *rng.uniform(1, 50, 2)]) @ axes.T
        S = (S + S.T) / 2
        values, vectors = np.linalg.eigh(S)
        value, vector = least_eigenpair(S.copy())
        assert value == pytest.approx(values[0], abs=1e-14 * values[2])
        expected = vectors[:, 0] * np.sign(vectors[2, 0])
        np.testing.assert_allclose(vector, expected, atol=1e-14)


def test_of_axes_and_of_nothing():
    assert least_eigenpair(np.diag([3.0, 1.0, 2.0])) == (1.0, (0.0, 1.0, 0.0))
    value, vector = least_eigenpair(np.zeros((3, 3)))
    assert value == 0.0
    assert np.linalg.norm(vector) == 1.0
