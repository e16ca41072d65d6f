"""The same work by others: NumPy alone, Open3D, and a mere copy of what goes in and out."""

import os

import numpy as np

from paperrepro.frames import T_NED_ENU
from paperrepro.survey import Mounting, Rays

os.environ.setdefault("OPEN3D_DISABLE_WEB_VISUALIZER", "true")


def copy(*arrays: np.ndarray) -> None:
    """What memory alone costs: every array read once and written once."""
    for array in arrays:
        np.copy(array)


def columns(rays: Rays) -> tuple[np.ndarray, ...]:
    """What the LiDAR equation reads."""
    return rays.pose, rays.ring, rays.azimuth, rays.elevation, rays.rho


def lidar_equation(rays: Rays, mounting: Mounting) -> np.ndarray:
    """Points (N, 3) m by Eq. (1) and (2) in NumPy, a matrix for each pose."""
    offsets = mounting.offsets(16)[rays.ring]
    flat = np.cos(rays.elevation)
    direction = np.stack(
        [flat * np.cos(rays.azimuth), flat * np.sin(rays.azimuth), np.sin(rays.elevation)], axis=1
    )
    r_l = (rays.rho + offsets)[:, None] * direction
    r_b = np.einsum("ab,nb->na", mounting.R_l_b, r_l) + mounting.lever_arm
    return rays.pose[:, :3] + np.einsum("nab,nb->na", attitudes(rays.pose[:, 3:]), r_b)


def attitudes(angles: np.ndarray) -> np.ndarray:
    """``R_b_m`` (N, 3, 3) of roll, pitch, heading (N, 3)."""
    (sr, sp, sh), (cr, cp, ch) = np.sin(angles.T), np.cos(angles.T)
    R = np.array(
        [
            [ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr],
            [sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    return np.einsum("ab,bcn->nac", T_NED_ENU, R)


def as_cloud(p_m: np.ndarray):
    """An Open3D point cloud, reckoned from its middle."""
    import open3d

    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(p_m - p_m.mean(axis=0)))


def outliers(cloud, count: int, k: int = 16, alpha: float = 10.0) -> np.ndarray:
    """Mask (N,) of what Open3D keeps; it counts a point among its own neighbours."""
    _, index = cloud.remove_statistical_outlier(nb_neighbors=k + 1, std_ratio=alpha)
    kept = np.zeros(count, dtype=bool)
    kept[np.asarray(index)] = True
    return kept


def planes(cloud) -> list:
    """Normals of ten neighbours, then planar patches, by Open3D."""
    import open3d

    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(knn=11))
    return cloud.detect_planar_patches(search_param=open3d.geometry.KDTreeSearchParamKNN(knn=11))


def jaccard(one: np.ndarray, other: np.ndarray) -> float:
    """Of two masks; 1 where both are empty."""
    either = (one | other).sum()
    return float((one & other).sum() / either) if either else 1.0
