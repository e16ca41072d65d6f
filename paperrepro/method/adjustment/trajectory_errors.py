"""Scenario D: boresight, range offsets and planes together with the trajectory's error.

GNSS/INS errors last for seconds to minutes. An adjustment that takes each laser point's pose error
as independent averages over thousands of points what in truth is one error per fly-over, and its
sigma is too small by a factor of ten. Here the error is an unknown: a first-order Gauss-Markov
process estimated in the same Gauss-Helmert adjustment, as in the paper's Eq. (3)-(4) otherwise.
"""

import numpy as np

from paperrepro.method.adjustment.conditions import face_states
from paperrepro.method.adjustment.observability import Observability, require_determined
from paperrepro.method.adjustment.quality import VarianceComponents, estimate, reliability
from paperrepro.method.adjustment.result import CalibrationResult, TrajectoryErrors
from paperrepro.method.adjustment.scenarios import calibrate
from paperrepro.method.adjustment.trajectory_equations import (
    GaussMarkov,
    LeverArm,
    LeverArmUnknowns,
)
from paperrepro.method.adjustment.trajectory_solver import (
    Solution,
    State,
    Step,
    TrajectoryModel,
    eliminate,
    iterate,
    prior_chi2,
)
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Navigation, Survey

#: Seconds between nodes. Between nodes a second apart an APX-15's heading wanders by 0.01 deg,
#: which thousands of points see. At full density, 15 000 points in such a time, nodes 0.25 s apart
#: move the yaw by a sigma and promise 5 % too little; from 0.1 s on neither changes any more.
NODE_SPACING = 0.1
#: Points a face, and seconds between nodes, that show what a flight determines.
WITNESSES, WITNESS_SPACING = 200, 0.5


def specified_process(navigation: Navigation) -> GaussMarkov:
    """The Gauss-Markov process that a GNSS/INS specification describes."""
    sigma = np.concatenate([navigation.position_sigma, navigation.attitude_sigma])
    return GaussMarkov(sigma, np.full(6, navigation.correlation_time))


def calibrate_with_trajectory(
    survey: Survey,
    tie_planes: TiePlanes,
    range_offsets: str = "per_ring",
    components: bool = False,
    spacing: float = NODE_SPACING,
    near: np.ndarray | None = None,
    lever_arm: bool = False,
) -> CalibrationResult:
    """Scenario D, from ``near`` (3,) rad as start, or else from where SL ends.

    A start degrees away would be taken for an error of the trajectory.

    The prior is ``survey.navigation``'s specification; with ``components`` its sigma, the laser's
    and the correlation time are estimated from the data. ``lever_arm``: it is an unknown too, with
    what was given for it as prior (`lever_arm.PRIOR_SIGMA`). The covariance is that of the stated
    (or estimated) noise, not scaled by sigma0. Raises `BadInput`, `RankDefect`, `NoConvergence`.
    """
    model = TrajectoryModel.prepare(survey, tie_planes, range_offsets, spacing, lever_arm)
    prior, factors = specified_process(survey.navigation), None
    start = model.unknowns.start()
    if near is None:
        near = calibrate(survey, tie_planes, "SL").boresight
    state = model.start(np.r_[near, start[3:]])
    if components:
        factors, state = estimate(model, prior, state)
        model, prior = factors.apply(model), factors.prior(prior)
    solution = iterate(model, prior, state)
    return _result(model, prior, start, solution, factors)


def lasting_sigma(survey: Survey, tie_planes: TiePlanes, boresight: np.ndarray) -> np.ndarray:
    """Standard deviations (3,) rad of ``boresight`` under errors of the trajectory that last as
    specified, as an adjustment that knows of them would have: from `WITNESSES` points a face."""
    few = tie_planes.thinned(WITNESSES)
    model = TrajectoryModel.prepare(survey, few, "per_ring", WITNESS_SPACING)
    state = model.start(np.r_[boresight, np.zeros(model.unknowns.size - 3)])
    prior = specified_process(survey.navigation)
    step = eliminate(model.normals(state), prior, model.nodes.time, state, model.pseudo_weight)
    return np.sqrt(np.diag(np.linalg.inv(step.S))[:3])


