"""What the paper claims of the boresight and of the method, and what stands beside it of ours.

What the paper claims of the RMSE, and of the share of the errors that is left.

What the paper claims of histograms, of vertical offsets, and of doing without control.

Findings that follow from the paper's printed numbers alone, without any survey.

The ledger as text: a short table, put between markers of a file.

The ledger: every testable claim, judged from the rows of a study by a written rule.

No verdict is typed: `verdicts` says how settings make one, `judges` and `honesty` how surveys make
a setting's, `accuracy`, `shape` and `boresight` list the claims.
"""

import itertools
import os
from collections.abc import Collection
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

from paperrepro.frames import ANGLES
from paperrepro.paper.judges import (
    MARGIN,
    Beside,
    Quantity,
    above,
    always,
    at_most,
    below,
    centred,
    coverage,
    critical_ks,
    critical_ks_of_points,
    error,
    grows,
    largest,
    left,
    less,
    lever_arm_found,
    metric,
    mostly_less,
    near,
    near_bound,
    no_worse,
    not_deceived,
    over_floor,
    reduced,
    similar,
    standardised,
    steeper,
    unharmed,
    within_specification,
    without_screening,
)
from paperrepro.paper.published import (
    ATTITUDE_ACCURACY,
    DENSITY,
    HEIGHT,
    OFFSET_AFTER_CALIBRATION,
    OFFSET_AFTER_REFINEMENT,
    RANGE_ACCURACY,
    RMSE_LEFT_BY_SL,
    RMSE_REDUCTION,
    SYSTEMATIC_CORRECTED,
    TABLE4,
    TABLE5,
)
from paperrepro.paper.verdicts import (
    STATEMENT,
    VERDICTS,
    Claim,
    Finding,
    called,
    fixed,
    never,
    ours,
    over_noise,
    over_settings,
    shown,
    span,
    valued,
)
from paperrepro.study.simulated import REFINED, mistaken_name
from paperrepro.study.statistics import CONFIDENCE, Evidence, Interval

SYMBOLS = {"omega": "Δω", "phi": "Δφ", "kappa": "Δκ"}
SCENARIOS = ("A", "B", "C")


def error_budget(evidence: Evidence) -> Finding:
    """The largest reduction of the RMSE that Table 4's boresights allow: a point at the flying
    height moves by d, and what stays is the range noise, so 1 - s / sqrt(s² + d²) at most."""
    turned = {name: _size([TABLE4[name, angle].value for angle in ANGLES]) for name in SCENARIOS}
    name = max(turned, key=turned.get)
    moved = HEIGHT.value * np.deg2rad(turned[name])
    most = 1 - RANGE_ACCURACY.value / np.hypot(RANGE_ACCURACY.value, moved)
    words = (
        f"scenario {name}'s {shown(turned[name], 'deg')} moves a point "
        f"{HEIGHT.value:g} m away by {shown(moved, 'm')}, the range noise is "
        f"{shown(RANGE_ACCURACY.value, 'm')}: at most {shown(most, 'share')} can be gained"
    )
    return fixed(most, "1", most > RMSE_REDUCTION[name].value, words)


def table4_agreement(evidence: Evidence) -> Finding:
    """The largest difference between two scenarios' angles, in their combined sigma; the limit is
    that of all comparisons together."""
    lines = []
    for (one, other), angle in itertools.product(itertools.combinations(SCENARIOS, 2), ANGLES):
        a, b = TABLE4[one, angle], TABLE4[other, angle]
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
    return fixed(lines[0][0], "1", lines[0][0] <= together, words)


def table4_sigma(evidence: Evidence) -> Finding:
    """The largest formal sigma of Table 4 in units of the attitude accuracy of its axis."""
    share = {key: value.sigma / ATTITUDE_ACCURACY[key[1]].value for key, value in TABLE4.items()}
    name, angle = max(share, key=share.get)
    words = (
        f"largest share: {SYMBOLS[angle]} of {name}, {shown(TABLE4[name, angle].sigma, 'deg')} "
        f"of {shown(ATTITUDE_ACCURACY[angle].value, 'deg')}; whether errors are that small is "
        "another claim"
    )
    return fixed(share[name, angle], "1", share[name, angle] <= 1, words)


