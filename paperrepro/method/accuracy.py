"""How good the points are: distances to planes of a reference, vertical offsets at virtual points.

The reference is an independent cloud whose roofs are segmented by the same chain (section 3.2.3),
or planes known otherwise. The same faces and points are used for every mounting that is compared.

How far strips lie apart is measured by distances of points of one strip from local planes of
another; no plane that the adjustment knew is asked. Which point belongs to which neighbours is
decided once, under the calibrated mounting, and the same correspondences are measured under any
other. A neighbourhood that is not planar, as in a crown, takes no part.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import special, stats
from scipy.spatial import cKDTree

from paperrepro.errors import TooFewPlanes
from paperrepro.method.adjustment.conditions import FaceStates
from paperrepro.method.cells import extent, inside
from paperrepro.method.coarse_to_fine import Candidates, PlaneSurvey
from paperrepro.method.georeference import georeference
from paperrepro.method.matching import MatchParameters, match
from paperrepro.method.roofs import Face, RoofParameters, Roofs, candidates, extract, virtual_point
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Mounting, Rays

_REFERENCE = "reference"


@dataclass(frozen=True)
class ReferencePlanes:
    """Reference of each plane of a `TiePlanes`: ``planes`` (G, 4) as (n, d), rows of NaN where
    the reference has none."""

    planes: np.ndarray

    @property
    def found(self) -> np.ndarray:
        """(G,) bool."""
        return np.isfinite(self.planes).all(axis=1)


def reference_roofs(cloud_m: np.ndarray, seed: int = 0) -> Roofs:
    """Gable roofs of a reference cloud (K, 3) m, m-frame."""
    params = RoofParameters()
    kept = cloud_m[candidates(cloud_m, params)]
    return extract(kept, params, np.random.default_rng(seed))


def reference_planes(found: PlaneSurvey, reference: Roofs) -> ReferencePlanes:
    """Match the roofs of the strips with those of the reference; a plane takes what most views say.

    ``found`` must have been found under a calibrated mounting. Raises `TooFewPlanes`.
    """
    matches = match({**found.surfaces, _REFERENCE: reference}, MatchParameters.fine())
    votes: dict[int, list[int]] = {}
    tie_of = {key: number for number, tie in enumerate(found.ties) for key in tie}
    for pair in matches.pairs:
        if pair.search[0] == _REFERENCE and pair.reference in tie_of:
            votes.setdefault(tie_of[pair.reference], []).append(pair.search[1])
    planes = np.full((len(found.ties), 4), np.nan)
    for tie, faces in votes.items():
        face = reference.faces[np.bincount(faces).argmax()]
        planes[tie] = [*face.normal, face.d]
    if not votes:
        raise TooFewPlanes(
            f"no roof of the reference ({len(reference.gables)} gables) lies where the strips have "
            "one; check the reference's coordinate system and its density"
        )
    return ReferencePlanes(planes)


def point_to_plane(
    tie_planes: TiePlanes, mounting: Mounting, reference: ReferencePlanes
) -> np.ndarray:
    """Distances of the points of all faces from a reference, Fig. 7 and 8.

    Parameters
    ----------
    tie_planes : TiePlanes
    mounting : Mounting
        Under which the points are georeferenced.
    reference : ReferencePlanes
        A plane, or none, for each of the tie planes.

    Returns
    -------
    (N',) array, m
        Signed distances of all points whose plane has a reference.

    References
    ----------
    Eq. (7) and section 3.2.3 of the paper.
    """
    plane_of_point = tie_planes.plane_of_point
    kept = reference.found[plane_of_point]
    p_m = georeference(tie_planes.rays.take(kept), mounting)
    plane = reference.planes[plane_of_point[kept]]
    return np.einsum("na,na->n", p_m, plane[:, :3]) - plane[:, 3]


def rmse(distances: np.ndarray) -> float:
    """Root mean square, m."""
    return float(np.sqrt(np.mean(np.square(distances))))


def nmad(values: np.ndarray) -> float:
    """Robust spread of values (N,): their median absolute deviation, as a normal sigma."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


@dataclass(frozen=True)
class Distribution:
    """Shape of point-to-plane distances: ``mean`` and ``median`` m, ``sigma`` m, robust ``nmad`` m,
    ``skewness``, ``kurtosis`` (0 for normal) and ``ks``, the greatest distance of their cumulative
    share from that of the normal distribution of the same mean and sigma."""

    count: int
    mean: float
    median: float
    sigma: float
    nmad: float
    skewness: float
    kurtosis: float
    ks: float

    @classmethod
    def of(cls, distances: np.ndarray) -> "Distribution":
        mean, sigma, median = distances.mean(), distances.std(), np.median(distances)
        ks = _from_normal(np.sort((distances - mean) / sigma))
        shape = stats.skew(distances), stats.kurtosis(distances)
        values = (mean, median, sigma, nmad(distances), *shape, ks)
        return cls(len(distances), *(float(value) for value in values))


def _from_normal(standardised: np.ndarray) -> float:
    """Greatest distance of the cumulative share of ascending values (N,) from the standard normal's
    (Kolmogorov-Smirnov), without the p-value, which costs more than all the rest."""
    expected, n = special.ndtr(standardised), len(standardised)
    steps = np.arange(n + 1) / n
    return float(max((steps[1:] - expected).max(), (expected - steps[:-1]).max()))


@dataclass(frozen=True)
class VirtualPoints:
    """Virtual points under one mounting: ``points`` (K, 3) m of the gables ``gable`` (K,) of a
    `PlaneSurvey`, their ``strips`` and ``planes`` (K, 2)."""

    points: np.ndarray
    gable: np.ndarray
    strips: tuple[str, ...]
    planes: np.ndarray


def virtual_points(found: PlaneSurvey, mounting: Mounting) -> VirtualPoints:
    """Virtual points of all matched gables, from the same points as they lie under ``mounting``."""
    tie_planes = found.tie_planes
    states = tie_planes.states(mounting)
    points, gable = [], []
    for number, (left, right) in enumerate(found.gables):
        crossing = virtual_point(_face(states, left), _face(states, right))
        if crossing is not None:
            points.append(crossing[0])
            gable.append(number)
    faces = found.gables[gable]
    strips = tuple(tie_planes.strips[left] for left, _ in faces)
    return VirtualPoints(
        np.array(points).reshape(-1, 3), np.array(gable, int), strips, tie_planes.plane[faces]
    )


def vertical_offsets(points: VirtualPoints, reference: ReferencePlanes) -> np.ndarray:
    """Heights of virtual points over the ridges of a reference, Fig. 11.

    Parameters
    ----------
    points : VirtualPoints
        K of them, under a mounting.
    reference : ReferencePlanes

    Returns
    -------
    (K,) array, m
        NaN where a gable has no reference.

    Notes
    -----
    The ridge is the line in which the two reference planes meet; the height is taken where, seen
    from above, the ridge passes nearest to the virtual point.
    """
    out = np.full(len(points.points), np.nan)
    for k, (p_m, faces) in enumerate(zip(points.points, points.planes, strict=True)):
        left, right = reference.planes[faces]
        ridge = np.cross(left[:3], right[:3])
        if np.isfinite(ridge).all():
            level = np.array([-ridge[1], ridge[0], 0.0])  # from the point square to the ridge
            system = np.array([left[:3], right[:3], np.cross(level, [0.0, 0.0, 1.0])])
            foot = np.linalg.solve(system, [left[3], right[3], system[2] @ p_m])
            out[k] = p_m[2] - foot[2]
    return out


def _face(states: FaceStates, number: int) -> Face:
    plane, none = states.plane[number], np.empty(0, int)
    return Face(plane[:3], plane[3], states.centroid[number], none, states.rms[number], 0.0)


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

    def rays(self, points: Candidates) -> tuple[Rays, Rays]:
        """Of the points (N,) and, one point's after the other's, of their neighbours (N k,)."""
        of_first = points.rays_of(self.first, self.index)
        return of_first, points.rays_of(self.second, self.neighbours.ravel())

    def distances(self, rays: Rays, others: Rays, mounting: Mounting) -> np.ndarray:
        """Signed distances (N,) m of the points from the planes of their neighbours, whose `rays`
        these are."""
        q_m = georeference(others, mounting).reshape(*self.neighbours.shape, 3)
        return over_planes(georeference(rays, mounting), q_m)


@dataclass(frozen=True)
class PairDistances:
    """Of a pair of strips: ``overlap``, the share, 0-1, of the smaller one's cells that both have;
    signed distances ``before`` and ``after`` (N,) m of the same correspondences, and ``adjusted``,
    with the trajectory's errors removed, too, or None."""

    first: str
    second: str
    overlap: float
    before: np.ndarray
    after: np.ndarray
    adjusted: np.ndarray | None = None


def over_planes(p_m: np.ndarray, q_m: np.ndarray) -> np.ndarray:
    """Signed distances (N,) m of points (N, 3) from the planes of neighbourhoods (N, k, 3)."""
    normal, centroid, _, _ = local_planes(q_m)
    return np.einsum("na,na->n", p_m - centroid, normal)


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
    points: Candidates,
    pairs: Mapping[tuple[str, str], float],
    before: Mounting,
    after: Mounting,
    adjust: Callable[[Rays], Rays] | None = None,
) -> tuple[PairDistances, ...]:
    """Distances of all ``pairs``, as `overlaps` gives them, under two mountings, and of rays that
    ``adjust`` gives other poses under the latter."""
    p_m = {name: georeference(rays, after) for name, rays in points.rays.items()}
    trees = {name: cKDTree(p) for name, p in p_m.items()}
    measured = []
    for (first, second), share in pairs.items():
        both = correspondences(first, second, p_m, tree=trees[second])
        if len(both.index) >= LEAST_POINTS:
            rays = both.rays(points)
            distances = [both.distances(*rays, mounting) for mounting in (before, after)]
            if adjust is not None:
                distances.append(both.distances(*map(adjust, rays), after))
            measured.append(PairDistances(first, second, share, *distances))
    return tuple(measured)


