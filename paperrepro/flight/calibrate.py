"""An operator's flight calibrated: overlap, planes, adjustment, and how far the strips lie apart.

Planes are gable roofs where there are enough of them, as in the paper, and patches of any kind
where there are not. Scenario D estimates how noisy trajectory and laser were, for what stands in
`mounting.toml` is a data sheet's word: a post-processed trajectory is often better.
"""

from dataclasses import dataclass, replace
from html import escape

import numpy as np

from paperrepro.errors import BadInput, NoConvergence, RankDefect, TooFewPlanes
from paperrepro.flight.agreement import implausible, require_agreement
from paperrepro.flight.read import Flight
from paperrepro.method.accuracy import PairDistances, overlaps, pair_distances
from paperrepro.method.adjustment import scenarios
from paperrepro.method.adjustment.calibrate import calibrate
from paperrepro.method.adjustment.model_checks import Check, model_checks
from paperrepro.method.adjustment.observability import AXIS_WORDS, WIDEST_SIGMA
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.adjustment.trajectory_equations import DETERMINED
from paperrepro.method.adjustment.trajectory_errors import find_noise
from paperrepro.method.coarse_to_fine import (
    Candidates,
    Progress,
    find_planes,
    find_roofs,
    sample_rays,
    silent,
)
from paperrepro.method.control import (
    CheckedHeights,
    ControlPoints,
    check_heights,
    clouds_of,
    left_out,
    with_control,
)
from paperrepro.method.parameters import Parameters
from paperrepro.method.tie_planes import Rejection, TiePlanes
from paperrepro.survey import Survey

#: What ``planes`` may be: gables alone, patches of any kind, or gables where they suffice.
PLANES = ("auto", "gables", "any")
#: Gable faces from which on gables suffice: six roofs, as many azimuths.
ENOUGH_GABLES = 12
#: Boresight error from which on gables may be missed for the start alone, rad.
FAR = np.deg2rad(2.5)
#: Strips from which on the noise of the trajectory is told from the boresight: in two lines half of
#: the boresight and an error of either look alike.
ENOUGH_STRIPS = 4


@dataclass(frozen=True)
class OwnFlight:
    """What a calibration of a flight found.

    Attributes
    ----------
    survey : Survey
        As it was given.
    planes : str
        ``gables`` or ``any``.
    result : CalibrationResult
        Of the adjustment.
    tie_planes : TiePlanes
        The tie planes that went into it.
    rejected : tuple of Rejection
        Gross errors of the last search and of the adjustment.
    boresights : (searches + 1, 3) array, rad
        As the search went.
    distances : tuple of PairDistances
        Between the strips of each pair, before and after.
    remarks : tuple of str
        A sentence each.
    checks : tuple of Check
        Of the model under which sigma hold.
    checkpoints : CheckedHeights, optional
        Heights of the cloud over points surveyed on the ground.
    """

    survey: Survey
    planes: str
    result: CalibrationResult
    tie_planes: TiePlanes
    rejected: tuple[Rejection, ...]
    boresights: np.ndarray
    distances: tuple[PairDistances, ...]
    remarks: tuple[str, ...]
    checks: tuple[Check, ...] = ()
    checkpoints: CheckedHeights | None = None

    def summary(self) -> str:
        """Lines for a terminal: remarks, the angles with their sigma, the fit, what is weak, and
        where the data contradict the model."""
        checks = [f"  check: {sentence}" for sentence in self.contradictions]
        checked = self.checkpoints.lines() if self.checkpoints else []
        return "\n".join([*self.remarks, self.result.summary(), *checks, *checked])

    @property
    def contradictions(self) -> list[str]:
        """Sentences of the checks that did not pass."""
        return [check.sentence for check in self.checks if not check.passed]

    def __repr__(self) -> str:
        strips = ", ".join(strip.name for strip in self.survey.strips)
        return f"OwnFlight({strips}; {self.result!r}; {len(self.remarks)} remarks)"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.summary())}</pre>"


