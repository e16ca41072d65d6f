"""One door to all five estimators: SL, A, B, C of the paper and D, ours."""

from dataclasses import replace

from paperrepro.errors import BadInput
from paperrepro.method.adjustment import scenarios, trajectory_errors
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.adjustment.screening import Screening, screen
from paperrepro.method.tie_planes import TiePlanes, require_shared
from paperrepro.survey import Survey

PAPER_SCENARIOS = tuple(scenarios.SCENARIOS)
SCENARIO_NAMES = (*PAPER_SCENARIOS, "D")


def calibrate(
    survey: Survey,
    tie_planes: TiePlanes,
    scenario: str,
    robust: bool = True,
    found: trajectory_errors.FoundNoise | None = None,
    lever_arm: bool = False,
    screening: Screening | None = None,
) -> CalibrationResult:
    """Estimate the boresight, and what else the scenario asks for, in a Gauss-Helmert adjustment.

    Parameters
    ----------
    survey : Survey
        Its mounting is where the iterations start.
    tie_planes : TiePlanes
        Faces seen by two strips or more, as `find_roofs` leaves them.
    scenario : str
        ``SL`` ([11]), ``A``, ``B``, ``C`` of the paper, or ``D``, ours; with the number of points
        a face that enter, as in ``B 3`` or ``D 40``, a variant of it (`scenarios.by_name`).
    robust : bool
        Faces that miss their plane are left out first, and reported (`screening`).
    found : FoundNoise, optional
        Noise that scenario D takes in place of the specified one, as `find_noise` estimates it.
    lever_arm : bool
        Scenario D estimates the lever arm, which the others hold.
    screening : Screening, optional
        Of the same faces, where it is known already.

    Returns
    -------
    CalibrationResult
        Its `Observability.undetermined` names the angles that the flight does not determine,
        whatever sigma the scenario has for them.

    Raises
    ------
    BadInput, TooFewPlanes, RankDefect, NoConvergence

    References
    ----------
    Section 2.2.4, Eq. (3) to (5) and Table 3 of the paper; Skaloud and Lichti 2006.
    """
    if not (isinstance(survey, Survey) and isinstance(tie_planes, TiePlanes)):
        raise BadInput(
            "calibrate: expected a Survey, its TiePlanes and a scenario, got "
            f"{type(survey).__name__} and {type(tie_planes).__name__}; tie planes are what "
            "find_roofs(survey).tie_planes holds"
        )
    estimator = scenarios.by_name(scenario)
    require_shared(tie_planes)
    rejected, kept, near = (), None, None
    if robust:
        screening = screening or screen(survey, tie_planes)
        rejected, near = screening.rejected, screening.boresight
        if rejected:
            kept = screening.kept
            tie_planes = tie_planes.subset(kept)
    if estimator.trajectory:
        few = tie_planes.thinned(estimator.points) if estimator.points else tie_planes
        result = trajectory_errors.calibrate_with_trajectory(
            survey, few, estimator.range_offsets, found=found, near=near, lever_arm=lever_arm
        )
    else:
        result = _judged(
            survey, tie_planes, scenarios.calibrate(survey, tie_planes, estimator, near)
        )
    return replace(result, scenario=scenario, rejected=rejected, kept=kept)


def _judged(survey: Survey, tie_planes: TiePlanes, result: CalibrationResult) -> CalibrationResult:
    """With what its flight determines once errors of the trajectory last: the formal sigma of the
    paper's scenarios do not tell."""
    if tie_planes.rays.time is None:
        return result
    lasting = trajectory_errors.lasting_sigma(survey, tie_planes, result.boresight)
    seen = result.observability.under(lasting, survey.navigation.attitude_sigma)
    return replace(result, observability=seen)
