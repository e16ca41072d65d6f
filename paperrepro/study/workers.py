"""Many surveys, one engine: points handed to Dask workers, and what they leave taken in one by one.

A point of a sweep is a notebook that is executed, one of a study a simulated survey that is
measured.
"""

import logging
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
from dask.distributed import Client, Future, LocalCluster, Security, WorkerPlugin, as_completed
from dask.system import CPU_COUNT
from tqdm import tqdm

from paperrepro._cache import cache_folder
from paperrepro._files import require_folder
from paperrepro.errors import BadInput
from paperrepro.study.environment import ONE_THREAD, temporary_files, variables
from paperrepro.study.grid import SEED, Fingerprint, Point, points, read_grid
from paperrepro.study.jobs import Job, NotebookJob, OtherVersion, Outcome, SurveyJob
from paperrepro.study.kernel import stop_kernels
from paperrepro.study.notebooks import declared, without_outputs
from paperrepro.study.rows import ARTEFACT, SurveyKey, frame
from paperrepro.study.store import Store

#: Surveys of a setting where nothing else is asked for.
SEEDS = 20
#: How long workers of a scheduler are waited for, s.
WAIT_S = 60.0
_CONNECT_S = 30  # a scheduler that is just being started is waited for
_LOOK_S = 2.0  # between two looks at whether there are workers
_DASHBOARD = "127.0.0.1:8787"  # or the next free port
_BAR = "{l_bar}{bar}| {n_fmt}/{total_fmt} [{elapsed}<{remaining}{postfix}]"
_LONGEST_ERROR = 500
_GONE = "the scheduler is gone"

#: Is given a sentence at each step.
Progress = Callable[[str], None]


@dataclass
class Finished:
    """What has become of the points of a study or sweep.

    Attributes
    ----------
    rows : pandas.DataFrame
        Tidy rows of all points that have some, in the order of the points; a survey that could not
        be measured is a row of metric ``failed``.
    points : list of Point
        All of them.
    done : int
        How many have rows of their own, now and from before.
    failed : dict of Point to str
        Their errors, now and from before; not made again unless that is asked for.
    lost : dict of Point to str
        Left neither rows nor an error of their own, since a worker died for example; the next
        start makes them anew.
    stopped : str
        Why it ended early, empty if it did not; what is missing is made by the next start.
    """

    points: list[Point]
    rows: pd.DataFrame = field(default_factory=lambda: frame([]))
    done: int = 0
    failed: dict[Point, str] = field(default_factory=dict)
    lost: dict[Point, str] = field(default_factory=dict)
    stopped: str = ""


def run_sweep(
    notebook: str | Path,
    grid: Sequence[str],
    out: str | Path,
    *,
    seeds: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    wait_s: float = WAIT_S,
    retry_failed: bool = False,
    progress: Progress = lambda words: None,
) -> Finished:
    """Execute a notebook over a grid of its parameters; started again, only what is missing.

    Parameters
    ----------
    notebook : path
        Has ``figures_dir`` among its parameters and writes one file of tidy rows there.
    grid : sequence of str
        Values by parameter, such as ``"noise_scale=0,0.5,1"``.
    out : path
        Folder of executed notebooks and rows by run (``runs/``), ``sweep.csv``, ``failed.csv`` and
        ``sweep.json``.
    seeds : int, optional
        Seeds 1 to so many; by default `SEEDS` where the notebook has a seed that ``grid`` does not
        name.
    workers : int, optional
        Processes on this machine; by default one a core.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers are used instead.
    wait_s : float
        How long workers of the scheduler are waited for, s.
    retry_failed : bool
        Whether runs that have failed before are made again.
    progress : callable
        Is given a sentence at each step.

    Returns
    -------
    Finished
        Rows of all points, what failed, and whether all was done.

    Raises
    ------
    BadInput
        Where a parameter is unknown, a point cannot be simulated, the folder is in use or cannot
        be written, no scheduler answers, or a worker has another version.
    """
    _require_one_of(workers, scheduler)
    notebook, known = Path(notebook), declared(Path(notebook))
    named = any(text.startswith(f"{SEED}=") for text in grid)
    if seeds is None and SEED in known and not named:
        seeds = SEEDS
    values = read_grid(grid, known, seeds)
    text = without_outputs(notebook)
    job = NotebookJob(Fingerprint.of_notebook(text), text)
    runs = points(values, known, job.asked)
    _refuse_what_cannot_be_simulated(runs)
    with Store(Path(out)) as store:
        finished = _make(job, runs, store, workers, scheduler, wait_s, retry_failed, progress)
        finished.rows = store.collate(runs, [name for name in values if len(values[name]) > 1])
        about = {"notebook": notebook.name, "grid": values, **job.asked.as_json()}
        store.write(finished.rows, finished.failed | finished.lost, about)
    return finished


