"""Tidy rows: one number of one survey each, by names that tables, claims and figures share."""

import ast
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from paperrepro._files import whole_file
from paperrepro.errors import BadInput

#: What names a row, and what it says.
COLUMNS = (
    "artefact", "scenario", "preset", "profile", "noise_scale", "errors", "seed",
    "metric", "unit", "value", "sigma",
)  # fmt: skip
#: Artefact of all that is measured of a simulated survey.
ARTEFACT = "study"
#: Metric of a row that stands for what could not be measured; its scenario says where it failed.
FAILED = "failed"
#: Scenario of the Cramer-Rao bound.
BOUND = "bound"
#: Endings of scenarios' names: after the refinement; with one wrong match, as it is and screened.
REFINED, WRONG, SCREENED = " refined", " wrong", " screened"
#: The paper's estimators, by how it calls them, with so few points a face that their sigmas are of
#: the size that it prints: as its claims are judged. And with all points.
FEW = {"SL": "SL 3", "A": "A", "B": "B 3", "C": "C 3"}
MANY = {"SL": "SL", "A": "A all", "B": "B", "C": "C"}
#: B on centroids alone; [11] as if the scanner had no range offsets.
CENTROIDS, WITHOUT_OFFSETS = "B 0", "SL without offsets"
#: Further numbers of points a face, where sigma is looked at as a function of it.
BETWEEN = ("SL 30", "A 3", "A 30", "B 30", "C 30", "D 3", "D 30")
#: Of each estimator, its variants by points a face; None: all.
POINTS = {
    "SL": (("SL 3", 3), ("SL 30", 30), ("SL", None)),
    "A": (("A", 0), ("A 3", 3), ("A 30", 30), ("A all", None)),
    "B": (("B 0", 0), ("B 3", 3), ("B 30", 30), ("B", None)),
    "C": (("C 3", 3), ("C 30", 30), ("C", None)),
    "D": (("D 3", 3), ("D 30", 30), ("D", None)),
}
#: Endings: after the refinement of each pair of strips for itself, and by four planes alone.
PER_PAIR, BY_FOUR = " refined per pair", " refined by four planes"
#: Of `FEW`: A with the pairs of strips that Table 1 lists; [11] with roofs of one direction, and
#: with as many of any.
LISTED_PAIRS, ONE_DIRECTION, AS_MANY = "A listed pairs", "SL 3 one direction", "SL 3 as many"
#: Scenario of the paper's steps before the adjustment.
SEGMENTATION = "segmentation"
#: Table 1's pairs of strips.
TABLE1_PAIRS = (
    ("F1", "F2"), ("F2", "F3"), ("F3", "F4"), ("F2", "F4"),
    ("F1", "F5"), ("F5", "F6"), ("F1", "F6"), ("F7", "F8"),
)  # fmt: skip
#: Scenario D with the lever arm as an unknown; and under the noise that it finds in the data.
LEVER_ARM, FOUND = "D lever arm", "D noise found"
#: The latter's mounting together with its trajectory; and the true mounting.
ADJUSTED, TRUTH = "D trajectory adjusted", "truth"
#: Significant digits of a study's numbers.
DIGITS = 4
#: Errors of a survey as the specifications say.
SPECIFIED = "specified"
#: Kinds of errors by the parameters of the simulation. All but ``smoother`` and ``outage`` have the
#: size of the specification, where one covers them; for the rest the size stands here.
ERRORS = {
    SPECIFIED: {},
    "smoother": {"navigation": "smoother"},
    "constant": {"navigation": "constant"},
    "slow": {"navigation": "slow"},
    "two-scale": {"navigation": "two-scale"},
    "steps": {"navigation": "steps"},
    "outage": {"navigation": "outage"},
    "vibration": {"unseen_vibration_deg": 0.05},
    "clock": {"clock_delay_s": 0.005},
    "lever arm": {"lever_arm_sigma_m": 0.02},
    "beams": {"beam_elevation_sigma_deg": 0.05, "beam_azimuth_sigma_deg": 0.05},
    "range": {"range_scale_ppm": 300.0, "range_noise_growth": 1.0},
    "roofs": {"roof_surface": "mixed"},
    "natural": {"scene": "fields", "terrain": "natural", "ground_roughness_m": 0.03},
    "together": {
        "navigation": "two-scale", "unseen_vibration_deg": 0.01, "clock_delay_s": 0.002,
        "lever_arm_sigma_m": 0.01, "beam_elevation_sigma_deg": 0.02,
        "beam_azimuth_sigma_deg": 0.02, "range_scale_ppm": 300.0, "range_noise_growth": 1.0,
        "roof_surface": "mixed",
    },
}  # fmt: skip


def mistaken_name(factor: float) -> str:
    """Scenario D with a specification of the GNSS/INS that is wrong by ``factor``."""
    return f"D prior x{factor:g}"


@dataclass(frozen=True)
class SurveyKey:
    """Which simulated survey a row speaks of; ``errors``: of which kind they are."""

    preset: str
    profile: str
    noise_scale: float
    seed: int
    errors: str = SPECIFIED

    def row(
        self, artefact: str, scenario: str, metric: str, unit: str, value: float,
        sigma: float = np.nan,
    ) -> dict:  # fmt: skip
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


def require_declared(notebook: Mapping) -> None:
    """Raise `BadInput` where papermill has set what the parameters' cell does not declare, of a
    notebook whose names are ``notebook``, its ``globals()``: papermill itself only warns."""
    cells = [cell for cell in notebook.get("In", ()) if cell.startswith("# Parameters\n")]
    given = [node for cell in cells for node in ast.walk(ast.parse(cell))]
    declared = notebook["__annotations__"]
    for node in given:
        set_here = isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        if set_here and node.id not in declared:
            names = ", ".join(declared)
            raise BadInput(f"{node.id}: no parameter of this notebook; it has {names}")


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
    with whole_file(path) as part:
        table.to_csv(part, index=False, float_format="%.10g")
    return path


def rounded(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows with `DIGITS` significant digits: a study is kept, and what chance decides is not
    written."""
    short = {
        column: [float(f"{number:.{DIGITS}g}") for number in rows[column]]
        for column in ("value", "sigma")
    }
    return rows.assign(**short)


def read_study(*paths: str | Path) -> pd.DataFrame:
    """Rows of studies and sweeps that were written before; none where a path is no file. What
    several have of a survey is taken from the first."""
    found = [_read(path) for path in paths if Path(path).is_file()]
    if not found:
        return frame([])
    rows = pd.concat(found, ignore_index=True)
    rows = rows.astype({"noise_scale": float, "value": float, "sigma": float})
    return rows.drop_duplicates(list(COLUMNS[:-3]), ignore_index=True)


def _read(path: str | Path) -> pd.DataFrame:
    """Rows of a file; those written before errors had kinds are of the specified one."""
    table = pd.read_csv(path)
    if "errors" not in table:
        table["errors"] = SPECIFIED
    return table[list(COLUMNS)]
