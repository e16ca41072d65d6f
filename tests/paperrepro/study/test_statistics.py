"""Promises of sigma, from rows made to keep or break them."""

import numpy as np

from paperrepro.frames import ANGLES
from paperrepro.study.rows import ARTEFACT, BOUND, SurveyKey, frame
from paperrepro.study.statistics import promises

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


def test_scenarios_not_asked_for_are_left_out():
    assert promises(rows_of("SL", 1.0), ("D",)).empty