def shares_agree(evidence: Evidence) -> Finding:
    """Whether the share that [11] leaves is the same in Fig. 8 and Table 5."""
    ratio = TABLE5["SL"].value / RMSE_LEFT_BY_SL.value
    words = (
        f"{TABLE5['SL'].place} leaves {shown(TABLE5['SL'].value, 'share')}, "
        f"{RMSE_LEFT_BY_SL.place} less than {shown(RMSE_LEFT_BY_SL.value, 'share')}: "
        f"{ratio:.1f} times as much"
    )
    return fixed(ratio, "1", ratio <= 1, words)


def _size(angles) -> float:
    return float(np.sqrt(np.sum(np.square(angles))))


def markdown_table(ledger: pd.DataFrame, ids: Collection[str]) -> str:
    """The claims ``ids`` of ``ledger``, their verdicts and measured values as a Markdown table,
    under a line that counts the verdicts of all."""
    counts = ledger.verdict.value_counts()
    counted = ", ".join(f"{counts[name]} {name}" for name in VERDICTS if name in counts)
    lines = [f"{len(ledger)} claims: {counted}.", ""]
    lines += ["| claim | place | verdict | measured |", "|---|---|---|---|"]
    lines += [
        f"| {line.claim} | {line.place} | {line.verdict} | {measured(line)} |"
        for line in ledger[ledger.id.isin(ids)].itertuples()
    ]
    return "\n".join(lines) + "\n"


def measured(line) -> str:
    """A line's measured value with unit and interval, empty where nothing was measured."""
    if not np.isfinite(line.measured):
        return ""
    if not np.isfinite(line.low):
        return shown(line.measured, line.unit)
    return span(Interval(line.measured, line.low, line.high), line.unit)


def update_between_markers(path: str | Path, name: str, text: str) -> bool:
    """Put ``text`` between ``<!-- name:begin -->`` and ``<!-- name:end -->`` of a file.

    Says whether that changed it. Raises `ValueError` where the markers are not there once and in
    order.
    """
    path = Path(path)
    before = path.read_text(encoding="utf-8")
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    if before.count(begin) != 1 or before.count(end) != 1 or before.find(end) < before.find(begin):
        raise ValueError(
            f"{path}: expected {begin} and after it {end}, each once; put them where the text goes"
        )
    head, rest = before.split(begin)
    after = f"{head}{begin}\n{text.rstrip()}\n{end}{rest.split(end)[1]}"
    if after == before:
        return False
    part = path.with_name(f"{path.name}.part")
    part.write_text(after, encoding="utf-8")
    os.replace(part, path)
    return True


PROPOSED = ("A", "B", "C")
ALL = ("SL", *PROPOSED)
RMSE = "rmse_reference"
#: "About 300 points/m²" is met within this.
ABOUT_DENSITY = 50.0

PRECISION = [
    Claim(
        "table4-agreement", "A, B and C estimate one boresight, within their sigmas", "Table 4",
        table4_agreement, kind="pattern", headline=True,
    ),
    Claim(
        "table4-sigma", "the printed sigmas lie within what the GNSS/INS promises",
        "section 3.2.1", table4_sigma, kind="pattern",
    ),
    *(
        Claim(
            f"coverage-{name}", f"the sigmas of {called(name)} are honest: 95 % intervals hold "
            "the truth", "section 3.2.1", over_settings(coverage(name)), kind="pattern",
            headline=name != "C",
        )
        for name in ALL
    ),
    *(
        Claim(
            f"standardised-{name}", f"errors of {called(name)} are as large as their sigmas",
            "section 3.2.1", over_settings(standardised(name)), kind="pattern",
        )
        for name in ALL
    ),
]  # fmt: skip

ERRORS = [
    Claim(
        f"error-{name}-below-SL", f"{name} finds the boresight better than [11]", "Abstract",
        over_settings(less(error(name), error("SL"), "deg")), kind="ordering", headline=True,
    )
    for name in PROPOSED
]  # fmt: skip

NOISE = [
    claim
    for name in PROPOSED
    for claim in (
        Claim(
            f"noise-{name}-below-SL", f"{name} is less sensitive to trajectory noise than [11]",
            "section 2.2.3", over_noise(steeper(name, "SL")), headline=name == "B",
        ),
        Claim(
            f"correct-under-noise-{name}", f"{name} is correct even with a highly noised "
            "trajectory: all angles within the attitude accuracy", "section 4",
            over_settings(always(within_specification(name))),
        ),
        Claim(
            f"noise-only-in-extraction-{name}", "noise affects the plane extraction only: the "
            f"error of {name} does not grow with it", "section 4", over_noise(grows(name, False)),
        ),
        Claim(
            f"better-sensors-{name}", f"better sensors improve {name}", "section 4",
            over_noise(grows(name, True)),
        ),
    )
]  # fmt: skip

