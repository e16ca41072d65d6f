"""SL, A, B and C, estimators of one boresight from the same matched faces, and the refinement.

=====  ==========================  ======================  =========================
name   unknowns                    planes                  conditions
=====  ==========================  ======================  =========================
SL     boresight, offsets, planes  free, unit normals      points, Eq. (4)
A      boresight                   of the reference strip  centroids, Eq. (5)
B      boresight, range offsets    of the reference strip  points and centroids
C      boresight, offsets, planes  free, unit normals      points and centroids
=====  ==========================  ======================  =========================

SL is Skaloud and Lichti 2006, the paper's [11]. Range offsets, one a ring: a common one is nearly a
height shift, so that each is observed as zero, too, with the scanner's stated accuracy. How many
points of a face enter Eq. (4) the paper does not say, so every estimator has variants (`by_name`).

The refinement, Eq. (6)-(9), takes the boresight alone: each point of a face in one strip is
projected at right angles on its matched plane in another; the boresight that makes the projections
shortest is sought, everything else held. The target plane is fitted to its own strip's points and
moves with the boresight like the points do.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from paperrepro._compiled import one_blas_thread
from paperrepro.errors import BadInput, NoConvergence, RankDefect, TooFewPlanes
from paperrepro.method.adjustment.conditions import (
    FINAL,
    FaceStates,
    PlaneNormals,
    PreparedRays,
    Unknowns,
    centroid_blocks,
    centroid_variances,
    face_states,
    last_value,
    observation_variances,
    point_blocks,
    virtual_jacobians,
)
from paperrepro.method.adjustment.gauss_helmert import (
    PriorObservations,
    Solution,
    solve_free,
    solve_reference,
)
from paperrepro.method.adjustment.observability import Observability
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.tie_planes import TiePlanes, require_spread, require_width
from paperrepro.survey import Mounting, Survey


@dataclass(frozen=True)
class Scenario:
    """An estimator by what it estimates and on what conditions.

    ``range_offsets`` is ``none``, ``common`` or ``per_ring``; ``free_planes``: unknowns, else taken
    from the reference strip of each pair; ``points`` of a face that enter Eq. (4), evenly spaced,
    or None for all; ``centroids``: Eq. (5); ``trajectory``: its errors are unknowns too.
    """

    name: str
    range_offsets: str
    free_planes: bool
    points: int | None
    centroids: bool
    trajectory: bool = False

    @property
    def has_points(self) -> bool:
        return self.points != 0


SCENARIOS = {
    s.name: s
    for s in (
        Scenario("SL", "per_ring", free_planes=True, points=None, centroids=False),
        Scenario("A", "none", free_planes=False, points=0, centroids=True),
        Scenario("B", "per_ring", free_planes=False, points=None, centroids=True),
        Scenario("C", "per_ring", free_planes=True, points=None, centroids=True),
    )
}
#: Ours, `trajectory_errors`.
D = Scenario("D", "per_ring", free_planes=True, points=None, centroids=False, trajectory=True)


@one_blas_thread
def calibrate(
    survey: Survey,
    tie_planes: TiePlanes,
    scenario: str | Scenario,
    near: np.ndarray | None = None,
) -> CalibrationResult:
    """Estimate the boresight from ``survey.mounting``'s as start, or from ``near`` (3,) rad.

    Raises `BadInput` for an unknown scenario, `TooFewPlanes`, `RankDefect`, `NoConvergence`.
    """
    scenario = scenario if isinstance(scenario, Scenario) else by_name(scenario)
    model = _Model.prepare(survey, tie_planes, scenario)
    x = model.unknowns.start()
    solution = model.solve(x if near is None else np.r_[near, x[3:]])
    return _result(model, solution)


def by_name(text: str) -> Scenario:
    """The scenario of that name; with a number of points a face behind it, as in ``B 3`` or
    ``SL all``, and ``without offsets``, a variant of it. Raises `BadInput`."""
    name, *words = text.split() or [""]
    found = (SCENARIOS | {"D": D}).get(name)
    offsets = words[-2:] != ["without", "offsets"]
    words = words if offsets else words[:-2]
    points = words[0] if len(words) == 1 and (words == ["all"] or words[0].isdecimal()) else None
    if found is None or (words and points is None) or (found.free_planes and points == "0"):
        raise BadInput(
            f"scenario {text!r}: expected one of {', '.join(SCENARIOS)}, D, perhaps with points a "
            "face (B 3, SL all; those with planes as unknowns need one at least) and 'without "
            "offsets'; name one of them"
        )
    if points is not None:
        found = replace(found, points=None if points == "all" else int(points))
    if not offsets:
        found = replace(found, range_offsets="none")
    return replace(found, name=text)


@dataclass(frozen=True)
class _Model:
    """A scenario's conditions on given faces.

    Condition group ``g`` is a plane (free) or a pair (reference): its points are ``observed`` in
    rows ``ranges[g]``, its centroid conditions are those with ``centroid_group == g``. ``states``
    gives all matched faces at an ``x``, ``before`` all planes at the start.
    """

    tie_planes: TiePlanes
    scenario: Scenario
    unknowns: Unknowns
    variances: np.ndarray
    rays: PreparedRays = field(repr=False)
    observed: PreparedRays = field(repr=False)
    states: Callable[[np.ndarray], FaceStates]
    before: FaceStates = field(repr=False)
    origin: np.ndarray
    ranges: np.ndarray
    centroid_face: np.ndarray
    centroid_group: np.ndarray
    pseudo: PriorObservations
    poses: np.ndarray = field(repr=False)

    @classmethod
    def prepare(cls, survey: Survey, tie_planes: TiePlanes, scenario: Scenario) -> "_Model":
        unknowns = Unknowns.layout(survey.mounting, survey.scanner.n_rings, scenario.range_offsets)
        rays, x = PreparedRays.of(tie_planes.rays), unknowns.start()
        planes = face_states(rays, tie_planes.plane_ranges, unknowns, x)
        if survey.mounting.known_to is None:
            require_spread(planes.plane[:, :3])
        states = last_value(lambda at: face_states(rays, tie_planes.ranges, unknowns, at))
        few = tie_planes.thinned(scenario.points) if scenario.points else tie_planes
        observed = PreparedRays.of(few.rays) if scenario.points else rays
        faces = np.arange(len(tie_planes.ranges))
        if scenario.free_planes:
            require_width(planes.width, [f"plane {k}" for k in range(tie_planes.n_planes)])
            layout = planes.centroid, few.plane_ranges, faces, tie_planes.plane
        else:
            if not len(tie_planes.pairs):
                raise TooFewPlanes(
                    f"scenario {scenario.name}: expected pairs of faces, got none; "
                    "match strips first"
                )
            reference, search = np.unique(tie_planes.pairs[:, 0]), tie_planes.pairs[:, 1]
            width = states(x).width[reference]
            require_width(width, [f"face {k} of {tie_planes.strips[k]}" for k in reference])
            origin = planes.centroid[tie_planes.plane[search]]
            layout = origin, few.ranges[search], search, np.arange(len(search))
        offset_weight = survey.scanner.range_offset_sigma**-2.0
        weight = np.r_[survey.mounting.boresight_weight, np.full(unknowns.size - 3, offset_weight)]
        variances = observation_variances(survey.navigation, survey.scanner)
        pseudo = PriorObservations(np.zeros(unknowns.size), weight)
        given = tie_planes, scenario, unknowns, variances, rays, observed, states, planes
        return cls(*given, *layout, pseudo, tie_planes.mean_poses())

    def solve(self, x: np.ndarray) -> Solution:
        if not self.scenario.free_planes:
            return solve_reference(self.blocks, self.reference_planes, x, self.pseudo)
        planes = self.planes(x).plane
        planes[:, 3] -= np.einsum("ga,ga->g", planes[:, :3], self.origin)
        return solve_free(self.blocks, x, planes, self.pseudo)

    def planes(self, x: np.ndarray) -> FaceStates:
        """Each plane fitted to the points of all its faces."""
        return face_states(self.rays, self.tie_planes.plane_ranges, self.unknowns, x)

    def reference_planes(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Planes (P, 4) of the pairs' reference faces, d from each pair's origin, and (P, 4, u)."""
        states, reference = self.states(x), self.tie_planes.pairs[:, 0]
        planes, J = states.plane[reference], states.J_plane[reference]
        planes[:, 3] -= np.einsum("ga,ga->g", planes[:, :3], self.origin)
        J[:, 3] -= np.einsum("gak,ga->gk", J[:, :3], self.origin)
        return planes, J

    def blocks(self, x: np.ndarray, planes: np.ndarray, final_m: float = FINAL) -> PlaneNormals:
        """All conditions at ``x`` and ``planes``; ``final_m`` m: `kernels.adjust_observations`."""
        parts = []
        if self.scenario.has_points:  # Eq. (4)
            parts.append(
                point_blocks(
                    self.observed,
                    self.ranges,
                    self.origin,
                    planes,
                    self.unknowns,
                    x,
                    self.variances,
                    final_m,
                )
            )
        if self.scenario.centroids:  # Eq. (5)
            parts.append(self._centroid_blocks(x, planes))
        return parts[0] if len(parts) == 1 else parts[0] + parts[1]

    def _centroid_blocks(self, x: np.ndarray, planes: np.ndarray) -> PlaneNormals:
        states = self.states(x)
        face, group = self.centroid_face, self.centroid_group
        J_l = virtual_jacobians(states.centroid, self.poses, self.unknowns, x)
        n = planes[group, :3]
        s = centroid_variances(n, J_l[face], states.count[face], self.variances)
        if not self.scenario.free_planes:
            reference = self.tie_planes.pairs[:, 0]
            s = s + centroid_variances(n, J_l[reference], states.count[reference], self.variances)
        return centroid_blocks(face, group, states, self.origin, planes, s)


