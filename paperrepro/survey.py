"""What an operator has after a flight: strips, a trajectory, a mounting, and the specifications.

Containers, which method and simulator share; they check what is put into them. Columns are arrays
of one length, N points or M poses. Metres, seconds, radians; frames as in `paperrepro.frames`.
"""

from dataclasses import dataclass, field, replace

import numba
import numpy as np

from paperrepro._compiled import over_threads
from paperrepro.errors import BadInput, EmptyStrip, NotFinite, OutsideTrajectory
from paperrepro.frames import R_NOMINAL, boresight_matrix, require_rotation


def require_finite(values, what: str) -> None:
    values = np.asarray(values)
    if not np.isfinite(values).all():
        where = int(np.flatnonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=1))[0])
        raise NotFinite(
            f"{what}: expected finite numbers, row {where} holds NaN or infinity; "
            "drop such records before calibrating"
        )


def require_vector(values, what: str) -> None:
    if np.shape(values) != (3,):
        raise BadInput(
            f"{what}: expected three numbers, got shape {np.shape(values)}; give one per body axis"
        )
    require_finite(values, what)


def require_lengths(lengths: dict[str, int], what: str) -> None:
    if len(set(lengths.values())) > 1:
        came = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise BadInput(
            f"{what}: expected columns of one length, got {came}; read them anew from one file"
        )


@dataclass(frozen=True, repr=False)
class Trajectory:
    """Poses in the m-frame: ``time`` (M,) s increasing, ``position`` (M, 3) m,
    ``attitude`` (M, 3) rad roll, pitch, heading (heading may wrap)."""

    time: np.ndarray
    position: np.ndarray
    attitude: np.ndarray

    def __repr__(self) -> str:
        return f"Trajectory({len(self.time)} poses, {self.time[0]:.3f}-{self.time[-1]:.3f} s)"

    def __post_init__(self):
        require_finite(self.time, "trajectory time")
        require_finite(self.position, "trajectory position")
        require_finite(self.attitude, "trajectory attitude")
        names = ("time", "position", "attitude")
        require_lengths({name: len(getattr(self, name)) for name in names}, "trajectory")
        if len(self.time) < 2 or not (np.diff(self.time) > 0).all():
            raise BadInput(
                "trajectory: expected at least two poses with increasing time, got "
                f"{len(self.time)} poses, not increasing or too few; sort it and drop repeats"
            )

    def at(self, time: np.ndarray, name: str = "strip") -> np.ndarray:
        """Poses (N, 6) at ``time`` (N,): east, north, up, roll, pitch, heading (unwrapped).

        Cubic Hermite between poses, with three-point tangents: at 200 Hz a 10 Hz vibration of
        0.03 deg is met to 2e-5 deg where a straight line misses it by 4e-4 deg.
        Raises `OutsideTrajectory` where ``time`` leaves the trajectory or falls into a gap.
        """
        time = np.ascontiguousarray(time, dtype=float)
        require_finite(time, f"{name} time")
        self._require_cover(time, name)
        pose, rate = self._nodes()
        out = np.empty((len(time), 6))
        over_threads(_hermite, len(time), self.time, pose, rate, time, out)
        return out

    def rate(self, time: np.ndarray) -> np.ndarray:
        """(N, 6) m/s and rad/s: how fast the pose changes at ``time`` (N,)."""
        _, rate = self._nodes()
        out = np.empty((len(time), 6))
        for k, column in enumerate(rate.T):
            out[:, k] = np.interp(time, self.time, column)
        return out

    def _nodes(self) -> tuple[np.ndarray, np.ndarray]:
        pose = np.column_stack([self.position, np.unwrap(self.attitude, axis=0)])
        return pose, np.gradient(pose, self.time, axis=0)

    def _require_cover(self, time: np.ndarray, name: str) -> None:
        low, high = time.min(), time.max()
        first, last = self.time[0], self.time[-1]
        if low < first or high > last:
            raise OutsideTrajectory(
                f"{name}: its points span {low:.3f}-{high:.3f} s, the trajectory "
                f"{first:.3f}-{last:.3f} s; give the trajectory of this flight, "
                "in the same time system"
            )
        step = np.diff(self.time)
        for gap in np.flatnonzero(step > max(1.0, 20 * np.median(step))):
            inside = (time > self.time[gap]) & (time < self.time[gap + 1])
            if inside.any():
                raise OutsideTrajectory(
                    f"{name}: {inside.sum()} points fall into a gap of {step[gap]:.1f} s in the "
                    f"trajectory after {self.time[gap]:.3f} s; process the trajectory without gaps"
                )


@numba.njit(cache=True, nogil=True)
def _hermite(first, last, nodes, value, rate, time, out):
    """Fill rows ``first`` to ``last`` of ``out``; times mostly increase, so the node before is
    tried first."""
    k = 0
    for i in range(first, last):
        if not (nodes[k] <= time[i] < nodes[k + 1]):
            k = min(max(np.searchsorted(nodes, time[i], side="right") - 1, 0), len(nodes) - 2)
        h = nodes[k + 1] - nodes[k]
        s = (time[i] - nodes[k]) / h
        a = 2 * s * s * s - 3 * s * s + 1
        b = s * s * s - 2 * s * s + s
        c = s * s * s - s * s
        for j in range(value.shape[1]):
            out[i, j] = (
                a * value[k, j]
                + (1 - a) * value[k + 1, j]
                + h * (b * rate[k, j] + c * rate[k + 1, j])
            )


