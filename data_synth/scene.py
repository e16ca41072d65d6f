"""The scene as triangles: each has its exact plane, its class, and the gable face it belongs to.

m-frame, metres. Planes are n . p - d = 0 with |n| = 1; those of gable faces have n_z > 0.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np


class ObjectClass(IntEnum):
    """What a pulse hit."""

    GROUND = 0
    GABLE_ROOF = 1
    WALL = 2
    CHIMNEY = 3
    DORMER = 4
    SHED_ROOF = 5
    LEAF = 6
    TRUNK = 7
    FENCE = 8
    WIRE = 9
    DUST = 10
    CAR = 11
    CONTAINER = 12
    HEAP = 13


@dataclass(frozen=True)
class RoofFace:
    """One face of a gable roof, overhang included.

    ``normal`` (3,) unit, up; ``d`` m, so that normal . p - d = 0; ``centroid`` (3,) m; ``area`` m²;
    ``corners`` (4, 3) m in order. What chimneys and dormers hide is not taken off.
    """

    id: int
    building: int
    normal: np.ndarray
    d: float
    centroid: np.ndarray
    area: float
    corners: np.ndarray


@dataclass(frozen=True)
class Scene:
    """``vertices`` (V, 3) m; ``triangles`` (T, 3) int32; ``planes`` (T, 4) n and d;
    ``triangle_class`` (T,) uint8 of `ObjectClass`; ``triangle_face`` (T,) int32 face id or -1."""

    vertices: np.ndarray
    triangles: np.ndarray
    planes: np.ndarray
    triangle_class: np.ndarray
    triangle_face: np.ndarray
    faces: tuple[RoofFace, ...]


def polygon_plane(corners: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Unit normal, d and area of a flat convex polygon (K, 3), by the fan's cross products."""
    fan = np.cross(corners[1:-1] - corners[0], corners[2:] - corners[0])
    twice_area = np.linalg.norm(fan.sum(axis=0))
    normal = fan.sum(axis=0) / twice_area
    return normal, float(normal @ corners.mean(axis=0)), 0.5 * float(twice_area)


def roof_face(id: int, building: int, corners: np.ndarray) -> RoofFace:
    """A `RoofFace` from the corners (4, 3) of a rectangle."""
    normal, d, area = polygon_plane(corners)
    if normal[2] < 0:
        normal, d = -normal, -d
    return RoofFace(id, building, normal, d, corners.mean(axis=0), area, corners)


class SceneBuilder:
    """Collects triangles; `build` makes the `Scene`."""

    def __init__(self):
        self._vertices, self._triangles, self._classes, self._faces = [], [], [], []
        self._n_vertices = 0
        self.roof_faces: list[RoofFace] = []

    def mesh(self, vertices, triangles, kind: ObjectClass, face: int = -1) -> None:
        """Add ``triangles`` (T, 3) into ``vertices`` (V, 3)."""
        self._vertices.append(np.asarray(vertices, dtype=float))
        self._triangles.append(np.asarray(triangles, dtype=np.int32) + self._n_vertices)
        self._classes.append(np.full(len(triangles), kind, dtype=np.uint8))
        self._faces.append(np.full(len(triangles), face, dtype=np.int32))
        self._n_vertices += len(vertices)

    def polygon(self, corners, kind: ObjectClass, face: int = -1) -> None:
        """Add a flat convex polygon (K, 3)."""
        fan = [(0, k, k + 1) for k in range(1, len(corners) - 1)]
        self.mesh(corners, fan, kind, face)

    def prism(self, base, top, kind: ObjectClass) -> None:
        """Add the sides between two polygons (K, 3) of equal length, and the upper one as lid."""
        for k in range(len(base)):
            j = (k + 1) % len(base)
            self.polygon([base[k], base[j], top[j], top[k]], kind)
        self.polygon(top, kind)

    def gable_face(self, building: int, corners) -> None:
        """Add a gable face and remember it as truth."""
        face = roof_face(len(self.roof_faces), building, np.asarray(corners, dtype=float))
        self.roof_faces.append(face)
        self.polygon(face.corners, ObjectClass.GABLE_ROOF, face.id)

    def build(self) -> Scene:
        """The scene; triangles of one gable face share the face's plane to the last bit."""
        vertices, triangles = np.concatenate(self._vertices), np.concatenate(self._triangles)
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        planes = np.column_stack([normal, np.einsum("ij,ij->i", normal, a)])
        owner = np.concatenate(self._faces)
        for face in self.roof_faces:
            planes[owner == face.id] = [*face.normal, face.d]
        classes = np.concatenate(self._classes)
        return Scene(vertices, triangles, planes, classes, owner, tuple(self.roof_faces))
