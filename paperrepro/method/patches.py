"""Planar patches of any kind that several strips show: ground, walls, flat and sloped roofs alike.

Points around a centre are tried in balls, the largest first. A patch is where the points of two
strips or more each lie on a plane, and these planes agree. Large patches tell normals better, small
ones find room on a car or a bank, so all sizes serve together and none has to be guessed: a smooth
field gives a few large ones, a rough one more of the small.

Under a boresight right to a tenth of a degree what two strips see of one place lies within
centimetres; see `closest_points`.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from paperrepro.method.cells import thin

#: Points a patch of a strip should have, from which the least radius follows, and its limits, m;
#: how many of the largest patches a strip should have room for, and their greatest radius, m; from
#: one radius to the next the area grows by a half.
POINTS_OF_LEAST, LEAST_M, ROOM_FOR, LARGEST_M, GROWTH = 40, (0.25, 1.5), 200, 2.5, np.sqrt(1.5)
#: Centres that are tried, and points of a strip in a ball, at most.
MOST_CENTRES, MOST_OF_VIEW = 4000, 400
#: Directions of normals that are told apart when planes are chosen: slopes, deg, and sectors.
SLOPES_DEG = (6.0, 20.0, 50.0)
SECTORS = 8


@dataclass(frozen=True)
class PatchParameters:
    """What a patch is.

    ``min_points`` of a view; its greatest ``rms_m`` from its plane, also as a share of its radius,
    ``roughness``; what share of its points may lie off the plane, ``strangers``; ``min_width``: RMS
    along its lesser direction as a share of the radius (a full disc has 0.5). Views agree when
    their normals do within ``inclination_deg``, or thrice what roughness makes of a normal, and
    each lies within ``distance_m`` of the other's plane; ``shift`` of their centroids, in radii.
    """

    min_points: int = 20
    rms_m: float = 0.06
    roughness: float = 0.14
    strangers: float = 0.2
    min_width: float = 0.3
    inclination_deg: float = 3.0
    distance_m: float = 0.3
    shift: float = 0.5


@dataclass(frozen=True)
class Patch:
    """``centre`` (3,) m, ``radius_m``, ``normal`` (3,) with n_z >= 0, and the points of its
    ``views``: by strip, indices into the strip's."""

    centre: np.ndarray
    radius_m: float
    normal: np.ndarray
    views: dict[str, np.ndarray]


@dataclass(frozen=True)
class _Cloud:
    """Points (N, 3) m of a strip and how many cubes of a metre they lie in: about the square metres
    of what they show."""

    p_m: np.ndarray
    area_m2: int

    @classmethod
    def of(cls, p_m: np.ndarray) -> "_Cloud":
        return cls(p_m, len(thin(p_m, 1.0)))

    @property
    def density(self) -> float:
        """Points a square metre."""
        return len(self.p_m) / self.area_m2

    def thinned(self, radius_m: float) -> np.ndarray:
        """Indices of as many points, drawn at random, that a ball has `MOST_OF_VIEW` as a rule."""
        share = MOST_OF_VIEW / max(np.pi * radius_m**2 * self.density, MOST_OF_VIEW)
        return np.flatnonzero(np.random.default_rng(0).random(len(self.p_m)) < share)


@dataclass(frozen=True)
class _Views:
    """What one strip shows in C balls: ``points`` sorted by ball, those of ball ``c`` at
    ``start[c]:start[c + 1]``, with ``normal`` (C, 3), ``centroid`` (C, 3), ``rms`` (C,) m about
    their planes, and which are ``planar`` (C,)."""

    points: np.ndarray
    start: np.ndarray
    normal: np.ndarray
    centroid: np.ndarray
    rms: np.ndarray
    planar: np.ndarray

    @classmethod
    def of(cls, cloud: "_Cloud", centres, radius_m: float, params: PatchParameters) -> "_Views":
        p_m, most = cloud.p_m, cloud.thinned(radius_m)
        balls = cKDTree(p_m[most]).query_ball_point(centres, radius_m, return_sorted=True)
        start = np.r_[0, np.cumsum([len(ball) for ball in balls])]
        points = most[np.concatenate([np.asarray(ball, int) for ball in balls])]
        given = np.diff(start)
        for sigmas in (2.5, 3.0, 3.0):
            normal, centroid, values = _fit(p_m[points], start)
            ball = np.repeat(np.arange(len(centres)), np.diff(start))
            limit = np.maximum(sigmas * np.minimum(np.sqrt(values[:, 0]), params.rms_m), 0.002)
            off = np.einsum("na,na->n", p_m[points] - centroid[ball], normal[ball])
            near = np.abs(off) <= limit[ball]
            start = np.r_[0, np.cumsum(np.bincount(ball[near], minlength=len(centres)))]
            points = points[near]
        normal, centroid, values = _fit(p_m[points], start)
        count, rms = np.diff(start), np.sqrt(values[:, 0])
        planar = (count >= params.min_points) & (count >= (1 - params.strangers) * given)
        planar &= rms <= min(params.rms_m, params.roughness * radius_m)
        planar &= np.sqrt(values[:, 1]) >= params.min_width * radius_m
        return cls(points, start, normal, centroid, rms, planar)

    def members(self, ball: int) -> np.ndarray:
        return self.points[self.start[ball] : self.start[ball + 1]]


