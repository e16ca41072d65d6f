"""The centroid condition, Eq. (5): the centroid of a face lies on the face's plane in other strips.

A centroid is treated as one virtual laser point. Its range and angles are averages, so their
variances fall with the number of points; its pose is shared by all of them, so the variance of the
GNSS/INS does not fall. Where the plane is taken from a reference strip, that strip's own pose error
moves it, and adds.
"""

import numpy as np

from paperrepro.adjustment.faces import FaceStates
from paperrepro.adjustment.normals import Blocks, Unknowns
from paperrepro.frames import attitude_matrix
from paperrepro.georeference import point_jacobians

N_POSE = 6


def virtual_jacobians(
    centroids: np.ndarray, poses: np.ndarray, unknowns: Unknowns, x: np.ndarray
) -> np.ndarray:
    """Derivatives (F, 3, 9) of ``centroids`` (F, 3), each a ray from its mean pose (F, 6)."""
    R_l_b, dR_l_b, lever, _, _ = unknowns.kernel_arguments(x)
    R_b_m = attitude_matrix(*poses[:, 3:].T)
    arm = np.einsum("fij,fi->fj", R_b_m, centroids - poses[:, :3])
    r_l = (arm - lever) @ R_l_b
    rho = np.linalg.norm(r_l, axis=1)
    angles = np.arctan2(r_l[:, 1], r_l[:, 0]), np.arcsin(r_l[:, 2] / rho)
    obs = np.column_stack([poses, rho, *angles])
    return point_jacobians(obs, R_l_b, dR_l_b, lever, 0.0)[2]


def centroid_variances(
    normals: np.ndarray, J_l: np.ndarray, count: np.ndarray, variances: np.ndarray
) -> np.ndarray:
    """``B Q B'`` (K,) of Eq. (5) for ``normals`` (K, 3), virtual rays ``J_l`` (K, 3, 9) of
    ``count`` points.
    """
    shared = np.where(np.arange(9) < N_POSE, 1.0, 1.0 / count[:, None])
    b = np.einsum("ka,kam->km", normals, J_l)
    return (np.square(b) * variances * shared).sum(axis=1)


def centroid_blocks(
    face: np.ndarray,
    group: np.ndarray,
    states: FaceStates,
    origin: np.ndarray,
    planes: np.ndarray,
    s: np.ndarray,
) -> Blocks:
    """Blocks of Eq. (5): centroid of ``face`` (K,) on plane ``group`` (K,), variances ``s`` (K,).

    ``planes`` (G, 4) holds (n, d) with d from ``origin`` (G, 3).
    """
    relative = states.centroid[face] - origin[group]
    n, d = planes[group, :3], planes[group, 3]
    row = np.concatenate(
        [np.einsum("ka,kau->ku", n, states.J_centroid[face]), relative, -np.ones((len(face), 1))],
        axis=1,
    )
    w = np.einsum("ka,ka->k", n, relative) - d
    size = row.shape[1]
    N, t = np.zeros((len(planes), size, size)), np.zeros((len(planes), size))
    chi2, count = np.zeros(len(planes)), np.zeros(len(planes), int)
    np.add.at(N, group, row[:, :, None] * row[:, None, :] / s[:, None, None])
    np.add.at(t, group, row * (w / s)[:, None])
    np.add.at(chi2, group, w * w / s)
    np.add.at(count, group, 1)
    return Blocks(N, t, chi2, count)
