"""The adjustment of scenario D: errors of trajectory and surfaces as unknowns beside all others.

A pose's error is a constant of the mission plus Gauss-Markov processes; a view of a face lies off
its plane by an offset and two tilts. The sparse structure is used: windows of time are eliminated
each by itself (`trajectory_windows`); what remains, planes and the windows' ends, is dissected by
place (`block_cholesky`), so that time and memory grow as the flight does.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from paperrepro.errors import BadInput, NoConvergence
from paperrepro.method.adjustment.block_cholesky import BlockCholesky
from paperrepro.method.adjustment.conditions import (
    FINAL,
    MAX_ITERATIONS,
    TOLERANCE,
    Iterations,
    face_states,
    observation_variances,
)
from paperrepro.method.adjustment.trajectory_equations import (
    LEAST_SIGMA,
    N_COMPONENTS,
    OF_D,
    CellBlocks,
    Cells,
    GaussMarkov,
    Nodes,
    TrajectoryUnknowns,
    cell_blocks,
)
from paperrepro.method.adjustment.trajectory_windows import (
    NodePrior,
    Window,
    WindowNormals,
    WindowStep,
    dissection,
    eliminate_window,
    places_left,
    window_normals,
    windows,
)
from paperrepro.method.tie_planes import TiePlanes, require_spread
from paperrepro.survey import Survey

#: A surface called flat still gets this, m: it keeps the prior finite.
LEAST_SURFACE = 1e-5
#: A step that lowers the sum of squares by so little is a ten thousandth of a standard deviation
#: in any direction.
LEAST_DECREMENT = 1e-8
#: A process with less of the largest's sigma changes the boresight's by less than a hundredth.
NEGLIGIBLE = 0.1


@dataclass(frozen=True)
class Noise:
    """Prior of the random effects: ``processes``, whose sum each pose's error follows; sigma
    ``constant`` (6,) m and rad of what lasts the whole mission; ``surface`` m, of a view's offset
    and of what its two tilts are at one standard extent from its middle, RMS of all views, each in
    proportion to its `TiePlanes.unevenness`; ``roughness`` m, of the offset that a view's points of
    a moment share: tiles, grass, what one scan line meets."""

    processes: tuple[GaussMarkov, ...]
    constant: np.ndarray
    surface: float
    roughness: float = 0.0

    def reduced(self) -> "Noise":
        """Without processes that no component has more of than `NEGLIGIBLE` of the largest's
        sigma: a second process costs four times the work."""
        sigma = np.array([process.sigma for process in self.processes])
        kept = (sigma > NEGLIGIBLE * sigma.max(axis=0)).any(axis=1)
        return replace(self, processes=tuple(np.array(self.processes, object)[kept]))

    @property
    def constant_weight(self) -> np.ndarray:
        """(6,)."""
        return np.maximum(self.constant, LEAST_SIGMA) ** -2.0

    @property
    def surface_weight(self) -> float:
        """1 / m²."""
        return max(self.surface, LEAST_SURFACE) ** -2.0

    @property
    def roughness_weight(self) -> float:
        """1 / m²."""
        return max(self.roughness, LEAST_SURFACE) ** -2.0


@dataclass(frozen=True)
class TrajectoryModel:
    """The conditions of scenario D on given faces: ``origin`` (G, 3) and ``axes`` (G, 3, 2) of the
    planes, ``to_plane`` (F, 3, 3) from a view's offset and tilts to the unknowns of its plane;
    ``order`` of the ``windows`` in which what they leave is dissected."""

    tie_planes: TiePlanes
    unknowns: TrajectoryUnknowns
    nodes: Nodes
    cells: Cells
    windows: tuple[Window, ...]
    order: np.ndarray
    origin: np.ndarray
    axes: np.ndarray
    to_plane: np.ndarray
    variances: np.ndarray
    pseudo_weight: np.ndarray

    @classmethod
    def prepare(
        cls,
        survey: Survey,
        tie_planes: TiePlanes,
        range_offsets: str,
        spacing: float,
        lever_arm: bool = False,
        clock: bool = False,
        beam_sigma: float = 0.0,
    ) -> "TrajectoryModel":
        if tie_planes.rays.time is None:
            raise BadInput(
                "scenario D: expected rays with their times, got none; build them from strips"
            )
        unknowns = TrajectoryUnknowns.layout(survey.mounting, survey.scanner.n_rings, range_offsets)
        unknowns = replace(unknowns, lever=lever_arm, clock=clock, beam_sigma=beam_sigma)
        start = unknowns.start()
        states = face_states(tie_planes.rays, tie_planes.plane_ranges, unknowns, start)
        if survey.mounting.known_to is None:
            require_spread(states.plane[:, :3])
        nodes = Nodes.covering(tie_planes.rays.time, spacing)
        variances = observation_variances(survey.navigation, survey.scanner)
        variances[:N_COMPONENTS] = 0.0  # the error that these stand for is an unknown now
        cells = Cells.of(tie_planes, nodes, survey.trajectory.rate if clock else None)
        _, _, rows = np.linalg.svd(states.plane[:, None, :3])  # rows 1, 2 span what is square to n
        axes = rows[:, 1:].transpose(0, 2, 1)
        uneven = tie_planes.unevenness(survey.mounting, survey.scanner)
        to_plane = _to_plane(tie_planes, unknowns, start, states.centroid, axes, uneven)
        cut = windows(cells, nodes, tie_planes.plane, to_plane)
        return cls(
            tie_planes, unknowns, nodes, cells, cut, dissection(cut, states.centroid),
            states.centroid, axes, to_plane, variances,
            unknowns.pseudo_weight(survey.scanner.range_offset_sigma),
        )  # fmt: skip

    def start(self, x: np.ndarray, n_processes: int = 1) -> "State":
        """``x`` (u,), the planes fitted under it, and no error of the trajectory."""
        planes = face_states(
            self.tie_planes.rays, self.tie_planes.plane_ranges, self.unknowns, x
        ).plane
        planes[:, 3] -= np.einsum("ga,ga->g", planes[:, :3], self.origin)
        error = np.zeros((len(self.nodes.time), n_processes, N_COMPONENTS))
        return State(x, planes, error, np.zeros(6), np.zeros((len(self.tie_planes.ranges), 3)))

    def bases(self, planes: np.ndarray) -> np.ndarray:
        """(G, 4, 3): the directions in which planes (G, 4) can move at unit norm, two turns and d.
        They follow `axes`, so that a tilt means the same in every iteration."""
        return _bases(planes, self.axes)

    def view_planes(self, state: "State") -> np.ndarray:
        """(F, 4): the plane of each view, its surface error applied."""
        turns = np.einsum("fab,fb->fa", self.to_plane, state.surface)
        on = self.tie_planes.plane
        return _turned(state.planes[on], self.bases(state.planes)[on], turns)

    def blocks(self, state: "State", final_m: float = FINAL) -> CellBlocks:
        """Normal equations of the conditions at ``state``, cell by cell; ``final_m`` m as
        `kernels.adjust_observations` has it."""
        planes = self.view_planes(state)
        turns = _bases(planes, self.axes[self.tie_planes.plane])[:, :3, :2]
        return cell_blocks(
            self.cells, self.origin[self.tie_planes.plane], planes, turns, self.unknowns, state.x,
            state.correction, self.variances, final_m,
        )  # fmt: skip

    def normals(self, state: "State", noise: Noise) -> "DataNormals":
        """Normal equations of the conditions alone, at ``state``."""
        return self.assemble(self.blocks(state), noise)

    def assemble(self, blocks: CellBlocks, noise: Noise) -> "DataNormals":
        """Sum the cells' blocks into place, window by window."""
        rough, u = noise.roughness_weight, len(blocks.N_x[0])
        parts = (window_normals(w, blocks, self.cells, rough) for w in self.windows)
        total = blocks.N[:, OF_D, u + OF_D] + rough
        chi2 = blocks.chi2 - np.square(blocks.t[:, u + OF_D]) / total
        return DataNormals(tuple(parts), float(chi2.sum()), float(np.log(total / rough).sum()))

    def moved(self, state: "State", step: "Step", share: float = 1.0) -> "State":
        """``state`` after a ``share`` of the corrections of ``step``."""
        u, constant, dy = len(state.x), len(step.dy) - N_COMPONENTS, share * step.dy
        turns = dy[u:constant].reshape(-1, 3)
        return State(
            state.x + dy[:u], _turned(state.planes, self.bases(state.planes), turns),
            state.error + share * step.d_error, state.constant + dy[constant:],
            state.surface + share * step.d_surface,
        )  # fmt: skip


