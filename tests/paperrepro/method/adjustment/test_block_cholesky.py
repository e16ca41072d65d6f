"""The sparse factor against the dense matrix that its parts add up to."""

import numpy as np
import pytest

from paperrepro.method.adjustment.block_cholesky import BlockCholesky, dissected


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
    order = dissected(places, rng.normal(size=(count, 2)))
    factor = BlockCholesky.of(parts, places, len(seen), order)
    inverse, right = np.linalg.inv(dense), rng.normal(size=(len(seen), 3))
    np.testing.assert_allclose(factor.log_det, np.linalg.slogdet(dense)[1], rtol=1e-12)
    np.testing.assert_allclose(factor.solve(right), inverse @ right, rtol=0, atol=1e-11)
    for at, block in zip(places, factor.inverse_blocks(), strict=True):
        np.testing.assert_allclose(block, inverse[np.ix_(at, at)], rtol=0, atol=1e-11)


def test_what_is_not_positive_definite_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        BlockCholesky.of([np.array([[1.0, 2.0], [2.0, 1.0]])], [np.arange(2)], 2, np.arange(1))


def crossing(size: int) -> tuple[list, list, np.ndarray, int]:
    """Parts of ``size`` lines east and as many north over as many crossings squared, one at each
    crossing: it knows its three unknowns, those between neighbours in time, and two of all."""
    rng, steps = np.random.default_rng(size), np.arange(size)
    east = [(k, j if k % 2 == 0 else size - 1 - j) for k in steps for j in steps]
    flown = [*east, *[(j, k) for k, j in east]]
    places = [
        np.r_[2 + 3 * (size * k + j) + np.arange(3), 2 + 3 * size**2 + 2 * n + np.arange(4), 0, 1]
        for n, (k, j) in enumerate(flown)
    ]
    parts = [a.T @ a for a in rng.normal(size=(len(places), 12, 9))]
    return parts, places, np.array(flown, float), 4 + 3 * size**2 + 2 * len(flown)


def test_crossing_lines_equal_the_dense_sum():
    parts, places, at, n = crossing(6)
    dense = np.zeros((n, n))
    for part, where in zip(parts, places, strict=True):
        dense[np.ix_(where, where)] += part
    inverse = np.linalg.inv(dense)
    factor = BlockCholesky.of(parts, places, n, dissected(places, at))
    np.testing.assert_allclose(factor.log_det, np.linalg.slogdet(dense)[1], rtol=1e-12)
    np.testing.assert_allclose(factor.solve(np.eye(n)), inverse, rtol=0, atol=1e-10)
    for where, block in zip(places, factor.inverse_blocks(), strict=True):
        np.testing.assert_allclose(block, inverse[np.ix_(where, where)], rtol=0, atol=1e-10)


def test_with_lines_that_cross_the_greatest_front_grows_as_a_side_of_the_site():
    """One that grew as its area, as halves of the flight's time have it, would be fourfold."""

    def greatest(size):
        parts, places, at, n = crossing(size)
        factor = BlockCholesky.of(parts, places, n, dissected(places, at))
        return max(len(front.own) + len(front.rest) for front in factor.fronts)

    assert greatest(16) < 2.3 * greatest(8)
