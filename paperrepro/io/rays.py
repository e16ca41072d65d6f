"""The rays as a witness: do trajectory, points, mounting and beam table belong together?

A beam leaves a spinning scanner at one elevation for ever. Points taken back through their poses
and the nominal mounting, with which they were computed, must therefore lie at the elevations of the
beam table, whatever the boresight; if heights, clocks, units or axes are mistaken they do not. The
elevations see every mistake but a turn about the spin axis (with the axis forward: a roll).
"""

from dataclasses import dataclass, replace

import numba
import numpy as np

from paperrepro.errors import BadInput
from paperrepro.frames import rotation_zyx
from paperrepro.survey import Mounting, Trajectory

#: Elevations that scatter less than this, beyond the resolution of the coordinates, fit.
FITS = float(np.radians(0.02))
#: Up to this they are taken, with a word: coordinates from another solution of the trajectory.
TOLERATED = float(np.radians(0.25))
#: A beam may differ from its table by so much, as each unit's own calibration does.
BEAM_TOLERANCE = float(np.radians(0.3))
#: Undulations of the geoid and their search step, m.
HEIGHTS = np.arange(-120.0, 121.0, 4.0)
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Sample:
    """Points of all strips: ``time`` (N,) s of the trajectory's clock, ``p_m`` (N, 3) m, ``ring``
    (N,) as recorded; ``scale`` m, the resolution of their coordinates."""

    time: np.ndarray
    p_m: np.ndarray
    ring: np.ndarray
    scale: float

    def take(self, index) -> "Sample":
        """The chosen points."""
        return Sample(self.time[index], self.p_m[index], self.ring[index], self.scale)


def laser_rays(
    pose: np.ndarray, p_m: np.ndarray, mounting: Mounting
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Azimuth, elevation rad and range m, (N,) each, of points (N, 3) m seen from ``pose`` (N, 6)
    under ``mounting``: Eq. (1) and (2) backwards, without range offsets."""
    out = np.empty((3, len(p_m)))
    R_b_l = np.ascontiguousarray(mounting.R_l_b.T)
    _laser_rays(pose, np.ascontiguousarray(p_m), R_b_l, np.asarray(mounting.lever_arm, float), out)
    return out[0], out[1], out[2]


@numba.njit(cache=True, parallel=True)
def _laser_rays(pose, p_m, R_b_l, lever, out):
    for i in numba.prange(len(p_m)):
        east, north, up = p_m[i, 0] - pose[i, 0], p_m[i, 1] - pose[i, 1], p_m[i, 2] - pose[i, 2]
        R_b_n = rotation_zyx(pose[i, 3], pose[i, 4], pose[i, 5])
        x = R_b_n[0, 0] * north + R_b_n[1, 0] * east - R_b_n[2, 0] * up - lever[0]
        y = R_b_n[0, 1] * north + R_b_n[1, 1] * east - R_b_n[2, 1] * up - lever[1]
        z = R_b_n[0, 2] * north + R_b_n[1, 2] * east - R_b_n[2, 2] * up - lever[2]
        l_x = R_b_l[0, 0] * x + R_b_l[0, 1] * y + R_b_l[0, 2] * z
        l_y = R_b_l[1, 0] * x + R_b_l[1, 1] * y + R_b_l[1, 2] * z
        l_z = R_b_l[2, 0] * x + R_b_l[2, 1] * y + R_b_l[2, 2] * z
        across = np.hypot(l_x, l_y)
        out[0, i], out[1, i] = np.arctan2(l_y, l_x), np.arctan2(l_z, across)
        out[2, i] = np.hypot(across, l_z)


@dataclass(frozen=True)
class Fit:
    """``scatter`` rad of the elevations about their ring's median; ``rings`` (K,) as recorded and
    their median ``elevations`` (K,) rad."""

    scatter: float
    rings: np.ndarray
    elevations: np.ndarray


def fit(pose: np.ndarray, sample: Sample, mounting: Mounting) -> Fit:
    """How well each ring keeps one elevation: the median of the absolute differences, as sigma."""
    _, elevation, _ = laser_rays(pose, sample.p_m, mounting)
    rings, number = np.unique(sample.ring, return_inverse=True)
    medians = np.array([np.median(elevation[number == k]) for k in range(len(rings))])
    scatter = 1.4826 * np.median(np.abs(elevation - medians[number]))
    return Fit(float(scatter), rings, medians)


def beam_numbers(found: Fit, beams: np.ndarray) -> np.ndarray | None:
    """(K,) index into ``beams`` (rings,) rad of each recorded ring, in whatever order they are
    numbered, or None where they are not those beams."""
    number = np.abs(found.elevations[:, None] - beams).argmin(axis=1)
    limit = min(BEAM_TOLERANCE, 0.3 * float(np.diff(beams).min()))
    near = np.abs(found.elevations - beams[number]).max() <= limit
    return number if near and len(set(number)) == len(number) else None


@dataclass(frozen=True)
class Reading:
    """How points become rays: ``trajectory`` in the m-frame; ``time_shift`` s and ``height_shift``
    m added to the points; the ``fit`` then; ``notes`` on what was found."""

    trajectory: Trajectory
    mounting: Mounting
    time_shift: float
    height_shift: float
    fit: Fit

    def poses(self, time: np.ndarray, name: str) -> np.ndarray:
        """(N, 6) at times of the points."""
        return self.trajectory.at(time + self.time_shift, name)


def expected_scatter(sample: Sample, mounting: Mounting, pose: np.ndarray) -> float:
    """Scatter that still counts as a fit: a fixed part, and the coordinates' resolution."""
    _, _, rho = laser_rays(pose, sample.p_m, mounting)
    return FITS + 1.5 * sample.scale / float(np.median(rho))


def try_reading(
    sample: Sample, trajectory: Trajectory, mounting: Mounting, time_shift: float = 0.0
) -> Reading | None:
    """The points as they are, seen from ``trajectory``; None where it does not cover them."""
    time = sample.time + time_shift
    inside = (time >= trajectory.time[0]) & (time <= trajectory.time[-1])
    if inside.mean() < 0.999:
        return None
    part = sample.take(inside)
    pose = trajectory.at(time[inside])
    return Reading(trajectory, mounting, time_shift, 0.0, fit(pose, part, mounting))


def with_height(reading: Reading, sample: Sample) -> Reading:
    """``reading`` with the shift of the points' heights under which it fits best."""
    pose = reading.poses(np.clip(
        sample.time, reading.trajectory.time[0] - reading.time_shift,
        reading.trajectory.time[-1] - reading.time_shift,
    ), "sample")  # fmt: skip

    def shifted(height):
        part = replace(sample, p_m=sample.p_m + height * UP)
        return fit(pose, part, reading.mounting)

    best = min(HEIGHTS, key=lambda height: shifted(height).scatter)
    step = HEIGHTS[1] - HEIGHTS[0]
    while step > 1e-3:
        step /= 2
        best = min((best - step, best, best + step), key=lambda height: shifted(height).scatter)
    return replace(reading, height_shift=float(best), fit=shifted(best))


def require_some_fit(reading: Reading, limit: float, what: str) -> None:
    """Raise `BadInput` where the rays do not fit at all."""
    if reading.fit.scatter > max(TOLERATED, limit):
        raise BadInput(
            f"{what}: the rays do not fit: within a beam the elevations scatter by "
            f"{np.degrees(reading.fit.scatter):.2f} deg, expected less than "
            f"{np.degrees(limit):.2f} deg; give the trajectory and the mounting with which the "
            "coordinates were computed"
        )
