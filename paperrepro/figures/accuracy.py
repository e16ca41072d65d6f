"""Fig. 7, 8 and 11: how far points and virtual points lie from where they should."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from scipy import stats

from paperrepro.figures import SCENARIO_COLOURS, narrow_name, scenario_name
from paperrepro.method.accuracy import Distribution
from paperrepro.paper.numbers import number

CM = 100.0


def rmse_bars(
    ax: Axes, table: pd.DataFrame, floor_m: float,
    spread_m: dict[str, tuple[float, float]] | None = None,
) -> Axes:  # fmt: skip
    """Fig. 7: a bar for each row of ``table`` (``scenario``, ``rmse_m``), its value on top.

    ``floor_m`` is the RMSE under the true mounting: what no calibration can go below by much;
    ``spread_m``, what other surveys span, by scenario, are lines beside the bars.
    """
    colours = [SCENARIO_COLOURS[name] for name in table.scenario]
    bars = ax.bar(range(len(table)), CM * table.rmse_m, width=0.68, color=colours)
    ax.bar_label(bars, fmt="%.1f", padding=3, fontsize=7.5,
                 bbox={"fc": "white", "ec": "none", "pad": 0.3})  # fmt: skip
    reaches = {x: (spread_m or {}).get(name) for x, name in enumerate(table.scenario)}
    for x, reach in reaches.items():
        if reach:
            ax.plot([x + 0.4] * 2, CM * np.array(reach), color="black", lw=1.0)
    ax.axhline(
        CM * floor_m, color=SCENARIO_COLOURS["truth"], lw=0.8, ls=(0, (4, 2)),
        label=f"floor, true mounting: {CM * floor_m:.1f} cm",
    )  # fmt: skip
    ax.legend(loc="upper right")
    ax.set_xticks(range(len(table)), [narrow_name(name) for name in table.scenario])
    ax.set_ylabel("RMSE (cm)")
    ax.set_xlim(-0.6, len(table) - 0.4)
    most = max([floor_m, *table.rmse_m, *(reach[1] for reach in reaches.values() if reach)])
    ax.set_ylim(0, 1.12 * CM * most)
    return ax


def histogram_table(
    distances: dict[str, np.ndarray], limit_m: float, width_m: float
) -> pd.DataFrame:
    """Densities (1/m) of point-to-plane distances in bins, and of the normal of equal mean and
    sigma at the bins' middles: columns scenario, left_m, right_m, density, normal."""
    edges = np.arange(-limit_m, limit_m + 0.5 * width_m, width_m)
    tables = []
    for name, values in distances.items():
        count, _ = np.histogram(values, edges)
        middle = 0.5 * (edges[1:] + edges[:-1])
        tables.append(
            pd.DataFrame(
                {
                    "scenario": name,
                    "left_m": edges[:-1],
                    "right_m": edges[1:],
                    "density": count / (len(values) * width_m),
                    "normal": stats.norm(values.mean(), values.std()).pdf(middle),
                }
            )
        )
    return pd.concat(tables, ignore_index=True)


def histogram(ax: Axes, table: pd.DataFrame, scenario: str, shape: Distribution) -> Axes:
    """Fig. 8: one scenario of `histogram_table`, with the normal curve of its ``shape``."""
    rows = table[table.scenario == scenario]
    edges = CM * np.append(rows.left_m, rows.right_m.iloc[-1])
    ax.stairs(rows.density / CM, edges, fill=True, color=SCENARIO_COLOURS[scenario], alpha=0.55)
    x = np.linspace(edges[0], edges[-1], 400)
    ax.plot(x, stats.norm(CM * shape.mean, CM * shape.sigma).pdf(x), color="black", lw=0.9)
    ax.axvline(0.0, color="#4d4d4d", lw=0.5)
    ax.set_xlim(edges[0], edges[-1])
    ax.set_ylim(bottom=0)
    return ax


