"""Normal equations of scenario D: the point-on-plane condition with the pose error as an unknown.

Points of one face between two neighbouring nodes in time form a cell. They share one plane and two
nodes, so a cell's normal equations are one small dense block; blocks are summed cell by cell,
independent of the number of threads. A plane has three unknowns: two turns of its normal and its
distance d.

The prior of a trajectory's error is a first-order Gauss-Markov process: between nodes dt apart it
keeps ``exp(-dt / tau)`` of itself and gains the rest at random, so that its variance stays
``sigma**2``. It knows nothing of strips: across a turn it forgets as much as the turn is long.
Between nodes the error is interpolated linearly.

The lever arm may be an unknown, too. Opposite headings separate its forward and right parts from
everything but the trajectory's own position error, which averages out over the strips. Its down
part moves all strips alike, and the planes are unknown too: only the tilts of the body in gusts and
turns tell it from them. Without such tilts it keeps what it was before the flight.
"""

from dataclasses import dataclass

import numba
import numpy as np

from paperrepro._compiled import over_threads
from paperrepro.method.adjustment.conditions import FINAL, PreparedRays, Unknowns, axes
from paperrepro.method.adjustment.kernels import adjust_observations, moved, ray
from paperrepro.method.georeference import body_to_map
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Mounting

#: East, north, up, roll, pitch, heading.
N_COMPONENTS = 6
#: A trajectory called free of error still gets these, m and rad: they keep the prior finite.
LEAST_SIGMA = np.array([1e-6] * 3 + [1e-8] * 3)


