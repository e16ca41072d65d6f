"""Steps 4 and 5 again until the boresight settles: one search, for roofs or planes of any kind.

A boresight error of a degree makes a roof 18 cm thick within one strip, because the fan of beams
sees it from 10 m apart, and sets opposite strips a metre apart. So planes are found by the central
beams and wide thresholds first, then by all beams and narrow ones after each adjustment, until the
boresight under which they were found no longer changes.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Protocol

import numpy as np

from paperrepro.errors import NoConvergence, TooFewPlanes
from paperrepro.method.adjustment import scenarios
from paperrepro.method.adjustment.screening import screen
from paperrepro.method.adjustment.trajectory_errors import lasting_sigma
from paperrepro.method.georeference import georeference
from paperrepro.method.matching import FaceKey, FacePair, MatchParameters, match
from paperrepro.method.patches import (
    Patches,
    PatchMatchParameters,
    PatchParameters,
    choose,
    find_patches,
    match_patches,
    seen_by_all,
)
from paperrepro.method.roofs import RoofParameters, Roofs, candidates, extract
from paperrepro.method.tie_planes import LEAST_PLANES, Rejection, TiePlanes
from paperrepro.survey import Mounting, Rays, Survey

#: One physical face by its views.
Tie = tuple[FaceKey, ...]
#: The views of one physical face, each with indices into the points it was found among.
TieViews = list[tuple[FaceKey, np.ndarray]]
#: Called with a sentence for each step.
Progress = Callable[[str], None]

#: The estimator between two passes: [11] without range offsets, which move no face far.
FOR_SEARCH = "SL without offsets"
#: Most points of a strip that are looked at for planes of any kind, of a face that are adjusted,
#: and planes.
MOST_POINTS, MOST_OF_FACE, MOST_PLANES = 400_000, 400, 200
#: Edge of a patch: at most so many metres, at least so many, and so many patches in a strip. The
#: fewest points that a patch of a strip should have sets a limit from below, too.
TILE_M, TILES_PER_STRIP, POINTS_PER_TILE = (0.6, 4.0), 200, 100


def silent(words: str) -> None:
    """No progress is shown."""


@dataclass(frozen=True)
class Candidates:
    """Points among which planes are sought, by strip: ``index`` (K,) into the strip, and their
    ``rays``."""

    index: dict[str, np.ndarray]
    rays: dict[str, Rays]


class Search(Protocol):
    """How planes are found and matched under a given mounting, by beams within ``fan_deg`` of the
    scanner's equator; ``max_passes`` of it at most."""

    fan_deg: float
    max_passes: int

    def find(self, p_m: np.ndarray, rng: np.random.Generator):
        """Planes of one strip, among points (N, 3) m."""

    def match(self, found: dict) -> tuple[Sequence[Tie], Sequence[FacePair]]:
        """Physical faces, and the pairs of views of which they are made."""

    def views(self, tie: Tie, found: dict, p_m: dict[str, np.ndarray]) -> TieViews:
        """Points of each view of a physical face."""

    def tolerance_deg(self, survey: Survey, planes: TiePlanes, boresight: np.ndarray):
        """Change of the boresight, a number or (3,), at which the planes are final."""


@dataclass(frozen=True)
class RoofSearch:
    """Gable roofs, section 2.2.2, matched by their virtual points, section 2.2.4."""

    roofs: RoofParameters = field(default_factory=RoofParameters)
    matching: MatchParameters = field(default_factory=MatchParameters.fine)
    fan_deg: float = 90.0
    settled_deg: float = 0.02
    max_passes: int = 6

    def coarse(self) -> "RoofSearch":
        """The same for boresights wrong by up to 3 degrees: six central beams see a roof 18 cm
        thick."""
        coarse = self.roofs.coarse(), MatchParameters.coarse()
        return replace(self, roofs=coarse[0], matching=coarse[1], fan_deg=3.5)

    def find(self, p_m: np.ndarray, rng: np.random.Generator) -> Roofs:
        return extract(p_m, self.roofs, rng)

    def match(self, found: dict[str, Roofs]):
        matches = match(found, self.matching)
        return matches.connected_faces(), matches.pairs

    def views(self, tie: Tie, found: dict[str, Roofs], p_m: dict[str, np.ndarray]) -> TieViews:
        return [((strip, face), found[strip].faces[face].points) for strip, face in tie]

    def tolerance_deg(self, survey: Survey, planes: TiePlanes, boresight: np.ndarray) -> float:
        return self.settled_deg