def calibrate_flight(
    flight: Flight | Survey,
    scenario: str = "D",
    planes: str = "auto",
    progress: Progress = silent,
    parameters: Parameters | None = None,
    lever_arm: bool = False,
    checkpoints: ControlPoints | None = None,
    control: ControlPoints | None = None,
) -> OwnFlight:
    """Calibrate a flight, from its own mounting as start.

    Parameters
    ----------
    flight : Flight or Survey
        As `read_flight` gives it, or a survey from elsewhere.
    scenario : str
        ``SL``, ``A``, ``B``, ``C`` of the paper, or ``D``, ours; or a variant such as ``B 3``,
        three points a face, and ``SL without offsets``.
    planes : str
        ``gables``, ``any``, or ``auto``: gables where there are enough.
    progress : callable
        Given a sentence for each step.
    parameters : Parameters, optional
        Table 2, for gable roofs.
    lever_arm : bool
        Scenario D estimates the lever arm, too, with the given one as prior.
    checkpoints : ControlPoints, optional
        Points surveyed on the ground, as `read_control` gives them, that judge the heights.
    control : ControlPoints, optional
        Points that enter scenario D.

    Returns
    -------
    OwnFlight
        Boresight with its covariance, distances between the strips, remarks.

    Raises
    ------
    BadInput
        Strips that do not overlap; unknown words; a mistake of the trajectory, such as a wrong sign
        of roll, that shows in the strips' agreement alone.
    TooFewPlanes, RankDefect, NoConvergence
        Where the flight does not determine the boresight.
    """
    of_trajectory = scenarios.by_name(scenario).trajectory
    _require_word("planes", planes, PLANES)
    if lever_arm and not of_trajectory:
        raise BadInput(f"lever arm: scenario {scenario} holds it; estimate it by scenario D")
    if control is not None and not of_trajectory:
        raise BadInput(f"control: scenario {scenario} has no use for it; use it in scenario D")
    survey = flight.survey if isinstance(flight, Flight) else flight
    points = sample_rays(survey)
    pairs = _require_overlap(survey, points.rays)
    kind, found, remarks = _find(survey, points, planes, progress, parameters)
    require_agreement(survey, found.tie_planes, getattr(flight, "trajectory", "trajectory"))
    progress(f"scenario {scenario}: {found.tie_planes.n_planes} planes")
    tied = found.tie_planes
    if control is not None:
        tied = _controlled(survey, tied, control, found.boresights[-1], remarks)
    try:
        result, tie_planes = _adjust(survey, tied, scenario, found.boresights[-1], lever_arm)
    except RankDefect as error:
        given = survey.mounting
        survey = replace(survey, mounting=replace(given, known_to=WIDEST_SIGMA))
        result, tie_planes = _adjust(survey, tied, scenario, found.boresights[-1], lever_arm)
        remarks.append(_held(result, error))
    if of_trajectory and len(set(tie_planes.strips)) < ENOUGH_STRIPS:
        remarks.append(
            f"The trajectory's noise was taken as specified, to a factor of three: "
            f"{len(set(tie_planes.strips))} strips do not show it, {ENOUGH_STRIPS} would."
        )
    remarks += [*_constants(result), *implausible(result)]
    checks = model_checks(result, survey, _by_sl(survey, tie_planes, found.boresights[-1]))
    progress(f"distances of {len(pairs)} pairs of strips")
    adjust = None if result.trajectory is None else result.trajectory.apply
    distances = pair_distances(points, pairs, survey.mounting, result.calibrated, adjust)
    rejected = (*found.rejected, *result.rejected)
    checked = None
    if checkpoints is not None:
        progress(f"heights over {len(checkpoints.names)} checkpoints")
        correct = None if result.trajectory is None else result.trajectory.poses
        clouds = clouds_of(survey.mounting, result.calibrated, correct)
        checked = check_heights(survey, checkpoints, clouds)
    return OwnFlight(
        survey, kind, result, tie_planes, rejected, found.boresights, distances, tuple(remarks),
        checks, checked,
    )  # fmt: skip


def _by_sl(survey: Survey, tie_planes: TiePlanes, near: np.ndarray) -> np.ndarray | None:
    """Boresight (3,) rad of scenario SL from the same planes, or None where it has none."""
    try:
        return scenarios.calibrate(survey, tie_planes.uncontrolled(), "SL", near).boresight
    except (RankDefect, NoConvergence, TooFewPlanes):
        return None


def _controlled(
    survey: Survey, tie_planes: TiePlanes, control: ControlPoints, near: np.ndarray, remarks: list
) -> TiePlanes:
    """With planes through the control points, under the boresight ``near`` (3,) rad; ``remarks``
    get which were not used. Raises `BadInput` where none is."""
    mounting = survey.mounting.with_calibration(near)
    tied, off, uneven = with_control(survey, tie_planes, control, mounting)
    if not tied.controlled.any():
        raise BadInput(
            f"control: none of {len(control.names)} points lies on even ground of the strips "
            f"({', '.join(control.names[:3])} ...); give points there, in the strips' coordinates"
        )
    if off or uneven:
        remarks.append(f"Control: {left_out(off, uneven)}")
    return tied


