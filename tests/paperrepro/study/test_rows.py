"""Rows are read as they were written; of several files the first counts."""

import pandas as pd
import pytest

from paperrepro.errors import BadInput
from paperrepro.study.rows import SurveyKey, frame, read_study, require_declared, write_csv

ONE = SurveyKey("mount", "quick", 1.0, 1)


def test_a_study_is_read_as_it_was_written(tmp_path):
    rows = frame([ONE.row("study", "B", "error_phi", "deg", 0.1 + 0.2, 1e-17)])
    write_csv(rows, tmp_path, "study")
    pd.testing.assert_frame_equal(read_study(tmp_path / "study.csv"), rows)
    assert read_study(tmp_path / "none.csv").empty


def test_a_sweep_adds_the_surveys_that_a_study_lacks(tmp_path):
    other = SurveyKey("mount", "quick", 4.0, 1)
    study = frame([ONE.row("study", "B", "error_phi", "deg", 1.0)])
    sweep = frame([key.row("study", "B", "error_phi", "deg", 2.0) for key in (ONE, other)])
    for name, rows in {"study": study, "sweep": sweep}.items():
        write_csv(rows, tmp_path, name)
    both = read_study(tmp_path / "study.csv", tmp_path / "sweep.csv", tmp_path / "none.csv")
    assert both[["noise_scale", "value"]].to_numpy().tolist() == [[1.0, 1.0], [4.0, 2.0]]


@pytest.mark.parametrize("text", ["seed = 2", 'seed = 3\nnoise_scale = float("inf")'])
def test_parameters_that_a_notebook_declares_are_taken(text):
    declared = {"seed": int, "noise_scale": float}
    require_declared({"__annotations__": declared, "In": ["", f"# Parameters\n{text}\n"]})
    require_declared({"__annotations__": declared, "In": ["", "nose_scale = 1"]})
    require_declared({"__annotations__": declared})


def test_a_parameter_that_a_notebook_does_not_declare_is_refused():
    names = {"__annotations__": {"seed": int}, "In": ["", "x = 1", "# Parameters\nsed = 2\n"]}
    with pytest.raises(BadInput, match="sed: no parameter of this notebook; it has seed"):
        require_declared(names)
