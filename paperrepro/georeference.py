"""The LiDAR equation, Eq. (1) and (2), and its derivatives.

    p_m = g_m + R_b_m (R_l_b r_l + lever),   r_l = rho (cos b cos a, cos b sin a, sin b)

with rho the measured range plus the ring's range offset. Frames: `paperrepro.frames`.
"""

import numba
import numpy as np

from paperrepro.frames import rotation_zyx
from paperrepro.survey import Mounting, Rays, Strip, Survey

#: Columns of the derivatives with respect to the parameters, before the range offset.
BORESIGHT = ("omega", "phi", "kappa")
#: Observations of one laser point, in the order of `point_jacobians`.
OBSERVATIONS = ("east", "north", "up", "roll", "pitch", "heading", "range", "azimuth", "elevation")


def georeference(rays: Rays, mounting: Mounting) -> np.ndarray:
    """Points (N, 3) m, m-frame, of ``rays`` under ``mounting``. Eq. (1), Eq. (2)."""
    p_m = np.empty((len(rays), 3))
    n_rings = int(rays.ring.max()) + 1 if len(rays) else 0
    _georeference(
        rays.pose,
        rays.ring,
        rays.azimuth,
        rays.elevation,
        rays.rho,
        mounting.R_l_b,
        np.asarray(mounting.lever_arm, float),
        mounting.offsets(n_rings),
        p_m,
    )
    return p_m


def georeference_strip(
    survey: Survey, strip: Strip, mounting: Mounting | None = None
) -> np.ndarray:
    """Points (N, 3) m, m-frame, of a whole strip; by default under the survey's own mounting."""
    return georeference(survey.rays(strip), survey.mounting if mounting is None else mounting)


@numba.njit(cache=True)
def _rotate(R, v):
    return (
        R[0][0] * v[0] + R[0][1] * v[1] + R[0][2] * v[2],
        R[1][0] * v[0] + R[1][1] * v[1] + R[1][2] * v[2],
        R[2][0] * v[0] + R[2][1] * v[1] + R[2][2] * v[2],
    )


@numba.njit(cache=True)
def body_to_map_matrix(roll, pitch, heading):
    """``R_b_m`` as nested tuples, so that a loop over points allocates nothing."""
    cx, sx = np.cos(roll), np.sin(roll)
    cy, sy = np.cos(pitch), np.sin(pitch)
    cz, sz = np.cos(heading), np.sin(heading)
    return (
        (sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx),
        (cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx),
        (sy, -cy * sx, -cy * cx),
    )


@numba.njit(cache=True, parallel=True)
def _georeference(pose, ring, azimuth, elevation, rho, R_l_b, lever, offsets, p_m):
    for i in numba.prange(len(rho)):
        r = rho[i] + offsets[ring[i]]
        cb = np.cos(elevation[i])
        r_l = (r * cb * np.cos(azimuth[i]), r * cb * np.sin(azimuth[i]), r * np.sin(elevation[i]))
        x, y, z = _rotate(R_l_b, r_l)
        R = body_to_map_matrix(pose[i, 3], pose[i, 4], pose[i, 5])
        east, north, up = _rotate(R, (x + lever[0], y + lever[1], z + lever[2]))
        p_m[i, 0] = pose[i, 0] + east
        p_m[i, 1] = pose[i, 1] + north
        p_m[i, 2] = pose[i, 2] + up


@numba.njit(cache=True)
def boresight_derivatives(boresight, R_nominal):
    """dR_l_b/d(omega, phi, kappa), (3, 3, 3), first index the angle."""
    omega, phi, kappa = boresight
    out = np.empty((3, 3, 3))
    axis = np.zeros((3, 3, 3))  # generators: axis[k] @ v = e_k x v
    axis[0, 1, 2], axis[0, 2, 1] = -1.0, 1.0
    axis[1, 0, 2], axis[1, 2, 0] = 1.0, -1.0
    axis[2, 0, 1], axis[2, 1, 0] = -1.0, 1.0
    Rx = rotation_zyx(omega, 0.0, 0.0)
    Ry = rotation_zyx(0.0, phi, 0.0)
    Rz = rotation_zyx(0.0, 0.0, kappa)
    out[0] = Rz @ Ry @ axis[0] @ Rx @ R_nominal
    out[1] = Rz @ axis[1] @ Ry @ Rx @ R_nominal
    out[2] = axis[2] @ Rz @ Ry @ Rx @ R_nominal
    return out


@numba.njit(cache=True)
def point_jacobians(obs, R_l_b, dR_l_b, lever, offset, p, J_x, J_l):
    """One laser point and its derivatives, from Eq. (1) and (2).

    ``obs`` (9,) as `OBSERVATIONS`, ``dR_l_b`` from `boresight_derivatives`. Fills ``p`` (3,) m
    m-frame, ``J_x`` (3, 4) with respect to omega, phi, kappa and the ring's range offset, and
    ``J_l`` (3, 9) with respect to the observations.
    """
    ca, sa = np.cos(obs[7]), np.sin(obs[7])
    cb, sb = np.cos(obs[8]), np.sin(obs[8])
    r = obs[6] + offset
    R = body_to_map_matrix(obs[3], obs[4], obs[5])
    r_l = (r * cb * ca, r * cb * sa, r * sb)
    x, y, z = _rotate(R_l_b, r_l)
    x, y, z = x + lever[0], y + lever[1], z + lever[2]
    v_m = _rotate(R, (x, y, z))
    along = _rotate(R, _rotate(R_l_b, (cb * ca, cb * sa, sb)))
    across = _rotate(R, _rotate(R_l_b, (-r * cb * sa, r * cb * ca, 0.0)))
    upward = _rotate(R, _rotate(R_l_b, (-r * sb * ca, -r * sb * sa, r * cb)))
    by_roll = _rotate(R, (0.0, -z, y))
    # pitch turns about the levelled y axis: east cos(heading), north -sin(heading)
    e, n = np.cos(obs[5]), -np.sin(obs[5])
    by_pitch = (n * v_m[2], -e * v_m[2], e * v_m[1] - n * v_m[0])
    by_heading = (v_m[1], -v_m[0], 0.0)  # about down
    for k in range(3):
        turned = _rotate(R, _rotate(dR_l_b[k], r_l))
        for j in range(3):
            J_x[j, k] = turned[j]
    for j in range(3):
        p[j] = obs[j] + v_m[j]
        J_x[j, 3] = along[j]
        for k in range(3):
            J_l[j, k] = 1.0 if j == k else 0.0
        J_l[j, 3], J_l[j, 4], J_l[j, 5] = by_roll[j], by_pitch[j], by_heading[j]
        J_l[j, 6], J_l[j, 7], J_l[j, 8] = along[j], across[j], upward[j]
