"""What many surveys say: errors against noise and against their sigmas, verdicts counted; and the
time of each stage against the number of points."""

from collections.abc import Iterator

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator

from paperrepro.figures import SCENARIO_COLOURS, canvas, scenario_name
from paperrepro.paper.verdicts import CONDITIONS, FAILS, HOLDS, UNDECIDED, UNTESTED
from paperrepro.study.rows import FOUND
from paperrepro.study.statistics import (
    CONFIDENCE,
    OFFSETS,
    curve_table,
    of_mean,
    of_share,
    survey_table,
)


def curves(ax: Axes, table: pd.DataFrame, quantity: str, factor: float = 1.0) -> Axes:
    """``quantity`` of a `curve_table` of one setting, times ``factor``: a line with bars for each
    scenario, a little apart from one another along the noise."""
    table = table[table.quantity == quantity]
    names = _drawn(table)
    apart = 0.012 * max(np.ptp(table.noise_scale), 0.5) if len(table) else 0.0
    for k, name in enumerate(names):
        rows = table[table.scenario == name].sort_values("noise_scale")
        x = rows.noise_scale.to_numpy() + (k - (len(names) - 1) / 2) * apart
        y, low, high = factor * rows[["value", "low", "high"]].to_numpy().T
        reach = np.array([y - low, high - y]).clip(0)
        ax.errorbar(x, y, reach, fmt="o-", ms=3, color=SCENARIO_COLOURS[name],
                    lw=0.9, elinewidth=0.9, label=scenario_name(name))  # fmt: skip
    ax.set_xticks(sorted(table.noise_scale.unique()))
    if table.noise_scale.nunique() == 1:  # else what sets them apart would fill the axis
        ax.set_xlim(table.noise_scale.iloc[0] + 10 * apart * np.array([-1, 1]))
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set_ylim(bottom=0)
    ax.set_xlabel("trajectory noise (× data sheet)")
    return ax


