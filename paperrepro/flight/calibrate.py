"""An operator's flight calibrated: overlap, planes, adjustment, and how far the strips lie apart.

Planes are gable roofs where there are enough of them, as in the paper, and patches of any kind
where there are not. Scenario D estimates how noisy trajectory and laser were, for what stands in
`mounting.toml` is a data sheet's word: a post-processed trajectory is often better.
"""

from dataclasses import dataclass, replace

import numpy as np

from paperrepro.errors import BadInput, NoConvergence, RankDefect, TooFewPlanes
from paperrepro.method.accuracy import PairDistances, overlaps, pair_distances
from paperrepro.method.adjustment import trajectory_errors
from paperrepro.method.adjustment.calibrate import SCENARIO_NAMES, calibrate
from paperrepro.method.adjustment.conditions import Unknowns, face_states
from paperrepro.method.adjustment.model_checks import Check, model_checks
from paperrepro.method.adjustment.observability import AXIS_WORDS
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.adjustment.screening import screen
from paperrepro.method.coarse_to_fine import (
    Candidates,
    Progress,
    find_planes,
    find_roofs,
    sample_rays,
    silent,
)
from paperrepro.method.parameters import Parameters
from paperrepro.method.patches import choose
from paperrepro.method.tie_planes import Rejection, TiePlanes
from paperrepro.survey import Survey

#: What ``planes`` may be: gables alone, patches of any kind, or gables where they suffice.
PLANES = ("auto", "gables", "any")
#: Gable faces from which on gables suffice: six roofs, as many azimuths.
ENOUGH_GABLES = 12
#: Strips from which on the noise of the trajectory is told from the boresight: in two lines half of
#: the boresight and an error of either look alike.
ENOUGH_STRIPS = 4
#: Planes and points a face from which noise is estimated.
NOISE_PLANES, NOISE_POINTS = 30, 150


@dataclass(frozen=True)
class OwnFlight:
    """What a calibration of a flight found.

    ``planes``: ``gables`` or ``any``; ``result``; ``tie_planes`` faces that went into it;
    ``rejected`` faces, wrong matches of the last pass and of the adjustment; ``boresights``
    (passes + 1, 3) rad as the passes went; ``distances`` of the pairs of strips; ``remarks``, a
    sentence each; ``checks`` of the model under which sigma hold.
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


def calibrate_flight(
    survey: Survey,
    scenario: str = "D",
    planes: str = "auto",
    progress: Progress = silent,
    parameters: Parameters | None = None,
) -> OwnFlight:
    """Calibrate ``survey`` from its own mounting as start; ``planes`` is one of `PLANES`,
    ``parameters`` those of Table 2, for gable roofs.

    Raises `BadInput` for strips that do not overlap and for unknown words, `TooFewPlanes`,
    `RankDefect`, `NoConvergence`.
    """
    _require_word("scenario", scenario, SCENARIO_NAMES)
    _require_word("planes", planes, PLANES)
    points = sample_rays(survey)
    pairs = _require_overlap(survey, points.rays)
    kind, found, remarks = _find(survey, points, planes, progress, parameters or Parameters())
    progress(f"scenario {scenario}: {found.tie_planes.n_planes} planes")
    result, tie_planes = _adjust(survey, found.tie_planes, scenario, found.boresights[-1])
    if scenario == "D" and len(set(tie_planes.strips)) < ENOUGH_STRIPS:
        remarks.append(
            f"The trajectory's noise was taken as specified, to a factor of three: "
            f"{len(set(tie_planes.strips))} strips do not show it, {ENOUGH_STRIPS} would."
        )
    remarks += _constants(result)
    checks = model_checks(result, survey, tie_planes, found.boresights[-1])
    progress(f"distances of {len(pairs)} pairs of strips")
    distances = pair_distances(points.rays, pairs, survey.mounting, result.calibrated)
    rejected = (*found.rejected, *result.rejected)
    return OwnFlight(
        survey,
        kind,
        result,
        tie_planes,
        rejected,
        found.boresights,
        distances,
        tuple(remarks),
        checks,
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
        f"Sigma hold a constant error of the attitude ({', '.join(words)}), which no data tell "
        "from the boresight: the specification allows it, the flight does not show it."
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
    survey: Survey, points: Candidates, planes: str, progress: Progress, parameters: Parameters
):
    """Which planes, what was found, and what is to be said of the choice."""
    if planes == "any":
        return "any", find_planes(survey, points, progress=progress), []
    try:
        found = find_roofs(survey, search=parameters.search, progress=progress)
    except (TooFewPlanes, RankDefect, NoConvergence) as error:
        if planes == "gables":
            raise
        why = f"gable roofs did not suffice ({str(error).split(';')[0]})"
    else:
        if planes == "gables" or found.tie_planes.n_planes >= ENOUGH_GABLES:
            return "gables", found, []
        why = f"only {found.tie_planes.n_planes} faces of gable roofs lie in two strips or more"
    remark = f"Planes of any kind were used: {why}."
    progress(remark)
    return "any", find_planes(survey, points, progress=progress), [remark]


def _adjust(
    survey: Survey, tie_planes: TiePlanes, scenario: str, near: np.ndarray
) -> tuple[CalibrationResult, TiePlanes]:
    """``scenario`` on ``tie_planes`` from ``near`` (3,) rad, and the faces that it kept; D under
    the noise in the data. What it says of before is under the survey's own mounting."""
    found, start = None, replace(survey, mounting=survey.mounting.with_calibration(near))
    if scenario == "D":
        enough = len(set(tie_planes.strips)) >= ENOUGH_STRIPS
        found = trajectory_errors.find_noise(start, _few(start, tie_planes), near, enough)
    result = calibrate(start, tie_planes, scenario, found=found)
    kept = tie_planes.subset(screen(start, tie_planes).kept) if result.rejected else tie_planes
    unknowns = Unknowns.layout(survey.mounting, survey.scanner.n_rings, "none")
    before = face_states(kept.rays, kept.plane_ranges, unknowns, unknowns.start()).rms
    changed = {"mounting": survey.mounting, "rms_before": before}
    return replace(result, **changed), kept


def _few(survey: Survey, tie_planes: TiePlanes) -> TiePlanes:
    """At most `NOISE_PLANES` planes that face many ways, and few points of each."""
    unknowns = Unknowns.layout(survey.mounting, survey.scanner.n_rings, "none")
    states = face_states(tie_planes.rays, tie_planes.plane_ranges, unknowns, unknowns.start())
    views = np.bincount(tie_planes.plane)
    planes = choose(states.plane[:, :3], states.centroid, views, NOISE_PLANES)
    return tie_planes.subset(np.isin(tie_planes.plane, planes)).thinned(NOISE_POINTS)
