"""The ledger: every claim's verdict turns with the rows, and none is given without evidence."""

import ast
import functools
import itertools
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from paperrepro.frames import ANGLES
from paperrepro.method.adjustment.trajectory_equations import AXES
from paperrepro.paper import claims, published, tables
from paperrepro.paper.published import Published
from paperrepro.paper.verdicts import CONDITIONS, FAILS, HOLDS, UNTESTED, VERDICTS
from paperrepro.study.rows import (
    ARTEFACT,
    BOUND,
    COLUMNS,
    ERRORS,
    FAILED,
    FOUND,
    LEVER_ARM,
    REFINED,
    SCREENED,
    SPECIFIED,
    WRONG,
    SurveyKey,
    frame,
    mistaken_name,
)
from paperrepro.study.statistics import LEAST_SEEDS, Evidence, binomial, bootstrap

PAPER = ("SL", "A", "B", "C")
PROPOSED = PAPER[1:]
AGAINST = ("truth", "reference")
ACCURACY = ("rmse", "mae", "mean", "skewness", "kurtosis", "ks", "offset_mean", "offset_max")
MISTAKEN = tuple(mistaken_name(factor) for factor in (0.5, 2.0))
SCENARIOS = (
    *PAPER,
    "D",
    FOUND,
    *(name + end for name in PAPER for end in (REFINED, WRONG, SCREENED)),
)

#: What a survey says where a test says nothing else: by metric, or by scenario and metric.
USUAL = {
    "error": 0.01, "sigma": 0.01, "nees": 1.0, "iterations": 4, "seconds": 1.0, "rmse": 0.036,
    "mae": 0.03, "mean": 0.005, "skewness": 0.1, "kurtosis": -0.1, "ks": 0.02,
    "offset_mean": 0.05, "offset_max": 0.1, "bound": 0.0098, "lever_arm": 0.005,
    ("before", "error"): 1.0, ("before", "rmse"): 0.4,
    ("before", "mae"): 0.3, ("before", "offset_max"): 0.9, ("truth", "rmse"): 0.035,
    ("all", "views"): 80, ("all", "points"): 90_000, ("all", "pairs"): 130,
    ("all", "density"): 190.0, ("all", "density_below"): 300.0, ("all", "false_pairs"): 0,
    ("all", "rejected"): 0, ("all", "small_angle_shift"): 0.02,
}  # fmt: skip
COUNTS = {"iterations", "false_pairs", "rejected", "views", "points", "pairs"}


@functools.cache
def usual_rows():
    """One setting's rows with all levels 1: ``value`` scatters by survey, ``of`` is the key of its
    level in `USUAL`."""
    rng, rows = np.random.default_rng(0), []

    def add(run, scenario, metric, of, sigma=np.nan):
        value = 1.0 if of in COUNTS else rng.uniform(0.97, 1.03)
        rows.append({**run.row(ARTEFACT, scenario, metric, "", value, sigma), "of": of})

    for seed in range(1, LEAST_SEEDS + 1):
        run = SurveyKey("mount", "quick", 1.0, seed)
        for _, metric in (key for key in USUAL if key[0] == "all"):
            add(run, "all", metric, metric)
        for name in (*SCENARIOS, "before", "truth"):
            for angle in ANGLES if name != "truth" else ():
                add(run, name, f"error_{angle}", "error", np.nan if name == "before" else 1.0)
            for metric in ("nees", "iterations", "seconds") if name in SCENARIOS else ():
                add(run, name, metric, metric)
            for metric, against in itertools.product(ACCURACY, AGAINST):
                add(run, name, f"{metric}_{against}", metric)
    for seed in range(1, LEAST_SEEDS + 1):
        run = SurveyKey("mount", "quick", 1.0, seed)
        for angle in ANGLES:
            add(run, BOUND, f"bound_{angle}", "bound")
            for name in MISTAKEN:
                add(run, name, f"error_{angle}", "error", 1.0)
        for name in MISTAKEN:
            add(run, name, "nees", "nees")
        for axis in AXES:
            add(run, LEVER_ARM, f"error_{axis}", "lever_arm", 1.0)
    return pd.DataFrame(rows)


