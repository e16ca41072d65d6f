"""Seconds of a call, and the rows that say so."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

#: A call is repeated until this many seconds are spent on it, but `REPEATS` times at most.
ENOUGH_S, REPEATS = 3.0, 5


@dataclass(frozen=True)
class Timing:
    """``seconds`` of the fastest call and of the ``first``, which may have compiled; its result."""

    seconds: float
    first: float
    result: object


def timed(function: Callable, *arguments) -> Timing:
    """The fastest of several calls: the others waited for something else."""
    seconds: list[float] = []
    while not seconds or (sum(seconds) < ENOUGH_S and len(seconds) < REPEATS):
        start = time.perf_counter()
        result = function(*arguments)
        seconds.append(time.perf_counter() - start)
    return Timing(min(seconds), seconds[0], result)


@dataclass(frozen=True)
class Row:
    """One stage on one size beside one peer.

    ``every``: one in how many pulses; ``points`` that went in; ``agreement`` of the two results in
    the ``measure`` that fits the stage.
    """

    stage: str
    every: int
    points: int
    seconds: float
    first_seconds: float
    peer: str = ""
    peer_seconds: float = float("nan")
    measure: str = ""
    agreement: float = float("nan")

    def as_dict(self) -> dict:
        return {**asdict(self), "ratio": self.seconds / self.peer_seconds}


def row(stage: str, every: int, points: int, ours: Timing, **peer) -> Row:
    return Row(stage, every, points, ours.seconds, ours.first, **peer)
