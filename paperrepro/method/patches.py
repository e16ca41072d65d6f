"""Small planar patches of any kind in one strip: ground, walls, flat and sloped roofs alike.

The thinned cloud is grown into smooth segments as roofs are, but with no slope and no gable asked.
Segments are then cut by a grid that is the same for all strips, so that what two strips see of one
place are two patches of one footprint, and ground that rolls is flat enough within each. A patch
steeper than 45 degrees is cut by a grid in the vertical plane it faces.

A patch has no outline to recognise it by in another strip. Two correspond when their normals agree,
one lies near the plane of the other, and each is the other's best. While the boresight is coarse a
patch may lie a tile or more from its like; later both must lie in one cell of the common grid.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import chain, combinations

import numpy as np
from scipy.spatial import cKDTree

from paperrepro.method.cells import Thinned, thin
from paperrepro.method.matching import FaceKey, FacePair, connected_faces
from paperrepro.method.planes import GrowingParameters, grow_regions, neighbourhood

#: The two coordinates in which a patch is cut, by the axis nearest to its normal: x, y, z.
IN_PLANE = np.array([[1, 2], [0, 2], [0, 1]])


@dataclass(frozen=True)
class PatchParameters:
    """What a patch is.

    ``tile_m``: edge of the grid. ``cells``: voxels along that edge in the thinned cloud.
    ``growing``: as for roofs. ``min_cells`` and ``min_points`` of a patch; ``tolerance_m`` from
    which a point does not belong, and the greatest ``rms_m``; ``min_width`` of a patch: RMS along
    its lesser direction as a share of the tile's edge (a full tile has 0.29).
    """

    tile_m: float = 4.0
    cells: int = 8
    growing: GrowingParameters = field(
        default_factory=lambda: GrowingParameters(16, angle_deg=8.0, residual_m=0.05)
    )
    min_cells: int = 16
    min_points: int = 40
    tolerance_m: float = 0.10
    rms_m: float = 0.06
    min_width: float = 0.12

    @classmethod
    def fine(cls, tile_m: float) -> "PatchParameters":
        """For a boresight right to 0.2 degrees."""
        return cls(tile_m=tile_m)

    @classmethod
    def coarse(cls, tile_m: float) -> "PatchParameters":
        """For the central beams under a boresight wrong by up to 3 degrees, which makes a surface
        18 cm thick 30 m below: see `roofs.RoofParameters.coarse`."""
        growing = GrowingParameters(16, angle_deg=15.0, residual_m=0.15)
        return cls(
            tile_m=tile_m, growing=growing, min_points=20, tolerance_m=0.30, rms_m=0.15,
            min_cells=10,
        )  # fmt: skip

    @property
    def cell_m(self) -> float:
        """Edge of the thinned cloud's voxels, m."""
        return self.tile_m / self.cells


@dataclass(frozen=True)
class Patches:
    """P patches of one strip, m-frame.

    ``normal`` (P, 3) with n_z >= 0, ``centroid`` (P, 3) m, ``rms`` (P,) m about the plane;
    ``tile`` (P, 3): the axis nearest to the normal and the place in that axis' grid; ``points``
    sorted by patch, indices into the cloud, those of patch ``k`` at ``start[k]:start[k + 1]``.
    """

    normal: np.ndarray
    centroid: np.ndarray
    rms: np.ndarray
    tile: np.ndarray
    points: np.ndarray
    start: np.ndarray

    def __len__(self) -> int:
        return len(self.rms)

    def members(self, patch: int) -> np.ndarray:
        """Indices into the cloud of one patch's points."""
        return self.points[self.start[patch] : self.start[patch + 1]]


def find_patches(p_m: np.ndarray, params: PatchParameters) -> Patches:
    """The planar patches among points p_m (N, 3), m, m-frame, of one strip."""
    thinned = thin(p_m, params.cell_m)
    if len(thinned) < params.min_cells:
        return _of_points(p_m, np.empty((0, 3), int), np.empty(0, int), np.zeros(1, int))
    reach = 4 * params.cell_m
    around = neighbourhood(thinned.p_m, params.growing.neighbours, reach)
    segment = grow_regions(around, np.zeros(len(thinned), int), params.growing)
    tile, members, start = _cut(thinned, segment, around.normal, params)
    members, start, kept = _on_plane(p_m, members, start, params)
    return _wide_enough(_of_points(p_m, tile[kept], members, start), p_m, params)


def tiles(p_m: np.ndarray, axis: np.ndarray, edge_m: float) -> np.ndarray:
    """Place (N, 2) of points (N, 3) in the grid of each one's ``axis`` (N,)."""
    return np.floor(np.take_along_axis(p_m, IN_PLANE[axis], axis=1) / edge_m).astype(np.int64)


