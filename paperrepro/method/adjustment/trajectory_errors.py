"""Scenario D: boresight, range offsets and planes together with the trajectory's error.

GNSS/INS errors last for seconds to minutes. An adjustment that takes each laser point's pose error
as independent averages over thousands of points what in truth is one error per fly-over, and its
sigma is too small by up to the root of their number. Here the error is an unknown: a first-order
Gauss-Markov process estimated in the same Gauss-Helmert adjustment, as in the paper's Eq. (3)-(4)
otherwise.
"""

from dataclasses import dataclass, replace

import numpy as np

from paperrepro._compiled import one_blas_thread
from paperrepro.method.adjustment.bending import without_bends
from paperrepro.method.adjustment.conditions import face_states
from paperrepro.method.adjustment.observability import Observability, require_determined
from paperrepro.method.adjustment.quality import reliability
from paperrepro.method.adjustment.result import CalibrationResult, TrajectoryErrors
from paperrepro.method.adjustment.scenarios import calibrate
from paperrepro.method.adjustment.trajectory_components import (
    OF_LASER,
    Estimate,
    VarianceComponents,
    estimate,
    sigma_of_group,
)
from paperrepro.method.adjustment.trajectory_equations import (
    LEAST_SIGMA,
    Beams,
    Clock,
    GaussMarkov,
    LeverArm,
)
from paperrepro.method.adjustment.trajectory_solver import (
    Noise,
    Solution,
    State,
    TrajectoryModel,
    eliminate,
    iterate,
    prior_chi2,
)
from paperrepro.method.patches import varied
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Mounting, Navigation, Rays, Survey, Trajectory

#: Seconds between nodes. Between nodes a second apart an APX-15's heading wanders by 0.01 deg,
#: which thousands of points see. At full density, 15 000 points in such a time, nodes 0.25 s apart
#: move the yaw by a sigma and promise 5 % too little; from 0.1 s on neither changes any more.
NODE_SPACING = 0.1
#: Points a face, and seconds between nodes, that show what a flight determines.
WITNESSES, WITNESS_SPACING = 200, 0.5
#: A delay of the clock is beyond doubt from so many of its sigma on; how often it is looked for.
CLOCK_SIGMAS, CLOCK_ROUNDS, LEAST_SHARE = 4.0, 6, 0.1
#: Errors of the beams, rad, before the data; and by how much they must raise twice the logarithm of
#: the likelihood to be unknowns: by chance one flight of a thousand does.
BEAM_SIGMA, BEAM_EVIDENCE = np.radians(0.05), 10.0
#: Planes and points a face from which noise is estimated; a plane for so many s of a longer flight.
NOISE_PLANES, NOISE_POINTS, NOISE_TIME = 30, 150, 15.0


def specified_process(navigation: Navigation) -> GaussMarkov:
    """The Gauss-Markov process that a GNSS/INS specification describes."""
    sigma = np.concatenate([navigation.position_sigma, navigation.attitude_sigma])
    times = np.full(6, navigation.correlation_time)
    return GaussMarkov(np.maximum(sigma, LEAST_SIGMA), times, navigation.profile)


def specified_noise(navigation: Navigation) -> Noise:
    """Errors of the trajectory as specified, surfaces flat."""
    return Noise((specified_process(navigation),), np.zeros(6), 0.0)


@dataclass(frozen=True)
class FoundNoise:
    """What the data say of the noise: variance ``components``, and ``open`` (3, 3) rad², what the
    boresight gets of their uncertainty; ``delay`` s of the laser's clock, ``beam_sigma`` rad,
    spread of the beams' errors, and ``bending`` m of the faces, under which they are."""

    components: VarianceComponents
    open: np.ndarray
    delay: float = 0.0
    beam_sigma: float = 0.0
    bending: float = 0.0

    def named(self) -> dict[str, float]:
        """Plain numbers by name, as `VarianceComponents` has them."""
        return {**self.components.named(), "bending_m": self.bending}


def _clock_can_be_off(survey: Survey) -> bool:
    """A point that came with its pose has no clock of its own."""
    return survey.trajectory is not None and all(strip.pose is None for strip in survey.strips)


