"""One run of a sweep, made by whichever Dask worker has room.

Nothing is asked of the worker but the same packages: the notebook comes as text, results go back
as text, so no folder needs to be shared.
"""

import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import nbformat

from paperrepro.errors import PaperReproError
from paperrepro.notebooks import OUTPUT, NotebookFailed
from paperrepro.sweep.fingerprint import Fingerprint
from paperrepro.sweep.kernel import Kernel, kernel_for

_LONGEST_ERROR = 500


class OtherVersion(PaperReproError):
    """A worker has another notebook, code or library than the sweep that asks it."""


@dataclass(frozen=True)
class Outcome:
    """What a run leaves: the executed ``notebook``, and its ``rows`` as CSV or an ``error``."""

    notebook: str
    rows: str
    error: str
    seconds: float


def run_point(parameters: Mapping, notebook: str, asked: Fingerprint, sweep: str) -> Outcome:
    """Execute ``notebook``, a text, with ``parameters``. Its own errors come back in the outcome.

    Raises `OtherVersion` where this worker would not make the rows that were ``asked`` for.
    """
    start = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="sweep-") as name:
        folder, target = Path(name), Path(name) / "executed.ipynb"
        kernel = kernel_for(sweep, lambda: require_version(notebook, asked))
        error = _execute(kernel, notebook, target, {**parameters, OUTPUT: name})
        rows = [path.read_text(encoding="utf-8") for path in folder.glob("rows/*.csv")]
        if not error and len(rows) != 1:
            error = f"expected one file of rows below {OUTPUT}, found {len(rows)}"
        return Outcome(
            _signed(target, asked) if target.exists() else notebook,
            "" if error else rows[0],
            " ".join(error.split())[:_LONGEST_ERROR],
            time.perf_counter() - start,
        )


def _execute(kernel: Kernel, notebook: str, target: Path, parameters: Mapping) -> str:
    """The error that ``notebook`` ended with, empty if there was none."""
    try:
        kernel.execute(nbformat.reads(notebook, as_version=4), target, parameters)
    except NotebookFailed as failure:
        return failure.reason
    except RuntimeError as dead:  # the kernel, for lack of memory for example
        return f"{type(dead).__name__}: {dead}"
    return ""


def require_version(notebook: str, asked: Fingerprint) -> None:
    """Raises `OtherVersion`, which says what differs here."""
    if differs := asked.differs_in(Fingerprint.of(notebook)):
        raise OtherVersion(
            f"a worker differs from the sweep in: {differs}; install the same version on all "
            "machines and restart their workers"
        )


def _signed(executed: Path, fingerprint: Fingerprint) -> str:
    """The executed notebook with what it was made by in its metadata."""
    book = nbformat.read(executed, as_version=4)
    book.metadata["paperrepro"] = fingerprint.told()
    return nbformat.writes(book)
