"""The paper's seven steps in a row, from a survey to a refined boresight (Fig. 3).

A boresight error of a degree makes a roof 18 cm thick within one strip, because the fan of beams
sees it from 10 m apart, and sets opposite strips a metre apart. So the roofs are found in `passes`:
first by the central beams alone with wide thresholds, then by all beams after each adjustment,
until the boresight under which they were found no longer changes.

Find planes, adjust, find again: passes until the boresight no longer changes.

A boresight error of a degree makes a roof 18 cm thick within one strip and sets opposite strips a
metre apart. Planes are found by wide thresholds first, and by narrow ones once that is mended.

Planes of any kind found in all strips and matched, for flights without gable roofs.

As `pipeline.find_roofs` does with roofs: coarse and with the central beams first, then all beams,
until the boresight under which the patches were found no longer changes.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from paperrepro.errors import NoConvergence, TooFewPlanes
from paperrepro.method.adjustment import scenarios
from paperrepro.method.adjustment.calibrate import calibrate
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.adjustment.scenarios import refine
from paperrepro.method.adjustment.screening import screen
from paperrepro.method.adjustment.trajectory_errors import lasting_sigma
from paperrepro.method.georeference import georeference
from paperrepro.method.matching import FaceKey, FacePair, MatchParameters, match
from paperrepro.method.patches import (
    Patches,
    PatchMatchParameters,
    PatchParameters,
    choose,
    common_footprint,
    find_patches,
    match_patches,
)
from paperrepro.method.roofs import RoofParameters, Roofs, candidates, extract
from paperrepro.method.tie_planes import LEAST_PLANES, Rejection, TiePlanes
from paperrepro.survey import Mounting, Rays, Survey

#: What tells an onlooker how far the work is: it is given a sentence for each step.
Progress = Callable[[str], None]


def silent(words: str) -> None:
    """Tell nobody."""


def settle(
    survey: Survey,
    find: Callable[[Mounting, Any], Any],
    steps: Sequence[Any],
    max_passes: int,
    settled_deg: float | Callable[[Any, np.ndarray], np.ndarray],
    progress: Progress = silent,
) -> Any:
    """What ``find(mounting, step)`` finds under the boresight on which the passes settle.

    One pass for each of ``steps``, the last one repeated until the boresight changes by less than
    ``settled_deg``, a number or a function of what was found and the boresight. What is found is a
    dataclass that has the faces ``tie_planes`` and takes the ``boresights`` (passes + 1, 3) rad, as
    the passes went. Raises `NoConvergence`, and what the adjustment raises.
    """
    mounting, boresights = survey.mounting, [survey.mounting.boresight]
    for number in range(max_passes):
        last = number >= len(steps) - 1
        found = find(mounting, steps[-1] if last else steps[number])
        boresights.append(_boresight(replace(survey, mounting=mounting), found.tie_planes))
        change = np.rad2deg(np.abs(boresights[-1] - boresights[-2]))
        words = f"{found.tie_planes.n_planes} planes, change {change.max():.3f}°"
        progress(f"pass {number + 1}: {words}")
        limit = settled_deg(found, boresights[-1]) if callable(settled_deg) else settled_deg
        if last and (change < limit).all():
            return replace(found, boresights=np.array(boresights))
        mounting = mounting.with_calibration(boresights[-1])
    raise NoConvergence(
        f"the planes did not settle in {max_passes} passes, last change {change.max():.3f} deg "
        f"(limit {np.max(limit):.3f} deg); look for wrong matches, or start closer to the mounting"
    )


def _boresight(survey: Survey, tie_planes: TiePlanes) -> np.ndarray:
    """(3,) rad by SL, without the faces that miss their plane; where coarse planes keep SL from
    converging, that on which the faces agree."""
    screening = screen(survey, tie_planes)
    tie_planes = tie_planes.subset(screening.kept) if screening.rejected else tie_planes
    try:
        return scenarios.calibrate(survey, tie_planes, "SL", screening.boresight).boresight
    except NoConvergence:
        return screening.boresight


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
    (rings,); ``pairs`` and ``ties`` of the matching; ``tie_planes`` what the adjustment takes, its
    faces in the order of ``keys`` (strip, face number); ``gables`` (K, 2) left and right face in
    that order; ``boresights`` (passes + 1, 3) rad, as the passes went; ``rejected`` faces of the
    last pass, wrong matches that are in ``pairs`` but not in ``ties``.
    """

    mounting: Mounting
    roofs: dict[str, Roofs]
    pairs: tuple[FacePair, ...]
    ties: tuple[Tie, ...]
    tie_planes: TiePlanes
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
    ties = tuple(tie for tie in matches.connected_faces() if len(tie) > 1)
    tie_planes, keys = _matched_faces(rays, roofs, ties, matches.pairs)
    screening = screen(survey, tie_planes)
    if screening.rejected:
        kept = {key for key, keep in zip(keys, screening.kept, strict=True) if keep}
        ties = tuple(tie for tie in (_only(tie, kept) for tie in ties) if len(tie) > 1)
        tie_planes, keys = _matched_faces(rays, roofs, ties, matches.pairs)
    gables = _gables(roofs, {key: position for position, key in enumerate(keys)})
    found = np.array([mounting.boresight])
    return RoofSurvey(
        mounting,
        roofs,
        matches.pairs,
        ties,
        tie_planes,
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
) -> tuple[TiePlanes, tuple[FaceKey, ...]]:
    """The faces of ``ties`` as the adjustment takes them, and their keys in that order."""
    keys = tuple(key for tie in ties for key in tie)
    number = {key: position for position, key in enumerate(keys)}
    tie_planes = TiePlanes.build(
        [rays[strip].take(roofs[strip].faces[face].points) for strip, face in keys],
        [strip for strip, _ in keys],
        [[number[key] for key in tie] for tie in ties],
        [
            (number[pair.reference], number[pair.search])
            for pair in pairs
            if pair.reference in number and pair.search in number
        ],
    )
    return tie_planes, keys


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
    return {name: calibrate(survey, roofs.tie_planes, name) for name in scenarios}


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
        refined[name] = refine(survey, found.tie_planes, mounting)
    return refined