def _adjusted(
    survey: Survey,
    tie_planes: TiePlanes,
    near: np.ndarray,
    spacing: float,
    clock: bool,
    beam_sigma: float = 0.0,
    found: Estimate | None = None,
) -> tuple[TrajectoryModel, Solution]:
    """The model whose noise is to be found, and its solution under the components ``found``, from
    where they were, or else those before the data."""
    model = TrajectoryModel.prepare(
        survey, tie_planes, "per_ring", spacing, clock=clock, beam_sigma=beam_sigma
    )
    components = found.components if found else VarianceComponents()
    noise = components.noise(specified_process(survey.navigation), np.zeros(6))
    state = model.start(np.r_[near, np.zeros(model.unknowns.size - 3)], 2)
    if found:
        kept = np.arange(model.unknowns.kept)
        kept = np.r_[kept, -1] if clock else kept
        state.x[kept] = found.state.x[kept]
        state = replace(found.state, x=state.x)
    return model, iterate(components.apply(model), noise, state, 0.01)


def _find_delay(
    survey: Survey, tie_planes: TiePlanes, near: np.ndarray, spacing: float
) -> tuple[float, TrajectoryModel, Solution]:
    """Delay of the laser's clock, s, where it is beyond doubt, before any component could take it
    for an error of the trajectory, and what `_adjusted` finds under it. Noise of the reported poses
    makes each estimate too small by a share: poses are taken at the later time and the rest is
    looked for, until there is none; how much of a known delay the estimate followed says the share.
    """
    delay, before, share = 0.0, None, 1.0
    for k in range(CLOCK_ROUNDS + 1):
        model, solution = _adjusted(*_delayed(survey, tie_planes, delay), near, spacing, True)
        at = len(solution.state.x) - 1
        rest, sigma = solution.state.x[at], np.sqrt(solution.step.own(at + 1)[at, at])
        if before is not None:
            share = float(np.clip((before[1] - rest) / (delay - before[0]), LEAST_SHARE, 1.0))
        beyond_doubt = (CLOCK_SIGMAS if delay == 0 else 1) * sigma * share
        if k == CLOCK_ROUNDS or abs(rest) < beyond_doubt:
            break
        before = delay, rest
        delay += rest / share
    return float(delay), model, solution


def _delayed(survey: Survey, tie_planes: TiePlanes, delay: float) -> tuple[Survey, TiePlanes]:
    """With the poses, and their rates, of ``delay`` s later. Noise of a pose is in its neighbours'
    rates: taken of another moment, these would find a delay in it."""
    if delay == 0:
        return survey, tie_planes
    rays, times = tie_planes.rays, survey.trajectory.time - delay
    survey = replace(survey, trajectory=replace(survey.trajectory, time=times))
    pose = survey.trajectory.at(np.clip(rays.time, times[0], times[-1]))
    turns = np.round((rays.pose[:, 5] - pose[:, 5]) / (2 * np.pi))
    pose[:, 5] += 2 * np.pi * turns
    return survey, replace(tie_planes, rays=replace(rays, pose=pose))


def _few_planes(tie_planes: TiePlanes, mounting: Mounting) -> TiePlanes:
    """At most `NOISE_PLANES`, or one for each `NOISE_TIME` where these are more, that face many
    ways, and `NOISE_POINTS` points of a face: what shows the noise."""
    states, views = tie_planes.plane_states(mounting), np.bincount(tie_planes.plane)
    most = max(NOISE_PLANES, int(np.ptp(tie_planes.rays.time) / NOISE_TIME))
    planes = varied(states.plane[:, :3], states.centroid, views, most)
    return tie_planes.subset(np.isin(tie_planes.plane, planes)).thinned(NOISE_POINTS)


