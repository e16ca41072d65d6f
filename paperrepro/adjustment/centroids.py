"""The centroid condition, Eq. (5): the centroid of a face lies on the face's plane in other strips.

A centroid is treated as one virtual laser point. Its range and angles are averages, so their
variances fall with the number of points; its pose is shared by all of them, so the variance of the
GNSS/INS does not fall. Where the plane is taken from a reference strip, that strip's own pose error
moves it, and adds.
"""

import numba
import numpy as np

from paperrepro.adjustment.faces import FaceStates
from paperrepro.adjustment.normals import Blocks, Unknowns
from paperrepro.adjustment.sightlines import body_to_map
from paperrepro.georeference import point_jacobians

N_POSE = 6


def virtual_jacobians(
    centroids: np.ndarray, poses: np.ndarray, unknowns: Unknowns, x: np.ndarray
) -> np.ndarray:
    """Derivatives (F, 3, 9) of ``centroids`` (F, 3), each a ray from its mean pose (F, 6)."""
    out = np.empty((len(centroids), 3, 9))
    R_l_b, dR_l_b, lever, _, _ = unknowns.kernel_arguments(x)
    _virtual_jacobians(centroids, poses, R_l_b, dR_l_b, lever, out)
    return out


@numba.njit(cache=True)
def _virtual_jacobians(centroids, poses, R_l_b, dR_l_b, lever, out):
    p, J_x, obs = np.empty(3), np.empty((3, 4)), np.empty(9)
    for k in range(len(centroids)):
        v_b, r_l = np.empty(3), np.zeros(3)
        sine, cosine = np.sin(poses[k, 3:]), np.cos(poses[k, 3:])
        R = body_to_map((sine[0], cosine[0], sine[1], cosine[1], sine[2], cosine[2]))
        for i in range(3):
            v_b[i] = -lever[i]
            for j in range(3):
                v_b[i] += R[j][i] * (centroids[k, j] - poses[k, j])
        for i in range(3):
            for j in range(3):
                r_l[i] += R_l_b[j, i] * v_b[j]
        obs[:6] = poses[k]
        obs[6] = np.sqrt(r_l[0] ** 2 + r_l[1] ** 2 + r_l[2] ** 2)
        obs[7], obs[8] = np.arctan2(r_l[1], r_l[0]), np.arcsin(r_l[2] / obs[6])
        point_jacobians(obs, R_l_b, dR_l_b, lever, 0.0, p, J_x, out[k])


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
