"""What the stages should reach, and whether they do, from the rows alone."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd


@dataclass(frozen=True)
class Target:
    """``measured`` takes the table of rows and gives a number, which must be at most ``limit``, or
    at least if ``at_least``."""

    what: str
    limit: float
    measured: Callable[[pd.DataFrame], float]
    at_least: bool = False

    def judged(self, rows: pd.DataFrame) -> dict:
        value = self.measured(rows)
        met = value >= self.limit if self.at_least else value <= self.limit
        sign = ">=" if self.at_least else "<="
        return {"target": self.what, "limit": f"{sign} {self.limit:g}", "measured": value,
                "met": "not measured" if np.isnan(value) else "yes" if met else "no"}  # fmt: skip


def _of(column: str, stage: str, peer: str | None = None, every: int | None = 1):
    """``column`` of one row; of the densest survey that has a peer if ``every`` is None."""

    def measured(rows: pd.DataFrame) -> float:
        chosen = rows[rows.stage == stage]
        chosen = chosen[chosen.peer == peer] if peer else chosen
        chosen = chosen[chosen.every == every] if every else chosen.sort_values("every")
        return float(chosen[column].iloc[0]) if len(chosen) else np.nan

    return measured


def _rate(rows: pd.DataFrame) -> float:
    chosen = rows[(rows.stage == "simulate") & (rows.every == 1)]
    return float((chosen.points / chosen.seconds).iloc[0]) if len(chosen) else np.nan


def exponent(points: np.ndarray, seconds: np.ndarray) -> float:
    """Slope of the logarithm of ``seconds`` against that of ``points``."""
    if len(points) < 2:
        return float("nan")
    return float(np.polyfit(np.log(points), np.log(seconds), 1)[0])


def _growth(stage: str):
    def measured(rows: pd.DataFrame) -> float:
        chosen = rows[rows.stage == stage].drop_duplicates("every")
        return exponent(chosen.points.to_numpy(float), chosen.seconds.to_numpy())

    return measured


def _greatest_growth(rows: pd.DataFrame) -> float:
    """Of the stages of one strip: 0.2, 0.8 and 3 million points."""
    return max(_growth(stage)(rows) for stage in OF_A_STRIP)


def _growth_of(begin: str, column: str = "seconds"):
    """With points, of all stages whose names begin so."""

    def measured(rows: pd.DataFrame) -> float:
        chosen = rows[rows.stage.str.startswith(begin)].reindex(columns=["points", column])
        return exponent(chosen.points.to_numpy(float), chosen[column].to_numpy())

    return measured


def _paper_profile_over_survey(rows: pd.DataFrame) -> float:
    """The whole reproduction at full density over the method's stages for one survey."""
    return _of("seconds", "paper profile")(rows) / _of("seconds", "whole method")(rows)


def _greatest_over_icp(rows: pd.DataFrame) -> float:
    """Of the pairs of strips beside a rigid ICP."""
    return float(rows[rows.stage.str.startswith("strips ")].agreement.max())


#: Stages that are timed on one strip.
OF_A_STRIP = ("georeference", "outliers", "ground", "normals and growing", "roofs")

TARGETS = (
    Target("simulate, points/s", 5e6, _rate, at_least=True),
    Target("georeference / memory copy", 2.0, _of("ratio", "georeference", "memory copy")),
    Target("outliers / Open3D", 0.18, _of("ratio", "outliers")),
    Target("outliers, exponent in points", 1.05, _growth("outliers")),
    Target("outliers, Jaccard", 1.0, _of("agreement", "outliers"), at_least=True),
    Target("ground, s", 0.35, _of("seconds", "ground")),
    Target("normals and growing / Open3D", 0.5, _of("ratio", "normals and growing")),
    *(
        target
        for name in ("SL", "A", "B", "C")
        for target in (
            Target(f"{name} / SciPy", 0.1, _of("ratio", name, "SciPy", None)),
            Target(f"{name}, difference, rad", 1e-8, _of("agreement", name, "SciPy", None)),
        )
    ),
    Target("distance between strips / simpleicp", 1.0, _greatest_over_icp),
    Target("D, exponent in flight time", 1.05, _growth_of("D, ")),
    Target("D, exponent in a village's points", 1.15, _growth_of("village")),
    Target("D, memory, the same", 1.1, _growth_of("village", "memory_gib")),
    Target("stages of a strip, exponent", 1.05, _greatest_growth),
    Target("whole method, exponent in points", 1.05, _growth("whole method")),
    Target("whole method, memory, GiB", 4.0, _of("memory_gib", "whole method")),
    Target("first run, compiling, s", 8.0, _of("seconds", "compiling", every=None)),
    Target("import, s", 0.2, _of("seconds", "import", every=None)),
    Target("first words of a command, s", 0.3, _of("seconds", "first words", every=None)),
    Target("reading / laspy", 1.5, _of("ratio", "reading")),
    Target("quick profile, s", 40.0, _of("seconds", "quick profile", every=16)),
    Target("paper profile / whole method", 2.5, _paper_profile_over_survey),
    Target("paper profile, memory, GiB", 3.0, _of("memory_gib", "paper profile")),
    Target("sweep, 2 workers / 1", 0.55, _of("ratio", "sweep, 2 workers", every=None)),
)


def judged(rows: pd.DataFrame) -> pd.DataFrame:
    """One line a target."""
    return pd.DataFrame([target.judged(rows) for target in TARGETS])