@dataclass(frozen=True)
class PatchSearch:
    """Planar patches of any kind; ``settled_sigmas``: what an angle may change by in its sigma."""

    patches: PatchParameters
    matching: PatchMatchParameters
    fan_deg: float
    settled_deg: float = 0.02
    settled_sigmas: float = 0.5
    max_passes: int = 12

    @classmethod
    def coarse(cls, tile_m: float) -> "PatchSearch":
        """For boresights wrong by up to 3 degrees; see `matching.MatchParameters.coarse`."""
        inclination = max(10.0, 3 * normal_noise_deg(tile_m))
        matching = PatchMatchParameters(3.0, max(tile_m, 3.0), inclination, same_tile=False)
        return cls(PatchParameters.coarse(tile_m), matching, fan_deg=3.5)

    @classmethod
    def fine(cls, tile_m: float) -> "PatchSearch":
        """All beams, for a boresight right to 0.2 degrees."""
        inclination = max(3.0, 3 * normal_noise_deg(tile_m))
        matching = PatchMatchParameters(0.3, tile_m, inclination, same_tile=True)
        return cls(PatchParameters.fine(tile_m), matching, fan_deg=90.0)

    def find(self, p_m: np.ndarray, rng: np.random.Generator) -> Patches:
        return find_patches(p_m, self.patches)

    def match(self, found: dict[str, Patches]):
        """At most `MOST_PLANES` places, of varied direction and spread out. Raises
        `TooFewPlanes`."""
        ties = match_patches(found, self.matching)
        if len(ties) < LEAST_PLANES:
            counts = ", ".join(f"{name} {len(patches)}" for name, patches in found.items())
            raise TooFewPlanes(
                f"expected at least {LEAST_PLANES} planar patches that two strips share, got "
                f"{len(ties)}; patches per strip: {counts}; give strips that overlap, over ground, "
                "roofs or walls, or start from a boresight closer to the truth"
            )
        first = [(found[strip], number) for (strip, number), *_ in ties]
        normal = np.array([of.normal[number] for of, number in first])
        centroid = np.array([of.centroid[number] for of, number in first])
        views = np.array([len(tie) for tie in ties])
        chosen = [ties[k] for k in choose(normal, centroid, views, MOST_PLANES)]
        return chosen, [FacePair(*pair) for tie in chosen for pair in combinations(tie, 2)]

    def views(self, tie: Tie, found: dict[str, Patches], p_m: dict[str, np.ndarray]) -> TieViews:
        """At most `MOST_OF_FACE` points of each; none of a view that shows too little."""
        members = [found[strip].members(number) for strip, number in tie]
        if self.matching.same_tile:
            axis = int(found[tie[0][0]].tile[tie[0][1], 0])
            members = seen_by_all(members, [p_m[s] for s, _ in tie], axis, self.patches.tile_m)
        enough = self.patches.min_points // 2
        return [
            (key, _evenly(index, MOST_OF_FACE))
            for key, index in zip(tie, members, strict=True)
            if len(index) >= enough
        ]

    def tolerance_deg(self, survey: Survey, planes: TiePlanes, boresight: np.ndarray) -> np.ndarray:
        """Where a flight hardly determines an angle, each pass draws another one."""
        sigma = np.rad2deg(lasting_sigma(survey, planes, boresight))
        return np.maximum(self.settled_deg, self.settled_sigmas * sigma)


def normal_noise_deg(tile_m: float, roughness_m: float = 0.03, independent: int = 10) -> float:
    """To what a normal is known whose patch departs from its plane by ``roughness_m`` in so many
    ``independent`` places: 3 degrees at 0.6 m, half a degree at 4 m."""
    return float(np.degrees(roughness_m / np.sqrt(independent) / (tile_m / np.sqrt(12))))


def _evenly(index: np.ndarray, most: int) -> np.ndarray:
    return index[np.linspace(0, len(index) - 1, min(most, len(index))).astype(int)]


