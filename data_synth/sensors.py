"""The scanner: a Velodyne VLP-16 Puck Hi-Res by its data sheet, spinning about body forward.

l-frame: z along the spin axis, azimuth zero at nadir in the nominal mounting. Radians, seconds.
Source: Velodyne, VLP-16 User Manual 63-9243: 16 lasers fire 2.304 us apart, a sequence lasts
55.296 us, the lasers of the lower and upper half take turns; the Hi-Res has beams every 1.333 deg.
"""

from dataclasses import dataclass, field

import numpy as np

from paperrepro.survey import Scanner

N_RINGS = 16
#: From laser to laser and from sequence to sequence, s.
LASER_PERIOD, SEQUENCE_PERIOD = 2.304e-6, 55.296e-6
#: Rings (by ascending elevation) in the order of fire: lowest, ninth, second, tenth, ...
FIRING_ORDER = np.arange(N_RINGS).reshape(2, -1).T.ravel()
ROTATION_RATE = 10.0  # 1/s
MAX_RANGE, MIN_RANGE = 100.0, 0.5  # m
RANGE_SIGMA = 0.02  # m, one sigma; the data sheet promises 3 cm
ANGLE_SIGMA = np.radians(0.01)
RANGE_OFFSET_SIGMA = 0.03  # m, how well a beam's zero is known
#: Where the range noise is the specified one: perpendicular, this far off, m, this bright.
REFERENCE_DISTANCE, REFERENCE_REFLECTIVITY, LEAST_COSINE = 30.0, 0.4, 0.05
#: Half of the swath that is kept, azimuth from nadir, rad.
HALF_SWATH = np.radians(60.0)


def vlp16_hires() -> Scanner:
    """The specification that the operator has."""
    elevations = np.radians(np.linspace(-10.0, 10.0, N_RINGS))
    return Scanner("VLP-16 Puck Hi-Res", elevations, RANGE_SIGMA, ANGLE_SIGMA, RANGE_OFFSET_SIGMA)


@dataclass(frozen=True)
class ScannerErrors:
    """What a scanner does beside its specification.

    ``elevation_offsets`` and ``azimuth_offsets`` (16,) rad, to be added to the beams' elevations in
    the table and to the azimuths recorded; ``range_scale``, by which measured ranges are too long;
    ``noise_growth``, the power of `range_noise_factor`; ``clock_delay`` s, by which the laser's
    time stamps are later than the trajectory's clock.
    """

    elevation_offsets: np.ndarray = field(default_factory=lambda: np.zeros(N_RINGS))
    azimuth_offsets: np.ndarray = field(default_factory=lambda: np.zeros(N_RINGS))
    range_scale: float = 0.0
    noise_growth: float = 0.0
    clock_delay: float = 0.0


def range_noise_factor(reflectivity, cosine, distance, growth: float) -> np.ndarray:
    """Factor (N,) on the specified range noise of hits on a surface of ``reflectivity`` (N,) 0-1
    at ``distance`` (N,) m under the incidence of ``cosine`` (N,).

    The echo of an extended diffuse surface is s = reflectivity / 0.4 · cos(incidence) · (30 m /
    distance)², one where the specification holds, and the noise falls as s^(-growth / 2): 0 for
    none, 1 where shot noise rules, 2 where the receiver's own noise does. Source of the echo: the
    laser radar equation as in Wagner et al., ISPRS J. Photogramm. Remote Sens. 60 (2006).
    """
    echo = reflectivity / REFERENCE_REFLECTIVITY * np.maximum(cosine, LEAST_COSINE)
    return (echo * (REFERENCE_DISTANCE / distance) ** 2) ** (-0.5 * growth)


@dataclass(frozen=True)
class Pulses:
    """Shots in order of time: ``time`` (N,) s, ``ring`` (N,) uint8, ``azimuth`` (N,) rad."""

    time: np.ndarray
    ring: np.ndarray
    azimuth: np.ndarray

    def __len__(self) -> int:
        return len(self.time)


def fire(start: float, duration: float, thinning: int = 1) -> Pulses:
    """All pulses within the swath from ``start`` on, of one in ``thinning`` firing sequences."""
    sequence = start + SEQUENCE_PERIOD * _sequences(duration, thinning)
    near = np.abs(azimuth_at(sequence)) < HALF_SWATH + 0.05
    time = sequence[near, None] + LASER_PERIOD * np.arange(N_RINGS)
    azimuth = azimuth_at(time)
    kept = np.abs(azimuth) <= HALF_SWATH
    ring = np.broadcast_to(FIRING_ORDER.astype(np.uint8), time.shape)
    return Pulses(time[kept], ring[kept], azimuth[kept])


def azimuth_at(time: np.ndarray) -> np.ndarray:
    """Azimuth of the rotor, rad in [-pi, pi)."""
    turns = ROTATION_RATE * time
    return 2 * np.pi * (turns - np.floor(turns + 0.5))


def _sequences(duration: float, thinning: int) -> np.ndarray:
    """Numbers of the sequences kept: every ``thinning``-th, moved on by seven from turn to turn, so
    that a thin strip fills the ground as evenly as a full one."""
    count = int(duration / SEQUENCE_PERIOD)
    group = np.arange(0, count, thinning)
    turn = np.floor(group * SEQUENCE_PERIOD * ROTATION_RATE).astype(int)
    number = group + (7 * turn) % thinning
    return number[number < count]