def _result(
    model: TrajectoryModel,
    prior: GaussMarkov,
    start: np.ndarray,
    solution: Solution,
    factors: VarianceComponents | None,
) -> CalibrationResult:
    state, step = solution.state, solution.step
    tie_planes, unknowns = model.tie_planes, model.unknowns
    lever, u = isinstance(unknowns, LeverArmUnknowns), len(state.x)
    kept = u - 3 if lever else u
    observability = _observability(step.S, kept, model.pseudo_weight)
    require_determined(observability)
    Q = np.linalg.inv(step.S)
    observability = observability.under(np.sqrt(np.diag(Q)[:3]), prior.sigma[3:])
    planes, Q_planes = _planes_in_map(model, state, Q)
    chi2 = solution.data.chi2 + prior_chi2(prior, model.nodes.time, state.error)
    chi2 += float(model.pseudo_weight @ np.square(state.x))
    dof = len(tie_planes.rays) + np.count_nonzero(model.pseudo_weight) - len(Q)
    after = face_states(tie_planes.rays, tie_planes.plane_ranges, unknowns, state.x)
    return CalibrationResult(
        scenario="D",
        mounting=unknowns.mounting,
        boresight=state.x[:3],
        range_offsets=unknowns.offsets(state.x) if kept > 3 else None,
        covariance=Q[:kept, :kept],
        planes=planes,
        covariance_planes=Q_planes,
        sigma0=float(np.sqrt(chi2 / dof)),
        dof=dof,
        iterations=solution.iterations,
        n_points=len(tie_planes.rays),
        n_conditions=len(tie_planes.rays),
        rms_before=face_states(tie_planes.rays, tie_planes.plane_ranges, unknowns, start).rms,
        rms_after=after.rms,
        points_per_plane=after.count,
        observability=observability,
        trajectory=_errors(model, state, step, Q),
        components=None if factors is None else vars(factors).copy(),
        lever_arm=LeverArm.of(unknowns.mounting, state.x, Q[:u, :u]) if lever else None,
        reliability=reliability(solution.blocks, model.cells, state, step, tie_planes.strips),
    )


def _observability(S: np.ndarray, kept: int, pseudo: np.ndarray) -> Observability:
    """Of boresight and offsets, the first ``kept`` unknowns; lever arm, planes and trajectory
    being free; pseudo-observations of the offsets apart."""
    rest = S[kept:, kept:]
    S_x = S[:kept, :kept] - S[:kept, kept:] @ np.linalg.solve(rest, S[kept:, :kept])
    S_x -= np.diag(pseudo[:kept])
    return Observability.of((S_x + S_x.T) / 2, pseudo[:kept])


def _planes_in_map(model: TrajectoryModel, state: State, Q: np.ndarray):
    """Planes (G, 4) with d from the m-frame's origin, and their covariances (G, 4, 4)."""
    u, n_planes = len(state.x), len(state.planes)
    own = u + 3 * np.arange(n_planes)[:, None] + np.arange(3)
    to_map = np.tile(np.eye(4), (n_planes, 1, 1))
    to_map[:, 3, :3] = model.origin
    J = to_map @ state.bases()
    planes = np.einsum("gab,gb->ga", to_map, state.planes)
    return planes, J @ Q[own[:, :, None], own[:, None, :]] @ J.transpose(0, 2, 1)


def _errors(model: TrajectoryModel, state: State, step: Step, Q: np.ndarray) -> TrajectoryErrors:
    given_rest = np.einsum("kcc->kc", step.factor.inverse_diagonal())
    through_rest = np.einsum("kcy,kcy->kc", step.coupling @ Q, step.coupling)
    return TrajectoryErrors(model.nodes.time, state.error, np.sqrt(given_rest + through_rest))