def _cut(thinned: Thinned, segment: np.ndarray, normal: np.ndarray, params: PatchParameters):
    """Tile (P, 3) of each piece of a segment, its full-density points and where they start."""
    grown = np.flatnonzero(segment >= 0)
    facing = np.zeros((segment.max() + 1, 3))
    np.add.at(facing, segment[grown], np.abs(normal[grown]))
    axis = facing.argmax(axis=1)[segment[grown]]
    place = tiles(thinned.p_m[grown], axis, params.tile_m)
    key = np.column_stack([segment[grown], axis, place])
    pieces, piece, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    large = count >= params.min_cells
    order = np.argsort(piece.ravel(), kind="stable")
    order = order[large[piece.ravel()[order]]]
    voxels = grown[order]
    per_voxel = np.diff(thinned.start)[voxels]
    edges = np.r_[0, np.cumsum(count[large])]
    start = np.r_[0, np.cumsum(per_voxel)][edges]
    return pieces[large, 1:], thinned.members(voxels), start


def _on_plane(p_m, members, start, params: PatchParameters):
    """Points that lie on their piece's plane, and which pieces keep enough of them."""
    for sigmas in (3.0, 3.0):
        normal, centroid, rms = _fit(p_m[members], start)
        piece = np.repeat(np.arange(len(rms)), np.diff(start))
        limit = np.minimum(np.maximum(sigmas * rms, 0.002), params.tolerance_m)[piece]
        off = np.einsum("na,na->n", p_m[members] - centroid[piece], normal[piece])
        members, start = _select(members, piece, np.abs(off) <= limit, len(rms))
    _, _, rms = _fit(p_m[members], start)
    kept = (np.diff(start) >= params.min_points) & (rms <= params.rms_m)
    piece = np.repeat(np.arange(len(rms)), np.diff(start))
    members, start = _select(members, piece, kept[piece], len(rms))
    return members, np.r_[start[:-1][kept], start[-1]], kept


def _select(members, piece, chosen, n_pieces):
    count = np.bincount(piece[chosen], minlength=n_pieces)
    return members[chosen], np.r_[0, np.cumsum(count)]


def _wide_enough(patches: Patches, p_m: np.ndarray, params: PatchParameters) -> Patches:
    """Without those that are hardly wider than a line."""
    _, spread = _scatter(p_m[patches.points], patches.start)
    width = np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, 1], 0.0))
    kept = width >= params.min_width * params.tile_m
    piece = np.repeat(np.arange(len(patches)), np.diff(patches.start))
    points, start = _select(patches.points, piece, kept[piece], len(patches))
    start = np.r_[start[:-1][kept], start[-1]]
    return _of_points(p_m, patches.tile[kept], points, start)


def _of_points(p_m, tile, points, start) -> Patches:
    normal, centroid, rms = _fit(p_m[points], start)
    return Patches(normal, centroid, rms, tile, points, start)


def _fit(q: np.ndarray, start: np.ndarray):
    """PCA planes of consecutive groups of points: normals (P, 3), centroids (P, 3), rms (P,)."""
    centroid, spread = _scatter(q, start)
    values, vectors = np.linalg.eigh(spread)
    normal = vectors[:, :, 0] * np.where(vectors[:, 2:, 0] < 0, -1.0, 1.0)
    return normal, centroid, np.sqrt(np.maximum(values[:, 0], 0.0))


def _scatter(q: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centroids (P, 3) and mean squared spreads (P, 3, 3) of groups; zeros for empty groups."""
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
    return centroid, spread


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
    return connected_faces(pairs)


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


def seen_by_all(
    members: list[np.ndarray], clouds: list[np.ndarray], axis: int, tile_m: float
) -> list[np.ndarray]:
    """``members``, indices of each view into its cloud (N, 3) m, where every kept view has points.

    None of a view that shows too little of the place. What a surface departs from a plane is then
    the same for all views, and their centroids lie over one another.
    """
    codes = []
    for index, p_m in zip(members, clouds, strict=True):
        cell = np.floor(p_m[index][:, IN_PLANE[axis]] / (FOOTPRINT * tile_m)).astype(int)
        codes.append(cell[:, 0] * (1 << 24) + cell[:, 1])
    shown = [np.unique(code) for code in codes]
    everything = np.unique(np.concatenate(shown))
    kept = [len(cover) >= LEAST_COVER * len(everything) for cover in shown]
    common = everything
    for cover, keep in zip(shown, kept, strict=True):
        common = np.intersect1d(common, cover) if keep else common
    return [
        index[np.isin(code, common) & keep]
        for index, code, keep in zip(members, codes, kept, strict=True)
    ]