@dataclass(frozen=True)
class PatchPass:
    """One pass: beams within ``fan_deg`` of the scanner's equator."""

    patches: PatchParameters
    matching: PatchMatchParameters
    fan_deg: float

    @classmethod
    def coarse(cls, tile_m: float) -> "PatchPass":
        """For boresights wrong by up to 3 degrees; see `matching.MatchParameters.coarse`."""
        inclination = max(10.0, 3 * normal_noise_deg(tile_m))
        matching = PatchMatchParameters(3.0, max(tile_m, 3.0), inclination, same_tile=False)
        return cls(PatchParameters.coarse(tile_m), matching, fan_deg=3.5)

    @classmethod
    def fine(cls, tile_m: float) -> "PatchPass":
        """All beams, for a boresight right to 0.2 degrees."""
        inclination = max(3.0, 3 * normal_noise_deg(tile_m))
        matching = PatchMatchParameters(0.3, tile_m, inclination, same_tile=True)
        return cls(PatchParameters.fine(tile_m), matching, fan_deg=90.0)


def normal_noise_deg(tile_m: float, roughness_m: float = 0.03, independent: int = 10) -> float:
    """To what a normal is known whose patch departs from its plane by ``roughness_m`` in so many
    ``independent`` places: 3 degrees at 0.6 m, half a degree at 4 m."""
    return float(np.degrees(roughness_m / np.sqrt(independent) / (tile_m / np.sqrt(12))))


