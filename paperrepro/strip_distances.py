"""How far strips lie apart: distances of points of one strip from local planes of another.

No plane that the adjustment knew is asked. Which point belongs to which neighbours in the other
strip is settled once, under the calibrated mounting, and the same correspondences are measured
under any other. A neighbourhood that is not planar, as in a crown, takes no part.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from paperrepro.boxes import extent, inside
from paperrepro.georeference import georeference
from paperrepro.survey import Mounting, Rays

#: Points of a strip that look for neighbours in another, and how many neighbours they want.
POINTS, NEIGHBOURS = 5000, 16
#: RMS, m, of a planar neighbourhood about its plane, and the least width, as a share of its
#: length, of one that is no line.
PLANAR_M, LEAST_WIDTH = 0.06, 0.25
#: A point lies over its neighbours, within so many times their RMS radius of their centroid, and
#: within so many metres of their plane: farther off it is on another surface.
REACH, SAME_SURFACE_M = 1.5, 0.5
#: Edge of the cells in which overlap is counted, m, and the least share that is overlap.
CELL_M, LEAST_OVERLAP = 1.0, 0.02
#: Fewest correspondences of a pair that say anything.
LEAST_POINTS = 50


@dataclass(frozen=True)
class Correspondences:
    """Of strips ``first`` and ``second``: rays ``index`` (N,) of the first and ``neighbours``
    (N, k) of the second."""

    first: str
    second: str
    index: np.ndarray
    neighbours: np.ndarray

    def distances(self, samples: Mapping[str, Rays], mounting: Mounting) -> np.ndarray:
        """Signed distances (N,) m of the points from the planes of their neighbours."""
        p_m = georeference(samples[self.first].take(self.index), mounting)
        q_m = georeference(samples[self.second].take(self.neighbours.ravel()), mounting)
        normal, centroid, _, _ = local_planes(q_m.reshape(*self.neighbours.shape, 3))
        return np.einsum("na,na->n", p_m - centroid, normal)


@dataclass(frozen=True)
class PairDistances:
    """Of a pair of strips: ``overlap``, the share, 0-1, of the smaller one's cells that both have;
    signed distances ``before`` and ``after`` (N,) m of the same correspondences."""

    first: str
    second: str
    overlap: float
    before: np.ndarray
    after: np.ndarray


def local_planes(q_m: np.ndarray):
    """Planes of neighbourhoods (N, k, 3): normals (N, 3), centroids (N, 3), RMS (N,) m and width
    over length (N,)."""
    centroid = q_m.mean(axis=1)
    r = q_m - centroid[:, None]
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", r, r) / q_m.shape[1])
    values = np.maximum(values, 0.0)
    normal = vectors[:, :, 0] * np.where(vectors[:, 2:, 0] < 0, -1.0, 1.0)
    return normal, centroid, np.sqrt(values[:, 0]), np.sqrt(values[:, 1] / values[:, 2])


def overlaps(samples: Mapping[str, Rays], mounting: Mounting) -> dict[tuple[str, str], float]:
    """The pairs of strips that overlap, and by how much, 0-1."""
    cells = {
        name: np.unique(np.floor(georeference(rays, mounting)[:, :2] / CELL_M), axis=0)
        for name, rays in samples.items()
    }
    keys = {name: {tuple(cell) for cell in of.tolist()} for name, of in cells.items()}
    shares = {
        (a, b): len(keys[a] & keys[b]) / min(len(keys[a]), len(keys[b]))
        for a, b in combinations(keys, 2)
    }
    return {pair: share for pair, share in shares.items() if share >= LEAST_OVERLAP}


def pair_distances(
    samples: Mapping[str, Rays],
    pairs: Mapping[tuple[str, str], float],
    before: Mounting,
    after: Mounting,
) -> tuple[PairDistances, ...]:
    """Distances of all ``pairs``, as `overlaps` gives them, under two mountings."""
    p_m = {name: georeference(rays, after) for name, rays in samples.items()}
    trees = {name: cKDTree(p) for name, p in p_m.items()}
    measured = []
    for (first, second), share in pairs.items():
        both = _correspondences(first, second, p_m, trees)
        if len(both.index) >= LEAST_POINTS:
            distances = (both.distances(samples, mounting) for mounting in (before, after))
            measured.append(PairDistances(first, second, share, *distances))
    return tuple(measured)


def _correspondences(first: str, second: str, p_m, trees) -> Correspondences:
    """Points of ``first`` that lie on ``second``, evenly drawn, with their neighbours there."""
    near = np.flatnonzero(inside(p_m[first], *extent(p_m[second])))
    index = near[np.linspace(0, len(near) - 1, min(POINTS, len(near))).astype(int)]
    distance, neighbours = trees[second].query(p_m[first][index], k=NEIGHBOURS, workers=-1)
    if not len(index) or not np.isfinite(distance).all():
        return Correspondences(first, second, index[:0], np.empty((0, NEIGHBOURS), int))
    kept = _belong(p_m[first][index], p_m[second][neighbours])
    return Correspondences(first, second, index[kept], neighbours[kept])


def _belong(p_m: np.ndarray, q_m: np.ndarray) -> np.ndarray:
    """Mask (N,) of the points (N, 3) that lie over a planar neighbourhood, theirs of (N, k, 3)."""
    normal, centroid, rms, width = local_planes(q_m)
    step = p_m - centroid
    off = np.einsum("na,na->n", step, normal)
    aside = np.sqrt(np.maximum(np.square(step).sum(axis=1) - off**2, 0.0))
    radius = np.sqrt(np.square(q_m - centroid[:, None]).sum(axis=2).mean(axis=1))
    over = (aside <= REACH * radius) & (np.abs(off) <= SAME_SURFACE_M)
    return over & (rms <= PLANAR_M) & (width >= LEAST_WIDTH)


def rms(distances: np.ndarray) -> float:
    """Root mean square, m."""
    return float(np.sqrt(np.mean(np.square(distances))))