def find_patches(
    p_m: Mapping[str, np.ndarray], params: PatchParameters | None = None
) -> list[Patch]:
    """Patches that two strips or more show, apart from one another.

    ``p_m``: points (N, 3) m of each strip, m-frame. Sorted from large to small.
    """
    params = params or PatchParameters()
    clouds = {name: _Cloud.of(points) for name, points in p_m.items() if len(points)}
    if len(clouds) < 2:
        return []
    radii_m, everything = _radii(list(clouds.values())), np.vstack([*p_m.values()])
    centres, edge = everything, radii_m[-1]
    while len(centres) > MOST_CENTRES:
        centres, edge = thin(everything, edge).p_m, 1.2 * edge
    found: list[Patch] = []
    for radius_m in radii_m:
        for patch in found:
            centres = centres[_apart(centres, patch.centre, patch.radius_m + radius_m)]
        found += _of_radius(clouds, centres, radius_m, params)
    return found


def _radii(clouds: list[_Cloud]) -> np.ndarray:
    """Of the patches that are tried, m, from large to small."""
    density = np.median([cloud.density for cloud in clouds])
    least = float(np.clip(np.sqrt(POINTS_OF_LEAST / np.pi / density), *LEAST_M))
    area_m2 = np.median([cloud.area_m2 for cloud in clouds])
    largest = min(np.sqrt(area_m2 / ROOM_FOR / np.pi), LARGEST_M)
    steps = max(round(np.log(largest / least) / np.log(GROWTH)), 0)
    return least * GROWTH ** np.arange(steps, -1, -1)


def _apart(centres: np.ndarray, centre: np.ndarray, least_m: float) -> np.ndarray:
    """Which of ``centres`` (C, 3) have room beside ``centre`` (3,)."""
    return np.square(centres - centre).sum(axis=1) >= least_m**2


def _of_radius(
    clouds: dict[str, _Cloud], centres: np.ndarray, radius_m: float, params: PatchParameters
) -> list[Patch]:
    """Patches of one radius that leave one another their room."""
    if not len(centres):
        return []
    seen = {name: _Views.of(cloud, centres, radius_m, params) for name, cloud in clouds.items()}
    names = list(seen)
    planar = np.array([views.planar for views in seen.values()])
    count = np.array([np.diff(views.start) for views in seen.values()])
    first = np.where(planar, count, -1).argmax(axis=0)
    normal = np.array([views.normal for views in seen.values()])
    centroid = np.array([views.centroid for views in seen.values()])
    balls = np.arange(len(centres))
    agree = planar & _alike(
        normal, centroid, normal[first, balls], centroid[first, balls], radius_m, params
    )
    shown = agree.sum(axis=0)
    rms = np.sum([views.rms for views in seen.values()], axis=0, where=agree) / np.maximum(shown, 1)
    made, free = [], np.ones(len(centres), bool)
    for ball in np.lexsort((rms, -shown)):
        if shown[ball] < 2:
            break
        if free[ball]:
            free &= _apart(centres, centres[ball], 2 * radius_m)
            views = {names[s]: seen[names[s]].members(ball) for s in np.flatnonzero(agree[:, ball])}
            made.append(Patch(centres[ball], radius_m, normal[first[ball], ball], views))
    return made