def study(changes=None, seeds=LEAST_SEEDS, presets=("mount",), scales=(1.0,), errors=SPECIFIED):
    """Rows of a study; ``changes`` by (scenario, metric) are levels, or functions of the noise that
    give them, in the place of the `USUAL` ones; None leaves the metric out."""
    rows = usual_rows().query("seed <= @seeds")
    parts = [
        rows.assign(preset=p, noise_scale=k, errors=errors)
        for p, k in itertools.product(presets, scales)
    ]
    for part in parts:
        scale = part.noise_scale.iloc[0]
        part["value"] *= levels(part.scenario, part.of, changes or {}, scale)
        part["sigma"] *= levels(part.scenario, ["sigma"] * len(part), changes or {}, scale)
    return pd.concat(parts).dropna(subset="value")[list(COLUMNS)]


def levels(scenario, metric, changes, scale):
    known = {}
    for key in set(zip(scenario, metric, strict=True)):
        level = changes.get(key, USUAL.get(key, USUAL.get(key[1])))
        known[key] = np.nan if level is None else level(scale) if callable(level) else level
    return [known[key] for key in zip(scenario, metric, strict=True)]


def line(rows, claim):
    """One claim of the ledger."""
    finding = next(c for c in claims.CLAIMS if c.id == claim).rule(Evidence(rows))
    assert finding.verdict in VERDICTS
    assert finding.condition
    return finding


def flips():
    """id: (changes that make it hold, changes that make it fail, further arguments of `study`)."""
    low_high = {}

    def order(claim, less, more, low, high, **options):
        """``less`` below ``more``, both (scenario, metric)."""
        low_high[claim] = ({less: low, more: high}, {less: high, more: low}, options)

    def turn(claim, key, holds, fails, **options):
        low_high[claim] = ({key: holds}, {key: fails}, options)

    for name in ("B", "C"):
        turn(f"rmse-reduction-{name}", (name, "rmse"), 0.03, 0.1)
        turn(f"rmse-reduction-{name}-refined", (name + REFINED, "rmse"), 0.03, 0.1)
        order(f"rmse-{name}-below-SL", (name, "rmse"), ("SL", "rmse"), 0.03, 0.04)
        order(f"rmse-truth-{name}-below-SL", (name, "rmse"), ("SL", "rmse"), 0.03, 0.04)
        order(f"rmse-{name}-below-A", (name, "rmse"), ("A", "rmse"), 0.03, 0.04)
        turn(f"normal-means-eliminated-{name}", (name, "nees"), 0.5, 50.0)
    order("rmse-C-below-B", ("C", "rmse"), ("B", "rmse"), 0.03, 0.04)
    turn("rmse-B-like-C", ("B", "rmse"), 0.036, 0.06)
    turn("budget-table4", ("truth", "rmse"), 0.02, 0.3, presets=("table4",))
    turn("SL-alone", ("SL", "rmse"), 0.05, 0.035)
    turn("constraint-brings-most", ("SL", "rmse"), 0.38, 0.036)
    turn("rmse-left-SL", ("SL", "rmse"), 0.03, 0.3)
    turn("table5-rmse-SL", ("SL", "rmse"), 0.32, 0.04)
    turn("table5-mean-SL", ("SL", "mae"), 0.24, 0.03)
    turn("table5-rmse-B", ("B", "rmse"), 0.08, 0.02)
    turn("table5-mean-B", ("B", "mae"), 0.06, 0.015)
    turn("share-readings", ("SL", "mae"), 0.28, 0.03)
    turn("systematic-corrected", ("B", "error"), 0.2, 0.01)
    for name in ("SL", "B", "C"):
        turn(f"normal-{name}", (name, "ks"), 0.02, 0.2)
        turn(f"centred-{name}", (name, "mean"), 0.005, 0.05)
    for claim, end, limit in (("offset-calibrated", "", 0.4), ("offset-refined", REFINED, 0.3)):
        turn(claim, ("C" + end, "offset_max"), 0.9 * limit, 1.2 * limit)
    for name in PROPOSED:
        refined = (name + REFINED, "offset_mean")
        order(f"offset-{name}-refinement-helps", refined, (name, "offset_mean"), 0.04, 0.05)
        order(f"offset-{name}-below-SL", refined, ("SL", "offset_mean"), 0.04, 0.05)
        order(f"no-campaign-{name}", (name, "error"), ("before", "error"), 0.01, 0.02)
        order(f"error-{name}-below-SL", (name, "error"), ("SL", "error"), 0.01, 0.02)
        turn(f"correct-under-noise-{name}", (name, "error"), 0.01, 0.09)
        order(f"refinement-error-{name}", (name + REFINED, "error"), (name, "error"), 0.01, 0.02)
        order(f"refinement-rmse-{name}", (name + REFINED, "rmse"), (name, "rmse"), 0.03, 0.04)
        order(f"wrong-match-{name}-below-SL", (name + WRONG, "error"), ("SL" + WRONG, "error"),
              0.1, 0.2)  # fmt: skip
        two = {"scales": (1.0, 2.0)}
        order(f"noise-{name}-below-SL", (name, "error"), ("SL", "error"),
              lambda k: 0.01 + 0.001 * k, lambda k: 0.01 * k, **two)  # fmt: skip
        turn(f"noise-only-in-extraction-{name}", (name, "error"), 0.01, lambda k: 0.01 * k, **two)
        turn(f"better-sensors-{name}", (name, "error"), lambda k: 0.01 * k, 0.01, **two)
    for name, of in [*((name, "") for name in PAPER), ("D", "ours-")]:
        turn(f"{of}coverage-{name}", (name, "error"), 0.01, 0.05)
        turn(f"{of}standardised-{name}", (name, "nees"), 0.9, 50.0)
    for kind in ERRORS:
        turn(f"ours-coverage-under-{kind.replace(' ', '-')}", (FOUND, "error"), 0.01, 0.05,
             errors=kind)  # fmt: skip
    turn("natural-planes", ("C", "error"), 0.01, 0.09, errors="natural")
    order("vibration", ("C", "error"), ("SL", "error"), 0.01, 0.02, errors="vibration")
    turn("planes-not-needed-error", ("B", "error"), 0.01, 0.02)
    turn("planes-not-needed-rmse", ("B", "rmse"), 0.036, 0.05)
    order("planes-not-needed-time", ("B", "seconds"), ("C", "seconds"), 0.5, 1.0)
    turn("matching-automatic", ("all", "false_pairs"), 0, 1)
    turn("matching-unscreened", ("all", "rejected"), 0, 1)
    turn("density-below", ("all", "density_below"), 300.0, 190.0)
    turn("density-mean", ("all", "density"), 300.0, 190.0)
    turn("small-angle", ("all", "small_angle_shift"), 0.001, 0.02)
    turn("closed-form", ("B", "iterations"), 1, 4)
    for name in PAPER:
        order(f"ours-error-D-below-{name}", ("D", "error"), (name, "error"), 0.01, 0.02)
        turn(f"ours-wrong-match-{name}", (name + WRONG, "error"), 0.011, 0.1)
        turn(f"ours-screened-{name}", (name + SCREENED, "error"), 0.011, 0.1)
    turn("ours-bound-D", ("D", "error"), 0.01, 0.02)
    turn("lever-arm", (LEVER_ARM, "lever_arm"), 0.01, 0.04)
    for factor in (0.5, 2.0):
        name = mistaken_name(factor)
        turn(f"ours-wrong-prior-{factor:g}-coverage", (name, "error"), 0.01, 0.05)
        turn(f"ours-wrong-prior-{factor:g}-standardised", (name, "nees"), 0.9, 50.0)
    order("ours-A-more-honest", ("A", "nees"), ("SL", "nees"), 1.0, 50.0)
    return low_high