REFINEMENT = [
    claim
    for name in PROPOSED
    for claim in (
        Claim(
            f"refinement-error-{name}", f"refinement improves the boresight of {name}",
            "section 4.2", over_settings(less(error(name + REFINED), error(name), "deg")),
            kind="ordering", headline=name == "C",
        ),
        Claim(
            f"refinement-rmse-{name}", f"refinement lowers the RMSE of {name}", "section 4.2",
            over_settings(less(metric(name + REFINED, RMSE), metric(name, RMSE), "m")),
            kind="ordering",
        ),
    )
]  # fmt: skip

PLANES = [
    Claim(
        "planes-not-needed-error", "planes need not be estimated: B's boresight is no worse than "
        "C's", "section 4.1", over_settings(no_worse(error("B"), error("C"), "deg")),
        headline=True,
    ),
    Claim(
        "planes-not-needed-rmse", "planes need not be estimated: B's RMSE is no worse than C's",
        "section 4.1", over_settings(no_worse(metric("B", RMSE), metric("C", RMSE), "m")),
    ),
    Claim(
        "planes-not-needed-time", "B, without planes as unknowns, takes less time than C",
        "section 4.1", over_settings(less(metric("B", "seconds"), metric("C", "seconds"), "s")),
        kind="ordering",
    ),
]  # fmt: skip

MATCHING = [
    Claim(
        "matching-automatic", "matching is automatic once the strips are calibrated: no false "
        "match is left", "section 3.2.2",
        over_settings(always(at_most("all", "false_pairs", 0))), headline=True,
    ),
    Claim(
        "matching-unscreened", "nor does one have to be removed", "section 3.2.2",
        over_settings(always(at_most("all", "rejected", 0))),
    ),
    *(
        Claim(
            f"wrong-match-{name}-below-SL", f"with one wrong match and no screening, {name} is "
            "better than [11]: the constraint is the more reliable one", "section 2.2.3",
            over_settings(mostly_less(without_screening(name), without_screening("SL"))),
            kind="ordering",
        )
        for name in PROPOSED
    ),
]  # fmt: skip

METHOD = [
    valued(
        "density-below", "a strip holds about so many points per area, below the track", DENSITY,
        over_settings(near(metric("all", "density_below"), DENSITY.value, ABOUT_DENSITY, "1/m2")),
    ),
    valued(
        "density-mean", "a strip holds about so many points per area, over its whole swath",
        DENSITY,
        over_settings(near(metric("all", "density"), DENSITY.value, ABOUT_DENSITY, "1/m2")),
    ),
    Claim(
        "small-angle", "the small-angle form does for the boresight: it moves points by less than "
        "a third of the range noise", "Eq. (1)",
        over_settings(below(metric("all", "small_angle_shift"), RANGE_ACCURACY.value / 3, "m")),
    ),
    Claim(
        "closed-form", "the solution is of closed form, the first of its kind: B needs one step "
        "(who was first is not tested)", "section 4",
        over_settings(always(at_most("B", "iterations", 1))), headline=True,
    ),
    Claim(
        "lever-arm", "lever arm and boresight can be estimated together (the paper leaves it to "
        "later work): D finds both horizontal parts to half of what a tape gives", "section 4",
        over_settings(always(lever_arm_found)),
    ),
    Claim(
        "natural-planes", "planes of natural terrain do instead of roofs", "section 4",
        never("the simulated farm offers roofs only; level ground cannot show a turn in yaw"),
    ),
    Claim(
        "vibration", "errors caused by vibration of the platform are attenuated", "section 4.1",
        never(
            "vibration is part of the simulated motion and the GNSS/INS sees it: no error comes "
            "from it alone"
        ),
    ),
]  # fmt: skip

