"""Planes in a thinned cloud: PCA, RANSAC (reference 41 of the paper: Fischler and Bolles 1981) and
region growing (reference 42: Rabbani et al. 2006). A plane is n.p - d = 0 with |n| = 1, n_z >= 0.
"""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.spatial import cKDTree

from paperrepro._compiled import over_threads


@dataclass(frozen=True)
class Plane:
    """``normal`` (3,), ``d`` m, ``centroid`` (3,) m, ``rms`` m of the distances to the plane."""

    normal: np.ndarray
    d: float
    centroid: np.ndarray
    rms: float

    def distance(self, p_m: np.ndarray) -> np.ndarray:
        """Signed distances (N,) m of points (N, 3), positive above."""
        return p_m @ self.normal - self.d

    @property
    def slope(self) -> float:
        """Inclination against the horizontal, rad."""
        return float(np.arccos(np.clip(self.normal[2], 0.0, 1.0)))


@dataclass(frozen=True)
class GrowingParameters:
    """Table 2: segments of 40 to 500 points, 1 degree, none farther than 4 m from its segment.

    Three values depend on the cloud, which is here thinned to 0.5 m:

    ``size`` ends at 1000: a roof face of 200 m² has about 950 points, and a limit that drops the
    largest roofs helps nobody. ``angle_deg`` is 3: with 10 neighbours (0.9 m around a point) and
    heights good to 1-2 cm, a local normal is good to 0.5-1 degree, so at 1 degree a segment stops
    at noise; the bluntest ridge, twice 10 degrees, still turns by more. ``residual_m``, from which
    roughness on a segment does not grow further, is the tolerance of RANSAC. ``max_gap_m`` cuts
    longer links of the neighbourhood graph.
    """

    neighbours: int = 10
    angle_deg: float = 3.0
    residual_m: float = 0.10
    size: tuple[int, int] = (40, 1000)
    max_gap_m: float = 4.0


def fit_plane(p_m: np.ndarray) -> Plane:
    """Least-squares plane of points (N >= 3, 3) m by PCA."""
    centroid, scatter = _moments(p_m)
    value, vector = least_eigenpair(scatter)
    normal = np.array(vector)
    return Plane(normal, float(normal @ centroid), centroid, float(np.sqrt(max(value, 0.0))))


@numba.njit(cache=True)
def _moments(p_m):
    """Centroid (3,) and covariance (3, 3) of points."""
    centroid, scatter = np.zeros(3), np.zeros((3, 3))
    for i in range(len(p_m)):
        for a in range(3):
            centroid[a] += p_m[i, a]
    for a in range(3):
        centroid[a] /= len(p_m)
    for i in range(len(p_m)):
        for a in range(3):
            for b in range(a + 1):
                scatter[a, b] += (p_m[i, a] - centroid[a]) * (p_m[i, b] - centroid[b])
    for a in range(3):
        for b in range(a + 1):
            scatter[a, b] /= len(p_m)
            scatter[b, a] = scatter[a, b]
    return centroid, scatter


@dataclass(frozen=True)
class Neighbourhood:
    """The kNN graph of points (V, 3) and its local planes.

    ``index`` (V, k) neighbours, -1 where there is none within reach; ``normal`` (V, 3), n_z >= 0;
    ``residual`` (V,) m, rms of the neighbours about their local plane.
    """

    index: np.ndarray
    normal: np.ndarray
    residual: np.ndarray


def neighbourhood(p_m: np.ndarray, k: int, reach_m: float) -> Neighbourhood:
    """`Neighbourhood` of points (V >= 1, 3) m: k neighbours within ``reach_m``, and the point."""
    count = min(k + 1, len(p_m))
    tree = cKDTree(p_m)
    _, index = tree.query(p_m, k=np.arange(1, count + 1), distance_upper_bound=reach_m, workers=-1)
    index = np.where(index < len(p_m), index, -1)
    normal, residual = np.empty((len(p_m), 3)), np.empty(len(p_m))
    over_threads(_local_planes, len(index), p_m, index, normal, residual)
    return Neighbourhood(index[:, 1:], normal, residual)


@numba.njit(cache=True, nogil=True)
def _local_planes(first, last, p_m, index, normal, residual):
    """Fill ``normal`` (V, 3) and ``residual`` (V,) of the planes of each point's neighbours, -1 for
    none."""
    for v in range(first, last):
        residual[v] = _local_plane(p_m, index, v, normal)