@dataclass(frozen=True)
class PatchSurvey:
    """Patches found and matched under ``mounting``; ``tie_planes`` what the adjustment takes, its
    faces in the order of ``keys``; ``rejected`` faces, wrong matches left out of ``tie_planes``;
    ``found`` patches a strip and ``tied`` places that two strips or more show; ``boresights``
    (passes + 1, 3) rad, as the passes went."""

    mounting: Mounting
    tie_planes: TiePlanes
    keys: tuple[FaceKey, ...]
    rejected: tuple[Rejection, ...]
    found: dict[str, int]
    tied: int
    boresights: np.ndarray


#: Most points of a strip that are looked at, of a face that are adjusted, and planes.
MOST_POINTS, MOST_OF_FACE, MOST_PLANES = 400_000, 400, 200
#: Edge of a patch: at most so many metres, at least so many, and so many patches in a strip. The
#: fewest points that a patch of a strip should have sets a limit from below, too.
TILE_M, TILES_PER_STRIP, POINTS_PER_TILE = (0.6, 4.0), 200, 100
#: The passes end when the boresight changes by less, in degrees or in its standard deviations, or
#: when there were too many.
SETTLED_DEG, SETTLED_SIGMAS, MAX_PASSES = 0.02, 0.5, 12


def sample_rays(survey: Survey, seed: int = 0) -> dict[str, Rays]:
    """At most `MOST_POINTS` rays of each strip, drawn at random, in their order."""
    generators = np.random.default_rng(seed).spawn(len(survey.strips))
    samples = {}
    for strip, rng in zip(survey.strips, generators, strict=True):
        index = slice(None)
        if len(strip) > MOST_POINTS:
            index = np.sort(rng.choice(len(strip), MOST_POINTS, replace=False))
        samples[strip.name] = survey.rays(strip, index)
    return samples


def tile_size(samples: dict[str, Rays], mounting: Mounting) -> float:
    """Edge of the patches, m, that suits the extent and the density of the strips."""
    edges = []
    for rays in samples.values():
        cell = np.unique(np.floor(georeference(rays, mounting)[:, :2]).astype(int), axis=0)
        density = len(rays) / len(cell)  # points a square metre
        edges.append(max(np.sqrt(len(cell) / TILES_PER_STRIP), np.sqrt(POINTS_PER_TILE / density)))
    return float(np.clip(np.median(edges), *TILE_M))


def find_planes(survey: Survey, settled: bool = False, progress: Progress = silent) -> PatchSurvey:
    """Planar patches of all strips and their matches, from the survey's own mounting as start.

    ``settled``: that mounting is right to 0.2 degrees already. Raises `TooFewPlanes`,
    `RankDefect`, `NoConvergence`.
    """
    samples = sample_rays(survey)
    tile_m = tile_size(samples, survey.mounting)
    fine = PatchPass.fine(tile_m)
    return settle(
        survey,
        lambda mounting, step: planes_under(survey, samples, mounting, step),
        [fine] if settled else [PatchPass.coarse(tile_m), fine],
        MAX_PASSES,
        lambda found, x: _settled_deg(survey, found.tie_planes, x),
        progress,
    )


def _settled_deg(survey: Survey, tie_planes: TiePlanes, boresight: np.ndarray) -> np.ndarray:
    """Change (3,) deg of an angle that does not matter: small, or small against its sigma. Where a
    flight hardly determines an angle, each pass draws another one."""
    sigma = np.rad2deg(lasting_sigma(survey, tie_planes, boresight))
    return np.maximum(SETTLED_DEG, SETTLED_SIGMAS * sigma)