@one_blas_thread
def find_noise(
    survey: Survey, tie_planes: TiePlanes, near: np.ndarray, all_components: bool = True,
    spacing: float = WITNESS_SPACING,
) -> FoundNoise:  # fmt: skip
    """Variance components from some of the ``tie_planes``, at a boresight ``near`` (3,) rad; where
    not ``all_components``, those of laser and surfaces alone, and the others keep their priors: two
    opposite strips tell neither errors of the trajectory nor of beams from a boresight."""
    specified, free = specified_process(survey.navigation), None if all_components else OF_LASER
    mounting, clock, delay, beam_sigma = survey.mounting, _clock_can_be_off(survey), 0.0, 0.0
    tie_planes, bending = without_bends(
        tie_planes.uncontrolled(), survey.scanner, mounting.with_calibration(near)
    )
    tie_planes = _few_planes(tie_planes, mounting)
    if clock:
        delay, model, solution = _find_delay(survey, tie_planes, near, spacing)
        survey, tie_planes = _delayed(survey, tie_planes, delay)
    else:
        model, solution = _adjusted(survey, tie_planes, near, spacing, False)
    found = estimate(model, specified, solution, free)
    if all_components and survey.scanner.n_rings > 1:
        beam_sigma = _find_beam_sigma(
            *_adjusted(survey, tie_planes, near, spacing, clock, BEAM_SIGMA, found)
        )
    if beam_sigma > 0:
        model, solution = _adjusted(survey, tie_planes, near, spacing, clock, beam_sigma)
        found = estimate(model, specified, solution, free)
    return FoundNoise(found.components, found.open, delay, beam_sigma, bending)


def _find_beam_sigma(model: TrajectoryModel, solution: Solution) -> float:
    """Spread of the beams' errors, rad, where the data ask for any, else zero; ``model`` has them
    as unknowns. What errors of the beams there are is in the components, too: that is on the safe
    side."""
    beams, of_x = model.unknowns.beams_at, solution.step.own(len(solution.state.x))
    value, inverse, prior = (
        solution.state.x[beams], np.linalg.inv(of_x[beams, beams]), model.unknowns.beam_sigma,
    )  # fmt: skip
    information, axes = np.linalg.eigh(inverse - np.eye(len(value)) / prior**2)
    seen = np.square(axes.T @ (inverse @ value))
    sigma, evidence = sigma_of_group(np.maximum(information, 0.0), seen, prior)
    return sigma if evidence > BEAM_EVIDENCE else 0.0


@one_blas_thread
def calibrate_with_trajectory(
    survey: Survey,
    tie_planes: TiePlanes,
    range_offsets: str = "per_ring",
    found: FoundNoise | None = None,
    spacing: float = NODE_SPACING,
    near: np.ndarray | None = None,
    lever_arm: bool = False,
) -> CalibrationResult:
    """Scenario D, from ``near`` (3,) rad as start, or else from where SL ends.

    A start degrees away would be taken for an error of the trajectory.

    The prior is ``survey.navigation``'s specification, or the noise ``found`` in the data; then the
    delay of the laser's clock is an unknown, too. ``lever_arm``: it is one, with what was given for
    it as prior (`PRIOR_SIGMA` of `trajectory_equations`). The covariance is that of the stated (or
    estimated) noise, not scaled by sigma0. Raises `BadInput`, `RankDefect`, `NoConvergence`.
    """
    clock = found is not None and _clock_can_be_off(survey)
    reported = survey.trajectory if clock else None
    if clock:
        survey, tie_planes = _delayed(survey, tie_planes, found.delay)
    if near is None:
        near = calibrate(survey, tie_planes, "SL without offsets").boresight
    even, noise = tie_planes, specified_noise(survey.navigation)
    if found is not None and found.bending > 0:
        even, _ = without_bends(tie_planes, survey.scanner, survey.mounting.with_calibration(near))
    model = TrajectoryModel.prepare(
        survey, even, range_offsets, spacing, lever_arm, clock,
        0.0 if found is None else found.beam_sigma,
    )  # fmt: skip
    start = model.unknowns.start()
    if found is not None:
        model = found.components.apply(model)
        specified = specified_process(survey.navigation)
        noise = found.components.noise(specified, found.components.constant(specified)).reduced()
    state = model.start(np.r_[near, start[3:]], len(noise.processes))
    solution = iterate(model, noise, state)
    return _result(model, noise, tie_planes.rays, solution, found, reported)


@one_blas_thread
def lasting_sigma(survey: Survey, tie_planes: TiePlanes, boresight: np.ndarray) -> np.ndarray:
    """Standard deviations (3,) rad of ``boresight`` under errors of the trajectory that last as
    specified, as an adjustment that knows of them would have: from `WITNESSES` points a face."""
    few = tie_planes.thinned(WITNESSES)
    model = TrajectoryModel.prepare(survey, few, "per_ring", WITNESS_SPACING)
    state = model.start(np.r_[boresight, np.zeros(model.unknowns.size - 3)])
    noise = specified_noise(survey.navigation)
    step = eliminate(model.normals(state, noise), model, noise, state)
    return np.sqrt(np.diag(step.columns(3)))