def _held(result: CalibrationResult, why: RankDefect) -> str:
    """What the nominal mounting had to say because the flight does not. Raises ``why`` where the
    flight says nothing."""
    axes = np.array(AXIS_WORDS)[result.sigma > DETERMINED * WIDEST_SIGMA]
    if len(axes) == 3:
        raise why
    reason = str(why).split(";")[0]
    taken = f"the nominal mounting is taken as right to {np.rad2deg(WIDEST_SIGMA):.0f}°"
    if not len(axes):
        return f"Since {reason}, {taken}; sigma say what the flight adds to that."
    held = " and ".join(axes)
    return (
        f"This flight does not determine the boresight's {held}: {taken} and holds it ({reason})."
    )


def _constants(result: CalibrationResult) -> list[str]:
    """What of sigma is an attitude that may be off all the time, in words."""
    if result.trajectory is None:
        return []
    sigma = np.degrees(result.trajectory.constant_sigma[3:])
    words = [f"{axis} {s:.3f}°" for axis, s in zip(AXIS_WORDS, sigma, strict=True) if s > 0]
    if not words:
        return []
    return [
        f"Sigma include a constant error of attitude ({', '.join(words)}), which no data tell from "
        "the boresight: the specification allows it, the flight does not show it."
    ]


def _require_word(what: str, word: str, words) -> None:
    if word not in words:
        raise BadInput(f"{what}: expected one of {', '.join(words)}, got {word!r}; name one")


def _require_overlap(survey: Survey, samples):
    names = ", ".join(strip.name for strip in survey.strips)
    if len(survey.strips) < 2:
        raise BadInput(
            f"strips {names}: expected at least two that overlap, got one; give the strips of all "
            "flight lines, a calibration compares what they see of one place"
        )
    pairs = overlaps(samples, survey.mounting)
    if not pairs:
        raise BadInput(
            f"strips {names}: expected strips that overlap, got none that share a metre of ground; "
            "give neighbouring or opposite lines of one flight"
        )
    return pairs


def _find(
    survey: Survey, points: Candidates, planes: str, progress: Progress,
    parameters: Parameters | None,
):  # fmt: skip
    """Which planes, what was found, and what is to be said of the choice. Gables that were not
    found from a start too far off are sought again from the boresight that other planes have."""
    search, start, others = (parameters or Parameters()).search, survey, None
    while planes != "any":
        try:
            found = find_roofs(start, search=search, progress=progress)
        except (TooFewPlanes, RankDefect, NoConvergence) as error:
            if planes == "gables":
                raise
            why = f"gable roofs did not suffice ({str(error).split(';')[0]})"
        else:
            if planes == "gables" or found.tie_planes.n_planes >= ENOUGH_GABLES:
                return "gables", found, []
            why = f"only {found.tie_planes.n_planes} faces of gable roofs lie in two strips or more"
        if others is not None:
            break
        others = find_planes(survey, points, progress=progress)
        if np.abs(others.boresights[-1] - survey.mounting.boresight).max() < FAR:
            break
        start = replace(survey, mounting=survey.mounting.with_calibration(others.boresights[-1]))
    else:
        return "any", find_planes(survey, points, progress=progress), []
    remark = f"Planes of any kind were used: {why}."
    progress(remark)
    return "any", others, [remark]


def _adjust(
    survey: Survey, tie_planes: TiePlanes, scenario: str, near: np.ndarray, lever_arm: bool
) -> tuple[CalibrationResult, TiePlanes]:
    """``scenario`` on ``tie_planes`` from ``near`` (3,) rad, and the faces that it kept; D under
    the noise in the data. What it says of before is under the survey's own mounting."""
    found, start = None, replace(survey, mounting=survey.mounting.with_calibration(near))
    if scenarios.by_name(scenario).trajectory:
        enough = len(set(tie_planes.strips)) >= ENOUGH_STRIPS
        found = find_noise(start, tie_planes, near, enough)
    result = calibrate(start, tie_planes, scenario, found=found, lever_arm=lever_arm)
    kept = result.adjusted(tie_planes)
    before = kept.plane_states(survey.mounting).rms
    changed = {"mounting": survey.mounting, "rms_before": before}
    return replace(result, **changed), kept
