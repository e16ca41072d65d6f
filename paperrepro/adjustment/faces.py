"""Centroid and plane of a face as functions of the unknowns, with their derivatives.

A reference plane is no constant: it moves with the boresight as the points on it do. Its normal is
the eigenvector of least eigenvalue of the scatter ``S(x)``; the derivative of an eigenvector is
``sum_m u_m (u_m . dS n) / (lambda_0 - lambda_m)``.
"""

from dataclasses import dataclass

import numba
import numpy as np

from paperrepro.adjustment.normals import Unknowns, columns
from paperrepro.georeference import point_jacobians
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


def face_states(rays: Rays, ranges: np.ndarray, unknowns: Unknowns, x: np.ndarray) -> FaceStates:
    """`FaceStates` of faces whose points are ``ranges[f, 0]:ranges[f, 1]``."""
    n_faces, size = len(ranges), unknowns.size
    centroid, J = np.zeros((n_faces, 3)), np.zeros((n_faces, 3, size))
    scatter, cross = np.zeros((n_faces, 3, 3)), np.zeros((n_faces, 3, 3, size))
    arguments = unknowns.kernel_arguments(x)
    _face_sums(*columns(rays), ranges, *arguments, centroid, J, scatter, cross)
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


@numba.njit(cache=True, parallel=True)
def _face_sums(
    pose,
    ring,
    azimuth,
    elevation,
    rho,
    ranges,
    R_l_b,
    dR_l_b,
    lever,
    offsets,
    ring_column,
    centroid,
    J,
    scatter,
    cross,
):
    for f in numba.prange(len(ranges)):
        obs, p = np.empty(9), np.empty(3)
        J_x, J_l = np.empty((3, 4)), np.empty((3, 9))
        first, count = ranges[f, 0], ranges[f, 1] - ranges[f, 0]
        for second_pass in range(2):
            for i in range(first, first + count):
                obs[:6] = pose[i]
                obs[6], obs[7], obs[8] = rho[i], azimuth[i], elevation[i]
                point_jacobians(obs, R_l_b, dR_l_b, lever, offsets[ring[i]], p, J_x, J_l)
                if second_pass:
                    _add_products(p - centroid[f], J_x, ring_column[ring[i]], scatter[f], cross[f])
                else:
                    _add_means(p, J_x, ring_column[ring[i]], 1.0 / count, centroid[f], J[f])


@numba.njit(cache=True)
def _add_means(p, J_x, column, weight, centroid, J):
    for a in range(3):
        centroid[a] += weight * p[a]
        for k in range(3):
            J[a, k] += weight * J_x[a, k]
        if column >= 0:
            J[a, column] += weight * J_x[a, 3]


@numba.njit(cache=True)
def _add_products(r, J_x, column, scatter, cross):
    for a in range(3):
        for b in range(3):
            scatter[a, b] += r[a] * r[b]
            for k in range(3):
                cross[a, b, k] += r[a] * J_x[b, k]
            if column >= 0:
                cross[a, b, column] += r[a] * J_x[b, 3]