def _result(model: _Model, solution: Solution) -> CalibrationResult:
    tie_planes, x = model.tie_planes, solution.x
    sigma0 = float(np.sqrt(solution.chi2 / solution.dof))
    after = model.planes(x)
    planes, Q_planes = _planes_in_map(model, solution, after)
    conditions = len(model.centroid_face) * model.scenario.centroids
    n_points = int(np.diff(model.ranges, axis=1).sum()) * model.scenario.has_points
    return CalibrationResult(
        scenario=model.scenario.name,
        mounting=model.unknowns.mounting,
        boresight=x[:3],
        range_offsets=None if model.scenario.range_offsets == "none" else model.unknowns.offsets(x),
        covariance=sigma0**2 * solution.Q,
        planes=planes,
        covariance_planes=sigma0**2 * Q_planes,
        sigma0=sigma0,
        dof=solution.dof,
        iterations=solution.iterations,
        first_step=solution.first[:3],
        n_points=len(tie_planes.rays),
        n_conditions=n_points + conditions,
        rms_before=model.before.rms,
        rms_after=after.rms,
        points_per_plane=after.count,
        observability=Observability.of(solution.S_data, model.pseudo.weight),
    )


def _planes_in_map(
    model: _Model, solution: Solution, after: FaceStates
) -> tuple[np.ndarray, np.ndarray]:
    """Planes (G, 4) with d from the m-frame's origin, and cofactors (G, 4, 4).

    Where the scenario takes planes from reference strips, the common plane of all matched faces.
    """
    if not model.scenario.free_planes:
        return after.plane, after.J_plane @ solution.Q @ after.J_plane.transpose(0, 2, 1)
    to_map = np.tile(np.eye(4), (len(solution.planes), 1, 1))
    to_map[:, 3, :3] = model.origin
    planes = np.einsum("gab,gb->ga", to_map, solution.planes)
    return planes, to_map @ solution.Q_planes @ to_map.transpose(0, 2, 1)


