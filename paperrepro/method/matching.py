"""Which faces of different strips are the same roof: matching by virtual points (section 2.2.4).

Two gables correspond when their virtual points are near and the normals of both their faces agree,
each being the other's best. A strip may see only part of a roof, and then centroids and virtual
point slide along the ridge by metres while the roof stays where it is. So the distance between two
gables is taken *across* the ridge as it is, and *along* it only as far as the shorter gable must be
shifted to lie within the extent of the longer. Neighbours in line do not gain by that: their
extents do not overlap. Where two candidates are nearly as good, neither is taken.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from paperrepro.errors import TooFewPlanes
from paperrepro.method.roofs import Gable, Roofs

#: A face as it was seen: name of the strip, number in its `Roofs.faces`.
FaceKey = tuple[str, int]


@dataclass(frozen=True)
class MatchParameters:
    """Greatest distance between two gables and inclination between their normals; ``overlap`` of
    their extents along the ridge, relative to the shorter; ``distinct``: how many times worse than
    the best the second candidate must be."""

    distance_m: float
    inclination_deg: float
    overlap: float = 0.5
    distinct: float = 1.5

    @classmethod
    def fine(cls) -> "MatchParameters":
        """For a boresight right to 0.2 degrees: a degree moves a point at 60 m by 1 m."""
        return cls(distance_m=1.0, inclination_deg=3.0)

    @classmethod
    def coarse(cls) -> "MatchParameters":
        """For a boresight wrong by up to 3 degrees on each axis: opposite strips turn normals by
        twice that, and shift roofs by 3 m below the scanner, more towards the swath's edge."""
        return cls(distance_m=6.0, inclination_deg=10.0)


@dataclass(frozen=True)
class FacePair:
    """One face in two strips; ``distance`` m of the gables, ``inclination`` rad of the normals, NaN
    where they were not compared."""

    reference: FaceKey
    search: FaceKey
    distance: float = np.nan
    inclination: float = np.nan


@dataclass(frozen=True)
class Matches:
    """All ``pairs`` of all strips, free of contradictions: see `connected_faces`."""

    pairs: tuple[FacePair, ...]

    def connected_faces(self) -> tuple[tuple[FaceKey, ...], ...]:
        """The physical faces: for each its views, at most one per strip, sorted."""
        return connected_faces(self.pairs)


def match(roofs_by_strip: dict[str, Roofs], params: MatchParameters) -> Matches:
    """Match the gables of all pairs of strips.

    Raises `TooFewPlanes` where nothing corresponds.
    """
    pairs = [
        pair
        for reference, search in combinations(roofs_by_strip, 2)
        for pair in _match_strips(roofs_by_strip, reference, search, params)
    ]
    face = {key: number for number, tie in enumerate(connected_faces(pairs)) for key in tie}
    consistent = tuple(p for p in pairs if face.get(p.reference, -1) == face.get(p.search, -2))
    if not consistent:
        found = ", ".join(f"{name} {len(roofs.gables)}" for name, roofs in roofs_by_strip.items())
        raise TooFewPlanes(
            "expected gable roofs that two strips share, matched none within "
            f"{params.distance_m} m and {params.inclination_deg} deg; gables per strip: "
            f"{found or 'no strips'}; fly over more gable roofs with more overlap, or start from "
            "a boresight closer to the truth"
        )
    return Matches(consistent)


def connected_faces(pairs: Iterable[FacePair]) -> tuple[tuple[FaceKey, ...], ...]:
    """Connected components of ``pairs``: one physical face each, every strip at most once in it.

    Pairs are joined from the nearest on; one that would bring a second face of a strip into a
    component contradicts better ones and is left out.
    """
    component: dict[FaceKey, set[FaceKey]] = {}
    for pair in sorted(pairs, key=lambda pair: pair.distance):
        one, other = (component.setdefault(key, {key}) for key in (pair.reference, pair.search))
        if one is other or {strip for strip, _ in one} & {strip for strip, _ in other}:
            continue
        one |= other
        component.update(dict.fromkeys(other, one))
    distinct = {id(keys): keys for keys in component.values()}.values()
    return tuple(sorted(tuple(sorted(keys)) for keys in distinct if len(keys) > 1))


