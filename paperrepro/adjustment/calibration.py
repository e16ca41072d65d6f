"""One door to all five estimators: SL, A, B, C of the paper and D, ours."""

from dataclasses import replace

from paperrepro.adjustment import scenarios, trajectory
from paperrepro.adjustment.matched import MatchedFaces, require_shared
from paperrepro.adjustment.result import CalibrationResult
from paperrepro.adjustment.screening import screen
from paperrepro.errors import BadInput
from paperrepro.survey import Survey

PAPER_SCENARIOS = tuple(scenarios.SCENARIOS)
SCENARIO_NAMES = (*PAPER_SCENARIOS, "D")


def calibrate(
    survey: Survey,
    matched: MatchedFaces,
    scenario: str,
    robust: bool = True,
    found: trajectory.FoundNoise | None = None,
    lever_arm: bool = False,
) -> CalibrationResult:
    """Estimate the boresight by ``scenario``, from ``survey.mounting``'s as start.

    ``robust``: faces that miss their plane are left out first, and reported (`screening`).
    Scenario D takes the noise as specified or as ``found`` in the data; ``lever_arm``: it estimates
    it, which the others hold. `Observability.undetermined` names the angles that the flight does not
    determine, whatever sigma the scenario has for them. Raises `BadInput` for an unknown scenario,
    `TooFewPlanes`, `RankDefect`, `NoConvergence`.
    """
    if scenario not in SCENARIO_NAMES:
        raise BadInput(
            f"scenario {scenario!r}: expected one of {', '.join(SCENARIO_NAMES)}; name one of them"
        )
    require_shared(matched)
    rejected, near = (), None
    if robust:
        screening = screen(survey, matched)
        rejected, near = screening.rejected, screening.boresight
        matched = matched.subset(screening.kept) if rejected else matched
    if scenario == "D":
        result = trajectory.calibrate_with_trajectory(
            survey, matched, found=found, near=near, lever_arm=lever_arm
        )
    else:
        result = _judged(survey, matched, scenarios.calibrate(survey, matched, scenario, near))
    return replace(result, rejected=rejected)


def _judged(survey: Survey, matched: MatchedFaces, result: CalibrationResult) -> CalibrationResult:
    """With what its flight determines once errors of the trajectory last: the formal sigma of the
    paper's scenarios do not tell."""
    if matched.rays.time is None:
        return result
    lasting = trajectory.lasting_sigma(survey, matched, result.boresight)
    seen = result.observability.under(lasting, survey.navigation.attitude_sigma)
    return replace(result, observability=seen)
