"""MOVED"""

import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd

COLUMNS = (
    "artefact", "scenario", "preset", "profile", "noise_scale", "seed",
    "metric", "unit", "value", "sigma",
)  # fmt: skip


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

    def rows(self, artefact: str, unit: str, values: Mapping[tuple[str, str], float]) -> list[dict]:
        """Rows of ``values``, a number for each (scenario, metric)."""
        return [
            self.row(artefact, scenario, metric, unit, value)
            for (scenario, metric), value in values.items()
        ]


def frame(rows: Iterable[Mapping]) -> pd.DataFrame:
    """Rows as a table with the columns in their order."""
    return pd.DataFrame(list(rows), columns=list(COLUMNS))


def write_rows(rows: Iterable[Mapping], folder: str | Path, name: str) -> Path | None:
    """Write ``folder/rows/name.csv``; an empty ``folder`` writes nothing."""
    return write_csv(frame(rows), Path(folder) / "rows", name) if str(folder) else None


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