OURS = [
    ours(
        "ours-coverage-D", "D, trajectory errors estimated as a Gauss-Markov process, has honest "
        "sigmas: 95 % intervals hold the truth", "beside section 3.2.1",
        over_settings(coverage("D")), headline=True,
    ),
    ours(
        "ours-standardised-D", "errors of D are as large as their sigmas", "beside section 3.2.1",
        over_settings(standardised("D")),
    ),
    ours(
        "ours-bound-D", "no unbiased estimate from the same points could be much better than D: "
        "errors within 15 % of the Cramer-Rao bound", "beside section 3.2.1",
        over_settings(near_bound("D", 1.15)),
    ),
    *(
        claim
        for factor in (2.0, 0.5)
        for claim in (
            ours(
                f"ours-wrong-prior-{factor:g}-coverage", "with the GNSS/INS specification wrong by "
                f"a factor of {factor:g} and variance components estimated, D's 95 % intervals "
                "hold the truth", "beside section 3.2.1",
                over_settings(coverage(mistaken_name(factor)), preset="mount"),
            ),
            ours(
                f"ours-wrong-prior-{factor:g}-standardised", "and its errors are as large as its "
                f"sigmas (factor {factor:g})", "beside section 3.2.1",
                over_settings(standardised(mistaken_name(factor)), preset="mount"),
            ),
        )
    ),
    *(
        ours(
            f"ours-error-D-below-{name}", f"D finds the boresight better than {called(name)}",
            "beside the Abstract", over_settings(less(error("D"), error(name), "deg")),
            headline=name == "SL",
        )
        for name in ALL
    ),
    ours(
        "ours-A-more-honest", "the centroid constraint's merit is honest sigmas: errors of A are "
        "fewer of its sigmas than those of [11]", "beside section 3.2.1",
        over_settings(mostly_less(metric("A", "nees"), metric("SL", "nees"))), headline=True,
    ),
    *(
        ours(
            f"ours-wrong-match-{name}", f"one wrong match does no harm to {called(name)}",
            "beside section 2.2.4", over_settings(always(unharmed(name, screened=False))),
        )
        for name in ALL
    ),
    *(
        ours(
            f"ours-screened-{name}", f"one wrong match does no harm to {called(name)} after "
            "screening", "beside section 2.2.4",
            over_settings(always(unharmed(name, screened=True))), headline=name == "B",
        )
        for name in ALL
    ),
    *(
        ours(
            f"ours-completes-{name}", f"{called(name)} gives a result in every survey",
            "beside section 3.2.1",
            over_settings(always(lambda s, name=name: (~s.failed(name)).astype(float))),
        )
        for name in (*ALL, "D")
    ),
]  # fmt: skip

BORESIGHT_CLAIMS = [*PRECISION, *ERRORS, *NOISE, *REFINEMENT, *PLANES, *MATCHING, *METHOD, *OURS]


#: Values printed as "about so many percent" are met within this.
ABOUT = 0.1
RMSE_TRUTH = "rmse_truth"

#: What even the true mounting would reach, to be read beside a method's share.
GAINED = {"the true mounting gains": reduced("truth", RMSE)}


def _left_at_best(measure: str) -> Beside:
    return {"the true mounting leaves": left("truth", measure)}


def _rmse(name: str) -> list[Claim]:
    """Share of the RMSE that B or C removes, calibrated and refined."""
    limit, refined = RMSE_REDUCTION[name], name + REFINED
    return [
        valued(
            f"rmse-reduction-{name}",
            f"{name} lowers the RMSE against the reference by more than the stated share",
            limit, over_settings(above(reduced(name, RMSE), limit.value, "share", GAINED)),
            headline=True,
        ),
        valued(
            f"rmse-reduction-{name}-refined",
            f"{name} and refinement lower the RMSE by more than the stated share",
            limit, over_settings(above(reduced(refined, RMSE), limit.value, "share", GAINED)),
        ),
        Claim(
            f"rmse-{name}-below-SL", f"RMSE of {name} below that of [11]", "Fig. 7",
            over_settings(less(metric(name, RMSE), metric("SL", RMSE), "m")),
            kind="ordering", headline=True,
        ),
        Claim(
            f"rmse-truth-{name}-below-SL",
            f"RMSE of {name} below that of [11], against the true planes", "Fig. 7",
            over_settings(less(metric(name, RMSE_TRUTH), metric("SL", RMSE_TRUTH), "m")),
            kind="ordering",
        ),
        Claim(
            f"rmse-{name}-below-A", f"RMSE of {name} below that of A", "Fig. 6",
            over_settings(less(metric(name, RMSE), metric("A", RMSE), "m")), kind="ordering",
        ),
    ]  # fmt: skip


