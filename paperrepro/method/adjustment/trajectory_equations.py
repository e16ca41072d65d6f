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

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np

from paperrepro._compiled import over_threads, turned
from paperrepro.frames import BODY_AXES
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
    """``sigma`` (6,) m and rad of each component, ``correlation_time`` (6,) s; a ``profile`` as
    `survey.Navigation` has it, or None where sigma stays the same."""

    sigma: np.ndarray
    correlation_time: np.ndarray
    profile: tuple[np.ndarray, np.ndarray] | None = None

    def factor(self, time: np.ndarray) -> np.ndarray:
        """(K, 6) on sigma at ``time`` (K,) s."""
        if self.profile is None:
            return np.ones((len(time), N_COMPONENTS))
        known, factors = self.profile
        return np.column_stack([np.interp(time, known, column) for column in factors.T])

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
        log_det = -np.log(variance).sum() - np.log(gained).sum()
        if self.profile is None:
            return diagonal, -kept / gained, float(log_det)
        factor = self.factor(time)
        beside = -kept / gained / (factor[1:] * factor[:-1])
        return diagonal / factor**2, beside, float(log_det - 2 * np.log(factor).sum())


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
OF_D = 2  # of a plane's three unknowns, its distance
N_NODES = 12  # two nodes of six components
#: Of the nine observations, those that a beam may have an error of its own in: range, elevation,
#: azimuth.
OF_BEAM = (6, 8, 7)
#: A moment, s: a turn of most scanners, so that a cell holds one scan line of each beam. What the
#: points of a moment share of a face's roughness is independent of how far the nodes are apart.
MOMENT = 0.1
#: A row of A without beams, lever arm, clock. Loops of a length that is known are twice as fast.
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
    def of(
        cls, tie_planes: TiePlanes, nodes: Nodes,
        rate: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> "Cells":  # fmt: skip
        """``rate`` gives that of the pose at times (N,)."""
        order, share, first, face, node = _by_cell(tie_planes, nodes)
        return cls(
            order, PreparedRays.of(tie_planes.rays.take(order)), share,
            np.empty((0, 6)) if rate is None else rate(tie_planes.rays.time)[order],
            np.column_stack([first, np.r_[first[1:], len(order)]]).astype(np.int64),
            tie_planes.plane[face], face, node,
        )  # fmt: skip


def _by_cell(tie_planes: TiePlanes, nodes: Nodes) -> tuple[np.ndarray, ...]:
    """``order`` and ``share`` (N,) as `Cells` have them; (C,) where cells begin, their faces, their
    nodes."""
    face = np.repeat(np.arange(len(tie_planes.ranges)), np.diff(tie_planes.ranges, axis=1)[:, 0])
    node, share = nodes.locate(tie_planes.rays.time)
    moment = np.floor((tie_planes.rays.time - nodes.time[0]) / MOMENT).astype(int)
    key = (face * len(nodes.time) + node) * (moment.max() + 1) + moment
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.r_[True, np.diff(key[order]) > 0])
    return order, share[order], first, face[order[first]], node[order[first]]


@dataclass(frozen=True)
class CellBlocks:
    """``t`` (C, u + 15): unknowns, plane, node before, node after; ``chi2`` (C,) weighted squared
    residuals; ``N dx + t = 0`` at the solution step. Of N the rows ``N`` (C, 15, u + 15) of plane
    and nodes, upper triangle alone, and the block ``N_x`` (F, u, u) of the unknowns, upper triangle
    alone, summed over the cells of a face: a scanner of many beams has hundreds of unknowns."""

    N: np.ndarray
    N_x: np.ndarray
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
    size, n_cells, n_faces = unknowns.size + N_PLANE + N_NODES, len(cells.ranges), len(planes)
    N, t = np.zeros((n_cells, N_PLANE + N_NODES, size)), np.zeros((n_cells, size))
    N_x, chi2 = np.zeros((n_faces, unknowns.size, unknowns.size)), np.zeros(n_cells)
    of_face = np.searchsorted(cells.face, np.arange(n_faces + 1))
    R_l_b, dR_l_b, *mounted = unknowns.kernel_arguments(x)
    over_threads(
        _cell_blocks, n_faces, *cells.sight.columns(), cells.share, cells.rate, of_face,
        cells.ranges, cells.node, origin, planes, turns, error,
        R_l_b, axes(R_l_b, dR_l_b), *mounted[:-1], unknowns.beam_columns, unknowns.beam_errors(x),
        variances, final_m, 3 * unknowns.lever, unknowns.clock_delay(x), N, N_x, t, chi2, least=1,
    )  # fmt: skip
    return CellBlocks(N, N_x, t, chi2)


