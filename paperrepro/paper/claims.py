"""The ledger: every testable claim, judged from the rows of a study by a written rule.

No verdict is typed: `judges` says how surveys make a setting's, `verdicts` how settings make one.
A claim is declared once: what it is called, where the paper has it, of what kind it is (or the
value that it prints), how it is judged, and what it says in our words.
"""

import itertools
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial

import numpy as np
import pandas as pd
from scipy import stats

from paperrepro.frames import ANGLES
from paperrepro.paper import judges
from paperrepro.paper import published as paper
from paperrepro.paper.judges import (
    always,
    centred,
    coverage,
    critical_ks,
    error,
    left,
    less,
    metric,
    mostly_less,
    reduced,
    standardised,
    within,
)
from paperrepro.paper.numbers import SYMBOLS, shown
from paperrepro.paper.published import ORDERING, PATTERN
from paperrepro.paper.verdicts import (
    COLUMNS,
    OURS,
    STATEMENT,
    Claim,
    Finding,
    Judge,
    fixed,
    in_settings,
    over_noise,
    printed,
    under_errors,
)
from paperrepro.study.rows import ERRORS, FOUND, REFINED, mistaken_name
from paperrepro.study.statistics import CONFIDENCE, Evidence, Surveys

#: The scenarios that the paper proposes, and its [11] with them; how the paper calls them.
PROPOSED = ("A", "B", "C")
ALL = ("SL", *PROPOSED)
CALLED = {"SL": "[11]", "A": "A", "B": "B", "C": "C", "D": "D"}

#: Judged with one preset of the boresight alone.
ON_MOUNT, ON_TABLE4 = (partial(in_settings, preset=preset) for preset in ("mount", "table4"))

#: Claims of the short table.
HEADLINES = frozenset({
    "budget-printed", "rmse-reduction-B", "rmse-B-below-SL", "rmse-reduction-C", "rmse-C-below-SL",
    "SL-alone", "table5-rmse-SL", "table5-rmse-B", "share-contradiction", "normal-B",
    "normal-means-eliminated-C", "offset-calibrated", "offset-refined", "table4-agreement",
    "coverage-SL", "coverage-A", "coverage-B", "error-A-below-SL", "error-B-below-SL",
    "error-C-below-SL", "noise-B-below-SL", "refinement-error-C", "planes-not-needed-error",
    "matching-automatic", "closed-form", "ours-coverage-D", "ours-error-D-below-SL",
    "ours-A-more-honest", "ours-screened-B",
})  # fmt: skip

#: "About 300 points/m²" is met within this, values printed as "about so many percent" within that.
ABOUT_DENSITY, ABOUT = 50.0, 0.1
#: A mean further from zero than so many honest sigmas is a systematic error.
CENTRED_SIGMAS = 1.96
#: Errors over the Cramer-Rao bound that are still near it.
NEAR_BOUND = 1.15

RMSE, RMSE_TRUTH, MEAN = "rmse_reference", "rmse_truth", "mae_reference"
OFFSET, OFFSET_MAX = "offset_mean_reference", "offset_max_reference"

# fmt: off


