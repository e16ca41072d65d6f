"""Sweeps: what is asked is checked first, what is done is kept, versions do not mix."""

import json
import tempfile

import nbformat
import pandas as pd
import pytest

from paperrepro.cli import main
from paperrepro.errors import BadInput
from paperrepro.study.grid import Fingerprint, points, read_grid
from paperrepro.study.jobs import NotebookJob, OtherVersion
from paperrepro.study.notebooks import declared, without_outputs
from paperrepro.study.rows import COLUMNS
from paperrepro.study.store import Store
from tests.paperrepro.study.sweeping import (
    MEASURES,
    METRICS,
    arguments,
    begun,
    expected_keys,
    kernels,
    keys_of,
    rows_of,
    write_notebook,
)


@pytest.fixture
def notebook(tmp_path):
    return write_notebook(tmp_path / "standin.ipynb")


@pytest.fixture
def known(notebook):
    return declared(notebook)


# The grid


def test_values_get_the_types_that_the_notebook_declares(known):
    grid = read_grid(["noise_scale=0,0.5,0.5", "preset=mount,table4", "again=true"], known, 3)
    assert grid == {
        "noise_scale": [0.0, 0.5], "preset": ["mount", "table4"], "again": [True],
        "seed": [1, 2, 3],
    }  # fmt: skip
    assert type(grid["noise_scale"][0]) is float
    assert known["lasts_s"].default == 0.0