FLIPS = flips()
PRINTED = {"budget-printed", "table4-agreement", "table4-sigma", "share-contradiction"}
COMPLETES = [f"ours-completes-{name}" for name in (*PAPER, "D")]


def test_the_list_of_claims_is_complete_and_each_can_be_turned():
    ids = [claim.id for claim in claims.CLAIMS]
    assert len(ids) == len(set(ids))
    assert set(ids) == {*FLIPS, *PRINTED, *COMPLETES}


def test_every_claim_says_what_where_and_of_what_kind():
    kinds = {"input", "pattern", "ordering", "inequality", "statement", "ours"}
    places = ("Table ", "Fig. ", "section ", "Abstract", "Eq. ", "beside ")
    for claim in claims.CLAIMS:
        assert len(claim.text) > 15
        assert claim.place.startswith(places), claim.id
        assert claim.kind in kinds, claim.id
        assert (claim.kind == "ours") == claim.id.startswith("ours-")


@pytest.mark.parametrize("claim", FLIPS)
def test_rows_that_contradict_a_claim_turn_its_verdict(claim):
    holds, fails, options = FLIPS[claim]
    assert line(study(holds, **options), claim).verdict == HOLDS
    assert line(study(fails, **options), claim).verdict == FAILS


@pytest.mark.parametrize("claim", [*FLIPS, *COMPLETES])
def test_too_few_seeds_give_no_verdict(claim):
    holds, _, options = FLIPS.get(claim, ({}, {}, {}))
    finding = line(study(holds, seeds=LEAST_SEEDS - 1, **options), claim)
    assert finding.verdict == UNTESTED
    assert f"{LEAST_SEEDS - 1} surveys" in finding.condition
    assert f"{LEAST_SEEDS} are needed" in finding.condition


