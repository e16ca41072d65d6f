"""Planes in a thinned cloud: PCA fit, RANSAC (reference 41: Fischler and Bolles 1981) and region
growing (reference 42: Rabbani et al. 2006). A plane is n.p - d = 0 with |n| = 1 and n_z >= 0."""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.spatial import cKDTree


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
    centroid = p_m.mean(axis=0)
    q = p_m - centroid
    eigenvalue, eigenvector = np.linalg.eigh(q.T @ q / len(q))
    normal = eigenvector[:, 0] * (1.0 if eigenvector[2, 0] >= 0 else -1.0)
    rms = float(np.sqrt(max(eigenvalue[0], 0.0)))
    return Plane(normal, float(normal @ centroid), centroid, rms)


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
    found = index < len(p_m)
    q = p_m[np.where(found, index, np.arange(len(p_m))[:, None])]
    weight = found / found.sum(axis=1, keepdims=True)
    q = q - np.einsum("vk,vkj->vj", weight, q)[:, None]
    eigenvalue, eigenvector = np.linalg.eigh(np.einsum("vk,vki,vkj->vij", weight, q, q))
    normal = eigenvector[:, :, 0] * np.where(eigenvector[:, 2:, 0] >= 0, 1.0, -1.0)
    residual = np.sqrt(np.maximum(eigenvalue[:, 0], 0.0))
    return Neighbourhood(np.where(found, index, -1)[:, 1:], normal, residual)


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
    votes = _votes(q, own, normal, d, params.tolerance_m, cosine)
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
    normal = np.cross(p_m[second] - p_m[first], p_m[third] - p_m[first])
    length = np.linalg.norm(normal, axis=1)
    low, high = np.cos(np.radians(params.slope_deg))
    normal *= np.where(normal[:, 2] < 0, -1.0, 1.0)[:, None] / np.maximum(length, 1e-12)[:, None]
    use = (length > 1e-9) & (normal[:, 2] <= low) & (normal[:, 2] >= high)
    return normal[use], np.einsum("hj,hj->h", normal[use], p_m[first[use]])


def _step(point: np.ndarray, around: Neighbourhood, rng) -> np.ndarray:
    """A random neighbour of each point (H,); itself where that place is empty."""
    chosen = around.index[point, rng.integers(around.index.shape[1], size=len(point))]
    return np.where(chosen < 0, point, chosen)


def _inliers(q, own, normal, d, tolerance, cosine) -> np.ndarray:
    return (np.abs(q @ normal - d) <= tolerance) & (np.abs(own @ normal) >= cosine)


@numba.njit(cache=True)
def _votes(q, own, normal, d, tolerance, cosine):
    """Inliers (H,) of each hypothesis among points q (K, 3) with normals ``own`` (K, 3)."""
    votes = np.zeros(len(d), dtype=np.int64)
    for h in range(len(d)):
        a, b, c = normal[h, 0], normal[h, 1], normal[h, 2]
        count = 0
        for i in range(len(q)):
            near = abs(a * q[i, 0] + b * q[i, 1] + c * q[i, 2] - d[h]) <= tolerance
            if near and abs(a * own[i, 0] + b * own[i, 1] + c * own[i, 2]) >= cosine:
                count += 1
        votes[h] = count
    return votes


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
