"""Curves against the noise of the trajectory, over the surveys of a sweep.

What many surveys say: errors with their intervals, errors against sigmas, verdicts.

Time of each stage against the number of points.
"""

from collections.abc import Callable, Iterator

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from paperrepro.figures import SCENARIO_COLOURS, STRIP_COLOURS, canvas, scenario_name
from paperrepro.frames import ANGLES
from paperrepro.method.adjustment.calibrate import SCENARIO_NAMES
from paperrepro.study.rows import COLUMNS
from paperrepro.study.simulated import ARTEFACT
from paperrepro.study.statistics import CONFIDENCE, TWO_SIDED, Interval, binomial, bootstrap

#: What the surveys that are averaged have in common beside the noise; and what a sweep varies more.
SETTING = ["preset", "profile"]
TRUTH = "truth"
_OFFSETS = {"offset_reference": "offset_mean_reference", "offset_truth": "offset_mean_truth"}
_MEASURED = ["error_deg", "sigma_deg", "held", *_OFFSETS, "beats_sl"]


def survey_table(rows: pd.DataFrame) -> pd.DataFrame:
    """One line for each survey and scenario: setting, noise_scale, seed, scenario;

    error_deg and sigma_deg, the boresight error and its formal sigma over all three angles; held,
    the share of the angles whose 95 % interval holds the truth; offset_reference and offset_truth,
    the mean absolute vertical offset at the virtual points (m); beats_sl, 1 where the error is
    smaller than that of SL, [11], in the same survey, else 0.
    """
    rows = rows[(rows.artefact == ARTEFACT) & rows.scenario.isin((*SCENARIO_NAMES, TRUTH))]
    setting = SETTING + [name for name in rows if name not in COLUMNS]
    parts = [
        _of_setting(part).assign(**dict(zip(setting, key, strict=True)))
        for key, part in rows.groupby(setting)
    ]
    names = [*setting, "noise_scale", "seed", "scenario", *_MEASURED]
    return pd.concat(parts, ignore_index=True)[names] if parts else pd.DataFrame(columns=names)


def _of_setting(rows: pd.DataFrame) -> pd.DataFrame:
    keys = ["noise_scale", "seed", "scenario"]
    values = rows.pivot_table(index=keys, columns="metric", values="value")
    errors = error_table(rows, SCENARIO_NAMES).set_index(keys)[["error_deg", "sigma_deg"]]
    table = errors.reindex(values.index)
    for name, metric in _OFFSETS.items():
        table[name] = values.get(metric, np.nan)
    angles = rows[rows.metric.isin([f"error_{angle}" for angle in ANGLES])].dropna(subset="sigma")
    held = angles.assign(value=angles.value.abs() <= TWO_SIDED * angles.sigma)
    table["held"] = held.groupby(keys).value.mean()
    others = table.error_deg.unstack().reindex(columns=SCENARIO_NAMES)
    of_sl = others.pop("SL")
    beats = others.lt(of_sl, axis=0).where(others.notna().mul(of_sl.notna(), axis=0))
    table["beats_sl"] = beats.stack().astype(float)
    return table.reset_index()


def curve_table(
    surveys: pd.DataFrame, columns: dict[str, Callable[[np.ndarray], Interval]]
) -> pd.DataFrame:
    """Over the seeds of each setting, noise and scenario: setting, noise_scale, scenario, quantity,
    surveys, value, low, high. ``columns`` of a `survey_table` with what makes an interval of one,
    `of_mean` or `of_share`."""
    lines = []
    names = [name for name in surveys if name not in _MEASURED and name != "seed"]
    for key, part in surveys.groupby(names):
        for column, interval in columns.items():
            values = part[column].dropna().to_numpy()
            if len(values):
                span = interval(values)
                lines.append([*key, column, len(values), span.value, span.low, span.high])
    return pd.DataFrame(lines, columns=[*names, "quantity", "surveys", "value", "low", "high"])


def of_mean(values: np.ndarray) -> Interval:
    """Mean with its 95 % bootstrap interval over surveys; of one survey no interval is known."""
    return bootstrap(values) if len(values) > 1 else Interval(float(values[0]), np.nan, np.nan)


def of_share(values: np.ndarray) -> Interval:
    """Mean share with the exact 95 % interval of as many whole surveys: the three angles of one
    survey are one sample."""
    span = binomial(round(values.sum()), len(values))
    return Interval(float(values.mean()), span.low, span.high)


def curves(ax: Axes, table: pd.DataFrame, quantity: str, factor: float = 1.0) -> Axes:
    """``quantity`` of a `curve_table` of one setting, times ``factor``: a line with bars for each
    scenario, a little apart from one another along the noise."""
    table = table[table.quantity == quantity]
    names = [name for name in SCENARIO_COLOURS if (table.scenario == name).any()]
    apart = 0.012 * max(np.ptp(table.noise_scale), 0.5) if len(table) else 0.0
    for k, name in enumerate(names):
        rows = table[table.scenario == name].sort_values("noise_scale")
        x = rows.noise_scale.to_numpy() + (k - (len(names) - 1) / 2) * apart
        y, low, high = factor * rows[["value", "low", "high"]].to_numpy().T
        reach = np.array([y - low, high - y]).clip(0)
        ax.errorbar(x, y, reach, fmt="o-", ms=3, color=SCENARIO_COLOURS[name],
                    lw=0.9, elinewidth=0.9, label=scenario_name(name))  # fmt: skip
    ax.set_xticks(sorted(table.noise_scale.unique()))
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
        axes[0].set_ylabel(f"{name}\nboresight error (°)")
        axes[1].set_ylabel("formal σ (°)")
        axes[2].set_ylabel("coverage of 95 % intervals (%)")
        axes[2].axhline(100 * CONFIDENCE, color="#4d4d4d", lw=0.6, ls="--")
        axes[2].set_ylim(0, 104)
        axes[1].sharey(axes[0])
    _legend(figure, panels)
    return figure, table


def offsets(surveys: pd.DataFrame) -> tuple[Figure, pd.DataFrame]:
    """Vertical offset at the virtual points against noise, against reference and true planes."""
    table = curve_table(surveys, dict.fromkeys(_OFFSETS, of_mean))
    figure, panels = _panels(table, len(_OFFSETS))
    for axes, (name, part) in zip(panels, _by_setting(table), strict=False):
        for ax, quantity in zip(axes, _OFFSETS, strict=True):
            curves(ax, part, quantity, 100)
        axes[0].set_ylabel(f"{name}\noffset from the reference (cm)")
        axes[1].set_ylabel("offset from the true planes (cm)")
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
        axes[0].set_ylabel(f"{name}\nsurveys in which [11] is beaten (%)")
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


def _legend(figure: Figure, panels: np.ndarray) -> None:
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=max(len(labels), 1))


def _by_setting(table: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    names = list(table.columns[: table.columns.get_loc("noise_scale")])
    for key, part in table.groupby(names):
        yield ", ".join(map(str, key)), part


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


def time_against_points(rows: pd.DataFrame) -> Figure:
    """Log-log plot of ``rows`` with ``stage``, ``points``, ``seconds``, ``peer``, ``peer_seconds``;
    peers dashed, and a line of slope one to compare with."""
    figure, ax = canvas("double", 90, layout="constrained")
    for (stage, peer), colour in zip(STAGES.items(), STRIP_COLOURS.values(), strict=True):
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
