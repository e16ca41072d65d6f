"""The adjustment of scenario D: the error of the trajectory as an unknown beside all others.

The sparse structure is used: the nodes of the error are eliminated first, in time proportional to
the flight (`block_tridiagonal`); what remains is dense in boresight, offsets and planes.
"""

from dataclasses import dataclass

import numpy as np

from paperrepro.errors import BadInput, NoConvergence
from paperrepro.method.adjustment.conditions import (
    MAX_ITERATIONS,
    SETTLED,
    TOLERANCE,
    Iterations,
    Unknowns,
    face_states,
    observation_variances,
)
from paperrepro.method.adjustment.trajectory_equations import (
    N_COMPONENTS,
    PRIOR_SIGMA,
    CellBlocks,
    Cells,
    Factor,
    GaussMarkov,
    LeverArmUnknowns,
    Nodes,
    add_cells,
    cell_blocks,
    factorise,
)
from paperrepro.method.tie_planes import TiePlanes, require_spread
from paperrepro.survey import Survey


@dataclass(frozen=True)
class TrajectoryModel:
    """The conditions of scenario D on given faces."""

    tie_planes: TiePlanes
    unknowns: Unknowns
    nodes: Nodes
    cells: Cells
    origin: np.ndarray
    variances: np.ndarray
    pseudo_weight: np.ndarray
    weight: np.ndarray

    @classmethod
    def prepare(
        cls,
        survey: Survey,
        tie_planes: TiePlanes,
        range_offsets: str,
        spacing: float,
        lever_arm: bool = False,
    ) -> "TrajectoryModel":
        if tie_planes.rays.time is None:
            raise BadInput(
                "scenario D: expected rays with their times, got none; build them from strips"
            )
        layout = LeverArmUnknowns.layout if lever_arm else Unknowns.layout
        unknowns = layout(survey.mounting, survey.scanner.n_rings, range_offsets)
        states = face_states(tie_planes.rays, tie_planes.plane_ranges, unknowns, unknowns.start())
        require_spread(states.plane[:, :3])
        nodes = Nodes.covering(tie_planes.rays.time, spacing)
        variances = observation_variances(survey.navigation, survey.scanner)
        variances[:N_COMPONENTS] = 0.0  # the error that these stand for is an unknown now
        pseudo = np.zeros(unknowns.size)
        pseudo[3:] = survey.scanner.range_offset_sigma**-2.0
        if lever_arm:
            pseudo[-3:] = PRIOR_SIGMA**-2.0
        weight = np.ones(len(tie_planes.ranges))
        cells = Cells.of(tie_planes, nodes)
        return cls(tie_planes, unknowns, nodes, cells, states.centroid, variances, pseudo, weight)

    def start(self, x: np.ndarray) -> "State":
        """``x`` (u,), the planes fitted under it, and no error of the trajectory."""
        planes = face_states(
            self.tie_planes.rays, self.tie_planes.plane_ranges, self.unknowns, x
        ).plane
        planes[:, 3] -= np.einsum("ga,ga->g", planes[:, :3], self.origin)
        return State(x, planes, np.zeros((len(self.nodes.time), N_COMPONENTS)))

    def blocks(self, state: "State", settled: float = SETTLED) -> CellBlocks:
        """Normal equations of the conditions at ``state``, cell by cell; ``settled`` m as
        `sightlines.settle` has it."""
        return cell_blocks(
            self.cells, self.origin, state.planes, state.bases()[:, :3, :2], self.unknowns, state.x,
            state.error, self.variances, self.weight, settled,
        )  # fmt: skip

    def normals(self, state: "State") -> "DataNormals":
        """Normal equations of the conditions alone, at ``state``."""
        return assemble(self.blocks(state), self.cells, state)


@dataclass(frozen=True)
class State:
    """``x`` (u,), ``planes`` (G, 4) with d from their origins, ``error`` (K, 6) of the nodes: what
    must be added to the reported poses, m and rad."""

    x: np.ndarray
    planes: np.ndarray
    error: np.ndarray

    def bases(self) -> np.ndarray:
        """(G, 4, 3): the directions in which a plane can move at unit norm, two turns and d."""
        n = self.planes[:, :3]
        _, _, rows = np.linalg.svd(n[:, None, :])  # rows 1, 2 span what is square to n
        Z = np.zeros((len(n), 4, 3))
        Z[:, :3, :2] = rows[:, 1:].transpose(0, 2, 1)
        Z[:, 3, 2] = 1.0
        return Z

    def moved(self, dy: np.ndarray, d_error: np.ndarray) -> "State":
        """After corrections ``dy`` (u + 3 G,) and ``d_error`` (K, 6)."""
        size = len(self.x)
        planes = self.planes + np.einsum("gab,gb->ga", self.bases(), dy[size:].reshape(-1, 3))
        planes[:, :3] /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
        return State(self.x + dy[:size], planes, self.error + d_error)


