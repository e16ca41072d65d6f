"""What the sigma of each scenario promise and what they hold, over many surveys."""

import numpy as np
import pandas as pd

from paperrepro.claims.evidence import TWO_SIDED
from paperrepro.study_rows import ARTEFACT, BOUND
from paperrepro.tables import ANGLES

_SETTING = ["preset", "profile", "noise_scale"]


def promises(rows: pd.DataFrame, scenarios: tuple[str, ...]) -> pd.DataFrame:
    """A line for each setting, scenario and angle of the ``rows`` of a study.

    Columns: preset, profile, noise_scale, scenario, angle; ``surveys``; ``rms_deg`` of the error;
    ``sigma_deg``, the RMS of the formal sigma; ``bound_deg``, that of the Cramer-Rao bound on the
    same points, and ``over_bound``, the error's RMS over it; ``coverage`` of the 95 % intervals;
    ``nees``, the mean squared error in the unit of the full covariance of all three angles, over
    their number.
    """
    rows = rows[rows.artefact == ARTEFACT]
    nees = _of_metric(rows, "nees").groupby([*_SETTING, "scenario"]).value.mean()
    lines = []
    for angle in ANGLES:
        errors = _of_metric(rows, f"error_{angle}").dropna(subset="sigma")
        bound = _of_metric(rows[rows.scenario == BOUND], f"bound_{angle}")
        bound = bound.set_index([*_SETTING, "seed"]).value.rename("bound")
        errors = errors.join(bound, on=[*_SETTING, "seed"])
        for key, group in errors.groupby([*_SETTING, "scenario"]):
            if key[-1] in scenarios:
                lines.append([*key, angle, *_promise(group), nees.get(key, np.nan)])
    names = ["surveys", "rms_deg", "sigma_deg", "bound_deg", "over_bound", "coverage", "nees"]
    table = pd.DataFrame(lines, columns=[*_SETTING, "scenario", "angle", *names])
    table["scenario"] = pd.Categorical(table.scenario, scenarios, ordered=True)
    return table.sort_values([*_SETTING, "scenario"], kind="stable", ignore_index=True)


def _of_metric(rows: pd.DataFrame, metric: str) -> pd.DataFrame:
    return rows[rows.metric == metric]


def _promise(group: pd.DataFrame) -> list[float]:
    known = group.dropna(subset="bound")
    bound = _rms(known.bound)
    held = group.value.abs() <= TWO_SIDED * group.sigma
    over = _rms(known.value) / bound if len(known) else np.nan
    return [len(group), _rms(group.value), _rms(group.sigma), bound, over, held.mean()]


def _rms(values: pd.Series) -> float:
    return float(np.sqrt(np.square(values).mean()))
