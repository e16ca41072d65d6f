"""Expensive stages kept on disk, keyed by their arguments and by the code that makes them.

Files lie in the user's cache folder, or in ``PAPERREPRO_CACHE``. A lock per entry lets two
processes ask at once: one computes, the other waits. An entry is written whole or not at all, and
read only if it is what was written: from a folder that nobody else can write into, since to load a
pickle is to run it, and with the sum of its bytes. Whatever is wrong with a cache costs time, never
the result.
"""

import ast
import functools
import importlib.util
import os
import pickle
import re
import tempfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import joblib
from filelock import FileLock

from paperrepro import API
from paperrepro._files import private_folder, whole_file

PACKAGES = ("paperrepro", "data_synth")
#: Names that the lazy door of the package offers, in full, and their modules.
_API = {f"paperrepro.{name}": module for name, module in API.items()}
#: Names the limit of all entries together, GB; a new one removes those that were not read longest.
LIMIT = "PAPERREPRO_CACHE_GB"
USUAL_GB = 5.0
_ENDINGS = (".joblib", ".sum", ".lock", ".part")
_KEY = "_cache_key"
_MISSING = object()


def cache_folder() -> Path:
    """Where entries are kept."""
    if given := os.environ.get("PAPERREPRO_CACHE"):
        return Path(given)
    if base := os.environ.get("XDG_CACHE_HOME"):
        return Path(base) / "paperrepro"
    try:
        return Path.home() / ".cache" / "paperrepro"
    except RuntimeError:  # a user without a home
        return Path(tempfile.gettempdir()) / f"paperrepro-{os.getuid()}"


class Entry(NamedTuple):
    """When it was last read (s since 1970), its size (bytes) and its ``path``."""

    read: float
    size: int
    path: Path


def entries() -> list[Entry]:
    """What is kept, the one last read at the end."""
    found = []
    for path in _ours(_ENDINGS[:1]):
        with suppress(OSError):  # another process has just removed it
            state = path.stat()
            found.append(Entry(state.st_mtime, state.st_size, path))
    return sorted(found)


def _ours(endings: tuple[str, ...]) -> list[Path]:
    """Files of the cache with these endings: nothing else that may lie in the folder."""
    return [
        path for path in cache_folder().glob("*/*.*")
        if path.suffix in endings and re.fullmatch("[0-9a-f]{32}", path.name.partition(".")[0])
    ]  # fmt: skip


def limit() -> float:
    """How many bytes are kept."""
    try:
        return 1e9 * float(os.environ.get(LIMIT, USUAL_GB))
    except ValueError:
        return 1e9 * USUAL_GB


def clear() -> list[Entry]:
    """Remove all entries; gives those that there were."""
    there = entries()
    for path in _ours(_ENDINGS):
        with suppress(OSError):
            path.unlink(missing_ok=True)
    return there


def _keep_to_limit() -> None:
    there = entries()
    while there and sum(entry.size for entry in there) > limit():
        path = there.pop(0).path
        for ending in _ENDINGS[:2]:
            path.with_suffix(ending).unlink(missing_ok=True)


