"""One face matched to a plane that is not its own: what an estimator must survive."""

import numpy as np

from paperrepro.adjustment.faces import face_states
from paperrepro.adjustment.matched import MatchedFaces
from paperrepro.adjustment.normals import Unknowns
from paperrepro.errors import TooFewPlanes
from paperrepro.survey import Mounting

#: Faces more inclined to each other than this would not be taken for one another.
MOST_BETWEEN_DEG = 10.0


def with_wrong_match(matched: MatchedFaces, mounting: Mounting) -> MatchedFaces:
    """``matched`` with the likeliest mistake: of all faces that could be taken for a view of
    another plane, alike inclined and unseen there by their strip, the one nearest to its centroid.

    Only faces of planes with at least three views move, so no plane is lost. Raises `TooFewPlanes`
    where no such face exists.
    """
    face, plane = _likeliest(matched, mounting)
    planes = [list(np.flatnonzero(matched.plane == g)) for g in range(matched.n_planes)]
    planes[matched.plane[face]].remove(face)
    pairs = [tuple(pair) for pair in matched.pairs if face not in pair]
    pairs += [(other, face) for other in planes[plane]]
    planes[plane].append(face)
    rays = [matched.rays.take(slice(first, last)) for first, last in matched.ranges]
    return MatchedFaces.build(rays, list(matched.strips), planes, pairs)


def _likeliest(matched: MatchedFaces, mounting: Mounting) -> tuple[int, int]:
    """The face to be moved, and the plane that it is moved to."""
    unknowns = Unknowns.layout(mounting, int(matched.rays.ring.max()) + 1, "none")
    faces = face_states(matched.rays, matched.ranges, unknowns, unknowns.start())
    planes = face_states(matched.rays, matched.plane_ranges, unknowns, unknowns.start())
    away = np.linalg.norm(faces.centroid[:, None] - planes.centroid[None], axis=2)
    alike = np.abs(faces.plane[:, :3] @ planes.plane[:, :3].T)
    away[alike < np.cos(np.deg2rad(MOST_BETWEEN_DEG))] = np.inf
    away[np.bincount(matched.plane)[matched.plane] < 3] = np.inf
    for face, strip in enumerate(matched.strips):
        seen = [p for p, s in zip(matched.plane, matched.strips, strict=True) if s == strip]
        away[face, seen] = np.inf
    if not np.isfinite(away).any():
        raise TooFewPlanes(
            "expected two planes alike within "
            f"{MOST_BETWEEN_DEG:g} deg of which a strip sees only one, got none among "
            f"{matched.n_planes}; fly over more roofs"
        )
    face, plane = np.unravel_index(away.argmin(), away.shape)
    return int(face), int(plane)
