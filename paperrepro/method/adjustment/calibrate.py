"""One door to all five estimators: SL, A, B, C of the paper and D, ours."""

from dataclasses import replace

from paperrepro.errors import BadInput
from paperrepro.method.adjustment import scenarios, trajectory_errors
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.adjustment.screening import screen
from paperrepro.method.tie_planes import TiePlanes, require_shared
from paperrepro.survey import Survey

PAPER_SCENARIOS = tuple(scenarios.SCENARIOS)
SCENARIO_NAMES = (*PAPER_SCENARIOS, "D")


def calibrate(
    survey: Survey,
    tie_planes: TiePlanes,
    scenario: str,
    robust: bool = True,
    components: bool = False,
    lever_arm: bool = False,
) -> CalibrationResult:
    """Estimate the boresight by ``scenario``, from ``survey.mounting``'s as start.

    ``robust``: faces that miss their plane are left out first, and reported (`screening`).
    ``components``: scenario D estimates variance components; ``lever_arm``: and the lever arm,
    which the others hold. `Observability.undetermined` names the angles that the flight does not
    determine, whatever sigma the scenario has for them. Raises `BadInput` for an unknown scenario,
    `TooFewPlanes`, `RankDefect`, `NoConvergence`.
    """
    if scenario not in SCENARIO_NAMES:
        raise BadInput(
            f"scenario {scenario!r}: expected one of {', '.join(SCENARIO_NAMES)}; name one of them"
        )
    require_shared(tie_planes)
    rejected, near = (), None
    if robust:
        screening = screen(survey, tie_planes)
        rejected, near = screening.rejected, screening.boresight
        tie_planes = tie_planes.subset(screening.kept) if rejected else tie_planes
    if scenario == "D":
        result = trajectory_errors.calibrate_with_trajectory(
            survey, tie_planes, components=components, near=near, lever_arm=lever_arm
        )
    else:
        result = _judged(
            survey, tie_planes, scenarios.calibrate(survey, tie_planes, scenario, near)
        )
    return replace(result, rejected=rejected)


def _judged(survey: Survey, tie_planes: TiePlanes, result: CalibrationResult) -> CalibrationResult:
    """With what its flight determines once errors of the trajectory last: the formal sigma of the
    paper's scenarios do not tell."""
    if tie_planes.rays.time is None:
        return result
    lasting = trajectory_errors.lasting_sigma(survey, tie_planes, result.boresight)
    seen = result.observability.under(lasting, survey.navigation.attitude_sigma)
    return replace(result, observability=seen)
