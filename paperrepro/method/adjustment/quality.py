"""What an adjustment can find of its own gross errors: reliability after Baarda (1968).

The gross error looked for is a bias of one view: all its points moved along the plane's normal, as
a wrong match, a chimney, snow on the roof or a jump of the trajectory would move them. In scenario
D's conditions such a bias is minus the view's own plane distance, so its normal equations are rows
that exist already.

Variance components of scenario D, estimated from the data by restricted maximum likelihood.

Groups: range (all laser observations), position and attitude (their Gauss-Markov sigma), and the
correlation time. Each is a factor on the specification. Boresight, offsets and planes are
integrated out, so their number does not bias the components (Patterson and Thompson 1971; Koch
1999, section 3.6). A wide prior keeps a factor that the flight cannot see near the specification.

The Cramer-Rao bound: what no unbiased estimate from the same points can undercut.

Computed where the truth is known: at the true mounting, under the process that the trajectory's
error really follows, with nodes so close that nothing happens between them. White noise of the
poses is left out, so the true bound is a little higher and the comparison a little strict.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats
from scipy.optimize import minimize

from paperrepro.method.adjustment.trajectory_equations import (
    N_COMPONENTS,
    CellBlocks,
    Cells,
    GaussMarkov,
)
from paperrepro.method.adjustment.trajectory_solver import (
    DataNormals,
    State,
    Step,
    TrajectoryModel,
    eliminate,
    iterate,
    prior_chi2,
)
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Mounting, Survey

#: A bias counts as detectable where a test at this level finds it with this power (Baarda 1968).
LEVEL, POWER = 0.001, 0.80
#: Standardised bias that such a test detects, 4.13.
NON_CENTRALITY = float(stats.norm.ppf(1 - LEVEL / 2) + stats.norm.ppf(POWER))
#: Views whose biases are looked at together: bounds the memory of the right sides.
CHUNK = 64


@dataclass(frozen=True)
class Reliability:
    """Of each view, in the order of the matched faces: its ``strip`` and ``plane`` (F,);
    ``redundancy`` (F,) between 0 and 1, the share of its information on a bias that is left once
    all unknowns have taken theirs; ``detectable`` (F,) m, the minimal detectable bias; ``turns``
    (F, 3) rad, what an undetected bias of that size does to the boresight; ``bias`` (F,) m, the
    estimate, positive along the normal, and ``standardised`` (F,), the same in its own sigma (the
    statistic of data snooping)."""

    strip: tuple[str, ...]
    plane: np.ndarray
    redundancy: np.ndarray
    detectable: np.ndarray
    turns: np.ndarray
    bias: np.ndarray
    standardised: np.ndarray

    def of_planes(self) -> np.ndarray:
        """(G,) m: of each plane, the bias that can hide in the view where it hides best."""
        worst = np.zeros(int(self.plane.max()) + 1)
        np.maximum.at(worst, self.plane, self.detectable)
        return worst


def reliability(
    blocks: CellBlocks, cells: Cells, state: State, step: Step, strips: tuple[str, ...]
) -> Reliability:
    """`Reliability` of the views at the solution ``state``, from the ``step`` that ended there."""
    rows = _BiasRows.of(blocks, cells, state, len(strips))
    S_inverse = np.linalg.inv(step.S)
    hidden, turns = np.empty(len(strips)), np.empty((len(strips), 3))
    for first in range(0, len(strips), CHUNK):
        part = slice(first, min(first + CHUNK, len(strips)))
        c_t = rows.nodes(part, len(state.error))
        coupling = step.coupling.reshape(-1, len(step.S))
        right = rows.y[:, part] - coupling.T @ c_t.reshape(len(coupling), -1)
        dy = S_inverse @ right
        hidden[part] = np.einsum("kcf,kcf->f", c_t, step.factor.solve(c_t))
        hidden[part] += (right * dy).sum(axis=0)
        turns[part] = -dy[:3].T
    information = np.maximum(rows.own - hidden, 1e-12 * rows.own)
    detectable = NON_CENTRALITY / np.sqrt(information)
    return Reliability(
        strip=strips,
        plane=rows.plane,
        redundancy=information / rows.own,
        detectable=detectable,
        turns=turns * detectable[:, None],
        bias=rows.misclosure / information,
        standardised=rows.misclosure / np.sqrt(information),
    )


@dataclass(frozen=True)
class _BiasRows:
    """Rows of the normal equations of each view's bias: with itself, ``own`` (F,); with unknowns
    and planes, ``y`` (Y, F); with the nodes, by cell, ``t`` (C, 12). ``misclosure`` (F,) weighted,
    ``plane`` (F,), and the ``cells``."""

    own: np.ndarray
    y: np.ndarray
    t: np.ndarray
    misclosure: np.ndarray
    plane: np.ndarray
    cells: Cells

    @classmethod
    def of(cls, blocks: CellBlocks, cells: Cells, state: State, n_faces: int) -> "_BiasRows":
        u = len(state.x)
        before = -blocks.N[:, : u + 3, u + 2]  # a bias is minus the distance d, of this view alone
        after = -blocks.N[:, u + 2, u + 3 :]
        own, misclosure = np.zeros(n_faces), np.zeros(n_faces)
        np.add.at(own, cells.face, -before[:, u + 2])
        np.add.at(misclosure, cells.face, -blocks.t[:, u + 2])
        y = np.zeros((u + 3 * len(state.planes), n_faces))
        np.add.at(y, (slice(0, u), cells.face), before[:, :u].T)
        for k in range(3):
            np.add.at(y, (u + 3 * cells.plane + k, cells.face), before[:, u + k])
        plane = np.zeros(n_faces, int)
        plane[cells.face] = cells.plane
        return cls(own, y, after, misclosure, plane, cells)

    def nodes(self, part: slice, n_nodes: int) -> np.ndarray:
        """(K, 6, views of ``part``): rows with the nodes."""
        out = np.zeros((n_nodes, N_COMPONENTS, part.stop - part.start))
        chosen = np.flatnonzero((self.cells.face >= part.start) & (self.cells.face < part.stop))
        face, node = self.cells.face[chosen] - part.start, self.cells.node[chosen]
        for k in range(N_COMPONENTS):
            np.add.at(out, (node, k, face), self.t[chosen, k])
            np.add.at(out, (node + 1, k, face), self.t[chosen, N_COMPONENTS + k])
        return out


#: Standard deviation of the logarithm of each factor, before the data: a factor of three.
PRIOR_LOG_SIGMA = np.log(3.0)
#: No factor leaves a hundredth to a hundred times the specification.
WIDEST_LOG = np.log(100.0)
#: Rounds of estimating components and adjusting under them.
ROUNDS = 3


@dataclass(frozen=True)
class VarianceComponents:
    """Factors on the specified sigma of ``range`` (with the angles), ``position``, ``attitude``,
    and on the ``correlation_time``."""

    range: float = 1.0
    position: float = 1.0
    attitude: float = 1.0
    correlation_time: float = 1.0

    @classmethod
    def of(cls, theta: np.ndarray) -> "VarianceComponents":
        return cls(*(float(factor) for factor in np.exp(theta)))

    def theta(self) -> np.ndarray:
        """Logarithms of the factors, (4,)."""
        return np.log([self.range, self.position, self.attitude, self.correlation_time])

    def prior(self, specified: GaussMarkov) -> GaussMarkov:
        """The process with the factors applied."""
        factors = np.repeat([self.position, self.attitude], 3)
        return GaussMarkov(
            specified.sigma * factors, specified.correlation_time * self.correlation_time
        )

    def apply(self, model: TrajectoryModel) -> TrajectoryModel:
        """The model with the laser's variances scaled."""
        return replace(model, variances=model.variances * self.range**2)


