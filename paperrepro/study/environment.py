"""What a process runs in: the versions of its packages, and the variables that new ones get."""

import importlib.metadata
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

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