def _rmse() -> Iterator[Claim]:
    limit = paper.RMSE_REDUCTION["C"]
    yield Claim("budget-printed", "Table 4, Fig. 7", limit, error_budget,
        "boresights as large as Table 4's explain so large a fall of the RMSE", printed)
    yield Claim("budget-table4", "Table 4, Fig. 7", limit,
        within(reduced("truth", RMSE_TRUTH), "share", low=limit.value),
        "with Table 4's boresight, even the true mounting lowers the RMSE so far", ON_TABLE4)
    for x, limit in paper.RMSE_REDUCTION.items():
        yield Claim(f"rmse-reduction-{x}", "Fig. 7", limit, _gains(x, limit.value),
            f"{x} lowers the RMSE against the reference by more than the stated share")
        yield Claim(f"rmse-reduction-{x}-refined", "Fig. 7", limit,
            _gains(x + REFINED, limit.value),
            f"{x} and refinement lower the RMSE by more than the stated share")
        yield Claim(f"rmse-{x}-below-SL", "Fig. 7", ORDERING, _lower(x, "SL", RMSE),
            f"RMSE of {x} below that of [11]")
        yield Claim(f"rmse-truth-{x}-below-SL", "Fig. 7", ORDERING, _lower(x, "SL", RMSE_TRUTH),
            f"RMSE of {x} below that of [11], against the true planes")
        yield Claim(f"rmse-{x}-below-A", "Fig. 6", ORDERING, _lower(x, "A", RMSE),
            f"RMSE of {x} below that of A")
    yield Claim("rmse-C-below-B", "Fig. 7", ORDERING, _lower("C", "B", RMSE),
        "the RMSE of C, both constraints together, is slightly below B's")
    yield Claim("rmse-B-like-C", "Fig. 6", STATEMENT, _no_worse("B", "C", RMSE, either=True),
        "B and C perform alike")
    yield Claim("SL-alone", "section 5", STATEMENT,
        within(judges.over_floor("SL"), "1", low=1 + judges.MARGIN),
        "[11] alone does not do for UAV data: its RMSE stays above the noise floor")
    yield Claim("constraint-brings-most", "section 3.2.3", STATEMENT,
        within(_gain_over_that_of_b, "share", high=0.5), "most of the gain comes from the "
        "centroid constraint: [11] alone gains less than half of what B does", ON_MOUNT)


def _shares() -> Iterator[Claim]:
    sl, best = paper.RMSE_LEFT_BY_SL.value, {"the true mounting leaves": left("truth", RMSE)}
    yield Claim("rmse-left-SL", "Fig. 8", paper.RMSE_LEFT_BY_SL,
        within(left("SL", RMSE), "share", best, high=sl),
        "[11] leaves less than the stated share of the RMSE")
    readings = {"rmse": (RMSE, "RMSE"), "mean": (MEAN, "mean absolute distance")}
    for x, share in {"SL": paper.TABLE5["SL"], "B": paper.TABLE5["proposed"]}.items():
        for reading, (measure, words) in readings.items():
            best = {"the true mounting leaves": left("truth", measure)}
            yield Claim(f"table5-{reading}-{x}", "Table 5", share,
                _about(left(x, measure), share.value, best),
                f"{CALLED[x]} leaves about the stated share of the error, read as {words}")
    yield Claim("share-contradiction", "Fig. 8, Table 5", paper.TABLE5["SL"], shares_agree,
        "Fig. 8 and Table 5 agree on the share that [11] leaves", printed)
    yield Claim("share-readings", "Fig. 8, Table 5", paper.TABLE5["SL"],
        within(lambda s: s.left("SL", MEAN) - s.left("SL", RMSE), "share",
               low=paper.TABLE5["SL"].value - sl),
        "RMSE and mean distance are different enough for both to be true")
    yield Claim("systematic-corrected", "section 5", paper.SYSTEMATIC_CORRECTED,
        _about(lambda s: 1 - s.error("B") / s.error("before"), paper.SYSTEMATIC_CORRECTED.value),
        "the centroid constraint corrects about the stated share of the "
        "systematic error, read as the boresight's")


