"""The sparse factor against the dense matrix that its parts add up to."""

import numpy as np
import pytest

from paperrepro.method.adjustment.block_cholesky import BlockCholesky


@pytest.mark.parametrize("count", [1, 2, 7])
def test_solution_determinant_and_inverse_are_those_of_the_sum(count):
    """Neighbours share two unknowns, parts far apart one plane, all of them the last two."""
    rng = np.random.default_rng(count)
    n = 4 * count + 5
    shared = n - 3
    places = [
        np.array(
            [*range(4 * k, 4 * k + 4 + 2 * (k < count - 1)), *[shared] * (k % 3 == 0), n - 2, n - 1]
        )
        for k in range(count)
    ]
    parts = [a.T @ a for a in (rng.normal(size=(3 * len(at), len(at))) for at in places)]
    dense = np.zeros((n, n))
    for part, at in zip(parts, places, strict=True):
        dense[np.ix_(at, at)] += part
    seen = np.flatnonzero(np.diag(dense))
    number = np.cumsum(np.diag(dense) > 0) - 1
    dense, places = dense[np.ix_(seen, seen)], [number[at] for at in places]
    factor = BlockCholesky.of(parts, places, len(seen))
    inverse, right = np.linalg.inv(dense), rng.normal(size=(len(seen), 3))
    np.testing.assert_allclose(factor.log_det, np.linalg.slogdet(dense)[1], rtol=1e-12)
    np.testing.assert_allclose(factor.solve(right), inverse @ right, rtol=0, atol=1e-11)
    for at, block in zip(places, factor.inverse_blocks(), strict=True):
        np.testing.assert_allclose(block, inverse[np.ix_(at, at)], rtol=0, atol=1e-11)


def test_what_is_not_positive_definite_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        BlockCholesky.of([np.array([[1.0, 2.0], [2.0, 1.0]])], [np.arange(2)], 2)