def run_study(
    surveys: Mapping[SurveyKey, object],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    wait_s: float = WAIT_S,
    retry_failed: bool = False,
    progress: Progress = lambda words: None,
) -> Finished:
    """Simulate and measure many surveys; started again, only what is missing.

    What is done is kept in the cache folder, by the version of code and packages.

    Parameters
    ----------
    surveys : dict of SurveyKey to Measured
        Surveys and what is measured of each, such as `paperrepro.study.simulated.planned` gives.
    workers, scheduler, wait_s, retry_failed, progress
        As in `run_sweep`.

    Returns
    -------
    Finished
        Rows of all surveys, what failed, and whether all was done.

    Raises
    ------
    BadInput
        As in `run_sweep`.
    """
    _require_one_of(workers, scheduler)
    job = SurveyJob(Fingerprint.of(SurveyJob.SOURCE))
    shown = [one.name for one in fields(SurveyKey)]
    runs = [
        Point.of({**asdict(key), **asdict(what)}, job.asked, shown) for key, what in surveys.items()
    ]
    with _study_folder(job, progress) as folder, Store(folder) as store:
        finished = _make(job, runs, store, workers, scheduler, wait_s, retry_failed, progress)
        finished.rows = store.collate(runs)
    return finished


@contextmanager
def _study_folder(job: Job, progress: Progress) -> Iterator[Path]:
    """Below the cache folder; where that cannot be written, for a while only."""
    folder = cache_folder() / ARTEFACT / str(job.asked)[:12]
    try:
        require_folder(folder)
    except BadInput as error:
        progress(f"{str(error).split(';')[0]}: a study that is stopped begins anew")
        with tempfile.TemporaryDirectory(prefix="study-") as name:
            yield Path(name)
    else:
        yield folder


def _require_one_of(workers: int | None, scheduler: str | None) -> None:
    """Raises `BadInput` where both are given, or no number of workers."""
    if workers is not None and scheduler:
        raise BadInput(
            "--workers and --scheduler: expected one of them; a scheduler brings its own workers"
        )
    if workers is not None and workers < 1:
        raise BadInput(f"--workers: expected at least 1, got {workers}; give a number")


def _refuse_what_cannot_be_simulated(runs: Sequence[Point]) -> None:
    """The simulator's own checks, where the parameters are its own."""
    from paperrepro.study.simulated import SimulationConfig

    own = {one.name for one in fields(SimulationConfig)}
    for point in runs:
        SimulationConfig(**{name: v for name, v in point.parameters.items() if name in own})


# Handing out and taking in


def _make(
    job: Job, runs: list[Point], store: Store, workers: int | None, scheduler: str | None,
    wait_s: float, retry_failed: bool, progress: Progress,
) -> Finished:  # fmt: skip
    """Make the points of ``runs`` that ``store`` lacks; Ctrl-C at any time ends it with what is
    done."""
    waiting = [
        point for point in runs
        if not store.is_done(point) and (retry_failed or store.failure(point) is None)
    ]  # fmt: skip
    done = sum(map(store.is_done, runs))
    words = [f"{len(runs)} runs", f"{done} done before", f"{len(waiting)} to do"]
    if failed := len(runs) - done - len(waiting):
        words.append(f"{failed} failed before (--retry-failed makes them anew)")
    progress(", ".join(words))
    if others := store.others(runs):
        progress(
            f"{store.folder}: {others} runs of other parameters, notebooks or versions, unused"
        )
    finished = Finished(runs)
    try:
        if waiting:
            with temporary_files(), cluster(scheduler, workers) as client:
                number = _require_workers(client, job, wait_s, progress)
                progress(f"{number} workers, dashboard {client.dashboard_link}")
                drive(client, job, waiting, store, finished, wait_s, progress)
    except KeyboardInterrupt:
        finished.stopped = "interrupted"
    finished.done = sum(map(store.is_done, runs))
    finished.failed = {p: error for p in runs if (error := store.failure(p)) is not None}
    return finished


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
    """Processes of one thread, those of their libraries too. They talk by TLS with a key of their
    own: whoever reaches a Dask scheduler can run code in its workers."""
    warnings.filterwarnings("ignore", r"(?s)\s*Port .* is already in use")  # another is taken
    with (
        tempfile.TemporaryDirectory(prefix="sweep-dask-") as folder,
        variables(ONE_THREAD),
        LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, host="127.0.0.1",
            dashboard_address=_DASHBOARD, local_directory=folder, silence_logs=logging.CRITICAL,
            security=_security(),
        ) as processes,
        Client(processes) as client,
    ):  # fmt: skip
        client.register_plugin(_NotInterrupted())
        yield client