def _histograms_and_offsets() -> Iterator[Claim]:
    for x in ("SL", "B", "C"):
        yield Claim(f"normal-{x}", "Fig. 8", PATTERN, _normal(x),
            f"point-to-plane distances of {CALLED[x]} are near normal")
        yield Claim(f"centred-{x}", "Fig. 8", PATTERN,
            within(centred(x), "1", {"true mounting": centred("truth")}, high=CENTRED_SIGMAS),
            f"point-to-plane distances of {CALLED[x]} are centred on zero, in units of what "
            "trajectory errors alone move their mean")
    for x in ("B", "C"):
        yield Claim(f"normal-means-eliminated-{x}", "section 3.2.3", STATEMENT,
            always(judges.not_deceived(x)),
            f"a near normal histogram of {x} means that the boresight's error is gone")
    yield Claim("offset-calibrated", "Fig. 11", paper.OFFSET_AFTER_CALIBRATION,
        _largest_offset("", paper.OFFSET_AFTER_CALIBRATION),
        "vertical offsets at the virtual points are small after calibration by A, B and C")
    yield Claim("offset-refined", "Fig. 11", paper.OFFSET_AFTER_REFINEMENT,
        _largest_offset(REFINED, paper.OFFSET_AFTER_REFINEMENT), "and smaller after refinement")
    for x in PROPOSED:
        yield Claim(f"offset-{x}-refinement-helps", "Fig. 11", ORDERING,
            _lower(x + REFINED, x, OFFSET), f"refinement lowers the vertical offsets of {x}")
    for x in PROPOSED:
        yield Claim(f"offset-{x}-below-SL", "Fig. 11", ORDERING,
            _lower(x + REFINED, "SL", OFFSET), f"vertical offsets of {x}, refined, below [11]'s")


def _boresight() -> Iterator[Claim]:
    for x in PROPOSED:
        yield Claim(f"no-campaign-{x}", "section 2.2.3", STATEMENT, _truer(x, "before"),
            f"{x} lowers the boresight's error without control on the ground")
    yield Claim("table4-agreement", "Table 4", PATTERN, table4_agreement,
        "A, B and C estimate one boresight, within their sigmas", printed)
    yield Claim("table4-sigma", "section 3.2.1", PATTERN, table4_sigma,
        "the printed sigmas lie within what the GNSS/INS promises", printed)
    for x in ALL:
        yield Claim(f"coverage-{x}", "section 3.2.1", PATTERN, coverage(x),
            f"the sigmas of {CALLED[x]} are honest: 95 % intervals hold the truth")
    for x in ALL:
        yield Claim(f"standardised-{x}", "section 3.2.1", PATTERN, standardised(x),
            f"errors of {CALLED[x]} are as large as their sigmas")
    for x in PROPOSED:
        yield Claim(f"error-{x}-below-SL", "Abstract", ORDERING, _truer(x, "SL"),
            f"{x} finds the boresight better than [11]")
    for x in PROPOSED:
        yield Claim(f"noise-{x}-below-SL", "section 2.2.3", STATEMENT, judges.slower(x, "SL"),
            f"{x} is less sensitive to trajectory noise than [11]", over_noise)
        yield Claim(f"correct-under-noise-{x}", "section 4", STATEMENT,
            always(judges.within_specification(x)), f"{x} is correct even with a highly noised "
            "trajectory: all angles within the attitude accuracy")
        yield Claim(f"noise-only-in-extraction-{x}", "section 4", STATEMENT, judges.grows(x, False),
            "noise affects the plane extraction only: the "
            f"error of {x} does not grow with it", over_noise)
        yield Claim(f"better-sensors-{x}", "section 4", STATEMENT, judges.grows(x, True),
            f"better sensors improve {x}", over_noise)
    for x in PROPOSED:
        yield Claim(f"refinement-error-{x}", "section 4.2", ORDERING, _truer(x + REFINED, x),
            f"refinement improves the boresight of {x}")
        yield Claim(f"refinement-rmse-{x}", "section 4.2", ORDERING, _lower(x + REFINED, x, RMSE),
            f"refinement lowers the RMSE of {x}")


