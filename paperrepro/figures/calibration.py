"""What an adjustment says: angles with their sigmas, range offsets, correlations."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from paperrepro.figures import SCENARIO_COLOURS, canvas, scenario_name
from paperrepro.paper.numbers import ANGLE_NAMES
from paperrepro.study.statistics import CONFIDENCE


def angle_errors(ax: Axes, table: pd.DataFrame) -> Axes:
    """Error of each angle, estimate minus truth, with bars of one (thick) and of two sigma.

    ``table`` as `tables.table4` makes it.
    """
    scenarios = list(dict.fromkeys(table.scenario))
    step = 0.72 / len(scenarios)
    for k, name in enumerate(scenarios):
        rows = table[table.scenario == name]
        x = np.arange(len(rows)) + (k - (len(scenarios) - 1) / 2) * step
        colour = SCENARIO_COLOURS[name]
        ax.errorbar(x, rows.error_deg, 2 * rows.sigma_deg, fmt="none", ecolor=colour, elinewidth=1)
        ax.errorbar(x, rows.error_deg, rows.sigma_deg, fmt="o", color=colour, elinewidth=3,
                    label=scenario_name(name))  # fmt: skip
    ax.axhline(0.0, color=SCENARIO_COLOURS["truth"], lw=0.7)
    angles = list(dict.fromkeys(table.angle))
    ax.set_xticks(range(len(angles)), [ANGLE_NAMES[angle] for angle in angles])
    ax.set_ylabel("estimate − truth (°)")
    return ax


def sigma_against_points(table: pd.DataFrame, printed: dict[str, float]) -> Figure:
    """What a formal sigma measures: sigma, error, NEES and coverage over the points a face, of
    `against_points`; ``printed`` sigmas (deg, three angles together) by scenario are lines."""
    figure, axes = canvas("double", 120, nrows=2, ncols=2, sharex=True)
    panels = {
        "sigma_deg": "(a) formal σ, three angles (°)", "rms_deg": "(b) RMS error, three angles (°)",
        "nees": "(c) mean squared error in σ² (NEES)", "coverage": "(d) coverage of 95 % intervals",
    }  # fmt: skip
    for ax, (column, title) in zip(axes.flat, panels.items(), strict=True):
        for name in dict.fromkeys(table.scenario):
            rows = table[table.scenario == name].sort_values("points")
            look = {"color": SCENARIO_COLOURS[name], "marker": "o", "ms": 3.5, "lw": 1.1,
                    "label": scenario_name(name)}  # fmt: skip
            if f"{column}_low" in rows:
                reach = [
                    rows[column] - rows[f"{column}_low"],
                    rows[f"{column}_high"] - rows[column],
                ]
                ax.errorbar(rows.points, rows[column], reach, elinewidth=0.9, **look)
            else:
                ax.plot(rows.points, rows[column], **look)
        for name, sigma in printed.items() if column == "sigma_deg" else ():
            colour = SCENARIO_COLOURS[name]
            ax.axhline(sigma, color=colour, lw=0.9, ls=(0, (4, 2)), label=f"{name}, as printed")
        ax.set_title(title)
        ax.set_xscale("symlog", linthresh=1, linscale=0.4)
        ax.set_xlim(left=-0.15)
        ax.set_yscale("linear" if column == "coverage" else "log")
    ticks = [0, 3, 30, table.points.max()]
    for ax in axes[1]:
        ax.set_xticks(ticks, ["0, centroids", "3", "30", "all"])
        ax.set_xlabel("points of a face that enter")
    axes[1, 0].axhline(1.0, color=SCENARIO_COLOURS["truth"], lw=0.7, ls=":")
    axes[1, 1].axhline(CONFIDENCE, color=SCENARIO_COLOURS["truth"], lw=0.7, ls=":")
    axes[1, 1].set_ylim(0, 1.03)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def offset_table(truth_m: np.ndarray, estimates: dict[str, tuple[np.ndarray, np.ndarray]]):
    """Range offsets of truth (16,) and ``estimates`` (offsets, sigmas): columns ring, scenario,
    offset_m, centred_m (the mean of all rings removed) and sigma_m (NaN for the truth)."""
    entries = {"truth": (truth_m, np.full(len(truth_m), np.nan)), **estimates}
    return pd.concat(
        [
            pd.DataFrame({"ring": range(len(offset)), "scenario": name, "offset_m": offset,
                          "centred_m": offset - np.mean(offset), "sigma_m": sigma})
            for name, (offset, sigma) in entries.items()
        ],
        ignore_index=True,
    )  # fmt: skip


def range_offsets(ax: Axes, table: pd.DataFrame, column: str) -> Axes:
    """Range offset of each ring, ``column`` of `offset_table`, with bars of two sigma."""
    sets = table.groupby("scenario", sort=False)
    for k, (name, rows) in enumerate(sets):
        colour, value = SCENARIO_COLOURS[name], 100 * rows[column]
        if name == "truth":
            ax.plot(rows.ring, value, "_", color=colour, ms=9, mew=1.6, label="truth")
        else:
            ring = rows.ring + 0.25 * (k - 0.5 * len(sets))
            ax.errorbar(ring, value, 200 * rows.sigma_m, fmt="o", ms=3, color=colour,
                        elinewidth=0.8, label=f"{scenario_name(name)} ± 2σ")  # fmt: skip
    ax.axhline(0.0, color="#4d4d4d", lw=0.5)
    ax.set_xlabel("ring")
    ax.set_xticks(range(0, 16, 3))
    return ax


def correlation_matrix(ax: Axes, correlation: np.ndarray, labels: list[str]) -> Axes:
    """Correlations (u, u) between the unknowns, blue negative, red positive."""
    image = ax.imshow(correlation, cmap="RdBu_r", vmin=-1, vmax=1)
    ax.set_xticks(range(len(labels)), labels, rotation=90, fontsize=6.5)
    ax.set_yticks(range(len(labels)), labels, fontsize=6.5)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    ax.figure.colorbar(image, ax=ax, label="correlation", shrink=0.85)
    return ax
