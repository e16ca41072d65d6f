"""What the paper's estimators make of other material than the survey's tie planes, as tidy rows.

Roofs found anew for the refinement, pairs of strips and planes by themselves, and a gross error of
the matching, put in on purpose: what screening must bear.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from paperrepro.errors import PaperReproError, TooFewPlanes
from paperrepro.frames import ANGLES
from paperrepro.method.adjustment.calibrate import calibrate
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.adjustment.scenarios import by_name, refine, refine_pairs
from paperrepro.method.coarse_to_fine import Candidates, PlaneSurvey, RoofSearch, planes_under
from paperrepro.method.tie_planes import LEAST_PLANES, TiePlanes
from paperrepro.study.rows import (
    ARTEFACT,
    AS_MANY,
    BY_FOUR,
    FAILED,
    FEW,
    LISTED_PAIRS,
    ONE_DIRECTION,
    PER_PAIR,
    REFINED,
    SCREENED,
    TABLE1_PAIRS,
    WRONG,
    SurveyKey,
)
from paperrepro.survey import Mounting, Survey

#: Roofs whose slopes' azimuths agree so far are of one direction.
ALIKE_DEG = 15.0


class Flown(Protocol):
    """A survey, the points that may lie on its roofs, and the roofs found and matched."""

    key: SurveyKey
    survey: Survey
    points: Candidates
    found: PlaneSurvey


#: Faces more inclined to each other than this would not be taken for one another.
MOST_BETWEEN_DEG = 10.0


@dataclass
class SurveyRows:
    """Rows in the making, of a survey whose true ``boresight`` (3,) rad is known."""

    key: SurveyKey
    boresight: np.ndarray
    made: list[dict] = field(default_factory=list)

    def add(self, scenario: str, metric: str, value: float, unit="1", sigma=np.nan) -> None:
        self.made.append(self.key.row(ARTEFACT, scenario, metric, unit, value, sigma))

    def add_errors(self, name: str, error: np.ndarray, sigma=(np.nan,) * 3) -> None:
        """Of the angles, (3,) rad."""
        for angle, *pair in zip(ANGLES, np.rad2deg(error), np.rad2deg(sigma), strict=True):
            self.add(name, f"error_{angle}", pair[0], "deg", pair[1])

    def attempt(self, name: str, function: Callable, *args, **options):
        """What ``function`` gives and a row of its time, or None and a row that it failed."""
        start = time.process_time()
        try:
            result = function(*args, **options)
        except PaperReproError:
            self.add(name, FAILED, 1)
            return None
        self.add(name, "seconds", time.process_time() - start, "s")
        return result

    def add_result(self, name: str, result: CalibrationResult) -> CalibrationResult:
        """Errors with their sigma; the squared standardised error per angle."""
        error = result.boresight - self.boresight
        self.add_errors(name, error, result.sigma)
        self.add(name, "nees", error @ np.linalg.solve(result.covariance[:3, :3], error) / 3)
        self.add(name, "sigma0", result.sigma0)
        self.add(name, "iterations", result.iterations)
        return result

    def calibrated(self, name: str, *args, **options) -> CalibrationResult | None:
        """Rows of `calibrate` with these arguments."""
        result = self.attempt(name, calibrate, *args, **options)
        if result and result.trajectory is None:
            planes = 3 * result.n_planes * by_name(result.scenario).free_planes
            self.add(name, "unknowns", len(result.covariance) + planes)
        return self.add_result(name, result) if result else None


def add_refined(
    rows: SurveyRows, flown: Flown, results, names: Sequence[str]
) -> dict[str, Mounting]:
    """The paper's scenarios after their refinement; their mountings by name."""
    mountings = {}
    for name in (name for name in names if name in results):
        result, ours = results[name], name + REFINED
        again = rows.attempt(ours, _refined, flown, result.calibrated)
        if again is None:
            continue
        planes, refined = again
        rows.add_result(ours, refined)
        mountings[ours] = result.calibrated.with_calibration(
            refined.boresight, result.range_offsets
        )
        if name == FEW["C"]:
            _add_per_pair(rows, flown, planes, result.calibrated)
            four = np.random.default_rng(flown.key.seed).permutation(planes.n_planes)[:LEAST_PLANES]
            four = planes.subset(np.isin(planes.plane, four))
            of_four = rows.attempt(name + BY_FOUR, refine, flown.survey, four, result.calibrated)
            if of_four:
                rows.add_result(name + BY_FOUR, of_four)
    return mountings


