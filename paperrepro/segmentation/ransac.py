"""Planes of an object by RANSAC (reference 41: Fischler and Bolles 1981)."""

from dataclasses import dataclass

import numba
import numpy as np

from paperrepro.segmentation.planes import Neighbourhood, fit_plane


@dataclass(frozen=True)
class RansacParameters:
    """Table 2: at least 15 inliers, tolerance 10 cm, slope 10-80 deg, 10 consensus sets an object.

    ``hypotheses`` triples are tried for each set: a face that holds 2 % of its object is still met
    with 99 % probability when half of the triples around a point of it lie on it. ``normal_deg``
    is what makes vegetation fall out: an inlier's own normal must agree with the plane's, and
    in a crown the normals point everywhere.
    """

    min_inliers: int = 15
    tolerance_m: float = 0.10
    slope_deg: tuple[float, float] = (10.0, 80.0)
    max_sets: int = 10
    hypotheses: int = 500
    normal_deg: float = 20.0


def ransac_planes(
    p_m: np.ndarray, around: Neighbourhood, members: np.ndarray, params: RansacParameters, rng
) -> list[np.ndarray]:
    """Consensus sets, index arrays into p_m (V, 3), of the object ``members`` (K,).

    The largest first; each is taken out before the next is sought. A hypothesis of an admissible
    slope may turn, when refitted, into a plane of another: its points are taken out and forgotten.
    """
    sets, rest = [], members
    low, high = np.radians(params.slope_deg)
    for _ in range(params.max_sets):
        inlier = _best_consensus(p_m, around, rest, params, rng)
        if inlier.sum() < params.min_inliers:
            break
        if low <= fit_plane(p_m[rest[inlier]]).slope <= high:
            sets.append(rest[inlier])
        rest = rest[~inlier]
    return sets


def _best_consensus(p_m, around, rest, params, rng) -> np.ndarray:
    """Mask over ``rest`` of the inliers of the best plane, refitted once by PCA."""
    none = np.zeros(len(rest), dtype=bool)
    if len(rest) < params.min_inliers:
        return none
    normal, d = _hypotheses(p_m, around, rest, params, rng)
    if len(d) == 0:
        return none
    q, own, cosine = p_m[rest], around.normal[rest], np.cos(np.radians(params.normal_deg))
    columns = np.ascontiguousarray(np.column_stack([q, own]).T)
    votes = _votes(columns, normal, d, params.tolerance_m, cosine)
    inlier = _inliers(q, own, normal[votes.argmax()], d[votes.argmax()], params.tolerance_m, cosine)
    if inlier.sum() < params.min_inliers:
        return none
    refit = fit_plane(q[inlier])
    return _inliers(q, own, refit.normal, refit.d, params.tolerance_m, cosine)


def _hypotheses(p_m, around, rest, params, rng) -> tuple[np.ndarray, np.ndarray]:
    """Planes, normals (H, 3) and d (H,), through a point and two of its neighbours' neighbours.

    So the three are close enough to share a face and far enough apart to tilt little.
    """
    first = rng.choice(rest, params.hypotheses)
    second, third = (_step(_step(first, around, rng), around, rng) for _ in range(2))
    normal, d = np.empty((len(first), 3)), np.empty(len(first))
    low, high = np.cos(np.radians(params.slope_deg))
    use = _planes_through(p_m, first, second, third, low, high, normal, d)
    return normal[use], d[use]


@numba.njit(cache=True)
def _planes_through(p_m, first, second, third, low, high, normal, d):
    """Fill ``normal`` (H, 3) and ``d`` (H,) of the planes through three points each; which of them
    (H,) have n_z between ``high`` and ``low``."""
    use = np.zeros(len(first), dtype=np.bool_)
    for h in range(len(first)):
        p = p_m[first[h]]
        a, b = p_m[second[h]] - p, p_m[third[h]] - p
        x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
        length = np.sqrt(x * x + y * y + z * z)
        scale = (-1.0 if z < 0 else 1.0) / max(length, 1e-12)
        normal[h, 0], normal[h, 1], normal[h, 2] = x * scale, y * scale, z * scale
        d[h] = normal[h, 0] * p[0] + normal[h, 1] * p[1] + normal[h, 2] * p[2]
        use[h] = length > 1e-9 and high <= normal[h, 2] <= low
    return use


def _step(point: np.ndarray, around: Neighbourhood, rng) -> np.ndarray:
    """A random neighbour of each point (H,); itself where that place is empty."""
    chosen = around.index[point, rng.integers(around.index.shape[1], size=len(point))]
    return np.where(chosen < 0, point, chosen)


def _inliers(q, own, normal, d, tolerance, cosine) -> np.ndarray:
    return (np.abs(q @ normal - d) <= tolerance) & (np.abs(own @ normal) >= cosine)


@numba.njit(cache=True)
def _votes(columns, normal, d, tolerance, cosine):
    """Inliers (H,) of each hypothesis among points with their normals, the ``columns`` (6, K)."""
    x, y, z, e, n, u = columns[0], columns[1], columns[2], columns[3], columns[4], columns[5]
    votes = np.zeros(len(d), dtype=np.int64)
    for h in range(len(d)):
        a, b, c, away = normal[h, 0], normal[h, 1], normal[h, 2], d[h]
        count = 0
        for i in range(len(x)):  # & instead of `and`: without a branch several points go at a time
            near = abs(a * x[i] + b * y[i] + c * z[i] - away) <= tolerance
            count += near & (abs(a * e[i] + b * n[i] + c * u[i]) >= cosine)
        votes[h] = count
    return votes
