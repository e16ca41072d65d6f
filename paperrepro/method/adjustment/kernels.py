"""The loops over points and faces, compiled: conditions with their derivatives, sums over faces.

The reasons are in `conditions`.
"""

import numba
import numpy as np

from paperrepro._compiled import AZIMUTH, ELEVATION, sines_near, turned
from paperrepro.method.georeference import body_to_map


@numba.njit(cache=True, nogil=True)
def sum_points(
    first, last, position, turns, rho, ring, ranges, origin, planes, R_l_b, turn_axes, lever,
    offsets, ring_column, variances, final_m, N, t, chi2,
):  # fmt: skip
    """Fill ``N``, ``t`` and ``chi2`` of planes ``first`` to ``last``."""
    v, b, row = np.empty(9), np.empty(9), np.empty(8)
    per_ring = ring_column.max() >= 0
    for g in range(first, last):
        sums = np.zeros((len(ring_column) if per_ring else 1, 8, 9))
        plane, near = planes[g], origin[g]
        for i in range(ranges[g, 0], ranges[g, 1]):
            there, then = ray(position, turns, i)
            w, s = adjust_observations(
                there, then, rho[i], plane, near, R_l_b, turn_axes, lever, offsets[ring[i]],
                variances, final_m, v, b, row,
            )  # fmt: skip
            _add_products(row, w, 1.0 / s, sums, ring[i] if per_ring else 0)
            chi2[g] += w * w / s
        for k in range(len(sums)):
            _add_sums(sums[k], ring_column[k], N[g], t[g])


@numba.njit(cache=True)
def _add_products(row, w, weight, sums, ring):
    """Add a condition to the ``sums`` (rings, 8, 9) of its ring: products of ``row`` and, last,
    with w."""
    for k in range(8):
        scaled = weight * row[k]
        for m in range(k, 8):
            sums[ring, k, m] += scaled * row[m]
        sums[ring, k, 8] += scaled * w


@numba.njit(cache=True)
def _add_sums(sums, column, N, t):
    """Add a ring's ``sums`` to N (upper triangle) and t; its offset is at ``column``, or held."""
    where = np.array((0, 1, 2, column, len(t) - 4, len(t) - 3, len(t) - 2, len(t) - 1))
    for k in range(8):
        for m in range(k, 8):
            if where[k] >= 0 and where[m] >= 0:
                N[where[k], where[m]] += sums[k, m]
        if where[k] >= 0:
            t[where[k]] += sums[k, 8]


@numba.njit(cache=True, nogil=True)
def fill_turns(first, last, pose, azimuth, elevation, turns):
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
def adjust_observations(
    position, turns, rho, plane, origin, R_l_b, turn_axes, lever, offset, variances, final_m, v, b,
    row,
):  # fmt: skip
    """Misclosure ``w = f(l + v) - B v`` and ``s = B Q B'`` at the adjusted observations.

    One `ray` against ``plane`` (4,), d from ``origin`` (3,); its observations are final where ``w``
    changes by less than ``final_m`` m. Leaves the residuals in ``v`` (9,), B in ``b`` (9,), and in
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
        if abs(w - before) < final_m:
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
    x, y, z = body_ray(turns, r, R_l_b)  # Eq. (2)
    X, Y, Z = x + lever[0], y + lever[1], z + lever[2]  # Eq. (1), b-frame
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
    return plane[0] * row[4] + plane[1] * row[5] + plane[2] * row[6] - plane[3]  # Eq. (4)


@numba.njit(cache=True, nogil=True)
def sum_faces(
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
