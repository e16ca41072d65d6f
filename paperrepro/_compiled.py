"""Compiled kernels: on disk, kept apart by the sources of all of them, and on all cores.

numba compiles a kernel anew when its own file has changed, but not when the kernel calls one of
another file and that has: a corrected sign in the LiDAR equation would never reach the compiled
adjustment. So the folder of compiled kernels is named after every source that holds one.

The sines here are those of angles that differ little from one ray to the next: attitude, and the
scanner's azimuth within a firing sequence, turn by far less than a degree. The sine and cosine of
the ray before, turned by a short series, cost less than new ones and are as exact.
"""

import atexit
import functools
import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import numba
import numpy as np
from numba.core import caching
from threadpoolctl import ThreadpoolController

from paperrepro._files import private_folder

#: Tasks that a call is cut into at most, whatever the number of threads: what a task starts from
#: is then the same on every machine, to the last bit. BLAS, whose sums differ with its threads, is
#: held to one where it sums much (`one_blas_thread`).
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
    """Name numba's folder; to be called before the first kernel is defined.

    Beside the package, or in the user's cache; where neither can be written, or is open to others,
    in one that ends with the process.
    """
    package, key = Path(__file__).parent, source_key(Path(__file__).parent)
    given = numba.config.CACHE_DIR
    homes = (os.environ.get("XDG_CACHE_HOME"), os.path.expanduser("~/.cache"))
    bases = (
        [given] if given else [package / "__pycache__", *(f"{h}/paperrepro" for h in homes if h)]
    )
    for folder in (Path(base) / f"kernels-{key}" for base in bases):
        if private_folder(folder):
            numba.config.CACHE_DIR = str(folder)
            return
    numba.config.CACHE_DIR = tempfile.mkdtemp(prefix=f"kernels-{key}-")
    atexit.register(shutil.rmtree, numba.config.CACHE_DIR, ignore_errors=True)


class _Kernels(caching.IndexDataCacheFile):
    """Compiled kernels on disk: a damaged file, or one that cannot be written, is none."""

    def load(self, key):
        """The kernel, or None."""
        try:
            return super().load(key)
        except Exception:  # unpickling raises whatever the bytes make it raise
            return None

    def save(self, key, data):
        """Write the kernel, over a damaged index too."""
        with suppress(OSError):
            try:
                super().save(key, data)
            except OSError:
                raise
            except Exception:
                self.flush()
                super().save(key, data)


caching.IndexDataCacheFile = _Kernels
keep_apart()


def one_blas_thread(function: Callable) -> Callable:
    """``function`` with BLAS on one thread: its threads wait for one another where matrices are
    small and many, and would make the last bits depend on their number."""

    @functools.wraps(function)
    def limited(*args, **kwargs):
        with _blas().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


@functools.cache
def _blas() -> ThreadpoolController:
    """The libraries that are loaded."""
    return ThreadpoolController()


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


#: Turns up to here, rad, go by the series of `turned`: the first term left out is 1e-18.
SERIES = 0.02
#: Rows of what is known of a ray's angles. NumPy's integers: for each plain one, a literal, numba
#: would compile `sines_near` anew.
ROLL, PITCH, HEADING, AZIMUTH, ELEVATION = np.arange(5)


@numba.njit(cache=True)
def turned(sine, cosine, by):
    """Sine and cosine of an angle enlarged by ``by``, rad."""
    if abs(by) > SERIES:
        s, c = np.sin(by), np.cos(by)
    else:
        q = by * by
        s = by * (1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0)))
        c = 1.0 - q / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0))
    return sine * c + cosine * s, cosine * c - sine * s


@numba.njit(cache=True)
def sines_near(angle, known, k):
    """Sine and cosine of ``angle``, rad, from those of one before, row ``k`` of ``known`` (K, 3):
    angle, sine, cosine. The row is renewed where it is too far away, and to begin with holds
    NaN."""
    by = angle - known[k, 0]
    if abs(by) <= SERIES:
        return turned(known[k, 1], known[k, 2], by)
    known[k, 0], known[k, 1], known[k, 2] = angle, np.sin(angle), np.cos(angle)
    return known[k, 1], known[k, 2]
