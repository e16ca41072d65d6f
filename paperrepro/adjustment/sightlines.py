"""Rays with the sines and cosines of their angles, and what the estimators' kernels ask of one.

No unknown changes an observed angle, so its sine and cosine are computed once. Derivatives are
taken backwards: the plane's normal is brought to the body and to the laser, where a derivative is
one scalar product, and no 3 x 9 matrix is built. The forward form, which the tests compare with,
is `georeference.point_jacobians`.
"""

from dataclasses import dataclass

import numba
import numpy as np

from paperrepro.georeference import body_to_map
from paperrepro.kernels import over_threads
from paperrepro.sines import AZIMUTH, ELEVATION, sines_near, turned
from paperrepro.survey import Rays


@dataclass(frozen=True)
class Sightlines:
    """``position`` (N, 3) m m-frame, ``turns`` (N, 10) sine and cosine of roll, pitch, heading,
    azimuth, elevation, ``rho`` (N,) m measured range, ``ring`` (N,)."""

    position: np.ndarray
    turns: np.ndarray
    rho: np.ndarray
    ring: np.ndarray

    @classmethod
    def of(cls, rays: "Rays | Sightlines") -> "Sightlines":
        """Of rays; what is prepared already is handed back."""
        if isinstance(rays, Sightlines):
            return rays
        turns = np.empty((len(rays), 10))
        over_threads(_turns, len(rays), rays.pose, rays.azimuth, rays.elevation, turns)
        return cls(np.ascontiguousarray(rays.pose[:, :3]), turns, rays.rho, rays.ring)

    def columns(self) -> tuple:
        """As the kernels take them."""
        return self.position, self.turns, self.rho, self.ring


def axes(R_l_b: np.ndarray, dR_l_b: np.ndarray) -> np.ndarray:
    """Axes (3, 3), a row each, about which omega, phi, kappa turn the laser in the body frame:
    ``dR_l_b[k] @ r = axes[k] x (R_l_b @ r)``."""
    skew = dR_l_b @ R_l_b.T
    return np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)


@numba.njit(cache=True, nogil=True)
def _turns(first, last, pose, azimuth, elevation, turns):
    """Fill ``turns`` (N, 10), each row by the sines of the ray before."""
    before = np.full((5, 3), np.nan)
    for i in range(first, last):
        for k in range(3):
            turns[i, 2 * k], turns[i, 2 * k + 1] = sines_near(pose[i, 3 + k], before, k)
        turns[i, 6], turns[i, 7] = sines_near(azimuth[i], before, AZIMUTH)
        turns[i, 8], turns[i, 9] = sines_near(elevation[i], before, ELEVATION)


@numba.njit(cache=True)
def ray(position, turns, i):
    """Position and turns of ray ``i`` as tuples: a row of an array would be counted as a reference
    to it, and two threads that count wait for each other."""
    return (position[i, 0], position[i, 1], position[i, 2]), (
        turns[i, 0], turns[i, 1], turns[i, 2], turns[i, 3], turns[i, 4], turns[i, 5],
        turns[i, 6], turns[i, 7], turns[i, 8], turns[i, 9],
    )  # fmt: skip


@numba.njit(cache=True)
def moved(position, turns, by):
    """Position and turns of a ray whose pose is off ``by`` (6,), m and rad."""
    sr, cr = turned(turns[0], turns[1], by[3])
    sp, cp = turned(turns[2], turns[3], by[4])
    sh, ch = turned(turns[4], turns[5], by[5])
    return (position[0] + by[0], position[1] + by[1], position[2] + by[2]), (
        sr, cr, sp, cp, sh, ch, turns[6], turns[7], turns[8], turns[9],
    )  # fmt: skip


@numba.njit(cache=True)
def _back(R, v):
    """``R' v`` of a matrix (3, 3) as an array."""
    return (
        R[0, 0] * v[0] + R[1, 0] * v[1] + R[2, 0] * v[2],
        R[0, 1] * v[0] + R[1, 1] * v[1] + R[2, 1] * v[2],
        R[0, 2] * v[0] + R[1, 2] * v[1] + R[2, 2] * v[2],
    )


@numba.njit(cache=True)
def body_ray(turns, r, R_l_b):
    """``r`` m along a ray, b-frame, from the laser."""
    x, y, z = r * turns[9] * turns[7], r * turns[9] * turns[6], r * turns[8]
    return (
        R_l_b[0, 0] * x + R_l_b[0, 1] * y + R_l_b[0, 2] * z,
        R_l_b[1, 0] * x + R_l_b[1, 1] * y + R_l_b[1, 2] * z,
        R_l_b[2, 0] * x + R_l_b[2, 1] * y + R_l_b[2, 2] * z,
    )