def test_without_rows_only_the_printed_numbers_are_judged():
    ledger = claims.ledger(frame([]))
    assert list(ledger.columns) == list(claims.COLUMNS)
    judged = ledger[ledger.verdict != UNTESTED]
    assert set(judged.id) == PRINTED
    assert (judged.seeds == 0).all()
    assert ledger.measured.isna().equals(~ledger.id.isin(PRINTED))


def test_a_quantity_that_was_not_measured_is_named():
    finding = line(study({("B", "nees"): None}), "standardised-B")
    assert finding.verdict == UNTESTED
    assert "nees for B" in finding.condition


def test_what_depends_on_the_noise_holds_under_conditions():
    growing = {("B", "error"): lambda k: 0.005 * k**2, ("SL", "error"): lambda k: 0.01 * k}
    finding = line(study(growing, scales=(1.0, 4.0)), "error-B-below-SL")
    assert finding.verdict == CONDITIONS
    assert "holds at mount × 1" in finding.condition
    assert "not at mount × 4" in finding.condition
    assert finding.high < 0  # measured at the paper's own noise


def test_no_difference_is_no_order():
    finding = line(study(), "error-B-below-SL")
    assert finding.verdict == FAILS
    assert "no difference beyond chance" in finding.condition
    assert finding.low < 0 < finding.high


def test_surveys_that_do_not_decide_are_not_a_verdict():
    """Two methods apart by the margin, more or less: neither alike nor different."""
    finding = line(study({("B", "rmse"): 0.036 * 1.1}), "rmse-B-like-C")
    assert finding.verdict == UNTESTED
    assert finding.condition.startswith("undecided")
    assert np.isfinite(finding.measured)


def failures(scenario, seeds, of=FAILED):
    return frame(
        SurveyKey("mount", "quick", 1.0, s).row(ARTEFACT, scenario, of, "1", 1) for s in seeds
    )


def test_a_wrong_match_that_ends_in_no_solution_is_harm():
    clean = study({("B" + WRONG, "error"): None, ("B" + WRONG, "nees"): None})
    rows = pd.concat([clean, failures("B" + WRONG, range(1, LEAST_SEEDS + 1))])
    assert line(rows, "ours-wrong-match-B").verdict == FAILS
    assert line(rows, "wrong-match-B-below-SL").measured == 0.0


@pytest.mark.parametrize("name", [*PAPER, "D"])
def test_a_calibration_that_fails_is_counted(name):
    assert line(study(), f"ours-completes-{name}").verdict == HOLDS
    some = line(pd.concat([study(), failures(name, [1, 2])]), f"ours-completes-{name}")
    assert some.verdict == CONDITIONS
    assert some.measured == 1 - 2 / LEAST_SEEDS
    every = failures("all", range(1, LEAST_SEEDS + 1))
    assert line(pd.concat([study(), every]), f"ours-completes-{name}").verdict == FAILS


def test_a_noise_at_which_too_few_surveys_give_a_result_is_left_out_of_a_growth():
    growing = study({("B", "error"): lambda k: 0.01 * k}, scales=(1.0, 2.0, 4.0))
    at_most = (growing.noise_scale != 4.0) | (growing.seed > 2)
    failed = failures("all", [1, 2]).assign(noise_scale=4.0)
    rows = pd.concat([growing[at_most], failed])
    assert line(rows, "better-sensors-B").verdict == HOLDS
    every = pd.concat([failures("all", range(1, LEAST_SEEDS + 1)).assign(noise_scale=k)
                       for k in (1.0, 2.0)])  # fmt: skip
    nothing = line(every, "better-sensors-B")
    assert nothing.verdict == UNTESTED
    assert "gave a result" in nothing.condition


