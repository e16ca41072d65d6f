"""The LiDAR equation, Eq. (1) and (2), and its derivatives.

    p_m = g_m + R_b_m (R_l_b r_l + lever),   r_l = rho (cos b cos a, cos b sin a, sin b)

with rho the measured range plus the ring's range offset. Frames: `paperrepro.frames`.
"""

import numba
import numpy as np

from paperrepro._compiled import AZIMUTH, HEADING, PITCH, ROLL, over_threads, sines_near
from paperrepro.frames import attitude_matrix, rotation_zyx
from paperrepro.survey import Mounting, Rays, Strip, Survey

#: Columns of the derivatives with respect to the parameters, before the range offset.
BORESIGHT = ("omega", "phi", "kappa")
#: Observations of one laser point, in the order of `point_jacobians`.
OBSERVATIONS = ("east", "north", "up", "roll", "pitch", "heading", "range", "azimuth", "elevation")
#: Rays of a strip at a time, which take four times as much memory as the strip.
CHUNK = 1_000_000
#: (3, 3, 3): the k-th matrix times a vector is the k-th axis x the vector.
AXIS_CROSS = np.cross(np.eye(3)[:, None], np.eye(3)[None]).transpose(0, 2, 1)


def georeference(rays: Rays, mounting: Mounting) -> np.ndarray:
    """The LiDAR equation: where laser points lie.

    Parameters
    ----------
    rays : Rays
        N of them, each with its pose.
    mounting : Mounting

    Returns
    -------
    (N, 3) array, m, m-frame

    Raises
    ------
    BadInput
        Where the mounting has offsets for fewer rings.

    References
    ----------
    Eq. (1) and (2) of the paper.
    """
    p_m, rays = np.empty((len(rays), 3)), mounting.pointed(rays)
    n_rings = int(rays.ring.max()) + 1 if len(rays) else 0
    over_threads(
        _georeference,
        len(rays),
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
    mounting = survey.mounting if mounting is None else mounting
    p_m = np.empty((len(strip), 3))
    for start in range(0, max(len(strip), 1), CHUNK):
        part = slice(start, start + CHUNK)
        p_m[part] = georeference(survey.rays(strip, part), mounting)
    return p_m


@numba.njit(cache=True)
def _rotate(R, v):
    return (
        R[0][0] * v[0] + R[0][1] * v[1] + R[0][2] * v[2],
        R[1][0] * v[0] + R[1][1] * v[1] + R[1][2] * v[2],
        R[2][0] * v[0] + R[2][1] * v[1] + R[2][2] * v[2],
    )


@numba.njit(cache=True)
def body_to_map(turns):
    """``R_b_m`` by rows, as nested tuples, so that a loop over points allocates nothing; ``turns``
    begins with sine and cosine of roll, of pitch and of heading."""
    sr, cr, sp, cp, sh, ch = turns[0], turns[1], turns[2], turns[3], turns[4], turns[5]
    return (
        (sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr),
        (ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr),
        (sp, -cp * sr, -cp * cr),
    )


@numba.njit(cache=True, nogil=True)
def _georeference(
    first, last, pose, ring, azimuth, elevation, rho, R_l_b, lever, offsets, p_m
):  # fmt: skip
    """Rays ``first`` to ``last``, each by the sines of the one before."""
    before, beams = np.full((4, 3), np.nan), np.full((len(offsets), 3), np.nan)
    for i in range(first, last):
        sa, ca = sines_near(azimuth[i], before, AZIMUTH)
        sb, cb = sines_near(elevation[i], beams, np.int64(ring[i]))
        r = rho[i] + offsets[ring[i]]
        x, y, z = _rotate(R_l_b, (r * cb * ca, r * cb * sa, r * sb))
        sr, cr = sines_near(pose[i, 3], before, ROLL)
        sp, cp = sines_near(pose[i, 4], before, PITCH)
        sh, ch = sines_near(pose[i, 5], before, HEADING)
        R = body_to_map((sr, cr, sp, cp, sh, ch))
        east, north, up = _rotate(R, (x + lever[0], y + lever[1], z + lever[2]))
        p_m[i, 0] = pose[i, 0] + east
        p_m[i, 1] = pose[i, 1] + north
        p_m[i, 2] = pose[i, 2] + up


def boresight_derivatives(boresight: np.ndarray, R_nominal: np.ndarray) -> np.ndarray:
    """dR_l_b/d(omega, phi, kappa), (3, 3, 3), first index the angle."""
    omega, phi, kappa = boresight
    Rx = rotation_zyx(omega, 0.0, 0.0)
    Ry = rotation_zyx(0.0, phi, 0.0)
    Rz = rotation_zyx(0.0, 0.0, kappa)
    about_x, about_y, about_z = AXIS_CROSS
    return np.stack(
        [
            Rz @ Ry @ about_x @ Rx @ R_nominal,
            Rz @ about_y @ Ry @ Rx @ R_nominal,
            about_z @ Rz @ Ry @ Rx @ R_nominal,
        ]
    )


def point_jacobians(
    obs: np.ndarray, R_l_b: np.ndarray, dR_l_b: np.ndarray, lever: np.ndarray, offset: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Laser points and their derivatives, from Eq. (1) and (2).

    ``obs`` (N, 9) as `OBSERVATIONS`, ``dR_l_b`` from `boresight_derivatives`, ``offset`` m of the
    range. Points (N, 3) m m-frame; derivatives (N, 3, 4) with respect to omega, phi, kappa and the
    range offset, and (N, 3, 9) with respect to the observations.
    """
    obs = np.asarray(obs, float)
    (sa, sb), (ca, cb) = np.sin(obs[:, 7:].T), np.cos(obs[:, 7:].T)
    rho, zero = obs[:, 6] + offset, np.zeros(len(obs))
    R_b_m = attitude_matrix(*obs[:, 3:6].T)

    def in_map(v_b):
        return np.einsum("nij,nj->ni", R_b_m, v_b)

    beam = np.column_stack([cb * ca, cb * sa, sb])
    r_l = rho[:, None] * beam
    r_b = r_l @ R_l_b.T + lever
    arm = in_map(r_b)
    along = in_map(beam @ R_l_b.T)
    across = in_map(np.column_stack([-rho * cb * sa, rho * cb * ca, zero]) @ R_l_b.T)
    upward = in_map(np.column_stack([-rho * sb * ca, -rho * sb * sa, rho * cb]) @ R_l_b.T)
    level = np.column_stack([np.cos(obs[:, 5]), -np.sin(obs[:, 5]), zero])
    by_roll = in_map(np.cross([1.0, 0.0, 0.0], r_b))
    by_pitch = np.cross(level, arm)  # about the levelled y axis
    by_heading = np.cross([0.0, 0.0, -1.0], arm)  # about down
    by_angles = [in_map(r_l @ derivative.T) for derivative in dR_l_b]
    J_x = np.stack([*by_angles, along], axis=2)
    J_l = np.empty((len(obs), 3, 9))
    J_l[:, :, :3] = np.eye(3)
    J_l[:, :, 3:] = np.stack([by_roll, by_pitch, by_heading, along, across, upward], axis=2)
    return obs[:, :3] + arm, J_x, J_l
