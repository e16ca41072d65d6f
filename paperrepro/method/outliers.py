"""Statistical outlier removal, SOR (reference 39 of the paper: Rusu et al. 2008).

The mean distance of every point to its nearest neighbours comes from a horizontal grid. A strip is
a surface seen from above: in plan its points are spread evenly enough for a grid, and a grid is
searched several times faster than a tree. The search is exact. Points are sorted by cell; a query
looks at the square of cells around it whose half width is that of the point before, made wider
until the k-th neighbour lies within. Clouds that a grid does not suit go to a k-d tree.
"""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.spatial import cKDTree

from paperrepro._compiled import over_threads


@dataclass(frozen=True)
class OutlierParameters:
    """``k`` neighbours; a point goes when its mean distance to them exceeds mu + ``alpha`` sigma.

    The paper prints neither number. Sigma is here the trend of density, not noise: it comes out
    near mu / 2. A face grazed at 80 degrees at the swath's edge has, by range and incidence,
    sqrt(4 / cos 80) = 5 times the spacing of nadir, which is 6 to 8 sigma; dust and birds stand
    metres from anything. So alpha = 10 keeps such a face and drops what is alone in the air.
    """

    k: int = 16
    alpha: float = 10.0


def statistical_outliers(p_m: np.ndarray, k: int = 16, alpha: float = 10.0) -> np.ndarray:
    """Mask (N,) of the points to keep.

    p_m : (N, 3) array, m, any Cartesian frame. ``k`` neighbours, the point itself not counted;
    kept where the mean distance to them is at most mu + ``alpha`` sigma over all points. A cloud
    of k points or fewer has no statistics and is kept whole.
    """
    if len(p_m) <= k:
        return np.ones(len(p_m), dtype=bool)
    mean_distance = mean_neighbour_distance(p_m, k)
    return mean_distance <= mean_distance.mean() + alpha * mean_distance.std()


#: Points in a cell, on average as a point sees it; so many make the search fastest.
OCCUPANCY = 3.0
#: More points in a cell than this, as a point sees it: columns or heaps, a case for the tree.
MOST_OCCUPANCY = 60.0
#: Points that the tree is asked for at a time.
CHUNK = 20_000
#: A search reaches so much farther than the point before had to, and when that is not far enough,
#: so much farther again.
MARGIN, WIDER = 1.1, 1.4
#: Distances kept in a search, and so few that ranks are counted.
ROOM, FEW = 4096, 64


def mean_neighbour_distance(p_m: np.ndarray, k: int) -> np.ndarray:
    """(N,) m, of points (N > k, 3) m to their ``k`` nearest others."""
    grid = _fitting_grid(p_m)
    if grid is None:
        return by_tree(p_m, k)
    low, cell, shape = grid
    out = np.empty(len(p_m))
    start, order, q = _sorted_by_cell(p_m, low, cell, shape)
    over_threads(_by_grid, len(out), q, k, low, cell, shape, start, order, out)
    return out


def by_tree(p_m: np.ndarray, k: int) -> np.ndarray:
    """The same by a k-d tree, for any cloud."""
    tree = cKDTree(p_m, balanced_tree=False, compact_nodes=False)
    out = np.empty(len(p_m))
    for first in range(0, len(p_m), CHUNK):  # bounds the table of neighbours
        part = slice(first, first + CHUNK)
        distance, _ = tree.query(p_m[part], k=k + 1, workers=-1)
        out[part] = distance.sum(axis=1) / k  # the first is the point itself, 0
    return out