def _method() -> Iterator[Claim]:
    yield Claim("planes-not-needed-error", "section 4.1", STATEMENT,
        judges.no_worse(error("B"), error("C"), "deg"),
        "planes need not be estimated: B's boresight is no worse than C's")
    yield Claim("planes-not-needed-rmse", "section 4.1", STATEMENT, _no_worse("B", "C", RMSE),
        "planes need not be estimated: B's RMSE is no worse than C's")
    yield Claim("planes-not-needed-time", "section 4.1", ORDERING,
        _lower("B", "C", "seconds", "s"), "B, without planes as unknowns, takes less time than C")
    yield Claim("matching-automatic", "section 3.2.2", STATEMENT, _at_most("all", "false_pairs", 0),
        "matching is automatic once the strips are calibrated: no false match is left")
    yield Claim("matching-unscreened", "section 3.2.2", STATEMENT, _at_most("all", "rejected", 0),
        "nor does one have to be removed")
    for x in PROPOSED:
        yield Claim(f"wrong-match-{x}-below-SL", "section 2.2.3", ORDERING,
            mostly_less(judges.without_screening(x), judges.without_screening("SL")),
            f"with one wrong match and no screening, {x} is better than [11]: the constraint is "
            "the more reliable one")
    yield Claim("density-below", "section 2.1", paper.DENSITY, _density("density_below"),
        "a strip holds about so many points per area, below the track")
    yield Claim("density-mean", "section 2.1", paper.DENSITY, _density("density"),
        "a strip holds about so many points per area, over its whole swath")
    yield Claim("small-angle", "Eq. (1)", STATEMENT,
        within(metric("all", "small_angle_shift"), "m", high=paper.RANGE_ACCURACY.value / 3),
        "the small-angle form does for the boresight: it moves points by less than a third of "
        "the range noise")
    yield Claim("closed-form", "section 4", STATEMENT, _at_most("B", "iterations", 1),
        "the solution is of closed form, the first of its kind: B needs one step (who was first "
        "is not tested)")
    yield Claim("lever-arm", "section 4", STATEMENT, always(judges.lever_arm_found),
        "lever arm and boresight can be estimated together (the paper leaves it to later work): "
        "D finds both horizontal parts to half of what a tape gives")
    yield Claim("natural-planes", "section 4", STATEMENT, always(judges.within_specification("C")),
        "planes of natural terrain, here banks, ditches and dams, do instead of roofs: all angles "
        "of C lie within the attitude accuracy", under_errors("natural"))
    yield Claim("vibration", "section 4.1", STATEMENT, _truer("C", "SL"), "errors caused by "
        "vibration of the platform that the GNSS/INS does not see are attenuated: C finds the "
        "boresight better than [11] under it", under_errors("vibration"))


def _ours() -> Iterator[Claim]:
    sigmas, match = "beside section 3.2.1", "beside section 2.2.4"
    yield Claim("ours-coverage-D", sigmas, OURS, coverage("D"), "D, trajectory errors estimated as "
        "a Gauss-Markov process, has honest sigmas: 95 % intervals hold the truth")
    yield Claim("ours-standardised-D", sigmas, OURS, standardised("D"),
        "errors of D are as large as their sigmas")
    yield Claim("ours-bound-D", sigmas, OURS, judges.near_bound("D", NEAR_BOUND), "no unbiased "
        "estimate from the same points could be much better than D: errors within 15 % of the "
        "Cramer-Rao bound")
    for factor in (2.0, 0.5):
        x, id = mistaken_name(factor), f"ours-wrong-prior-{factor:g}"
        yield Claim(f"{id}-coverage", sigmas, OURS, coverage(x), "with the GNSS/INS specification "
            f"wrong by a factor of {factor:g} and variance components estimated, D's 95 % "
            "intervals hold the truth", ON_MOUNT)
        yield Claim(f"{id}-standardised", sigmas, OURS, standardised(x),
            f"and its errors are as large as its sigmas (factor {factor:g})", ON_MOUNT)
    for kind in ERRORS:
        id = f"ours-coverage-under-{kind.replace(' ', '-')}"
        yield Claim(id, sigmas, OURS, coverage(FOUND), "D as calibrate runs it, told the "
            f"specification alone, keeps honest sigmas under errors of the kind '{kind}'",
            under_errors(kind))
    for x in ALL:
        yield Claim(f"ours-error-D-below-{x}", "beside the Abstract", OURS, _truer("D", x),
            f"D finds the boresight better than {CALLED[x]}")
    yield Claim("ours-A-more-honest", sigmas, OURS,
        mostly_less(metric("A", "nees"), metric("SL", "nees")), "the centroid constraint's merit "
        "is honest sigmas: errors of A are fewer of its sigmas than those of [11]")
    for x in ALL:
        yield Claim(f"ours-wrong-match-{x}", match, OURS, always(judges.unharmed(x, False)),
            f"one wrong match does no harm to {CALLED[x]}")
    for x in ALL:
        yield Claim(f"ours-screened-{x}", match, OURS, always(judges.unharmed(x, True)),
            f"one wrong match does no harm to {CALLED[x]} after screening")
    for x in (*ALL, "D"):
        yield Claim(f"ours-completes-{x}", sigmas, OURS, always(judges.completes(x)),
            f"{CALLED[x]} gives a result in every survey")