def _match_strips(roofs_by_strip, reference: str, search: str, params) -> list[FacePair]:
    """The mutual best correspondences of two strips, two pairs of faces each."""
    ours, theirs = roofs_by_strip[reference], roofs_by_strip[search]
    distance = _distances(ours.gables, theirs.gables, params.overlap)
    candidates = {}
    score = np.full(distance.shape, np.inf)
    for i, j in np.argwhere(distance <= params.distance_m).tolist():
        gables = ours.gables[i], theirs.gables[j]
        candidate = _compare(ours, theirs, *gables, float(distance[i, j]), params)
        if candidate is not None:
            candidates[i, j] = candidate
            score[i, j] = candidate.score(params)
    return [
        FacePair((reference, a), (search, b), candidates[i, j].distance, inclination)
        for i, j in _mutual_best(score, params.distinct)
        for a, b, inclination in candidates[i, j].faces
    ]


def _mutual_best(score: np.ndarray, distinct: float) -> list[tuple[int, int]]:
    """Entries that are the least of their row and column, clearly less than the next in both."""
    return [
        (i, j)
        for i, j in np.argwhere(np.isfinite(score)).tolist()
        if score[i, j] * distinct
        <= min(
            np.delete(score[i], j).min(initial=np.inf),
            np.delete(score[:, j], i).min(initial=np.inf),
        )
    ]


@dataclass(frozen=True)
class _Candidate:
    """Two gables that may be one: ``distance`` m, ``faces`` ((a, b, inclination rad), twice)."""

    distance: float
    faces: tuple[tuple[int, int, float], ...]

    def score(self, params: MatchParameters) -> float:
        """0 for the same place and normals, up to sqrt(2)."""
        worst = max(inclination for _, _, inclination in self.faces)
        return float(
            np.hypot(self.distance / params.distance_m, worst / np.radians(params.inclination_deg))
        )


def _compare(
    ours: Roofs, theirs: Roofs, g: Gable, h: Gable, distance: float, params
) -> _Candidate | None:
    """The candidate that gables g and h make, or None where their normals are too different."""
    faces = min(
        (
            _paired(ours, theirs, (g.left, a), (g.right, b))
            for a, b in ((h.left, h.right), (h.right, h.left))
        ),
        key=lambda pairs: max(inclination for _, _, inclination in pairs),
    )
    if max(inclination for _, _, inclination in faces) > np.radians(params.inclination_deg):
        return None
    return _Candidate(distance, faces)


def _paired(ours: Roofs, theirs: Roofs, *numbers: tuple[int, int]):
    """((a, b, inclination rad), ...) of face numbers (a, b)."""
    return tuple(
        (a, b, _inclination(ours.faces[a].normal, theirs.faces[b].normal)) for a, b in numbers
    )


def _inclination(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))


def _distances(ours: Sequence[Gable], theirs: Sequence[Gable], least_overlap: float) -> np.ndarray:
    """Distances (I, J), m, of gables as the module says; infinite where they do not overlap."""
    if not (ours and theirs):
        return np.full((len(ours), len(theirs)), np.inf)
    (p, u, ours_along), (q, v, theirs_along) = _places(ours), _places(theirs)
    sign = np.where(u @ v.T >= 0, 1.0, -1.0)[..., None]
    ridge = u[:, None] + sign * v
    ridge /= np.linalg.norm(ridge, axis=2, keepdims=True)
    step = q - p[:, None]
    along = np.einsum("ija,ija->ij", step, ridge)[..., None]
    one = np.broadcast_to(ours_along[:, None], (*along.shape[:2], 2))
    other = np.where(sign > 0, theirs_along, -theirs_along[:, ::-1]) + along
    longer = np.ptp(one, axis=2) > np.ptp(other, axis=2)
    short, long = (np.where(longer[..., None] == swap, one, other) for swap in (False, True))
    shift = np.maximum(np.maximum((long - short)[..., 0], (short - long)[..., 1]), 0.0)
    overlap = np.minimum(one[..., 1], other[..., 1]) - np.maximum(one[..., 0], other[..., 0])
    distance = np.hypot(np.linalg.norm(step - along * ridge, axis=2), shift)
    return np.where(overlap < least_overlap * np.ptp(short, axis=2), np.inf, distance)


def _places(gables: Sequence[Gable]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Virtual points (K, 3) m, ridges (K, 3), extents (K, 2) m, ascending."""
    names = ("virtual_point", "ridge", "extent")
    return tuple(np.array([getattr(gable, name) for gable in gables]) for name in names)
