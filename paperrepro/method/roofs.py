"""Gable roofs of one strip: the chain of section 2.2.2, with the parameters of Table 2.

candidates: statistical outlier removal -> progressive morphological filter (non-ground)
extract:    thin -> objects -> RANSAC -> region growing -> PCA planes -> faces -> gables

Faces are segments of the thinned cloud, brought back to the full density; two faces make a gable
with a virtual point on its ridge (section 2.2.4, Fig. 4).
"""

from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError, cKDTree

from paperrepro.method.cells import Thinned, cells, extent, inside, thin
from paperrepro.method.ground import GroundParameters, progressive_morphological_filter
from paperrepro.method.outliers import OutlierParameters, statistical_outliers
from paperrepro.method.planes import (
    GrowingParameters,
    Neighbourhood,
    RansacParameters,
    fit_plane,
    grow_regions,
    neighbourhood,
    ransac_planes,
)


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


@dataclass(frozen=True)
class GableParameters:
    """What two faces must have in common to be a gable.

    ``azimuth_deg``: departure of the two slope directions from opposite. ``ridge_slope_deg``: of
    their intersection from the horizontal. ``ridge_gap_m``: from the ridge to the nearest points of
    either face; also the depth by which a face may cross to the other side or rise over the ridge.
    ``overlap``: of the extents along the ridge, relative to the shorter. ``width_ratio``: of the
    narrower to the wider face across the ridge, so that their eaves are comparable and a lean-to
    does not pass. ``hip_inset``: a face that is shorter at the ridge than at the eaves at *both*
    ends, by more than this share of its width, is a hip's: between the outer quarters a hip of
    equal slopes loses 0.75 of its width at either end, a gable nothing, and the edge of the swath
    cuts one end only. ``min_length_m`` along the ridge and ``min_width_m`` across.
    """

    azimuth_deg: float = 10.0
    ridge_slope_deg: float = 5.0
    ridge_gap_m: float = 1.0
    overlap: float = 0.5
    width_ratio: float = 0.4
    hip_inset: float = 0.3
    min_length_m: float = 3.0
    min_width_m: float = 1.5


@dataclass(frozen=True)
class Gable:
    """Two faces and their ridge, m-frame.

    ``left``, ``right`` : face numbers, left as seen along ``ridge`` (3,), a unit vector that points
    north or, when level with the parallel, east. ``virtual_point`` (3,) m, on the ridge. ``extent``
    (2,) m: where the two faces begin and end along ``ridge``, from the virtual point.
    """

    left: int
    right: int
    virtual_point: np.ndarray
    ridge: np.ndarray
    extent: np.ndarray


def virtual_point(left: Face, right: Face) -> tuple[np.ndarray, np.ndarray] | None:
    """The virtual point (3,) m and the ridge's direction (3,), or None where there is none.

    Seen from above, the segment between the two centroids crosses the line in which the planes
    meet; the height is the line's. None for planes without such a line and for a segment that does
    not cross it.
    """
    ridge = np.cross(left.normal, right.normal)
    length = np.linalg.norm(ridge)
    if length < 1e-6:
        return None
    ridge = ridge / length
    ridge = ridge * (1.0 if (ridge[1], ridge[0]) > (0.0, 0.0) else -1.0)
    normals = np.array([left.normal, right.normal, ridge])
    middle = (left.centroid + right.centroid) / 2
    on_ridge = np.linalg.solve(normals, [left.d, right.d, ridge @ middle])
    step = right.centroid - left.centroid
    # on_ridge + s ridge = left.centroid + t step, in east and north
    system = np.column_stack([ridge[:2], -step[:2]])
    if abs(np.linalg.det(system)) < 1e-9:
        return None
    s, t = np.linalg.solve(system, (left.centroid - on_ridge)[:2])
    return (on_ridge + s * ridge, ridge) if 0.0 < t < 1.0 else None


def find_gables(p_m: np.ndarray, faces: list[Face], params: GableParameters) -> list[Gable]:
    """The gables among ``faces`` of the cloud p_m (N, 3) m; a face belongs to one at most.

    Where a face could belong to several, the pair with the greatest common length comes first.
    """
    found = []
    for a, b in combinations(range(len(faces)), 2):
        if _opposite(faces[a], faces[b], params):
            found += _gable(p_m, faces, a, b, params)
    taken, gables = set(), []
    for _, gable in sorted(found, key=lambda item: -item[0]):
        if not taken & {gable.left, gable.right}:
            taken |= {gable.left, gable.right}
            gables.append(gable)
    return gables


