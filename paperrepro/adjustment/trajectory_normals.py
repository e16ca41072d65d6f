"""Normal equations of scenario D: the point-on-plane condition with the pose error as an unknown.

Points of one face between two neighbouring nodes form a cell. All of a cell's points share one
plane and two nodes, so a cell's normal equations are one small dense block; blocks are summed cell
by cell, independent of the number of threads.
"""

from dataclasses import dataclass

import numba
import numpy as np

from paperrepro.adjustment.gauss_markov import Nodes
from paperrepro.adjustment.lever_arm import LeverArmUnknowns
from paperrepro.adjustment.matched import MatchedFaces
from paperrepro.adjustment.normals import Unknowns
from paperrepro.adjustment.sightlines import SETTLED, Sightlines, axes, moved, ray, settle
from paperrepro.georeference import body_to_map
from paperrepro.kernels import over_threads

N_NODES = 12  # two nodes of six components
N_PLANE = 4


@dataclass(frozen=True)
class Cells:
    """Rays sorted by cell, ``order`` (N,) being their index in the matched faces: cell ``c`` has
    rows ``ranges[c]``, lies on ``plane[c]`` in face ``face[c]`` and between nodes ``node[c]`` and
    the next; ``share`` (N,) of the latter for each ray."""

    order: np.ndarray
    sight: Sightlines
    share: np.ndarray
    ranges: np.ndarray
    plane: np.ndarray
    face: np.ndarray
    node: np.ndarray

    @classmethod
    def of(cls, matched: MatchedFaces, nodes: Nodes) -> "Cells":
        face = np.repeat(np.arange(len(matched.ranges)), np.diff(matched.ranges, axis=1)[:, 0])
        node, share = nodes.locate(matched.rays.time)
        key = face * len(nodes.time) + node
        order = np.argsort(key, kind="stable")
        first = np.flatnonzero(np.r_[True, np.diff(key[order]) > 0])
        ranges = np.column_stack([first, np.r_[first[1:], len(key)]]).astype(np.int64)
        chosen = order[first]
        face_of_cell = face[chosen]
        return cls(
            order, Sightlines.of(matched.rays.take(order)), share[order], ranges,
            matched.plane[face_of_cell], face_of_cell, node[chosen],
        )  # fmt: skip


@dataclass(frozen=True)
class CellBlocks:
    """``N`` (C, u + 16, u + 16), ``t`` (C, u + 16): unknowns, plane, node before, node after;
    ``chi2`` (C,) weighted squared residuals; ``N dx + t = 0`` at the solution step."""

    N: np.ndarray
    t: np.ndarray
    chi2: np.ndarray


def cell_blocks(
    cells: Cells,
    origin: np.ndarray,
    planes: np.ndarray,
    unknowns: Unknowns,
    x: np.ndarray,
    error: np.ndarray,
    variances: np.ndarray,
    weight: np.ndarray,
    settled: float = SETTLED,
) -> CellBlocks:
    """`CellBlocks` at ``x``, ``planes`` (G, 4) with d from ``origin`` (G, 3), pose errors ``error``
    (K, 6) m and rad, and ``variances`` (9,) of the observations, free of what the error stands for;
    ``weight`` (F,) multiplies the weights of a face's points; ``settled`` m as `sightlines.settle`
    has it.
    """  # fmt: skip
    size = unknowns.size + N_PLANE + N_NODES
    n_cells = len(cells.ranges)
    N, t, chi2 = np.zeros((n_cells, size, size)), np.zeros((n_cells, size)), np.zeros(n_cells)
    R_l_b, dR_l_b, *mounted = unknowns.kernel_arguments(x)
    over_threads(
        _cell_blocks, n_cells, 8, *cells.sight.columns(), cells.share, cells.ranges, cells.node,
        origin[cells.plane], planes[cells.plane], weight[cells.face], error, R_l_b,
        axes(R_l_b, dR_l_b), *mounted, variances, settled,
        3 if isinstance(unknowns, LeverArmUnknowns) else 0, N, t, chi2,
    )  # fmt: skip
    lower = np.tril_indices(size, -1)
    N[:, lower[0], lower[1]] = N[:, lower[1], lower[0]]
    return CellBlocks(N, t, chi2)


@numba.njit(cache=True, nogil=True)
def _cell_blocks(
    first, last, position, turns, rho, ring, share, ranges, node, origin, planes, weight, error,
    R_l_b, turn_axes, lever, offsets, ring_column, variances, settled, n_lever, N, t, chi2,
):  # fmt: skip
    """Fill ``N``, ``t`` and ``chi2`` of cells ``first`` to ``last``."""
    v, b, seen, e = np.empty(9), np.empty(9), np.empty(8), np.empty(6)
    row, where = np.empty(20 + n_lever), np.empty(20 + n_lever, np.int64)
    for c in range(first, last):
        before, after, n_x = error[node[c]], error[node[c] + 1], t.shape[1] - 16
        plane, near, N_c, t_c = planes[c], origin[c], N[c], t[c]
        for i in range(ranges[c, 0], ranges[c, 1]):
            for m in range(6):
                e[m] = (1 - share[i]) * before[m] + share[i] * after[m]
            there, then = ray(position, turns, i)
            there, then = moved(there, then, e)
            w, s = settle(
                there, then, rho[i], plane, near, R_l_b, turn_axes, lever, offsets[ring[i]],
                variances, settled, v, b, seen,
            )  # fmt: skip
            _row(seen, b, share[i], ring_column[ring[i]], n_x, row, where)
            if n_lever > 0:
                _lever_entries(plane, then, row)
            add_row(row, where, w, weight[c] / s, N_c, t_c)
            chi2[c] += weight[c] * w * w / s


@numba.njit(cache=True)
def _row(seen, b, share, column, n_x, row, where):
    """Entries of a row of A: angles, the ring's offset, the lever arm where it is free, n and d,
    six of each node."""
    for k in range(4):
        row[k] = seen[k]
        where[k] = k
    where[3] = column
    if column < 0:  # held: a zero entry, anywhere
        row[3], where[3] = 0.0, 2
    first = len(row) - 16
    for k in range(4, first):
        where[k] = n_x - first + k
    for j in range(4):
        row[first + j] = seen[4 + j]
    for m in range(6):
        row[first + 4 + m], row[first + 10 + m] = (1 - share) * b[m], share * b[m]
    for k in range(16):
        where[first + k] = n_x + k


@numba.njit(cache=True)
def _lever_entries(plane, turns, row):
    """The plane's normal in the b-frame: Eq. (1) adds the lever arm there."""
    R = body_to_map(turns)
    for k in range(3):
        row[4 + k] = plane[0] * R[0][k] + plane[1] * R[1][k] + plane[2] * R[2][k]


@numba.njit(cache=True)
def add_row(row, where, w, weight, N, t):
    """Add a condition, ``row`` in columns ``where`` (ascending), to N (upper triangle) and t. From
    the fifth on the columns follow each other."""
    shift = where[4] - 4
    for a in range(len(row)):
        scaled, place = weight * row[a], where[a]
        t[place] += scaled * w
        for b in range(a, 4):
            N[place, where[b]] += scaled * row[b]
        for b in range(max(a, 4), len(row)):
            N[place, shift + b] += scaled * row[b]
