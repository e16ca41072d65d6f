"""Everything measured of one simulated survey, as tidy rows: what the ledger and the sweeps read.

The truth comes in as plain numbers and one callable, so nothing here knows the simulator.

Rows of what is measured of one survey, a function per theme.

One face matched to a plane that is not its own: what an estimator must survive.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from paperrepro.errors import PaperReproError, TooFewPlanes
from paperrepro.frames import boresight_matrix
from paperrepro.method import Candidates, refine_all
from paperrepro.method.accuracy import (
    Distribution,
    ReferencePlanes,
    point_to_plane,
    reference_planes,
    reference_roofs,
    rmse,
    vertical_offsets,
    virtual_points,
)
from paperrepro.method.adjustment.calibrate import PAPER_SCENARIOS, SCENARIO_NAMES, calibrate
from paperrepro.method.adjustment.quality import TrueNoise, cramer_rao_bound
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.adjustment.trajectory_equations import AXES
from paperrepro.method.coarse_to_fine import (
    PlaneSurvey,
    find_candidates,
    find_roofs,
)
from paperrepro.method.georeference import georeference
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.study.rows import ANGLES, SurveyKey
from paperrepro.survey import Mounting, Rays, Survey

ARTEFACT = "study"
#: Density falls from the track outwards; this quantile of the square metres is near the track.
CREST = 0.9
#: Scenario of the Cramer-Rao bound's rows.
BOUND = "bound"


@dataclass(frozen=True)
class Known:
    """The truth that measuring needs: the true ``mounting``; ``judge``, which gives for the views
    of a `PlaneSurvey` (strip, indices) the label (F,) of each and the true plane (F, 4); the
    ``noise``, or None where there is no bound to compute. Of ``thinning`` pulses the survey holds
    one."""

    mounting: Mounting
    judge: Callable[[list[tuple[str, np.ndarray]]], tuple[np.ndarray, np.ndarray]]
    noise: TrueNoise | None = None
    thinning: int = 1


def survey_rows(run: SurveyKey, known: Known, survey: Survey) -> list[dict]:
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


def matching_rows(run: SurveyKey, known: Known, found: PlaneSurvey) -> list[dict]:
    label, _ = known.judge(found.views)
    one, other = label[found.tie_planes.pairs].T
    return [
        run.row(ARTEFACT, "all", "planes", "1", found.tie_planes.n_planes),
        run.row(ARTEFACT, "all", "pairs", "1", len(one)),
        run.row(ARTEFACT, "all", "views", "1", len(label)),
        run.row(ARTEFACT, "all", "points", "1", len(found.tie_planes.rays)),
        run.row(ARTEFACT, "all", "false_pairs", "1", ((one != other) | (one < 0)).sum()),
        run.row(ARTEFACT, "all", "rejected", "1", len(found.rejected)),
    ]


def angle_rows(
    run: SurveyKey, name: str, result: CalibrationResult, truth: np.ndarray
) -> list[dict]:
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


def error_rows(run: SurveyKey, name: str, error: np.ndarray, sigma=(np.nan,) * 3) -> list[dict]:
    return [
        run.row(ARTEFACT, name, f"error_{angle}", "deg", np.rad2deg(e), np.rad2deg(s))
        for angle, e, s in zip(ANGLES, error, sigma, strict=True)
    ]


def bound_rows(run: SurveyKey, known: Known, survey: Survey, found: PlaneSurvey) -> list[dict]:
    """The Cramer-Rao bound of each angle, as a standard deviation."""
    if known.noise is None:
        return []
    bound = cramer_rao_bound(survey, found.tie_planes, known.mounting, known.noise)
    return [
        run.row(ARTEFACT, BOUND, f"bound_{angle}", "deg", np.rad2deg(sigma))
        for angle, sigma in zip(ANGLES, np.sqrt(np.diag(bound)), strict=True)
    ]


def accuracy_rows(
    run: SurveyKey, known: Known, found: PlaneSurvey,
    mountings: dict[str, Mounting], survey: Survey,
) -> list[dict]:  # fmt: skip
    """RMSE, distributions and vertical offsets of every mounting, by truth and by the reference."""
    _, planes = known.judge(found.views)
    first = np.searchsorted(found.tie_planes.plane, np.arange(found.tie_planes.n_planes))
    references = {"truth": ReferencePlanes(planes[first])}
    references["reference"] = reference_planes(found, reference_roofs(survey.reference))
    rows = []
    for name, mounting in mountings.items():
        corners = virtual_points(found, mounting)
        for against, reference in references.items():
            distances = point_to_plane(found.tie_planes, mounting, reference)
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


#: Faces more inclined to each other than this would not be taken for one another.
MOST_BETWEEN_DEG = 10.0


def with_wrong_match(tie_planes: TiePlanes, mounting: Mounting) -> TiePlanes:
    """``tie_planes`` with the likeliest mistake: of all faces that could be taken for a view of
    another plane, alike inclined and unseen there by their strip, the one nearest to its centroid.

    Only faces of planes with at least three views move, so no plane is lost. Raises `TooFewPlanes`
    where no such face exists.
    """
    face, plane = _likeliest(tie_planes, mounting)
    planes = [list(np.flatnonzero(tie_planes.plane == g)) for g in range(tie_planes.n_planes)]
    planes[tie_planes.plane[face]].remove(face)
    pairs = [tuple(pair) for pair in tie_planes.pairs if face not in pair]
    pairs += [(other, face) for other in planes[plane]]
    planes[plane].append(face)
    rays = [tie_planes.rays.take(slice(first, last)) for first, last in tie_planes.ranges]
    return TiePlanes.build(rays, list(tie_planes.strips), planes, pairs)


def _likeliest(tie_planes: TiePlanes, mounting: Mounting) -> tuple[int, int]:
    """The face to be moved, and the plane that it is moved to."""
    faces, planes = tie_planes.states(mounting), tie_planes.plane_states(mounting)
    away = np.linalg.norm(faces.centroid[:, None] - planes.centroid[None], axis=2)
    alike = np.abs(faces.plane[:, :3] @ planes.plane[:, :3].T)
    away[alike < np.cos(np.deg2rad(MOST_BETWEEN_DEG))] = np.inf
    away[np.bincount(tie_planes.plane)[tie_planes.plane] < 3] = np.inf
    for face, strip in enumerate(tie_planes.strips):
        seen = [p for p, s in zip(tie_planes.plane, tie_planes.strips, strict=True) if s == strip]
        away[face, seen] = np.inf
    if not np.isfinite(away).any():
        raise TooFewPlanes(
            "expected two planes alike within "
            f"{MOST_BETWEEN_DEG:g} deg of which a strip sees only one, got none among "
            f"{tie_planes.n_planes}; fly over more roofs"
        )
    face, plane = np.unravel_index(away.argmin(), away.shape)
    return int(face), int(plane)


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
    run: SurveyKey,
    scenarios: Sequence[str] = SCENARIO_NAMES,
    depth: Depth = Depth(),
) -> list[dict]:
    """Rows of one survey: calibrated by every scenario from its own segmentation and matching.

    A scenario that cannot be calibrated is a row of metric ``failed``.
    """
    points = find_candidates(survey)
    found = find_roofs(survey, points)
    truth = known.mounting.boresight
    rows = [*survey_rows(run, known, survey), *matching_rows(run, known, found)]
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
        rows += accuracy_rows(run, known, found, mountings, survey)
    return rows


def _calibrated(
    rows: list[dict],
    run: SurveyKey,
    survey: Survey,
    found: PlaneSurvey,
    truth: np.ndarray,
    scenarios,
) -> dict[str, CalibrationResult]:  # fmt: skip
    results = {}
    for name in scenarios:
        result = _attempt(rows, run, name, calibrate, survey, found.tie_planes, name)
        if result is not None:
            rows += angle_rows(run, name, result, truth)
            results[name] = result
    return results


def _refined(
    rows: list[dict], run: SurveyKey, survey: Survey, points: Candidates, truth: np.ndarray, results
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
    run: SurveyKey, survey: Survey, found: PlaneSurvey, truth: np.ndarray, factors: Sequence[float]
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
            rows, run, name, calibrate, replace(survey, navigation=told), found.tie_planes, "D",
            components=True,
        )  # fmt: skip
        if result is not None:
            rows += angle_rows(run, name, result, truth)
            rows += [
                run.row(ARTEFACT, name, f"component_{group}", "1", value)
                for group, value in result.components.items()
            ]
    return rows


def _lever_arm_rows(run: SurveyKey, known: Known, survey: Survey, found: PlaneSurvey) -> list[dict]:
    """Scenario D told a lever arm that is wrong, and asked for it."""
    rows: list[dict] = []
    told = replace(survey.mounting, lever_arm=survey.mounting.lever_arm + WRONG_LEVER_ARM)
    result = _attempt(
        rows, run, LEVER_ARM, calibrate, replace(survey, mounting=told), found.tie_planes, "D",
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


def _attempt(rows: list[dict], run: SurveyKey, name: str, function: Callable, *args, **options):
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
    run: SurveyKey, survey: Survey, found: PlaneSurvey, truth: np.ndarray, scenarios: Sequence[str]
) -> list[dict]:
    """Errors with one wrong match: taken as it is, and screened."""
    rows: list[dict] = []
    tie_planes = _attempt(
        rows, run, "all" + WRONG, with_wrong_match, found.tie_planes, found.mounting
    )
    for name in scenarios if tie_planes is not None else ():
        for ending, robust in {WRONG: False, SCREENED: True}.items():
            if name in PAPER_SCENARIOS:
                result = _attempt(
                    rows, run, name + ending, calibrate, survey, tie_planes, name, robust
                )
                rows += angle_rows(run, name + ending, result, truth) if result else []
    return rows


def simulate_one(run):
    """A survey of the simulated farm, and what its truth tells a measurement."""
    from data_synth import make_config, simulate
    from data_synth.evaluation import judge_views, true_planes
    from paperrepro.study.simulated import Known

    config = make_config(**asdict(run))
    survey, truth = simulate(config)

    def judge(views):
        label = judge_views(survey, truth, views).label
        return label, true_planes(truth, label)

    return survey, Known(truth.mounting, judge, _true_noise(config), config.thinning)


def _true_noise(config):
    """What disturbs the simulated survey, as the Cramer-Rao bound needs it."""
    from data_synth.navigation import ATTITUDE_SIGMA, CORRELATION_TIME, POSITION_SIGMA
    from paperrepro.method.adjustment.quality import TrueNoise
    from paperrepro.method.adjustment.trajectory_equations import GaussMarkov

    sigma = config.noise_scale * np.concatenate([POSITION_SIGMA, ATTITUDE_SIGMA])
    process = GaussMarkov(sigma, np.full(6, CORRELATION_TIME))
    return TrueNoise(process, config.range_offset_sigma_m)
