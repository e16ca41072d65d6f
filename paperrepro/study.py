"""Everything measured of one simulated survey, as tidy rows: what the ledger and the sweeps read.

The truth comes in as plain numbers and one callable, so nothing here knows the simulator.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from paperrepro.accuracy import (
    Distribution,
    ReferencePlanes,
    point_to_plane,
    reference_planes,
    reference_roofs,
    rmse,
    vertical_offsets,
    virtual_points,
)
from paperrepro.adjustment.calibration import PAPER_SCENARIOS, SCENARIO_NAMES, calibrate
from paperrepro.adjustment.result import CalibrationResult
from paperrepro.pipeline import Candidates, RoofSurvey, find_candidates, find_roofs, refine_all
from paperrepro.survey import Mounting, Survey
from paperrepro.tables import ANGLES, Run

ARTEFACT = "study"


@dataclass(frozen=True)
class Known:
    """The truth that measuring needs: the true ``mounting``, and ``judge``, which gives for the
    views of a `RoofSurvey` (strip, indices) the label (F,) of each and the true plane (F, 4)."""

    mounting: Mounting
    judge: Callable[[list[tuple[str, np.ndarray]]], tuple[np.ndarray, np.ndarray]]


def measure(
    survey: Survey,
    known: Known,
    run: Run,
    scenarios: Sequence[str] = SCENARIO_NAMES,
    refined: bool = True,
    components: bool = False,
) -> list[dict]:
    """Rows of one survey: calibrated by every scenario from its own segmentation and matching."""  # fmt: skip
    points = find_candidates(survey)
    found = find_roofs(survey, points)
    results = {
        name: calibrate(survey, found.matched, name, components=components and name == "D")
        for name in scenarios
    }
    mountings = {"before": survey.mounting, "truth": known.mounting}
    mountings |= {name: _mounting(survey, result) for name, result in results.items()}
    rows = _matching_rows(run, known, points, found)
    for name, result in results.items():
        rows += _angle_rows(run, name, result, known.mounting.boresight)
    if refined:
        paper = {name: results[name] for name in PAPER_SCENARIOS if name in results}
        for name, result in refine_all(survey, points, paper).items():
            rows += _angle_rows(run, f"{name} refined", result, known.mounting.boresight)
            mountings[f"{name} refined"] = survey.mounting.with_calibration(
                result.boresight, results[name].range_offsets
            )
    return rows + _accuracy_rows(run, known, points, found, mountings, survey)


def _mounting(survey: Survey, result: CalibrationResult) -> Mounting:
    return survey.mounting.with_calibration(result.boresight, result.range_offsets)


def _matching_rows(run: Run, known: Known, points: Candidates, found: RoofSurvey) -> list[dict]:
    label, _ = known.judge(found.views(points))
    one, other = label[found.matched.pairs].T
    return [
        run.row(ARTEFACT, "all", "planes", "1", found.matched.n_planes),
        run.row(ARTEFACT, "all", "pairs", "1", len(one)),
        run.row(ARTEFACT, "all", "false_pairs", "1", ((one != other) | (one < 0)).sum()),
    ]


def _angle_rows(run: Run, name: str, result: CalibrationResult, truth: np.ndarray) -> list[dict]:
    """Errors of the angles with their sigma, and the squared standardised error per angle."""
    error = result.boresight - truth
    rows = [
        run.row(ARTEFACT, name, f"error_{angle}", "deg", np.rad2deg(e), np.rad2deg(s))
        for angle, e, s in zip(ANGLES, error, result.sigma, strict=True)
    ]
    nees = error @ np.linalg.solve(result.covariance[:3, :3], error) / 3
    return [
        *rows,
        run.row(ARTEFACT, name, "nees", "1", nees),
        run.row(ARTEFACT, name, "sigma0", "1", result.sigma0),
    ]


def _accuracy_rows(
    run: Run, known: Known, points: Candidates, found: RoofSurvey,
    mountings: dict[str, Mounting], survey: Survey,
) -> list[dict]:  # fmt: skip
    """RMSE, distributions and vertical offsets of every mounting, by truth and by the reference."""
    _, planes = known.judge(found.views(points))
    first = np.searchsorted(found.matched.plane, np.arange(found.matched.n_planes))
    references = {"truth": ReferencePlanes(planes[first])}
    references["reference"] = reference_planes(found, reference_roofs(survey.reference))
    rows = []
    for name, mounting in mountings.items():
        corners = virtual_points(found, mounting)
        for against, reference in references.items():
            distances = point_to_plane(found.matched, mounting, reference)
            shape = Distribution.of(distances)
            offsets = np.abs(vertical_offsets(corners, reference))
            offsets = offsets[np.isfinite(offsets)]
            values = {
                "rmse": ("m", rmse(distances)), "mean": ("m", shape.mean), "nmad": ("m", shape.nmad),
                "skewness": ("1", shape.skewness), "kurtosis": ("1", shape.kurtosis),
                "ks": ("1", shape.ks), "offset_mean": ("m", offsets.mean()),
                "offset_max": ("m", offsets.max()),
            }  # fmt: skip
            rows += [
                run.row(ARTEFACT, name, f"{metric}_{against}", unit, value)
                for metric, (unit, value) in values.items()
            ]
    return rows
