"""Tables for readers: Tables 2 and 4 beside the paper's, and the ledger in short for a text."""

import itertools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from paperrepro._files import write_text
from paperrepro.errors import BadInput
from paperrepro.frames import ANGLES
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.roofs import RoofParameters
from paperrepro.paper.claims import HEADLINES, OUR_HEADLINES
from paperrepro.paper.numbers import shown
from paperrepro.paper.published import TABLE2, TABLE4, TABLE5
from paperrepro.paper.verdicts import (
    CONDITIONS,
    FAILS,
    FOLLOWS,
    HOLDS,
    OURS,
    SAYS,
    UNDECIDED,
    UNTESTED,
)  # fmt: skip
from paperrepro.study.rows import FEW, MANY, SurveyKey
from paperrepro.study.statistics import Evidence, TooLittle


def calibration_rows(
    run: SurveyKey, results: Mapping[str, CalibrationResult], truth_rad: np.ndarray
) -> list[dict]:
    """Rows of Table 4: each angle's estimate and sigma, the truth, and the adjustment's figures."""
    rows = []
    for name, result in results.items():
        for angle, value, sigma in zip(
            ANGLES, np.rad2deg(result.boresight), np.rad2deg(result.sigma), strict=True
        ):
            rows.append(run.row("table4", name, angle, "deg", value, sigma))
        rows.append(run.row("table4", name, "sigma0", "1", result.sigma0))
        rows.append(run.row("table4", name, "conditions", "1", result.n_conditions))
        rows.append(run.row("table4", name, "planes", "1", result.n_planes))
        rows.append(run.row("table4", name, "iterations", "1", result.iterations))
    for angle, value in zip(ANGLES, np.rad2deg(truth_rad), strict=True):
        rows.append(run.row("table4", "truth", angle, "deg", value))
    return rows


def table4(rows: pd.DataFrame) -> pd.DataFrame:
    """Table 4 for readers, a line for each estimator and angle: the paper's value, our truth, our
    estimate with its sigma and error, from few points a face and, ``all_``, from all of them."""
    rows = rows[(rows.artefact == "table4") & rows.metric.isin(ANGLES)]
    known = rows.set_index(["scenario", "metric"])
    lines = []
    for x, angle in itertools.product((*FEW, "D"), ANGLES):
        if (FEW.get(x, x), angle) not in known.index:
            continue
        truth, paper = known.value["truth", angle], TABLE4.get((x, angle))
        line = {
            "scenario": x, "angle": angle,
            "paper_deg": paper.value if paper else np.nan,
            "paper_sigma_deg": paper.sigma if paper else np.nan, "truth_deg": truth,
        }  # fmt: skip
        for start, reading in {"": FEW, "all_": MANY}.items():
            name = reading.get(x, x if not start else "")
            value, sigma = np.nan, np.nan
            if (name, angle) in known.index:
                value, sigma = known.loc[(name, angle), ["value", "sigma"]]
            line |= {
                f"{start}estimate_deg": value, f"{start}sigma_deg": sigma,
                f"{start}error_deg": value - truth,
                f"{start}error_in_sigma": (value - truth) / sigma,
            }  # fmt: skip
        lines.append(line)
    return pd.DataFrame(lines)


def table5(left: pd.DataFrame, study: pd.DataFrame) -> pd.DataFrame:
    """Table 5 for readers, a line for each method: the shares that it leaves in one survey,
    ``left`` by scenario; the share of the mean distance over the surveys of a ``study``, its mean
    and the range of nine in ten; and the paper's."""
    table = left.copy()
    for name in ("mean", "low", "high"):
        table[f"surveys_{name}"] = np.nan
    try:
        evidence = Evidence(study)
        surveys = evidence.surveys(evidence.settings("mount")[0])
        for x in table.index:
            share = surveys.left(FEW.get(x, x), "mae_reference").dropna()
            spread = [share.mean(), *share.quantile([0.05, 0.95])]
            table.loc[x, ["surveys_mean", "surveys_low", "surveys_high"]] = spread
    except TooLittle:
        pass
    table["paper"] = [TABLE5.get(x, TABLE5["proposed"] if x in "BC" else None) for x in table.index]
    table["paper"] = [value.value if value else np.nan for value in table.paper]
    table.index = [f"{x} (proposed)" if x in "BC" else x for x in table.index]
    return table.rename_axis("method").reset_index()


