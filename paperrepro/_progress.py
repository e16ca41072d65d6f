"""How far a command is: steps on a bar or in lines, and how long what is counted still takes."""

import ctypes
import sys
import time
from collections.abc import Callable
from contextlib import suppress

from tqdm import tqdm


def release_memory() -> None:
    """Give back to the system what was freed: glibc keeps arrays of up to 32 MB for later."""
    with suppress(OSError, TypeError, AttributeError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)


class Remaining:
    """Points of a work that are done of ``total``; ``progress`` is told what share that is, and
    how long the rest takes at the pace so far."""

    def __init__(self, what: str, total: int, progress: Callable[[str], None]):
        self._what, self._total, self._progress = what, total, progress
        self._done, self._start = 0, time.monotonic()

    def __call__(self, count: int) -> None:
        """So many more are done."""
        self._done += count
        left = (time.monotonic() - self._start) * max(self._total / max(self._done, 1) - 1, 0)
        share = f"{self._done / 1e6:.0f} of {self._total / 1e6:.0f} million points"
        self._progress(f"{self._what}: {share}, {tqdm.format_interval(left)} left")


class Steps:
    """A progress bar on a terminal, elsewhere a line for each step. The bar grows with the work:
    how long it is going to be is known in part only."""

    #: Between lines on how far a step is, s.
    PAUSE = 10.0

    def __init__(self, usual: int, lines: bool, quiet: bool):
        """``usual``: number of steps that are expected."""
        self._lines = lines and not quiet
        self._start = self._told = time.monotonic()
        self._bar = tqdm(
            total=usual, disable=quiet or lines, leave=False, file=sys.stderr,
            bar_format="{percentage:3.0f} %|{bar:30}| {elapsed} {desc}",
        )  # fmt: skip

    def __call__(self, words: str) -> None:
        """Begin a step, with the memory that the last one freed given back."""
        release_memory()
        if self._lines:
            self._line(words)
        elif not self._bar.disable:
            self._bar.set_description_str(words, refresh=False)
            self._bar.total = max(self._bar.total, self._bar.n + 2)
            self._bar.update(1)

    def within(self, words: str) -> None:
        """Say how far the step is."""
        if not self._bar.disable:
            self._bar.set_description_str(words)
        elif self._lines and time.monotonic() - self._told > self.PAUSE:
            self._line(words)

    def _line(self, words: str) -> None:
        self._told = time.monotonic()
        print(f"{self._told - self._start:7.1f} s  {words}", flush=True)

    def __enter__(self) -> "Steps":
        return self

    def __exit__(self, *_) -> None:
        self._bar.close()
