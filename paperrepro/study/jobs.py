"""What a Dask worker does with a point: execute a notebook, or measure a simulated survey.

What it needs comes with the task, what it makes goes back as text, so no folder is shared.
"""

import tempfile
import time
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path

import nbformat
from dask.distributed import get_worker

from paperrepro.errors import PaperReproError
from paperrepro.study.environment import KEEP_MEMORY, ONE_THREAD
from paperrepro.study.grid import Fingerprint
from paperrepro.study.kernel import kernel_for
from paperrepro.study.notebooks import OUTPUT, NotebookFailed, shortened
from paperrepro.study.rows import SurveyKey, frame

_LONGEST_ERROR = 500
#: Variables of kernels that work beside one another.
OF_A_WORKER = ONE_THREAD | KEEP_MEMORY


class OtherVersion(PaperReproError):
    """A worker has another notebook, code or library than the sweep that asks it."""


@dataclass(frozen=True)
class Outcome:
    """What a point leaves: an executed ``notebook``, if any, and its ``rows`` as CSV or an
    ``error``."""

    notebook: str
    rows: str
    error: str
    seconds: float


@dataclass(frozen=True)
class Job:
    """What a worker does with the parameters of a point, in the version that is ``asked`` for;
    ``name`` is another one at each start.

    A job's own errors come back in the `Outcome`.
    """

    asked: Fingerprint
    name: str = field(default_factory=lambda: uuid.uuid4().hex, kw_only=True)

    def __call__(self, parameters: Mapping) -> Outcome:
        """Raises `OtherVersion` where this worker would not make the rows asked for."""
        start = time.perf_counter()
        notebook, rows, error = self.made(parameters)
        error = " ".join(error.split())[:_LONGEST_ERROR]
        return Outcome(notebook, rows, error, time.perf_counter() - start)

    def made(self, parameters: Mapping) -> tuple[str, str, str]:
        """Notebook, rows and error of a point."""
        raise NotImplementedError

    def here(self) -> Fingerprint:
        """The version that this process has."""
        raise NotImplementedError

    def require_version(self) -> None:
        """Raises `OtherVersion`, which says what differs here."""
        if differs := self.asked.differs_in(self.here()):
            raise OtherVersion(
                f"a worker differs from the sweep in: {differs}; install the same version on all "
                "machines and restart their workers"
            )


@dataclass(frozen=True)
class NotebookJob(Job):
    """Execute ``notebook``, a text, and take the one file of rows that it writes."""

    notebook: str

    def made(self, parameters: Mapping) -> tuple[str, str, str]:
        with tempfile.TemporaryDirectory(prefix="sweep-") as name:
            folder, target = Path(name), Path(name) / "executed.ipynb"
            kernel, error = kernel_for(self.name, self.require_version, OF_A_WORKER), ""
            book = nbformat.reads(self.notebook, as_version=4)
            try:
                kernel.execute(book, target, {**parameters, OUTPUT: name}, _memory_limit())
            except NotebookFailed as failure:
                error = failure.reason
            except RuntimeError as dead:  # the kernel
                error = kernel.ended_for or f"{type(dead).__name__}: {dead}"
            rows = [path.read_text(encoding="utf-8") for path in folder.glob("rows/*.csv")]
            if not error and len(rows) != 1:
                error = f"expected one file of rows below {OUTPUT}, found {len(rows)}"
            executed = self._signed(target) if target.exists() else self.notebook
            return executed, "" if error else rows[0], error

    def here(self) -> Fingerprint:
        return Fingerprint.of_notebook(self.notebook)

    def _signed(self, executed: Path) -> str:
        """The executed notebook with what it was made by in its metadata."""
        book = shortened(nbformat.read(executed, as_version=4))
        book.metadata["paperrepro"] = self.asked.as_json()
        return nbformat.writes(book)


@dataclass(frozen=True)
class SurveyJob(Job):
    """Simulate a survey and measure it."""

    #: What is executed, as `Fingerprint` needs it.
    SOURCE = "from paperrepro.study.simulated import SimulatedSurvey, measure"

    def made(self, parameters: Mapping) -> tuple[str, str, str]:
        self._require_version_once()
        from paperrepro.study.simulated import Measured, SimulatedSurvey, measure

        key, what = (
            kind(**{one.name: parameters[one.name] for one in fields(kind)})
            for kind in (SurveyKey, Measured)
        )
        try:
            rows = frame(measure(SimulatedSurvey.of(key), what=what))
        except PaperReproError as error:
            return "", "", f"{type(error).__name__}: {error}"
        return "", rows.to_csv(index=False, float_format="%.10g"), ""

    def here(self) -> Fingerprint:
        return Fingerprint.of(self.SOURCE)

    def _require_version_once(self) -> None:
        """A process executes what it has read, whatever lies on disk later."""
        if self.name not in _checked:
            self.require_version()
            _checked.add(self.name)


_checked: set[str] = set()


def _memory_limit() -> int | None:
    """Bytes that Dask grants this worker; None where it does not say."""
    try:
        return get_worker().memory_manager.memory_limit
    except (ValueError, AttributeError):
        return None
