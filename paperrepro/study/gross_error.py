"""A gross error of the matching, put in on purpose: what screening must bear."""

import numpy as np

from paperrepro.errors import TooFewPlanes
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Mounting

#: Faces more inclined to each other than this would not be taken for one another.
MOST_BETWEEN_DEG = 10.0


def with_wrong_match(tie_planes: TiePlanes, mounting: Mounting) -> TiePlanes:
    """``tie_planes`` with the likeliest mistake: of all faces that could be taken for a view of
    another plane, alike inclined and unseen there by their strip, the one nearest to its centroid.

    Only faces of planes with at least three views move, so no plane is lost. Raises `TooFewPlanes`
    where no such face exists.
    """
    face, plane = _likeliest(tie_planes, mounting)
    planes = [list(np.flatnonzero(tie_planes.plane == g)) for g in range(tie_planes.n_planes)]
    planes[tie_planes.plane[face]].remove(face)
    pairs = [tuple(pair) for pair in tie_planes.pairs if face not in pair]
    pairs += [(other, face) for other in planes[plane]]
    planes[plane].append(face)
    rays = [tie_planes.rays.take(slice(first, last)) for first, last in tie_planes.ranges]
    return TiePlanes.build(rays, list(tie_planes.strips), planes, pairs)


def _likeliest(tie_planes: TiePlanes, mounting: Mounting) -> tuple[int, int]:
    """The face to be moved, and the plane that it is moved to."""
    faces, planes = tie_planes.states(mounting), tie_planes.plane_states(mounting)
    away = np.linalg.norm(faces.centroid[:, None] - planes.centroid[None], axis=2)
    alike = np.abs(faces.plane[:, :3] @ planes.plane[:, :3].T)
    away[alike < np.cos(np.deg2rad(MOST_BETWEEN_DEG))] = np.inf
    away[np.bincount(tie_planes.plane)[tie_planes.plane] < 3] = np.inf
    for face, strip in enumerate(tie_planes.strips):
        seen = [p for p, s in zip(tie_planes.plane, tie_planes.strips, strict=True) if s == strip]
        away[face, seen] = np.inf
    if not np.isfinite(away).any():
        raise TooFewPlanes(
            "expected two planes alike within "
            f"{MOST_BETWEEN_DEG:g} deg of which a strip sees only one, got none among "
            f"{tie_planes.n_planes}; fly over more roofs"
        )
    face, plane = np.unravel_index(away.argmin(), away.shape)
    return int(face), int(plane)
