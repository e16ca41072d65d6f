"""The paper's seven steps in a row, from a survey to a refined boresight (Fig. 3).

A boresight error of a degree makes a roof 18 cm thick within one strip, because the fan of beams
sees it from 10 m apart, and sets opposite strips a metre apart. So the roofs are found in `passes`:
first by the central beams alone with wide thresholds, then by all beams after each adjustment,
until the boresight under which they were found no longer changes.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from paperrepro.adjustment.calibration import calibrate
from paperrepro.adjustment.matched import MatchedFaces, Rejection
from paperrepro.adjustment.refinement import refine
from paperrepro.adjustment.result import CalibrationResult
from paperrepro.adjustment.screening import screen
from paperrepro.georeference import georeference
from paperrepro.matching import FaceKey, FacePair, MatchParameters, match
from paperrepro.passes import Progress, settle, silent
from paperrepro.segmentation.roofs import RoofParameters, Roofs, candidates, extract
from paperrepro.survey import Mounting, Rays, Survey

#: One physical face by its views.
Tie = tuple[FaceKey, ...]

#: The paper's steps, in its order; Fig. 3 is drawn from these names.
STAGES = (
    "LiDAR equation",
    "Outlier removal",
    "Ground filter",
    "Roof planes",
    "Virtual points and matching",
    "Calibration",
    "Refinement",
)


@dataclass(frozen=True)
class PassParameters:
    """One pass over the roofs: beams within ``fan_deg`` of the scanner's equator."""

    roofs: RoofParameters
    matching: MatchParameters
    fan_deg: float

    @classmethod
    def coarse(cls) -> "PassParameters":
        """For boresights wrong by up to 3 degrees: six central beams see a roof 18 cm thick."""
        return cls(RoofParameters.coarse(), MatchParameters.coarse(), fan_deg=3.5)

    @classmethod
    def fine(cls) -> "PassParameters":
        """All beams, Table 2."""
        return cls(RoofParameters.fine(), MatchParameters.fine(), fan_deg=90.0)


@dataclass(frozen=True)
class PipelineParameters:
    """``settled_deg``: change of the boresight, over a fine pass, at which the roofs are final."""

    coarse: PassParameters = field(default_factory=PassParameters.coarse)
    fine: PassParameters = field(default_factory=PassParameters.fine)
    settled_deg: float = 0.02
    max_passes: int = 6
    seed: int = 0


@dataclass(frozen=True)
class Candidates:
    """Points that can lie on a roof, by strip: ``index`` into the strip, and their ``rays``."""

    index: dict[str, np.ndarray]
    rays: dict[str, Rays]


@dataclass(frozen=True)
class RoofSurvey:
    """Roofs found and matched under ``mounting``.

    ``roofs`` by strip, whose face points index the `Candidates` of the beams used, ``in_fan``
    (rings,); ``pairs`` and ``ties`` of the matching; ``matched`` what the adjustment takes, its
    faces in the order of ``keys`` (strip, face number); ``gables`` (K, 2) left and right face in
    that order; ``boresights`` (passes + 1, 3) rad, as the passes went; ``rejected`` faces of the
    last pass, wrong matches that are in ``pairs`` but not in ``ties``.
    """

    mounting: Mounting
    roofs: dict[str, Roofs]
    pairs: tuple[FacePair, ...]
    ties: tuple[Tie, ...]
    matched: MatchedFaces
    keys: tuple[FaceKey, ...]
    gables: np.ndarray
    boresights: np.ndarray
    rejected: tuple[Rejection, ...]
    in_fan: np.ndarray

    def views(self, points: Candidates) -> list[tuple[str, np.ndarray]]:
        """Each matched face as (strip, indices into the strip), in the order of ``keys``."""
        index = {
            strip: index[self.in_fan[points.rays[strip].ring]]
            for strip, index in points.index.items()
        }
        return [
            (strip, index[strip][self.roofs[strip].faces[face].points]) for strip, face in self.keys
        ]


def find_candidates(
    survey: Survey, params: PipelineParameters | None = None, progress: Progress = silent
) -> Candidates:
    """Outlier removal and ground filter of every strip, one strip in memory at a time."""
    params = params or PipelineParameters()
    index, rays = {}, {}
    for strip in survey.strips:
        progress(f"{strip.name}: points above the ground")
        whole = survey.rays(strip)
        index[strip.name] = candidates(georeference(whole, survey.mounting), params.fine.roofs)
        rays[strip.name] = whole.take(index[strip.name])
    return Candidates(index, rays)