@pytest.mark.parametrize(
    ("claim", "key", "value"),
    [
        ("budget-printed", ("C", "phi"), 2.0),
        ("table4-agreement", None, 0.02),
        ("table4-sigma", ("B", "kappa"), 0.0),
    ],
)
def test_printed_numbers_are_judged_as_they_are(monkeypatch, claim, key, value):
    """Other printed numbers give the other verdict."""
    before = line(frame([]), claim).verdict
    sigma = 0.2 if claim == "table4-sigma" else 0.01
    table = {k: Published(value, "deg", "", "", sigma) if key in (None, k) else v
             for k, v in published.TABLE4.items()}  # fmt: skip
    monkeypatch.setattr(published, "TABLE4", table)
    assert {before, line(frame([]), claim).verdict} == {HOLDS, FAILS}


def test_the_two_shares_of_the_paper_contradict_each_other(monkeypatch):
    assert line(frame([]), "share-contradiction").verdict == FAILS
    same = Published(0.9, "1", "Fig. 8", "inequality")
    monkeypatch.setattr(published, "RMSE_LEFT_BY_SL", same)
    assert line(frame([]), "share-contradiction").verdict == HOLDS


def test_table_4_disagrees_by_the_sigmas_it_prints():
    """Worked by hand: |-0.0155 - 0.0507| / sqrt(0.0037² + 0.0205²)."""
    finding = line(frame([]), "table4-agreement")
    assert finding.measured == pytest.approx(0.0662 / np.hypot(0.0037, 0.0205))
    assert "Δφ of A and C by 3.2 σ" in finding.condition


def test_table_4_moves_a_point_less_than_the_range_noise_hides():
    finding = line(frame([]), "budget-printed")
    moved = 30 * np.deg2rad(np.linalg.norm([-0.0012, 0.0507, 0.0446]))
    assert moved == pytest.approx(0.0354, abs=1e-4)
    assert finding.measured == pytest.approx(1 - 0.03 / np.hypot(0.03, moved))


def test_no_number_is_typed_into_the_words_of_a_verdict():
    folder = Path(claims.__file__).parent
    for name in ("judges", "claims", "verdicts"):
        tree = ast.parse((folder / f"{name}.py").read_text(encoding="utf-8"))
        functions = [n for n in tree.body if isinstance(n, ast.FunctionDef)]
        if name == "claims":  # what a claim says in our words is typed, what is found is not
            functions = [f for f in functions if f.args.args and f.args.args[0].arg == "evidence"]
        assert functions
        nodes = [node for function in functions for node in ast.walk(function)]
        formats = [node.format_spec for node in nodes if isinstance(node, ast.FormattedValue)]
        for text in (n for n in nodes if isinstance(n, ast.JoinedStr) and n not in formats):
            typed = [part.value for part in text.values if isinstance(part, ast.Constant)]
            assert not any(letter.isdigit() for part in typed for letter in part), typed


def test_more_settings_ask_for_wider_intervals():
    one = line(study(), "error-B-below-SL")
    three = line(study(scales=(1.0, 2.0, 3.0)), "error-B-below-SL")
    assert three.measured == one.measured
    assert three.high - three.low > one.high - one.low


def test_intervals():
    values = np.random.default_rng(3).normal(2.0, 1.0, 400)
    mean = bootstrap(values)
    assert mean == bootstrap(values)  # the same rows give the same ledger
    assert (mean.high - mean.low) / 2 == pytest.approx(1.96 * values.std() / 20, rel=0.1)
    share = binomial(0, 20)
    assert (share.low, share.high) == pytest.approx((0.0, 1 - 0.025**0.05))


def test_the_summary_counts_all_and_shows_the_headlines():
    ledger = claims.ledger(study(presets=("mount", "table4"), scales=(1.0, 2.0)))
    text = tables.markdown_summary(ledger)
    rows = [part for part in text.splitlines() if part.startswith("| ")][1:]
    assert text.startswith(f"{len(ledger)} claims: ")
    assert len(rows) == len(claims.HEADLINES)
    assert 10 <= len(rows) <= 30
    assert all(len(row.split(" | ")) == 4 for row in rows)


def test_text_between_markers_is_replaced_and_nothing_else(tmp_path):
    path = tmp_path / "README.md"
    path.write_text("a\n<!-- claims:begin -->\nold\n<!-- claims:end -->\nb\n", encoding="utf-8")
    assert tables.update_between_markers(path, "claims", "new\n")
    assert path.read_text(encoding="utf-8") == (
        "a\n<!-- claims:begin -->\nnew\n<!-- claims:end -->\nb\n"
    )
    assert not tables.update_between_markers(path, "claims", "new\n")
    with pytest.raises(ValueError, match="other:begin"):
        tables.update_between_markers(path, "other", "new")