POINT_TO_PLANE = Scenario("refinement", "none", free_planes=False, points=None, centroids=False)


def orthogonal_projection(p_m: np.ndarray, plane: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Foot points (N, 3) of ``p_m`` (N, 3) on ``plane`` (4,) as (n, d), and signed lengths (N,), m.

    Eq. (7): ``s = d - n . p``, ``p_T = p + s n``.
    """
    s = plane[3] - p_m @ plane[:3]
    return p_m + s[:, None] * plane[:3], s


def refine(survey: Survey, tie_planes: TiePlanes, calibrated: Mounting) -> CalibrationResult:
    """Refine the boresight by the point-to-plane model; range offsets stay as they are.

    Parameters
    ----------
    survey : Survey
    tie_planes : TiePlanes
        Extracted and matched under ``calibrated``; the first face of a pair gives the points, the
        second the target plane.
    calibrated : Mounting
        The result of a calibration, where the iterations start.

    Returns
    -------
    CalibrationResult

    Raises
    ------
    TooFewPlanes
        For fewer than four planes.
    RankDefect, NoConvergence

    References
    ----------
    Section 2.2.5, Eq. (6) to (9) of the paper.
    """
    # Eq. (6), (7): each point is projected on its target plane; Eq. (9): boresight alone
    onto_target = replace(tie_planes, pairs=tie_planes.pairs[:, ::-1])
    return calibrate(replace(survey, mounting=calibrated), onto_target, POINT_TO_PLANE)


def refine_pairs(
    survey: Survey, tie_planes: TiePlanes, calibrated: Mounting
) -> dict[tuple[str, str], CalibrationResult]:
    """`refine` from each pair of strips alone, as section 2.2.5 can be read, too; pairs that share
    fewer than four planes, or planes that leave an angle open, are left out."""
    results = {}
    for pair in combinations(dict.fromkeys(sorted(tie_planes.strips)), 2):
        seen = np.isin(tie_planes.strips, pair)
        try:
            results[pair] = refine(survey, tie_planes.subset(seen), calibrated)
        except (TooFewPlanes, RankDefect, NoConvergence):
            continue
    return results