@numba.njit(cache=True)
def _local_plane(p_m, index, v, normal):
    q = np.empty((index.shape[1], 3))
    count = 0
    for m in range(index.shape[1]):
        n = index[v, m]
        if n >= 0:
            for a in range(3):
                q[count, a] = p_m[n, a]
            count += 1
    value, vector = least_eigenpair(_moments(q[:count])[1])
    normal[v, 0], normal[v, 1], normal[v, 2] = vector
    return np.sqrt(max(value, 0.0))


def grow_regions(around: Neighbourhood, group: np.ndarray, params: GrowingParameters) -> np.ndarray:
    """Segment number (V,) of every point, -1 for none.

    ``group`` (V,) is the consensus set of a point, -1 for none: a segment stays in one set, so it
    cannot creep over a blunt ridge. Rabbani's growing: seeds in the order of their residual; a
    neighbour joins when its normal turns by less than the angle threshold against the current
    point's, |n_c.n_b| > cos(angle) (the paper prints the sign the other way round), and is grown
    from when its own residual is small.
    """
    order = np.argsort(around.residual, kind="stable")
    order = order[(group[order] >= 0) & (around.residual[order] <= params.residual_m)]
    limits = np.cos(np.radians(params.angle_deg)), params.residual_m
    return _grow(around.index, around.normal, around.residual, group, order, *limits)


@numba.njit(cache=True)
def _grow(index, normal, residual, group, order, cosine, residual_limit):
    label = np.full(len(group), -1, dtype=np.int64)
    queue = np.empty(len(group), dtype=np.int64)
    segment = 0
    for seed in order:
        if label[seed] >= 0:
            continue
        label[seed] = segment
        queue[0] = seed
        head, tail = 0, 1
        while head < tail:
            current = queue[head]
            head += 1
            for b in index[current]:
                if b < 0 or group[b] != group[seed] or label[b] >= 0:
                    continue
                turn = 0.0
                for j in range(3):
                    turn += normal[current, j] * normal[b, j]
                if abs(turn) > cosine:
                    label[b] = segment
                    if residual[b] <= residual_limit:
                        queue[tail] = b
                        tail += 1
        segment += 1
    return label


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


#: Sweeps of Jacobi's rotations; five reach rounding, since each squares what is left.
SWEEPS = 8
#: Axes. NumPy's integers: for plain ones, literals, numba would compile `_rotate` three times.
X, Y, Z = np.arange(3)


@numba.njit(cache=True)
def least_eigenpair(S):
    """Least eigenvalue and its unit vector (x, y, z), z >= 0, of ``S`` (3, 3), which is spoilt."""
    V = np.zeros((3, 3))
    V[0, 0] = V[1, 1] = V[2, 2] = 1.0
    for _ in range(SWEEPS):
        apart = abs(S[0, 1]) + abs(S[0, 2]) + abs(S[1, 2])
        if apart <= 1e-17 * (abs(S[0, 0]) + abs(S[1, 1]) + abs(S[2, 2])):
            break
        _rotate(S, V, X, Y)
        _rotate(S, V, X, Z)
        _rotate(S, V, Y, Z)
    k = 0
    for m in range(1, 3):
        if S[m, m] < S[k, k]:
            k = m
    sign = -1.0 if V[2, k] < 0 else 1.0
    return S[k, k], (sign * V[0, k], sign * V[1, k], sign * V[2, k])


@numba.njit(cache=True)
def _rotate(S, V, p, q):
    """Turn ``S`` in the plane of p and q so that S[p, q] vanishes, and ``V`` with it."""
    if S[p, q] == 0.0:
        return
    theta = (S[q, q] - S[p, p]) / (2.0 * S[p, q])
    t = (1.0 if theta >= 0 else -1.0) / (abs(theta) + np.sqrt(theta * theta + 1.0))
    c = 1.0 / np.sqrt(t * t + 1.0)
    s = t * c
    for k in range(3):
        S[k, p], S[k, q] = c * S[k, p] - s * S[k, q], s * S[k, p] + c * S[k, q]
    for k in range(3):
        S[p, k], S[q, k] = c * S[p, k] - s * S[q, k], s * S[p, k] + c * S[q, k]
    for k in range(3):
        V[k, p], V[k, q] = c * V[k, p] - s * V[k, q], s * V[k, p] + c * V[k, q]
