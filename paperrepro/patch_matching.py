"""Which patches of different strips are the same place of the same surface.

A patch has no outline to recognise it by. Two correspond when their normals agree, one lies near
the plane of the other, and each is the other's best. While the boresight is coarse a patch may lie
a tile or more from its like; later both must lie in one cell of the common grid.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np
from scipy.spatial import cKDTree

from paperrepro.matching import FaceKey, FacePair, tie_planes
from paperrepro.segmentation.patches import IN_PLANE, Patches

#: Edge of the cells by which footprints are compared, in tiles.
FOOTPRINT = 0.25
#: A view that shows less than this share of what all views show of a patch is left out.
LEAST_COVER = 0.5
#: Directions of normals that are told apart when planes are chosen: slopes, deg, and sectors.
SLOPES_DEG = (6.0, 20.0, 50.0)
SECTORS = 8


@dataclass(frozen=True)
class PatchMatchParameters:
    """``distance_m`` from the other's plane and ``shift_m`` along it, at most; ``inclination_deg``
    between the normals; ``same_tile``: both in one cell of the grid."""

    distance_m: float
    shift_m: float
    inclination_deg: float
    same_tile: bool


def match_patches(
    patches: Mapping[str, Patches], params: PatchMatchParameters
) -> tuple[tuple[FaceKey, ...], ...]:
    """For each place that two strips or more show, its views, at most one a strip, sorted."""
    pairs = []
    for reference, search in combinations(patches, 2):
        a, b, score = _mutual_best(patches[reference], patches[search], params)
        pairs += [
            FacePair((reference, int(i)), (search, int(j)), float(s), 0.0)
            for i, j, s in zip(a, b, score, strict=True)
        ]
    return tie_planes(pairs)


def _mutual_best(ours: Patches, theirs: Patches, params: PatchMatchParameters):
    """Patches (M,), (M,) that are each other's best, and their scores (M,)."""
    a, b = _near(ours, theirs, np.hypot(params.distance_m, params.shift_m))
    step = theirs.centroid[b] - ours.centroid[a]
    n = ours.normal[a] + theirs.normal[b] * _sign(ours.normal[a], theirs.normal[b])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    off = np.abs(np.einsum("pa,pa->p", step, n))
    shift = np.sqrt(np.maximum(np.square(step).sum(axis=1) - off**2, 0.0))
    turn = _inclination(ours.normal[a], theirs.normal[b])
    limit = np.radians(params.inclination_deg)
    kept = (off <= params.distance_m) & (shift <= params.shift_m) & (turn <= limit)
    if params.same_tile:
        kept &= (ours.tile[a] == theirs.tile[b]).all(axis=1)
    score = np.sqrt(
        (off / params.distance_m) ** 2 + (shift / params.shift_m) ** 2 + (turn / limit) ** 2
    )
    a, b, score = a[kept], b[kept], score[kept]
    best_a, best_b = np.full(len(ours), np.inf), np.full(len(theirs), np.inf)
    np.minimum.at(best_a, a, score)
    np.minimum.at(best_b, b, score)
    mutual = (score == best_a[a]) & (score == best_b[b])
    return a[mutual], b[mutual], score[mutual]


def _near(ours: Patches, theirs: Patches, reach_m: float) -> tuple[np.ndarray, np.ndarray]:
    if not len(ours) or not len(theirs):
        return np.empty(0, int), np.empty(0, int)
    found = cKDTree(ours.centroid).query_ball_tree(cKDTree(theirs.centroid), reach_m)
    count = [len(near) for near in found]
    return np.repeat(np.arange(len(ours)), count), np.array(list(chain(*found)), int)


def _sign(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.where(np.einsum("pa,pa->p", one, other) < 0, -1.0, 1.0)[:, None]


def _inclination(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    cross = np.linalg.norm(np.cross(one, other), axis=1)
    return np.arctan2(cross, np.abs(np.einsum("pa,pa->p", one, other)))


def choose(normal: np.ndarray, centroid: np.ndarray, views: np.ndarray, most: int) -> np.ndarray:
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


def common_footprint(views: list[np.ndarray], axis: int, tile_m: float) -> list[np.ndarray | None]:
    """Of each view's points (N, 3) m, a mask (N,) of those where every kept view has points.

    None for a view that shows too little of the place. What a surface departs from a plane is then
    the same for all views, and their centroids lie over one another.
    """
    cells = [np.floor(p_m[:, IN_PLANE[axis]] / (FOOTPRINT * tile_m)).astype(int) for p_m in views]
    codes = [cell[:, 0] * (1 << 24) + cell[:, 1] for cell in cells]
    shown = [np.unique(code) for code in codes]
    everything = np.unique(np.concatenate(shown))
    kept = [len(cover) >= LEAST_COVER * len(everything) for cover in shown]
    common = everything
    for cover, keep in zip(shown, kept, strict=True):
        common = np.intersect1d(common, cover) if keep else common
    return [np.isin(code, common) if keep else None for code, keep in zip(codes, kept, strict=True)]
