"""Whole commands: a sweep by one worker and by two, and the full-density reproduction."""

import contextlib
import os
import subprocess
import sys
import tempfile
import time

import psutil

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


def paper_profile() -> dict:
    """Every notebook at full density, with nothing cached."""
    with tempfile.TemporaryDirectory() as out, tempfile.TemporaryDirectory() as cache:
        command = "reproduce", "--profile", "paper", "--out", out
        seconds, most = measured(*command, memory=True, PAPERREPRO_CACHE=cache)
    return {"stage": "paper profile", "every": 1, "seconds": seconds, "memory_gib": most / 2**30}
