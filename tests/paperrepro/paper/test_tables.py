"""Rows and the tables read from them."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import paperrepro
from paperrepro.method.adjustment.scenarios import calibrate
from paperrepro.method.roofs import RoofParameters
from paperrepro.paper.published import TABLE2, TABLE4, TABLE5
from paperrepro.paper.tables import calibration_rows, markdown_summary, table2, table4, table5
from paperrepro.study.rows import COLUMNS, SurveyKey, frame, write_csv
from paperrepro.study.statistics import LEAST_SEEDS
from tests.paperrepro.labelled import matched_faces, survey_of

RUN = SurveyKey("mount", "quick", 1.0, 7)


@pytest.fixture(scope="module")
def rows():
    tie_planes, truth, _ = matched_faces()
    results = {name: calibrate(survey_of(), tie_planes, name) for name in ("SL 3", "SL", "A")}
    return frame(calibration_rows(RUN, results, truth.boresight + np.deg2rad([0.1, 0.2, 0.3])))


def test_rows_are_tidy(rows):
    assert tuple(rows.columns) == COLUMNS
    assert set(rows.preset) == {"mount"}
    assert set(rows.seed) == {7}
    assert not rows[["artefact", "scenario", "metric", "unit", "value"]].isna().any().any()


def test_table4_sets_paper_truth_estimate_and_error_side_by_side(rows):
    table = table4(rows).set_index(["scenario", "angle"])
    line = table.loc["A", "phi"]
    assert line.paper_deg == TABLE4["A", "phi"].value
    assert line.paper_sigma_deg == TABLE4["A", "phi"].sigma
    assert line.truth_deg == pytest.approx(-0.8 + 0.2)
    assert line.estimate_deg == pytest.approx(-0.8)
    assert line.error_deg == pytest.approx(-0.2)
    assert line.error_in_sigma == pytest.approx(line.error_deg / line.sigma_deg)
    assert np.isnan(table.loc["SL", "phi"].paper_deg)  # the paper prints no row for [11] alone
    assert table.loc["SL", "phi"].all_sigma_deg < table.loc["SL", "phi"].sigma_deg
    assert np.isnan(line.all_sigma_deg)  # not calibrated by "A all"


def test_table5_has_our_value_beside_the_proposed_one():
    left = pd.DataFrame({"mean_left": [0.2, 0.3]}, index=["SL", "B"])
    table = table5(left, frame([])).set_index("method")
    assert table.paper.tolist() == [TABLE5["SL"].value, TABLE5["proposed"].value]
    assert table.mean_left["B (proposed)"] == 0.3
    assert table.surveys_mean.isna().all()
    rows = [
        SurveyKey("mount", "quick", 1.0, seed).row("study", name, "mae_reference", "m", value)
        for seed in range(1, LEAST_SEEDS + 1)
        for name, value in {"before": 1.0, "SL 3": 0.1, "B 3": 0.01 * seed}.items()
    ]
    table = table5(left, frame(rows)).set_index("method")
    assert table.surveys_mean["SL"] == pytest.approx(0.1)
    assert table.surveys_high["B (proposed)"] > table.surveys_low["B (proposed)"] > 0


def test_csv_is_written_whole_and_read_back(tmp_path, rows):
    path = write_csv(rows, tmp_path / "deep", "rows")
    back = pd.read_csv(path)
    np.testing.assert_allclose(back.value, rows.value, rtol=1e-9)
    assert [p.name for p in path.parent.iterdir()] == ["rows.csv"]


def test_an_empty_folder_writes_nothing(tmp_path, rows, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert write_csv(rows, "", "rows") is None
    assert not list(tmp_path.iterdir())


def test_table_2_shows_every_printed_value_beside_the_one_used():
    table = table2(RoofParameters(), RoofParameters().coarse()).set_index("parameter")
    assert set(TABLE2) <= set(table.index)
    for name, value in TABLE2.items():
        assert float(table.paper[name]) == value.value
        assert table.paper[name] == table.fine[name] or table.reading[name]


def test_the_readme_has_the_verdicts_of_the_ledger():
    root = Path(paperrepro.__file__).parents[1]
    ledger = pd.read_csv(root / "figures" / "claims.csv")
    assert markdown_summary(ledger).strip() in (root / "README.md").read_text("utf-8")