@dataclass(frozen=True)
class Scanner:
    """A scanner by its specification.

    ``beam_elevations`` (rings,) rad ascending, or none (0,) where beams keep no elevation of their
    own (line scanners, solid state): each point then has its own. ``range_sigma`` m,
    ``angle_sigma`` rad (both encoder and beam), ``range_offset_sigma`` m: how well a beam's zero is
    known.
    """

    name: str
    beam_elevations: np.ndarray
    range_sigma: float
    angle_sigma: float
    range_offset_sigma: float = 0.03

    @property
    def n_rings(self) -> int:
        """Beams with a zero of their own; one where there are no rings."""
        return max(len(self.beam_elevations), 1)


#: No standard deviation of an accuracy file is believed to be a smaller share of its mean.
LEAST_FACTOR = 0.05


@dataclass(frozen=True)
class Navigation:
    """A GNSS/INS by its specification: ``position_sigma`` (3,) m east, north, up;
    ``attitude_sigma`` (3,) rad roll, pitch, heading; ``correlation_time`` s. ``profile``: times
    (T,) s and, at these, factors (T, 6) on the six sigmas, where it is known how they change."""

    name: str
    position_sigma: np.ndarray
    attitude_sigma: np.ndarray
    correlation_time: float
    profile: tuple[np.ndarray, np.ndarray] | None = None

    def with_profile(self, time: np.ndarray, sigma: np.ndarray) -> "Navigation":
        """With the standard deviations ``sigma`` (T, 6) m and rad at ``time`` (T,) s: the root of
        their mean square, and how they change, by no less than a share of `LEAST_FACTOR`."""
        mean = np.sqrt(np.square(sigma).mean(axis=0))
        factors = np.clip(sigma / np.where(mean > 0, mean, 1.0), LEAST_FACTOR, None)
        return replace(
            self, position_sigma=mean[:3], attitude_sigma=mean[3:], profile=(time, factors)
        )


@dataclass(frozen=True)
class Mounting:
    """How the scanner sits in the body: ``R_nominal`` l to b, ``lever_arm`` (3,) m b-frame,
    ``boresight`` (3,) rad omega, phi, kappa; ``range_offsets`` (rings,) m, and ``beam_offsets``
    (rings, 2) rad to elevations and azimuths of the beams, or None for zeros. ``known_to``, rad:
    standard deviation of the boresight before the flight, about none, or None where the flight
    alone is to tell."""

    R_nominal: np.ndarray = field(default_factory=R_NOMINAL.copy)
    lever_arm: np.ndarray = field(default_factory=lambda: np.zeros(3))
    boresight: np.ndarray = field(default_factory=lambda: np.zeros(3))
    range_offsets: np.ndarray | None = None
    beam_offsets: np.ndarray | None = None
    known_to: float | None = None

    def __post_init__(self):
        object.__setattr__(self, "R_nominal", require_rotation(self.R_nominal, "mounting rotation"))
        require_vector(self.lever_arm, "mounting lever arm")
        require_vector(self.boresight, "mounting boresight")
        if self.range_offsets is not None:
            require_finite(self.range_offsets, "mounting range offsets")
        if self.beam_offsets is not None:
            require_finite(self.beam_offsets, "mounting beam offsets")

    @property
    def R_l_b(self) -> np.ndarray:
        """(3, 3), boresight applied."""
        return boresight_matrix(self.boresight, self.R_nominal)

    @property
    def boresight_weight(self) -> np.ndarray:
        """(3,) rad^-2, of the pseudo-observation that the boresight is none."""
        return np.zeros(3) if self.known_to is None else np.full(3, self.known_to**-2.0)

    def offsets(self, n_rings: int) -> np.ndarray:
        """At least (n_rings,) m. Raises `BadInput` where the mounting knows fewer rings."""
        if self.range_offsets is None:
            return np.zeros(n_rings)
        offsets = np.asarray(self.range_offsets, float)
        if offsets.ndim != 1 or len(offsets) < n_rings:
            raise BadInput(
                f"mounting range offsets: expected one for each of {n_rings} rings, got shape "
                f"{offsets.shape}; give an offset per beam of the scanner, or none at all"
            )
        return offsets

    def with_calibration(self, boresight, range_offsets=None) -> "Mounting":
        """The same mounting with another boresight and range offsets."""
        return replace(self, boresight=np.asarray(boresight, float), range_offsets=range_offsets)

    def pointed(self, rays: "Rays") -> "Rays":
        """The rays with the beams' offsets applied."""
        if self.beam_offsets is None:
            return rays
        elevation, azimuth = self.beam_offsets[rays.ring].T
        return replace(rays, elevation=rays.elevation + elevation, azimuth=rays.azimuth + azimuth)


