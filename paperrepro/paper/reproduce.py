"""Executing the notebooks: every table and figure from one command.

Results appear when all notebooks have run; a run that fails leaves the earlier ones as they were.
"""

import os
import shutil
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

import pandas as pd

from paperrepro._files import written_whole
from paperrepro.errors import BadInput
from paperrepro.study.environment import temporary_files
from paperrepro.study.kernel import kernel_for, stop_kernels
from paperrepro.study.notebooks import (
    OUTPUT,
    NotebookFailed,
    as_page,
    declared,
)
from paperrepro.study.rows import FEW, read_study, write_csv
from paperrepro.study.statistics import TooLittle, median_survey

NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"
#: Rows of the committed study.
STUDY = NOTEBOOKS.parent / "figures" / "study.csv"
EXECUTED = "executed"
#: Notebooks that make no artefact: recipes, and what a sweep executes for each of its runs.
_NO_ARTEFACT = ("00_*.ipynb", "*_run.ipynb")
#: Where several run at a time, these are begun first, in this order: the longest, and such as work
#: on different surveys (01 and 03 on the first mounting, 05 on the second, 10 on the forest), since
#: of two that need the same one would wait for the other.
BEGIN_WITH = ("01", "05", "03", "10", "07", "11")


def median_seed(study: str | Path = STUDY) -> int:
    """The survey that pictures of a single one show, by the committed study: that whose RMSE after
    the calibration by C is the median one; 1 where the study does not say."""
    try:
        return median_survey(read_study(study), FEW["C"], "rmse_reference")
    except TooLittle:
        return 1


def reproduce(
    out: Path, parameters: Mapping, only: tuple[str, ...] = (), jobs: int = 1,
    progress: Callable[[str], None] = lambda words: None,
    finish: Callable[[Path], None] = lambda folder: None,
) -> None:  # fmt: skip
    """Execute the notebooks.

    Parameters
    ----------
    out : Path
        Folder of the results, in it ``executed``: the notebooks as they ran, also as pages (HTML).
        Ctrl-C ends the notebooks that run, and ``out`` is as it was.
    parameters : mapping
        Plain values by name, given to every notebook.
    only : tuple of str
        Notebooks by the start of their names; empty: all.
    jobs : int
        How many run at a time; what two of them need is computed once, the other waits for it.
    progress : callable
        Called with a line for each notebook that has run.
    finish : callable
        Is given the folder as it is going to be and may write into it, a report for example.

    Raises
    ------
    BadInput
        For a parameter that a notebook lacks, and a folder that cannot be written.
    NotebookFailed
        With notebook, cell and error; the notebook as far as it ran is in ``out``.
    """
    notebooks = _chosen(only)
    for notebook in notebooks:
        _require_parameters(notebook, parameters)
    failure = None
    with written_whole(out) as draft, temporary_files():
        try:
            _run_all(notebooks, draft, {**parameters, OUTPUT: str(draft)}, jobs, progress)
        except NotebookFailed as error:
            failure = error
            _keep_executed(draft)
        else:
            _finish(draft, out, finish)
    if failure is not None:
        raise failure


def _finish(draft: Path, out: Path, finish: Callable[[Path], None]) -> None:
    """Add to ``draft`` what is made of all results, of this run and of earlier ones in ``out``."""
    both = draft.parent / "both"
    unseen = shutil.ignore_patterns(".*")
    for folder in (out, draft):
        shutil.copytree(folder.resolve(), both, ignore=unseen, copy_function=_link,
                        dirs_exist_ok=True)  # fmt: skip
    _merge_rows(both)
    finish(both)
    for path in both.rglob("*"):
        if path.is_file() and not path.is_symlink():
            shutil.copy(path, draft / path.relative_to(both))


def _link(source: str, target: str) -> None:
    Path(target).unlink(missing_ok=True)
    os.symlink(source, target)


def _keep_executed(draft: Path) -> None:
    """Of what a run that failed has written, only the notebooks."""
    for path in draft.iterdir():
        if path.is_file():
            path.unlink()
        elif path.name != EXECUTED:
            shutil.rmtree(path)


def _chosen(only: tuple[str, ...]) -> list[Path]:
    there = sorted(NOTEBOOKS.glob("[0-9][0-9]_*.ipynb"))
    there = [path for path in there if not any(map(path.match, _NO_ARTEFACT))]
    chosen = [path for path in there if not only or path.name.startswith(only)]
    if not there:
        raise BadInput(f"{NOTEBOOKS}: no notebooks here; run reproduce in a clone, which has them")
    if not chosen:
        raise BadInput(
            f"--only {','.join(only)}: no notebook begins so; there are "
            f"{', '.join(path.name[:2] for path in there)}"
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
    notebooks: list[Path], draft: Path, parameters: Mapping, jobs: int,
    progress: Callable[[str], None],
) -> None:  # fmt: skip
    """A notebook that fails keeps those that wait from starting."""
    (draft / EXECUTED).mkdir()
    progress(f"notebooks: {len(notebooks)} to execute, {jobs} at a time")
    with ThreadPoolExecutor(jobs) as pool:
        order = in_order(notebooks) if jobs > 1 else notebooks
        futures = {pool.submit(_run, path, draft, parameters): path for path in order}
        try:
            for number, future in enumerate(as_completed(futures), start=1):
                spent, name = future.result(), futures[future].stem
                progress(f"{number:3d} of {len(notebooks)}  {name:24s} {spent:6.1f} s")
        except NotebookFailed:
            pool.shutdown(cancel_futures=True)
            raise
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            while not all(future.done() for future in futures):
                stop_kernels(str(draft))
                time.sleep(0.1)
            raise
        finally:
            stop_kernels(str(draft))


def in_order(notebooks: list[Path]) -> list[Path]:
    """Those of `BEGIN_WITH`, then the others by name."""
    rank = {number: place for place, number in enumerate(BEGIN_WITH)}
    return sorted(notebooks, key=lambda path: (rank.get(path.name[:2], len(rank)), path.name))


def _run(notebook: Path, draft: Path, parameters: Mapping) -> float:
    start = time.perf_counter()
    hint = f"; the notebook as far as it ran is in the folder {EXECUTED}"
    executed = draft / EXECUTED / notebook.name
    kernel_for(str(draft)).execute(notebook, executed, parameters, hint=hint)
    as_page(executed)
    return time.perf_counter() - start


def _merge_rows(folder: Path) -> None:
    """``rows.csv``: one table of all notebooks' rows, of this run and of earlier ones."""
    parts = [pd.read_csv(path) for path in sorted((folder / "rows").glob("*.csv"))]
    if parts:
        write_csv(pd.concat(parts, ignore_index=True), folder, "rows")
