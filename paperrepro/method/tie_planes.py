"""The adjustment's observations: matched faces, their rays, and which plane each lies on."""

from dataclasses import dataclass, replace

import numpy as np

from paperrepro.errors import RankDefect, TooFewPlanes
from paperrepro.method.adjustment.conditions import FaceStates, Unknowns, face_states
from paperrepro.method.georeference import georeference
from paperrepro.survey import Mounting, Rays, Scanner

#: Planes needed for three angles and a check; the paper asks four of the refinement, section 2.2.5.
LEAST_PLANES = 4
#: No scanner is taken for better than this share of its specification: three points always are.
LEAST_NOISE = 0.25
#: Points of a face that show how uneven it is.
SHOWING = 1000


@dataclass(frozen=True)
class Rejection:
    """A face left out: its ``strip``, the ``plane`` it was matched to, its centroid (3,) m in the
    m-frame, by how much it misses the plane, and the limit, m."""

    strip: str
    plane: int
    centroid: np.ndarray
    misfit_m: float
    limit_m: float


@dataclass(frozen=True)
class TiePlanes:
    """F faces on G planes, sorted by plane.

    ``rays`` of all faces one after the other, face ``f`` in rows ``ranges[f, 0]:ranges[f, 1]``;
    ``strips`` (F,) names; ``plane`` (F,) index of each face's plane, ascending; ``pairs`` (P, 2)
    reference face and search face; ``control`` (G, 4) m, the point through which a plane is known
    to go and how well in height, NaN where none is known, or None.
    """

    rays: Rays
    ranges: np.ndarray
    strips: tuple[str, ...]
    plane: np.ndarray
    pairs: np.ndarray
    control: np.ndarray | None = None

    @classmethod
    def build(
        cls,
        faces: list[Rays],
        strips: list[str],
        planes: list[list[int]],
        pairs: list[tuple[int, int]],
    ) -> "TiePlanes":
        """From ``faces`` in any order; ``planes`` lists each plane's, ``pairs`` index them too.

        Faces on no plane are left out; so are pairs whose faces lie on different planes.
        Raises `TooFewPlanes`.
        """
        order = [face for plane in planes for face in plane]
        if len(planes) < LEAST_PLANES:
            raise TooFewPlanes(
                f"expected at least {LEAST_PLANES} matched planes, got {len(planes)}; fly over "
                "more roofs with more overlap, or widen the matching thresholds"
            )
        stops = np.cumsum([len(faces[face]) for face in order])
        place = {face: position for position, face in enumerate(order)}
        of_plane = np.repeat(np.arange(len(planes)), [len(plane) for plane in planes])
        kept = [(place[a], place[b]) for a, b in pairs if a in place and b in place]
        kept = [pair for pair in kept if of_plane[pair[0]] == of_plane[pair[1]]]
        ranges = np.column_stack([np.r_[0, stops[:-1]], stops]).astype(np.int64)
        return cls(
            Rays.join([faces[face] for face in order]),
            ranges,
            tuple(strips[face] for face in order),
            of_plane,
            np.array(kept, int).reshape(-1, 2),
        )

    @property
    def n_planes(self) -> int:
        return int(self.plane[-1]) + 1

    @property
    def controlled(self) -> np.ndarray:
        """(G,) bool: planes through a control point."""
        if self.control is None:
            return np.zeros(self.n_planes, bool)
        return np.isfinite(self.control[:, 3])

    def uncontrolled(self) -> "TiePlanes":
        """Without the planes through control points."""
        if self.control is None:
            return self
        return replace(self, control=None).subset(~self.controlled[self.plane])

    @property
    def plane_ranges(self) -> np.ndarray:
        """(G, 2) rows of all points of each plane."""
        first = np.searchsorted(self.plane, np.arange(self.n_planes))
        last = np.searchsorted(self.plane, np.arange(self.n_planes), side="right") - 1
        return np.column_stack([self.ranges[first, 0], self.ranges[last, 1]])

    @property
    def plane_of_point(self) -> np.ndarray:
        """(N,) index of each point's plane."""
        return np.repeat(self.plane, np.diff(self.ranges, axis=1)[:, 0])

    def states(self, mounting: Mounting) -> FaceStates:
        """Centroids and planes of the faces under ``mounting``."""
        return self._states(mounting, self.ranges)

    def plane_states(self, mounting: Mounting) -> FaceStates:
        """The same of the planes, each fitted to the points of all its faces."""
        return self._states(mounting, self.plane_ranges)

    def _states(self, mounting: Mounting, ranges: np.ndarray) -> FaceStates:
        unknowns = Unknowns.layout(mounting, int(self.rays.ring.max()) + 1, "none")
        return face_states(mounting.pointed(self.rays), ranges, unknowns, unknowns.start())

    def unevenness(self, mounting: Mounting, scanner: Scanner) -> np.ndarray:
        """(F,) how far each face departs from its plane beyond the noise of the laser, in units of
        the RMS of all; that noise is as specified but for a factor, the median face's. What chance
        makes of so many points, three standard deviations of it, makes no face uneven."""
        few = self.thinned(SHOWING)
        faces, rays, count = few.states(mounting), few.rays, np.diff(few.ranges, axis=1)[:, 0]
        sight = georeference(rays, mounting) - rays.pose[:, :3]
        distance = np.linalg.norm(sight, axis=1)
        normal = np.repeat(faces.plane[:, :3], count, axis=0)
        along = np.square(np.einsum("na,na->n", sight, normal) / distance)
        across = np.square(distance * scanner.angle_sigma) * (1 - along)
        noise = np.add.reduceat(along * scanner.range_sigma**2 + across, few.ranges[:, 0]) / count
        ratio = np.square(faces.rms) / noise
        typical = max(np.median(ratio), LEAST_NOISE**2)
        beyond = np.maximum(ratio / typical - 1, 3 * np.sqrt(2 / count))
        return np.sqrt(beyond / beyond.mean())

    def subset(self, keep: np.ndarray) -> "TiePlanes":
        """Without the faces where ``keep`` (F,) is False, and the planes that one face is left of,
        or none of those through a control point.

        Raises `TooFewPlanes`.
        """
        members = [np.flatnonzero(keep & (self.plane == g)) for g in range(self.n_planes)]
        least = np.where(self.controlled, 1, 2)
        kept = [g for g, faces in enumerate(members) if len(faces) >= least[g]]
        planes = [list(members[g]) for g in kept]
        faces = [self.rays.take(slice(first, last)) for first, last in self.ranges]
        pairs = [tuple(pair) for pair in self.pairs]
        built = TiePlanes.build(faces, list(self.strips), planes, pairs)
        return replace(built, control=None if self.control is None else self.control[kept])

    def thinned(self, most: int) -> "TiePlanes":
        """With at most ``most`` points a face, evenly spaced in their order."""
        index = [
            np.linspace(first, last - 1, min(most, last - first)).astype(int)
            for first, last in self.ranges
        ]
        stops = np.cumsum([len(rows) for rows in index])
        ranges = np.column_stack([np.r_[0, stops[:-1]], stops]).astype(np.int64)
        return replace(self, rays=self.rays.take(np.concatenate(index)), ranges=ranges)

    def mean_poses(self) -> np.ndarray:
        """(F, 6), each face's mean pose (headings within a face do not wrap)."""
        sums = np.add.reduceat(self.rays.pose, self.ranges[:, 0], axis=0)
        return sums / np.diff(self.ranges, axis=1)


