"""The folder of a sweep or study: what is done, what failed, and all rows together.

A run is done when its row file is there; it and the executed notebook are written whole or not at
all. A run that failed leaves a note instead, with the notebook as far as it ran.
"""

import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import pandas as pd
from filelock import FileLock, Timeout

from paperrepro._files import write_text
from paperrepro.errors import BadInput
from paperrepro.study.grid import Point
from paperrepro.study.rows import ARTEFACT, COLUMNS, FAILED, SurveyKey, frame, write_csv

RUNS, ROWS, FAILURES, ABOUT = "runs", "sweep", "failed", "sweep.json"


class Store:
    """Files of the runs below ``folder``, which is made; one process at a time has it."""

    def __init__(self, folder: Path):
        self.folder = Path(folder)
        self._runs = self.folder / RUNS
        self._lock = FileLock(self.folder / ".lock")

    def __enter__(self) -> "Store":
        try:
            self._runs.mkdir(parents=True, exist_ok=True)
            self._lock.acquire(timeout=0)
        except Timeout:
            raise BadInput(
                f"{self.folder}: another sweep or study is writing here; wait for it or choose "
                "another --out"
            ) from None
        except OSError as error:
            raise BadInput(
                f"{self.folder}: cannot be written ({error.strerror}); choose another --out"
            ) from None
        for part in self._runs.glob("*.part"):
            part.unlink()
        return self

    def __exit__(self, *_) -> None:
        self._lock.release()

    def is_done(self, point: Point) -> bool:
        return self._path(point, "csv").exists()

    def failure(self, point: Point) -> str | None:
        """The last line of the error that a run ended with, where it has failed."""
        note = self._path(point, "failed.json")
        if self.is_done(point) or not note.exists():
            return None
        return json.loads(note.read_text(encoding="utf-8"))["error"]

    def keep(self, point: Point, notebook: str, rows: str) -> None:
        """Write a finished run; its rows come last, for they say that it is done. An empty
        ``notebook`` is none.

        Raises `BadInput` for ``rows`` that are not tidy.
        """
        table = _tidy(rows)
        if notebook:
            write_text(self._path(point, "ipynb"), notebook)
        write_csv(table, self._runs, point.name)
        self._path(point, "failed.json").unlink(missing_ok=True)

    def keep_failure(self, point: Point, notebook: str, error: str) -> None:
        """Write down that and how a run has failed."""
        if notebook:
            write_text(self._path(point, "ipynb"), notebook)
        note = {"error": error, "parameters": dict(point.parameters)}
        write_text(self._path(point, "failed.json"), json.dumps(note, indent=1) + "\n")

    def others(self, points: Iterable[Point]) -> int:
        """How many finished runs lie here that are none of ``points``: other parameters, notebook
        or versions."""
        return len({path.stem for path in self._runs.glob("*.csv")} - {p.name for p in points})

    def collate(self, points: Sequence[Point], varied: Sequence[str] = ()) -> pd.DataFrame:
        """Rows of all ``points`` in their order. A run that failed is a row of metric ``failed``;
        ``varied`` parameters that rows do not know become columns of their own."""
        extra = [name for name in varied if name not in COLUMNS]
        tables = [self._rows(point, extra) for point in points]
        tables = [table for table in tables if len(table)]
        empty = frame([]).reindex(columns=[*COLUMNS, *extra])
        return pd.concat(tables, ignore_index=True) if tables else empty

    def write(self, rows: pd.DataFrame, failed: Mapping[Point, str], about: dict) -> None:
        """``sweep.csv``, ``failed.csv`` if there is a failure, and what the sweep was."""
        write_csv(rows, self.folder, ROWS)
        if failed:
            lines = [{**point.parameters, "error": error} for point, error in failed.items()]
            write_csv(pd.DataFrame(lines), self.folder, FAILURES)
        else:
            (self.folder / f"{FAILURES}.csv").unlink(missing_ok=True)
        write_text(self.folder / ABOUT, json.dumps(about, indent=1) + "\n")

    def _rows(self, point: Point, extra: Sequence[str]) -> pd.DataFrame:
        if self.is_done(point):
            rows = pd.read_csv(self._path(point, "csv"), dtype={"scenario": str})
        else:
            rows = _failed_row(point) if self.failure(point) is not None else frame([])
        return rows.assign(**{name: point.parameters[name] for name in extra})

    def _path(self, point: Point, ending: str) -> Path:
        return self._runs / f"{point.name}.{ending}"


def _tidy(rows: str) -> pd.DataFrame:
    table = pd.read_csv(io.StringIO(rows))
    if lacking := [name for name in COLUMNS if name not in table]:
        raise BadInput(
            f"rows: expected the columns {', '.join(COLUMNS)}, none is named {', '.join(lacking)}"
        )
    if table.empty:
        raise BadInput("rows: expected at least one, got none")
    return table[list(COLUMNS)]


def _failed_row(point: Point) -> pd.DataFrame:
    """The row of a survey that could not be measured; none where the run is of no survey."""
    names = SurveyKey.__dataclass_fields__
    if not set(names) <= set(point.parameters):
        return frame([])
    key = SurveyKey(**{name: point.parameters[name] for name in names})
    return frame([key.row(ARTEFACT, "all", FAILED, "1", 1)])