@dataclass(frozen=True)
class PlaneSurvey:
    """Planes of all strips, found and matched under ``mounting``.

    ``surfaces`` by strip, `Roofs` or `Patches`, whose points index the `Candidates` of the beams
    used; ``pairs`` of views as matched, and ``ties``, the physical faces; ``tie_planes`` what the
    adjustment takes, its faces in the order of ``keys`` (strip, number of the surface), their
    points ``views`` (strip, indices into the strip); ``rejected`` faces, wrong matches that are in
    ``pairs`` but not in ``ties``; ``agreed`` (3,) rad, the boresight on which the others agree;
    ``boresights`` (passes + 1, 3) rad, as the search went.
    """

    mounting: Mounting
    surfaces: dict[str, Roofs] | dict[str, Patches]
    pairs: tuple[FacePair, ...]
    ties: tuple[Tie, ...]
    tie_planes: TiePlanes
    views: tuple[tuple[str, np.ndarray], ...]
    rejected: tuple[Rejection, ...]
    agreed: np.ndarray
    boresights: np.ndarray

    @property
    def keys(self) -> tuple[FaceKey, ...]:
        return tuple(key for tie in self.ties for key in tie)

    @property
    def gables(self) -> np.ndarray:
        """(K, 2) left and right face of each gable, numbers of faces of ``tie_planes``."""
        number = {key: position for position, key in enumerate(self.keys)}
        both = [
            (number[name, gable.left], number[name, gable.right])
            for name, roofs in self.surfaces.items()
            for gable in roofs.gables
            if (name, gable.left) in number and (name, gable.right) in number
        ]
        return np.array(both, int).reshape(-1, 2)

    def __repr__(self) -> str:
        boresight = ", ".join(f"{angle:.3f}" for angle in np.degrees(self.mounting.boresight))
        return (
            f"PlaneSurvey({self.tie_planes.n_planes} planes, {len(self.keys)} views, "
            f"{len(self.tie_planes.rays)} points of {len(self.surfaces)} strips, found under a "
            f"boresight of ({boresight})°, {len(self.rejected)} rejected)"
        )


def find_candidates(
    survey: Survey, roofs: RoofParameters | None = None, progress: Progress = silent
) -> Candidates:
    """Outlier removal and ground filter of every strip, one strip in memory at a time."""
    index, rays = {}, {}
    for strip in survey.strips:
        progress(f"{strip.name}: points above the ground")
        of_strip = survey.rays(strip)
        index[strip.name] = candidates(georeference(of_strip, survey.mounting), roofs)
        rays[strip.name] = of_strip.take(index[strip.name])
    return Candidates(index, rays)


def sample_rays(survey: Survey, seed: int = 0) -> Candidates:
    """At most `MOST_POINTS` rays of each strip, drawn at random, in their order."""
    generators = np.random.default_rng(seed).spawn(len(survey.strips))
    index, rays = {}, {}
    for strip, rng in zip(survey.strips, generators, strict=True):
        chosen = np.arange(len(strip))
        if len(strip) > MOST_POINTS:
            chosen = np.sort(rng.choice(len(strip), MOST_POINTS, replace=False))
        index[strip.name] = chosen
        rays[strip.name] = survey.rays(strip, chosen)
    return Candidates(index, rays)


def tile_size(samples: Mapping[str, Rays], mounting: Mounting) -> float:
    """Edge of the patches, m, that suits the extent and the density of the strips."""
    edges = []
    for rays in samples.values():
        cell = np.unique(np.floor(georeference(rays, mounting)[:, :2]).astype(int), axis=0)
        density = len(rays) / len(cell)  # points a square metre
        edges.append(max(np.sqrt(len(cell) / TILES_PER_STRIP), np.sqrt(POINTS_PER_TILE / density)))
    return float(np.clip(np.median(edges), *TILE_M))


def find_roofs(
    survey: Survey,
    points: Candidates | None = None,
    search: RoofSearch | None = None,
    progress: Progress = silent,
) -> PlaneSurvey:
    """Gable roofs of all strips and their matches, from the survey's own mounting as start.

    Parameters
    ----------
    survey : Survey
    points : Candidates, optional
        Points above the ground, `find_candidates`; found here where they are not given.
    search : RoofSearch, optional
        Thresholds of the last pass; the first one's follow from them.
    progress : callable, optional
        Called with a sentence for each step.

    Returns
    -------
    PlaneSurvey
        Faces and gables of each strip, and the tie planes.

    Raises
    ------
    TooFewPlanes, RankDefect, NoConvergence

    References
    ----------
    Sections 2.2.2 and 2.2.4 of the paper.
    """
    search = search or RoofSearch()
    points = points or find_candidates(survey, search.roofs, progress)
    return _search(survey, points, [search.coarse(), search], progress)


def find_planes(
    survey: Survey,
    points: Candidates | None = None,
    progress: Progress = silent,
) -> PlaneSurvey:
    """Planar patches of any kind of all strips and their matches, for flights without gable roofs.

    Parameters
    ----------
    survey : Survey
    points : Candidates, optional
        Points among which patches are sought; by default a sample of each strip.
    progress : callable, optional
        Called with a sentence for each step.

    Returns
    -------
    PlaneSurvey

    Raises
    ------
    TooFewPlanes, RankDefect, NoConvergence
    """
    points = points or sample_rays(survey)
    tile_m = tile_size(points.rays, survey.mounting)
    fine = PatchSearch.fine(tile_m)
    searches = [PatchSearch.coarse(tile_m), fine]
    return _search(survey, points, searches, progress)


