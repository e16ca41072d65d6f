"""Tie planes of all strips: gable roofs, by steps 4 and 5 again until the boresight settles, or
planes of any kind.

A boresight error of a degree makes a roof 18 cm thick within one strip, because the fan of beams
sees it from 10 m apart, and sets opposite strips a metre apart. So roofs are found by the central
beams and wide thresholds first, then by all beams and narrow ones after each adjustment, until the
boresight under which they were found no longer changes. Planes of any kind are found under the
boresight on which closest points agree, which needs no planes.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise

import numpy as np

from paperrepro.errors import NoConvergence, TooFewPlanes
from paperrepro.method.adjustment import scenarios
from paperrepro.method.adjustment.screening import screen
from paperrepro.method.closest_points import boresight_by_closest_points
from paperrepro.method.georeference import georeference, georeference_strip
from paperrepro.method.matching import FaceKey, FacePair, MatchParameters, match
from paperrepro.method.patches import choose, find_patches
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
#: Most points of a strip that are looked at for planes of any kind, and planes.
MOST_POINTS, MOST_PLANES = 400_000, 200
#: Points of a strip that are judged together: 60 bytes each.
PIECE = 6_000_000
#: Points of all tie planes at most: 400 bytes each in the adjustment.
MOST_OF_PLANES = 2_500_000


def silent(words: str) -> None:
    """No progress is shown."""


@dataclass(frozen=True)
class Candidates:
    """Points among which planes are sought: ``index`` (K,) into each strip, by its name, and a
    ``survey`` of these points alone. Rays, four times as large, are made where they are used."""

    index: dict[str, np.ndarray]
    survey: Survey

    @classmethod
    def of(cls, survey: Survey, index: dict[str, np.ndarray]) -> "Candidates":
        """The points at ``index`` by strip."""
        strips = tuple(survey.strip(name).take(rows) for name, rows in index.items())
        return cls(index, replace(survey, strips=strips, reference=None))

    @property
    def rays(self) -> Mapping[str, Rays]:
        """By strip; made anew whenever one is asked for."""
        return _RaysByStrip(self)

    def rays_of(self, strip: str, rows=slice(None)) -> Rays:
        """Of one strip, all or those at ``rows``."""
        return self.survey.rays(self.survey.strip(strip), rows)

    def chosen(self, rows: Mapping[str, np.ndarray]) -> "Candidates":
        """Those at ``rows``, by strip."""
        index = {name: self.index[name][of_strip] for name, of_strip in rows.items()}
        return Candidates(index, Candidates.of(self.survey, dict(rows)).survey)


class _RaysByStrip(Mapping):
    """`Candidates.rays`."""

    def __init__(self, points: Candidates):
        self._points = points

    def __getitem__(self, strip: str) -> Rays:
        if strip not in self._points.index:
            raise KeyError(strip)
        return self._points.rays_of(strip)

    def __iter__(self):
        return iter(self._points.index)

    def __len__(self) -> int:
        return len(self._points.index)


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


@dataclass(frozen=True)
class PlaneSurvey:
    """Planes of all strips, found and matched under ``mounting``.

    ``surfaces`` by strip, whose points index the `Candidates` of the beams used, none of planes of
    any kind; ``pairs`` of views as matched, ``ties``, the physical faces; ``tie_planes`` what the
    adjustment takes, its faces in the order of ``keys`` (strip, number of the surface), their
    points ``views`` (strip, indices into the strip), `MOST_OF_PLANES` in all; ``rejected`` faces,
    wrong matches that are in ``pairs`` but not in ``ties``; ``agreed`` (3,) rad, the boresight on
    which the others agree;
    ``boresights`` (passes + 1, 3) rad, as the search went.
    """

    mounting: Mounting
    surfaces: dict[str, Roofs]
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
            f"{len(self.tie_planes.rays)} points of {len({name for name, _ in self.keys})} strips, "
            f"found under a boresight of ({boresight})°, {len(self.rejected)} rejected)"
        )


def find_candidates(
    survey: Survey, roofs: RoofParameters | None = None, progress: Progress = silent
) -> Candidates:
    """Outlier removal and ground filter of every strip, a piece of at most `PIECE` points at a
    time: where a strip is cut is like the end of one."""
    index = {}
    for strip in survey.strips:
        progress(f"{strip.name}: points above the ground")
        pieces = -(-len(strip) // PIECE) or 1
        found = []
        for first, last in pairwise(np.linspace(0, len(strip), pieces + 1).astype(int)):
            p_m = georeference_strip(survey, strip.take(slice(first, last)))
            found.append(first + candidates(p_m, roofs))
        index[strip.name] = np.concatenate(found)
    return Candidates.of(survey, index)


def sample_rays(survey: Survey, seed: int = 0) -> Candidates:
    """At most `MOST_POINTS` rays of each strip, drawn at random, in their order."""
    generators = np.random.default_rng(seed).spawn(len(survey.strips))
    index = {}
    for strip, rng in zip(survey.strips, generators, strict=True):
        index[strip.name] = np.arange(len(strip))
        if len(strip) > MOST_POINTS:
            index[strip.name] = np.sort(rng.choice(len(strip), MOST_POINTS, replace=False))
    return Candidates.of(survey, index)


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
    boresight = boresight_by_closest_points(points.survey, points.rays)
    change = np.rad2deg(np.abs(boresight - survey.mounting.boresight)).max()
    progress(f"closest points: change {change:.3f}°")
    mounting = survey.mounting.with_calibration(boresight)
    patches = find_patches(
        {name: georeference(rays, mounting) for name, rays in points.rays.items()}
    )
    if len(patches) < LEAST_PLANES:
        raise TooFewPlanes(
            f"expected at least {LEAST_PLANES} planar patches that two strips share, got "
            f"{len(patches)}; give strips that overlap, over ground, roofs or walls"
        )
    chosen = choose(patches, MOST_PLANES)
    progress(f"{len(patches)} planar patches, {len(chosen)} chosen")
    ties = [
        [((strip, number), index) for strip, index in patch.views.items()]
        for number, patch in enumerate(chosen)
    ]
    found = _screened(survey, mounting, points, {}, ties)
    return replace(found, boresights=np.array([survey.mounting.boresight, boresight]))


def _search(
    survey: Survey, points: Candidates, searches: Sequence[RoofSearch], progress: Progress
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
        change = np.rad2deg(np.abs(boresights[-1] - boresights[-2])).max()
        progress(f"pass {number + 1}: {found.tie_planes.n_planes} planes, change {change:.3f}°")
        if search is last and change < last.settled_deg:
            return replace(found, boresights=np.array(boresights))
        mounting = mounting.with_calibration(boresights[-1])
        found = None  # the next pass needs its memory
    raise NoConvergence(
        f"the planes did not settle in {last.max_passes} passes, last change {change:.3f} deg "
        f"(limit {last.settled_deg:.3f} deg); look for wrong matches, or start closer to the "
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
    survey: Survey, points: Candidates, mounting: Mounting, search: RoofSearch
) -> PlaneSurvey:
    """One pass: planes found and matched as they lie under ``mounting``.

    Parameters
    ----------
    survey : Survey
    points : Candidates
    mounting : Mounting
        Under which the points are georeferenced.
    search : RoofSearch

    Returns
    -------
    PlaneSurvey

    Raises
    ------
    TooFewPlanes
    """
    generators = np.random.default_rng(0).spawn(len(points.index))
    in_fan = {
        strip.name: np.abs(points.survey.elevation(strip)) <= np.deg2rad(search.fan_deg)
        for strip in points.survey.strips
    }
    if not all(chosen.all() for chosen in in_fan.values()):
        points = points.chosen(in_fan)
    surfaces = {}
    for strip, rng in zip(points.survey.strips, generators, strict=True):
        p_m = np.empty((0, 3))
        if len(strip):
            p_m = georeference_strip(points.survey, strip, mounting)
        surfaces[strip.name] = extract(p_m, search.roofs, rng)
    matches = match(surfaces, search.matching)
    ties = [
        [((strip, face), surfaces[strip].faces[face].points) for strip, face in tie]
        for tie in matches.connected_faces()
    ]
    return _screened(survey, mounting, points, surfaces, ties, matches.pairs)


def _screened(
    survey: Survey, mounting: Mounting, points: Candidates, surfaces: dict[str, Roofs],
    views: list[TieViews], pairs: Sequence[FacePair] | None = None,
) -> PlaneSurvey:  # fmt: skip
    """Tie planes of ``views``, without those that do not lie on the plane they were matched to;
    ``pairs`` are all of a plane's if None."""
    if pairs is None:
        keys = [[key for key, _ in tie] for tie in views]
        pairs = [FacePair(*pair) for tie in keys for pair in combinations(tie, 2)]
    views = _limited(views)
    planes = _tie_planes(points, views, pairs)
    screening = screen(replace(survey, mounting=mounting), planes)
    if screening.rejected:
        kept = iter(screening.kept)
        views = [[view for view in tie if next(kept)] for tie in views if len(tie) > 1]
        planes = _tie_planes(points, views, pairs)
    views, index = [tie for tie in views if len(tie) > 1], points.index
    return PlaneSurvey(
        mounting, surfaces, tuple(pairs), tuple(tuple(key for key, _ in tie) for tie in views),
        planes, tuple((strip, index[strip][rows]) for tie in views for (strip, _), rows in tie),
        screening.rejected, screening.boresight, np.array([mounting.boresight]),
    )  # fmt: skip


