"""Faces: segments of the thinned cloud, brought back to the full density."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from paperrepro.boxes import extent, inside
from paperrepro.segmentation.planes import fit_plane
from paperrepro.segmentation.voxels import Thinned


@dataclass(frozen=True)
class AssignmentParameters:
    """Which full-density points belong to a face.

    Points of the face's voxels and of those within ``reach_cells`` around them are tried, so that
    edges lost to spoilt normals come back. They belong when they lie within ``sigmas`` robust
    standard deviations of the face's own points, at least ``floor_m`` (ranges are recorded in
    steps of 2 mm, and a noise-free face must not lose points to 3 x 0) and at most ``ceiling_m``.
    A point that fits two faces, as near a ridge, belongs to neither.
    """

    reach_cells: float = 1.8
    sigmas: float = 3.0
    floor_m: float = 0.002
    ceiling_m: float = 0.20


@dataclass(frozen=True)
class Face:
    """One roof face in one strip, m-frame.

    ``normal`` (3,) with n_z >= 0 and ``d`` m of n.p - d = 0; ``centroid`` (3,) m; ``points`` (K,)
    indices into the cloud it was extracted from; ``rms`` m of their distances; ``area`` m² in the
    plane (convex hull).
    """

    normal: np.ndarray
    d: float
    centroid: np.ndarray
    points: np.ndarray
    rms: float
    area: float

    @property
    def slope(self) -> float:
        """Inclination against the horizontal, rad."""
        return float(np.arccos(np.clip(self.normal[2], 0.0, 1.0)))


def assign(
    p_m: np.ndarray,
    thinned: Thinned,
    segments: list[np.ndarray],
    cell_m: float,
    params: AssignmentParameters,
) -> list[Face]:
    """A `Face` for each of ``segments``, index arrays into the thinned cloud.

    p_m : (N, 3) array, m, the full cloud.
    """
    claims = np.zeros(len(p_m), dtype=np.uint8)
    fits = [_members(p_m, thinned, segment, cell_m, params) for segment in segments]
    for points in fits:
        claims[points] += 1
    own = [points[claims[points] == 1] for points in fits]
    return [_face(p_m, points) for points in own if len(points) >= 3]


def _members(p_m, thinned, segment, cell_m, params) -> np.ndarray:
    """Indices (K,) of the full points that lie on the plane of the segment."""
    core = thinned.members(segment)
    core_m = p_m[core]
    plane = fit_plane(thinned.p_m[segment])
    for _ in range(3):  # the plane of the thinned cloud, then twice that of its own points
        away = np.abs(plane.distance(core_m))
        inside = away <= _limit(away, params)
        if inside.sum() < 3:
            return core[inside]
        plane = fit_plane(core_m[inside])
    limit = _limit(np.abs(plane.distance(core_m)), params)
    tried = thinned.members(_around(thinned, segment, cell_m, params))
    return tried[np.abs(plane.distance(p_m[tried])) <= limit]


def _limit(away: np.ndarray, params: AssignmentParameters) -> float:
    """Greatest distance, m, of a point that belongs, by how far (K,) m the segment's points are
    from the plane."""
    robust_sigma = 1.4826 * np.median(away)
    return float(min(max(params.sigmas * robust_sigma, params.floor_m), params.ceiling_m))


def _around(thinned: Thinned, segment: np.ndarray, cell_m: float, params) -> np.ndarray:
    """The segment's voxels and those within reach of one of them."""
    reach = params.reach_cells * cell_m
    core = thinned.p_m[segment]
    low, high = extent(core)
    near = np.flatnonzero(inside(thinned.p_m, low - reach, high + reach))
    distance, _ = cKDTree(core).query(thinned.p_m[near], distance_upper_bound=reach)
    return near[np.isfinite(distance)]


def _face(p_m: np.ndarray, points: np.ndarray) -> Face:
    plane = fit_plane(p_m[points])
    return Face(
        plane.normal, plane.d, plane.centroid, points, plane.rms, _area(p_m[points], plane.normal)
    )


def _area(p_m: np.ndarray, normal: np.ndarray) -> float:
    """Area, m², of the convex hull of points (K, 3) seen from above, as it lies in the plane."""
    try:
        return ConvexHull(p_m[:, :2]).volume / max(normal[2], 1e-6)
    except QhullError:  # fewer than three points, or all on a line
        return 0.0
