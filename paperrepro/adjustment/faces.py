"""Centroid and plane of a face as functions of the unknowns, with their derivatives.

A reference plane is no constant: it moves with the boresight as the points on it do. Its normal is
the eigenvector of least eigenvalue of the scatter ``S(x)``; the derivative of an eigenvector is
``sum_m u_m (u_m . dS n) / (lambda_0 - lambda_m)``.
"""

from dataclasses import dataclass

import numba
import numpy as np

from paperrepro.adjustment.normals import Unknowns
from paperrepro.adjustment.sightlines import Sightlines, axes, body_ray, ray
from paperrepro.georeference import body_to_map
from paperrepro.kernels import over_threads
from paperrepro.survey import Rays


@dataclass(frozen=True)
class FaceStates:
    """Faces under given unknowns, F of them: ``count`` (F,), ``centroid`` (F, 3) m, ``J_centroid``
    (F, 3, u); ``plane`` (F, 4) as (n, d) with d reckoned from the m-frame's origin, ``J_plane``
    (F, 4, u), NaN where the points do not define a plane; ``rms`` (F,) m of the points about the
    plane, ``width`` (F,) m RMS along the lesser of its two directions; ``scatter`` (F, 3, 3) m²
    about the centroid, summed over the points."""

    count: np.ndarray
    centroid: np.ndarray
    J_centroid: np.ndarray
    plane: np.ndarray
    J_plane: np.ndarray
    rms: np.ndarray
    width: np.ndarray
    scatter: np.ndarray


def face_states(
    rays: Rays | Sightlines, ranges: np.ndarray, unknowns: Unknowns, x: np.ndarray
) -> FaceStates:
    """`FaceStates` of faces whose points are ``ranges[f, 0]:ranges[f, 1]``."""
    n_faces, size = len(ranges), unknowns.size
    centroid, J = np.zeros((n_faces, 3)), np.zeros((n_faces, 3, size))
    scatter, cross = np.zeros((n_faces, 3, 3)), np.zeros((n_faces, 3, 3, size))
    R_l_b, dR_l_b, *mounted = unknowns.kernel_arguments(x)
    turned = R_l_b, axes(R_l_b, dR_l_b), *mounted
    over_threads(
        _face_sums, n_faces, *Sightlines.of(rays).columns(), ranges, *turned, centroid, J,
        scatter, cross, least=1,
    )  # fmt: skip
    count = ranges[:, 1] - ranges[:, 0]
    plane, J_plane = _plane_of_scatter(centroid, J, scatter, cross)
    values = np.maximum(np.linalg.eigvalsh(scatter), 0)
    rms, width = np.sqrt(values[:, :2] / count[:, None]).T
    return FaceStates(count, centroid, J, plane, J_plane, rms, width, scatter)


def _plane_of_scatter(centroid, J_centroid, scatter, cross):
    """PCA plane (F, 4) and its derivatives (F, 4, u)."""
    values, vectors = np.linalg.eigh(scatter)
    n = vectors[:, :, 0] * np.where(vectors[:, 2:, 0] < 0, -1.0, 1.0)
    dS_n = np.einsum("fabk,fb->fak", cross, n) + np.einsum("fbak,fb->fak", cross, n)
    gap = values[:, :1] - values[:, 1:]  # (F, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.einsum("fam,fak->fmk", vectors[:, :, 1:], dS_n) / gap[:, :, None]
    J_n = np.einsum("fam,fmk->fak", vectors[:, :, 1:], along)
    d = np.einsum("fa,fa->f", n, centroid)
    J_d = np.einsum("fak,fa->fk", J_n, centroid) + np.einsum("fa,fak->fk", n, J_centroid)
    return np.column_stack([n, d]), np.concatenate([J_n, J_d[:, None]], axis=1)


@numba.njit(cache=True, nogil=True)
def _face_sums(
    first, last, position, turns, rho, ring, ranges, R_l_b, turn_axes, lever, offsets, ring_column,
    centroid, J, scatter, cross,
):  # fmt: skip
    """Fill the last four of faces ``first`` to ``last``."""
    q, J_x, near = np.empty(3), np.empty((3, 4)), np.zeros(3)
    for f in range(first, last):
        begin, end = ranges[f, 0], ranges[f, 1]
        of_f = centroid[f], J[f], scatter[f], cross[f]
        for i in range(begin, end):
            r = rho[i] + offsets[ring[i]]
            there, then = ray(position, turns, i)
            _point(there, then, r, R_l_b, turn_axes, lever, q, J_x)
            for a in range(3):
                if i == begin:  # sums are reckoned from a point of the face: no digits are lost
                    near[a] = q[a]
                q[a] -= near[a]
            _add(q, J_x, ring_column[ring[i]], *of_f)
        _centre(end - begin, near, *of_f)


@numba.njit(cache=True)
def _point(position, turns, r, R_l_b, turn_axes, lever, p, J_x):
    """Eq. (1) of a ray of length ``r`` m: ``p`` (3,) m, ``J_x`` (3, 4) by the angles and ``r``."""
    R = body_to_map(turns)
    x, y, z = body_ray(turns, r, R_l_b)
    k_x, k_y, k_z = body_ray(turns, 1.0, R_l_b)
    for j in range(3):
        p[j] = position[j] + (
            R[j][0] * (x + lever[0]) + R[j][1] * (y + lever[1]) + R[j][2] * (z + lever[2])
        )
        J_x[j, 3] = R[j][0] * k_x + R[j][1] * k_y + R[j][2] * k_z
    for k in range(3):
        a = turn_axes[k, 1] * z - turn_axes[k, 2] * y
        b = turn_axes[k, 2] * x - turn_axes[k, 0] * z
        c = turn_axes[k, 0] * y - turn_axes[k, 1] * x
        for j in range(3):
            J_x[j, k] = R[j][0] * a + R[j][1] * b + R[j][2] * c


@numba.njit(cache=True)
def _add(q, J_x, column, centroid, J, scatter, cross):
    """Add a point ``q`` (3,) to the sums of its face."""
    for a in range(3):
        centroid[a] += q[a]
        for k in range(3):
            J[a, k] += J_x[a, k]
        if column >= 0:
            J[a, column] += J_x[a, 3]
        for b in range(3):
            scatter[a, b] += q[a] * q[b]
            for k in range(3):
                cross[a, b, k] += q[a] * J_x[b, k]
            if column >= 0:
                cross[a, b, column] += q[a] * J_x[b, 3]


@numba.njit(cache=True)
def _centre(count, near, centroid, J, scatter, cross):
    """Sums reckoned from ``near`` become means, and sums about the mean."""
    for a in range(3):
        for b in range(3):
            scatter[a, b] -= centroid[a] * centroid[b] / count
            for k in range(J.shape[1]):
                cross[a, b, k] -= centroid[a] * J[b, k] / count
    for a in range(3):
        centroid[a] = near[a] + centroid[a] / count
        for k in range(J.shape[1]):
            J[a, k] /= count
