"""The reference: an airborne Leica ALS60 cloud of its own flight, about 5 points/m².

Two crossing lines 700 m above ground, scan +-15 deg. The cloud is shifted as a whole by the
absolute error of its georeferencing and carries its own noise. m-frame, metres.
"""

from dataclasses import dataclass

import numpy as np

from data_synth.raycast import Raycaster

HEIGHT, SPEED, HALF_SCAN = 700.0, 60.0, np.radians(15.0)
#: Points per m² of one line, and the mirror's sweeps per second that make the pattern square.
LINE_DENSITY = 2.5
ABSOLUTE_SIGMA = np.array([0.05, 0.05, 0.08])
POINT_SIGMA = 0.03
#: Half extents of the site that is delivered, m.
SITE_EXTENT = (140.0, 85.0)


@dataclass(frozen=True)
class ReferenceNoise:
    """``shift`` (3,) m of the whole cloud and ``point_sigma`` m of each coordinate of a point."""

    shift: np.ndarray
    point_sigma: float


def draw_noise(noisy: bool, rng: np.random.Generator) -> ReferenceNoise:
    """What the reference is off by; nothing if not ``noisy``."""
    shift = ABSOLUTE_SIGMA * rng.normal(size=3)
    return ReferenceNoise(shift, POINT_SIGMA) if noisy else ReferenceNoise(np.zeros(3), 0.0)


def scan(caster: Raycaster, noisy: bool, rng: np.random.Generator) -> np.ndarray:
    """The reference cloud (K, 3) m, m-frame."""
    noise = draw_noise(noisy, rng)
    points = np.concatenate([_scan_line(caster, axis) for axis in (0, 1)])
    points += noise.point_sigma * rng.normal(size=points.shape)
    return points[(np.abs(points[:, :2]) < SITE_EXTENT).all(axis=1)] + noise.shift


def _scan_line(caster: Raycaster, axis: int) -> np.ndarray:
    """Exact points of one line along east (0) or north (1)."""
    swath = 2 * HEIGHT * np.tan(HALF_SCAN)
    half_line = SITE_EXTENT[axis] + 5.0
    pulses = int(LINE_DENSITY * 2 * half_line * swath)
    time = 2 * half_line / SPEED * np.arange(pulses) / pulses
    sweep = SPEED * np.sqrt(LINE_DENSITY) * time
    angle = HALF_SCAN * (2 * np.abs(sweep % 2 - 1) - 1)
    origin = np.zeros((pulses, 3))
    origin[:, axis], origin[:, 2] = SPEED * time - half_line, HEIGHT
    direction = np.zeros((pulses, 3))
    direction[:, 1 - axis], direction[:, 2] = np.sin(angle), -np.cos(angle)
    distance, triangle = caster.cast(origin, direction)
    met = triangle >= 0
    return origin[met] + distance[met, None] * direction[met]