def _refined(flown: Flown, calibrated: Mounting) -> tuple[TiePlanes, CalibrationResult]:
    """Roofs extracted and matched anew under a mounting, and what the refinement makes of them."""
    planes = planes_under(flown.survey, flown.points, calibrated, RoofSearch()).tie_planes
    return planes, refine(flown.survey, planes, calibrated)


def _add_per_pair(rows: SurveyRows, flown: Flown, planes: TiePlanes, calibrated: Mounting) -> None:
    """Each pair of strips refined for itself: the mean of their boresights, weighted by each one's
    formal variances; its sigma is the one by which they scatter about it."""
    name = FEW["C"] + PER_PAIR
    results = rows.attempt(name, refine_pairs, flown.survey, planes, calibrated)
    if not results or len(results) < 2:
        return
    each = np.array([result.boresight for result in results.values()])
    weight = np.array([result.sigma for result in results.values()]) ** -2.0
    mean = np.average(each, axis=0, weights=weight)
    scatter = (weight * np.square(each - mean)).sum(axis=0) / (len(each) - 1)
    sigma = np.sqrt(scatter / weight.sum(axis=0))
    rows.add_errors(name, mean - rows.boresight, sigma)
    rows.add(name, "nees", np.mean(np.square((mean - rows.boresight) / sigma)))
    rows.add(name, "strip_pairs", len(each))
    for angle, spread in zip(ANGLES, np.rad2deg(each.std(axis=0)), strict=True):
        rows.add(name, f"spread_{angle}", spread, "deg")


def add_first_steps(rows: SurveyRows, flown: Flown) -> None:
    """How far the first iteration from the mounting to start from is off the last, in sigma of the
    angle that fares worst."""
    for name in (FEW[x] for x in "ABC"):
        try:
            result = calibrate(flown.survey, flown.found.tie_planes, name, robust=False)
        except PaperReproError:
            continue
        off = np.abs(result.first_step - result.boresight) / result.sigma
        rows.add(name, "first_step_in_sigma", off.max())


def add_few_planes(rows: SurveyRows, flown: Flown) -> None:
    """A from Table 1's pairs of strips alone; [11] from roofs of one direction alone, and from as
    many of any."""
    survey, tie_planes = flown.survey, flown.found.tie_planes
    strips = np.array(tie_planes.strips)[tie_planes.pairs]
    listed = [tuple(sorted(pair)) in TABLE1_PAIRS for pair in strips.tolist()]
    few = replace(tie_planes, pairs=tie_planes.pairs[np.array(listed, bool)])
    rows.calibrated(LISTED_PAIRS, survey, few, FEW["A"])
    normal = tie_planes.plane_states(survey.mounting).plane[:, :3]
    azimuth = np.arctan2(normal[:, 1], normal[:, 0])
    apart = np.abs(np.sin(azimuth[:, None] - azimuth))  # the two slopes of a roof are alike
    alike = apart <= np.sin(np.deg2rad(ALIKE_DEG))
    largest = np.flatnonzero(alike[alike.sum(axis=1).argmax()])
    drawn = np.random.default_rng(flown.key.seed).permutation(tie_planes.n_planes)
    for name, planes in {ONE_DIRECTION: largest, AS_MANY: drawn[: len(largest)]}.items():
        rows.add(name, "planes", len(planes))
        if len(planes) < LEAST_PLANES:
            rows.add(name, FAILED, 1)
            continue
        some = tie_planes.subset(np.isin(tie_planes.plane, planes))
        rows.calibrated(name, survey, some, FEW["SL"])


def add_wrong_match(rows: SurveyRows, flown: Flown) -> None:
    """Errors with one wrong match: taken as it is, and screened."""
    found = flown.found
    tie_planes = rows.attempt("all" + WRONG, with_wrong_match, found.tie_planes, found.mounting)
    for name in FEW.values() if tie_planes is not None else ():
        for ending, robust in {WRONG: False, SCREENED: True}.items():
            rows.calibrated(name + ending, flown.survey, tie_planes, name, robust)


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
