"""Executing notebooks: parameters checked first, results moved whole, failures named."""

import os
import signal
import threading
import time

import nbformat
import pandas as pd
import pytest
from nbformat.v4 import new_code_cell, new_notebook

from paperrepro import cli
from paperrepro.errors import BadInput
from paperrepro.paper import reproduce
from paperrepro.paper.reproduce import NotebookFailed

PARAMETERS = 'seed: int = 1\nfigures_dir: str = ""'
WRITES = """
from pathlib import Path
from paperrepro.study.rows import SurveyKey, frame, write_csv
row = SurveyKey("mount", "quick", 1.0, seed).row("table4", "A", "omega", "deg", {value})
write_csv(frame([row]), Path(figures_dir) / "rows", "{name}")
(Path(figures_dir) / "{name}.txt").write_text(str(seed))
"""


def notebook(folder, name, *cells):
    first = new_code_cell(PARAMETERS, metadata={"tags": ["parameters"]})
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    book = new_notebook(cells=[first, *map(new_code_cell, cells)], metadata=kernel)
    nbformat.write(book, folder / f"{name}.ipynb")


@pytest.fixture
def books(tmp_path, monkeypatch):
    folder = tmp_path / "notebooks"
    folder.mkdir()
    monkeypatch.setattr(reproduce, "NOTEBOOKS", folder)
    for number, value in ((1, 0.5), (2, 0.25)):
        name = f"0{number}_part"
        notebook(folder, name, WRITES.format(name=name, value=value))
    return folder


@pytest.mark.slow
def test_results_are_collected_and_rows_merged(books, tmp_path):
    out = tmp_path / "out"
    lines = []
    reproduce.reproduce(out, {"seed": 7}, progress=lines.append)
    assert [line.split()[-3] for line in lines[1:]] == ["01_part", "02_part"]
    assert (out / "01_part.txt").read_text() == "7"
    assert pd.read_csv(out / "rows.csv").value.tolist() == [0.5, 0.25]
    assert (out / "executed" / "02_part.ipynb").exists()
    assert "figures_dir" in (out / "executed" / "02_part.html").read_text(encoding="utf-8")
    assert not list(out.glob(".unfinished*"))
    # one notebook alone renews its own rows and keeps the others'
    notebook(books, "02_part", WRITES.format(name="02_part", value=0.125))
    reproduce.reproduce(out, {"seed": 7}, only=("02",))
    assert pd.read_csv(out / "rows.csv").value.tolist() == [0.5, 0.125]


@pytest.mark.slow
def test_a_failing_notebook_is_named_and_changes_nothing(books, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "01_part.txt").write_text("earlier")
    notebook(books, "02_part", "raise ValueError('no roof')")
    with pytest.raises(NotebookFailed, match=r"02_part.ipynb, cell .*: ValueError: no roof"):
        reproduce.reproduce(out, {"seed": 7})
    assert (out / "01_part.txt").read_text() == "earlier"
    assert (out / "executed" / "02_part.ipynb").exists()
    assert sorted(p.name for p in out.iterdir()) == ["01_part.txt", "executed"]


@pytest.mark.slow
def test_stopped_it_ends_what_runs_and_changes_nothing(books, tmp_path):
    out, begun = tmp_path / "out", tmp_path / "begun"
    waits = f"import pathlib, time; pathlib.Path({str(begun)!r}).touch(); time.sleep(600)"
    notebook(books, "01_part", waits)
    notebook(books, "03_part", waits)

    def stop():
        while not begun.exists():
            time.sleep(0.1)
        os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
    try:
        threading.Thread(target=stop, daemon=True).start()
        with pytest.raises(KeyboardInterrupt):
            reproduce.reproduce(out, {"seed": 7}, jobs=2)
    finally:
        signal.signal(signal.SIGINT, before)
    assert not out.exists()


def test_unknown_parameters_are_refused_before_anything_runs(books, tmp_path):
    with pytest.raises(BadInput, match=r"no parameter sede; it has .*seed"):
        reproduce.reproduce(tmp_path / "out", {"sede": 7})
    assert not (tmp_path / "out").exists()


def test_the_longest_notebooks_are_begun_first():
    notebooks = sorted(reproduce.NOTEBOOKS.glob("[0-9][0-9]_*.ipynb"))
    order = reproduce.in_order(notebooks)
    assert sorted(order) == notebooks
    begun = tuple(path.name[:2] for path in order)
    assert begun[: len(reproduce.BEGIN_WITH)] == reproduce.BEGIN_WITH
    assert list(begun[len(reproduce.BEGIN_WITH) :]) == sorted(begun[len(reproduce.BEGIN_WITH) :])


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["reproduce", "--profile", "full"], "invalid choice: 'full'"),
        (["reproduce", "--preset", "mounted"], "invalid choice: 'mounted'"),
        (["reproduce", "--noise-scale", "-1"], "noise_scale"),
        (["reproduce", "--only", "99"], "99"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(arguments, named, capsys, tmp_path):
    assert cli.main([*arguments, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert named in error
    assert not (tmp_path / "out").exists()


def test_what_cannot_be_chosen_is_refused_with_what_there_is(books, tmp_path, monkeypatch):
    notebook(books, "00_start", "1")
    with pytest.raises(BadInput, match="--only 00,77: no notebook begins so; there are 01, 02"):
        reproduce.reproduce(tmp_path / "out", {}, only=("00", "77"))
    monkeypatch.setattr(reproduce, "NOTEBOOKS", tmp_path / "site-packages")
    with pytest.raises(BadInput, match="run reproduce in a clone"):
        reproduce.reproduce(tmp_path / "out", {})
    assert not (tmp_path / "out").exists()
