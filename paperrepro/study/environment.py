"""What a process runs in: versions of its packages, temporary files, variables that new ones get;
and what of it is told of a fault."""

import importlib.metadata
import os
import platform
import re
import shlex
import shutil
import sys
import tempfile
import time
import traceback
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from paperrepro import __version__
from paperrepro._cache import cache_folder
from paperrepro._files import private_folder, write_text

#: Variables that keep a process to one thread, where others work beside it.
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)

#: Variables that let a process keep memory that it has freed (glibc). By default a Dask worker
#: gives it back at once; the next survey needs the same again, and to fetch it takes a seventh of
#: the time.
KEEP_MEMORY = dict.fromkeys(("MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_"), str(2**32 - 1))


@contextmanager
def variables(values: Mapping[str, str]) -> Iterator[None]:
    """``values`` in the environment that new processes get."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name)
            else:
                os.environ[name] = value


@contextmanager
def temporary_files() -> Iterator[None]:
    """Temporary files of this process, of its libraries and of the processes that it starts lie in
    one folder. It is removed at the end, and with it those of processes that were killed."""
    before = tempfile.gettempdir()
    base = Path(before) / f"paperrepro-files-{os.getuid()}"
    if not private_folder(base, "*.none"):
        yield
        return
    for lock in map(FileLock, base.glob("*.lock")):
        with suppress(Timeout, OSError), lock.acquire(timeout=0):
            _remove(lock)
    lock = FileLock(base / f"{uuid.uuid4().hex[:12]}.lock")
    with lock, variables({"TMPDIR": lock.lock_file.removesuffix(".lock")}):
        os.mkdir(os.environ["TMPDIR"], 0o700)
        tempfile.tempdir = os.environ["TMPDIR"]
        try:
            yield
        finally:
            tempfile.tempdir = before
            _remove(lock)


def _remove(lock: FileLock) -> None:
    """The folder of a lock that is held, and its file."""
    shutil.rmtree(lock.lock_file.removesuffix(".lock"), ignore_errors=True)
    Path(lock.lock_file).unlink(missing_ok=True)


def package_versions() -> dict[str, str]:
    """Versions of the packages that the project asks for, as far as they are installed."""
    versions = {}
    for requirement in importlib.metadata.requires("paperrepro") or []:
        name = re.match(r"[\w.-]+", requirement)[0]
        if "extra ==" not in requirement:
            try:
                versions[name] = importlib.metadata.version(name)
            except importlib.metadata.PackageNotFoundError:
                continue
    return dict(sorted(versions.items()))


def fault(error: BaseException, arguments: Sequence[str]) -> str:
    """What to tell of an ``error`` that nobody foresaw. The rest, command, versions and traceback,
    is written into a file in the cache folder."""
    if isinstance(error, MemoryError):
        return f"out of memory ({error}); give fewer or smaller strips, or more memory"
    now = time.strftime("%Y-%m-%dT%H-%M-%S")
    path = cache_folder() / "faults" / f"{now}-{os.getpid()}.log"
    told = {
        "time": now,
        "command": shlex.join(["paperrepro", *arguments]),
        "folder": os.getcwd(),
        "Python": sys.version,
        "system": platform.platform(),
        "paperrepro": __version__,
    }
    lines = [f"{name}: {value}" for name, value in (told | package_versions()).items()]
    more = f"with {path}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, "\n".join([*lines, "", *traceback.format_exception(error)]))
    except OSError:
        more = "with what --verbose shows"
    return (
        f"{type(error).__name__}: {error}; this is a fault of the program: report it to those from "
        f"whom you have it, {more}"
    )