def _opposite(one: Face, other: Face, params: GableParameters) -> bool:
    """The faces slope away from each other, near enough to share a ridge."""
    a, b = one.normal[:2], other.normal[:2]
    turn = a @ b / (np.linalg.norm(a) * np.linalg.norm(b))
    reach = np.sqrt(one.area) + np.sqrt(other.area)
    apart = np.linalg.norm(one.centroid - other.centroid)
    return turn < -np.cos(np.radians(params.azimuth_deg)) and apart < 4 * reach


def _gable(p_m, faces, a, b, params) -> list[tuple[float, Gable]]:
    """The gable of two opposite faces after the length, m, that they share; or nothing."""
    crossing = virtual_point(faces[a], faces[b])
    if crossing is None:
        return []
    point, ridge = crossing
    if abs(ridge[2]) > np.sin(np.radians(params.ridge_slope_deg)):
        return []
    to_left = np.array([-ridge[1], ridge[0], 0.0]) / np.hypot(ridge[0], ridge[1])
    left, right = (a, b) if to_left @ (faces[a].centroid - point) > 0 else (b, a)
    one = _Side.of(p_m[faces[left].points] - point, ridge, to_left)
    if not one.is_gable_face(params):
        return []
    other = _Side.of(p_m[faces[right].points] - point, ridge, -to_left)
    common = min(one.along[1], other.along[1]) - max(one.along[0], other.along[0])
    if not (
        other.is_gable_face(params)
        and common >= max(params.overlap * min(one.length, other.length), params.min_length_m)
        and min(one.width, other.width) >= params.width_ratio * max(one.width, other.width)
    ):
        return []
    extent = np.array([min(one.along[0], other.along[0]), max(one.along[1], other.along[1])])
    return [(common, Gable(left, right, point, ridge, extent))]


@dataclass(frozen=True)
class _Side:
    """One face in ridge coordinates: 1st and 99th percentile of its points ``along`` and ``across``
    the ridge (m, across positive on its own side), of their ``height`` over it, and how far each
    end near the ridge is ``inset`` against the eaves."""

    along: np.ndarray
    across: np.ndarray
    height: np.ndarray
    inset: np.ndarray

    @property
    def length(self) -> float:
        """m, along the ridge."""
        return float(self.along[1] - self.along[0])

    @property
    def width(self) -> float:
        """m, across the ridge, in plan."""
        return float(self.across[1] - self.across[0])

    @staticmethod
    def of(q: np.ndarray, ridge: np.ndarray, outward: np.ndarray) -> "_Side":
        """Of points q (K, 3) m, relative to a point of the ridge."""
        coordinates = np.column_stack([q @ ridge, q @ outward, q[:, 2]])
        along, across, height = np.percentile(coordinates, [1, 99], axis=0).T
        quarter = (across[1] - across[0]) / 4
        near = coordinates[coordinates[:, 1] <= across[0] + quarter, 0]
        far = coordinates[coordinates[:, 1] >= across[1] - quarter, 0]
        near, far = np.percentile(near, [2, 98]), np.percentile(far, [2, 98])
        return _Side(along, across, height, np.array([near[0] - far[0], far[1] - near[1]]))

    def is_gable_face(self, params: GableParameters) -> bool:
        """Begins at the ridge, keeps to its side and under it, is large enough, and no hip's."""
        return bool(
            abs(self.across[0]) <= params.ridge_gap_m
            and self.height[1] <= params.ridge_gap_m
            and self.width >= params.min_width_m
            and self.length >= params.min_length_m
            and self.inset.min() <= params.hip_inset * self.width
        )