def _security() -> Security | None:
    """A key for this process and its workers alone."""
    try:
        return Security.temporary()
    except ImportError:
        print("note: cryptography is not installed, so other users of this machine can reach the "
              "workers", file=sys.stderr)  # fmt: skip
        return None


class _NotInterrupted(WorkerPlugin):
    """A terminal sends Ctrl-C and its end to all processes; they are for the sweep alone, which
    ends the rest."""

    def setup(self, worker) -> None:
        for number in (signal.SIGINT, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)


def _require_workers(client: Client, job: Job, wait_s: float, progress: Progress) -> int:
    """How many workers there are, once there is one. Raises `BadInput` where none comes, or one has
    another version."""
    if not client.nthreads():
        progress(f"no worker has joined yet; waiting up to {wait_s:g} s for one")
        try:
            client.wait_for_workers(1, timeout=wait_s)
        except TimeoutError:
            raise BadInput(
                f"--scheduler {client.scheduler.address}: expected workers, none has joined within "
                f"{wait_s:g} s; start them with 'dask worker {client.scheduler.address} "
                "--nthreads 1', or wait longer (--wait)"
            ) from None
    answers = client.run(job.require_version, on_error="return")
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
    client: Client, job: Job, runs: Sequence[Point], store: Store, finished: Finished,
    wait_s: float = WAIT_S, progress: Progress = lambda words: None,
) -> None:  # fmt: skip
    """Make all ``runs`` on the workers of ``client``, into ``store`` and ``finished``.

    Ends early where the scheduler or all its workers are gone. Raises `OtherVersion` where a
    worker, or the code since the start, differs from what was asked for.
    """
    keys = [f"{point.name}-{job.name}" for point in runs]
    futures = client.map(job, [dict(point.parameters) for point in runs], key=keys)
    waiting, counts, seconds = dict(zip(futures, runs, strict=True)), [0, 0], 0.0
    start = looked = seen = time.monotonic()
    ready = as_completed(futures)
    try:
        with _bar(len(runs)) as bar:
            while waiting and not finished.stopped:
                if ready.has_ready():
                    future = next(ready)
                    if future.cancelled():
                        finished.stopped = _GONE
                        break
                    outcome = _take(future, waiting.pop(future), store, finished)
                    counts[bool(outcome is None or outcome.error)] += 1
                    seconds += outcome.seconds if outcome else 0.0
                    words = f"{counts[0]} done, {counts[1]} failed"
                    bar.set_postfix_str(f"{words}, {len(waiting)} left", refresh=False)
                    bar.update()
                    continue
                time.sleep(0.02)
                if time.monotonic() > looked + _LOOK_S:
                    looked = time.monotonic()
                    seen = looked if _has_workers(client) else seen
                    if looked > seen + wait_s:
                        finished.stopped = f"all workers are gone since {wait_s:g} s"
    finally:
        if finished.stopped != _GONE:
            _stop(client, list(waiting), job.name)
    made = sum(counts)
    progress(
        f"{made} runs in {time.monotonic() - start:.1f} s, {seconds / max(made, 1):.1f} s each: "
        f"{counts[0]} done, {counts[1]} failed"
    )


def _has_workers(client: Client) -> bool:
    try:
        return bool(client.nthreads())
    except Exception:  # no answer
        return False


def _bar(total: int) -> tqdm:
    """Its estimate is what is left times the mean time so far; a file gets a line in a minute."""
    how = {"total": total, "smoothing": 0, "bar_format": _BAR, "unit": "run"}
    if sys.stderr.isatty():
        return tqdm(mininterval=0.5, **how)
    return tqdm(mininterval=60, file=SimpleNamespace(write=_write_line, flush=lambda: None), **how)


def _write_line(text: str) -> None:
    if text.strip():
        print(text.strip(), file=sys.stderr, flush=True)


def _take(future: Future, point: Point, store: Store, finished: Finished) -> Outcome | None:
    """Keep what one run left; None where that is nothing."""
    try:
        outcome = future.result()
    except OtherVersion:
        raise
    except Exception as error:
        finished.lost[point] = _in_a_line(error)
        return None
    finally:
        future.release()
    if not outcome.error:
        try:
            store.keep(point, outcome.notebook, outcome.rows)
        except (BadInput, ValueError) as error:
            outcome = replace(outcome, error=str(error))
    if outcome.error:
        store.keep_failure(point, outcome.notebook, outcome.error)
    return outcome


def _in_a_line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:_LONGEST_ERROR]


def _stop(client: Client, futures: list[Future], job: str) -> None:
    """No run is begun any more, none goes on, and no kernel stays behind."""
    with suppress(Exception):
        client.cancel(futures, force=True)
        client.run(stop_kernels, job, on_error="ignore")