@numba.njit(cache=True, nogil=True)
def _cell_blocks(
    first, last, position, turns, rho, ring, share, rate, of_face, ranges, node, origin, planes,
    plane_turns, error, R_l_b, turn_axes, lever, offsets, beam_columns, beams, variances, final_m,
    n_lever, delay, N, N_x, t, chi2,
):  # fmt: skip
    """Fill ``N``, ``N_x``, ``t`` and ``chi2`` of faces ``first`` to ``last``, whose cells begin at
    ``of_face``."""
    timed = len(rate) > 0
    size = N_ROW + n_lever + timed
    v, b, seen, e, row = np.empty(9), np.empty(9), np.empty(8), np.empty(6), np.empty(size)
    n_rings, n_of_ring = beam_columns.shape
    sums, of_ring = np.empty((size, size + 1)), np.empty((n_rings, n_of_ring, size + n_of_ring + 1))
    per_ring, n_x = beam_columns.max() >= 0, t.shape[1] - N_PLANE - N_NODES
    where = np.arange(size)  # plane and nodes follow the unknowns, the last: lever arm, clock
    for k in range(N_ANGLES, size):
        where[k] += n_x - (N_ANGLES if k < N_ROW else size)
    for c in range(of_face[first], of_face[last]):
        f = np.searchsorted(of_face, c, side="right") - 1
        before, after = error[node[c]], error[node[c] + 1]
        plane, near = planes[f], origin[f]
        sums[:], of_ring[:] = 0.0, 0.0
        for i in range(ranges[c, 0], ranges[c, 1]):
            for m in range(6):
                e[m] = (1 - share[i]) * before[m] + share[i] * after[m]
                if timed:
                    e[m] += delay * rate[i, m]
            there, then = ray(position, turns, i)
            there, then = moved(there, then, e)
            if len(beams) > 0:
                then = _with_beam(then, beams[ring[i]])
            w, s = adjust_observations(
                there, then, rho[i], plane, near, R_l_b, turn_axes, lever, offsets[ring[i]],
                variances, final_m, v, b, seen,
            )  # fmt: skip
            _fill_row(seen, b, share[i], plane_turns[f], row)
            if n_lever > 0:
                _fill_lever(plane, then, row)
            if timed:
                row[size - 1] = 0.0
                for m in range(6):
                    row[size - 1] += b[m] * rate[i, m]
            _add_products(row, w, 1.0 / s, sums)
            if per_ring:
                _add_beam(row, b, w, 1.0 / s, of_ring[ring[i]])
            chi2[c] += w * w / s
        _add_sums(sums, of_ring, where, beam_columns, N[c], N_x[f], t[c])


@numba.njit(cache=True)
def _with_beam(turns, by):
    """Turns of a ray whose elevation and azimuth are off ``by`` (2,) rad."""
    sa, ca = turned(turns[6], turns[7], by[1])
    sb, cb = turned(turns[8], turns[9], by[0])
    return turns[0], turns[1], turns[2], turns[3], turns[4], turns[5], sa, ca, sb, cb


