"""Planes in a thinned cloud: PCA fit, local planes, and region growing (reference 42: Rabbani et
al. 2006). A plane is n.p - d = 0 with |n| = 1 and n_z >= 0."""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.spatial import cKDTree

from paperrepro.kernels import over_threads
from paperrepro.segmentation.eigen import least_eigenpair


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