def require_spread(normals: np.ndarray, least_deg: float = 3.0) -> None:
    """Raise `RankDefect` if all ``normals`` (G, 3) agree within ``least_deg``."""
    cosines = np.abs(normals @ normals.T)
    widest = np.rad2deg(np.arccos(np.clip(cosines.min(), -1, 1)))
    if widest < least_deg:
        raise RankDefect(
            f"all {len(normals)} planes are parallel within {widest:.2f} deg; expected roofs of "
            "several slopes and azimuths. Turns about the common normal cannot be seen: add "
            "differently inclined planes"
        )


def require_shared(tie_planes: TiePlanes) -> None:
    """Raise `TooFewPlanes` where fewer than `LEAST_PLANES` planes are seen from two strips."""
    strips = [set() for _ in range(tie_planes.n_planes)]
    for strip, plane in zip(tie_planes.strips, tie_planes.plane, strict=True):
        strips[plane].add(strip)
    shared = sum(len(names) > 1 for names in strips)
    if shared < LEAST_PLANES:
        raise TooFewPlanes(
            f"expected at least {LEAST_PLANES} planes that two strips or more see, got {shared} of "
            f"{tie_planes.n_planes}; a single strip calibrates nothing: add strips that overlap"
        )


def require_width(width: np.ndarray, what: list[str], least_m: float = 0.05) -> None:
    """Raise `RankDefect` where the points of a plane, or face, are only as wide as noise.

    ``width`` (F,) m as in `FaceStates`, ``what`` the F names.
    """
    narrow = np.flatnonzero(~(width >= least_m))
    if len(narrow):
        raise RankDefect(
            f"the points of {', '.join(what[k] for k in narrow[:5])} lie on a line or in a point: "
            f"expected a width of {100 * least_m:.0f} cm RMS, got {100 * width[narrow[0]]:.1f} cm; "
            "leave such faces out"
        )
