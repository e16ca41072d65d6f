"""The ledger: every testable claim, judged from the rows of a study by a written rule.

No verdict is typed: `verdicts` says how settings make one, `judges` and `honesty` how surveys make
a setting's, `accuracy`, `shape` and `boresight` list the claims.
"""

from dataclasses import asdict

import numpy as np
import pandas as pd

from paperrepro.claims import accuracy, boresight, shape
from paperrepro.claims.claim import Claim
from paperrepro.claims.evidence import Evidence
from paperrepro.claims.rendering import markdown_table, update_between_markers
from paperrepro.claims.verdicts import VERDICTS, Finding

CLAIMS: tuple[Claim, ...] = (*accuracy.CLAIMS, *shape.CLAIMS, *boresight.CLAIMS)
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
