"""Everything measured of one simulated survey, as tidy rows: what the ledger and the sweeps read.

The truth comes in as plain numbers and one callable, so nothing here knows the simulator.
"""

import time
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
from paperrepro.errors import PaperReproError
from paperrepro.frames import boresight_matrix
from paperrepro.georeference import georeference
from paperrepro.pipeline import Candidates, RoofSurvey, find_candidates, find_roofs, refine_all
from paperrepro.survey import Mounting, Rays, Survey
from paperrepro.tables import ANGLES, Run
from paperrepro.wrong_match import with_wrong_match

ARTEFACT = "study"
#: Metric of a row that stands for what could not be measured; its scenario says where it failed.
FAILED = "failed"
#: Density falls from the track outwards; this quantile of the square metres is near the track.
CREST = 0.9
#: Endings of scenarios' names: after the refinement; with one wrong match, as it is and screened.
REFINED, WRONG, SCREENED = " refined", " wrong", " screened"


@dataclass(frozen=True)
class Known:
    """The truth that measuring needs: the true ``mounting``, and ``judge``, which gives for the
    views of a `RoofSurvey` (strip, indices) the label (F,) of each and the true plane (F, 4).
    Of ``thinning`` pulses the survey holds one."""

    mounting: Mounting
    judge: Callable[[list[tuple[str, np.ndarray]]], tuple[np.ndarray, np.ndarray]]
    thinning: int = 1


def measure(
    survey: Survey,
    known: Known,
    run: Run,
    scenarios: Sequence[str] = SCENARIO_NAMES,
    refined: bool = True,
    components: bool = False,
    wrong: bool = True,
) -> list[dict]:
    """Rows of one survey: calibrated by every scenario from its own segmentation and matching.

    A scenario that cannot be calibrated is a row of metric ``failed``. ``wrong``: the paper's
    scenarios once more, one of their matches being wrong.
    """
    points = find_candidates(survey)
    found = find_roofs(survey, points)
    truth = known.mounting.boresight
    rows = [*_survey_rows(run, known, survey), *_matching_rows(run, known, points, found)]
    rows += _error_rows(run, "before", survey.mounting.boresight - truth)
    mountings = {"before": survey.mounting, "truth": known.mounting}
    for name in scenarios:
        options = {"components": components and name == "D"}
        result = _attempt(rows, run, name, calibrate, survey, found.matched, name, **options)
        if result is None:
            continue
        rows += _angle_rows(run, name, result, truth)
        mountings[name] = survey.mounting.with_calibration(result.boresight, result.range_offsets)
        if refined and name in PAPER_SCENARIOS:
            again = _attempt(rows, run, name + REFINED, refine_all, survey, points, {name: result})
            if again is not None:
                rows += _angle_rows(run, name + REFINED, again[name], truth)
                mountings[name + REFINED] = mountings[name].with_calibration(
                    again[name].boresight, result.range_offsets
                )
    if wrong:
        rows += _wrong_match_rows(run, survey, found, truth, scenarios)
    return rows + _accuracy_rows(run, known, points, found, mountings, survey)


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


def _survey_rows(run: Run, known: Known, survey: Survey) -> list[dict]:
    """Density of a strip with all its pulses, mean and below the track; displacement of its
    points, on average, where the true boresight is put in by the small-angle form I + [w]x instead
    of the rotation."""
    w, rays = known.mounting.boresight, survey.rays(survey.strips[0])
    places = np.floor(georeference(rays, known.mounting)[:, :2])  # cells of 1 m by 1 m
    counts = known.thinning * np.unique(places, axis=0, return_counts=True)[1]
    skew = np.cross(np.eye(3), w)
    wrong_by = boresight_matrix(w, np.eye(3)) - np.eye(3) - skew
    r_b = _in_laser_frame(rays) @ known.mounting.R_nominal.T
    shift = np.linalg.norm(r_b @ wrong_by.T, axis=1).mean()
    return [
        run.row(ARTEFACT, "all", "density", "1/m2", counts.mean()),
        run.row(ARTEFACT, "all", "density_below", "1/m2", np.quantile(counts, CREST)),
        run.row(ARTEFACT, "all", "small_angle_shift", "m", shift),
    ]


def _in_laser_frame(rays: Rays) -> np.ndarray:
    """Eq. (2) with the measured ranges, (N, 3) m."""
    flat = rays.rho * np.cos(rays.elevation)
    return np.column_stack(
        [
            flat * np.cos(rays.azimuth),
            flat * np.sin(rays.azimuth),
            rays.rho * np.sin(rays.elevation),
        ]
    )


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
                rows += _angle_rows(run, name + ending, result, truth) if result else []
    return rows


def _matching_rows(run: Run, known: Known, points: Candidates, found: RoofSurvey) -> list[dict]:
    label, _ = known.judge(found.views(points))
    one, other = label[found.matched.pairs].T
    return [
        run.row(ARTEFACT, "all", "planes", "1", found.matched.n_planes),
        run.row(ARTEFACT, "all", "pairs", "1", len(one)),
        run.row(ARTEFACT, "all", "views", "1", len(label)),
        run.row(ARTEFACT, "all", "points", "1", len(found.matched.rays)),
        run.row(ARTEFACT, "all", "false_pairs", "1", ((one != other) | (one < 0)).sum()),
        run.row(ARTEFACT, "all", "rejected", "1", len(found.rejected)),
    ]


def _angle_rows(run: Run, name: str, result: CalibrationResult, truth: np.ndarray) -> list[dict]:
    """Errors of the angles with their sigma, and the squared standardised error per angle."""
    error = result.boresight - truth
    rows = _error_rows(run, name, error, result.sigma)
    nees = error @ np.linalg.solve(result.covariance[:3, :3], error) / 3
    return [
        *rows,
        run.row(ARTEFACT, name, "nees", "1", nees),
        run.row(ARTEFACT, name, "sigma0", "1", result.sigma0),
        run.row(ARTEFACT, name, "iterations", "1", result.iterations),
    ]


def _error_rows(run: Run, name: str, error: np.ndarray, sigma=(np.nan,) * 3) -> list[dict]:
    return [
        run.row(ARTEFACT, name, f"error_{angle}", "deg", np.rad2deg(e), np.rad2deg(s))
        for angle, e, s in zip(ANGLES, error, sigma, strict=True)
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
                "rmse": ("m", rmse(distances)), "mae": ("m", np.abs(distances).mean()),
                "mean": ("m", shape.mean), "nmad": ("m", shape.nmad),
                "skewness": ("1", shape.skewness), "kurtosis": ("1", shape.kurtosis),
                "ks": ("1", shape.ks), "offset_mean": ("m", offsets.mean()),
                "offset_max": ("m", offsets.max()),
            }  # fmt: skip
            rows += [
                run.row(ARTEFACT, name, f"{metric}_{against}", unit, value)
                for metric, (unit, value) in values.items()
            ]
    return rows