def find_roofs(
    survey: Survey,
    points: Candidates,
    params: PipelineParameters | None = None,
    progress: Progress = silent,
) -> RoofSurvey:
    """Roofs of all strips and their matches, from the survey's own mounting as start.

    Raises `TooFewPlanes`, `RankDefect`, `NoConvergence`.
    """
    params = params or PipelineParameters()
    return settle(
        survey,
        lambda mounting, step: roofs_under(survey, points, mounting, step, params.seed),
        (params.coarse, params.fine),
        params.max_passes,
        params.settled_deg,
        progress,
    )


def roofs_under(
    survey: Survey, points: Candidates, mounting: Mounting, step: PassParameters, seed: int = 0
) -> RoofSurvey:
    """One pass: extract and match the roofs as they lie under ``mounting``."""
    in_fan = np.abs(survey.scanner.beam_elevations) <= np.deg2rad(step.fan_deg)
    generators = np.random.default_rng(seed).spawn(len(points.rays))
    roofs, rays = {}, {}
    for (name, all_rays), rng in zip(points.rays.items(), generators, strict=True):
        rays[name] = all_rays.take(in_fan[all_rays.ring]) if not in_fan.all() else all_rays
        roofs[name] = extract(georeference(rays[name], mounting), step.roofs, rng)
    matches = match(roofs, step.matching)
    ties = tuple(tie for tie in matches.tie_planes() if len(tie) > 1)
    matched, keys = _matched_faces(rays, roofs, ties, matches.pairs)
    screening = screen(survey, matched)
    if screening.rejected:
        kept = {key for key, keep in zip(keys, screening.kept, strict=True) if keep}
        ties = tuple(tie for tie in (_only(tie, kept) for tie in ties) if len(tie) > 1)
        matched, keys = _matched_faces(rays, roofs, ties, matches.pairs)
    gables = _gables(roofs, {key: position for position, key in enumerate(keys)})
    found = np.array([mounting.boresight])
    return RoofSurvey(
        mounting,
        roofs,
        matches.pairs,
        ties,
        matched,
        keys,
        gables,
        found,
        screening.rejected,
        in_fan,
    )


def _only(tie: Tie, kept: set[FaceKey]) -> Tie:
    return tuple(key for key in tie if key in kept)


def _matched_faces(
    rays: dict[str, Rays], roofs: dict[str, Roofs], ties: tuple[Tie, ...], pairs
) -> tuple[MatchedFaces, tuple[FaceKey, ...]]:
    """The faces of ``ties`` as the adjustment takes them, and their keys in that order."""
    keys = tuple(key for tie in ties for key in tie)
    number = {key: position for position, key in enumerate(keys)}
    matched = MatchedFaces.build(
        [rays[strip].take(roofs[strip].faces[face].points) for strip, face in keys],
        [strip for strip, _ in keys],
        [[number[key] for key in tie] for tie in ties],
        [
            (number[pair.reference], number[pair.search])
            for pair in pairs
            if pair.reference in number and pair.search in number
        ],
    )
    return matched, keys


def _gables(roofs: dict[str, Roofs], number: dict[FaceKey, int]) -> np.ndarray:
    """(K, 2) matched faces that make a gable, left and right."""
    both = [
        (number[name, gable.left], number[name, gable.right])
        for name, found in roofs.items()
        for gable in found.gables
        if (name, gable.left) in number and (name, gable.right) in number
    ]
    return np.array(both, int).reshape(-1, 2)


def calibrate_all(
    survey: Survey, roofs: RoofSurvey, scenarios: Iterable[str]
) -> dict[str, CalibrationResult]:
    """Every scenario on the same matched faces, from the survey's mounting as start."""
    return {name: calibrate(survey, roofs.matched, name) for name in scenarios}


def refine_all(
    survey: Survey,
    points: Candidates,
    results: dict[str, CalibrationResult],
    params: PipelineParameters | None = None,
) -> dict[str, CalibrationResult]:
    """Section 2.2.5 after each calibration: roofs extracted and matched anew, then Eq. (9)."""
    params = params or PipelineParameters()
    refined = {}
    for name, result in results.items():
        mounting = survey.mounting.with_calibration(result.boresight, result.range_offsets)
        found = roofs_under(survey, points, mounting, params.fine, params.seed)
        refined[name] = refine(survey, found.matched, mounting)
    return refined