# fmt: on


def _lower(one: str, other: str, name: str, unit: str = "m") -> Judge:
    return less(metric(one, name), metric(other, name), unit)


def _no_worse(one: str, other: str, name: str, either: bool = False) -> Judge:
    return judges.no_worse(metric(one, name), metric(other, name), "m", either)


def _truer(one: str, other: str) -> Judge:
    return less(error(one), error(other), "deg")


def _at_most(scenario: str, name: str, limit: float) -> Judge:
    return always(judges.at_most(scenario, name, limit))


def _about(quantity, value: float, beside=None, margin: float = ABOUT, unit="share") -> Judge:
    return within(quantity, unit, beside, low=value - margin, high=value + margin)


def _density(name: str) -> Judge:
    return _about(metric("all", name), paper.DENSITY.value, None, ABOUT_DENSITY, "1/m2")


def _gains(scenario: str, limit: float) -> Judge:
    beside = {"the true mounting gains": reduced("truth", RMSE)}
    return within(reduced(scenario, RMSE), "share", beside, low=limit)


def _gain_over_that_of_b(surveys: Surveys) -> pd.Series:
    """What [11] gains of the RMSE, over what B gains on average."""
    before = surveys.of("before", RMSE)
    return (before - surveys.of("SL", RMSE)) / (before - surveys.of("B", RMSE)).mean()


def _normal(scenario: str) -> Judge:
    beside = {
        "skewness": metric(scenario, "skewness_reference"),
        "excess kurtosis": metric(scenario, "kurtosis_reference"),
        "limit if every point were a sample": critical_ks("points"),
    }
    return within(metric(scenario, "ks_reference"), "1", beside, high=critical_ks("views"))


def _largest_offset(ending: str, limit: paper.Published) -> Judge:
    worst = judges.largest(*(metric(name + ending, OFFSET_MAX) for name in PROPOSED))
    others = {"before": "before", "with [11]": "SL", "with the true mounting": "truth"}
    beside = {words: metric(name, OFFSET_MAX) for words, name in others.items()}
    return within(worst, "m", beside, high=limit.value)


# Findings that follow from the paper's printed numbers alone, without any survey


def error_budget(evidence: Evidence) -> Finding:
    """The largest reduction of the RMSE that Table 4's boresights allow: a point at the flying
    height moves by d, and what stays is the range noise, so 1 - s / sqrt(s² + d²) at most."""
    angles = {x: [paper.TABLE4[x, angle].value for angle in ANGLES] for x in PROPOSED}
    turned = {x: np.linalg.norm(each) for x, each in angles.items()}
    name = max(turned, key=turned.get)
    moved = paper.HEIGHT.value * np.deg2rad(turned[name])
    most = 1 - paper.RANGE_ACCURACY.value / np.hypot(paper.RANGE_ACCURACY.value, moved)
    words = (
        f"scenario {name}'s {shown(turned[name], 'deg')} moves a point "
        f"{paper.HEIGHT.value:g} m away by {shown(moved, 'm')}, the range noise is "
        f"{shown(paper.RANGE_ACCURACY.value, 'm')}: at most {shown(most, 'share')} can be gained"
    )
    return fixed(most, most > paper.RMSE_REDUCTION[name].value, words)