@dataclass(frozen=True, repr=False)
class Strip:
    """One flight line as measured: ``time`` (N,) s, ``ring`` (N,) uint8, ``azimuth`` (N,) rad,
    ``rho`` (N,) m measured range. A ring indexes `Scanner.beam_elevations`. Azimuth and range may
    be float32: at 100 m that is 10 um. ``pose`` (N, 6), m-frame, where a strip carries a pose per
    point; else poses come from the survey's trajectory. ``elevation`` (N,) rad, where the scanner
    has no rings; ``ring`` is zero then."""

    name: str
    time: np.ndarray
    ring: np.ndarray
    azimuth: np.ndarray
    rho: np.ndarray
    pose: np.ndarray | None = None
    elevation: np.ndarray | None = None

    def __repr__(self) -> str:
        return f"Strip({self.name}, {len(self)} points)"

    def __len__(self) -> int:
        return len(self.time)

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """What the strip has of its points, by name."""
        names = ("time", "ring", "azimuth", "rho", "pose", "elevation")
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    def take(self, index) -> "Strip":
        """The chosen points; ``index`` as numpy takes it."""
        return Strip(self.name, **{name: column[index] for name, column in self.columns.items()})

    def check(self) -> "Strip":
        """Return itself, or raise `EmptyStrip`, `NotFinite`, `BadInput`."""
        if len(self) == 0:
            raise EmptyStrip(f"{self.name}: expected points, the strip is empty; leave it out")
        require_lengths({name: len(column) for name, column in self.columns.items()}, self.name)
        for name, column in self.columns.items():
            require_finite(column, f"{self.name} {name}")
        return self


@dataclass(frozen=True, repr=False)
class Rays:
    """Laser points with their poses, ready for Eq. (1): ``pose`` (N, 6) m and rad, ``ring`` (N,),
    ``azimuth`` (N,) rad, ``elevation`` (N,) rad, ``rho`` (N,) m measured range; ``time`` (N,) s, or
    None where nothing depends on it."""

    pose: np.ndarray
    ring: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray
    rho: np.ndarray
    time: np.ndarray | None = None

    def __repr__(self) -> str:
        return f"Rays({len(self)})"

    def __len__(self) -> int:
        return len(self.rho)

    def take(self, index) -> "Rays":
        """The chosen rays; ``index`` as numpy takes it."""
        columns = (column[index] for column in self._columns())
        return Rays(*columns, None if self.time is None else self.time[index])

    def _columns(self):
        return self.pose, self.ring, self.azimuth, self.elevation, self.rho

    @staticmethod
    def join(parts: list["Rays"]) -> "Rays":
        """One after the other; with times only where all parts have them."""
        columns = zip(*(part._columns() for part in parts), strict=True)
        times = [part.time for part in parts]
        time = None if any(t is None for t in times) else np.concatenate(times)
        return Rays(*(np.concatenate(column) for column in columns), time)


@dataclass(frozen=True, repr=False)
class Survey:
    """A flight as its operator has it. ``reference`` is an independent cloud (K, 3) m, m-frame,
    or None."""

    strips: tuple[Strip, ...]
    trajectory: Trajectory
    mounting: Mounting
    scanner: Scanner
    navigation: Navigation
    reference: np.ndarray | None = None

    def strip(self, name: str) -> Strip:
        """The strip of that name. Raises `BadInput`."""
        found = {strip.name: strip for strip in self.strips}
        if name not in found:
            raise BadInput(f"strip {name!r}: expected one of {', '.join(found)}; name one of them")
        return found[name]

    def __repr__(self) -> str:
        span = self.trajectory.time[-1] - self.trajectory.time[0]
        boresight = ", ".join(f"{angle:.3f}" for angle in np.degrees(self.mounting.boresight))
        return (
            f"Survey({len(self.strips)} strips {', '.join(strip.name for strip in self.strips)}, "
            f"{sum(map(len, self.strips))} points, trajectory of {span:.0f} s, "
            f"{self.scanner.name}, {self.navigation.name}, boresight ({boresight})°)"
        )

    def elevation(self, strip: Strip) -> np.ndarray:
        """(N,) rad of the strip's points: those of its rings, or their own."""
        own = strip.elevation is not None
        return np.asarray(strip.elevation) if own else self.scanner.beam_elevations[strip.ring]

    def rays(self, strip: Strip, index=slice(None)) -> Rays:
        """`Rays` of a strip, or of the chosen points of it.

        Raises what `Strip.check` and `Trajectory.at` raise, and `BadInput` for an unknown ring.
        """
        part = strip.take(index).check()
        ring = np.asarray(part.ring)
        if ring.max() >= self.scanner.n_rings or ring.min() < 0:
            raise BadInput(
                f"{strip.name}: rings {ring.min()} to {ring.max()} found, {self.scanner.name} has "
                f"{self.scanner.n_rings}, counted from 0; choose the right scanner or ring column"
            )
        posed = part.pose is not None
        return Rays(
            np.asarray(part.pose) if posed else self.trajectory.at(part.time, strip.name),
            ring,
            np.asarray(part.azimuth, float),
            self.elevation(part).astype(float, copy=False),
            np.asarray(part.rho, float),
            np.asarray(part.time),
        )