def _limited(views: list[TieViews]) -> list[TieViews]:
    """With `MOST_OF_PLANES` points at most: of the largest, as many of each, evenly spaced."""
    count = np.sort([len(rows) for tie in views for _, rows in tie])
    before, left = np.cumsum(count) - count, np.arange(len(count), 0, -1)
    full = int((before + count * left <= MOST_OF_PLANES).sum())  # views that keep all they have
    if full == len(count):
        return views
    most = int(MOST_OF_PLANES - before[full]) // int(left[full])
    return [
        [(key, rows[np.linspace(0, len(rows) - 1, min(most, len(rows))).astype(int)])
         for key, rows in tie]
        for tie in views
    ]  # fmt: skip


def _tie_planes(points: Candidates, ties: list[TieViews], pairs) -> TiePlanes:
    """The faces of ``ties`` that two views or more show, as the adjustment takes them."""
    views = [view for tie in ties if len(tie) > 1 for view in tie]
    keys = [key for key, _ in views]
    number = {key: position for position, key in enumerate(keys)}
    faces = {}
    for strip in {strip: None for strip, _ in keys}:
        of_strip = [(key, rows) for key, rows in views if key[0] == strip]
        rays = points.rays_of(strip, np.concatenate([rows for _, rows in of_strip]))
        stops = np.cumsum([len(rows) for _, rows in of_strip])
        for (key, rows), stop in zip(of_strip, stops.tolist(), strict=True):
            faces[key] = rays.take(slice(stop - len(rows), stop))
    return TiePlanes.build(
        [faces[key] for key in keys],
        [strip for strip, _ in keys],
        [[number[key] for key, _ in tie] for tie in ties if len(tie) > 1],
        [
            (number[pair.reference], number[pair.search])
            for pair in pairs
            if pair.reference in number and pair.search in number
        ],
    )
