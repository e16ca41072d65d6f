"""Many simulated surveys measured one by one, in processes of their own, into one table of rows.

Each run's rows go to a file of the cache folder as soon as they exist, named by the run and by the
version of the code, so an interrupted study goes on where it stopped. A run that fails is a row of
metric ``failed`` that says in which step, not a gap.
"""

import logging
import multiprocessing
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from pathlib import Path

import joblib
import pandas as pd
from tqdm import tqdm

from paperrepro._cache import cache_folder, code_version
from paperrepro.errors import PaperReproError
from paperrepro.study.environment import ONE_THREAD, variables
from paperrepro.study.rows import COLUMNS, SurveyKey, frame, write_csv
from paperrepro.study.simulated import ARTEFACT, FAILED, Depth, Known, measure
from paperrepro.survey import Survey

SimulateOne = Callable[[SurveyKey], tuple[Survey, Known]]

_log = logging.getLogger(__name__)


def run_seeds(
    simulate_one: SimulateOne,
    runs: Mapping[SurveyKey, Depth],
    workers: int,
    version: str | None = None,
) -> pd.DataFrame:
    """Rows of all ``runs``, in their order, each measured to its depth, by ``workers`` processes.

    ``simulate_one`` is a function of a module, since processes are started anew. ``version`` names
    the code that simulates; by default it is made from the module of ``simulate_one``.
    """
    version = version or code_version(simulate_one.__module__)
    folder = cache_folder() / ARTEFACT / joblib.hash((version, code_version(measure.__module__)))
    folder.mkdir(parents=True, exist_ok=True)
    parts = {run: folder / f"{joblib.hash((run, depth))}.csv" for run, depth in runs.items()}
    waiting = {run: depth for run, depth in runs.items() if not parts[run].exists()}
    lost = dict(_measured(simulate_one, waiting, parts, workers)) if waiting else {}
    tables = [lost[run] if run in lost else pd.read_csv(parts[run]) for run in runs]
    return pd.concat(tables, ignore_index=True) if tables else frame([])


def _measured(
    simulate_one: SimulateOne,
    runs: Mapping[SurveyKey, Depth],
    parts: dict[SurveyKey, Path],
    workers: int,
) -> Iterator[tuple[SurveyKey, pd.DataFrame]]:
    """Measure ``runs`` into their files; yields those that left none."""
    context = multiprocessing.get_context("spawn")
    with (
        variables(ONE_THREAD),
        ProcessPoolExecutor(workers, mp_context=context) as pool,
        tqdm(total=len(runs), unit="survey") as bar,
    ):
        futures = {
            pool.submit(run_one, simulate_one, run, depth, parts[run]): run
            for run, depth in runs.items()
        }
        for future in as_completed(futures):
            bar.update()
            reason = _reason(future)
            if reason is not None:
                _log.warning("%s: %s", futures[future], reason)
            if reason is not None and not parts[futures[future]].exists():
                yield futures[future], frame([failure(futures[future])])


def run_one(simulate_one: SimulateOne, run: SurveyKey, depth: Depth, part: Path) -> str | None:
    """Simulate and measure one survey into the file ``part``; returns why it failed, or None.

    An error that this package raises on purpose would come again, so it is kept too.
    """
    reason = None
    try:
        rows = measure(*simulate_one(run), run, depth=depth)
    except PaperReproError as error:
        rows, reason = [failure(run)], f"{type(error).__name__}: {error}"
    write_csv(frame(rows), part.parent, part.stem)
    return reason


def failure(run: SurveyKey) -> dict:
    """The row of a survey that could not be measured at all."""
    return run.row(ARTEFACT, "all", FAILED, "1", 1)


def read_study(*paths: str | Path) -> pd.DataFrame:
    """Rows of studies and sweeps that were written before; none where a path is no file. What
    several have of a survey is taken from the first."""
    found = [pd.read_csv(path)[list(COLUMNS)] for path in paths if Path(path).is_file()]
    if not found:
        return frame([])
    rows = pd.concat(found, ignore_index=True)
    rows = rows.astype({"noise_scale": float, "value": float, "sigma": float})
    return rows.drop_duplicates(list(COLUMNS[:-3]), ignore_index=True)


def _reason(future: Future) -> str | None:
    """What ended a run: its own error, or that of a process which died."""
    error = future.exception()
    return future.result() if error is None else f"{type(error).__name__}: {error}"
