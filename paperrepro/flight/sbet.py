"""The trajectory as a post-processor writes it: SBET, and its accuracy file SMRMSG.

SBET: records of 17 little-endian float64: time s; latitude, longitude rad; ellipsoidal height m;
three velocities m/s; roll, pitch, heading rad; wander angle rad; three accelerations; three angular
rates. The attitude is against the local level at the pose, north-east-down, and the heading is the
platform's against *true* north: the wander angle turns the velocities, accelerations and rates,
which stand in the wander frame, and is not taken off the heading again. Some exports give the
heading in the wander frame too; the rays tell (`consistency`), and it is then taken off, noted.

SMRMSG: records of 10 little-endian float64: time s; north, east, down position m; three velocities
m/s; roll, pitch, heading in minutes of arc, all one sigma.

Strips and trajectory get one time system, GPS seconds of the trajectory's week. LAS holds seconds
of the GPS week, or adjusted standard GPS time (seconds since 1980-01-06, less 1e9); an SBET the
former as a rule. The size of the numbers tells them apart; the header's bit may lie. A multiple of
a week is taken out silently, point by point: nothing else could be meant, and a flight may cross
the end of a week. Leap seconds (UTC for GPS) are found by `consistency`, since a shift of 18 s may
still lie within the flight.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from paperrepro.errors import BadInput
from paperrepro.flight.geodesy import LocalFrame
from paperrepro.survey import Navigation, Trajectory

SBET_COLUMNS, SMRMSG_COLUMNS = 17, 10
WEEK = 604800.0


@dataclass(frozen=True)
class Poses:
    """Poses by latitude and longitude: ``time`` (M,) s increasing, ``latitude``, ``longitude``
    (M,) rad, ``height`` (M,) m ellipsoidal, ``attitude`` (M, 3) rad roll, pitch, heading against
    the local level and true north, ``wander`` (M,) rad; ``week`` s, what its times lack to count
    from the start of their GPS week."""

    time: np.ndarray
    latitude: np.ndarray
    longitude: np.ndarray
    height: np.ndarray
    attitude: np.ndarray
    wander: np.ndarray
    week: float = 0.0

    def in_frame(self, frame: LocalFrame) -> Trajectory:
        """The trajectory in the m-frame, times from the start of the GPS week."""
        return Trajectory(
            self.time + self.week,
            frame.from_geodetic(self.latitude, self.longitude, self.height),
            frame.attitude_from_level(self.latitude, self.longitude, self.attitude),
        )

    def near(self, time: np.ndarray) -> "Poses":
        """The poses about ``time`` (N,) s alone, so many that it is met as by all of them."""
        after = np.searchsorted(self.time + self.week, time)
        index = np.unique(np.clip(after[:, None] + np.arange(-3, 3), 0, len(self.time) - 1))
        names = ("time", "latitude", "longitude", "height", "attitude", "wander")
        return replace(self, **{name: getattr(self, name)[index] for name in names})


def read_sbet(path: Path) -> Poses:
    """The poses of an SBET, its times as written but continuous over a week's end.

    Raises `BadInput` for a file of another kind or length, for NaN, for degrees in place of
    radians, and for times that run backwards.
    """
    return poses_of(read_records(path, SBET_COLUMNS, "SBET"), path)


def poses_of(table: np.ndarray, path: Path) -> Poses:
    """The poses of records (M, 17) of the file ``path``; raises as `read_sbet`."""
    time = continuous(table[:, 0], path)
    kept = np.r_[True, np.diff(time) > 0]  # a repeated record says nothing new
    table, time = table[kept], time[kept]
    _require_radians(table, path)
    columns = table[:, 1], table[:, 2], table[:, 3], table[:, 7:10], table[:, 10]
    return Poses(time, *columns, week_start(time))


def read_accuracy(path: Path, navigation: Navigation, flown: np.ndarray) -> Navigation:
    """``navigation`` with the position and attitude sigmas of an SMRMSG: the root of their mean
    square over the file, and how they change. Raises `BadInput`, also where it holds nothing of
    the times ``flown`` (K,) s."""
    table = read_records(path, SMRMSG_COLUMNS, "SMRMSG")
    time, (north, east, down, *_, roll, pitch, heading) = (
        continuous(table[:, 0], path),
        table.T[1:],
    )
    sigmas = np.column_stack([east, north, down, roll, pitch, heading])
    position, attitude = np.sqrt(np.square(sigmas).mean(axis=0)).reshape(2, 3)
    if not (position.max() < 100 and 0 < attitude.max() < 600):
        raise BadInput(
            f"{path}: expected sigmas in metres and minutes of arc, got {position.max():.3g} m and "
            f"{attitude.max():.3g}'; give the SMRMSG that belongs to the SBET"
        )
    time = time + week_start(time)
    if time[-1] < flown[0] or time[0] > flown[-1]:
        raise BadInput(
            f"{path}: its times, {time[0]:.0f} to {time[-1]:.0f} s, are none of the trajectory's, "
            f"{flown[0]:.0f} to {flown[-1]:.0f} s; give the SMRMSG that belongs to the SBET"
        )
    sigmas[:, 3:] = np.radians(sigmas[:, 3:] / 60.0)
    return navigation.with_profile(time, sigmas)


def read_records(path: Path, columns: int, kind: str) -> np.ndarray:
    """(M, columns) of a file of float64 records. Raises `BadInput`."""
    path = Path(path)
    if not path.is_file():
        raise BadInput(f"{path}: no such file; give the {kind} of this flight")
    size, record = path.stat().st_size, 8 * columns
    with path.open("rb") as file:
        if file.read(4) == b"LASF":
            raise BadInput(
                f"{path}: expected a trajectory ({kind}), this is a LAS/LAZ file; "
                "were strip and trajectory swapped?"
            )
    if size % record or size < 2 * record:
        raise BadInput(
            f"{path}: expected {kind} records of {record} bytes, got {size} bytes, "
            f"{size // record} records and {size % record} bytes more; the file is cut off: copy "
            f"it again; or of another kind, such as a RIEGL POF: export {kind} or text"
        )
    table = np.fromfile(path, "<f8").reshape(-1, columns)
    finite = np.isfinite(table[:, :10]).all(axis=1)
    if not finite.all():
        raise BadInput(
            f"{path}: expected finite numbers, record {int(np.flatnonzero(~finite)[0])} holds NaN "
            f"or infinity; export the {kind} again"
        )
    return table


def continuous(time: np.ndarray, path: Path) -> np.ndarray:
    """Times without the jump back at the end of a GPS week."""
    step = np.diff(time)
    week = np.cumsum(np.r_[0, step < -0.5 * WEEK]) * WEEK
    back = np.flatnonzero(np.diff(time + week) < 0)
    if len(back):
        raise BadInput(
            f"{path}: expected increasing times, record {back[0] + 1} goes back by "
            f"{-step[back[0]]:.3f} s; the file is no SBET in little-endian order, or not sorted: "
            "export it again"
        )
    return time + week


def _require_radians(table: np.ndarray, path: Path) -> None:
    limits = {"latitude": (1, np.pi / 2), "longitude": (2, 2 * np.pi), "roll": (7, np.pi),
              "pitch": (8, np.pi / 2), "heading": (9, 2 * np.pi)}  # fmt: skip
    for name, (column, limit) in limits.items():
        largest = np.abs(table[:, column]).max()
        if largest <= limit + 1e-3:
            continue
        known = 360 if name in ("heading", "longitude") else 180
        if largest <= known:
            raise BadInput(
                f"{path}: {name} reaches {largest:.3f}, more than {limit:.4f} rad: it is in "
                "degrees; export the SBET in radians, as its format has it"
            )
        raise BadInput(
            f"{path}: {name} reaches {largest:.3g}, which is no angle; the file is no SBET "
            "(17 little-endian float64 a record): export it again"
        )


#: Unix time of the GPS epoch, less the leap seconds since 2017.
UNIX_TO_GPS = -315964800.0 + 18.0


@dataclass(frozen=True)
class TimeSystem:
    """``name``, and ``to_standard`` s, what takes it to seconds since the GPS epoch; None where
    the week is not known."""

    name: str
    to_standard: float | None


def recognise(time: np.ndarray) -> TimeSystem:
    """The time system of ``time`` (N,) s, by its size."""
    middle = float(np.median(time[np.isfinite(time)]))
    if abs(middle) < 2 * WEEK:
        return TimeSystem("seconds of the GPS week", None)
    if middle < 0.9e9:
        return TimeSystem("adjusted standard GPS time", 1e9)
    if middle < 1.5e9:
        return TimeSystem("standard GPS time", 0.0)
    return TimeSystem("Unix time", UNIX_TO_GPS)


def week_start(time: np.ndarray) -> float:
    """What to add to a trajectory's times, s, so that they count from the start of its week."""
    system = recognise(time)
    if system.to_standard is None:
        return 0.0
    standard = float(time[0]) + system.to_standard
    return system.to_standard - WEEK * np.floor(standard / WEEK)


@dataclass(frozen=True)
class Clock:
    """Times of a strip to seconds of the trajectory's week: ``shift`` s is added, and whole weeks
    until the time is the nearest to ``middle`` s, unless the strip knows its week (None)."""

    shift: float = 0.0
    middle: float | None = None

    def __call__(self, time: np.ndarray) -> np.ndarray:
        with np.errstate(invalid="ignore", over="ignore"):  # of times that are none
            time = np.asarray(time, float) + self.shift
            if self.middle is None:
                return time
            return time - WEEK * np.round((time - self.middle) / WEEK)


def clock_to(trajectory: np.ndarray, points: np.ndarray) -> Clock:
    """What makes times of points count as `week_start` makes a trajectory count.

    ``trajectory`` (M,) s as written, ``points`` (N,) s. Where one of them does not know its week,
    the week is the one that brings them nearest.
    """
    flown, seen = recognise(trajectory), recognise(points)
    if flown.to_standard is not None and seen.to_standard is not None:
        return Clock(week_start(trajectory) + seen.to_standard - flown.to_standard)
    middle = 0.5 * (trajectory[0] + trajectory[-1]) + week_start(trajectory)
    return Clock(week_start(points), float(middle))
