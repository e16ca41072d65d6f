"""Normal equations of scenario D: the point-on-plane condition with the pose error as an unknown.

Points of one face and one moment between two neighbouring nodes form a cell. All of a cell's points share one
plane and two nodes, so a cell's normal equations are one small dense block; blocks are summed cell
by cell, independent of the number of threads. A plane has three unknowns: two turns of its normal
and its distance d.
"""

from dataclasses import dataclass

import numba
import numpy as np

from paperrepro.adjustment.gauss_markov import Nodes
from paperrepro.adjustment.gauss_newton import SETTLED
from paperrepro.adjustment.lever_arm import TrajectoryUnknowns
from paperrepro.adjustment.matched import MatchedFaces
from paperrepro.adjustment.sightlines import Sightlines, axes, moved, ray, settle
from paperrepro.georeference import body_to_map
from paperrepro.kernels import over_threads

N_ANGLES, N_PLANE = 3, 3
N_NODES = 12  # two nodes of six components
#: A moment, s: a turn of most scanners, so that a cell holds one scan line of each beam. What the
#: points of a moment share of a face's roughness is independent of how far the nodes are apart.
MOMENT = 0.1
#: A row of A without offset, lever arm and clock. Loops of a length that is known are twice as fast.
N_ROW = N_ANGLES + N_PLANE + N_NODES


@dataclass(frozen=True)
class Cells:
    """Rays sorted by cell, ``order`` (N,) being their index in the matched faces: cell ``c`` has
    rows ``ranges[c]``, lies on ``plane[c]`` in face ``face[c]`` and between nodes ``node[c]`` and
    the next; ``share`` (N,) of the latter for each ray, ``rate`` (N, 6) of its pose, m/s and rad/s,
    or (0, 6) where the clock is no unknown."""

    order: np.ndarray
    sight: Sightlines
    share: np.ndarray
    rate: np.ndarray
    ranges: np.ndarray
    plane: np.ndarray
    face: np.ndarray
    node: np.ndarray

    @classmethod
    def of(cls, matched: MatchedFaces, nodes: Nodes, rate: np.ndarray | None = None) -> "Cells":
        face = np.repeat(np.arange(len(matched.ranges)), np.diff(matched.ranges, axis=1)[:, 0])
        node, share = nodes.locate(matched.rays.time)
        moment = np.floor((matched.rays.time - nodes.time[0]) / MOMENT).astype(int)
        key = (face * len(nodes.time) + node) * (moment.max() + 1) + moment
        order = np.argsort(key, kind="stable")
        first = np.flatnonzero(np.r_[True, np.diff(key[order]) > 0])
        ranges = np.column_stack([first, np.r_[first[1:], len(key)]]).astype(np.int64)
        chosen = order[first]
        face_of_cell = face[chosen]
        return cls(
            order, Sightlines.of(matched.rays.take(order)), share[order],
            np.empty((0, 6)) if rate is None else np.ascontiguousarray(rate[order]), ranges,
            matched.plane[face_of_cell], face_of_cell, node[chosen],
        )  # fmt: skip


@dataclass(frozen=True)
class CellBlocks:
    """``N`` (C, u + 15, u + 15), upper triangle alone, ``t`` (C, u + 15): unknowns, plane, node
    before, node after; ``chi2`` (C,) weighted squared residuals; ``N dx + t = 0`` at the solution
    step."""

    N: np.ndarray
    t: np.ndarray
    chi2: np.ndarray


def cell_blocks(
    cells: Cells,
    origin: np.ndarray,
    planes: np.ndarray,
    turns: np.ndarray,
    unknowns: TrajectoryUnknowns,
    x: np.ndarray,
    error: np.ndarray,
    variances: np.ndarray,
    settled: float = SETTLED,
) -> CellBlocks:
    """`CellBlocks` at ``x``, the views' ``planes`` (F, 4) with d from ``origin`` (F, 3), pose errors
    ``error`` (K, 6) m and rad, and ``variances`` (9,) of the observations, free of what the error
    stands for; ``turns`` (F, 3, 2) how a plane's normal moves with its two unknowns; ``settled`` m
    as `sightlines.settle` has it.
    """  # fmt: skip
    size = unknowns.size + N_PLANE + N_NODES
    n_cells = len(cells.ranges)
    N, t, chi2 = np.zeros((n_cells, size, size)), np.zeros((n_cells, size)), np.zeros(n_cells)
    R_l_b, dR_l_b, *mounted = unknowns.kernel_arguments(x)
    over_threads(
        _cell_blocks, n_cells, *cells.sight.columns(), cells.share, cells.rate, cells.ranges,
        cells.node, origin[cells.face], planes[cells.face], turns[cells.face], error,
        R_l_b, axes(R_l_b, dR_l_b), *mounted, variances, settled,
        3 * unknowns.lever, unknowns.clock_delay(x), N, t, chi2, least=8,
    )  # fmt: skip
    return CellBlocks(N, t, chi2)