def _bases(planes: np.ndarray, axes: np.ndarray) -> np.ndarray:
    n, Z = planes[:, :3], np.zeros((len(planes), 4, 3))
    Z[:, :3, :2] = axes - n[:, :, None] * np.einsum("ga,gab->gb", n, axes)[:, None]
    Z[:, 3, 2] = 1.0
    return Z


def _turned(planes: np.ndarray, bases: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Planes (G, 4) after turns and shifts (G, 3)."""
    planes = planes + np.einsum("gab,gb->ga", bases, by)
    planes[:, :3] /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    return planes


def _to_plane(tie_planes, unknowns, x, origin, axes, uneven) -> np.ndarray:
    """An offset along the normal, and tilts about the view's middle in units of its extent, times
    how ``uneven`` (F,) the view is."""
    views = face_states(tie_planes.rays, tie_planes.ranges, unknowns, x)
    Z = axes[tie_planes.plane]
    middle = np.einsum("fab,fa->fb", Z, views.centroid - origin[tie_planes.plane])
    spread = np.einsum("fab,fac,fcb->f", Z, views.scatter, Z) / views.count
    extent = np.sqrt(np.maximum(spread / 2, 1e-6))
    T = np.zeros((len(middle), 3, 3))
    T[:, 2, 0] = 1.0
    T[:, 0, 1] = T[:, 1, 2] = 1 / extent
    T[:, 2, 1:] = middle / extent[:, None]
    return T * uneven[:, None, None]


@dataclass(frozen=True)
class State:
    """``x`` (u,), ``planes`` (G, 4) with d from their origins; of the poses, what must be added to
    the reported ones, m and rad: ``error`` (K, P, 6) of nodes and processes, ``constant`` (6,);
    ``surface`` (F, 3) m of the views."""

    x: np.ndarray
    planes: np.ndarray
    error: np.ndarray
    constant: np.ndarray
    surface: np.ndarray

    @property
    def correction(self) -> np.ndarray:
        """(K, 6), all parts together."""
        return self.error.sum(axis=1) + self.constant


@dataclass(frozen=True)
class DataNormals:
    """Normal equations of the conditions, by window; ``chi2``, and the logarithm of the determinant
    of what roughness adds to the conditions' noise."""

    windows: tuple[WindowNormals, ...]
    chi2: float
    log_det: float

    def scaled(self, factor: float) -> "DataNormals":
        """With all weights, those of roughness too, multiplied by ``factor``."""
        parts = tuple(part.scaled(factor) for part in self.windows)
        return DataNormals(parts, factor * self.chi2, self.log_det)


@dataclass(frozen=True)
class Step:
    """One elimination: corrections ``dz`` (T,) of x, planes, constants, then separators, of which
    the first ``size`` are y, and what leads back: ``factor`` of the matrix (T, T) that the windows
    leave; ``steps`` of the windows and ``where`` (r,) in T what each leaves is; ``shape`` (K, P, 6)
    of the errors; ``log_det`` of all; ``decrement``: by how much the step lowers the sum of
    squares."""

    dz: np.ndarray
    size: int
    factor: BlockCholesky
    windows: tuple[Window, ...]
    steps: tuple[WindowStep, ...]
    where: tuple[np.ndarray, ...]
    shape: tuple[int, ...]
    log_det: float
    decrement: float

    @property
    def dy(self) -> np.ndarray:
        """(Y,) of x, planes and constants."""
        return self.dz[: self.size]

    def columns(self, count: int) -> np.ndarray:
        """The first columns (T, count) of the inverse of what the windows leave."""
        return self.factor.solve(np.eye(len(self.dz), count))

    @cached_property
    def _blocks(self) -> list[np.ndarray]:
        """Of the inverse of what the windows leave, the part (r, r) of each."""
        return self.factor.inverse_blocks()

    def own(self, u: int) -> np.ndarray:
        """Covariance (u + 6, u + 6) of x (u,) and constants, which every window sees."""
        at = 2 * self.shape[1] * self.shape[2] + np.arange(u + N_COMPONENTS)
        return self._blocks[0][np.ix_(at, at)]

    def of_planes(self) -> np.ndarray:
        """Covariances (G, 3, 3) of each plane's unknowns, from a window that sees it."""
        out = np.empty((1 + max(w.planes[-1] for w in self.windows), 3, 3))
        for w, Q in zip(self.windows, self._blocks, strict=True):
            at = len(Q) - 3 * len(w.planes) + np.arange(3 * len(w.planes)).reshape(-1, 3)
            out[w.planes] = Q[at[:, :, None], at[:, None]]
        return out

    @cached_property
    def _moved(self) -> tuple[np.ndarray, np.ndarray]:
        K, b = self.shape[0], self.shape[1] * self.shape[2]
        d_error = np.empty((K, b))
        d_surface = np.empty((sum(len(w.faces) for w in self.windows), 3))
        for w, step, where in zip(self.windows, self.steps, self.where, strict=True):
            begin, end = w.nodes
            d_error[begin] = self.dz[where[:b]]
            d_error[begin + 1 : end], d_surface[w.faces] = step.back(self.dz[where])
        return d_error.reshape(self.shape), d_surface

    @property
    def d_error(self) -> np.ndarray:
        """(K, P, 6) corrections of the nodes' errors."""
        return self._moved[0]

    @property
    def d_surface(self) -> np.ndarray:
        """(F, 3) of the surface errors."""
        return self._moved[1]

    def squares(
        self, errors: np.ndarray, surfaces: np.ndarray, fixed: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Products (n, n) by the inverse of all normal equations of right sides at errors
        (K, P, 6, n), surface errors (F, 3, n), x and constants (u + 6, n); and the solution for
        x (u, n)."""
        n = fixed.shape[1]
        errors = errors.reshape(len(errors), -1, n)
        right, out = np.zeros((len(self.dz), n)), np.zeros((n, n))
        for w, step, where in zip(self.windows, self.steps, self.where, strict=True):
            of_window = surfaces[w.faces].reshape(-1, n)
            squares, left = step.squares(errors[slice(*w.nodes)], of_window)
            right[where] += left
            out += squares
        u = len(fixed) - N_COMPONENTS
        right[:u] += fixed[:u]
        right[self.size - N_COMPONENTS : self.size] += fixed[u:]
        solution = self.factor.solve(right)
        return out + right.T @ solution, solution[:u]

    def covariance(self, further: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Covariances (K, P, 6) of the errors with those of the process ``further`` on, at the same
        node; (K - 1, P, 6) at the next; and variances (F, 3) of the surface errors."""
        K, b = self.shape[0], self.shape[1] * self.shape[2]
        other = (np.arange(b) + further * N_COMPONENTS) % b
        variance, beside, surface = np.empty((K, b)), np.empty((K, b)), self.d_surface.copy()
        for w, step, Q in zip(self.windows, self.steps, self._blocks, strict=True):
            begin, end = w.nodes
            variance[begin] = Q[np.arange(b), other]
            variance[begin + 1 : end], beside[begin:end], surface[w.faces] = step.covariance(
                Q, other
            )
        return variance.reshape(self.shape), beside[:-1].reshape(-1, *self.shape[1:]), surface


def eliminate(data: DataNormals, model: TrajectoryModel, noise: Noise, state: State) -> Step:
    """Eliminate window by window, solve for what is left, and substitute back."""
    u, n_planes, b = len(state.x), len(state.planes), state.error[0].size
    Y = u + 3 * n_planes + N_COMPONENTS
    total = Y + b * (len(model.windows) + 1)
    parts, t = [], np.zeros(total)
    steps, log_det, decrement = [], data.log_det, 0.0
    priors = _node_priors(model, noise, state)
    places = places_left(model.windows, u, n_planes, b)
    for w, part, prior, where in zip(model.windows, data.windows, priors, places, strict=True):
        step = eliminate_window(w, part, prior)
        parts.append(step.S.copy())
        t[where] += step.t
        log_det += step.log_det
        decrement += step.decrement
        steps.append(step)
    last = np.arange(b, 2 * b)
    parts[-1][last, last] += 1.0  # after the last window none is
    _add_control(model, state, parts, places, t)
    own = np.r_[:u, Y - N_COMPONENTS : Y]
    weight = np.concatenate([model.pseudo_weight, noise.constant_weight])
    at = 2 * b + np.arange(len(own))
    parts[0][at, at] += weight
    t[own] += weight * np.concatenate([state.x, state.constant])
    factor = BlockCholesky.of(parts, places, total, model.order)
    log_det += factor.log_det
    dz = -factor.solve(t[:, None])[:, 0]
    return Step(
        dz, Y, factor, model.windows, tuple(steps), tuple(places), state.error.shape,
        log_det, decrement - float(t @ dz),
    )  # fmt: skip


def _control(model: TrajectoryModel, planes: np.ndarray) -> tuple[np.ndarray, ...]:
    """Planes (C,) through control points, by how much they miss these, (C,) m up, the derivatives
    (C, 3) by the planes' unknowns, and weights (C,) 1 / m²."""
    at = np.flatnonzero(model.tie_planes.controlled)
    if not len(at):
        return at, np.empty(0), np.empty((0, 3)), np.empty(0)
    *point, sigma = model.tie_planes.control[at].T
    step = np.transpose(point) - model.origin[at]
    n, bases = planes[at, :3], model.bases(planes)[at]
    up = n[:, 2]
    miss = (np.einsum("ca,ca->c", n, step) - planes[at, 3]) / up
    A = np.einsum("ca,cab->cb", step, bases[:, :3]) - bases[:, 3] - miss[:, None] * bases[:, 2]
    return at, miss, A / up[:, None], sigma**-2.0


def _add_control(
    model: TrajectoryModel, state: "State", parts: list, places: list, t: np.ndarray
) -> None:
    """Add to the first window that sees its plane that each control point lies on it."""
    first = {g: k for k, w in reversed([*enumerate(model.windows)]) for g in w.planes}
    for g, miss, a, weight in zip(*_control(model, state.planes), strict=True):
        own, seen = len(state.x) + 3 * g + np.arange(3), first[g]
        at = np.flatnonzero(places[seen] == own[0]) + np.arange(3)
        parts[seen][np.ix_(at, at)] += weight * np.outer(a, a)
        t[own] += weight * miss * a


def _node_priors(model: TrajectoryModel, noise: Noise, state: State) -> list[NodePrior]:
    time = model.nodes.time
    information = [process.information(time) for process in noise.processes]
    diagonal = np.concatenate([part[0] for part in information], axis=1)
    beside = np.concatenate([part[1] for part in information], axis=1)
    error = state.error.reshape(len(time), -1)
    gradient = diagonal * error
    gradient[:-1] += beside * error[1:]
    gradient[1:] += beside * error[:-1]
    beside = np.concatenate([beside, np.zeros_like(diagonal[:1])])
    surface = noise.surface_weight
    return [
        NodePrior(
            diagonal[begin:end], beside[begin : end - 1], beside[end - 1], gradient[begin:end],
            surface, surface * state.surface[w.faces],
        )
        for w in model.windows
        for begin, end in [w.nodes]
    ]  # fmt: skip


def prior_chi2(model: TrajectoryModel, noise: Noise, state: State) -> float:
    """Weighted squares of everything that has a prior."""
    total = float(model.pseudo_weight @ np.square(state.x))
    total += float(noise.constant_weight @ np.square(state.constant))
    total += noise.surface_weight * float(np.square(state.surface).sum())
    _, miss, _, weight = _control(model, state.planes)
    total += float(weight @ np.square(miss))
    for k, process in enumerate(noise.processes):
        diagonal, beside, _ = process.information(model.nodes.time)
        e = state.error[:, k]
        total += float((diagonal * e**2).sum() + 2 * (beside * e[1:] * e[:-1]).sum())
    return total


@dataclass(frozen=True)
class Solution:
    """``state`` after ``iterations``, the last ``step`` to it, and from where that was taken the
    normal equations, ``data``, made of ``blocks``."""

    state: State
    step: Step
    data: DataNormals
    blocks: CellBlocks
    iterations: int


def iterate(
    model: TrajectoryModel, noise: Noise, state: State, least: float = LEAST_DECREMENT
) -> Solution:
    """Gauss-Newton from ``state``, until a step is tiny or lowers the sum of squares by less than
    ``least``; half steps once they swing about the minimum. Raises `NoConvergence`."""
    iterations, share, before = Iterations(), 1.0, (np.inf, 0.0)
    done = False
    while not done:
        blocks = model.blocks(state, iterations.final_m)
        data = model.assemble(blocks, noise)
        step = eliminate(data, model, noise, state)
        if step.decrement > before[0] / 2 and (step.dz * before[1]).sum() < 0:
            share = 0.5
        state, before = model.moved(state, step, share), (step.decrement, step.dz)
        final = iterations.final_m == FINAL
        iterations.take(step.dy, step.d_error)
        if step.decrement < least:
            iterations.final_m = FINAL
        done = iterations.converged or (step.decrement < least and (final or least > 1e-6))
        if iterations.made >= MAX_ITERATIONS and not done:
            raise NoConvergence(
                f"scenario D: no convergence after {MAX_ITERATIONS} iterations, last correction "
                f"{iterations.change:.2e} (limit {TOLERANCE:.0e}); look for wrong matches"
            )
    return Solution(state, step, data, blocks, iterations.made)