def estimate(
    model: TrajectoryModel, specified: GaussMarkov, state: State
) -> tuple[VarianceComponents, State]:
    """Components, and the state adjusted under them. Raises as `trajectory_solver.iterate` does."""
    components = VarianceComponents()
    # every condition speaks of the range, few of the rest: in these steps all matter alike
    step = np.array([1 / np.sqrt(2 * len(model.tie_planes.rays)), 1.0, 1.0, 1.0])
    for _ in range(ROUNDS):
        solution = iterate(components.apply(model), components.prior(specified), state)
        state, data = solution.state, solution.data.scaled(components.range**2)
        found = minimize(
            lambda z, *rest: _objective(step * z, *rest),
            components.theta() / step,
            args=(data, model, specified, state),
            method="L-BFGS-B",
            bounds=[(-WIDEST_LOG / s, WIDEST_LOG / s) for s in step],
            options={"eps": 1e-3, "gtol": 0.05, "maxiter": 50},
        )
        change = np.abs(step * found.x - components.theta()).max()
        components = VarianceComponents.of(step * found.x)
        if change < 0.02:
            break
    return components, state


def _objective(
    theta: np.ndarray,
    data: DataNormals,
    model: TrajectoryModel,
    specified: GaussMarkov,
    state: State,
) -> float:
    """Minus twice the restricted log likelihood, at the linearisation point ``state``."""
    components = VarianceComponents.of(theta)
    prior, time = components.prior(specified), model.nodes.time
    scaled = data.scaled(components.range**-2)
    try:
        step = eliminate(scaled, prior, time, state, model.pseudo_weight)
    except np.linalg.LinAlgError:
        return np.inf
    quadratic = scaled.chi2 + prior_chi2(prior, time, state.error) - step.decrement
    quadratic += float(model.pseudo_weight @ np.square(state.x))
    log_det = step.factor.log_det + np.linalg.slogdet(step.S)[1] - prior.information(time)[2]
    n_conditions = len(model.tie_planes.rays)
    wide = np.square(theta / PRIOR_LOG_SIGMA).sum()
    return quadratic + log_det + 2 * n_conditions * theta[0] + wide


#: Seconds between nodes: half of scenario D's change the bound by less than 0.2 %.
SPACING = 0.05


@dataclass(frozen=True)
class TrueNoise:
    """What really disturbs a survey: the ``process`` of the trajectory's error and the spread
    ``range_offset_sigma`` m of the beams' offsets. The laser is as its scanner's specification."""

    process: GaussMarkov
    range_offset_sigma: float


def cramer_rao_bound(
    survey: Survey,
    tie_planes: TiePlanes,
    truth: Mounting,
    noise: TrueNoise,
    spacing: float = SPACING,
) -> np.ndarray:
    """Least covariance (3, 3) rad² of the boresight, given the points of ``tie_planes``.

    The range offsets' spread is prior knowledge here, as in the adjustment.
    """
    scanner = replace(survey.scanner, range_offset_sigma=max(noise.range_offset_sigma, 1e-6))
    model = TrajectoryModel.prepare(
        replace(survey, mounting=truth, scanner=scanner), tie_planes, "per_ring", spacing
    )
    x = model.unknowns.start()
    x[3:] = truth.offsets(scanner.n_rings)
    state = model.start(x)
    step = eliminate(
        model.normals(state), noise.process, model.nodes.time, state, model.pseudo_weight
    )
    return np.linalg.inv(step.S)[:3, :3]
