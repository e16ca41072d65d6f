"""The rays as a witness: do trajectory, points, mounting and beam table belong together?

A beam leaves a spinning scanner at one elevation for ever. Points taken back through their poses
and the nominal mounting, with which they were computed, must therefore lie at the elevations of the
beam table, whatever the boresight; if heights, clocks, units or axes are mistaken they do not. The
elevations see every mistake but a turn about the spin axis (with the axis forward: a roll).
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numba
import numpy as np

from paperrepro._compiled import HEADING, PITCH, ROLL, over_threads, sines_near
from paperrepro.method.georeference import body_to_map
from paperrepro.survey import Mounting, Trajectory

#: Elevations that scatter less than this, beyond the resolution of the coordinates, fit.
FITS = float(np.radians(0.02))
#: A beam may differ from its table by so much, as each unit's own calibration does.
BEAM_TOLERANCE = float(np.radians(0.3))
#: Heights of the geoid over the ellipsoid, and how finely they are searched, m.
HEIGHTS, HEIGHT_STEP = np.arange(-120.0, 121.0, 4.0), 1e-3
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Sample:
    """Points of all strips: ``time`` (N,) s of the trajectory's clock, ``p_m`` (N, 3) m, ``ring``
    (N,) as recorded; ``scale`` m, the resolution of their coordinates; ``base`` m, the height
    of the m-frame's origin."""

    time: np.ndarray
    p_m: np.ndarray
    ring: np.ndarray
    scale: float
    base: float = 0.0

    def take(self, index) -> "Sample":
        """The chosen points."""
        return Sample(self.time[index], self.p_m[index], self.ring[index], self.scale, self.base)

    def few(self, count: int = 4000) -> "Sample":
        """Some ``count`` of them."""
        return self.take(slice(None, None, max(1, len(self.time) // count)))


def laser_rays(
    pose: np.ndarray, p_m: np.ndarray, mounting: Mounting
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Azimuth, elevation rad and range m, (N,) each, of points (N, 3) m seen from ``pose`` (N, 6)
    under ``mounting``: Eq. (1) and (2) backwards, without range offsets."""
    out = np.empty((3, len(p_m)))
    R_b_l, lever = np.ascontiguousarray(mounting.R_l_b.T), np.asarray(mounting.lever_arm, float)
    over_threads(_laser_rays, len(p_m), pose, np.ascontiguousarray(p_m), R_b_l, lever, out)
    return out[0], out[1], out[2]


@numba.njit(cache=True, nogil=True)
def _laser_rays(first, last, pose, p_m, R_b_l, lever, out):
    before = np.full((3, 3), np.nan)
    for i in range(first, last):
        east, north, up = p_m[i, 0] - pose[i, 0], p_m[i, 1] - pose[i, 1], p_m[i, 2] - pose[i, 2]
        sr, cr = sines_near(pose[i, 3], before, ROLL)
        sp, cp = sines_near(pose[i, 4], before, PITCH)
        sh, ch = sines_near(pose[i, 5], before, HEADING)
        R = body_to_map((sr, cr, sp, cp, sh, ch))
        x = R[0][0] * east + R[1][0] * north + R[2][0] * up - lever[0]
        y = R[0][1] * east + R[1][1] * north + R[2][1] * up - lever[1]
        z = R[0][2] * east + R[1][2] * north + R[2][2] * up - lever[2]
        l_x = R_b_l[0, 0] * x + R_b_l[0, 1] * y + R_b_l[0, 2] * z
        l_y = R_b_l[1, 0] * x + R_b_l[1, 1] * y + R_b_l[1, 2] * z
        l_z = R_b_l[2, 0] * x + R_b_l[2, 1] * y + R_b_l[2, 2] * z
        across = np.hypot(l_x, l_y)
        out[0, i], out[1, i] = np.arctan2(l_y, l_x), np.arctan2(l_z, across)
        out[2, i] = np.hypot(across, l_z)


@dataclass(frozen=True)
class Fit:
    """``scatter`` rad of the elevations about their ring's median; ``rings`` (K,) as recorded,
    their median ``elevations`` (K,) rad, and the ``limit`` rad below which the scatter is that of
    the coordinates' resolution."""

    scatter: float
    rings: np.ndarray
    elevations: np.ndarray
    limit: float

    @property
    def good(self) -> bool:
        """Nothing but resolution."""
        return self.scatter <= self.limit


def fit(pose: np.ndarray, sample: Sample, mounting: Mounting) -> Fit:
    """How well each ring keeps one elevation: the median of the absolute differences, as sigma."""
    _, elevation, rho = laser_rays(pose, sample.p_m, mounting)
    rings, order, edges = _by_ring(sample.ring)
    medians, scatter = _scatter(elevation[order], edges)
    limit = FITS + 1.5 * sample.scale / max(float(np.median(rho)), 1.0)
    return Fit(scatter, rings, medians, limit)


def _by_ring(ring: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The rings (K,), the order (N,) that brings their points together, their edges (K + 1,)."""
    order = np.argsort(ring, kind="stable")
    rings, first = np.unique(ring[order], return_index=True)
    return rings, order, np.r_[first, len(ring)]


def _scatter(elevation: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, float]:
    """Median of each ring, and the scatter about them all, of elevations that lie by ring."""
    medians = np.array([np.median(elevation[a:b]) for a, b in pairwise(edges)])
    difference = elevation - np.repeat(medians, np.diff(edges))
    return medians, 1.4826 * float(np.median(np.abs(difference)))


def beam_numbers(found: Fit, beams: np.ndarray) -> np.ndarray | None:
    """(K,) index into ``beams`` (rings,) rad of each recorded ring, in whatever order they are
    numbered, or None where they are not those beams."""
    number = np.abs(found.elevations[:, None] - beams).argmin(axis=1)
    limit = min(BEAM_TOLERANCE, 0.3 * float(np.diff(beams).min()))
    near = np.abs(found.elevations - beams[number]).max() <= limit
    return number if near and len(set(number)) == len(number) else None


@dataclass(frozen=True)
class Reading:
    """How points become rays: ``trajectory`` in the m-frame, nominal ``mounting``, ``time_shift`` s
    and ``height_shift`` m added to the points; the ``fit`` then."""

    trajectory: Trajectory
    mounting: Mounting
    time_shift: float
    height_shift: float
    fit: Fit


def try_reading(
    sample: Sample, trajectory: Trajectory, mounting: Mounting, time_shift: float = 0.0
) -> Reading | None:
    """The points seen from ``trajectory``; None where it does not cover them."""
    pose, part = poses_of(sample, trajectory, time_shift)
    if len(part.time) < 0.999 * len(sample.time):
        return None
    return Reading(trajectory, mounting, time_shift, 0.0, fit(pose, part, mounting))


def poses_of(
    sample: Sample, trajectory: Trajectory, time_shift: float = 0.0
) -> tuple[np.ndarray, Sample]:
    """Poses (K, 6) of the points that ``trajectory`` covers, and those points."""
    time = sample.time + time_shift
    inside = np.flatnonzero((time >= trajectory.time[0]) & (time <= trajectory.time[-1]))
    if not len(inside):
        return np.empty((0, 6)), sample.take(inside)
    return trajectory.at(time[inside], "sample"), sample.take(inside)


def with_height(reading: Reading, sample: Sample) -> Reading:
    """``reading`` with the shift of the points' heights under which it fits best."""
    pose, part = poses_of(sample, reading.trajectory, reading.time_shift)
    height, found = best_height(pose, part, reading.mounting)
    return replace(reading, height_shift=height, fit=found)


def best_height(pose: np.ndarray, sample: Sample, mounting: Mounting) -> tuple[float, Fit]:
    """The shift of heights, m, under which the rays fit best, and the `Fit` then."""
    _, order, edges = _by_ring(sample.ring)
    here = _across_and_along(pose, sample.p_m, mounting)[:, order]
    rise = _across_and_along(pose, sample.p_m + UP, mounting)[:, order] - here

    def scatter(height):
        x, y, z = here + height * rise
        return _scatter(np.arctan2(z, np.hypot(x, y)), edges)[1]

    best, step = min(HEIGHTS, key=scatter), HEIGHTS[1] - HEIGHTS[0]
    while step > HEIGHT_STEP:
        step /= 2
        best = min((best - step, best, best + step), key=scatter)
    return float(best), fit(pose, replace(sample, p_m=sample.p_m + best * UP), mounting)


def _across_and_along(pose, p_m, mounting: Mounting) -> np.ndarray:
    """(3, N) m, l-frame."""
    azimuth, elevation, rho = laser_rays(pose, p_m, mounting)
    across = rho * np.cos(elevation)
    return np.array([across * np.cos(azimuth), across * np.sin(azimuth), rho * np.sin(elevation)])
