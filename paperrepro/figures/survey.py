"""The site, the flight and the clouds, as plans, sections, perspectives and time series."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from paperrepro.figures import ACCENT, AXIS_COLOURS, GROUND, OBJECT, STRIP_COLOURS, thinned
from paperrepro.method.accuracy import density_across
from paperrepro.method.cells import inside

#: What stands on the site, in the order of drawing: colour and words.
KINDS = {
    "FENCE": ("#4d4d4d", "fence"),
    "WIRE": ("#000000", "wire"),
    "SHED_ROOF": ("#56b4e9", "shed, not gable"),
    "GABLE_ROOF": ("#d55e00", "gable roof"),
    "DORMER": ("#cc79a7", "dormer"),
    "CHIMNEY": ("#000000", "chimney"),
    "LEAF": ("#009e73", "tree"),
    "GROUND": (GROUND, "ground"),
    "WALL": ("#7f7f7f", "wall"),
    "TRUNK": ("#6b4f2a", "trunk"),
    "DUST": ("#e6007e", "dust"),
}
ON_PLAN = ("FENCE", "WIRE", "SHED_ROOF", "GABLE_ROOF", "DORMER", "LEAF")
COMPONENTS = ("east", "north", "up", "roll", "pitch", "heading")
#: Where the sun stands that shades roofs: north-west, 45 degrees high.
_SUN = np.array([-0.5, 0.5, np.sqrt(0.5)])


def plan(ax: Axes, triangles: dict[str, np.ndarray], lines, extent_m=(118.0, 82.0)) -> Axes:
    """Fig. 1: the site from above, and the flight ``lines`` with their directions.

    ``triangles`` (T, 3, 3) m by name of their class, see `KINDS`. Each line is set off to the right
    of its heading, so that two on one track show.
    """
    ground = triangles["GROUND"].reshape(-1, 3)
    ground = ground[(np.abs(ground[:, :2]) <= np.add(extent_m, 6.0)).all(axis=1)]
    ground = np.unique(ground, axis=0)
    levels = np.arange(np.floor(ground[:, 2].min()), ground[:, 2].max() + 0.5, 0.5)
    heights = ax.tricontourf(*ground.T, levels, cmap="Greys_r", alpha=0.45, zorder=0)
    ax.figure.colorbar(heights, ax=ax, label="ground height (m)", shrink=0.55, pad=0.01)
    for name in ON_PLAN:
        _shaded(ax, triangles[name], KINDS[name][0])
    for line in lines:
        _flight_line(ax, line)
    _plan_axes(ax, extent_m)
    handles = [Patch(color=KINDS[name][0], label=KINDS[name][1]) for name in ON_PLAN]
    ax.figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return ax


def _shaded(ax: Axes, triangles: np.ndarray, colour: str) -> None:
    """Triangles (T, 3, 3) from above, lit from the north-west."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal *= np.where(normal[:, 2:] < 0, -1, 1) / np.linalg.norm(normal, axis=1, keepdims=True)
    light = np.clip(0.55 + 0.5 * normal @ _SUN, 0.3, 1.15)[:, None]
    colours = np.clip(light * to_rgb(colour), 0, 1)
    many = len(triangles) > 2000
    ax.add_collection(
        PolyCollection(
            triangles[:, :, :2], facecolors=colours, edgecolors=colours, lw=0.4, rasterized=many
        )
    )


def _flight_line(ax: Axes, line) -> None:
    along = (line.end - line.start) / np.linalg.norm(line.end - line.start)
    right = 2.2 * np.array([along[1], -along[0]])
    colour = STRIP_COLOURS[line.name]
    ax.annotate("", line.end + right, line.start + right,
                arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.3, "shrinkA": 0,
                            "shrinkB": 0, "mutation_scale": 9}, zorder=4)  # fmt: skip
    ax.text(*(line.start + 1.6 * right - 4.5 * along), line.name, color=colour, ha="center",
            va="center", fontweight="bold", fontsize=7.5, zorder=5,
            path_effects=[withStroke(linewidth=2, foreground="white")])  # fmt: skip


