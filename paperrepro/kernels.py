"""Compiled kernels on disk, kept apart by the sources of all of them.

numba compiles a kernel anew when its own file has changed, but not when the kernel calls one of
another file and that has: a corrected sign in `paperrepro.georeference` would never reach the
compiled adjustment. So the folder of compiled kernels is named after every source that holds one.
"""

import hashlib
from pathlib import Path

import numba


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
