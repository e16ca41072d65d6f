"""The paper's seven steps, Fig. 3: no file, no picture, no truth.

`calibrate_survey` takes them all; each step is a module or a room of its own.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from paperrepro import _modules_of
from paperrepro.method.adjustment.calibrate import PAPER_SCENARIOS, calibrate
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.adjustment.scenarios import refine
from paperrepro.method.adjustment.screening import screen
from paperrepro.method.coarse_to_fine import (
    Candidates,
    PlaneSurvey,
    Progress,
    RoofSearch,
    find_candidates,
    find_roofs,
    planes_under,
    silent,
)
from paperrepro.method.parameters import Parameters
from paperrepro.survey import Survey

#: The steps in the paper's order; Fig. 3 is drawn from these names.
STEPS = (
    "LiDAR equation",
    "Outlier removal",
    "Ground filter",
    "Roof planes",
    "Virtual points and matching",
    "Calibration",
    "Refinement",
)


@dataclass(frozen=True)
class SurveyCalibration:
    """Roofs ``found``, the ``result`` of the calibration on them, and ``refined``, that of the
    refinement, None for scenario D and for
    variants such as ``B 3``."""

    found: PlaneSurvey
    result: CalibrationResult
    refined: CalibrationResult | None


def calibrate_survey(
    survey: Survey,
    scenario: str = "C",
    parameters: Parameters | None = None,
    progress: Progress = silent,
) -> SurveyCalibration:
    """The paper's method: from strips and trajectory to a refined boresight.

    Parameters
    ----------
    survey : Survey
        Strips, trajectory, and the mounting to start from; its boresight may be 3 degrees off.
    scenario : str
        ``SL`` ([11]), ``A``, ``B``, ``C`` of the paper, or ``D``, which estimates the trajectory's
        errors too and is not refined.
    parameters : Parameters, optional
        Table 2.
    progress : callable, optional
        Called with a sentence for each step.

    Returns
    -------
    SurveyCalibration

    Raises
    ------
    BadInput, TooFewPlanes, RankDefect, NoConvergence

    References
    ----------
    Section 2.2 and Fig. 3 of the paper.
    """
    search = (parameters or Parameters()).search
    # 1 LiDAR equation, 2 outlier removal, 3 ground filter
    points = find_candidates(survey, search.roofs, progress)
    # 4 roof planes, 5 virtual points and matching, coarse to fine
    found = find_roofs(survey, points, search, progress)
    # 6 calibration
    progress(f"scenario {scenario}: {found.tie_planes.n_planes} planes")
    result = calibrate(survey, found.tie_planes, scenario)
    # 4, 5 again on the adjusted strips, 7 refinement
    refined = None
    if scenario in PAPER_SCENARIOS:
        progress("refinement")
        refined = refine_all(survey, points, {scenario: result}, search)[scenario]
    return SurveyCalibration(found, result, refined)


def calibrate_all(
    survey: Survey, found: PlaneSurvey, scenarios: Iterable[str]
) -> dict[str, CalibrationResult]:
    """Every one of ``scenarios`` on the same tie planes, screened once."""
    screening = screen(survey, found.tie_planes)
    return {
        name: calibrate(survey, found.tie_planes, name, screening=screening) for name in scenarios
    }


def refine_all(
    survey: Survey,
    points: Candidates,
    results: dict[str, CalibrationResult],
    search: RoofSearch | None = None,
) -> dict[str, CalibrationResult]:
    """Section 2.2.5 after each calibration: roofs extracted and matched anew, then Eq. (9)."""
    return {
        name: refine(
            survey,
            planes_under(survey, points, result.calibrated, search or RoofSearch()).tie_planes,
            result.calibrated,
        )
        for name, result in results.items()
    }


__getattr__ = _modules_of(__name__)