def _result(
    model: TrajectoryModel,
    noise: Noise,
    measured: Rays,
    solution: Solution,
    found: FoundNoise | None,
    reported: Trajectory | None,
) -> CalibrationResult:
    """``measured``: the faces' rays with what they bend."""
    state, step = solution.state, solution.step
    tie_planes, unknowns = model.tie_planes, model.unknowns
    kept, lever, u = unknowns.kept, unknowns.lever_at, len(state.x)
    Q = step.own(u)
    observability = _observability(np.linalg.inv(Q)[:u, :u], kept, model.pseudo_weight)
    require_determined(observability)
    if found is not None:
        Q[:3, :3] += found.open
    of_pose = [noise.constant, *(process.sigma for process in noise.processes)]
    sigma = np.linalg.norm(of_pose, axis=0)[3:]
    observability = observability.under(np.sqrt(np.diag(Q)[:3]), sigma)
    planes, Q_planes = _planes_in_map(model, state, step.of_planes())
    chi2 = solution.data.chi2 + prior_chi2(model, noise, state)
    dof = len(tie_planes.rays) + np.count_nonzero(model.pseudo_weight) - step.size + 6
    dof += int(tie_planes.controlled.sum())
    beams = _beams(unknowns, state.x, Q)
    mounting = replace(unknowns.mounting, beam_offsets=beams.errors if beams else None)
    before, after = (
        face_states(rays, tie_planes.plane_ranges, unknowns, x)
        for rays, x in (
            (measured, unknowns.start()), (mounting.pointed(measured), state.x)
        )
    )  # fmt: skip
    covariances = (step.covariance(further) for further in range(len(noise.processes)))
    same, beside, of_surface = map(np.stack, zip(*covariances, strict=True))
    delay = found.delay + unknowns.clock_delay(state.x) if unknowns.clock else 0.0
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
        rms_before=before.rms,
        rms_after=after.rms,
        points_per_plane=after.count,
        observability=observability,
        trajectory=TrajectoryErrors(
            model.nodes.time, state.error, same, beside, noise.processes, state.constant,
            noise.constant, delay, reported,
        ),
        components=None if found is None else found.named(),
        lever_arm=(
            LeverArm.of(unknowns.mounting, state.x[lever], Q[lever, lever])
            if unknowns.lever else None
        ),
        clock=Clock(delay, float(np.sqrt(np.diag(Q)[u - 1]))) if unknowns.clock else None,
        beams=beams,
        reliability=reliability(model, noise, solution, of_surface[0]),
    )  # fmt: skip


def _beams(unknowns, x: np.ndarray, Q: np.ndarray) -> Beams | None:
    at = unknowns.beams_at
    if at.start == at.stop:
        return None
    variance = np.zeros(unknowns.size)
    variance[at] = np.diag(Q)[at]
    return Beams(unknowns.beam_errors(x), np.sqrt(unknowns.beam_errors(variance)))


def _observability(S: np.ndarray, kept: int, pseudo: np.ndarray) -> Observability:
    """Of boresight and offsets, the first ``kept`` of x, whose information ``S`` (u, u) is, planes
    and trajectory being free, but for constants; so are lever arm and clock, and
    pseudo-observations of the offsets apart."""
    rest = S[kept:, kept:]
    S_x = S[:kept, :kept] - S[:kept, kept:] @ np.linalg.solve(rest, S[kept:, :kept])
    S_x -= np.diag(pseudo[:kept])
    return Observability.of((S_x + S_x.T) / 2, pseudo[:kept])


def _planes_in_map(model: TrajectoryModel, state: State, Q: np.ndarray):
    """Planes (G, 4) with d from the m-frame's origin, and their covariances (G, 4, 4), given those
    of their unknowns (G, 3, 3)."""
    to_map = np.tile(np.eye(4), (len(state.planes), 1, 1))
    to_map[:, 3, :3] = model.origin
    J = to_map @ model.bases(state.planes)
    planes = np.einsum("gab,gb->ga", to_map, state.planes)
    return planes, J @ Q @ J.transpose(0, 2, 1)