@dataclass(frozen=True)
class GaussMarkov:
    """Stationary ``sigma`` (6,) m and rad of each component, ``correlation_time`` (6,) s."""

    sigma: np.ndarray
    correlation_time: np.ndarray

    def information(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Information of the errors at nodes ``time`` (K,) s ascending.

        Diagonals (K, 6), the values next to them (K - 1, 6), and the logarithm of the determinant.
        """
        variance = np.square(np.maximum(self.sigma, LEAST_SIGMA))
        kept = np.exp(-np.diff(time)[:, None] / self.correlation_time)
        gained = variance * -np.expm1(-2 * np.diff(time)[:, None] / self.correlation_time)
        diagonal = np.zeros((len(time), N_COMPONENTS))
        diagonal[0] = 1 / variance
        diagonal[1:] += 1 / gained
        diagonal[:-1] += np.square(kept) / gained
        return diagonal, -kept / gained, float(-np.log(variance).sum() - np.log(gained).sum())


@dataclass(frozen=True)
class Nodes:
    """Nodes ``time`` (K,) s, ascending, on a grid of ``spacing`` s and only where points are."""

    time: np.ndarray
    spacing: float

    @classmethod
    def covering(cls, time: np.ndarray, spacing: float) -> "Nodes":
        """The grid's nodes around every one of ``time`` (N,) s."""
        cell = np.unique(np.floor(time / spacing))
        return cls(np.union1d(cell, cell + 1) * spacing, spacing)

    def locate(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """For each of ``time`` (N,): the node before it, and the share (N,) of the next one."""
        before = np.searchsorted(self.time, time, side="right") - 1
        before = np.clip(before, 0, len(self.time) - 2)
        return before, np.clip((time - self.time[before]) / self.spacing, 0.0, 1.0)


N_ANGLES, N_PLANE = 3, 3
N_NODES = 12  # two nodes of six components
#: A moment, s: a turn of most scanners, so that a cell holds one scan line of each beam. What the
#: points of a moment share of a face's roughness is independent of how far the nodes are apart.
MOMENT = 0.1
#: A row of A without offset, lever arm, clock. Loops of a length that is known are twice as fast.
N_ROW = N_ANGLES + N_PLANE + N_NODES


@dataclass(frozen=True)
class Cells:
    """Rays sorted by cell, ``order`` (N,) being their index in the tie_planes faces: cell ``c`` has
    rows ``ranges[c]``, lies on ``plane[c]`` in face ``face[c]`` and between nodes ``node[c]`` and
    the next; ``share`` (N,) of the latter for each ray, ``rate`` (N, 6) of its pose, m/s and rad/s,
    or (0, 6) where the clock is no unknown."""

    order: np.ndarray
    sight: PreparedRays
    share: np.ndarray
    rate: np.ndarray
    ranges: np.ndarray
    plane: np.ndarray
    face: np.ndarray
    node: np.ndarray

    @classmethod
    def of(cls, tie_planes: TiePlanes, nodes: Nodes, rate: np.ndarray | None = None) -> "Cells":
        face = np.repeat(
            np.arange(len(tie_planes.ranges)), np.diff(tie_planes.ranges, axis=1)[:, 0]
        )
        node, share = nodes.locate(tie_planes.rays.time)
        moment = np.floor((tie_planes.rays.time - nodes.time[0]) / MOMENT).astype(int)
        key = (face * len(nodes.time) + node) * (moment.max() + 1) + moment
        order = np.argsort(key, kind="stable")
        first = np.flatnonzero(np.r_[True, np.diff(key[order]) > 0])
        ranges = np.column_stack([first, np.r_[first[1:], len(key)]]).astype(np.int64)
        chosen = order[first]
        face_of_cell = face[chosen]
        return cls(
            order, PreparedRays.of(tie_planes.rays.take(order)), share[order],
            np.empty((0, 6)) if rate is None else np.ascontiguousarray(rate[order]), ranges,
            tie_planes.plane[face_of_cell], face_of_cell, node[chosen],
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
    unknowns: "TrajectoryUnknowns",
    x: np.ndarray,
    error: np.ndarray,
    variances: np.ndarray,
    final_m: float = FINAL,
) -> CellBlocks:
    """`CellBlocks` at ``x``, the views' ``planes`` (F, 4), d from ``origin`` (F, 3), pose errors
    ``error`` (K, 6) m and rad, and ``variances`` (9,) of the observations, free of what the error
    stands for; ``turns`` (F, 3, 2) how a plane's normal moves with its two unknowns; ``final_m`` m
    as `kernels.adjust_observations` has it.
    """  # fmt: skip
    size = unknowns.size + N_PLANE + N_NODES
    n_cells = len(cells.ranges)
    N, t, chi2 = np.zeros((n_cells, size, size)), np.zeros((n_cells, size)), np.zeros(n_cells)
    R_l_b, dR_l_b, *mounted = unknowns.kernel_arguments(x)
    over_threads(
        _cell_blocks, n_cells, *cells.sight.columns(), cells.share, cells.rate, cells.ranges,
        cells.node, origin[cells.face], planes[cells.face], turns[cells.face], error,
        R_l_b, axes(R_l_b, dR_l_b), *mounted, variances, final_m,
        3 * unknowns.lever, unknowns.clock_delay(x), N, t, chi2, least=8,
    )  # fmt: skip
    return CellBlocks(N, t, chi2)


@numba.njit(cache=True, nogil=True)
def _cell_blocks(
    first, last, position, turns, rho, ring, share, rate, ranges, node, origin, planes, plane_turns,
    error, R_l_b, turn_axes, lever, offsets, ring_column, variances, final_m, n_lever, delay, N, t,
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
            w, s = adjust_observations(
                there, then, rho[i], plane, near, R_l_b, turn_axes, lever, offsets[ring[i]],
                variances, final_m, v, b, seen,
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


#: How well a lever arm is known before the flight, m: measured by tape between housings.
PRIOR_SIGMA = 0.05
#: Clocks of laser and GNSS/INS agree to this before the flight, s: some are off by a record.
CLOCK_SIGMA = 0.01
#: An axis counts as determined where the flight leaves no more than this share of the prior sigma.
DETERMINED = 0.5
AXES = ("forward", "right", "down")


@dataclass(frozen=True)
class TrajectoryUnknowns(Unknowns):
    """`Unknowns` with more at the end of ``x``: corrections of the ``lever`` arm, m, b-frame, and
    the delay of the laser's ``clock``, s, where they are unknown."""

    lever: bool = False
    clock: bool = False

    @property
    def size(self) -> int:
        return self.kept + 3 * self.lever + self.clock

    @property
    def kept(self) -> int:
        """Boresight and offsets."""
        return super().size

    @property
    def lever_at(self) -> slice:
        """Where the lever arm is in ``x``."""
        return slice(self.kept, self.kept + 3 * self.lever)

    def clock_delay(self, x: np.ndarray) -> float:
        """s, by which the poses must be taken later."""
        return float(x[-1]) if self.clock else 0.0

    def pseudo_weight(self, range_offset_sigma: float) -> np.ndarray:
        """(size,) what is known of the unknowns before the flight."""
        weight = np.zeros(self.size)
        weight[3 : self.kept] = range_offset_sigma**-2.0
        weight[self.lever_at] = PRIOR_SIGMA**-2.0
        if self.clock:
            weight[-1] = CLOCK_SIGMA**-2.0
        return weight

    def kernel_arguments(self, x: np.ndarray) -> tuple:
        R, dR, lever, offsets, ring_column = super().kernel_arguments(x)
        if self.lever:
            lever = lever + x[self.lever_at]
        return R, dR, lever, offsets, ring_column


@dataclass(frozen=True)
class Clock:
    """``delay`` s by which poses must be taken later than the points' times say, its ``sigma``."""

    delay: float
    sigma: float


@dataclass(frozen=True)
class LeverArm:
    """``value`` (3,) m b-frame as adjusted, the ``correction`` (3,) to what was given, and
    ``sigma`` (3,) m; ``prior_sigma`` m before the flight."""

    value: np.ndarray
    correction: np.ndarray
    sigma: np.ndarray
    prior_sigma: float = PRIOR_SIGMA

    @classmethod
    def of(cls, mounting: Mounting, x: np.ndarray, covariance: np.ndarray) -> "LeverArm":
        """From its three of ``x`` and their ``covariance``."""
        return cls(np.asarray(mounting.lever_arm, float) + x, x, np.sqrt(np.diag(covariance)))

    @property
    def determined(self) -> np.ndarray:
        """(3,) bool: the flight, not the value given before it, decides."""
        return self.sigma <= DETERMINED * self.prior_sigma

    def __str__(self) -> str:
        return "lever arm: " + ", ".join(self._words(axis) for axis in range(3))

    def _words(self, axis: int) -> str:
        words = f"{AXES[axis]} {self.value[axis]:+.3f} m (sigma {self.sigma[axis]:.3f} m"
        if not self.determined[axis]:
            words += f"; not determined by this flight, given to {self.prior_sigma:.3f} m before it"
        return words + ")"
