"""Curves against noise: what they are computed from, and what is drawn of it."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from paperrepro import figures
from paperrepro.figures import study
from paperrepro.frames import ANGLES
from paperrepro.study.rows import ARTEFACT, FAILED, SurveyKey, frame
from paperrepro.study.statistics import binomial, survey_table

NOISES, SEEDS = (0.0, 1.0, 4.0), (1, 2, 3, 4)
#: Error of an angle in its sigmas, and its sigma a unit of noise (deg): A's are beyond 1.96 in two
#: of four surveys, and A is better than SL in the same two.
LEVELS = {"SL": 0.03, "A": 0.02, "D": 0.01}


@pytest.fixture(autouse=True)
def _style():
    with plt.rc_context():
        plt.switch_backend("agg")
        figures.use_style()
        yield
        plt.close("all")


def error_of(name, noise, seed):
    spread = 2.0 if name == "A" and seed > 2 else 1.0
    return LEVELS[name] * spread * (0.1 + noise)


def rows_of(scenarios=tuple(LEVELS), preset="mount"):
    rows = []
    for noise in NOISES:
        for seed in SEEDS:
            run = SurveyKey(preset, "quick", noise, seed)
            for name in scenarios:
                error = error_of(name, noise, seed)
                sigma = 0.9 * LEVELS[name] * (0.1 + noise)
                rows += [
                    run.row(ARTEFACT, name, f"error_{a}", "deg", -error, sigma) for a in ANGLES
                ]
            for name in (*scenarios, "truth"):
                rows.append(run.row(ARTEFACT, name, "offset_mean_reference", "m", 0.05 + noise))
                rows.append(run.row(ARTEFACT, name, "offset_mean_truth", "m", 0.01 * seed))
    return frame(rows)


def curve(table, scenario, quantity):
    rows = table[(table.scenario == scenario) & (table.quantity == quantity)]
    return rows.set_index("noise_scale")


def test_each_survey_says_error_sigma_coverage_offset_and_who_is_better():
    surveys = survey_table(rows_of()).set_index(["noise_scale", "seed", "scenario"])
    assert len(surveys) == len(NOISES) * len(SEEDS) * 4
    one = surveys.loc[(1.0, 3, "A")]
    assert one.error_deg == pytest.approx(np.sqrt(3) * error_of("A", 1.0, 3))
    assert one.sigma_deg == pytest.approx(np.sqrt(3) * 0.9 * 0.02 * 1.1)
    assert one.held == 0.0  # 2 / 0.9 sigmas away
    assert surveys.loc[(1.0, 2, "A")].held == 1.0
    assert one.beats_sl == 0.0
    assert surveys.loc[(1.0, 2, "A")].beats_sl == 1.0
    assert (surveys.xs("D", level="scenario").beats_sl == 1.0).all()
    assert surveys.xs("SL", level="scenario").beats_sl.isna().all()
    assert one.offset_truth == pytest.approx(0.03)
    truth = surveys.loc[(0.0, 1, "truth")]
    assert truth.offset_reference == pytest.approx(0.05)
    assert truth[["error_deg", "held", "beats_sl"]].isna().all()


def test_shares_have_exact_intervals_and_means_resampled_ones():
    table = study.errors(survey_table(rows_of()))[1]
    held = curve(table, "A", "held").loc[4.0]
    exact = binomial(2, len(SEEDS))
    assert (held.value, held.low, held.high) == (0.5, exact.low, exact.high)
    error = curve(table, "A", "error_deg").loc[4.0]
    assert error.value == pytest.approx(1.5 * np.sqrt(3) * 0.02 * 4.1)
    assert error.low < error.value < error.high
    assert (table.surveys == len(SEEDS)).all()
    beaten = study.beaten(survey_table(rows_of()))[1]
    assert set(beaten.scenario) == {"A", "D"}
    assert curve(beaten, "A", "beats_sl").value.tolist() == [0.5] * 3
    assert curve(beaten, "D", "beats_sl").value.tolist() == [1.0] * 3


def test_a_survey_without_sl_beats_nobody():
    rows = rows_of()
    lost = (rows.scenario == "SL") & (rows.seed == 1) & (rows.noise_scale == 1.0)
    table = study.beaten(survey_table(rows[~lost]))[1]
    assert curve(table, "A", "beats_sl").surveys.tolist() == [4, 3, 4]
    assert curve(table, "A", "beats_sl").value[1.0] == pytest.approx(1 / 3)
    names = [name for name, figure, data in study.pictures(rows_of(("D",)))]
    assert names == ["noise_errors", "noise_offsets"]


def test_settings_are_not_averaged_with_one_another():
    rows = pd.concat([rows_of(), rows_of(preset="table4")])
    figure, table = study.errors(survey_table(rows))
    assert set(table.surveys) == {len(SEEDS)}
    assert len(figure.axes) == 6
    assert figure.axes[0].get_title(loc="left") == "(a) error: mount, quick"
    varied = pd.concat([rows_of().assign(scene=scene) for scene in ("farm", "forest")])
    table = study.offsets(survey_table(varied))[1]
    assert set(table.surveys) == {len(SEEDS)}
    assert set(table.scene) == {"farm", "forest"}


def test_a_line_with_bars_for_each_scenario_in_its_colour():
    surveys = survey_table(rows_of())
    figure, table = study.errors(surveys)
    ax = figure.axes[0]
    assert [c.get_label() for c in ax.containers] == ["[11] = SL", "A", "D (ours)"]
    line = ax.containers[1].lines[0]
    assert line.get_color() == figures.SCENARIO_COLOURS["A"]
    np.testing.assert_allclose(line.get_ydata(), curve(table, "A", "error_deg").value)
    np.testing.assert_allclose(line.get_xdata(), NOISES, atol=0.1)
    assert figure.axes[2].containers[1].lines[0].get_ydata().tolist() == [50, 50, 50]
    assert "(°)" in ax.get_ylabel()
    assert "(%)" in figure.axes[2].get_ylabel()


def test_one_survey_has_no_bar_and_none_no_picture():
    rows = rows_of()
    single = rows[(rows.seed == 1) & (rows.noise_scale == 0.0)]
    names = [name for name, figure, data in study.pictures(single)]
    assert names == ["noise_errors", "noise_offsets", "noise_beaten"]
    table = study.errors(survey_table(single))[1]
    assert table[table.quantity == "error_deg"].low.isna().all()
    run = SurveyKey("mount", "quick", 900.0, 1)
    assert list(study.pictures(frame([run.row(ARTEFACT, "all", FAILED, "1", 1)]))) == []
    assert list(study.pictures(frame([run.row("other", "A", "x", "1", 1)]))) == []
