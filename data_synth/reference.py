"""The reference: an airborne Leica ALS60 cloud of its own flight, about 5 points/m².

Two crossing lines 700 m above ground, scan +-15 deg, or more where the site is wider than one. The
cloud is shifted as a whole by the absolute error of its georeferencing and carries its own noise.
m-frame, metres.
"""

from dataclasses import dataclass

import numpy as np

from data_synth.raycast import Raycaster

HEIGHT, SPEED, HALF_SCAN = 700.0, 60.0, np.radians(15.0)
#: Points per m² of one line, and the mirror's sweeps per second that make the pattern square.
LINE_DENSITY = 2.5
ABSOLUTE_SIGMA = np.array([0.05, 0.05, 0.08])
POINT_SIGMA = 0.03
#: Half extents of what is delivered, m, at least, and beyond the middles of the outermost sites.
SITE_EXTENT, BEYOND = (140.0, 85.0), (68.0, 47.0)
#: Lines of one direction overlap by so much.
OVERLAP = 0.2


@dataclass(frozen=True)
class ReferenceNoise:
    """``shift`` (3,) m of the whole cloud and ``point_sigma`` m of each coordinate of a point."""

    shift: np.ndarray
    point_sigma: float


def draw_noise(noisy: bool, rng: np.random.Generator) -> ReferenceNoise:
    """What the reference is off by; nothing if not ``noisy``."""
    shift = ABSOLUTE_SIGMA * rng.normal(size=3)
    return ReferenceNoise(shift, POINT_SIGMA) if noisy else ReferenceNoise(np.zeros(3), 0.0)


def scan(caster: Raycaster, noisy: bool, rng: np.random.Generator, reach) -> np.ndarray:
    """The reference cloud (K, 3) m, m-frame, of sites whose middles ``reach`` (2,) m so far."""
    noise, extent = draw_noise(noisy, rng), np.maximum(SITE_EXTENT, np.add(reach, BEYOND))
    points = np.concatenate(
        [
            _scan_line(caster, axis, extent[axis] + 5.0, offset)
            for axis in (0, 1)
            for offset in _offsets(extent[1 - axis])
        ]
    )
    points += noise.point_sigma * rng.normal(size=points.shape)
    return points[(np.abs(points[:, :2]) < extent).all(axis=1)] + noise.shift


def _offsets(half_extent: float) -> np.ndarray:
    """Of the lines of one direction from the middle, m: one if its swath does."""
    swath = 2 * HEIGHT * np.tan(HALF_SCAN)
    count = 1 + max(0, int(np.ceil((2 * half_extent - swath) / (swath * (1 - OVERLAP)))))
    return swath * (1 - OVERLAP) * (np.arange(count) - 0.5 * (count - 1))


def _scan_line(caster: Raycaster, axis: int, half_line: float, offset: float) -> np.ndarray:
    """Exact points of one line along east (0) or north (1)."""
    swath = 2 * HEIGHT * np.tan(HALF_SCAN)
    pulses = int(LINE_DENSITY * 2 * half_line * swath)
    time = 2 * half_line / SPEED * np.arange(pulses) / pulses
    sweep = SPEED * np.sqrt(LINE_DENSITY) * time
    angle = HALF_SCAN * (2 * np.abs(sweep % 2 - 1) - 1)
    origin = np.zeros((pulses, 3))
    origin[:, axis], origin[:, 1 - axis], origin[:, 2] = SPEED * time - half_line, offset, HEIGHT
    direction = np.zeros((pulses, 3))
    direction[:, 1 - axis], direction[:, 2] = np.sin(angle), -np.cos(angle)
    distance, triangle = caster.cast(origin, direction)
    met = triangle >= 0
    return origin[met] + distance[met, None] * direction[met]