def correspondences(
    first: str, second: str, p_m: Mapping[str, np.ndarray], most: int = POINTS,
    tree: cKDTree | None = None,
) -> Correspondences:  # fmt: skip
    """At most ``most`` points of strip ``first`` that lie on ``second``, evenly drawn, with their
    neighbours there; ``p_m`` (N, 3) m of each strip, ``tree`` of the second's, if there is one."""
    tree = cKDTree(p_m[second]) if tree is None else tree
    near = np.flatnonzero(inside(p_m[first], *extent(p_m[second])))
    index = near[np.linspace(0, len(near) - 1, min(most, len(near))).astype(int)]
    distance, neighbours = tree.query(p_m[first][index], k=NEIGHBOURS, workers=-1)
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


def median_ratio(distances: Sequence[PairDistances]) -> float | None:
    """Median distance between the strips after, as a share of that before, of all points of all
    pairs; None where there is no pair."""
    if not distances:
        return None
    after, before = (
        np.median(np.abs(np.concatenate([getattr(pair, when) for pair in distances])))
        for when in ("after", "before")
    )
    return float(after / before)


def ring_spread(distance_m: np.ndarray, ring: np.ndarray) -> float:
    """Largest minus least of the rings' mean distances, m, of points (N,)."""
    rings, number = np.unique(ring, return_inverse=True)
    mean = np.bincount(number, distance_m) / np.bincount(number)
    return float(np.ptp(mean)) if len(rings) else 0.0


def ground_spread(p_m: np.ndarray, cell_m: float = 1.0, least: int = 10) -> float:
    """Median over level cells of the standard deviation, m, of heights of ground points (N, 3) m;
    cells of fewer than ``least`` points do not count."""
    east, north = (np.floor(x / cell_m).astype(np.int64) for x in p_m[:, :2].T)
    number = (east - east.min()) * (np.ptp(north) + 1) + north - north.min()
    count = np.maximum(np.bincount(number), 1)
    height = p_m[:, 2] - (np.bincount(number, p_m[:, 2]) / count)[number]
    many = count >= least
    variance = np.bincount(number, np.square(height))[many] / (count[many] - 1)
    return float(np.median(np.sqrt(variance)))


def density_across(
    across_m: np.ndarray, length_m: float, half_m: float = 60.0, step_m: float = 4.0
) -> tuple[np.ndarray, np.ndarray]:
    """Points per m² of a strip ``length_m`` long against the distance from its track: middles (K,)
    m of bins, and densities (K,), of points ``across_m`` (N,), right positive."""
    edges = np.arange(-half_m, half_m + 0.1, step_m)
    density = np.histogram(across_m, edges)[0] / (step_m * length_m)
    return 0.5 * (edges[1:] + edges[:-1]), density
