"""How good the points are: distances to planes of a reference, vertical offsets at virtual points.

The reference is an independent cloud whose roofs are segmented by the same chain (section 3.2.3),
or planes known otherwise. The same faces and points are used for every mounting that is compared.
"""

from dataclasses import dataclass

import numpy as np
from scipy import special, stats

from paperrepro.adjustment.faces import FaceStates, face_states
from paperrepro.adjustment.matched import MatchedFaces
from paperrepro.adjustment.normals import Unknowns
from paperrepro.errors import TooFewPlanes
from paperrepro.georeference import georeference
from paperrepro.matching import MatchParameters, match
from paperrepro.pipeline import RoofSurvey
from paperrepro.segmentation.faces import Face
from paperrepro.segmentation.gables import virtual_point
from paperrepro.segmentation.roofs import RoofParameters, Roofs, candidates, extract
from paperrepro.survey import Mounting

_REFERENCE = "reference"


@dataclass(frozen=True)
class ReferencePlanes:
    """Reference of each plane of a `MatchedFaces`: ``planes`` (G, 4) as (n, d), rows of NaN where
    the reference has none."""

    planes: np.ndarray

    @property
    def found(self) -> np.ndarray:
        """(G,) bool."""
        return np.isfinite(self.planes).all(axis=1)


def reference_roofs(cloud_m: np.ndarray, seed: int = 0) -> Roofs:
    """Gable roofs of a reference cloud (K, 3) m, m-frame."""
    params = RoofParameters.fine()
    kept = cloud_m[candidates(cloud_m, params)]
    return extract(kept, params, np.random.default_rng(seed))


def reference_planes(found: RoofSurvey, reference: Roofs) -> ReferencePlanes:
    """Match the roofs of the strips with those of the reference; a plane takes what most views say.

    ``found`` must have been found under a calibrated mounting. Raises `TooFewPlanes`.
    """
    matches = match({**found.roofs, _REFERENCE: reference}, MatchParameters.fine())
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
    matched: MatchedFaces, mounting: Mounting, reference: ReferencePlanes
) -> np.ndarray:
    """Signed distances (N',), m, of all face points that have a reference, under ``mounting``."""
    plane_of_point = np.repeat(matched.plane, np.diff(matched.ranges, axis=1)[:, 0])
    kept = reference.found[plane_of_point]
    p_m = georeference(matched.rays.take(kept), mounting)
    plane = reference.planes[plane_of_point[kept]]
    return np.einsum("na,na->n", p_m, plane[:, :3]) - plane[:, 3]


def rmse(distances: np.ndarray) -> float:
    """Root mean square, m."""
    return float(np.sqrt(np.mean(np.square(distances))))


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
        nmad = 1.4826 * np.median(np.abs(distances - median))
        ks = _from_normal(np.sort((distances - mean) / sigma))
        shape = stats.skew(distances), stats.kurtosis(distances)
        return cls(len(distances), *(float(v) for v in (mean, median, sigma, nmad, *shape, ks)))


def _from_normal(standardised: np.ndarray) -> float:
    """Greatest distance of the cumulative share of ascending values (N,) from the standard normal's
    (Kolmogorov-Smirnov), without the p-value, which costs more than all the rest."""
    expected, n = special.ndtr(standardised), len(standardised)
    steps = np.arange(n + 1) / n
    return float(max((steps[1:] - expected).max(), (expected - steps[:-1]).max()))


@dataclass(frozen=True)
class VirtualPoints:
    """Virtual points under one mounting: ``points`` (K, 3) m of the gables ``gable`` (K,) of a
    `RoofSurvey`, their ``strips`` and ``planes`` (K, 2)."""

    points: np.ndarray
    gable: np.ndarray
    strips: tuple[str, ...]
    planes: np.ndarray


def virtual_points(found: RoofSurvey, mounting: Mounting) -> VirtualPoints:
    """Virtual points of all matched gables, from the same points as they lie under ``mounting``."""
    matched = found.matched
    states = _states(matched, mounting)
    points, gable = [], []
    for number, (left, right) in enumerate(found.gables):
        crossing = virtual_point(_face(states, left), _face(states, right))
        if crossing is not None:
            points.append(crossing[0])
            gable.append(number)
    faces = found.gables[gable]
    strips = tuple(matched.strips[left] for left, _ in faces)
    return VirtualPoints(
        np.array(points).reshape(-1, 3), np.array(gable, int), strips, matched.plane[faces]
    )


def vertical_offsets(points: VirtualPoints, reference: ReferencePlanes) -> np.ndarray:
    """Height (K,), m, of each virtual point over the reference's ridge; NaN where it has none.

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


def _states(matched: MatchedFaces, mounting: Mounting) -> FaceStates:
    """Centroids and planes of all faces under ``mounting``."""
    n_rings = int(matched.rays.ring.max()) + 1
    unknowns = Unknowns.layout(mounting, n_rings, "none")
    return face_states(matched.rays, matched.ranges, unknowns, unknowns.start())


def _face(states: FaceStates, number: int) -> Face:
    plane, none = states.plane[number], np.empty(0, int)
    return Face(plane[:3], plane[3], states.centroid[number], none, states.rms[number], 0.0)