def cached(function: Callable, *args: Any, **kwargs: Any) -> Any:
    """``function(*args, **kwargs)``, computed once.

    The key is the function, its arguments, and the source of every module it reaches by imports. An
    argument that itself came out of the cache stands for its key, so a survey of gigabytes is not
    read to be recognised. Arrays come back memory-mapped, copy on write.
    """
    identity = [_identity(value) for value in args]
    named = {name: _identity(value) for name, value in sorted(kwargs.items())}
    key = joblib.hash((function.__qualname__, code_version(function.__module__), identity, named))
    path = cache_folder() / function.__name__ / f"{key}.joblib"
    if not private_folder(path.parent, "*.joblib"):
        return _mark(function(*args, **kwargs), key)
    with _locked(path):
        value = _load(path)
        if value is _MISSING:
            value = function(*args, **kwargs)
            if _store(value, path):
                again = _load(path)
                value = value if again is _MISSING else again
    return _mark(value, key)


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Alone with the entry, where the folder knows locks."""
    lock = FileLock(path.with_suffix(".lock"))
    try:
        lock.acquire()
    except (OSError, NotImplementedError):
        lock = None
    try:
        yield
    finally:
        if lock is not None:
            lock.release()


def _identity(value: Any) -> Any:
    return getattr(value, _KEY, value)


def _mark(value: Any, key: str) -> Any:
    """Note on the object, or on each part of a tuple, which entry it is."""
    parts = enumerate(value) if isinstance(value, tuple) else [("", value)]
    for number, part in parts:
        if hasattr(part, "__dict__"):
            object.__setattr__(part, _KEY, f"{key}{number}")
    return value


def _load(path: Path) -> Any:
    """What the entry holds, or `_MISSING`; a damaged one is removed."""
    try:
        size, crc = map(int, path.with_suffix(".sum").read_text().split())
        if path.stat().st_size != size or _crc(path) != crc:
            raise ValueError("not what was written")
        path.touch()
        return joblib.load(path, mmap_mode="c")
    except FileNotFoundError:
        return _MISSING
    except Exception:  # unpickling raises whatever the bytes make it raise
        with suppress(OSError):
            path.unlink(missing_ok=True)
        return _MISSING


def _store(value: Any, path: Path) -> bool:
    """Whether ``value`` could be written to ``path``."""
    part, note = path.with_suffix(".joblib.part"), path.with_suffix(".sum")
    try:
        joblib.dump(value, part)
        written = f"{part.stat().st_size} {_crc(part)}\n"
        with whole_file(note) as draft:
            draft.write_text(written)
        os.replace(part, path)
        _keep_to_limit()
    except (OSError, pickle.PicklingError):
        return False
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
    return True


def _crc(path: Path) -> int:
    crc = 0
    with path.open("rb") as file:
        while block := file.read(1 << 24):
            crc = zlib.crc32(block, crc)
    return crc


@functools.cache
def code_version(module: str) -> str:
    """Hash of the sources of ``module`` and of all modules of ours that it imports, directly or
    not.
    """
    return _version_of([module])


def code_version_of(source: str) -> str:
    """The same of all modules of ours that ``source``, a text of Python, imports. Always read
    anew."""
    return _version_of(_imports(source.encode()))


def _version_of(modules: Iterable[str]) -> str:
    sources, waiting = {}, list(modules)
    while waiting:
        name = waiting.pop()
        spec = importlib.util.find_spec(name)
        if name in sources or spec is None or not spec.origin:
            continue
        sources[name] = Path(spec.origin).read_bytes()
        waiting += list(_imports(sources[name]))
    return joblib.hash(sorted(sources.items()))


def _imports(source: bytes) -> Iterator[str]:
    """Names of our modules that a source imports, also through the lazy names of `paperrepro`:
    ``pr.calibrate`` is its module of `paperrepro.API`, ``pr.method.ground`` that module."""
    tree, named = ast.parse(source), {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield from _modules(alias.name)
                top = alias.name.split(".")[0]
                named[alias.asname or top] = alias.name if alias.asname else top
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                yield from _modules(f"{node.module}.{alias.name}")
                named[alias.asname or alias.name] = f"{node.module}.{alias.name}"
    for node in ast.walk(tree):
        first, _, rest = _dotted(node).partition(".")
        if first in named:
            yield from _modules(f"{named[first]}.{rest}")


def _dotted(node: ast.AST) -> str:
    """``a.b.c`` as text; empty for all else."""
    if isinstance(node, ast.Attribute) and (before := _dotted(node.value)):
        return f"{before}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def _modules(name: str) -> Iterator[str]:
    """The module of ours that holds ``name``, a module itself or something of one."""
    if name.split(".")[0] in PACKAGES:
        while name not in _API and not _is_module(name):
            name = name.rpartition(".")[0]
        yield _API.get(name, name)


def _is_module(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False
