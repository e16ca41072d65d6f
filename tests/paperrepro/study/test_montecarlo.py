"""Many surveys in processes of their own: nothing is lost, nothing is measured twice."""

import os

import numpy as np
import pandas as pd
import pytest

from data_synth.evaluation import judge_views, true_planes
from paperrepro.cli import main
from paperrepro.errors import TooFewPlanes
from paperrepro.method.adjustment.quality import TrueNoise
from paperrepro.method.adjustment.trajectory_errors import specified_process
from paperrepro.paper import claims
from paperrepro.study import montecarlo, statistics
from paperrepro.study.montecarlo import run_one, run_seeds
from paperrepro.study.rows import (
    COLUMNS,
    SurveyKey,
    frame,
    read_study,
    write_csv,
)
from paperrepro.study.simulated import ANGLES_ONLY, FAILED, Depth, Known, measure, with_wrong_match

RUNS = {SurveyKey("mount", "quick", 1.0, seed): Depth() for seed in (1, 2)}
ONE = next(iter(RUNS))


def refused(run):
    """Fails on purpose; leaves a trace of having been asked."""
    _trace(run)
    raise TooFewPlanes("expected roofs, got none")


def broken(run):
    _trace(run)
    raise RuntimeError("not on purpose")


def ended(run):
    os._exit(1)


def _trace(run):
    with open(os.path.join(os.environ["PAPERREPRO_CACHE"], "asked"), "a") as file:
        file.write(f"{run.seed} {os.environ['NUMBA_NUM_THREADS']}\n")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("PAPERREPRO_CACHE", str(tmp_path))
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    return tmp_path


@pytest.mark.parametrize("simulate", [refused, broken, ended])
def test_a_survey_that_fails_is_a_row(cache, simulate):
    rows = run_seeds(simulate, RUNS, 1, version="1")
    assert list(rows.columns) == list(COLUMNS)
    assert rows.seed.tolist() == [1, 2]
    assert set(rows.metric) == {FAILED}


@pytest.mark.parametrize(("simulate", "times"), [(refused, 1), (broken, 2)])
def test_only_what_fails_on_purpose_is_not_asked_again(cache, simulate, times):
    for _ in range(2):
        run_seeds(simulate, {ONE: Depth()}, 1, version="1")
    asked = (cache / "asked").read_text().splitlines()
    assert asked == ["1 1"] * times  # with one thread each
    assert "NUMBA_NUM_THREADS" not in os.environ


def test_another_depth_is_measured_anew(cache):
    for depth in (Depth(), ANGLES_ONLY):
        run_seeds(refused, {ONE: depth}, 1, version="1")
    assert len((cache / "asked").read_text().splitlines()) == 2


def test_another_version_of_the_code_measures_anew(cache):
    for version in ("1", "2"):
        run_seeds(refused, {ONE: Depth()}, 1, version=version)
    assert len((cache / "asked").read_text().splitlines()) == 2


def test_rows_go_to_the_file_of_their_run(tmp_path, monkeypatch):
    monkeypatch.setattr(
        montecarlo,
        "measure",
        lambda survey, known, run, depth: [run.row("study", "B", "x", "m", survey)],
    )
    assert run_one(lambda run: (2.5, None), ONE, Depth(), tmp_path / "part.csv") is None
    assert read_study(tmp_path / "part.csv").value.tolist() == [2.5]
    assert [path.name for path in tmp_path.iterdir()] == ["part.csv"]


def test_a_study_is_read_as_it_was_written(tmp_path):
    rows = frame([ONE.row("study", "B", "error_phi", "deg", 0.1 + 0.2, 1e-17)])
    write_csv(rows, tmp_path, "study")
    pd.testing.assert_frame_equal(read_study(tmp_path / "study.csv"), rows)
    assert read_study(tmp_path / "none.csv").empty


def test_a_sweep_adds_the_surveys_that_a_study_lacks(tmp_path):
    other = SurveyKey("mount", "quick", 4.0, 1)
    study = frame([ONE.row("study", "B", "error_phi", "deg", 1.0)])
    sweep = frame([run.row("study", "B", "error_phi", "deg", 2.0) for run in (ONE, other)])
    for name, rows in {"study": study, "sweep": sweep}.items():
        write_csv(rows, tmp_path, name)
    both = read_study(tmp_path / "study.csv", tmp_path / "sweep.csv", tmp_path / "none.csv")
    assert both[["noise_scale", "value"]].to_numpy().tolist() == [[1.0, 1.0], [4.0, 2.0]]


@pytest.mark.parametrize(
    ("options", "words"), [(["--preset", "mount,none"], "'none'"), (["--seeds", "0"], "got 0")]
)
def test_a_study_of_what_cannot_be_simulated_is_refused_before_it_starts(
    cache, capsys, options, words
):
    assert main(["study", *options, "--out", str(cache / "study.csv")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
    assert not list(cache.iterdir())


def test_one_face_is_matched_to_a_plane_alike_but_not_its_own(flown):
    tie_planes, labels = flown.found.tie_planes, flown.views.label
    wrong = with_wrong_match(tie_planes, flown.found.mounting)
    assert wrong.n_planes == tie_planes.n_planes
    assert len(wrong.rays) == len(tie_planes.rays)
    views = np.bincount(wrong.plane) - np.bincount(tie_planes.plane)
    assert sorted(views)[0] == -1
    assert sorted(views)[-1] == 1
    assert np.abs(views).sum() == 2
    assert (wrong.plane[wrong.pairs[:, 0]] == wrong.plane[wrong.pairs[:, 1]]).all()
    assert len(labels) == len(wrong.ranges)


@pytest.mark.slow
def test_one_survey_measured_has_all_that_the_ledger_asks_for(flown, monkeypatch):
    """With a single survey allowed, no claim lacks a quantity but those on several noise scales."""

    def judge(views):
        label = judge_views(flown.survey, flown.truth, views).label
        return label, true_planes(flown.truth, label)

    noise = TrueNoise(specified_process(flown.survey.navigation), 0.015)
    known = Known(flown.truth.mounting, judge, noise, 16)
    rows = frame(measure(flown.survey, known, ONE, depth=Depth(mistaken=(0.5, 2.0))))
    assert not rows.duplicated(["scenario", "metric"]).any()
    assert np.isfinite(rows.value).all()
    monkeypatch.setattr(statistics, "LEAST_SEEDS", 1)
    ledger = claims.ledger(rows)
    assert not ledger.condition.str.contains("no row of").any()
    density = rows[rows.metric == "density"].value.item()
    assert density == pytest.approx(200, rel=0.15)  # 300 000 /s on a swath of 104 m at 4.5 m/s