def _alike(normal, centroid, n, c, radius_m: float, params: PatchParameters) -> np.ndarray:
    """Which views (S, C) lie on the plane (C, 3) through (C, 3)."""
    step = centroid - c
    turn = np.arccos(np.clip(np.abs(np.einsum("sca,ca->sc", normal, n)), 0, 1))
    off = np.abs(np.einsum("sca,ca->sc", step, n))
    shift = np.sqrt(np.maximum(np.square(step).sum(axis=2) - off**2, 0.0))
    most = np.radians(max(params.inclination_deg, 3 * normal_noise_deg(radius_m)))
    near = (off <= params.distance_m) & (shift <= params.shift * radius_m)
    return near & (turn <= most)


def normal_noise_deg(radius_m: float, roughness_m: float = 0.03, independent: int = 10) -> float:
    """To what a normal is known whose patch departs from its plane by ``roughness_m`` in so many
    ``independent`` places: 3 degrees at 0.35 m, half a degree at 2 m."""
    return float(np.degrees(roughness_m / np.sqrt(independent) / (radius_m / 2)))


def _fit(q: np.ndarray, start: np.ndarray):
    """PCA planes of consecutive groups of points: normals (P, 3), centroids (P, 3), and mean
    squared spreads (P, 3) along the normal and in the plane; zeros for empty groups."""
    group = np.repeat(np.arange(len(start) - 1), np.diff(start))
    count = np.maximum(np.diff(start), 1)

    def mean(values):
        return np.bincount(group, values, minlength=len(count)) / count

    centroid = np.column_stack([mean(q[:, a]) for a in range(3)])
    r = q - centroid[group]
    spread = np.empty((len(count), 3, 3))
    for a in range(3):
        for b in range(a, 3):
            spread[:, a, b] = spread[:, b, a] = mean(r[:, a] * r[:, b])
    values, vectors = np.linalg.eigh(spread)
    normal = vectors[:, :, 0] * np.where(vectors[:, 2:, 0] < 0, -1.0, 1.0)
    return normal, centroid, np.maximum(values, 0.0)


def choose(patches: list[Patch], most: int) -> list[Patch]:
    """At most ``most``: see `varied`."""
    normal = np.array([patch.normal for patch in patches])
    centre = np.array([patch.centre for patch in patches])
    views = np.array([len(patch.views) for patch in patches])
    return [patches[k] for k in varied(normal, centre, views, most)]


def varied(normal: np.ndarray, centroid: np.ndarray, views: np.ndarray, most: int) -> np.ndarray:
    """Indices of at most ``most`` planes out of G, (G, 3) and (G, 3): of every direction as many,
    and of each direction those that lie farthest apart, the half of more ``views`` (G,) first.

    A thousand patches of level ground say no more of the boresight than a hundred, but cost more.
    """
    slope = np.degrees(np.arccos(np.clip(np.abs(normal[:, 2]), 0, 1)))
    sector = np.floor((np.arctan2(normal[:, 1], normal[:, 0]) / (2 * np.pi) % 1.0) * SECTORS)
    steep = np.digitize(slope, SLOPES_DEG)
    kind = np.where(steep == 0, 0, SECTORS * steep + sector).astype(int)
    rank = np.empty(len(normal), int)
    for one in np.unique(kind):
        members = np.flatnonzero(kind == one)
        many = views[members] >= np.median(views[members])
        halves = [members[many], members[~many]]
        order = [half[_spread_out(centroid[half], most)] for half in halves if len(half)]
        rank[np.concatenate(order)] = np.arange(len(members))
    return np.sort(np.lexsort((kind, rank))[:most])


def _spread_out(p_m: np.ndarray, most: int) -> np.ndarray:
    """Order (K,) of points: each the farthest from all before it, for the first ``most``."""
    order, distance = [], np.full(len(p_m), np.inf)
    following = int(np.linalg.norm(p_m - p_m.mean(axis=0), axis=1).argmin())
    for _ in range(min(most, len(p_m))):
        order.append(following)
        distance = np.minimum(distance, np.linalg.norm(p_m - p_m[following], axis=1))
        distance[following] = -1.0
        following = int(distance.argmax())
    return np.r_[order, np.setdiff1d(np.arange(len(p_m)), order)].astype(int)
