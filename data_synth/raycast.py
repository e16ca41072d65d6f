"""Rays from true poses into the scene.

Open3D finds, in single precision, which triangle a ray meets; the range is then computed in double
precision from that triangle's plane, and from its relief where it has one. Written without the
method's LiDAR equation: a body's axes are built from heading, pitch and roll, so that a wrong sign
on either side shows.
"""

import os

import numba
import numpy as np

from data_synth.relief import Relief
from data_synth.scene import Scene
from paperrepro._compiled import over_threads
from paperrepro.survey import Mounting

#: Rays per batch: bounds the transient memory to about 150 MB.
BATCH = 1_000_000


def _open3d():
    """The library, loaded at the first ray: that takes a second or two, and a cached survey needs
    none. Without the variable it would start a web server in a notebook, and say so."""
    os.environ.setdefault("OPEN3D_DISABLE_WEB_VISUALIZER", "true")
    import open3d

    return open3d


class Raycaster:
    """A scene made ready for casting, with ``relief`` where its surfaces are no planes."""

    def __init__(self, scene: Scene, relief: Relief | None = None):
        o3d = _open3d()
        self._planes, self._relief = scene.planes, relief
        self._scene = o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(
            o3d.core.Tensor(scene.vertices.astype(np.float32)),
            o3d.core.Tensor(scene.triangles.astype(np.uint32)),
        )

    def cast(self, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance (N,) m, NaN where nothing is met, and triangle (N,) int32 or -1.

        ``origin`` (N, 3) m and ``direction`` (N, 3) unit, m-frame.
        """
        o3d = _open3d()
        distance, triangle = np.empty(len(origin)), np.empty(len(origin), dtype=np.int32)
        for start in range(0, len(origin), BATCH):
            part = slice(start, start + BATCH)
            single = np.concatenate([origin[part], direction[part]], axis=1, dtype=np.float32)
            hit = self._scene.cast_rays(o3d.core.Tensor(single))["primitive_ids"].numpy()
            out = distance[part], triangle[part]
            rays = origin[part], direction[part]
            over_threads(_distances, len(hit), *rays, hit, self._planes, *out)
            if self._relief is not None:
                self._relief.displace(*rays, self._planes, *out)
        return distance, triangle


@numba.njit(cache=True, nogil=True)
def _distances(first, last, origin, direction, hit, planes, distance, triangle):
    for i in range(first, last):
        k = hit[i]
        if k >= len(planes):  # Open3D's mark of a miss
            distance[i], triangle[i] = np.nan, -1
            continue
        above, rate = -planes[k, 3], 0.0
        for j in range(3):
            above += planes[k, j] * origin[i, j]
            rate -= planes[k, j] * direction[i, j]
        distance[i], triangle[i] = above / rate, k


def aim(pose, azimuth, elevation, mounting: Mounting) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions (N, 3), m-frame, of beams fired at ``pose`` (N, 6)."""
    origin, direction = np.empty((len(pose), 3)), np.empty((len(pose), 3))
    given = pose, azimuth, elevation, mounting.R_l_b, mounting.lever_arm
    over_threads(_aim, len(pose), *given, origin, direction)
    return origin, direction


@numba.njit(cache=True, nogil=True)
def _aim(first, last, pose, azimuth, elevation, R_l_b, lever, origin, direction):
    for i in range(first, last):
        cb = np.cos(elevation[i])
        l_x, l_y, l_z = cb * np.cos(azimuth[i]), cb * np.sin(azimuth[i]), np.sin(elevation[i])
        sr, cr = np.sin(pose[i, 3]), np.cos(pose[i, 3])
        sp, cp = np.sin(pose[i, 4]), np.cos(pose[i, 4])
        sh, ch = np.sin(pose[i, 5]), np.cos(pose[i, 5])
        forward = (sh * cp, ch * cp, sp)
        level = (ch, -sh, 0.0)  # right wing before rolling
        below = (sh * sp, ch * sp, -cp)  # forward x level
        for j in range(3):
            right = cr * level[j] + sr * below[j]
            down = cr * below[j] - sr * level[j]
            origin[i, j] = pose[i, j] + forward[j] * lever[0] + right * lever[1] + down * lever[2]
            direction[i, j] = (
                forward[j] * (R_l_b[0, 0] * l_x + R_l_b[0, 1] * l_y + R_l_b[0, 2] * l_z)
                + right * (R_l_b[1, 0] * l_x + R_l_b[1, 1] * l_y + R_l_b[1, 2] * l_z)
                + down * (R_l_b[2, 0] * l_x + R_l_b[2, 1] * l_y + R_l_b[2, 2] * l_z)
            )
