"""Promises of sigma, from rows made to keep or break them."""

import numpy as np
import pandas as pd
import pytest

from paperrepro.frames import ANGLES
from paperrepro.study.rows import ARTEFACT, BOUND, SurveyKey, frame
from paperrepro.study.statistics import TooLittle, against_points, median_survey, promises

SEEDS = 400


def rows_of(scenario, factor, bound=1.0):
    """Errors of ``factor`` times the sigma that is promised, and a bound on each."""
    rng, rows = np.random.default_rng(1), []
    for seed in range(1, SEEDS + 1):
        run, errors = SurveyKey("mount", "quick", 1.0, seed), factor * rng.normal(size=3)
        rows += [
            run.row(ARTEFACT, scenario, f"error_{angle}", "deg", error, 1.0)
            for angle, error in zip(ANGLES, errors, strict=True)
        ]
        rows += [run.row(ARTEFACT, BOUND, f"bound_{angle}", "deg", bound) for angle in ANGLES]
        rows.append(run.row(ARTEFACT, scenario, "nees", "1", np.square(errors).mean()))
    return frame(rows)


def test_an_honest_sigma_covers_what_it_says():
    table = promises(rows_of("D", 1.0), ("D",))
    assert table.angle.tolist() == list(ANGLES)
    assert (table.surveys == SEEDS).all()
    assert table.coverage.between(0.92, 0.98).all()
    np.testing.assert_allclose(table.nees, 1.0, atol=0.1)
    np.testing.assert_allclose(table.over_bound, 1.0, atol=0.08)
    np.testing.assert_allclose(table.sigma_deg, 1.0)


def test_one_ten_times_too_small_does_not():
    table = promises(rows_of("SL", 10.0, bound=5.0), ("SL", "D"))
    assert (table.coverage < 0.25).all()
    assert (table.nees > 80).all()
    np.testing.assert_allclose(table.over_bound, 2.0, rtol=0.1)


def test_without_a_bound_the_rest_is_there():
    rows = rows_of("D", 1.0)
    table = promises(rows[rows.scenario != BOUND], ("D",))
    assert table.over_bound.isna().all()
    assert (table.rms_deg > 0.9).all()


def test_the_median_survey_is_neither_the_best_nor_the_worst():
    keys = [SurveyKey("mount", "quick", 1.0, seed) for seed in (1, 2, 3)]
    values = {1: 0.9, 2: 0.1, 3: 0.5}
    rows = [key.row(ARTEFACT, "C 3", "rmse", "m", values[key.seed]) for key in keys]
    rows += [SurveyKey("mount", "quick", 2.0, 4).row(ARTEFACT, "C 3", "rmse", "m", 0.55)]
    assert median_survey(frame(rows), "C 3", "rmse") == 3
    with pytest.raises(TooLittle, match="no row of ks"):
        median_survey(frame(rows), "C 3", "ks")


def test_honesty_against_points_a_face(monkeypatch):
    rows = [rows_of("SL 3", 1.0), rows_of("SL", 10.0)]
    counts = [SurveyKey("mount", "quick", 1.0, seed).row(ARTEFACT, "all", name, "1", value)
              for seed in range(1, SEEDS + 1)
              for name, value in {"points": 5000, "views": 10}.items()]  # fmt: skip
    rows = pd.concat([*rows, frame(counts)]).drop_duplicates(["scenario", "metric", "seed"])
    table = against_points(rows, {"SL": (("SL 3", 3), ("SL", None)), "A": (("A", 0),)})
    assert table.points.tolist() == [3, 500]
    few, many = table.itertuples()
    assert few.nees_low < 1 < few.nees_high
    assert many.nees > 80
    assert few.coverage_low < 0.95 < few.coverage_high
    assert few.sigma_deg == many.sigma_deg == pytest.approx(np.sqrt(3))
    assert against_points(frame([]), {}).empty


def test_scenarios_not_asked_for_are_left_out():
    assert promises(rows_of("SL", 1.0), ("D",)).empty
