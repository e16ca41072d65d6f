"""The ledger as text: a short table, put between markers of a file."""

import os
from collections.abc import Collection
from pathlib import Path

import numpy as np
import pandas as pd

from paperrepro.claims.evidence import Interval
from paperrepro.claims.verdicts import VERDICTS, shown, span


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
