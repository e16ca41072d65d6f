"""Gable roofs from pairs of faces, and their virtual points (section 2.2.4, Fig. 4)."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from paperrepro.segmentation.faces import Face


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