def _plan_axes(ax: Axes, extent_m) -> None:
    ax.set_aspect("equal")
    ax.set(xlim=(-extent_m[0], extent_m[0]), ylim=(-extent_m[1], extent_m[1]))
    ax.set(xlabel="east (m)", ylabel="north (m)")


def trajectory_error(axes, table: pd.DataFrame, sigma: np.ndarray, spans: dict) -> None:
    """Six panels of ``table`` (``time_s`` and the `COMPONENTS`, m and rad): the GNSS/INS minus the
    truth, with bands of one ``sigma`` (6,); ``spans`` are the strips' times, s."""
    for k, (ax, name) in enumerate(zip(np.ravel(axes), COMPONENTS, strict=True)):
        scale, unit = (100.0, "cm") if k < 3 else (180 / np.pi, "°")
        ax.axhspan(-scale * sigma[k], scale * sigma[k], color="#e5e5e5", lw=0)
        ax.plot(table.time_s, scale * table[name], color=AXIS_COLOURS[k % 3], lw=0.8)
        ax.axhline(0, color="black", lw=0.5)
        for strip, (first, last) in spans.items():
            ax.plot([first, last], [0.02, 0.02], color=STRIP_COLOURS[strip], lw=3,
                    transform=ax.get_xaxis_transform(), solid_capstyle="butt")  # fmt: skip
        ax.set_title(f"{name}, σ = {scale * sigma[k]:.3g}{' ' * (k < 3)}{unit}")
        ax.set_ylabel(f"error ({unit})")
        largest = 1.15 * scale * max(table[name].abs().max(), sigma[k])
        ax.set_ylim(-largest or -1, largest or 1)
        ax.margins(x=0)
    for ax in np.atleast_2d(axes)[-1]:
        ax.set_xlabel("time of the mission (s)")


def density_table(across_m: dict[str, np.ndarray], length_m: float) -> pd.DataFrame:
    """`density_across` of each strip: columns strip, across_m, density."""
    parts = []
    for name, across in across_m.items():
        middle, density = density_across(across, length_m)
        parts.append(pd.DataFrame({"strip": name, "across_m": middle, "density": density}))
    return pd.concat(parts, ignore_index=True)


def density(ax: Axes, table: pd.DataFrame, height_m: float, crest: float) -> Axes:
    """`density_table` as a curve per strip, over ``crest`` cos² of the angle off nadir, which flat
    ground ``height_m`` below would give."""
    for name, rows in table.groupby("strip", sort=False):
        ax.plot(rows.across_m, rows.density, color=STRIP_COLOURS[name], lw=1, label=name)
    across = np.linspace(-60, 60, 241)
    expected = crest * np.cos(np.arctan(across / height_m)) ** 2
    ax.plot(across, expected, color="black", lw=0.9, ls=(0, (4, 2)), label="cos²")
    ax.set(xlabel="distance from the track, right positive (m)", ylabel="points per m²")
    ax.set_ylim(bottom=0)
    ax.legend(ncols=3, loc="lower center", columnspacing=1)
    return ax


def section(ax: Axes, across_m: np.ndarray, up_m: np.ndarray, kinds: np.ndarray) -> Axes:
    """Points of a slice along the flight, coloured by what was hit; ``kinds`` (N,) of names."""
    handles = []
    for name, (colour, words) in KINDS.items():
        here = thinned(np.flatnonzero(kinds == name))
        if len(here):
            rare = name not in ("GROUND", "GABLE_ROOF", "LEAF", "WALL")
            ax.scatter(across_m[here], up_m[here], s=6 if rare else 2.2, color=colour, lw=0,
                       rasterized=True, zorder=3 if rare else 2)  # fmt: skip
            handles.append(Line2D([], [], ls="", marker="o", color=colour, label=words))
    ax.set_aspect("equal")
    ax.set(xlabel="east (m)", ylabel="up (m)")
    ax.figure.legend(handles=handles, ncols=len(handles), loc="outside lower center")
    return ax