def _fitting_grid(p_m: np.ndarray) -> tuple[np.ndarray, float, np.ndarray] | None:
    """Corner (2,) m, edge of the cells m, and their number (2,); None where no grid fits.

    It spans all but the outermost points, which count to the cells at its edge, so that single
    points far away do not make it coarse.
    """
    sample = p_m[:: max(1, len(p_m) // 20_000), :2]
    low, high = np.quantile(sample, [0.001, 0.999], axis=0)
    extent = np.maximum(high - low, 1e-3)
    even = float(np.sqrt(extent.prod() / len(p_m)))  # a cell's edge for one point in each
    cell = even * np.sqrt(OCCUPANCY)
    while True:
        shape = np.floor(extent / cell).astype(np.int64) + 1
        crowd = _crowd(p_m, low, cell, shape)
        if crowd <= 2 * OCCUPANCY or cell <= even / 2:
            return (low, cell, shape) if crowd <= MOST_OCCUPANCY else None
        cell = max(cell * float(np.sqrt(OCCUPANCY / crowd)), even / 2)


@numba.njit(cache=True)
def _cell_of(x, y, low, cell, shape):
    """Row and column of the cell of a place; outside of the grid, of the nearest."""
    row = min(max(int((x - low[0]) / cell), 0), shape[0] - 1)
    column = min(max(int((y - low[1]) / cell), 0), shape[1] - 1)
    return row, column


@numba.njit(cache=True)
def _crowd(p_m, low, cell, shape):
    """Points in a point's cell, on average over the points."""
    count = np.zeros(shape[0] * shape[1], dtype=np.int32)
    for i in range(len(p_m)):
        row, column = _cell_of(p_m[i, 0], p_m[i, 1], low, cell, shape)
        count[row * shape[1] + column] += 1
    total = 0.0
    for c in range(len(count)):
        total += float(count[c]) * count[c]
    return total / len(p_m)


@numba.njit(cache=True)
def _sorted_by_cell(p_m, low, cell, shape):
    """Points by cell, row by row: where each cell begins, (cells + 1,), the order (N,), and the
    points (3, N) in it."""
    number = np.empty(len(p_m), dtype=np.int32)
    start = np.zeros(shape[0] * shape[1] + 1, dtype=np.int32)
    for i in range(len(p_m)):
        row, column = _cell_of(p_m[i, 0], p_m[i, 1], low, cell, shape)
        number[i] = row * shape[1] + column
        start[number[i] + 1] += 1
    for c in range(1, len(start)):
        start[c] += start[c - 1]
    following, order = start.copy(), np.empty(len(p_m), dtype=np.int32)
    q = np.empty((3, len(p_m)))
    for i in range(len(p_m)):
        place = following[number[i]]
        following[number[i]] += 1
        order[place] = i
        q[0, place], q[1, place], q[2, place] = p_m[i, 0], p_m[i, 1], p_m[i, 2]
    return start, order, q


@numba.njit(cache=True, nogil=True)
def _by_grid(first, last, q, k, low, cell, shape, start, order, out):
    """Fill ``out``, in the order of measurement, for points ``first`` to ``last`` of ``q``, which
    are sorted by cell."""
    found, nearest = np.empty(max(ROOM, 2 * k)), np.empty(k + 1)
    reach = cell
    for i in range(first, last):
        count = 0
        while count <= k:  # the point itself is among them
            count = _within(q, i, reach, low, cell, shape, start, found, nearest)
            reach *= WIDER
        farthest = _at_rank(found, count, nearest)
        out[order[i]] = _sum_to(found, count, farthest, k + 1) / k
        reach = MARGIN * np.sqrt(farthest) + 1e-9


@numba.njit(cache=True)
def _within(q, i, reach, low, cell, shape, start, found, nearest):
    """Fill ``found`` with the squared distances of the points within ``reach``, the point itself
    among them, or where there is no room with those of the nearest; their number."""
    x, y, z = q[0, i], q[1, i], q[2, i]
    count, limit = numba.uint64(0), reach * reach
    first_row, first_column = _cell_of(x - reach, y - reach, low, cell, shape)
    last_row, last_column = _cell_of(x + reach, y + reach, low, cell, shape)
    for row in range(first_row, last_row + 1):
        j = numba.uint64(start[row * shape[1] + first_column])
        end = numba.uint64(start[row * shape[1] + last_column + 1])
        while j < end:
            stop = j + numba.uint64(len(found)) - count  # as far as there is room
            if stop > end:
                stop = end
            for other in range(j, stop):  # unsigned and without branches: in a few cycles each
                e, n, u = q[0, other] - x, q[1, other] - y, q[2, other] - z
                square = e * e + n * n + u * u
                found[count] = square
                count += numba.uint64(square <= limit)
            j = stop
            if count == len(found):
                limit = _keep_smallest(found, np.int64(count), nearest)
                count = numba.uint64(len(nearest))
                for m in range(len(nearest)):
                    found[m] = nearest[m]
    return np.int64(count)


@numba.njit(cache=True)
def _sum_to(squares, count, farthest, smallest):
    """Sum of the roots of the ``smallest`` least of ``count`` squares, of which ``farthest`` is the
    greatest: as many of its roots, less what the others fall short of it. There are no branches in
    this; those beyond fall short by nothing."""
    root = np.sqrt(farthest)
    for m in range(count):
        squares[m] = root - np.sqrt(min(squares[m], farthest))
    short_even = short_odd = 0.0
    for m in range(0, count - 1, 2):
        short_even += squares[m]
        short_odd += squares[m + 1]
    if count % 2:
        short_even += squares[count - 1]
    return smallest * root - (short_even + short_odd)


@numba.njit(cache=True)
def _at_rank(values, count, nearest):
    """The greatest of the ``len(nearest)`` smallest of the first ``count`` values: by their ranks
    where they are few, since counting needs no branches."""
    if count > FEW:
        return _keep_smallest(values, count, nearest)
    found = 0.0
    for m in range(count):
        value, less = values[m], 0
        for j in range(count):
            less += values[j] < value
        if less < len(nearest):
            found = max(found, value)
    return found


@numba.njit(cache=True)
def _keep_smallest(values, count, smallest):
    """Fill ``smallest``, ascending, from the first ``count`` values; the greatest of them."""
    last = len(smallest) - 1
    for m in range(last + 1):
        smallest[m] = np.inf
    for m in range(count):
        if values[m] < smallest[last]:
            place = last
            while place > 0 and smallest[place - 1] > values[m]:
                smallest[place] = smallest[place - 1]
                place -= 1
            smallest[place] = values[m]
    return smallest[last]