@numba.njit(cache=True)
def settle(
    position, turns, rho, plane, origin, R_l_b, turn_axes, lever, offset, variances, settled, v, b,
    row,
):  # fmt: skip
    """Misclosure ``w = f(l + v) - B v`` and ``s = B Q B'`` at the adjusted observations.

    One `ray` against ``plane`` (4,), d from ``origin`` (3,); its observations are final where ``w``
    changes by less than ``settled`` m. Leaves the residuals in ``v`` (9,), B in ``b`` (9,), and in
    ``row`` (8,) the row of A: three angles, the ring's offset, n and d.
    """
    v[:] = 0.0
    w = _linearise(position, turns, rho + offset, plane, origin, R_l_b, turn_axes, lever, v, b,
                   row)  # fmt: skip
    s = _variance(b, variances)
    for _ in range(20):
        step = w / s
        for m in range(9):
            v[m] = -variances[m] * b[m] * step
        sr, cr = turned(turns[0], turns[1], v[3])
        sp, cp = turned(turns[2], turns[3], v[4])
        sh, ch = turned(turns[4], turns[5], v[5])
        sa, ca = turned(turns[6], turns[7], v[7])
        sb, cb = turned(turns[8], turns[9], v[8])
        angles = (sr, cr, sp, cp, sh, ch, sa, ca, sb, cb)
        before = w
        w = _linearise(position, angles, rho + offset, plane, origin, R_l_b, turn_axes, lever, v, b,
                       row)  # fmt: skip
        for m in range(9):
            w -= b[m] * v[m]
        s = _variance(b, variances)
        if abs(w - before) < settled:
            break
    return w, s


@numba.njit(cache=True)
def _variance(b, variances):
    s = 0.0
    for m in range(9):
        s += b[m] * b[m] * variances[m]
    return s


@numba.njit(cache=True)
def _linearise(position, turns, r, plane, origin, R_l_b, turn_axes, lever, v, b, row):
    """Value of Eq. (4) at the observations plus ``v``, whose angles are in ``turns`` already; fills
    ``b`` and ``row``."""
    _, _, _, _, sh, ch, sa, ca, sb, cb = turns
    r += v[6]
    R = body_to_map(turns)
    x, y, z = body_ray(turns, r, R_l_b)
    X, Y, Z = x + lever[0], y + lever[1], z + lever[2]
    e = R[0][0] * X + R[0][1] * Y + R[0][2] * Z
    n = R[1][0] * X + R[1][1] * Y + R[1][2] * Z
    u = R[2][0] * X + R[2][1] * Y + R[2][2] * Z
    a = plane[0] * R[0][0] + plane[1] * R[1][0] + plane[2] * R[2][0]  # the normal, b-frame
    c = plane[0] * R[0][1] + plane[1] * R[1][1] + plane[2] * R[2][1]
    d = plane[0] * R[0][2] + plane[1] * R[1][2] + plane[2] * R[2][2]
    f, g, h = _back(R_l_b, (a, c, d))  # and l-frame
    b[0], b[1], b[2] = plane[0], plane[1], plane[2]
    b[3] = d * Y - c * Z  # roll turns about forward
    # pitch turns about the levelled y axis: east cos(heading), north -sin(heading)
    b[4] = -u * (plane[0] * sh + plane[1] * ch) + plane[2] * (ch * n + sh * e)
    b[5] = plane[0] * n - plane[1] * e  # heading turns about down
    b[6] = cb * (f * ca + g * sa) + h * sb
    b[7] = r * cb * (g * ca - f * sa)
    b[8] = r * (h * cb - sb * (f * ca + g * sa))
    for k in range(3):  # n . (axis x ray) = axis . (ray x n)
        row[k] = (
            turn_axes[k, 0] * (y * d - z * c)
            + turn_axes[k, 1] * (z * a - x * d)
            + turn_axes[k, 2] * (x * c - y * a)
        )
    row[3], row[7] = b[6], -1.0
    row[4] = position[0] + v[0] + e - origin[0]
    row[5] = position[1] + v[1] + n - origin[1]
    row[6] = position[2] + v[2] + u - origin[2]
    return plane[0] * row[4] + plane[1] * row[5] + plane[2] * row[6] - plane[3]
