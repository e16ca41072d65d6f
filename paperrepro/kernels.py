"""Compiled kernels: on disk, kept apart by the sources of all of them, and on all cores.

numba compiles a kernel anew when its own file has changed, but not when the kernel calls one of
another file and that has: a corrected sign in `paperrepro.georeference` would never reach the
compiled adjustment. So the folder of compiled kernels is named after every source that holds one.
"""

import functools
import hashlib
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numba

#: Tasks that a call is cut into at most, whatever the number of threads: what a task starts from
#: is then the same on every machine, to the last bit.
TASKS = 16
#: Fewer points are not worth a task.
POINTS = 4096


def source_key(package: Path) -> str:
    """Hash of all sources in ``package`` that mention numba."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        source = path.read_bytes()
        if b"numba" in source:
            digest.update(path.relative_to(package).as_posix().encode())
            digest.update(source)
    return digest.hexdigest()[:16]


def keep_apart() -> None:
    """Name numba's folder; to be called before the first kernel is defined."""
    package = Path(__file__).parent
    base = Path(numba.config.CACHE_DIR or package / "__pycache__")
    numba.config.CACHE_DIR = str(base / f"kernels-{source_key(package)}")


def threads() -> int:
    """Of this process: ``NUMBA_NUM_THREADS``, by default one a core."""
    return numba.config.NUMBA_NUM_THREADS


def over_threads(kernel: Callable, count: int, *arguments, least: int = POINTS) -> None:
    """``kernel(first, last, *arguments)`` over ``count`` items, at least ``least`` a task.

    ``kernel`` is compiled with ``nogil``, and no item's result depends on another's. Compiling such
    a loop takes a fraction of what numba's own parallel loops take.
    """
    step = max(least, -(-count // TASKS))
    tasks = [(first, min(first + step, count)) for first in range(0, count, step)]
    if threads() == 1 or len(tasks) == 1:
        for first, last in tasks:
            kernel(first, last, *arguments)
    else:
        for _ in _pool(os.getpid()).map(lambda task: kernel(*task, *arguments), tasks):
            pass


@functools.cache
def _pool(process: int) -> ThreadPoolExecutor:
    """Threads do not survive a fork, so each process has its own."""
    return ThreadPoolExecutor(threads())
