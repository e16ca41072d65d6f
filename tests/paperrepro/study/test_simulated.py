"""What is measured of a simulated survey, and which surveys a study has."""

import numpy as np
import pytest

from data_synth import make_config
from paperrepro.errors import BadInput
from paperrepro.paper import claims
from paperrepro.study import statistics
from paperrepro.study.gross_error import with_wrong_match
from paperrepro.study.rows import SurveyKey, frame
from paperrepro.study.simulated import (
    ANGLES_ONLY,
    MISTAKEN,
    Measured,
    SimulatedSurvey,
    measure,
    planned,
)


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
    rows = frame(measure(flown, what=Measured(mistaken=MISTAKEN, found=True)))
    assert not rows.duplicated(["scenario", "metric"]).any()
    assert np.isfinite(rows.value).all()
    monkeypatch.setattr(statistics, "LEAST_SEEDS", 1)
    ledger = claims.ledger(rows)
    assert not ledger.condition.str.contains("no row of").any()
    density = rows[rows.metric == "density"].value.item()
    assert density == pytest.approx(200, rel=0.15)  # 300 000 /s on a swath of 104 m at 4.5 m/s


def test_further_surveys_are_of_the_first_preset_and_measured_in_part():
    surveys = planned(1, 2, (0.5, 1.0), ("mount", "table4"), "quick")
    whole = [key for key, what in surveys.items() if what.accuracy]
    assert {(key.preset, key.seed) for key in whole} == {("mount", 1), ("table4", 1)}
    assert surveys[SurveyKey("mount", "quick", 0.5, 2)] == ANGLES_ONLY
    told_wrong = {key for key, what in surveys.items() if what.mistaken == MISTAKEN}
    assert told_wrong == {SurveyKey("mount", "quick", 1.0, seed) for seed in (1, 2)}
    assert len(surveys) == 6


@pytest.mark.parametrize(
    ("seeds", "presets", "words"), [(0, ("mount",), "got 0"), (1, ("none",), "'none'")]
)
def test_surveys_that_cannot_be_are_refused(seeds, presets, words):
    with pytest.raises(BadInput, match=words):
        planned(seeds, 0, (1.0,), presets, "quick")