@pytest.mark.parametrize(
    ("texts", "seeds", "words"),
    [
        (["noise=1"], None, "no parameter 'noise' to vary"),
        (["figures_dir=/tmp"], None, "no parameter 'figures_dir' to vary"),
        (["noise_scale=1,much"], None, "expected float, got 'much'"),
        (["noise_scale=nan"], None, "expected float, got 'nan'"),
        (["seed=1.5"], None, "expected int, got '1.5'"),
        (["again=perhaps"], None, "expected bool, got 'perhaps'"),
        (["noise_scale"], None, "expected float, got ''"),
        (["preset=mount,"], None, "expected str, got ''"),
        (["seed=1"], 2, "give one of them"),
        (["seed=1", "seed=2"], None, "given twice"),
        ([], 0, "at least 1"),
    ],
)
def test_what_the_notebook_does_not_know_is_refused_with_what_it_has(known, texts, seeds, words):
    with pytest.raises(BadInput, match=words) as error:
        read_grid(texts, known, seeds)
    if "parameter" in words or "expected" in words.split("got")[0][:8]:
        assert "noise_scale: float = 1.0" in str(error.value)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--grid", "nois=1"], "no parameter 'nois'"),
        (["--grid", "preset=none"], "'none'"),
        (["--grid", "preset=mount,table4", "--grid", "seed=-1"], "give one of them"),
        (["--workers", "0"], "at least 1"),
        (["--workers", "2", "--scheduler", "tcp://127.0.0.1:1"], "one of them"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(notebook, tmp_path, capsys, more, words):
    assert main(arguments(notebook, tmp_path / "out", *more)) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
    assert not (tmp_path / "out").exists()


def test_the_notebook_has_to_be_one(tmp_path, capsys):
    assert main(arguments(tmp_path / "none.ipynb", tmp_path / "out")) == 2
    (tmp_path / "text.ipynb").write_text("no notebook")
    assert main(arguments(tmp_path / "text.ipynb", tmp_path / "out")) == 2
    assert main(arguments(write_notebook(tmp_path / "x.ipynb", parameters="a = [1]"), "out")) == 2
    assert len(capsys.readouterr().err.splitlines()) == 3


def test_the_seed_changes_last(known):
    fingerprint = Fingerprint("notebook", "code", ())
    runs = points({"noise_scale": [0.0, 2.0], "seed": [1, 2]}, known, fingerprint)
    assert [(p.parameters["seed"], p.parameters["noise_scale"]) for p in runs] == [
        (1, 0.0), (1, 2.0), (2, 0.0), (2, 2.0),
    ]  # fmt: skip
    assert len({p.name for p in runs}) == 4
    assert runs[0].name.startswith("preset-mount_profile-quick_seed-1_noise_scale-0.0_")
    assert "figures_dir" not in runs[0].parameters


def test_a_run_is_the_same_however_it_is_asked_for(known):
    fingerprint = Fingerprint("notebook", "code", ())
    (short,) = points({"seed": [1]}, known, fingerprint)
    (long,) = points({"noise_scale": [1.0], "preset": ["mount"]}, known, fingerprint)
    assert short.name == long.name
    (other,) = points({"seed": [1]}, known, Fingerprint("notebook", "changed", ()))
    assert short.name != other.name


# The fingerprint


def test_code_makes_another_fingerprint_and_prose_does_not(tmp_path):
    def of(**changes):
        return Fingerprint.of_notebook(write_notebook(tmp_path / "n.ipynb", **changes).read_text())

    assert of() == of(about="Other words")
    assert of().differs_in(of(source=MEASURES + "x = 1")) == "notebook"
    other = of(source=MEASURES + "\n%pip list\nfrom paperrepro.frames import rotation_zyx")
    assert of().differs_in(other) == "notebook, code"


def test_a_worker_of_another_version_is_refused_by_name(notebook):
    text = notebook.read_text()
    asked = Fingerprint.of_notebook(text)
    NotebookJob(asked, text).require_version()
    versions = {**dict(asked.packages), "numpy": "1.0"}
    other = NotebookJob(Fingerprint(asked.notebook, asked.code, tuple(versions.items())), text)
    with pytest.raises(OtherVersion, match=r"numpy .* instead of 1.0; install"):
        other.require_version()


def test_what_a_notebook_has_shown_does_not_travel(notebook):
    book = nbformat.read(notebook, 4)
    book.cells[2].outputs = [nbformat.v4.new_output("stream", text="shown before")]
    nbformat.write(book, notebook)
    assert "shown before" not in without_outputs(notebook)
    of = Fingerprint.of_notebook
    assert of(without_outputs(notebook)) == of(notebook.read_text())


# The store


def test_only_tidy_rows_are_kept_and_only_whole(tmp_path, known):
    (point,) = points({"seed": [1]}, known, Fingerprint("notebook", "code", ()))
    with Store(tmp_path) as store:
        with pytest.raises(BadInput, match="none is named artefact"):
            store.keep(point, "{}", "a,b\n1,2\n")
        with pytest.raises(BadInput, match="at least one"):
            store.keep(point, "{}", ",".join(COLUMNS) + "\n")
        assert not list((tmp_path / "runs").iterdir())
        with pytest.raises(BadInput, match="another sweep"), Store(tmp_path):
            pass


# Whole sweeps, on workers of their own


@pytest.mark.slow
def test_a_sweep_is_made_once_and_goes_on_where_something_is_missing(notebook, tmp_path, capsys):
    out, log = tmp_path / "out", tmp_path / "log"
    sweep = arguments(notebook, out, "--grid", f"log={log}", "--workers", "1", noise="0,1,101")
    assert main(sweep) == 1
    told = capsys.readouterr()
    assert "dashboard http://127.0.0.1:" in told.out
    failures = [line for line in told.err.splitlines() if line.startswith("failed:")]
    assert len(failures) == 2
    assert "noise_scale=101.0" in failures[0]
    assert "ValueError: noise so large that nothing matches" in failures[0]

    rows = rows_of(out)
    measured = rows[rows.metric != "failed"]
    assert keys_of(measured) == expected_keys((0, 1), 2)
    assert rows[rows.metric == "failed"].noise_scale.tolist() == [101.0, 101.0]
    assert measured[measured.metric == "one"].value.tolist() == pytest.approx([1, 8 / 7, 2, 15 / 7])
    # each run finds an empty namespace although the kernel was used before, and has one thread
    assert set(measured[measured.metric == "left"].value) == {0.0}
    assert set(measured[measured.metric == "threads"].value) == {1.0}
    assert len(set(kernels(log))) < len(kernels(log)) == 6
    assert len(list((out / "runs").glob("*.ipynb"))) == 6
    failed = pd.read_csv(out / "failed.csv")
    assert failed.noise_scale.tolist() == [101.0, 101.0]

    # nothing is missing: nothing is done, the failures are told again
    assert main(sweep) == 1
    assert len(begun(log)) == 6
    assert "2 failed before" in capsys.readouterr().out
    # two are missing, one of them half-written
    lost = sorted((out / "runs").glob("*noise_scale-0.0*.csv"))
    lost[0].rename(lost[0].with_suffix(".csv.part"))
    lost[1].unlink()
    before = rows
    assert main(sweep) == 1
    assert sorted(begun(log)[6:]) == [(0.0, 1.0), (0.0, 2.0)]
    pd.testing.assert_frame_equal(rows_of(out), before)
    assert not list((out / "runs").glob("*.part"))
    # failures are made again when asked for
    assert main([*sweep, "--retry-failed"]) == 1
    assert sorted(begun(log)[8:]) == [(101.0, 1.0), (101.0, 2.0)]


@pytest.mark.slow
def test_a_changed_notebook_does_not_mix_with_old_rows(notebook, tmp_path, capsys):
    out = tmp_path / "out"
    sweep = arguments(notebook, out, "--workers", "1", noise="1", seeds=1)
    assert main(sweep) == 0
    assert "failed" not in capsys.readouterr().err.replace("0 failed", "")
    write_notebook(notebook, MEASURES.replace("seed * noise_scale", "-1.0"))
    assert main(sweep) == 0
    assert "1 runs of other parameters" in capsys.readouterr().out
    rows = rows_of(out)
    assert len(rows) == METRICS
    assert rows[rows.metric == "two"].value.tolist() == [-1.0]
    about = json.loads((out / "sweep.json").read_text())
    assert about["packages"]["numpy"]
    made_by = {
        nbformat.read(path, 4).metadata.paperrepro.fingerprint
        for path in (out / "runs").glob("*.ipynb")
    }
    assert about["fingerprint"] in made_by
    assert len(made_by) == 2


@pytest.mark.slow
def test_a_parameter_that_rows_do_not_name_is_a_column(tmp_path):
    out = tmp_path / "out"
    notebook = write_notebook(tmp_path / "long.ipynb", about="Half a megabyte " * 32_000)
    sweep = arguments(notebook, out, "--grid", "again=false,true", "--workers", "1", noise="1")
    assert main(sweep) == 0
    rows = rows_of(out)
    assert not rows.duplicated().any()
    assert rows.groupby("again").size().tolist() == [2 * METRICS] * 2


@pytest.mark.slow
def test_kernels_are_reached_where_the_folder_of_temporary_files_has_a_long_name(
    notebook, tmp_path, monkeypatch
):
    """A socket's name has at most 107 bytes."""
    long = tmp_path / ("long" * 30)
    long.mkdir()
    monkeypatch.setenv("TMPDIR", str(long))
    monkeypatch.setattr(tempfile, "tempdir", None)
    assert main(arguments(notebook, tmp_path / "out", "--workers", "1", noise="1", seeds=1)) == 0