@numba.njit(cache=True)
def _fill_row(seen, b, share, plane_turns, row):
    """A row of A without the beam's errors: three angles, two turns of the plane and d, six of each
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
def _add_beam(row, b, w, weight, sums):
    """Add a condition's products with its derivatives by the n errors of its beam to the beam's
    ``sums`` (n, r + n + 1): with ``row``, with each other and, last, with w."""
    size, n = len(row), len(sums)
    for j in range(n):
        scaled = weight * b[OF_BEAM[j]]
        for k in range(size):
            sums[j, k] += scaled * row[k]
        for k in range(n):
            sums[j, size + k] += scaled * b[OF_BEAM[k]]
        sums[j, size + n] += scaled * w


@numba.njit(cache=True)
def _add_sums(sums, of_ring, where, beam_columns, N, N_x, t):
    """Add the sums to N and N_x (upper triangles) and t: ``where`` (r,) an entry of a row is there,
    and ``beam_columns`` (rings, n) the errors of a beam, -1 where they are held."""
    size, n, n_x = len(sums), beam_columns.shape[1], len(N_x)
    for k in range(size):
        for m in range(k, size):
            _add(N, N_x, n_x, where[k], where[m], sums[k, m])
        t[where[k]] += sums[k, size]
    for r in range(len(beam_columns)):
        for j in range(n):
            column = beam_columns[r, j]
            if column < 0:
                continue
            for k in range(size):
                _add(N, N_x, n_x, column, where[k], of_ring[r, j, k])
            for k in range(n):
                if beam_columns[r, k] >= column:
                    N_x[column, beam_columns[r, k]] += of_ring[r, j, size + k]
            t[column] += of_ring[r, j, size + n]


@numba.njit(cache=True)
def _add(N, N_x, n_x, k, m, value):
    """Add to the entry (k, m) of normal equations as `CellBlocks` keeps them."""
    low, high = min(k, m), max(k, m)
    if high < n_x:
        N_x[low, high] += value
    elif low < n_x:
        N[high - n_x, low] += value
    else:
        N[low - n_x, high] += value


#: How well a lever arm is known before the flight, m: measured by tape between housings.
PRIOR_SIGMA = 0.05
#: Clocks of laser and GNSS/INS agree to this before the flight, s: some are off by a record.
CLOCK_SIGMA = 0.01
#: An axis counts as determined where the flight leaves no more than this share of the prior sigma.
DETERMINED = 0.5


@dataclass(frozen=True)
class TrajectoryUnknowns(Unknowns):
    """`Unknowns` with more at the end of ``x``, where they are unknown: errors of all beams'
    elevations, then azimuths, rad, of standard deviation ``beam_sigma``; corrections of the
    ``lever`` arm, m, b-frame; the delay of the laser's ``clock``, s."""

    lever: bool = False
    clock: bool = False
    beam_sigma: float = 0.0

    @property
    def size(self) -> int:
        return self.kept + self._n_beams + 3 * self.lever + self.clock

    @property
    def _n_beams(self) -> int:
        return 2 * self.n_rings if self.beam_sigma else 0

    @property
    def beams_at(self) -> slice:
        """Where the beams' errors are in ``x``."""
        return slice(self.kept, self.kept + self._n_beams)

    def beam_errors(self, x: np.ndarray) -> np.ndarray:
        """(rings, 2) rad, of elevation and azimuth, or (0, 2) where they are held."""
        return np.ascontiguousarray(x[self.beams_at].reshape(2, -1).T)

    @property
    def beam_columns(self) -> np.ndarray:
        """(rings, n) where in ``x`` what `OF_BEAM` names is, -1 where it is held."""
        if not self.beam_sigma:
            return self.ring_column[:, None]
        elevation = self.kept + np.arange(self.n_rings)
        return np.column_stack([self.ring_column, elevation, elevation + self.n_rings])

    @property
    def kept(self) -> int:
        """Boresight and offsets."""
        return super().size

    @property
    def lever_at(self) -> slice:
        """Where the lever arm is in ``x``."""
        first = self.kept + self._n_beams
        return slice(first, first + 3 * self.lever)

    def clock_delay(self, x: np.ndarray) -> float:
        """s, by which the poses must be taken later."""
        return float(x[-1]) if self.clock else 0.0

    def pseudo_weight(self, range_offset_sigma: float) -> np.ndarray:
        """(size,) what is known of the unknowns before the flight."""
        weight = np.zeros(self.size)
        weight[:3] = self.mounting.boresight_weight
        weight[3 : self.kept] = range_offset_sigma**-2.0
        weight[self.lever_at] = PRIOR_SIGMA**-2.0
        weight[self.beams_at] = self.beam_sigma**-2.0 if self.beam_sigma else 0.0
        if self.clock:
            weight[-1] = CLOCK_SIGMA**-2.0
        return weight

    def kernel_arguments(self, x: np.ndarray) -> tuple:
        R, dR, lever, offsets, ring_column = super().kernel_arguments(x)
        if self.lever:
            lever = lever + x[self.lever_at]
        return R, dR, lever, offsets, ring_column


@dataclass(frozen=True)
class Beams:
    """``errors`` (rings, 2) rad of the beams' elevations in the table and of their azimuths as
    recorded, to be added to them, and their ``sigma`` (rings, 2)."""

    errors: np.ndarray
    sigma: np.ndarray

    @property
    def rms(self) -> float:
        """rad, of all."""
        return float(np.sqrt(np.square(self.errors).mean()))


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
        words = f"{BODY_AXES[axis]} {self.value[axis]:+.3f} m (sigma {self.sigma[axis]:.3f} m"
        if not self.determined[axis]:
            words += f"; not determined by this flight, given to {self.prior_sigma:.3f} m before it"
        return words + ")"
