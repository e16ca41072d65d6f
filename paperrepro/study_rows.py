"""Rows of what is measured of one survey, a function per theme."""

from collections.abc import Callable
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
from paperrepro.adjustment.cramer_rao import TrueNoise, cramer_rao_bound
from paperrepro.adjustment.result import CalibrationResult
from paperrepro.frames import boresight_matrix
from paperrepro.georeference import georeference
from paperrepro.pipeline import Candidates, RoofSurvey
from paperrepro.survey import Mounting, Rays, Survey
from paperrepro.tables import ANGLES, Run

ARTEFACT = "study"
#: Density falls from the track outwards; this quantile of the square metres is near the track.
CREST = 0.9
#: Scenario of the Cramer-Rao bound's rows.
BOUND = "bound"


@dataclass(frozen=True)
class Known:
    """The truth that measuring needs: the true ``mounting``; ``judge``, which gives for the views
    of a `RoofSurvey` (strip, indices) the label (F,) of each and the true plane (F, 4); the
    ``noise``, or None where there is no bound to compute. Of ``thinning`` pulses the survey holds
    one."""

    mounting: Mounting
    judge: Callable[[list[tuple[str, np.ndarray]]], tuple[np.ndarray, np.ndarray]]
    noise: TrueNoise | None = None
    thinning: int = 1


def survey_rows(run: Run, known: Known, survey: Survey) -> list[dict]:
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


def matching_rows(run: Run, known: Known, points: Candidates, found: RoofSurvey) -> list[dict]:
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


def angle_rows(run: Run, name: str, result: CalibrationResult, truth: np.ndarray) -> list[dict]:
    """Errors of the angles with their sigma, and the squared standardised error per angle."""
    error = result.boresight - truth
    rows = error_rows(run, name, error, result.sigma)
    nees = error @ np.linalg.solve(result.covariance[:3, :3], error) / 3
    return [
        *rows,
        run.row(ARTEFACT, name, "nees", "1", nees),
        run.row(ARTEFACT, name, "sigma0", "1", result.sigma0),
        run.row(ARTEFACT, name, "iterations", "1", result.iterations),
    ]


def error_rows(run: Run, name: str, error: np.ndarray, sigma=(np.nan,) * 3) -> list[dict]:
    return [
        run.row(ARTEFACT, name, f"error_{angle}", "deg", np.rad2deg(e), np.rad2deg(s))
        for angle, e, s in zip(ANGLES, error, sigma, strict=True)
    ]


def bound_rows(run: Run, known: Known, survey: Survey, found: RoofSurvey) -> list[dict]:
    """The Cramer-Rao bound of each angle, as a standard deviation."""
    if known.noise is None:
        return []
    bound = cramer_rao_bound(survey, found.matched, known.mounting, known.noise)
    return [
        run.row(ARTEFACT, BOUND, f"bound_{angle}", "deg", np.rad2deg(sigma))
        for angle, sigma in zip(ANGLES, np.sqrt(np.diag(bound)), strict=True)
    ]


def accuracy_rows(
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
