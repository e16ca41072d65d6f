"""Do the rays fit the beams? The test behind every statement on the consistency of a flight.

A beam leaves a spinning scanner at one elevation for ever. Points taken back through their poses
and the nominal mounting, with which they were computed, must therefore lie at the elevations of the
beam table, whatever the boresight; if heights, clocks, units or axes are mistaken they do not. The
elevations see every mistake but a turn about the spin axis (with the axis forward: a roll).

A scanner that sweeps a plane has one such beam. Where beams go anywhere only gross mistakes show:
rays then leave the cone that such a scanner sees.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numba
import numpy as np

from paperrepro._compiled import HEADING, PITCH, ROLL, over_threads, sines_near
from paperrepro.method.georeference import body_to_map
from paperrepro.survey import Mounting

#: Elevations that scatter less than this, beyond the resolution of the coordinates, fit.
FITS = float(np.radians(0.02))
#: A beam may differ from its table by so much, as each unit's own calibration does.
BEAM_TOLERANCE = float(np.radians(0.3))
#: Heights of the geoid over the ellipsoid, and how finely they are searched, m.
HEIGHTS, HEIGHT_STEP = np.arange(-120.0, 121.0, 4.0), 1e-3
#: Points that a first search needs.
FEW = 600
#: Datums and epochs of one region differ by less than this in plan, m.
WIDEST_SHIFT = 5.0
#: Half of the rays of a scanner without beams lie within this of their middle, rad.
CONE = float(np.radians(45.0))
#: Marks a recorded ring that is no beam.
UNKNOWN_RING = 255
#: A ring with a smaller share of the points is a stray number, no beam.
RARE = 5e-4
#: Points nearer to the laser than this are pulses without a return; none comes from further, m.
NEAREST, FARTHEST = 0.5, 2000.0
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Sample:
    """Points of all strips: ``p_m`` (N, 3) m, ``ring`` (N,) as recorded; ``scale`` m, the
    resolution of their coordinates; ``beams``: whether these keep their elevations."""

    p_m: np.ndarray
    ring: np.ndarray
    scale: float
    beams: bool = True


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
    """How well each ring keeps one elevation: the median of the absolute differences, as sigma.
    Without beams: the median of the angles from the middle of all rays."""
    azimuth, elevation, rho = laser_rays(pose, sample.p_m, mounting)
    if not sample.beams:
        flat = np.cos(elevation)
        rays = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
        middle = rays.mean(axis=1)
        aside = np.arccos(np.clip(middle @ rays / np.linalg.norm(middle), -1, 1))
        return Fit(float(np.median(aside)), np.zeros(1, int), np.median(elevation, keepdims=True),
                   CONE)  # fmt: skip
    kept = np.flatnonzero(is_return(rho))
    if len(kept) < max(20, 0.02 * len(rho)):
        kept = np.arange(len(rho))
    rings, order, edges = _by_ring(sample.ring[kept])
    medians, scatter = _scatter(elevation[kept][order], edges)
    common = np.diff(edges) > RARE * len(kept)
    rings, medians = rings[common], medians[common]
    limit = FITS + 1.5 * sample.scale / max(float(np.median(rho[kept])), 1.0)
    return Fit(scatter, rings, medians, limit)


def about_mirror(pose: np.ndarray, sample: Sample, mounting: Mounting) -> Mounting:
    """For a test of a line scanner: makers name the axis of the mirror z or otherwise, so the
    laser's axes are named anew where the elevations about x or y clearly scatter less."""
    turned = [replace(mounting, R_nominal=np.roll(mounting.R_nominal, k, axis=1)) for k in range(3)]
    scatter = [fit(pose, sample, one).scatter for one in turned]
    return turned[int(np.argmin(scatter))] if min(scatter) < 0.1 * scatter[0] else mounting


def is_return(rho: np.ndarray) -> np.ndarray:
    """(N,) bool: a point at this range, m, is what a pulse met."""
    return (rho >= NEAREST) & (rho <= FARTHEST)


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