def planes_under(
    survey: Survey, samples: dict[str, Rays], mounting: Mounting, step: PatchPass
) -> PatchSurvey:
    """One pass: patches found and matched as they lie under ``mounting``."""
    in_fan = np.abs(survey.scanner.beam_elevations) <= np.deg2rad(step.fan_deg)
    rays = {name: r if in_fan.all() else r.take(in_fan[r.ring]) for name, r in samples.items()}
    p_m = {name: georeference(r, mounting) for name, r in rays.items()}
    patches = {name: find_patches(p, step.patches) for name, p in p_m.items()}
    ties = match_patches(patches, step.matching)
    found = {name: len(of_strip) for name, of_strip in patches.items()}
    if len(ties) < LEAST_PLANES:
        counts = ", ".join(f"{name} {count}" for name, count in found.items())
        raise TooFewPlanes(
            f"expected at least {LEAST_PLANES} planar patches that two strips share, got "
            f"{len(ties)}; patches per strip: {counts}; give strips that overlap, over ground, "
            "roofs or walls, or start from a boresight closer to the truth"
        )
    chosen = _chosen(ties, patches)
    tie_planes, keys = _matched(rays, p_m, patches, chosen, step)
    screening = screen(replace(survey, mounting=mounting), tie_planes)
    if screening.rejected:
        keys = _surviving(tie_planes, keys, screening.kept)
        tie_planes = tie_planes.subset(screening.kept)
    return PatchSurvey(
        mounting, tie_planes, tuple(keys), screening.rejected, found, len(ties),
        np.array([mounting.boresight]),
    )  # fmt: skip


def _chosen(ties, patches: dict[str, Patches]) -> list[tuple[FaceKey, ...]]:
    """At most `MOST_PLANES` of the places, of varied direction and spread out."""
    first = [(patches[strip], number) for (strip, number), *_ in ties]
    normal = np.array([of.normal[number] for of, number in first])
    centroid = np.array([of.centroid[number] for of, number in first])
    views = np.array([len(tie) for tie in ties])
    return [ties[k] for k in choose(normal, centroid, views, MOST_PLANES)]


def _matched(rays, p_m, patches, ties, step: PatchPass) -> tuple[TiePlanes, list[FaceKey]]:
    """The patches of ``ties`` as the adjustment takes them, and their keys in that order."""
    faces, keys, planes = [], [], []
    for tie in ties:
        views = [(key, index) for key, index in _views(tie, p_m, patches, step) if len(index)]
        if len(views) > 1:
            planes.append(list(range(len(keys), len(keys) + len(views))))
            keys += [key for key, _ in views]
            faces += [rays[strip].take(index) for (strip, _), index in views]
    pairs = [(a, b) for plane in planes for k, a in enumerate(plane) for b in plane[k + 1 :]]
    return TiePlanes.build(faces, [strip for strip, _ in keys], planes, pairs), keys


def _views(tie, p_m, patches: dict[str, Patches], step: PatchPass):
    """Each key of ``tie`` with its points, at most `MOST_OF_FACE`; none for a view that shows too
    little of the place."""
    members = [patches[strip].members(number) for strip, number in tie]
    if step.matching.same_tile:
        axis = int(patches[tie[0][0]].tile[tie[0][1], 0])
        seen = [p_m[strip][index] for (strip, _), index in zip(tie, members, strict=True)]
        masks = common_footprint(seen, axis, step.patches.tile_m)
        members = [index[mask] for index, mask in zip(members, masks, strict=True)]
    for key, index in zip(tie, members, strict=True):
        enough = len(index) >= step.patches.min_points // 2
        yield key, _evenly(index, MOST_OF_FACE) if enough else index[:0]


def _evenly(index: np.ndarray, most: int) -> np.ndarray:
    return index[np.linspace(0, len(index) - 1, min(most, len(index))).astype(int)]


def _surviving(tie_planes: TiePlanes, keys: list[FaceKey], kept: np.ndarray) -> list[FaceKey]:
    """Keys of the faces that `TiePlanes.subset` keeps."""
    views = np.bincount(tie_planes.plane[kept], minlength=tie_planes.n_planes)
    kept = kept & (views > 1)[tie_planes.plane]
    return [key for key, keep in zip(keys, kept, strict=True) if keep]