@dataclass(frozen=True)
class DataNormals:
    """Normal equations of the conditions: ``y`` is the unknowns and three of each plane.

    ``N_yy`` (Y, Y), ``t_y`` (Y,); ``N_ty`` (K, 6, Y), ``t_t`` (K, 6); diagonal blocks ``D``
    (K, 6, 6) and those above them ``E`` (K - 1, 6, 6) of the nodes; ``chi2``.
    """

    N_yy: np.ndarray
    t_y: np.ndarray
    N_ty: np.ndarray
    t_t: np.ndarray
    D: np.ndarray
    E: np.ndarray
    chi2: float

    def scaled(self, factor: float) -> "DataNormals":
        """With all weights multiplied by ``factor``."""
        return DataNormals(*(factor * part for part in vars(self).values()))


def assemble(blocks: CellBlocks, cells: Cells, state: State) -> DataNormals:
    """Sum the cells' blocks into place."""
    size, n_nodes = len(state.x) + 3 * len(state.planes), len(state.error)
    N_yy, t_y = np.zeros((size, size)), np.zeros(size)
    N_ty, t_t = np.zeros((n_nodes, N_COMPONENTS, size)), np.zeros((n_nodes, N_COMPONENTS))
    D, E = np.zeros((n_nodes, 6, 6)), np.zeros((n_nodes - 1, 6, 6))
    add_cells(blocks.N, blocks.t, cells.plane, cells.node, N_yy, t_y, N_ty, t_t, D, E)
    N_yy += np.triu(N_yy, 1).T
    D += np.triu(D, 1).transpose(0, 2, 1)
    return DataNormals(N_yy, t_y, N_ty, t_t, D, E, float(blocks.chi2.sum()))


@dataclass(frozen=True)
class Step:
    """One elimination: corrections, the Schur complement ``S`` (Y, Y) of ``y``, the nodes' factor,
    their ``coupling`` (K, 6, Y) ``N_tt^-1 N_ty``, and by how much the step lowers the sum of
    squares, ``decrement``."""

    dy: np.ndarray
    d_error: np.ndarray
    S: np.ndarray
    factor: Factor
    coupling: np.ndarray
    decrement: float


def eliminate(
    data: DataNormals, prior: GaussMarkov, time: np.ndarray, state: State, pseudo: np.ndarray
) -> Step:
    """Eliminate the nodes, solve for boresight, offsets and planes, and substitute back."""
    diagonal, beside, _ = prior.information(time)
    D, E = data.D.copy(), data.E.copy()
    place = np.arange(N_COMPONENTS)
    D[:, place, place] += diagonal
    E[:, place, place] += beside
    t_t = data.t_t + diagonal * state.error
    t_t[:-1] += beside * state.error[1:]
    t_t[1:] += beside * state.error[:-1]
    factor = factorise(D, E)
    solved = factor.solve(np.concatenate([data.N_ty, t_t[:, :, None]], axis=2))
    coupling, alone = solved[:, :, :-1], solved[:, :, -1]
    u, N_ty = len(state.x), data.N_ty.reshape(t_t.size, -1)
    S = data.N_yy - N_ty.T @ coupling.reshape(N_ty.shape)
    t_y = data.t_y.copy()
    t_y[:u] += pseudo * state.x
    t = t_y - N_ty.T @ alone.ravel()
    S[np.arange(u), np.arange(u)] += pseudo
    S = (S + S.T) / 2
    scale = 1 / np.sqrt(np.diag(S))
    dy = -scale * np.linalg.solve(S * np.outer(scale, scale), scale * t)
    d_error = -alone - coupling @ dy
    decrement = -float(t_y @ dy + (t_t * d_error).sum())
    return Step(dy, d_error, S, factor, coupling, decrement)


def prior_chi2(prior: GaussMarkov, time: np.ndarray, error: np.ndarray) -> float:
    """``e' Lambda e`` of node errors (K, 6)."""
    diagonal, beside, _ = prior.information(time)
    return float((diagonal * error**2).sum() + 2 * (beside * error[1:] * error[:-1]).sum())


@dataclass(frozen=True)
class Solution:
    """``state`` after ``iterations``, the last ``step`` to it, and from where that was taken the
    normal equations, ``data``, with their ``blocks``."""

    state: State
    step: Step
    data: DataNormals
    blocks: CellBlocks
    iterations: int


def iterate(model: TrajectoryModel, prior: GaussMarkov, state: State) -> Solution:
    """Gauss-Newton from ``state``; raises `NoConvergence`."""
    iterations = Iterations()
    while not iterations.converged:
        blocks = model.blocks(state, iterations.settled)
        data = assemble(blocks, model.cells, state)
        step = eliminate(data, prior, model.nodes.time, state, model.pseudo_weight)
        state = state.moved(step.dy, step.d_error)
        iterations.take(step.dy, step.d_error)
        if iterations.too_many:
            raise NoConvergence(
                f"scenario D: no convergence after {MAX_ITERATIONS} iterations, last correction "
                f"{iterations.change:.2e} (limit {TOLERANCE:.0e}); look for wrong matches"
            )
    return Solution(state, step, data, blocks, iterations.made)
