"""Small planar patches of any kind in one strip: ground, walls, flat and sloped roofs alike.

The thinned cloud is grown into smooth segments as roofs are, but with no slope and no gable asked.
Segments are then cut by a grid that is the same for all strips, so that what two strips see of one
place are two patches of one footprint, and ground that rolls is flat enough within each. A patch
steeper than 45 degrees is cut by a grid in the vertical plane it faces.
"""

from dataclasses import dataclass, field

import numpy as np

from paperrepro.segmentation.planes import GrowingParameters, grow_regions, neighbourhood
from paperrepro.segmentation.voxels import Thinned, thin

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
