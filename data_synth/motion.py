"""True motion as a smooth function of time: a planned course, plus gusts and vibration.

The function is the cubic Hermite through exact values and rates every half millisecond. At 15 Hz,
the fastest vibration that the GNSS/INS sees, that differs from the sinusoids themselves by 1e-8 of
their amplitude; at 60 Hz by 3e-6.
"""

from dataclasses import dataclass, replace

import numba
import numpy as np
from scipy.interpolate import PPoly

from paperrepro._compiled import over_threads
from paperrepro.survey import Trajectory

#: Spacing of the exact poses, and of the trajectory's records, s.
FINE_STEP, RECORD_STEP = 5e-4, 5e-3
#: Root mean square of the gusts, east, north, up m, roll, pitch, heading rad, and their band, Hz.
GUST_RMS = np.array([0.2, 0.2, 0.15, *np.radians([1.5, 1.5, 2.0])])
GUST_BAND = np.array([[0.03, 0.4]] * 3 + [[0.05, 0.9]] * 3)
#: The same of the vibration of motors and frame.
VIBRATION_RMS = np.array([0.001, 0.001, 0.002, *np.radians([0.03, 0.03, 0.02])])
VIBRATION_BAND = np.array([[6.0, 15.0]] * 6)
N_GUSTS, N_VIBRATIONS = 12, 6
#: Vibration between GNSS/INS and scanner, which the former does not see: band, Hz, and root mean
#: square by degree of attitude, east, north, up m, roll, pitch, heading rad.
UNSEEN_BAND = np.array([[15.0, 60.0]] * 6)
UNSEEN_PER_DEGREE = np.array([0.03, 0.03, 0.06, *np.radians([1.0, 1.0, 1.0])])
N_UNSEEN = 12


@dataclass(frozen=True)
class Disturbance:
    """Six sums of sinusoids of ``amplitude`` (6, S) m and rad, ``omega`` (6, S) rad/s and ``phase``
    (6, S) rad, for east, north, up, roll, pitch, heading."""

    amplitude: np.ndarray
    omega: np.ndarray
    phase: np.ndarray

    def __add__(self, other: "Disturbance") -> "Disturbance":
        columns = ("amplitude", "omega", "phase")
        pairs = ([getattr(self, c), getattr(other, c)] for c in columns)
        return Disturbance(*(np.concatenate(pair, axis=1) for pair in pairs))

    def at(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (M, 6) and rates (M, 6)."""
        value, rate = np.empty((len(time), 6)), np.empty((len(time), 6))
        waves = self.amplitude, self.omega, self.phase
        over_threads(_sinusoids, len(time), time, *waves, value, rate, least=1024)
        return value, rate


def draw_disturbance(
    rng: np.random.Generator, gust_scale: float = 1.0, vibration_scale: float = 1.0
) -> Disturbance:
    """Frequencies log-uniform in their band, slow ones stronger, phases random; the scales are
    factors on `GUST_RMS` and `VIBRATION_RMS`."""
    parts = [
        _draw_band(gust_scale * GUST_RMS, GUST_BAND, N_GUSTS, rng),
        _draw_band(vibration_scale * VIBRATION_RMS, VIBRATION_BAND, N_VIBRATIONS, rng),
    ]
    return Disturbance(*(np.concatenate(column, axis=1) for column in zip(*parts, strict=True)))


def draw_unseen_vibration(rms_deg: float, rng: np.random.Generator) -> Disturbance:
    """A band of `UNSEEN_BAND` of ``rms_deg`` in each of roll, pitch and heading, and what goes with
    it in position."""
    return Disturbance(*_draw_band(rms_deg * UNSEEN_PER_DEGREE, UNSEEN_BAND, N_UNSEEN, rng))


def _draw_band(rms, band, count: int, rng) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    low, high = np.log(band[:, :1]), np.log(band[:, 1:])
    omega = 2 * np.pi * np.exp(rng.uniform(low, high, (6, count)))
    weight = rng.uniform(0.5, 1.0, (6, count)) / np.sqrt(omega)
    weight *= rms[:, None] * np.sqrt(2.0 / (weight**2).sum(axis=1, keepdims=True))
    return weight, omega, rng.uniform(0.0, 2 * np.pi, (6, count))


@numba.njit(cache=True, nogil=True)
def _sinusoids(first, last, time, amplitude, omega, phase, value, rate):
    for i in range(first, last):
        for j in range(6):
            total, slope = 0.0, 0.0
            for k in range(amplitude.shape[1]):
                argument = omega[j, k] * time[i] + phase[j, k]
                total += amplitude[j, k] * np.sin(argument)
                slope += amplitude[j, k] * omega[j, k] * np.cos(argument)
            value[i, j], rate[i, j] = total, slope


@dataclass(frozen=True)
class Motion:
    """True motion between ``start`` and ``end`` s; ``course`` gives east, north, up, heading."""

    course: PPoly
    disturbance: Disturbance
    start: float
    end: float

    def at(self, time: np.ndarray) -> np.ndarray:
        """Poses (N, 6) at ``time`` (N,) s: east, north, up m, roll, pitch, heading rad, unwrapped.

        Exact: what the simulated laser was really at, free of any interpolation of records.
        """
        time = np.ascontiguousarray(time, dtype=float)
        first = int((time.min() - self.start) / FINE_STEP) - 1
        last = int((time.max() - self.start) / FINE_STEP) + 2
        value, rate = self._exact(self.start + FINE_STEP * np.arange(first, last + 1))
        pose = np.empty((len(time), 6))
        origin = self.start + FINE_STEP * first
        over_threads(_hermite, len(time), time, origin, FINE_STEP, value, rate, pose)
        return pose

    def vibrating(self, unseen: Disturbance) -> "Motion":
        """The same with a further disturbance."""
        return replace(self, disturbance=self.disturbance + unseen)

    def record(self) -> Trajectory:
        """The true `Trajectory` every 5 ms, heading wrapped to [-pi, pi) as an SBET has it."""
        count = int((self.end - self.start) / RECORD_STEP)
        time = self.start + RECORD_STEP * np.arange(count + 1)
        pose, _ = self._exact(time)
        return Trajectory(time, pose[:, :3], np.column_stack([pose[:, 3:5], wrap(pose[:, 5])]))

    def _exact(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, rate = self.disturbance.at(time)
        for total, derivative in ((value, 0), (rate, 1)):
            total[:, [0, 1, 2, 5]] += self.course(time, nu=derivative)
        return value, rate


def wrap(angle: np.ndarray) -> np.ndarray:
    """To [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


@numba.njit(cache=True, nogil=True)
def _hermite(first, last, time, origin, step, value, rate, pose):
    for i in range(first, last):
        u = (time[i] - origin) / step
        k = min(max(int(u), 0), len(value) - 2)
        u -= k
        v = 1.0 - u
        a, b = (1.0 + 2.0 * u) * v * v, (1.0 + 2.0 * v) * u * u
        c, d = step * u * v * v, -step * u * u * v
        for j in range(6):
            pose[i, j] = a * value[k, j] + b * value[k + 1, j] + c * rate[k, j] + d * rate[k + 1, j]