def _search(
    survey: Survey, points: Candidates, searches: Sequence[Search], progress: Progress
) -> PlaneSurvey:
    """One pass by each of ``searches``, the last one repeated until the boresight settles.

    Raises `NoConvergence`, and what the adjustment raises.
    """
    mounting, boresights = survey.mounting, [survey.mounting.boresight]
    last = searches[-1]
    for number in range(last.max_passes):
        search = searches[min(number, len(searches) - 1)]
        found = planes_under(survey, points, mounting, search)
        boresights.append(_boresight(survey, found))
        change = np.rad2deg(np.abs(boresights[-1] - boresights[-2]))
        words = f"{found.tie_planes.n_planes} planes, change {change.max():.3f}°"
        progress(f"pass {number + 1}: {words}")
        limit = search.tolerance_deg(survey, found.tie_planes, boresights[-1])
        if search is last and (change < limit).all():
            return replace(found, boresights=np.array(boresights))
        mounting = mounting.with_calibration(boresights[-1])
    raise NoConvergence(
        f"the planes did not settle in {last.max_passes} passes, last change {change.max():.3f} "
        f"deg (limit {np.max(limit):.3f} deg); look for wrong matches, or start closer to the "
        "mounting"
    )


def _boresight(survey: Survey, found: PlaneSurvey) -> np.ndarray:
    """(3,) rad by SL, or that on which the faces agree where coarse planes let it not converge."""
    survey = replace(survey, mounting=found.mounting)
    try:
        return scenarios.calibrate(survey, found.tie_planes, FOR_SEARCH, found.agreed).boresight
    except NoConvergence:
        return found.agreed


def planes_under(
    survey: Survey, points: Candidates, mounting: Mounting, search: Search
) -> PlaneSurvey:
    """One pass: planes found and matched as they lie under ``mounting``.

    Parameters
    ----------
    survey : Survey
    points : Candidates
    mounting : Mounting
        Under which the points are georeferenced.
    search : RoofSearch or PatchSearch

    Returns
    -------
    PlaneSurvey

    Raises
    ------
    TooFewPlanes
    """
    in_fan = np.abs(survey.scanner.beam_elevations) <= np.deg2rad(search.fan_deg)
    generators = np.random.default_rng(0).spawn(len(points.rays))
    index, rays, p_m, surfaces = {}, {}, {}, {}
    for (name, of_strip), rng in zip(points.rays.items(), generators, strict=True):
        chosen = slice(None) if in_fan.all() else in_fan[of_strip.ring]
        index[name], rays[name] = points.index[name][chosen], of_strip.take(chosen)
        p_m[name] = georeference(rays[name], mounting)
        surfaces[name] = search.find(p_m[name], rng)
    ties, pairs = search.match(surfaces)
    views = [search.views(tie, surfaces, p_m) for tie in ties]
    planes = _tie_planes(rays, views, pairs)
    screening = screen(replace(survey, mounting=mounting), planes)
    if screening.rejected:
        kept = iter(screening.kept)
        views = [[view for view in tie if next(kept)] for tie in views if len(tie) > 1]
        planes = _tie_planes(rays, views, pairs)
    views = [tie for tie in views if len(tie) > 1]
    return PlaneSurvey(
        mounting, surfaces, tuple(pairs), tuple(tuple(key for key, _ in tie) for tie in views),
        planes, tuple((strip, index[strip][rows]) for tie in views for (strip, _), rows in tie),
        screening.rejected, screening.boresight, np.array([mounting.boresight]),
    )  # fmt: skip


def _tie_planes(rays: dict[str, Rays], ties: list[TieViews], pairs) -> TiePlanes:
    """The faces of ``ties`` that two views or more show, as the adjustment takes them."""
    ties = [tie for tie in ties if len(tie) > 1]
    keys = [key for tie in ties for key, _ in tie]
    number = {key: position for position, key in enumerate(keys)}
    return TiePlanes.build(
        [rays[strip].take(rows) for tie in ties for (strip, _), rows in tie],
        [strip for strip, _ in keys],
        [[number[key] for key, _ in tie] for tie in ties],
        [
            (number[pair.reference], number[pair.search])
            for pair in pairs
            if pair.reference in number and pair.search in number
        ],
    )
