"""The LiDAR equation, Eq. (1) and (2), and its derivatives.

    p_m = g_m + R_b_m (R_l_b r_l + lever),   r_l = rho (cos b cos a, cos b sin a, sin b)

with rho the measured range plus the ring's range offset. Frames: `paperrepro.frames`.
"""

import numba
import numpy as np

from paperrepro.frames import T_NED_ENU, rotation_zyx
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
        rays.pose, rays.ring, rays.azimuth, rays.elevation, rays.rho,
        mounting.R_l_b, np.asarray(mounting.lever_arm, float), mounting.offsets(n_rings), p_m,
    )
    return p_m


def georeference_strip(survey: Survey, strip: Strip, mounting: Mounting | None = None) -> np.ndarray:
    """Points (N, 3) m, m-frame, of a whole strip; by default under the survey's own mounting."""
    return georeference(survey.rays(strip), survey.mounting if mounting is None else mounting)


@numba.njit(cache=True, inline="always")
def _rotate(R, v):
    return (
        R[0, 0] * v[0] + R[0, 1] * v[1] + R[0, 2] * v[2],
        R[1, 0] * v[0] + R[1, 1] * v[1] + R[1, 2] * v[2],
        R[2, 0] * v[0] + R[2, 1] * v[1] + R[2, 2] * v[2],
    )


@numba.njit(cache=True, inline="always")
def _body_to_map(roll, pitch, heading, v):
    """``R_b_m @ v`` without forming the matrix."""
    c, s = np.cos(roll), np.sin(roll)
    y, z = c * v[1] - s * v[2], s * v[1] + c * v[2]
    c, s = np.cos(pitch), np.sin(pitch)
    x, z = c * v[0] + s * z, c * z - s * v[0]
    c, s = np.cos(heading), np.sin(heading)
    north, east = c * x - s * y, s * x + c * y
    return east, north, -z


@numba.njit(cache=True, parallel=True)
def _georeference(pose, ring, azimuth, elevation, rho, R_l_b, lever, offsets, p_m):
    for i in numba.prange(len(rho)):
        r = rho[i] + offsets[ring[i]]
        cb = np.cos(elevation[i])
        r_l = (r * cb * np.cos(azimuth[i]), r * cb * np.sin(azimuth[i]), r * np.sin(elevation[i]))
        x, y, z = _rotate(R_l_b, r_l)
        east, north, up = _body_to_map(
            pose[i, 3], pose[i, 4], pose[i, 5], (x + lever[0], y + lever[1], z + lever[2])
        )
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
    """One laser point and its derivatives.

    ``obs`` (9,) as `OBSERVATIONS`, ``dR_l_b`` from `boresight_derivatives`. Fills ``p`` (3,) m
    m-frame, ``J_x`` (3, 4) with respect to omega, phi, kappa and the ring's range offset, and
    ``J_l`` (3, 9) with respect to the observations. Derivatives of Eq. (1) and (2).
    """
    ca, sa = np.cos(obs[7]), np.sin(obs[7])
    cb, sb = np.cos(obs[8]), np.sin(obs[8])
    r = obs[6] + offset
    u = (cb * ca, cb * sa, sb)
    r_l = (r * u[0], r * u[1], r * u[2])
    x, y, z = _rotate(R_l_b, r_l)
    v_b = (x + lever[0], y + lever[1], z + lever[2])
    roll, pitch, heading = obs[3], obs[4], obs[5]
    v_m = _body_to_map(roll, pitch, heading, v_b)
    along = _body_to_map(roll, pitch, heading, _rotate(R_l_b, u))
    across = _body_to_map(roll, pitch, heading, _rotate(R_l_b, (-r * cb * sa, r * cb * ca, 0.0)))
    upward = _body_to_map(roll, pitch, heading, _rotate(R_l_b, (-r * sb * ca, -r * sb * sa, r * cb)))
    for k in range(3):
        turned = _body_to_map(roll, pitch, heading, _rotate(dR_l_b[k], r_l))
        for j in range(3):
            J_x[j, k] = turned[j]
    by_roll, by_pitch, by_heading = _attitude_derivatives(roll, pitch, heading, v_b, v_m)
    for j in range(3):
        p[j] = obs[j] + v_m[j]
        J_x[j, 3] = along[j]
        for k in range(3):
            J_l[j, k] = 1.0 if j == k else 0.0
        J_l[j, 3], J_l[j, 4], J_l[j, 5] = by_roll[j], by_pitch[j], by_heading[j]
        J_l[j, 6], J_l[j, 7], J_l[j, 8] = along[j], across[j], upward[j]


@numba.njit(cache=True, inline="always")
def _attitude_derivatives(roll, pitch, heading, v_b, v_m):
    """d(R_b_m v_b) by roll, pitch and heading: turns about body x, the levelled y, and down."""
    by_roll = _body_to_map(roll, pitch, heading, (0.0, -v_b[2], v_b[1]))
    # axis of pitch in the m-frame: east cos(heading), north -sin(heading)
    e, n = np.cos(heading), -np.sin(heading)
    by_pitch = (n * v_m[2], -e * v_m[2], e * v_m[1] - n * v_m[0])
    by_heading = (v_m[1], -v_m[0], 0.0)  # clockwise from above
    return by_roll, by_pitch, by_heading


#: Kept beside the kernels: the constant they have built in.
assert (T_NED_ENU == np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])).all()
