"""Points surveyed on the ground: how far the cloud lies over them, and planes through them.

The height of the cloud at a point is that of a plane through the laser points about it, of all
strips together, as a surveyor takes it from the delivered cloud: each cloud that is compared finds
its own laser points. Where that surface is no plane, or there are too few points, nothing is said.

Checkpoints judge, and nothing else reads them; control points enter scenario D, where they hold
what strips alone do not tell: the height of all, and constant errors.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from paperrepro.method.accuracy import nmad, rmse
from paperrepro.method.georeference import georeference
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Mounting, Rays, Survey

#: Poses (N, 6) in place of those reported, of times (N,) s and these.
Correct = Callable[[np.ndarray, np.ndarray], np.ndarray]
#: Laser points within so many metres of a point, seen from above, are its surface; so many at
#: least, about it and not beside it, and so near to a plane, m RMS.
RADIUS, LEAST_POINTS, FLAT_M = 1.0, 12, 0.08
#: Least spread of these points in any level direction, m; residuals beyond so many robust sigma
#: are no part of the surface.
LEAST_SPREAD, OUTLYING = 0.15, 3.0
#: Fits of a surface, each without what lies off the one before; robust sigma at least, m.
ROUNDS, LEAST_NMAD = 5, 1e-3
#: Laser points looked at together, and kept at most of a strip about a control point.
CHUNK, MOST_OF_VIEW = 1_000_000, 100
#: Vertical accuracy at 95 %, in RMSE, of offsets that are normal (ASPRS, NSSDA).
AT_95 = 1.96
#: ASPRS, Positional Accuracy Standards (2023): so many checkpoints at least.
ASKED = 30


@dataclass(frozen=True)
class ControlPoints:
    """Points surveyed on the ground.

    Parameters
    ----------
    names : (K,) tuple of str
    p_m : (K, 3) array, m, m-frame
    sigma : (K,) array, m
        Standard deviation of their heights.
    """

    names: tuple[str, ...]
    p_m: np.ndarray
    sigma: np.ndarray


@dataclass(frozen=True)
class VerticalAccuracy:
    """Of ``n`` offsets in height: their ``mean`` and ``rmse``, m."""

    n: int
    mean: float
    rmse: float

    @property
    def at_95(self) -> float:
        """What 95 % of normal offsets are within, m."""
        return AT_95 * self.rmse


@dataclass(frozen=True)
class CheckedHeights:
    """Heights of clouds over checkpoints.

    Attributes
    ----------
    points : ControlPoints
    offsets : mapping of str to (K,) array, m
        Cloud minus point, by the cloud's name; NaN at points ``off`` and ``uneven``.
    off, uneven : tuple of str
        Names of the points where strips have too few laser points, and where these are no plane.
    """

    points: ControlPoints
    offsets: Mapping[str, np.ndarray]
    off: tuple[str, ...]
    uneven: tuple[str, ...]

    def accuracy(self, cloud: str) -> VerticalAccuracy | None:
        """Of one cloud; None where no point is measured."""
        known = self.offsets[cloud][np.isfinite(self.offsets[cloud])]
        return VerticalAccuracy(len(known), known.mean(), rmse(known)) if len(known) else None

    def lines(self) -> list[str]:
        """For a terminal."""
        said = [f"checkpoints: height of the cloud over {len(self.points.names)} points"]
        for cloud in self.offsets:
            found = self.accuracy(cloud)
            if found:
                said.append(
                    f"  {cloud:10s} n {found.n}, mean {100 * found.mean:+.1f} cm, RMSE "
                    f"{100 * found.rmse:.1f} cm, 95 % {100 * found.at_95:.1f} cm"
                )
        return said + [f"  {sentence}" for sentence in self.remarks]

    @property
    def remarks(self) -> list[str]:
        """What was left out and why, and whether there are enough."""
        said = [left_out(self.off, self.uneven)] if self.off or self.uneven else []
        used = len(self.points.names) - len(self.off) - len(self.uneven)
        if used < ASKED:
            said.append(f"{used} points were measured; the ASPRS asks for {ASKED}.")
        return said


def left_out(off: tuple[str, ...], uneven: tuple[str, ...]) -> str:
    """A sentence on points that were not used."""
    parts = [
        f"{len(names)} {why} ({', '.join(names)})"
        for names, why in ((off, "off the strips"), (uneven, "on uneven ground")) if names
    ]  # fmt: skip
    return f"Points not used: {' and '.join(parts)}."


def clouds_of(
    nominal: Mounting, calibrated: Mounting, correct: Correct | None = None
) -> dict[str, tuple[Mounting, Correct | None]]:
    """Clouds whose heights are compared, before a calibration, with its mounting and with its
    trajectory, where it ``correct``s poses, for `check_heights`."""
    clouds = {"before": (nominal, None), "mounting": (calibrated, None)}
    return clouds | {"trajectory": (calibrated, correct)} if correct else clouds


def check_heights(
    survey: Survey, points: ControlPoints, clouds: Mapping[str, tuple[Mounting, Correct | None]]
) -> CheckedHeights:
    """Heights of clouds over ``points``.

    Parameters
    ----------
    survey : Survey
    points : ControlPoints
    clouds : mapping of str to (Mounting, Correct or None)
        The mounting, and what corrects the poses, of each cloud by name. In the last one the points
        are judged: whether they lie on the strips, and on a plane.

    Returns
    -------
    CheckedHeights
        Of the same points in every cloud.

    References
    ----------
    ASPRS, Positional Accuracy Standards for Digital Geospatial Data.
    """
    heights, rms = {}, np.empty(0)
    for cloud, (mounting, correct) in clouds.items():
        _, _, p_m, number = zip(*_near(survey, points, mounting, correct), strict=True)
        p_m, number = np.concatenate(p_m), np.concatenate(number)
        surfaces = [fitted(p_m[number == k], at) for k, at in enumerate(points.p_m)]
        heights[cloud] = np.array([np.nan if s is None else s.height for s in surfaces])
        rms = np.array([np.nan if s is None else s.rms for s in surfaces])
    known = np.isfinite(list(heights.values())).all(axis=0)
    offsets = {
        cloud: np.where(known & (rms <= FLAT_M), height - points.p_m[:, 2], np.nan)
        for cloud, height in heights.items()
    }
    off, uneven = (
        tuple(points.names[k] for k in np.flatnonzero(chosen))
        for chosen in (~known, known & (rms > FLAT_M))
    )
    return CheckedHeights(points, offsets, off, uneven)


def _near(
    survey: Survey, points: ControlPoints, mounting: Mounting, correct: Correct | None = None
) -> Iterator[tuple[str, Rays, np.ndarray, np.ndarray]]:
    """By strip and chunk: its name, the rays, as reported, whose points lie within `RADIUS` of one
    of ``points``, these (N, 3) m, and the number (N,) of the nearest."""
    tree = cKDTree(points.p_m[:, :2])
    for strip in survey.strips:
        for start in range(0, len(strip), CHUNK):
            rays = survey.rays(strip, slice(start, start + CHUNK))
            seen = rays
            if correct is not None:
                seen = replace(rays, pose=correct(rays.time, rays.pose))
            p_m = georeference(seen, mounting)
            _, number = tree.query(p_m[:, :2], distance_upper_bound=RADIUS)
            index = np.flatnonzero(number < len(points.names))
            yield strip.name, rays.take(index), p_m[index], number[index]


@dataclass(frozen=True)
class Surface:
    """Plane of laser points about a point: its ``height`` there, m, their ``rms`` m about it, and
    which of them it is made of, ``kept`` (N,) bool."""

    height: float
    rms: float
    kept: np.ndarray


def fitted(p_m: np.ndarray, at: np.ndarray) -> Surface | None:
    """`Surface` of points (N, 3) m about ``at`` (3,); None where they tell none."""
    step = p_m - at
    design, kept = np.column_stack([np.ones(len(step)), step[:, :2]]), np.ones(len(step), bool)
    for _ in range(ROUNDS):
        if not _about(step[kept, :2]):
            return None
        plane, *_ = np.linalg.lstsq(design[kept], step[kept, 2], rcond=None)
        off = step[:, 2] - design @ plane
        limit = OUTLYING * max(nmad(off[kept]), LEAST_NMAD)
        kept = np.abs(off - np.median(off[kept])) <= limit
    return Surface(float(at[2] + plane[0]), rmse(off[kept]), kept)


def _about(step: np.ndarray) -> bool:
    """Whether level steps (N, 2) m from a point lie about it, enough of them and not on a line."""
    if len(step) < LEAST_POINTS or np.linalg.norm(step.mean(axis=0)) > RADIUS / 2:
        return False
    return bool(np.linalg.eigvalsh(np.cov(step.T))[0] >= LEAST_SPREAD**2)


def with_control(
    survey: Survey, tie_planes: TiePlanes, points: ControlPoints, mounting: Mounting
) -> tuple[TiePlanes, tuple[str, ...], tuple[str, ...]]:
    """Tie planes with one more through each control point, from the laser points about it.

    Parameters
    ----------
    survey : Survey
    tie_planes : TiePlanes
    points : ControlPoints
    mounting : Mounting
        A calibrated one, under which laser points belong to control points.

    Returns
    -------
    TiePlanes
        With ``control``.
    off, uneven : tuple of str
        Points that could not be used, as `CheckedHeights` has them.
    """
    strip, rays, p_m, number = zip(*_near(survey, points, mounting), strict=True)
    strip = np.repeat(strip, list(map(len, number)))
    rays, p_m, number = Rays.join(list(rays)), np.concatenate(p_m), np.concatenate(number)
    faces = [tie_planes.rays.take(slice(*rows)) for rows in tie_planes.ranges]
    strips, pairs = list(tie_planes.strips), [tuple(pair) for pair in tie_planes.pairs]
    planes = [list(np.flatnonzero(tie_planes.plane == g)) for g in range(tie_planes.n_planes)]
    control = [np.full(4, np.nan)] * len(planes)
    off, uneven = [], []
    for k, name in enumerate(points.names):
        index = np.flatnonzero(number == k)
        surface = fitted(p_m[index], points.p_m[k])
        if surface is None or surface.rms > FLAT_M:
            (off if surface is None else uneven).append(name)
            continue
        index, first = index[surface.kept], len(faces)
        for of_strip in np.unique(strip[index]):
            view = index[strip[index] == of_strip]
            if len(view) >= LEAST_POINTS:
                few = np.linspace(0, len(view) - 1, min(MOST_OF_VIEW, len(view))).astype(int)
                faces.append(rays.take(view[few]))
                strips.append(str(of_strip))
        if len(faces) == first:
            off.append(name)
            continue
        planes.append(list(range(first, len(faces))))
        pairs += [(first, other) for other in range(first + 1, len(faces))]
        control.append(np.r_[points.p_m[k], points.sigma[k]])
    built = TiePlanes.build(faces, strips, planes, pairs)
    return replace(built, control=np.array(control)), tuple(off), tuple(uneven)