def heights(ax: Axes, p_m: np.ndarray, extent_m, cell_m=1.0) -> Axes:
    """Points (N, 3) from above: the highest of every cell, white where there is none."""
    edges = [np.arange(-half, half + cell_m, cell_m) for half in extent_m]
    cell = [np.digitize(p_m[:, k], edges[k]) - 1 for k in (0, 1)]
    inside = np.logical_and.reduce([(cell[k] >= 0) & (cell[k] < len(edges[k]) - 1) for k in (0, 1)])
    top = np.full((len(edges[0]) - 1, len(edges[1]) - 1), -np.inf)
    np.maximum.at(top, (cell[0][inside], cell[1][inside]), p_m[inside, 2])
    limits = [edges[0][0], edges[0][-1], edges[1][0], edges[1][-1]]
    place = {"origin": "lower", "extent": limits}
    low, high = np.percentile(top[np.isfinite(top)], [0.5, 99.5])  # dust would stretch the colours
    shades = plt.get_cmap("cividis", 24)  # few, so that noise does not swell the files
    image = ax.imshow(np.ma.masked_invalid(top.T), shades, vmin=low, vmax=high, **place)
    ax.figure.colorbar(image, ax=ax, label="height (m)", shrink=0.7, pad=0.01)
    _plan_axes(ax, extent_m)
    return ax


def perspective(
    ax, p_m: np.ndarray, centre_m: np.ndarray, half_m: float, azimuth_deg=-55.0
) -> Axes:
    """Points (N, 3) within ``half_m`` of ``centre_m`` (2,), coloured by height. 3-D axes."""
    shown = thinned(p_m[inside(p_m[:, :2], centre_m - half_m, centre_m + half_m)], 9_000)
    low, high = np.percentile(shown[:, 2], [0.5, 99.8])
    shown = shown[(shown[:, 2] >= low) & (shown[:, 2] <= high)]
    ax.scatter(*shown.T, c=shown[:, 2], s=2, lw=0, depthshade=False, rasterized=True)
    ax.view_init(elev=18, azim=azimuth_deg)
    ax.set_box_aspect((2 * half_m, 2 * half_m, high - low), zoom=1.35)
    ax.set(xlabel="east (m)", ylabel="north (m)")
    ax.locator_params(nbins=4)
    ax.set_zticks(np.unique(np.round([low, high])))
    ax.grid(False)
    return ax


def profiles(ax: Axes, across_m: dict[str, np.ndarray], up_m: dict[str, np.ndarray]) -> Axes:
    """Slices of several clouds in one picture, the first drawn below."""
    colours = dict(zip(across_m, (OBJECT, ACCENT, "#009e73"), strict=False))
    for name in across_m:
        shown = thinned(np.column_stack([across_m[name], up_m[name]]))
        ax.scatter(*shown.T, s=5, lw=0, color=colours[name], rasterized=True)
    handles = [Line2D([], [], ls="", marker="o", color=c, label=n) for n, c in colours.items()]
    ax.legend(handles=handles)
    ax.set(xlabel="across the ridge (m)", ylabel="up (m)")
    ax.set_aspect("equal")
    return ax


def by_height(ax: Axes, table: pd.DataFrame, limits_m: tuple[float, float]) -> PathCollection:
    """A section's table (``across_m``, ``up_m``) coloured by height between ``limits_m``; returns
    the dots, for a colour bar."""
    table = thinned(table, 20_000).sample(frac=1, random_state=0)
    dots = ax.scatter(table.across_m, table.up_m, c=table.up_m, s=1.2, lw=0, vmin=limits_m[0],
                      vmax=limits_m[1], rasterized=True)  # fmt: skip
    ax.set_aspect("equal")
    ax.set_ylim(limits_m[0] - 1.5, limits_m[1] + 2.5)
    return dots
