"""Tidy rows, and the tables made from them.

A row says one number: ``artefact, scenario, preset, profile, noise_scale, seed, metric, unit,
value, sigma``. Tables, figures and texts read rows.
"""

import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from paperrepro.adjustment.result import CalibrationResult
from paperrepro.published import TABLE4

COLUMNS = (
    "artefact", "scenario", "preset", "profile", "noise_scale", "seed", "metric", "unit", "value", "sigma",
)  # fmt: skip
ANGLES = ("omega", "phi", "kappa")


@dataclass(frozen=True)
class Run:
    """Which simulated survey a row speaks of."""

    preset: str
    profile: str
    noise_scale: float
    seed: int

    def row(
        self,
        artefact: str,
        scenario: str,
        metric: str,
        unit: str,
        value: float,
        sigma: float = np.nan,
    ) -> dict:
        """One tidy row."""
        return {
            "artefact": artefact, "scenario": scenario, **asdict(self),
            "metric": metric, "unit": unit, "value": float(value), "sigma": float(sigma),
        }  # fmt: skip


def frame(rows: Iterable[Mapping]) -> pd.DataFrame:
    """Rows as a table with the columns in their order."""
    return pd.DataFrame(list(rows), columns=list(COLUMNS))


def calibration_rows(
    run: Run, results: Mapping[str, CalibrationResult], truth_rad: np.ndarray
) -> list[dict]:
    """Rows of Table 4: each angle's estimate and sigma, the truth, and what tells of the adjustment."""
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
    """Table 4 for readers: the paper's value, our truth, our estimate, its sigma and its error."""
    rows = rows[(rows.artefact == "table4") & rows.metric.isin(ANGLES)]
    truth = rows[rows.scenario == "truth"].set_index("metric").value
    lines = []
    for row in rows[rows.scenario != "truth"].itertuples():
        paper = TABLE4.get((row.scenario, row.metric))
        lines.append(
            {
                "scenario": row.scenario,
                "angle": row.metric,
                "paper_deg": paper.value if paper else np.nan,
                "paper_sigma_deg": paper.sigma if paper else np.nan,
                "truth_deg": truth[row.metric],
                "estimate_deg": row.value,
                "sigma_deg": row.sigma,
                "error_deg": row.value - truth[row.metric],
                "error_in_sigma": (row.value - truth[row.metric]) / row.sigma,
            }
        )
    return pd.DataFrame(lines)


def write_csv(table: pd.DataFrame, folder: str | Path, name: str) -> Path | None:
    """Write ``folder/name.csv`` whole or not at all; an empty ``folder`` writes nothing."""
    if not str(folder):
        return None
    path = Path(folder) / f"{name}.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".csv.part")
    table.to_csv(part, index=False, float_format="%.10g")
    os.replace(part, path)
    return path