def errors(surveys: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Error, formal sigma and coverage against noise, a row of panels for each setting."""
    columns = {"error_deg": of_mean, "sigma_deg": of_mean, "held": of_share}
    table = curve_table(surveys, columns)
    figure, panels = _panels(table, len(columns))
    for axes, (name, part) in zip(panels, _by_setting(table), strict=False):
        for ax, quantity in zip(axes, columns, strict=True):
            curves(ax, part, quantity, 100 if quantity == "held" else 1)
        _titles(axes, f"error{name}", "formal σ", "coverage")
        axes[0].set_ylabel("boresight error (°)")
        axes[1].set_ylabel("formal σ (°)")
        axes[2].set_ylabel("95 % intervals that hold the truth (%)")
        axes[2].axhline(100 * CONFIDENCE, color="#4d4d4d", lw=0.6, ls="--")
        axes[2].set_ylim(0, 104)
        axes[1].sharey(axes[0])
    _legend(figure, panels)
    return figure, table


def offsets(surveys: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Vertical offset at the virtual points against noise, against reference and true planes."""
    table = curve_table(surveys, dict.fromkeys(OFFSETS, of_mean))
    figure, panels = _panels(table, len(OFFSETS))
    for axes, (name, part) in zip(panels, _by_setting(table), strict=False):
        for ax, quantity in zip(axes, OFFSETS, strict=True):
            curves(ax, part, quantity, 100)
        _titles(axes, f"from the reference{name}", "from the true planes")
        axes[0].set_ylabel("mean vertical offset (cm)")
    _legend(figure, panels)
    return figure, table


def beaten(surveys: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Share of surveys in which a scenario finds the boresight better than SL, [11], against
    noise."""
    table = curve_table(surveys, {"beats_sl": of_share})
    figure, panels = _panels(table, 1)
    for axes, (name, part) in zip(panels, _by_setting(table), strict=False):
        curves(axes[0], part, "beats_sl", 100)
        axes[0].axhline(50, color="#4d4d4d", lw=0.6, ls="--")
        axes[0].set_ylim(-2, 102)
        _titles(axes, f"[11] is beaten{name}")
        axes[0].set_ylabel("surveys (%)")
    _legend(figure, panels)
    return figure, table


def pictures(rows: pd.DataFrame) -> Iterator[tuple[str, Figure, pd.DataFrame]]:
    """Name, figure and plotted values of all that can be drawn of ``rows``."""
    surveys = survey_table(rows)
    draw = {"noise_errors": errors, "noise_offsets": offsets, "noise_beaten": beaten}
    for name, function in draw.items() if len(surveys) else ():
        figure, data = function(surveys)
        if len(data):
            yield name, figure, data


def _panels(table: pd.DataFrame, columns: int) -> tuple[Figure, np.ndarray]:
    """A row of so many axes for each setting, (settings, columns)."""
    rows = max(1, len(list(_by_setting(table))))
    return canvas("double", 8 + 58 * rows, nrows=rows, ncols=columns, squeeze=False)


def _titles(axes: np.ndarray, *words: str) -> None:
    """A letter, counted over the figure's panels, and words over each of ``axes``."""
    panels = axes[0].figure.axes
    for ax, title in zip(axes, words, strict=True):
        letter = f"({'abcdefghijkl'[panels.index(ax)]}) " if len(panels) > 1 else ""
        ax.set_title(letter + title)


def _legend(figure: Figure, panels: np.ndarray) -> None:
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=max(len(labels), 1))


def _drawn(table: pd.DataFrame) -> list[str]:
    """Its scenarios, in the order of the colours."""
    return [name for name in SCENARIO_COLOURS if (table.scenario == name).any()]


def _by_setting(table: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """Its parts by setting, each with words on it, empty if there is but one."""
    names = list(table.columns[: table.columns.get_loc("noise_scale")])
    groups = table.groupby(names)
    for key, part in groups:
        yield f": {', '.join(map(str, key))}" if len(groups) > 1 else "", part


def kinds(table: pd.DataFrame) -> Figure:
    """Coverage and error by kind of errors and scenario, of a `promises_by_kind` of one setting."""
    names = list(dict.fromkeys(table.errors))
    figure, (left, right) = canvas("double", 12 + 7.5 * len(names), ncols=2, sharey=True)
    scenarios = [name for name in [*SCENARIO_COLOURS, FOUND] if (table.scenario == name).any()]
    step = 0.7 / max(len(scenarios), 1)
    for k, name in enumerate(scenarios):
        part = table[table.scenario == name]
        y = [names.index(kind) + (k - (len(scenarios) - 1) / 2) * step for kind in part.errors]
        found = name == FOUND
        look = {"color": SCENARIO_COLOURS["D" if found else name], "ls": "", "ms": 4,
                "marker": "D" if found else "o", "label": scenario_name(name)}  # fmt: skip
        left.plot(100 * part.coverage, y, **look)
        right.plot(part.rms_deg, y, **look)
    left.axvline(100 * CONFIDENCE, color="#4d4d4d", lw=0.6, ls="--")
    left.set_yticks(range(len(names)), names)
    left.invert_yaxis()
    left.set_xlim(0, 102)
    left.set_xlabel("coverage of 95 % intervals (%)")
    right.set_xscale("log")
    right.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    right.xaxis.set_major_formatter("{x:g}")
    right.xaxis.set_minor_formatter("")
    right.set_xlabel("RMS boresight error, three angles (°)")
    for ax in (left, right):
        ax.grid(axis="x", lw=0.3)
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


VERDICT_COLOURS = {
    HOLDS: "#009e73", CONDITIONS: "#e69f00", FAILS: "#d55e00", UNDECIDED: "#7a9cc6",
    UNTESTED: "#b3b3b3",
}  # fmt: skip


def means(ax: Axes, table: pd.DataFrame, factor: float = 1.0) -> Axes:
    """One quantity of one setting of a `curve_table`, times ``factor``: a dot with its interval for
    each scenario at each noise scale."""
    scenarios = _drawn(table)
    scales = sorted(table.noise_scale.unique())
    step = 0.7 / max(len(scenarios), 1)
    for k, name in enumerate(scenarios):
        rows = table[table.scenario == name]
        x = [scales.index(s) + (k - (len(scenarios) - 1) / 2) * step for s in rows.noise_scale]
        reach = factor * np.array([rows.value - rows.low, rows.high - rows.value])
        colour = SCENARIO_COLOURS[name]
        ax.errorbar(x, factor * rows.value, reach, fmt="o", color=colour, elinewidth=1.4)
        ax.plot([], [], "s", ms=6, color=colour, label=scenario_name(name))  # no dot of the data
    ax.set_xticks(range(len(scales)), [f"× {scale:g}" for scale in scales])
    ax.set_xlim(-0.6, len(scales) - 0.4)
    ax.set_ylim(bottom=0)
    ax.set_xlabel("trajectory noise")
    return ax


def errors_against_sigmas(ax: Axes, table: pd.DataFrame) -> Axes:
    """One point for each line of a `survey_table`; on the line an error is what its sigma says."""
    ends = np.array([[0.6, 1.6]]).T * table[["sigma_deg", "error_deg"]].agg(["min", "max"])
    x, y = ends.to_numpy().T
    line = np.array([max(x[0], y[0]), min(x[1], y[1])])
    ax.plot(line, line, color=SCENARIO_COLOURS["truth"], lw=0.8, label="error = σ")
    for name in _drawn(table):
        rows = table[table.scenario == name]
        ax.plot(rows.sigma_deg, rows.error_deg, "o", ms=3, mew=0, alpha=0.75,
                color=SCENARIO_COLOURS[name], label=scenario_name(name))  # fmt: skip
    ax.set(xscale="log", yscale="log", xlim=x, ylim=y)
    ax.set_xlabel("formal σ, three angles together (°)")
    ax.set_ylabel("error, three angles together (°)")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("")
    ax.figure.legend(loc="outside lower center", ncols=3)
    return ax


def verdict_counts(ax: Axes, counts: pd.Series) -> Axes:
    """A bar for each verdict, in their order, with its number of claims; as long for a claim in all
    panels of the figure."""
    colours = [VERDICT_COLOURS[verdict] for verdict in counts.index]
    bars = ax.barh(range(len(counts)), counts, color=colours, height=0.66)
    ax.bar_label(bars, padding=3)
    ax.set_yticks(range(len(counts)), counts.index)
    ax.invert_yaxis()
    panels = ax.figure.axes
    longest = max(bar.get_width() for panel in panels for bar in panel.patches)
    plt.setp(panels, xlim=(0, 1.12 * max(longest, 1)))
    ax.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    ax.set_xlabel("claims")
    return ax


#: Stages that are drawn, each with the peer that is drawn dashed in the same colour.
STAGES = {
    "simulate": "",
    "georeference": "memory copy",
    "outliers": "Open3D",
    "ground": "",
    "normals and growing": "Open3D",
    "SL": "",
    "C": "",
    "whole method": "",
}


#: No strip's and no scenario's.
STAGE_COLOURS = (
    "#4e79a7", "#f28e2b", "#e15759", "#76b7b2", "#59a14f", "#b6992d", "#b07aa1", "#79706e",
)  # fmt: skip


def time_against_points(rows: pd.DataFrame) -> Figure:
    """Log-log plot of ``rows`` with ``stage``, ``points``, ``seconds``, ``peer``, ``peer_seconds``;
    peers dashed, and a line of slope one to compare with."""
    figure, ax = canvas("double", 90)
    for (stage, peer), colour in zip(STAGES.items(), STAGE_COLOURS, strict=True):
        of_stage = rows[rows.stage == stage].sort_values("points")
        ours = of_stage.drop_duplicates("points")
        if len(ours):
            ax.loglog(ours.points, ours.seconds, "o-", color=colour, label=stage, ms=4)
        theirs = of_stage[of_stage.peer == peer] if peer else of_stage[:0]
        if len(theirs):
            ax.loglog(theirs.points, theirs.peer_seconds, "x--", color=colour,
                      label=f"{stage}: {peer}", ms=4)  # fmt: skip
    span = np.array([rows.points.min(), rows.points.max()], float)
    ax.loglog(span, 1e-6 * span, ":", color="0.5", label="1 µs a point")
    ax.set(xlabel="points", ylabel="time (s)")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return figure
