"""Fig. 3, the steps of the method; what angles do to a point, and a wrong boresight to a roof."""

from collections.abc import Sequence

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from paperrepro.figures import ACCENT, OBJECT, SCENARIO_COLOURS
from paperrepro.paper.numbers import SYMBOLS

RANGE_COLOURS = {30.0: "#9ca7b0", 45.0: "#5d6b76", 60.0: "#1d2730"}
#: Of an error budget's entries: colour and marker by what they are.
BUDGET_KINDS = {
    "noise of the sensors": ("#4d4d4d", "s"),
    "boresight of Table 4": ("#e69f00", "o"),
    "boresight of the presets": ("#d55e00", "D"),
}


def small_angle(ax: Axes, table: pd.DataFrame) -> Axes:
    """Error of the small-angle form: ``table`` has ``angle_deg``, ``range_m``, ``error_m``."""
    for range_m, rows in table.groupby("range_m"):
        ax.plot(rows.angle_deg, 100 * rows.error_m, color=RANGE_COLOURS[range_m])
        last = rows.iloc[-1]
        ax.annotate(f"{range_m:.0f} m", (last.angle_deg, 100 * last.error_m), (3, -2),
                    textcoords="offset points", color=RANGE_COLOURS[range_m])  # fmt: skip
    ax.set(xlabel="boresight angle about one axis (°)", ylabel="displacement (cm)")
    ax.set_xlim(0, 1.12 * table.angle_deg.max())
    ax.set_ylim(bottom=0)
    ax.grid(True)
    return ax


def budget(ax: Axes, table: pd.DataFrame, accuracy_m: float) -> Axes:
    """What moves a point by how much: ``table`` has ``source``, ``kind`` (of `BUDGET_KINDS`) and
    ``displacement_m``, also in words at the right; ``accuracy_m`` is the scanner's stated accuracy,
    a line."""
    table = table.iloc[::-1].reset_index(drop=True)
    for kind, (colour, marker) in BUDGET_KINDS.items():
        rows = table[table.kind == kind]
        ax.hlines(rows.index, 1e-3, 100 * rows.displacement_m, color=colour, lw=0.7)
        ax.plot(100 * rows.displacement_m, rows.index, marker, color=colour, label=kind)
    for y, row in table.iterrows():
        ax.text(1.04, y, f"{100 * row.displacement_m:.2g}", transform=ax.get_yaxis_transform(),
                va="center", ha="right", fontsize=7)  # fmt: skip
    ax.text(1.04, len(table) - 0.2, "cm", transform=ax.get_yaxis_transform(), ha="right")
    ax.axvline(100 * accuracy_m, color="black", lw=0.8, ls=(0, (4, 2)), zorder=1)
    ax.annotate(f"scanner, stated: {100 * accuracy_m:g} cm", (100 * accuracy_m, len(table) - 0.4),
                (4, 0), textcoords="offset points", fontsize=7)  # fmt: skip
    ax.set_yticks(range(len(table)), table.source.replace(SYMBOLS, regex=True))
    ax.set_xscale("log")
    ax.set_xlim(30 * table.displacement_m.min(), 150 * table.displacement_m.max())
    ax.set_ylim(-0.7, len(table) + 0.2)
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set_xlabel("displacement of a point 30 m away (cm)")
    ax.figure.legend(loc="outside lower center", ncols=3)
    return ax


def thick_roof(figure: Figure, axes: dict, table: pd.DataFrame, names: dict[str, str]) -> Figure:
    """One roof in one strip under two mountings; ``axes`` a, b (profiles) and c.

    ``table`` has ``mounting``, ``elevation_deg``, ``across_m``, ``up_m`` and ``distance_m`` from
    the true plane of one face (NaN for other points); ``names`` are the panels' titles. In c, the
    mean distance of each beam, from that of the face.
    """
    low, high = table.elevation_deg.min(), table.elevation_deg.max()
    colours = [SCENARIO_COLOURS["before"], SCENARIO_COLOURS["truth"]]
    for letter, (mounting, words), colour in zip("ab", names.items(), colours, strict=True):
        rows, ax = table[table.mounting == mounting], axes[letter]
        dots = ax.scatter(rows.across_m, rows.up_m, c=rows.elevation_deg, s=5, lw=0, vmin=low,
                          vmax=high, rasterized=True)  # fmt: skip
        ax.set_title(f"({letter}) {words}")
        ax.set(ylabel="up (m)", aspect="equal")
        face = rows[rows.distance_m.notna()]
        mean = face.groupby("elevation_deg").distance_m.mean() - face.distance_m.mean()
        axes["c"].plot(mean.index, 100 * mean, "o-", ms=3, color=colour, label=words)
    axes["a"].tick_params(labelbottom=False)
    axes["a"].set(xlim=_about(table.across_m), ylim=_about(table.up_m))
    axes["b"].set(xlim=_about(table.across_m), ylim=_about(table.up_m))
    axes["b"].set_xlabel("across the ridge (m)")
    figure.colorbar(dots, ax=[axes["a"], axes["b"]], label="beam elevation (°)", shrink=0.8)
    axes["c"].axhline(0, color="#4d4d4d", lw=0.5)
    axes["c"].set_title("(c) one face, beam by beam")
    axes["c"].set(xlabel="beam elevation (°)", ylabel="mean distance, from the face's (cm)")
    axes["c"].margins(y=0.2)
    axes["c"].legend()
    return figure


def _about(values: pd.Series) -> tuple[float, float]:
    """A little more than their span."""
    return values.min() - 0.3, values.max() + 0.3


def steps(ax: Axes, names: Sequence[str], notes: Sequence[str], again: tuple[int, int]) -> Axes:
    """Boxes in a row with arrows between them, ``notes`` below; an arrow back over the boxes from
    the second number of ``again`` to the first."""
    width, height = 0.84, 0.5
    for k, (name, note) in enumerate(zip(names, notes, strict=True)):
        box = FancyBboxPatch((k, 0), width, height, boxstyle="round,pad=0,rounding_size=0.06",
                             fc="#eaf4fb", ec=OBJECT)  # fmt: skip
        ax.add_patch(box)
        words = name.replace(" and ", " and\n").replace(" ", "\n", 1)
        ax.text(k + width / 2, height / 2, words, ha="center", va="center", fontsize=7)
        ax.text(k + width / 2, -0.06, note, ha="center", va="top", fontsize=7, color="#4d4d4d")
        if k:
            _arrow(ax, (k - 1 + width, height / 2), (k, height / 2), "black", "arc3")
    first, last = again
    _arrow(ax, (last + width / 2, height), (first + width / 2, height), ACCENT, "arc3,rad=0.18")
    ax.text((first + last + width) / 2, height + 0.36, "again, until the boresight settles",
            color=ACCENT, ha="center", fontsize=7)  # fmt: skip
    ax.set(xlim=(-0.05, len(names) - 1 + width + 0.05), ylim=(-0.25, height + 0.5))
    ax.axis("off")
    return ax


def _arrow(ax: Axes, start, end, colour: str, style: str) -> None:
    look = {"arrowstyle": "-|>", "color": colour, "lw": 1, "mutation_scale": 8}
    ax.annotate(
        "", end, start, arrowprops={**look, "shrinkA": 0, "shrinkB": 0, "connectionstyle": style}
    )
