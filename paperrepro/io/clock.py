"""One time system for strips and trajectory: GPS seconds of the trajectory's week.

LAS holds seconds of the GPS week, or adjusted standard GPS time (seconds since 1980-01-06, less
1e9); an SBET the former as a rule. The size of the numbers tells them apart; the header's bit may
lie. A multiple of a week is taken out silently: nothing else could be meant. Leap seconds (UTC for
GPS) are found by `rays`, since a shift of 18 s may still lie within the flight.
"""

from dataclasses import dataclass

import numpy as np

WEEK = 604800.0
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
    middle = float(np.median(time))
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


def offset_to(trajectory: np.ndarray, points: np.ndarray) -> float:
    """What to add to times of points, s, to count as `week_start` makes a trajectory count.

    ``trajectory`` (M,) s as written, ``points`` (N,) s. Where one of them does not know its week,
    the week is the one that brings them nearest.
    """
    flown, seen = recognise(trajectory), recognise(points)
    if flown.to_standard is not None and seen.to_standard is not None:
        return week_start(trajectory) + seen.to_standard - flown.to_standard
    start = week_start(points)
    middle = 0.5 * (trajectory[0] + trajectory[-1]) + week_start(trajectory)
    return start + WEEK * np.round((middle - np.median(points) - start) / WEEK)
