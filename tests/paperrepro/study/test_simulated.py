"""What is measured of a simulated survey, and which surveys a study has."""

from dataclasses import replace

import numpy as np
import pytest

from data_synth import make_config
from paperrepro.errors import BadInput
from paperrepro.frames import ANGLES
from paperrepro.paper import claims
from paperrepro.study import statistics
from paperrepro.study.rows import (
    ADJUSTED,
    BY_FOUR,
    FEW,
    PER_PAIR,
    REFINED,
    SEGMENTATION,
    SPECIFIED,
    WITHOUT_OFFSETS,
    SurveyKey,
    frame,
)
from paperrepro.study.simulated import (
    ANGLES_ONLY,
    MISTAKEN,
    OF_DENSE,
    Measured,
    SimulatedSurvey,
    measure,
    planned,
)
from paperrepro.study.variants import with_wrong_match


def test_a_survey_and_its_key_are_the_same():
    key = SurveyKey("table4", "quick", 2.0, 7)
    assert SimulatedSurvey.of(key).key == key
    assert SimulatedSurvey.of(key).config == make_config("table4", seed=7, noise_scale=2.0)


def test_the_true_planes_are_those_of_the_tie_planes(flown):
    """Each found plane lies near its true one; a number mixed up would be metres away."""
    planes = flown.true_planes
    states = flown.found.tie_planes.plane_states(flown.truth.mounting)
    away = np.einsum("ga,ga->g", planes[:, :3], states.centroid) - planes[:, 3]
    assert len(planes) == flown.found.tie_planes.n_planes
    assert np.abs(away).max() < 0.2


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
    rows = frame(measure(flown, Measured(mistaken=MISTAKEN, found=True, between=True)))
    assert not rows.duplicated(["scenario", "metric"]).any()
    assert np.isfinite(rows.value).all()
    of_true_planes = rows[rows.metric == "rmse_truth"].set_index("scenario").value
    assert of_true_planes[ADJUSTED] < of_true_planes["D"] < of_true_planes["before"]
    monkeypatch.setattr(statistics, "LEAST_SEEDS", 1)
    ledger = claims.ledger(rows)
    # what asks for other surveys, and for the time of a stage that is kept here
    known = ~ledger.id.str.contains("wrong-match|screened|segmentation-slow")
    assert not ledger[known].condition.str.contains("no row of").any()
    density = rows[rows.metric == "density"].value.item()
    assert density == pytest.approx(200, rel=0.15)  # 300 000 /s on a swath of 104 m at 4.5 m/s


def test_further_surveys_are_of_the_first_preset_and_measured_in_part():
    surveys = planned(1, 2, (0.5, 1.0), ("mount", "table4"), "quick")
    whole = [key for key, what in surveys.items() if what.accuracy]
    assert {(key.preset, key.seed) for key in whole} == {("mount", 1), ("table4", 1)}
    assert surveys[SurveyKey("mount", "quick", 0.5, 2)] == ANGLES_ONLY
    assert surveys[SurveyKey("mount", "quick", 1.0, 2)].between
    assert not any(what.between for key, what in surveys.items() if key.noise_scale != 1)
    told_wrong = {key for key, what in surveys.items() if what.mistaken == MISTAKEN}
    assert told_wrong == {SurveyKey("mount", "quick", 1.0, seed) for seed in (1, 2)}
    assert len(surveys) == 6


def test_less_is_measured_at_full_density_and_under_errors_of_other_kinds():
    (dense,) = planned(1, 0, (1.0,), ("mount",), "paper").values()
    assert dense == OF_DENSE
    of_kinds = planned(1, 0, (1.0,), ("mount",), "quick", (SPECIFIED, "clock"))
    clock = of_kinds[SurveyKey("mount", "quick", 1.0, 1, "clock")]
    assert clock == replace(ANGLES_ONLY, variants=False, found=True)


@pytest.fixture(scope="module")
def rows(flown):
    return frame(measure(flown, Measured(accuracy=False, lever_arm=False)))


def value(rows, scenario, metric):
    return rows[(rows.scenario == scenario) & (rows.metric == metric)].value.item()


@pytest.mark.slow
def test_sigma_falls_with_the_points_a_face_and_the_error_does_not(flown):
    """Points of a face share one error of the trajectory: forty times the points, hardly better."""
    rows = frame(measure(flown, replace(ANGLES_ONLY, variants=False, between=True)))
    for few, more, every in (("SL 3", "SL 30", "SL"), ("B 3", "B 30", "B"), ("C 3", "C 30", "C")):
        sigmas = [
            rows[(rows.scenario == name) & (rows.metric == "error_kappa")].sigma.item()
            for name in (few, more, every)
        ]
        assert sigmas[0] > 2 * sigmas[1] > 4 * sigmas[2]
        assert value(rows, every, "nees") > 10 * value(rows, few, "nees")


@pytest.mark.slow
def test_unknowns_and_steps_of_the_variants(flown, rows):
    planes = flown.found.tie_planes.n_planes
    unknowns = {name: value(rows, name, "unknowns") for name in ("A", "B 3", "SL 3", "C 3", "B 0")}
    free = 3 + 16 + 3 * planes
    assert unknowns == {"A": 3, "B 3": 19, "SL 3": free, "C 3": free, "B 0": 19}
    assert value(rows, WITHOUT_OFFSETS, "unknowns") == 3 + 3 * planes
    for name in ("A", "B 3", "C 3"):  # a degree away, the first step is good to some per cent
        assert 0 < value(rows, name, "first_step_in_sigma") < 20
    assert value(rows, SEGMENTATION, "seconds") > 0 if not flown.kept else True


@pytest.mark.slow
def test_the_refinement_by_pairs_and_by_four_planes(rows):
    assert value(rows, FEW["C"] + PER_PAIR, "strip_pairs") > 5
    joint, pairs, four = (
        np.hypot.reduce([value(rows, FEW["C"] + ending, f"error_{a}") for a in ANGLES])
        for ending in (REFINED, PER_PAIR, BY_FOUR)
    )
    assert max(joint, pairs) < 0.2
    assert four < 1


@pytest.mark.parametrize(
    ("seeds", "presets", "words"), [(0, ("mount",), "got 0"), (1, ("none",), "'none'")]
)
def test_surveys_that_cannot_be_are_refused(seeds, presets, words):
    with pytest.raises(BadInput, match=words):
        planned(seeds, 0, (1.0,), presets, "quick")
