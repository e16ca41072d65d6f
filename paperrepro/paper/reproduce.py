"""Executing the notebooks: every table and figure from one command.

Results are collected in a folder of their own and moved into place when all notebooks have run, so
a run that fails leaves the earlier figures as they were.
"""

import os
import shutil
import tempfile
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

import pandas as pd
from tqdm import tqdm

from paperrepro.errors import BadInput
from paperrepro.study.notebooks import OUTPUT, NotebookFailed, declared, execute, kill_kernels
from paperrepro.study.rows import write_csv

NOTEBOOKS = Path(__file__).resolve().parent.parent / "notebooks"
EXECUTED = "executed"
#: Ending of a notebook that makes no artefact: what a sweep executes for each of its runs.
RUN = "_run"
#: Where several run at a time, these are begun first, in this order: the longest, and such as work
#: on different surveys (01 and 03 on the first mounting, 05 on the second, 10 on the forest), since
#: of two that need the same one would wait for the other.
BEGIN_WITH = ("01", "05", "03", "10", "07", "11")


def reproduce(
    out: Path, parameters: Mapping, only: tuple[str, ...] = (), jobs: int = 1
) -> dict[str, float]:
    """Run the notebooks (those whose names start with one of ``only``, or all) into ``out``.

    ``jobs`` run at a time; what two of them need is computed once, the other waits for it.

    Ctrl-C ends the notebooks that run, and ``out`` is as it was.

    Returns the seconds each took. Raises `BadInput` for a parameter that a notebook lacks, and
    `NotebookFailed`, which names notebook, cell and error.
    """
    notebooks = _chosen(only)
    for notebook in notebooks:
        _require_parameters(notebook, parameters)
    out.mkdir(parents=True, exist_ok=True)
    staging = Path(tempfile.mkdtemp(prefix=".part-", dir=out))
    try:
        seconds = _run_all(notebooks, staging, {**parameters, OUTPUT: str(staging)}, jobs)
        _move_into(staging, out)
        _merge_rows(out)
    except NotebookFailed:
        _move_into(staging / EXECUTED, out / EXECUTED)
        raise
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return seconds


def _chosen(only: tuple[str, ...]) -> list[Path]:
    notebooks = sorted(NOTEBOOKS.glob("[0-9][0-9]_*.ipynb"))
    notebooks = [path for path in notebooks if not path.stem.endswith(RUN)]
    chosen = [path for path in notebooks if not only or path.name.startswith(only)]
    if not chosen:
        raise BadInput(
            f"expected notebooks {', '.join(only) or '01_...'} in {NOTEBOOKS}, found none; "
            "run from a clone of the repository"
        )
    return chosen


def _require_parameters(notebook: Path, parameters: Mapping) -> None:
    """papermill only warns about names it does not know."""
    known = set(declared(notebook)) | {OUTPUT}
    unknown = sorted(set(parameters) - known)
    if unknown:
        raise BadInput(
            f"{notebook.name} has no parameter {', '.join(unknown)}; "
            f"it has {', '.join(sorted(known))}"
        )


def _run_all(
    notebooks: list[Path], staging: Path, parameters: Mapping, jobs: int
) -> dict[str, float]:
    """Seconds that each took; a notebook that fails keeps those that wait from starting."""
    (staging / EXECUTED).mkdir()
    seconds = dict.fromkeys((notebook.stem for notebook in notebooks), 0.0)
    with ThreadPoolExecutor(jobs) as pool, tqdm(total=len(notebooks), unit="notebook") as bar:
        order = in_order(notebooks) if jobs > 1 else notebooks
        futures = {pool.submit(_run, path, staging, parameters): path for path in order}
        try:
            for future in as_completed(futures):
                seconds[futures[future].stem] = future.result()
                bar.set_description(futures[future].stem)
                bar.update()
        except NotebookFailed:
            pool.shutdown(cancel_futures=True)
            raise
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            while not all(future.done() for future in futures):
                kill_kernels()
                time.sleep(0.1)
            raise
    return seconds


def in_order(notebooks: list[Path]) -> list[Path]:
    """Those of `BEGIN_WITH`, then the others by name."""
    rank = {number: place for place, number in enumerate(BEGIN_WITH)}
    return sorted(notebooks, key=lambda path: (rank.get(path.name[:2], len(rank)), path.name))


def _run(notebook: Path, staging: Path, parameters: Mapping) -> float:
    start = time.perf_counter()
    hint = f"; the notebook as far as it ran is in the folder {EXECUTED}"
    execute(notebook, staging / EXECUTED / notebook.name, parameters, hint)
    return time.perf_counter() - start


def _merge_rows(folder: Path) -> None:
    """``rows.csv``: one table of all notebooks' rows, of this run and of earlier ones."""
    parts = [pd.read_csv(path) for path in sorted((folder / "rows").glob("*.csv"))]
    if parts:
        write_csv(pd.concat(parts, ignore_index=True), folder, "rows")


def _move_into(source: Path, target: Path) -> None:
    """Move every file, keeping folders; each replaces its namesake at once."""
    for path in sorted(p for p in source.rglob("*") if p.is_file()):
        place = target / path.relative_to(source)
        place.parent.mkdir(parents=True, exist_ok=True)
        os.replace(path, place)