BUDGET = [
    valued(
        "budget-printed", "boresights as large as Table 4's explain so large a fall of the RMSE",
        RMSE_REDUCTION["C"], error_budget, place="Table 4, Fig. 7", headline=True,
    ),
    valued(
        "budget-table4", "with Table 4's boresight, even the true mounting lowers the RMSE so far",
        RMSE_REDUCTION["C"],
        over_settings(
            above(reduced("truth", RMSE_TRUTH), RMSE_REDUCTION["C"].value, "share"), "table4"
        ),
        place="Table 4, Fig. 7",
    ),
]  # fmt: skip

ORDER = [
    *_rmse("B"),
    *_rmse("C"),
    Claim(
        "rmse-C-below-B", "the RMSE of C, both constraints together, is slightly below B's",
        "Fig. 7", over_settings(less(metric("C", RMSE), metric("B", RMSE), "m")), kind="ordering",
    ),
    Claim(
        "rmse-B-like-C", "B and C perform alike", "Fig. 6",
        over_settings(similar(metric("B", RMSE), metric("C", RMSE), "m")),
    ),
    Claim(
        "SL-alone", "[11] alone does not do for UAV data: its RMSE stays above the noise floor",
        "section 5", over_settings(above(over_floor("SL"), 1 + MARGIN, "1")), headline=True,
    ),
    Claim(
        "constraint-brings-most", "most of the gain comes from the centroid constraint: [11] "
        "alone gains less than half of what B does", "section 3.2.3",
        over_settings(
            below(
                lambda s: (s.of("before", RMSE) - s.of("SL", RMSE))
                / (s.of("before", RMSE) - s.of("B", RMSE)).mean(), 0.5, "share",
            ), "mount",
        ),
    ),
]  # fmt: skip

SHARES = [
    valued(
        "rmse-left-SL", "[11] leaves less than the stated share of the RMSE", RMSE_LEFT_BY_SL,
        over_settings(
            below(left("SL", RMSE), RMSE_LEFT_BY_SL.value, "share", _left_at_best(RMSE))
        ),
    ),
    *(
        valued(
            f"table5-{reading}-{name}",
            f"{called(name)} leaves about the stated share of the error, read as {words}",
            TABLE5[key],
            over_settings(
                near(
                    left(name, measure), TABLE5[key].value, ABOUT, "share", _left_at_best(measure)
                )
            ),
            headline=reading == "rmse",
        )
        for name, key in {"SL": "SL", "B": "proposed"}.items()
        for reading, measure, words in (
            ("rmse", RMSE, "RMSE"), ("mean", "mae_reference", "mean absolute distance")
        )
    ),
    valued(
        "share-contradiction", "Fig. 8 and Table 5 agree on the share that [11] leaves",
        TABLE5["SL"], shares_agree, place="Fig. 8, Table 5", headline=True,
    ),
    valued(
        "share-readings", "RMSE and mean distance are different enough for both to be true",
        TABLE5["SL"],
        over_settings(
            above(
                lambda s: s.left("SL", "mae_reference") - s.left("SL", RMSE),
                TABLE5["SL"].value - RMSE_LEFT_BY_SL.value, "share",
            )
        ),
        place="Fig. 8, Table 5",
    ),
    valued(
        "systematic-corrected", "the centroid constraint corrects about the stated share of the "
        "systematic error, read as the boresight's", SYSTEMATIC_CORRECTED,
        over_settings(
            near(
                lambda s: 1 - s.error("B") / s.error("before"), SYSTEMATIC_CORRECTED.value,
                ABOUT, "share",
            )
        ),
    ),
]  # fmt: skip

ACCURACY_CLAIMS = [*BUDGET, *ORDER, *SHARES]


#: A mean further from zero than so many honest sigmas is a systematic error.
CENTRED_SIGMAS = 1.96
OFFSET_MAX = "offset_max_reference"


def _shape(name: str) -> Beside:
    """What a KS distance is read with."""
    return {
        "skewness": metric(name, "skewness_reference"),
        "excess kurtosis": metric(name, "kurtosis_reference"),
        "limit if every point were a sample": critical_ks_of_points,
    }


