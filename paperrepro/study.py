"""Everything measured of one simulated survey, as tidy rows: what the ledger and the sweeps read.

The truth comes in as plain numbers and one callable, so nothing here knows the simulator.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from paperrepro.adjustment.calibration import PAPER_SCENARIOS, SCENARIO_NAMES, calibrate
from paperrepro.adjustment.lever_arm import AXES
from paperrepro.adjustment.result import CalibrationResult
from paperrepro.errors import PaperReproError
from paperrepro.pipeline import Candidates, RoofSurvey, find_candidates, find_roofs, refine_all
from paperrepro.study_rows import (
    ARTEFACT,
    Known,
    accuracy_rows,
    angle_rows,
    bound_rows,
    error_rows,
    matching_rows,
    survey_rows,
)
from paperrepro.survey import Mounting, Survey
from paperrepro.tables import Run
from paperrepro.wrong_match import with_wrong_match

#: Metric of a row that stands for what could not be measured; its scenario says where it failed.
FAILED = "failed"
#: Endings of scenarios' names: after the refinement; with one wrong match, as it is and screened.
REFINED, WRONG, SCREENED = " refined", " wrong", " screened"
#: Scenario D with the lever arm as an unknown, and by how much the one it is told is wrong, m.
LEVER_ARM, WRONG_LEVER_ARM = "D lever arm", np.array([0.03, -0.03, 0.03])


def mistaken_name(factor: float) -> str:
    """Scenario D with a specification of the GNSS/INS that is wrong by ``factor``."""
    return f"D prior x{factor:g}"


@dataclass(frozen=True)
class Depth:
    """What is measured of a survey beside the calibration by all scenarios: the ``refined`` ones
    of the paper, their answer to a ``wrong`` match, the ``accuracy`` of all points, the
    ``lever_arm`` by scenario D; and D once more for each factor of ``mistaken`` by which its prior
    is wrong, variance components being estimated."""

    refined: bool = True
    wrong: bool = True
    accuracy: bool = True
    lever_arm: bool = True
    mistaken: tuple[float, ...] = ()


#: Boresight and sigma alone.
ANGLES_ONLY = Depth(refined=False, wrong=False, accuracy=False, lever_arm=False)


def measure(
    survey: Survey,
    known: Known,
    run: Run,
    scenarios: Sequence[str] = SCENARIO_NAMES,
    depth: Depth = Depth(),
) -> list[dict]:
    """Rows of one survey: calibrated by every scenario from its own segmentation and matching.

    A scenario that cannot be calibrated is a row of metric ``failed``.
    """
    points = find_candidates(survey)
    found = find_roofs(survey, points)
    truth = known.mounting.boresight
    rows = [*survey_rows(run, known, survey), *matching_rows(run, known, points, found)]
    rows += error_rows(run, "before", survey.mounting.boresight - truth)
    results = _calibrated(rows, run, survey, found, truth, scenarios)
    mountings = {"before": survey.mounting, "truth": known.mounting}
    mountings |= {name: result.calibrated for name, result in results.items()}
    if depth.refined:
        mountings |= _refined(rows, run, survey, points, truth, results)
    rows += _mistaken_rows(run, survey, found, truth, depth.mistaken)
    rows += bound_rows(run, known, survey, found)
    if depth.lever_arm:
        rows += _lever_arm_rows(run, known, survey, found)
    if depth.wrong:
        rows += _wrong_match_rows(run, survey, found, truth, scenarios)
    if depth.accuracy:
        rows += accuracy_rows(run, known, points, found, mountings, survey)
    return rows


def _calibrated(
    rows: list[dict], run: Run, survey: Survey, found: RoofSurvey, truth: np.ndarray, scenarios
) -> dict[str, CalibrationResult]:
    results = {}
    for name in scenarios:
        result = _attempt(rows, run, name, calibrate, survey, found.matched, name)
        if result is not None:
            rows += angle_rows(run, name, result, truth)
            results[name] = result
    return results


def _refined(
    rows: list[dict], run: Run, survey: Survey, points: Candidates, truth: np.ndarray, results
) -> dict[str, Mounting]:
    """Rows, and mountings by name, of the paper's scenarios after their refinement."""
    mountings = {}
    for name in (name for name in results if name in PAPER_SCENARIOS):
        result, ours = results[name], name + REFINED
        again = _attempt(rows, run, ours, refine_all, survey, points, {name: result})
        if again is not None:
            rows += angle_rows(run, ours, again[name], truth)
            mountings[ours] = result.calibrated.with_calibration(
                again[name].boresight, result.range_offsets
            )
    return mountings


def _mistaken_rows(
    run: Run, survey: Survey, found: RoofSurvey, truth: np.ndarray, factors: Sequence[float]
) -> list[dict]:
    """Scenario D told a GNSS/INS specification that is wrong by each of ``factors``."""
    rows: list[dict] = []
    for factor in factors:
        told, name = survey.navigation, mistaken_name(factor)
        told = replace(
            told,
            position_sigma=factor * told.position_sigma,
            attitude_sigma=factor * told.attitude_sigma,
        )
        result = _attempt(
            rows, run, name, calibrate, replace(survey, navigation=told), found.matched, "D",
            components=True,
        )  # fmt: skip
        if result is not None:
            rows += angle_rows(run, name, result, truth)
            rows += [
                run.row(ARTEFACT, name, f"component_{group}", "1", value)
                for group, value in result.components.items()
            ]
    return rows


def _lever_arm_rows(run: Run, known: Known, survey: Survey, found: RoofSurvey) -> list[dict]:
    """Scenario D told a lever arm that is wrong, and asked for it."""
    rows: list[dict] = []
    told = replace(survey.mounting, lever_arm=survey.mounting.lever_arm + WRONG_LEVER_ARM)
    result = _attempt(
        rows, run, LEVER_ARM, calibrate, replace(survey, mounting=told), found.matched, "D",
        lever_arm=True,
    )  # fmt: skip
    if result is not None:
        rows += angle_rows(run, LEVER_ARM, result, known.mounting.boresight)
        error = result.lever_arm.value - known.mounting.lever_arm
        rows += [
            run.row(ARTEFACT, LEVER_ARM, f"error_{axis}", "m", e, s)
            for axis, e, s in zip(AXES, error, result.lever_arm.sigma, strict=True)
        ]
    return rows


def _attempt(rows: list[dict], run: Run, name: str, function: Callable, *args, **options):
    """What ``function`` gives, or None and a row in ``rows`` that says that ``name`` failed."""
    start = time.process_time()
    try:
        result = function(*args, **options)
    except PaperReproError:
        rows.append(run.row(ARTEFACT, name, FAILED, "1", 1))
        return None
    rows.append(run.row(ARTEFACT, name, "seconds", "s", time.process_time() - start))
    return result


def _wrong_match_rows(
    run: Run, survey: Survey, found: RoofSurvey, truth: np.ndarray, scenarios: Sequence[str]
) -> list[dict]:
    """Errors with one wrong match: taken as it is, and screened."""
    rows: list[dict] = []
    matched = _attempt(rows, run, "all" + WRONG, with_wrong_match, found.matched, found.mounting)
    for name in scenarios if matched is not None else ():
        for ending, robust in {WRONG: False, SCREENED: True}.items():
            if name in PAPER_SCENARIOS:
                result = _attempt(
                    rows, run, name + ending, calibrate, survey, matched, name, robust
                )
                rows += angle_rows(run, name + ending, result, truth) if result else []
    return rows