@numba.njit(cache=True, nogil=True)
def _cell_blocks(
    first, last, position, turns, rho, ring, share, rate, ranges, node, origin, planes, plane_turns,
    error, R_l_b, turn_axes, lever, offsets, ring_column, variances, settled, n_lever, delay, N, t,
    chi2,
):  # fmt: skip
    """Fill ``N``, ``t`` and ``chi2`` of cells ``first`` to ``last``."""
    timed = len(rate) > 0
    size = N_ROW + n_lever + timed
    v, b, seen, e, row = np.empty(9), np.empty(9), np.empty(8), np.empty(6), np.empty(size)
    sums, of_ring = np.empty((size, size + 1)), np.empty((len(ring_column), size + 2))
    per_ring, n_x = ring_column.max() >= 0, t.shape[1] - N_PLANE - N_NODES
    where = np.arange(size)  # plane and nodes follow the unknowns, the last: lever arm, clock
    for k in range(N_ANGLES, size):
        where[k] += n_x - (N_ANGLES if k < N_ROW else size)
    for c in range(first, last):
        before, after = error[node[c]], error[node[c] + 1]
        plane, near = planes[c], origin[c]
        sums[:], of_ring[:] = 0.0, 0.0
        for i in range(ranges[c, 0], ranges[c, 1]):
            for m in range(6):
                e[m] = (1 - share[i]) * before[m] + share[i] * after[m]
                if timed:
                    e[m] += delay * rate[i, m]
            there, then = ray(position, turns, i)
            there, then = moved(there, then, e)
            w, s = settle(
                there, then, rho[i], plane, near, R_l_b, turn_axes, lever, offsets[ring[i]],
                variances, settled, v, b, seen,
            )  # fmt: skip
            _fill_row(seen, b, share[i], plane_turns[c], row)
            if n_lever > 0:
                _fill_lever(plane, then, row)
            if timed:
                row[size - 1] = 0.0
                for m in range(6):
                    row[size - 1] += b[m] * rate[i, m]
            _add_products(row, w, 1.0 / s, sums)
            if per_ring:
                _add_offset(row, seen[3], w, 1.0 / s, of_ring, ring[i])
            chi2[c] += w * w / s
        _add_sums(sums, of_ring, where, ring_column, N[c], t[c])


@numba.njit(cache=True)
def _fill_row(seen, b, share, plane_turns, row):
    """A row of A without the ring's offset: three angles, two turns of the plane and d, six of each
    node; those of the lever arm come last."""
    for k in range(3):
        row[k] = seen[k]
    for k in range(2):
        row[3 + k] = (
            seen[4] * plane_turns[0, k] + seen[5] * plane_turns[1, k] + seen[6] * plane_turns[2, k]
        )
    row[5] = seen[7]
    for m in range(6):
        row[6 + m], row[12 + m] = (1 - share) * b[m], share * b[m]


@numba.njit(cache=True)
def _fill_lever(plane, turns, row):
    """The plane's normal in the b-frame: Eq. (1) adds the lever arm there."""
    R = body_to_map(turns)
    for k in range(3):
        row[N_ROW + k] = plane[0] * R[0][k] + plane[1] * R[1][k] + plane[2] * R[2][k]


@numba.njit(cache=True)
def _add_products(row, w, weight, sums):
    """Add a condition to the ``sums`` (r, r + 1): products of its ``row`` (r,) and, last, with w;
    upper triangle alone."""
    size = len(row)
    for k in range(N_ROW):
        scaled = weight * row[k]
        for m in range(k, N_ROW):
            sums[k, m] += scaled * row[m]
        sums[k, size] += scaled * w
    for m in range(N_ROW, size):
        scaled = weight * row[m]
        for k in range(m + 1):
            sums[k, m] += scaled * row[k]
        sums[m, size] += scaled * w


@numba.njit(cache=True)
def _add_offset(row, by_offset, w, weight, of_ring, ring):
    """Add a condition's products with its derivative by the offset of its ``ring`` to ``of_ring``
    (rings, r + 2): with ``row``, with itself and, last, with w."""
    scaled = weight * by_offset
    for k in range(len(row)):
        of_ring[ring, k] += scaled * row[k]
    of_ring[ring, len(row)] += scaled * by_offset
    of_ring[ring, len(row) + 1] += scaled * w


@numba.njit(cache=True)
def _add_sums(sums, of_ring, where, ring_column, N, t):
    """Add the sums to N (upper triangle) and t: ``where`` (r,) an entry of a row is there, and
    ``ring_column`` (rings,) the offset of a ring, -1 where it is held."""
    size = len(sums)
    for k in range(size):
        for m in range(k, size):
            N[min(where[k], where[m]), max(where[k], where[m])] += sums[k, m]
        t[where[k]] += sums[k, size]
    for r in range(len(ring_column)):
        column = ring_column[r]
        if column >= 0:
            for k in range(size):
                N[min(column, where[k]), max(column, where[k])] += of_ring[r, k]
            N[column, column] += of_ring[r, size]
            t[column] += of_ring[r, size + 1]