def histograms(
    axes: np.ndarray, table: pd.DataFrame, shapes: dict[str, Distribution],
    spread_m: dict[str, tuple[float, float]] | None = None,
) -> None:  # fmt: skip
    """Fig. 8: a panel of ``axes`` (rows, columns) for each scenario of `histogram_table`, in the
    order of ``shapes``, whose mean, sigma and distance from a normal distribution are written
    above; ``spread_m``, what the means of other surveys span, by scenario, are bars on top."""
    panels = axes.ravel()
    for ax, letter, (name, shape) in zip(panels, "abcdef", shapes.items(), strict=False):
        histogram(ax, table, name, shape)
        if name in (spread_m or {}):
            ax.plot(CM * np.array(spread_m[name]), [1.05] * 2, color="#4d4d4d", lw=2.0,
                    transform=ax.get_xaxis_transform(), clip_on=False)  # fmt: skip
        ax.set_title(
            f"({letter}) {scenario_name(name)}\nmean {number(CM * shape.mean, 1, signed=True)} cm, "
            f"σ {number(CM * shape.sigma, 1)} cm\nKS {number(100 * shape.ks, 1)} %",
            pad=9,
        )
    for ax in panels[2:]:
        ax.sharey(panels[1])
    tallest = table[table.scenario.isin(list(shapes)[1:])][["density", "normal"]]
    panels[1].set_ylim(0, 1.05 * tallest.max(axis=None) / CM)
    for ax in axes[:, 0]:
        ax.set_ylabel("density (1/cm)")
    axes[-1, axes.shape[1] // 2].set_xlabel("point-to-plane distance (cm)")


def offset_strips(
    ax: Axes, table: pd.DataFrame, bounds_m: dict[str, float],
    spread_m: dict[tuple[str, str], tuple[float, float]] | None = None,
) -> Axes:  # fmt: skip
    """Fig. 11: absolute vertical offsets at the virtual points, a column of dots for each step.

    ``table`` has ``scenario``, ``stage`` (after which, "" for none) and ``offset_m``, one row per
    virtual point; the bar is the mean, the number the largest. ``bounds_m`` are drawn as lines,
    ``spread_m``, what the means of other surveys span by (stage, scenario), beside the dots.
    """
    columns = table.groupby(["stage", "scenario"], sort=False).offset_m
    for x, (step, offset) in enumerate(columns):
        scenario = step[1]
        if step in (spread_m or {}):
            ax.plot([x + 0.42] * 2, CM * np.array(spread_m[step]), color="#4d4d4d", lw=1.4)
        value = CM * offset.abs().to_numpy()
        jitter = 0.28 * np.linspace(-1, 1, len(value)) if len(value) > 1 else np.zeros(1)
        ax.plot(x + jitter, value, "o", ms=2.2, mew=0, color=SCENARIO_COLOURS[scenario], alpha=0.8)
        ax.plot([x - 0.34, x + 0.34], [value.mean()] * 2, color="black", lw=1.1)
        ax.annotate(f"{value.max():.0f}", (x, value.max()), (0, 3), textcoords="offset points",
                    ha="center", fontsize=7)  # fmt: skip
    stages, scenarios = zip(*(key for key, _ in columns), strict=True)
    for words, bound in bounds_m.items():
        ax.axhline(CM * bound, color="#4d4d4d", lw=0.7, ls=(0, (4, 2)))
        ax.text(len(stages) - 0.45, CM * bound, words, ha="right", va="bottom", fontsize=7)
    ax.set_xticks(range(len(stages)), [narrow_name(name) for name in scenarios])
    for stage in dict.fromkeys(stages):
        places = [x for x, of in enumerate(stages) if of == stage]
        words = f"after {stage}" if stage else ""
        ax.annotate(words, (np.mean(places), 0), (0, -31), xycoords=("data", "axes fraction"),
                    textcoords="offset points", ha="center", fontsize=7.5)  # fmt: skip
    ax.set_xlabel(" ")  # room for the stages' names
    ax.set_xlim(-0.55, len(stages) - 0.45)
    reaches = [high for step, (_, high) in (spread_m or {}).items() if step in columns.groups]
    ax.set_ylim(0, 1.08 * CM * max([table.offset_m.abs().max(), *reaches]))
    ax.set_ylabel("absolute vertical offset (cm)")
    return ax
