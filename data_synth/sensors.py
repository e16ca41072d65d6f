"""Scanners by their data sheets, a Velodyne VLP-16 Puck Hi-Res first, spinning about body forward.

Two have no rings: a line scanner, one beam that a mirror turns across the flight, and a solid-state
one, whose beam two turning prisms send through a rosette about nadir that repeats after ten seconds
only (as of Livox; Brazeal et al., Sensors 21 (2021) 4722, describe such a pair). Both are of no
maker: rates and fields are chosen so that they measure as many points as the first.

l-frame: z along the spin axis, azimuth zero at nadir in the nominal mounting. Radians, seconds.
Sources: Velodyne, VLP-16 User Manual 63-9243: 16 lasers fire 2.304 us apart, a sequence lasts
55.296 us, the lasers of the lower and upper half take turns; the Hi-Res has beams every 1.333 deg.
HDL-32E User Manual 63-9113: 32 lasers likewise, 1.152 us apart, 46.080 us a sequence.
"""

from dataclasses import dataclass, field

import numpy as np

from paperrepro.survey import Scanner

#: Of the VLP-16: rings; from laser to laser and from sequence to sequence, s.
N_RINGS = 16
LASER_PERIOD, SEQUENCE_PERIOD = 2.304e-6, 55.296e-6
ROTATION_RATE = 10.0  # 1/s
MAX_RANGE, MIN_RANGE = 100.0, 0.5  # m
RANGE_SIGMA = 0.02  # m, one sigma; the data sheet promises 3 cm
ANGLE_SIGMA = np.radians(0.01)
RANGE_OFFSET_SIGMA = 0.03  # m, how well a beam's zero is known
#: Where the range noise is the specified one: perpendicular, this far off, m, this bright.
REFERENCE_DISTANCE, REFERENCE_REFLECTIVITY, LEAST_COSINE = 30.0, 0.4, 0.05
#: Half of the swath that is kept, azimuth from nadir, rad.
HALF_SWATH = np.radians(60.0)
#: Half of the solid-state scanner's field, rad from nadir.
HALF_ROSETTE = np.radians(35.0)
#: From pulse to pulse of the scanners without rings, s; turns a second.
PULSE_PERIOD, LINE_RATE = 1.0 / 300_000.0, 100.0  # of the line scanner
PRISM_PERIOD, PRISM_RATES = 1.0 / 100_000.0, (121.6, -77.7)


@dataclass(frozen=True)
class Model:
    """A scanner as it is sold: its ``name``, ``elevations_deg`` (rings,) of the beams, ascending,
    none where a beam keeps no elevation; the time from laser to laser and from sequence to
    sequence, s; turns of the rotor a second, or of each of its two prisms."""

    name: str
    elevations_deg: np.ndarray
    laser_period: float = LASER_PERIOD
    sequence_period: float = SEQUENCE_PERIOD
    rotation_rate: float = ROTATION_RATE
    prism_rates: tuple[float, float] | None = None

    @property
    def n_rings(self) -> int:
        """Number of beams."""
        return max(len(self.elevations_deg), 1)

    @property
    def firing_order(self) -> np.ndarray:
        """Rings in the order of fire: lowest, ninth (of 16), second, tenth, ..."""
        if self.n_rings == 1:
            return np.zeros(1, int)
        return np.arange(self.n_rings).reshape(2, -1).T.ravel()

    def directions(self, time: np.ndarray, ring: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Azimuth and elevation (N,) rad of the beams ``ring`` (N,) at ``time`` (N,) s."""
        if self.prism_rates is None:
            turned = azimuth_at(time, self.rotation_rate)
            return turned, self.specification.beam_elevations[ring]
        y, z = np.zeros(len(time)), np.zeros(len(time))
        for rate in self.prism_rates:  # each sends the beam aside by half of the field
            y += 0.5 * np.tan(HALF_ROSETTE) * np.cos(azimuth_at(time, rate))
            z += 0.5 * np.tan(HALF_ROSETTE) * np.sin(azimuth_at(time, rate))
        return np.arctan2(y, 1.0), np.arctan2(z, np.hypot(y, 1.0))

    @property
    def specification(self) -> Scanner:
        """What the operator has."""
        elevations = np.radians(self.elevations_deg)
        return Scanner(self.name, elevations, RANGE_SIGMA, ANGLE_SIGMA, RANGE_OFFSET_SIGMA)


VLP16_HIRES = Model("VLP-16 Puck Hi-Res", np.linspace(-10.0, 10.0, N_RINGS))
#: What can be chosen.
SCANNERS = {
    "VLP-16 Hi-Res": VLP16_HIRES,
    "VLP-16": Model("VLP-16", np.linspace(-15.0, 15.0, N_RINGS)),
    "HDL-32E": Model("HDL-32E", -92.0 / 3.0 + 4.0 / 3.0 * np.arange(32), 1.152e-6, 46.08e-6),
    "line": Model("line scanner", np.zeros(1), 0.0, PULSE_PERIOD, LINE_RATE),
    "solid-state": Model(
        "solid-state scanner", np.empty(0), 0.0, PRISM_PERIOD, prism_rates=PRISM_RATES
    ),
}


@dataclass(frozen=True)
class ScannerErrors:
    """What a scanner does beside its specification.

    ``elevation_offsets`` and ``azimuth_offsets`` (rings,) rad, to be added to the beams' elevations
    in the table and to the azimuths recorded; ``range_scale``, by which ranges are too long;
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
    """Shots in order of time: ``time`` (N,) s, ``ring`` (N,) uint8, ``azimuth`` and ``elevation``
    (N,) rad."""

    time: np.ndarray
    ring: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray

    def __len__(self) -> int:
        return len(self.time)


def fire(start: float, duration: float, thinning: int = 1, model: Model = VLP16_HIRES) -> Pulses:
    """All pulses within the swath from ``start`` on, of one in ``thinning`` firing sequences."""
    sequence = start + model.sequence_period * _sequences(duration, thinning, model)
    if model.prism_rates is None:
        near = np.abs(azimuth_at(sequence, model.rotation_rate)) < HALF_SWATH + 0.05
        sequence = sequence[near]
    time = (sequence[:, None] + model.laser_period * np.arange(model.n_rings)).ravel()
    ring = np.tile(model.firing_order.astype(np.uint8), len(sequence))
    azimuth, elevation = model.directions(time, ring)
    kept = np.abs(azimuth) <= HALF_SWATH
    return Pulses(time[kept], ring[kept], azimuth[kept], elevation[kept])


def azimuth_at(time: np.ndarray, rate: float = ROTATION_RATE) -> np.ndarray:
    """Azimuth, rad in [-pi, pi), of what turns ``rate`` times a second."""
    turns = rate * time
    return 2 * np.pi * (turns - np.floor(turns + 0.5))


def _sequences(duration: float, thinning: int, model: Model) -> np.ndarray:
    """Numbers of the sequences kept: every ``thinning``-th, moved on by seven from turn to turn, so
    that a thin strip fills the ground as evenly as a full one."""
    count = int(duration / model.sequence_period)
    group = np.arange(0, count, thinning)
    turn = np.floor(group * model.sequence_period * model.rotation_rate).astype(int)
    number = group + (7 * turn) % thinning
    return number[number < count]