def table4_agreement(evidence: Evidence) -> Finding:
    """The largest difference between two scenarios' angles, in their combined sigma; the limit is
    that of all comparisons together."""
    lines = []
    for (one, other), angle in itertools.product(itertools.combinations(PROPOSED, 2), ANGLES):
        a, b = paper.TABLE4[one, angle], paper.TABLE4[other, angle]
        difference, sigma = abs(a.value - b.value), np.hypot(a.sigma, b.sigma)
        words = f"{SYMBOLS[angle]} of {one} and {other} by {difference / sigma:.1f} σ"
        detail = f" ({shown(difference, 'deg')}, σ {shown(sigma, 'deg')})"
        lines.append((difference / sigma, words, detail))
    lines.sort(reverse=True)
    alone = stats.norm.ppf(0.5 + CONFIDENCE / 2)
    together = stats.norm.ppf(1 - (1 - CONFIDENCE) / 2 / len(lines))
    apart = [words + detail for size, words, detail in lines if size > alone]
    words = (
        f"apart: {', '.join(apart) or 'none'}; limit {together:.2f} σ "
        f"for the largest of {len(lines)}"
    )
    return fixed(lines[0][0], lines[0][0] <= together, words)


def table4_sigma(evidence: Evidence) -> Finding:
    """The largest formal sigma of Table 4 in units of the attitude accuracy of its axis."""
    promised = {angle: value.value for angle, value in paper.ATTITUDE_ACCURACY.items()}
    share = {key: value.sigma / promised[key[1]] for key, value in paper.TABLE4.items()}
    name, angle = max(share, key=share.get)
    sigma = shown(paper.TABLE4[name, angle].sigma, "deg")
    words = (
        f"largest share: {SYMBOLS[angle]} of {name}, {sigma} of {shown(promised[angle], 'deg')}; "
        "whether errors are that small is another claim"
    )
    return fixed(share[name, angle], share[name, angle] <= 1, words)


def shares_agree(evidence: Evidence) -> Finding:
    """Whether the share that [11] leaves is the same in Fig. 8 and Table 5."""
    one, other = paper.TABLE5["SL"], paper.RMSE_LEFT_BY_SL
    ratio = one.value / other.value
    words = (
        f"{one.place} leaves {shown(one.value, 'share')}, {other.place} less than "
        f"{shown(other.value, 'share')}: {ratio:.1f} times as much"
    )
    return fixed(ratio, ratio <= 1, words)


CLAIMS: tuple[Claim, ...] = (
    *_rmse(), *_shares(), *_histograms_and_offsets(), *_boresight(), *_method(), *_ours(),
)  # fmt: skip


# The ledger


def ledger(rows: pd.DataFrame) -> pd.DataFrame:
    """Judge every claim.

    Parameters
    ----------
    rows : DataFrame
        Tidy rows of a study, with the columns of `paperrepro.study.rows.COLUMNS`.

    Returns
    -------
    DataFrame
        A line for each of `CLAIMS`, in their order, with the columns `COLUMNS`; ``measured``,
        ``low`` and ``high`` in ``unit`` are those of the first setting.
    """
    evidence = Evidence(rows)
    return pd.DataFrame([_line(claim, evidence) for claim in CLAIMS], columns=list(COLUMNS))


def _line(claim: Claim, evidence: Evidence) -> dict:
    finding, value = claim.rule(evidence), claim.paper
    return {
        "id": claim.id, "claim": claim.text, "place": claim.place, "kind": claim.kind,
        "paper": value.value if value else np.nan, **asdict(finding),
        "unit": finding.unit or (value.unit if value else ""),
    }  # fmt: skip
