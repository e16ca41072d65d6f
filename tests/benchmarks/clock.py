"""Seconds of calls that take turns, and the rows that say so."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

#: All are called again until this many seconds are spent, `ROUNDS` times at most; where one call
#: takes longer than `LONG_S`, its first is all there is.
ENOUGH_S, ROUNDS, LONG_S = 15.0, 5, 60.0


@dataclass(frozen=True)
class Timing:
    """``rounds`` (R,) s, without the very first call, which may have compiled or loaded something;
    the ``result``."""

    rounds: np.ndarray
    result: object

    @property
    def seconds(self) -> float:
        """The median."""
        return float(np.median(self.rounds))


def timed(*functions: Callable[[], object]) -> list[Timing]:
    """Each in turn, then all again: what disturbs the machine meets all of them alike."""
    firsts, results = [], []
    for function in functions:
        seconds, result = _seconds(function)
        firsts.append(seconds)
        results.append(result)
    if max(firsts) > LONG_S:
        rounds = np.array([firsts])
    else:
        spent = []
        while not spent or (np.sum(spent) < ENOUGH_S and len(spent) < ROUNDS):
            spent.append([_seconds(function)[0] for function in functions])
        rounds = np.array(spent)
    return [Timing(*of) for of in zip(rounds.T, results, strict=True)]


def _seconds(function: Callable[[], object]) -> tuple[float, object]:
    start = time.perf_counter()
    result = function()
    return time.perf_counter() - start, result


@dataclass(frozen=True)
class Row:
    """One stage on one size beside one peer.

    ``every``: one in how many pulses; ``points`` that went in; ``seconds`` and ``peer_seconds``,
    medians; ``ratio``, the median over the rounds; ``agreement`` of the two results in the
    ``measure`` that fits the stage.
    """

    stage: str
    every: int
    points: int
    seconds: float
    peer: str = ""
    peer_seconds: float = float("nan")
    ratio: float = float("nan")
    measure: str = ""
    agreement: float = float("nan")

    def as_dict(self) -> dict:
        return asdict(self)


def row(
    stage: str,
    every: int,
    points: int,
    ours: Timing,
    peer: str = "",
    theirs: Timing | None = None,
    measure: str = "",
    agreement: float = float("nan"),
) -> Row:
    """`Row` of two that took turns, or each its own number of times, or of one alone."""
    if theirs is None:
        return Row(stage, every, points, ours.seconds)
    took_turns = len(ours.rounds) == len(theirs.rounds)
    ratio = np.median(ours.rounds / theirs.rounds) if took_turns else ours.seconds / theirs.seconds
    seconds = ours.seconds, peer, theirs.seconds
    return Row(stage, every, points, *seconds, float(ratio), measure, agreement)