#: How Table 2 is read, or why another value is used; printed beside it.
READINGS = {
    "outliers.k": "not printed",
    "outliers.alpha": "not printed; the spread is that of density: faces far from the track stay",
    "ground.base_cells": "text: linear windows 2kb+1; Table 2: exponential; both are offered",
    "ground.largest_window_m": "not printed; wider than the widest building",
    "ground.threshold_m": "not printed; more than a wrong boresight smears the ground",
    "cell_m": "not printed; at 300 points/m² a face has 10 000s, so 40-500 needs thinning",
    "ransac.tolerance_m": "coarse: the fan of beams makes roofs thick",
    "ransac.max_sets": "read as planes per object",
    "growing.angle_deg": "normals of 17 noisy points scatter by a degree",
    "growing.size.1": "the largest roofs have more",
    "growing.max_gap_m": "read as the reach beyond which a point is not of the segment",
}


def table2(fine: RoofParameters, coarse: RoofParameters) -> pd.DataFrame:
    """Table 2 for readers: the paper's value, ours in the last and in the first pass, and how it is
    read. Columns parameter, paper, fine, coarse, reading."""
    names = {*TABLE2, *READINGS}
    lines = []
    for name in sorted(names):
        printed = TABLE2.get(name)
        lines.append(
            {
                "parameter": name,
                "paper": f"{printed.value:g}" if printed else "",
                "fine": f"{_field(fine, name):g}",
                "coarse": f"{_field(coarse, name):g}",
                "reading": READINGS.get(name, ""),
            }
        )
    return pd.DataFrame(lines)


def _field(params: RoofParameters, name: str) -> float:
    """The value of "group.field" or "group.field.place"."""
    value = params
    for part in name.split("."):
        value = value[int(part)] if part.isdigit() else getattr(value, part)
    return value


def markdown_summary(ledger: pd.DataFrame) -> str:
    """The paper's main promises in a `ledger` and three claims of ours, one of them with the worst
    verdict, as a Markdown table, under a sentence on what came out of all."""
    lines = [what_came_out(ledger), "", "| claim | paper | here | verdict |", "|---|---|---|---|"]
    lines += [
        f"| {line.claim} ({line.place}) | {printed_value(line.paper, line.unit)} | {line.values} "
        f"| {line.verdict} |"
        for line in headlines(ledger).fillna({"values": ""}).itertuples()
    ]
    return "\n".join(lines) + "\n"


def headlines(ledger: pd.DataFrame) -> pd.DataFrame:
    """Lines of the short table."""
    ours = ledger[(ledger.kind == OURS) & ~ledger.id.isin(OUR_HEADLINES)]
    rank = {FAILS: 0, CONDITIONS: 1, UNDECIDED: 2, HOLDS: 3, UNTESTED: 4}
    worst = ours.loc[ours.verdict.map(rank).sort_values(kind="stable").index].id[:1]
    shown = [*HEADLINES, *OUR_HEADLINES, *worst]
    return ledger.set_index("id").reindex(shown).dropna(subset="claim").reset_index()


#: How the number of claims with a verdict reads.
SAID = {
    HOLDS: "hold", CONDITIONS: "hold under conditions", FAILS: "do not hold",
    UNDECIDED: "are undecided", UNTESTED: "cannot be tested here",
}  # fmt: skip


def what_came_out(ledger: pd.DataFrame) -> str:
    """The verdicts counted, in words, by whose the claims are."""
    whose = {
        SAYS: "sentences of the paper",
        FOLLOWS: "that follow from what it prints",
        OURS: "claims of ours",
    }
    parts = []
    for kind, words in whose.items():
        given = ledger[ledger.kind == kind].verdict
        counts = {said: (given == name).sum() for name, said in SAID.items()}
        listed = ", ".join(f"{n} {said}" for said, n in counts.items() if n)
        parts.append(f"of {len(given)} {words} {listed}")
    return f"{'; '.join(parts)}.".replace("of", "Of", 1)


def printed_value(value: float, unit: str) -> str:
    """The value that the paper prints, if any; shares in percent."""
    if not np.isfinite(value):
        return ""
    return shown(value, "share" if unit == "1" and value <= 1 else unit)


def update_between_markers(path: str | Path, name: str, text: str) -> bool:
    """Put ``text`` between ``<!-- name:begin -->`` and ``<!-- name:end -->`` of a file.

    Returns whether that changed it. Raises `BadInput` where the markers are not there once and in
    order.
    """
    path = Path(path)
    before = path.read_text(encoding="utf-8")
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    if before.count(begin) != 1 or before.count(end) != 1 or before.find(end) < before.find(begin):
        raise BadInput(
            f"{path}: expected {begin} and after it {end}, each once; put them where the text goes"
        )
    head, rest = before.split(begin)
    after = f"{head}{begin}\n{text.rstrip()}\n{end}{rest.split(end)[1]}"
    if after == before:
        return False
    write_text(path, after)
    return True
