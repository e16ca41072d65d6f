"""What many surveys say: errors with their intervals, errors against sigmas, verdicts."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from paperrepro.claims.evidence import bootstrap
from paperrepro.figures import SCENARIO_COLOURS, scenario_name
from paperrepro.study import ARTEFACT
from paperrepro.tables import ANGLES

#: Of the verdicts: holds, under conditions, does not hold, not testable here.
VERDICT_COLOURS = ("#009e73", "#e69f00", "#d55e00", "#b3b3b3")


def error_table(rows: pd.DataFrame, scenarios: tuple[str, ...]) -> pd.DataFrame:
    """Size of the boresight error of every survey: preset, noise_scale, seed, scenario, error_deg
    and, over the three angles, sigma_deg."""
    chosen = (
        (rows.artefact == ARTEFACT)
        & rows.metric.isin([f"error_{angle}" for angle in ANGLES])
        & rows.scenario.isin(scenarios)
    )
    squares = rows[chosen].assign(value=rows.value**2, sigma=rows.sigma**2)
    keys = ["preset", "noise_scale", "seed", "scenario"]
    size = np.sqrt(squares.groupby(keys)[["value", "sigma"]].sum(min_count=len(ANGLES)))
    return size.rename(columns={"value": "error_deg", "sigma": "sigma_deg"}).reset_index()


def mean_table(
    table: pd.DataFrame, scenarios: tuple[str, ...], column: str = "error_deg"
) -> pd.DataFrame:
    """Mean of ``column`` over the seeds with its 95 % interval: preset, noise_scale, scenario,
    surveys, mean, low, high; scenarios in their order."""
    lines = []
    for key, values in table.dropna(subset=column).groupby(["preset", "noise_scale", "scenario"]):
        mean = bootstrap(values[column].to_numpy())
        lines.append([*key, len(values), mean.value, mean.low, mean.high])
    names = ["preset", "noise_scale", "scenario", "surveys", "mean", "low", "high"]
    out = pd.DataFrame(lines, columns=names)
    out["scenario"] = pd.Categorical(out.scenario, scenarios, ordered=True)
    return out.sort_values(["preset", "noise_scale", "scenario"], ignore_index=True)


def means(ax: Axes, table: pd.DataFrame, factor: float = 1.0) -> Axes:
    """One preset of `mean_table`: a dot with its interval for each scenario at each noise scale."""
    scenarios = [name for name in table.scenario.cat.categories if (table.scenario == name).any()]
    scales = sorted(table.noise_scale.unique())
    step = 0.7 / max(len(scenarios), 1)
    for k, name in enumerate(scenarios):
        rows = table[table.scenario == name]
        x = [scales.index(s) + (k - (len(scenarios) - 1) / 2) * step for s in rows.noise_scale]
        reach = factor * np.array([rows["mean"] - rows.low, rows.high - rows["mean"]])
        ax.errorbar(x, factor * rows["mean"], reach, fmt="o", color=SCENARIO_COLOURS[name],
                    elinewidth=1.4, label=scenario_name(name))  # fmt: skip
    ax.set_xticks(range(len(scales)), [f"× {scale:g}" for scale in scales])
    ax.set_xlim(-0.6, len(scales) - 0.4)
    ax.set_ylim(bottom=0)
    ax.set_xlabel("trajectory noise")
    return ax


def errors_against_sigmas(ax: Axes, table: pd.DataFrame) -> Axes:
    """One point for each line of `error_table`; on the line an error is what its sigma says."""
    ends = np.array([[0.6, 1.6]]).T * table[["sigma_deg", "error_deg"]].agg(["min", "max"])
    x, y = ends.to_numpy().T
    line = np.array([max(x[0], y[0]), min(x[1], y[1])])
    ax.plot(line, line, color=SCENARIO_COLOURS["truth"], lw=0.8, label="error = σ")
    for name in [name for name in SCENARIO_COLOURS if (table.scenario == name).any()]:
        rows = table[table.scenario == name]
        ax.plot(rows.sigma_deg, rows.error_deg, "o", ms=3, mew=0, alpha=0.75,
                color=SCENARIO_COLOURS[name], label=scenario_name(name))  # fmt: skip
    ax.set(xscale="log", yscale="log", xlim=x, ylim=y)
    ax.set_xlabel("formal σ of the three angles together (°)")
    ax.set_ylabel("error of the three angles together (°)")
    return ax


def verdict_counts(ax: Axes, counts: pd.Series) -> Axes:
    """A bar for each verdict, in their order, with its number of claims."""
    bars = ax.barh(range(len(counts)), counts, color=VERDICT_COLOURS[: len(counts)], height=0.66)
    ax.bar_label(bars, padding=3)
    ax.set_yticks(range(len(counts)), counts.index)
    ax.invert_yaxis()
    ax.set_xlim(0, 1.12 * max(counts.max(), 1))
    ax.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    ax.set_xlabel("claims")
    return ax