HISTOGRAMS = [
    claim
    for name in ("SL", "B", "C")
    for claim in (
        Claim(
            f"normal-{name}", f"point-to-plane distances of {called(name)} are near normal",
            "Fig. 8", over_settings(
                below(metric(name, "ks_reference"), critical_ks, "1", _shape(name))
            ),
            kind="pattern", headline=name == "B",
        ),
        Claim(
            f"centred-{name}",
            f"point-to-plane distances of {called(name)} are centred on zero, in units of what "
            "trajectory errors alone move their mean", "Fig. 8",
            over_settings(
                below(centred(name), CENTRED_SIGMAS, "1", {"true mounting": centred("truth")})
            ), kind="pattern",
        ),
    )
] + [
    Claim(
        f"normal-means-eliminated-{name}", f"a near normal histogram of {name} means that the "
        "boresight's error is gone", "section 3.2.3", over_settings(always(not_deceived(name))),
        headline=name == "C",
    )
    for name in ("B", "C")
]  # fmt: skip


def _offset(scenario: str) -> Quantity:
    return metric(scenario, "offset_mean_reference")


_CALIBRATED = largest(*(metric(name, OFFSET_MAX) for name in "ABC"))
_OTHER_OFFSETS = {
    "before": metric("before", OFFSET_MAX), "with [11]": metric("SL", OFFSET_MAX),
    "with the true mounting": metric("truth", OFFSET_MAX),
}  # fmt: skip
_REFINED = largest(*(metric(name + REFINED, OFFSET_MAX) for name in "ABC"))
OFFSETS = [
    valued(
        "offset-calibrated", "vertical offsets at the virtual points are small after calibration "
        "by A, B and C", OFFSET_AFTER_CALIBRATION,
        over_settings(
            below(_CALIBRATED, OFFSET_AFTER_CALIBRATION.value, "m", _OTHER_OFFSETS)
        ), headline=True,
    ),
    valued(
        "offset-refined", "and smaller after refinement", OFFSET_AFTER_REFINEMENT,
        over_settings(below(_REFINED, OFFSET_AFTER_REFINEMENT.value, "m", _OTHER_OFFSETS)),
        headline=True,
    ),
    *(
        Claim(
            f"offset-{name}-refinement-helps", f"refinement lowers the vertical offsets of {name}",
            "Fig. 11",
            over_settings(less(_offset(name + REFINED), _offset(name), "m")),
            kind="ordering",
        )
        for name in "ABC"
    ),
    *(
        Claim(
            f"offset-{name}-below-SL", f"vertical offsets of {name}, refined, below [11]'s",
            "Fig. 11",
            over_settings(less(_offset(name + REFINED), _offset("SL"), "m")),
            kind="ordering",
        )
        for name in "ABC"
    ),
]  # fmt: skip

NO_CAMPAIGN = [
    Claim(
        f"no-campaign-{name}", f"{name} lowers the boresight's error without control on the "
        "ground", "section 2.2.3", over_settings(less(error(name), error("before"), "deg")),
        kind=STATEMENT,
    )
    for name in "ABC"
]  # fmt: skip

SHAPE_CLAIMS = [*HISTOGRAMS, *OFFSETS, *NO_CAMPAIGN]


CLAIMS: tuple[Claim, ...] = (*ACCURACY_CLAIMS, *SHAPE_CLAIMS, *BORESIGHT_CLAIMS)
HEADLINES = tuple(claim.id for claim in CLAIMS if claim.headline)
COLUMNS = (
    "id", "claim", "place", "kind", "paper", "measured", "low", "high", "unit", "seeds",
    "verdict", "condition",
)  # fmt: skip

__all__ = [
    "CLAIMS",
    "COLUMNS",
    "HEADLINES",
    "VERDICTS",
    "Claim",
    "Finding",
    "ledger",
    "markdown_summary",
    "update_between_markers",
]


def ledger(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each of `CLAIMS`, from tidy ``rows`` of a study (`tables.COLUMNS`)."""
    evidence = Evidence(rows)
    return pd.DataFrame([_line(claim, evidence) for claim in CLAIMS], columns=list(COLUMNS))


def markdown_summary(ledger: pd.DataFrame) -> str:
    """The most telling claims as a Markdown table, and how many got which verdict."""
    return markdown_table(ledger, HEADLINES)


def _line(claim: Claim, evidence: Evidence) -> dict:
    finding = claim.rule(evidence)
    paper = claim.paper.value if claim.paper else np.nan
    unit = finding.unit or (claim.paper.unit if claim.paper else "")
    line = {"claim": claim.text, "place": claim.place, "kind": claim.kind, "paper": paper}
    return {"id": claim.id, **line, **asdict(finding), "unit": unit}
