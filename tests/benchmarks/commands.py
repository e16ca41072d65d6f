"""Whole commands: reproductions, a sweep by one worker and by two, files read, first words."""

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import laspy
import psutil

from paperrepro.flight.las import CHUNK
from paperrepro.flight.read import read_flight
from tests.benchmarks.clock import row, timed

#: What a sweep is timed on: noise levels and seeds.
NOISE, SEEDS = "0,1", 6


def measured(*arguments: str, memory: bool = False, **variables: str) -> tuple[float, int]:
    """Seconds of ``paperrepro`` with these arguments, and with ``memory`` the most, bytes, that its
    processes had together, what they share counted once; looked at once a second."""
    command = [sys.executable, "-m", "paperrepro", *arguments]
    start, most = time.perf_counter(), 0
    with tempfile.TemporaryFile() as told:
        process = subprocess.Popen(
            command, env={**os.environ, **variables}, stdout=told, stderr=subprocess.STDOUT
        )
        while process.poll() is None:
            if memory:
                most = max(most, _memory(process.pid))
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=1.0)
        seconds = time.perf_counter() - start
        if process.returncode:
            told.seek(0)
            raise RuntimeError(told.read().decode(errors="replace")[-2000:])
    return seconds, most


def _memory(pid: int) -> int:
    total = 0
    try:
        for process in (top := psutil.Process(pid), *top.children(recursive=True)):
            total += process.memory_full_info().pss
    except psutil.NoSuchProcess:
        pass  # it ended while it was looked at
    return total


def sweep() -> dict:
    """The same surveys by one worker and by two."""
    seconds = {}
    for workers in (1, 2):
        with tempfile.TemporaryDirectory() as out:
            grid = "sweep", "--grid", f"noise_scale={NOISE}", "--seeds", str(SEEDS)
            seconds[workers], _ = measured(*grid, "--workers", str(workers), "--out", out)
    return {"stage": "sweep, 2 workers", "seconds": seconds[2], "peer": "1 worker",
            "peer_seconds": seconds[1], "ratio": seconds[2] / seconds[1]}  # fmt: skip


def reproduction(profile: str, every: int) -> dict:
    """Every notebook at one density, with nothing cached."""
    with tempfile.TemporaryDirectory() as out, tempfile.TemporaryDirectory() as cache:
        command = "reproduce", "--profile", profile, "--out", out
        seconds, most = measured(*command, memory=True, PAPERREPRO_CACHE=cache)
    return {"stage": f"{profile} profile", "every": every, "seconds": seconds,
            "memory_gib": most / 2**30}  # fmt: skip


def reading() -> dict:
    """All strips of the default flight at full density, read and decoded, beside `laspy` alone."""
    with tempfile.TemporaryDirectory() as out:
        measured("simulate", "--profile", "paper", "--out", out)
        folder = Path(out)
        files = sorted(folder.glob("F*.laz"))

        def bare() -> int:
            points = 0
            for file in files:
                with laspy.open(file) as reader:
                    points += sum(map(len, reader.chunk_iterator(CHUNK)))
            return points

        ours, theirs = timed(
            lambda: read_flight(files, folder / "mission.sbet", folder / "mounting.toml"), bare
        )
    return row("reading", 1, theirs.result, ours, "laspy", theirs).as_dict()


def first_words() -> Iterator[dict]:
    """Until the package is imported, and until a command says something."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import paperrepro"], check=True)
    yield {"stage": "import", "seconds": time.perf_counter() - start}
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-m", "paperrepro", "simulate", "--out", out]
        start = time.perf_counter()
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
            process.stdout.readline()
            yield {"stage": "first words", "seconds": time.perf_counter() - start}
            process.terminate()
