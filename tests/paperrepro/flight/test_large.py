"""Flights of any size: what is held of them, and what is said of how far the work is."""

import platform
import subprocess
import sys
import tracemalloc
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from paperrepro import _progress
from paperrepro._progress import Remaining, Steps
from paperrepro.flight import las
from paperrepro.flight.decoding import Decoded, read_strip, sampled
from paperrepro.flight.las import Records
from paperrepro.flight.write import write_strips

CHUNK, CHUNKS = 10_000, 60
#: Bytes of a point of a strip.
POINT = 21


@dataclass
class Recorded:
    """A file of `CHUNKS` chunks, its ``times`` by chunk, and the decoder of it."""

    times: np.ndarray
    path: Path = Path("F1.laz")
    count: int = CHUNK * CHUNKS
    poses: None = None
    beam_of_ring: tuple = (0,)

    def chunks(self, done=None):
        for first in self.times:
            time = first + 1e-5 * np.arange(CHUNK)
            yield Records(time, np.zeros(CHUNK, np.int64), np.empty((CHUNK, 3)), {})

    def usable(self, chunk):
        return chunk

    decoded = usable

    def decode(self, file, records):
        """Every tenth pulse did not return."""
        time, rho = records.time, np.full(CHUNK, 30.0)
        rho[::10] = 0.0
        timed = np.ones(CHUNK, bool)
        ring, pose = records.ring.astype(np.uint8), np.zeros((CHUNK, 6))
        return Decoded(time, pose, ring, np.sin(time), np.zeros(CHUNK), rho, timed)


def peak_of(function, *arguments):
    """What it gives, and the most memory that it held, bytes."""
    tracemalloc.start()
    try:
        return function(*arguments), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_strip_is_held_once_while_it_is_read():
    file = Recorded(np.arange(CHUNKS, dtype=float))
    (strip, notes), most = peak_of(read_strip, file, file)
    assert len(strip) == 0.9 * file.count
    np.testing.assert_array_equal(strip.azimuth, np.sin(strip.time))
    assert len(notes) == 1
    assert most < 1.3 * POINT * file.count


def test_a_file_in_another_order_is_sorted_column_by_column():
    file = Recorded(np.arange(CHUNKS, dtype=float)[::-1])
    (strip, _), most = peak_of(read_strip, file, file)
    assert (np.diff(strip.time) > 0).all()
    np.testing.assert_array_equal(strip.azimuth, np.sin(strip.time))
    assert most < 2.0 * POINT * file.count


def test_reading_and_writing_say_how_long_they_take(folder, tmp_path):
    given, said = folder(), []
    flight = given.read(progress=said.append)
    millions = sum(file.count for file in flight.files) / 1e6
    assert len(said) == len(flight.files)
    assert said[-1] == f"reading: {millions:.0f} of {millions:.0f} million points, 00:00 left"
    write_strips(flight, flight.survey.mounting, tmp_path / "out", progress=said.append)
    assert said[-1].startswith("writing: ")
    assert said[-1].endswith("00:00 left")


def test_of_a_long_strip_a_sample_is_read_from_every_piece_of_it(folder, monkeypatch):
    file = folder().read().files[0]
    evenly = sampled(file)
    monkeypatch.setattr(las, "PIECE", file.count // 60)
    monkeypatch.setattr(type(file), "chunks", None)  # the whole is not read
    pieces = sampled(file)
    assert len(pieces.time) == pytest.approx(las.SAMPLE, rel=0.1)
    edges = np.quantile(evenly.time, np.linspace(0, 1, 50))
    assert (np.histogram(pieces.time, edges)[0] > 0).all()
    np.testing.assert_allclose(pieces.xyz.mean(axis=0), evenly.xyz.mean(axis=0), atol=1.0)
    assert set(pieces.ring) == set(evenly.ring)


@pytest.fixture
def clock(monkeypatch):
    """Seconds, that the test sets."""
    now = [0.0]
    monkeypatch.setattr(_progress.time, "monotonic", lambda: now[0])
    return now


def test_time_left_is_that_of_the_pace_so_far(clock):
    said = []
    done = Remaining("reading", 100_000_000, said.append)
    clock[0] = 30.0
    done(25_000_000)
    assert said == ["reading: 25 of 100 million points, 01:30 left"]


def test_lines_on_one_step_come_now_and_then(clock, capsys):
    with Steps(5, lines=True, quiet=False) as steps:
        steps("reading")
        for now in range(25):
            clock[0] = float(now)
            steps.within(f"at {now}")
    assert [line.split("  ")[-1] for line in capsys.readouterr().out.splitlines()] == [
        "reading", "at 11", "at 22",
    ]  # fmt: skip


def test_nothing_is_said_where_nothing_is_wanted(clock, capsys):
    with Steps(5, lines=True, quiet=True) as steps:
        steps("reading")
        clock[0] = 60.0
        steps.within("halfway")
    assert capsys.readouterr() == ("", "")


KEPT_BY_THE_C_LIBRARY = """
import numpy as np
from paperrepro._progress import Steps

def held():
    return 4096 * int(open("/proc/self/statm").read().split()[1])

for _ in range(2):  # from now on arrays of this size come from the heap
    np.ones(2 << 20)
parts = [np.ones(1 << 20) for _ in range(40)]
del parts[:-1]
before = held()
with Steps(1, lines=True, quiet=True) as steps:
    steps("reading")
print(before - held())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="of glibc")
def test_a_step_begins_with_what_the_last_one_freed_given_back():
    command = [sys.executable, "-c", KEPT_BY_THE_C_LIBRARY]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert int(told) > 30 * 8 * 2**20
