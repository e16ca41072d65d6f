"""Handing the runs of a sweep to Dask workers and taking in what they leave, one by one.

One run of a sweep, made by whichever Dask worker has room.

Nothing is asked of the worker but the same packages: the notebook comes as text, results go back
as text, so no folder needs to be shared.
"""

import logging
import signal
import sys
import tempfile
import time
import uuid
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import nbformat
from dask.distributed import Client, Future, LocalCluster, WorkerPlugin, as_completed
from dask.system import CPU_COUNT
from tqdm import tqdm

from paperrepro.errors import BadInput, PaperReproError
from paperrepro.study.environment import ONE_THREAD, variables
from paperrepro.study.grid import Fingerprint, Point
from paperrepro.study.kernel import Kernel, kernel_for, stop_kernels
from paperrepro.study.notebooks import OUTPUT, NotebookFailed
from paperrepro.study.store import Store

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


_CONNECT_S = 30  # a scheduler that is just being started is waited for
_DASHBOARD = "127.0.0.1:8787"  # or the next free port
_BAR = "{l_bar}{bar}| {n_fmt}/{total_fmt} [{elapsed}<{remaining}{postfix}]"


@dataclass
class Progress:
    """What has become of the runs that were waiting. ``lost`` ones left neither rows nor an error
    of their own, because a worker died for example; the next start makes them anew."""

    done: list[Point] = field(default_factory=list)
    failed: dict[Point, str] = field(default_factory=dict)
    lost: dict[Point, str] = field(default_factory=dict)
    seconds: float = 0.0
    interrupted: bool = False

    def __str__(self) -> str:
        return f"{len(self.done)} done, {len(self.failed) + len(self.lost)} failed"


@contextmanager
def cluster(scheduler: str | None = None, workers: int | None = None) -> Iterator[Client]:
    """A client of the workers of ``scheduler``, an address, or of so many new processes here.

    Raises `BadInput` where no scheduler answers.
    """
    if scheduler is None:
        with _local(workers or CPU_COUNT) as client:
            yield client
        return
    try:
        client = Client(scheduler, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:
        raise BadInput(
            f"--scheduler {scheduler}: expected the address of a Dask scheduler, such as "
            f"tcp://10.0.0.1:8786; none answers ({type(error).__name__}); start it with "
            "'dask scheduler'"
        ) from None
    with client:
        yield client


@contextmanager
def _local(workers: int) -> Iterator[Client]:
    """Processes of one thread, those of their libraries too."""
    warnings.filterwarnings("ignore", r"(?s)\s*Port .* is already in use")  # another is taken
    with (
        tempfile.TemporaryDirectory(prefix="sweep-dask-") as folder,
        variables(ONE_THREAD),
        LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, host="127.0.0.1",
            dashboard_address=_DASHBOARD, local_directory=folder, silence_logs=logging.CRITICAL,
        ) as processes,
        Client(processes) as client,
    ):  # fmt: skip
        client.register_plugin(_NotInterrupted())
        yield client


class _NotInterrupted(WorkerPlugin):
    """A terminal sends Ctrl-C to all processes; it is for the sweep alone, which ends the rest."""

    def setup(self, worker) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def check_workers(client: Client, notebook: str, asked: Fingerprint) -> int:
    """How many workers there are by now. Raises `BadInput` where one has another version."""
    answers = client.run(require_version, notebook, asked, on_error="return")
    for worker, answer in answers.items():
        if isinstance(answer, OtherVersion):
            raise BadInput(f"worker {worker}: {answer}")
        if isinstance(answer, Exception):
            raise BadInput(
                f"worker {worker}: {_in_a_line(answer)}; it needs this package, installed in the "
                "same version"
            )
    return len(answers)


def drive(
    client: Client, points: Sequence[Point], notebook: str, asked: Fingerprint, store: Store
) -> Progress:
    """Make all ``points`` by executing ``notebook``, a text, on the workers of ``client``.

    Ctrl-C ends it early, with what was done kept. Raises `OtherVersion` where a worker, or the
    code since the start, differs from what was ``asked``.
    """
    progress = Progress()
    sweep = uuid.uuid4().hex
    run = partial(run_point, notebook=notebook, asked=asked, sweep=sweep)
    parameters = [dict(point.parameters) for point in points]
    keys = [f"{point.name}-{sweep}" for point in points]
    futures = client.map(run, parameters, key=keys)
    waiting = dict(zip(futures, points, strict=True))
    try:
        with _bar(len(points)) as bar:
            for future in as_completed(futures):
                _take(future, waiting.pop(future), store, progress)
                bar.set_postfix_str(f"{progress}, {len(waiting)} left", refresh=False)
                bar.update()
    except KeyboardInterrupt:
        progress.interrupted = True
    finally:
        _stop(client, list(waiting), sweep)
    return progress


def _bar(total: int) -> tqdm:
    """Its estimate is what is left times the mean time so far; a file gets a line in a minute."""
    pause = 0.5 if sys.stderr.isatty() else 60
    return tqdm(total=total, smoothing=0, bar_format=_BAR, unit="run", mininterval=pause)


def _take(future: Future, point: Point, store: Store, progress: Progress) -> None:
    """Keep what one run left."""
    try:
        outcome = future.result()
    except OtherVersion:
        raise
    except Exception as error:
        progress.lost[point] = _in_a_line(error)
        return
    finally:
        future.release()
    progress.seconds += outcome.seconds
    error = outcome.error or _kept(point, outcome, store)
    if error:
        store.keep_failure(point, outcome.notebook, error)
        progress.failed[point] = error
    else:
        progress.done.append(point)


def _in_a_line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())


def _kept(point: Point, outcome: Outcome, store: Store) -> str:
    """Nothing, or why the rows cannot be kept."""
    try:
        store.keep(point, outcome.notebook, outcome.rows)
    except (BadInput, ValueError) as error:
        return str(error)
    return ""


def _stop(client: Client, futures: list[Future], sweep: str) -> None:
    """No run is begun any more, none goes on, and no kernel stays behind."""
    with suppress(Exception):
        client.cancel(futures, force=True)
        client.run(stop_kernels, sweep, on_error="ignore")