@dataclass(frozen=True)
class RoofParameters:
    """Parameters of the chain; each part says where it departs from Table 2, and why.

    ``cell_m`` thins the cloud on which planes are grown: at 0.5 m the 40 points that Table 2 asks
    of a segment are about 9 m² of roof.
    """

    cell_m: float = 0.5
    outliers: OutlierParameters = field(default_factory=OutlierParameters)
    ground: GroundParameters = field(default_factory=GroundParameters)
    ransac: RansacParameters = field(default_factory=RansacParameters)
    growing: GrowingParameters = field(default_factory=GrowingParameters)
    assignment: AssignmentParameters = field(default_factory=AssignmentParameters)
    gable: GableParameters = field(default_factory=GableParameters)

    def coarse(self) -> "RoofParameters":
        """The same for the central beams (within 3.5 deg) under a boresight wrong by up to 3
        degrees.

        At 30 m these beams meet the roof up to 1.8 m ahead and behind; 3 degrees in pitch move
        them apart by 9 cm either way, 18 cm at the 60 m of the swath's edge. Hence tolerances of
        25 cm, and 8 degrees between local normals that come from such points. 3 degrees in roll
        tilt the ridge by as much and so turn the slope directions of a roof of 15 degrees by
        3 / tan 15 = 11 degrees, each its own way.
        """
        return replace(
            self,
            ransac=replace(self.ransac, tolerance_m=0.25, normal_deg=30.0),
            growing=replace(self.growing, angle_deg=8.0, residual_m=0.25),
            assignment=replace(self.assignment, ceiling_m=0.30),
            gable=replace(self.gable, azimuth_deg=30.0, ridge_slope_deg=8.0),
        )


@dataclass(frozen=True)
class Roofs:
    """What was found in one strip: ``faces``, and ``gables`` that name faces by their number.
    Faces' points index the array handed to `extract`."""

    faces: tuple[Face, ...]
    gables: tuple[Gable, ...]


def candidates(p_m: np.ndarray, params: RoofParameters | None = None) -> np.ndarray:
    """Indices (K,) of the points that can lie on a roof: no outliers, no ground.

    p_m : (N, 3) array, m, m-frame (z up), one strip, whatever the boresight.
    """
    params = params or RoofParameters()
    kept = np.flatnonzero(statistical_outliers(p_m, params.outliers.k, params.outliers.alpha))
    return kept[~progressive_morphological_filter(p_m[kept], params.ground)]


def extract(p_m: np.ndarray, params: RoofParameters, rng: np.random.Generator) -> Roofs:
    """The gable roofs among candidate points p_m (K, 3), m, m-frame."""
    thinned = thin(p_m, params.cell_m)
    if len(thinned) < params.growing.size[0]:
        return Roofs((), ())
    around = neighbourhood(thinned.p_m, params.growing.neighbours, params.growing.max_gap_m)
    group = _consensus_sets(thinned, around, params, rng)
    segments = _segments(grow_regions(around, group, params.growing), params)
    faces = assign(p_m, thinned, segments, params.cell_m, params.assignment)
    faces = [face for face in faces if _is_sloped(face, params)]
    return _of_gables(faces, find_gables(p_m, faces, params.gable))


def objects(p_m: np.ndarray, cell_m: float) -> list[np.ndarray]:
    """Index arrays of the objects among points (V, 3): islands of cells, seen from above."""
    east, north = cells(p_m[:, :2], cell_m)
    occupied = np.zeros((east.max() + 1, north.max() + 1), dtype=bool)
    occupied[east, north] = True
    island, _ = ndimage.label(occupied, structure=np.ones((3, 3)))
    number = island[east, north]
    order = np.argsort(number, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(number[order])) + 1)


def _consensus_sets(
    thinned: Thinned, around: Neighbourhood, params: RoofParameters, rng
) -> np.ndarray:
    """Number (V,) of the RANSAC plane that each thinned point belongs to, -1 for none."""
    group, number = np.full(len(thinned), -1), 0
    for members in objects(thinned.p_m, 2 * params.cell_m):
        if len(members) < params.growing.size[0]:
            continue
        for consensus in ransac_planes(thinned.p_m, around, members, params.ransac, rng):
            group[consensus] = number
            number += 1
    return group


def _segments(label: np.ndarray, params: RoofParameters) -> list[np.ndarray]:
    """Index arrays of the segments of an admissible size."""
    smallest, largest = params.growing.size
    count = np.bincount(label[label >= 0])
    wanted = np.flatnonzero((count >= smallest) & (count <= largest))
    return [np.flatnonzero(label == number) for number in wanted]


def _is_sloped(face: Face, params: RoofParameters) -> bool:
    low, high = np.radians(params.ransac.slope_deg)
    return bool(low <= face.slope <= high)


def _of_gables(faces: list[Face], gables: list[Gable]) -> Roofs:
    """Only the faces that make a gable, renumbered."""
    kept = sorted({number for gable in gables for number in (gable.left, gable.right)})
    new = {old: number for number, old in enumerate(kept)}
    return Roofs(
        tuple(faces[old] for old in kept),
        tuple(Gable(new[g.left], new[g.right], g.virtual_point, g.ridge, g.extent) for g in gables),
    )