def best_height(pose: np.ndarray, sample: Sample, mounting: Mounting) -> tuple[float, Fit]:
    """The shift of heights, m, under which the rays fit best, and the `Fit` then."""

    def scatter_of(count):
        """As a function of the height, of some ``count`` points, as many of each ring."""
        index = _evenly(sample.ring, count)
        p_m, pose_of = sample.p_m[index.ravel()], pose[index.ravel()]
        here = _across_and_along(pose_of, p_m, mounting)
        rise = _across_and_along(pose_of, p_m + UP, mounting) - here

        def scatter(height):
            x, y, z = (here + height * rise).reshape(3, *index.shape)
            elevation = np.arctan2(z, np.hypot(x, y))
            return np.median(np.abs(elevation - np.median(elevation, axis=1, keepdims=True)))

        return scatter

    best = min(HEIGHTS, key=scatter_of(FEW))
    scatter, step = scatter_of(len(pose)), HEIGHTS[1] - HEIGHTS[0]
    while step > HEIGHT_STEP:
        step /= 2
        best = min((best - step, best, best + step), key=scatter)
    return float(best), fit(pose, _shifted(sample, best * UP), mounting)


def best_shift(
    pose: np.ndarray, sample: Sample, mounting: Mounting, start: np.ndarray
) -> tuple[np.ndarray, Fit]:
    """The shift (3,) m, east, north, up, within `WIDEST_SHIFT` of ``start`` in plan, under which
    the rays fit best, and the `Fit` then: the elevations' differences from their ring's median,
    linear in the shift, by least squares of those that are no outliers."""
    shift = np.asarray(start, float)
    for _ in range(12):
        moved = _shifted(sample, shift)
        e, J = _linearised(lambda d, m=moved: laser_rays(pose, m.p_m + d, mounting)[1], 1e-3,
                           sample.ring)  # fmt: skip
        step = _robust_solution(J, -e)
        shift = shift + step
        if np.abs(shift[:2] - start[:2]).max() > WIDEST_SHIFT or np.abs(step).max() < 1e-4:
            break
    if np.abs(shift[:2] - start[:2]).max() > WIDEST_SHIFT:
        shift = np.asarray(start, float)
    return shift, fit(pose, _shifted(sample, shift), mounting)


def best_rotation(pose: np.ndarray, sample: Sample, mounting: Mounting) -> tuple[np.ndarray, Fit]:
    """The boresight (3,) rad, least where the rays do not tell, under which they fit best, and the
    `Fit` then: that with which coordinates were computed that are calibrated already."""
    angles = np.zeros(3)
    for _ in range(8):
        e, J = _linearised(
            lambda d, a=angles: laser_rays(
                pose, sample.p_m, mounting.with_calibration(mounting.boresight + a + d)
            )[1], 1e-4, sample.ring,
        )  # fmt: skip
        step = _robust_solution(J, -e)
        angles = angles + step
        if np.abs(step).max() < 1e-7 or np.abs(angles).max() > 0.2:
            break
    return angles, fit(pose, sample, mounting.with_calibration(mounting.boresight + angles))


def _shifted(sample: Sample, shift: np.ndarray) -> Sample:
    return replace(sample, p_m=sample.p_m + shift)


def _linearised(elevations, h: float, ring: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Differences (N,) of ``elevations(change)`` from their ring's median, and their derivatives
    (N, 3) by steps of ``h``."""
    _, order, edges = _by_ring(ring)
    columns = [elevations(np.zeros(3)), *(elevations(h * axis) for axis in np.eye(3))]
    out = []
    for column in columns:
        column = column[order]
        out.append(column - np.repeat(_scatter(column, edges)[0], np.diff(edges)))
    return out[0], (np.column_stack(out[1:]) - out[0][:, None]) / h


def _robust_solution(J: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Least squares without residuals beyond three sigma; of least size where ``J`` is blind."""
    x, kept = np.zeros(3), np.abs(e) < np.inf
    for _ in range(3):
        x = np.linalg.lstsq(J[kept], e[kept], rcond=1e-4)[0]
        r = np.abs(e - J @ x)
        kept = r <= 3 * 1.4826 * max(float(np.median(r)), 1e-9)
    return x


def _evenly(ring: np.ndarray, count: int) -> np.ndarray:
    """(K, M) indices of some ``count`` points, as many of each of the K rings that are common."""
    _, order, edges = _by_ring(ring)
    common = np.flatnonzero(np.diff(edges) > RARE * len(ring))
    each = max(count // len(common), 1)
    return np.array([order[np.linspace(edges[k], edges[k + 1] - 1, each).astype(int)]
                     for k in common])  # fmt: skip


def _across_and_along(pose, p_m, mounting: Mounting) -> np.ndarray:
    """(3, N) m, l-frame."""
    azimuth, elevation, rho = laser_rays(pose, p_m, mounting)
    across = rho * np.cos(elevation)
    return np.array([across * np.cos(azimuth), across * np.sin(azimuth), rho * np.sin(elevation)])
