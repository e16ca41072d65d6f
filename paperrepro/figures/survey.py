"""The site, the flight and the clouds, as plans, sections, perspectives and time series."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from paperrepro._files import require_folder, whole_file
from paperrepro.figures import ACCENT, GROUND, OBJECT, STRIP_COLOURS, thinned
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
ON_PLAN = ("SHED_ROOF", "GABLE_ROOF", "DORMER", "LEAF")
ALONG_LINES = {"FENCE": (0, (1, 1)), "WIRE": "-"}
COMPONENTS = ("east", "north", "up", "roll", "pitch", "heading")
#: Weights of a triangle's corners that spread points over it; shares along a line.
_CORNERS = np.array([(i, j, 4 - i - j) for i in range(5) for j in range(5 - i)]) / 4
_ALONG = np.linspace(0, 1, 40)
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
    handles = [Patch(color=KINDS[name][0], label=KINDS[name][1]) for name in ON_PLAN]
    for name, style in ALONG_LINES.items():  # thinner than a pixel as they are
        p_m = triangles[name].reshape(-1, 3)
        ends = p_m[[np.argmin(p_m[:, 0]), np.argmax(p_m[:, 0])], :2]
        handles += ax.plot(*ends.T, color=KINDS[name][0], ls=style, lw=1.1, label=KINDS[name][1])
    taken = np.concatenate([_CORNERS @ triangles[name][..., :2] for name in ON_PLAN]).reshape(-1, 2)
    tracks = [line.start + t * (line.end - line.start) for line in lines for t in _ALONG]
    for line in lines:
        _flight_line(ax, line, np.concatenate([taken, tracks]))
    _plan_axes(ax, extent_m)
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


def _flight_line(ax: Axes, line, taken: np.ndarray) -> None:
    """An arrow, its name behind its start where none of the ``taken`` places (N, 2) is near."""
    along = (line.end - line.start) / np.linalg.norm(line.end - line.start)
    right = 2.2 * np.array([along[1], -along[0]])
    colour = STRIP_COLOURS[line.name]
    ax.annotate("", line.end + right, line.start + right,
                arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.3, "shrinkA": 0,
                            "shrinkB": 0, "mutation_scale": 9}, zorder=4)  # fmt: skip
    places = line.start + 1.6 * right - np.arange(4.5, 30.0)[:, None] * along
    free = np.linalg.norm(places[:, None] - taken, axis=2).min(axis=1) > 5.0
    ax.text(*places[np.argmax(free)], line.name, color=colour, ha="center",
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
        ax.plot(table.time_s, scale * table[name], color="#404040", lw=0.8)
        ax.axhline(0, color="black", lw=0.5)
        for strip, (first, last) in spans.items():
            ax.plot([first, last], [0.02, 0.02], color=STRIP_COLOURS[strip], lw=3,
                    transform=ax.get_xaxis_transform(), solid_capstyle="butt")  # fmt: skip
        ax.set_title(f"({'abcdef'[k]}) {name}, σ = {scale * sigma[k]:.3g}{' ' * (k < 3)}{unit}")
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


def heights(ax: Axes, p_m: np.ndarray, extent_m, limits_m=None, cell_m=1.0) -> AxesImage:
    """Points (N, 3) from above: the highest of every cell, white where there is none, coloured
    between ``limits_m``, by default those of 99 % of the cells; returns the image, for a colour
    bar."""
    edges = [np.arange(-half, half + cell_m, cell_m) for half in extent_m]
    cell = [np.digitize(p_m[:, k], edges[k]) - 1 for k in (0, 1)]
    inside = np.logical_and.reduce([(cell[k] >= 0) & (cell[k] < len(edges[k]) - 1) for k in (0, 1)])
    top = np.full((len(edges[0]) - 1, len(edges[1]) - 1), -np.inf)
    np.maximum.at(top, (cell[0][inside], cell[1][inside]), p_m[inside, 2])
    limits = [edges[0][0], edges[0][-1], edges[1][0], edges[1][-1]]
    place = {"origin": "lower", "extent": limits}
    low, high = limits_m or np.percentile(top[np.isfinite(top)], [0.5, 99.5])
    shades = plt.get_cmap("cividis", 12)  # few, so that noise does not swell the files
    image = ax.imshow(np.ma.masked_invalid(top.T), shades, vmin=low, vmax=high, **place)
    _plan_axes(ax, extent_m)
    return image


def perspective(
    ax, p_m: np.ndarray, centre_m: np.ndarray, half_m: float, strips: np.ndarray | None = None
) -> PathCollection:
    """Points (N, 3) within ``half_m`` of ``centre_m`` (2,), coloured by height, or by ``strips``
    (N,), in random order so that none lies on top; 3-D axes. Returns the dots, for a colour bar."""
    shown = np.flatnonzero(inside(p_m[:, :2], centre_m - half_m, centre_m + half_m))
    shown = thinned(shown, 9_000 if strips is None else 40_000)
    low, high = np.percentile(p_m[shown, 2], [0.5, 99.8])
    shown = shown[(p_m[shown, 2] >= low) & (p_m[shown, 2] <= high)]
    look = {"s": 2, "c": p_m[shown, 2]}
    if strips is not None:
        shown = np.random.default_rng(0).permutation(shown)
        look = {"s": 0.6, "c": [STRIP_COLOURS[name] for name in strips[shown]]}
    dots = ax.scatter(*p_m[shown].T, lw=0, depthshade=False, rasterized=True, **look)
    ax.view_init(elev=18 if strips is None else 32, azim=-55)
    zoom = 1.15 if strips is None else 1.5
    ax.set_box_aspect((2 * half_m, 2 * half_m, high - low), zoom=zoom)
    upright(ax, low, high)
    return dots


def upright(ax, low: float, high: float) -> None:
    """Names and few ticks for 3-D axes, ``low`` and ``high`` on the third."""
    ax.set(xlabel="east (m)", ylabel="north (m)")
    ax.locator_params(nbins=4)
    ticks = np.unique(np.round([low, high])) + 0.0  # no minus zero
    ax.set_zticks(ticks, [f"{tick:.0f} m up" for tick in ticks], ha="left")
    ax.grid(False)
    ax.tick_params(pad=-2)
    for axis in (ax.xaxis, ax.yaxis):
        axis.labelpad = -4


def save_cloud(
    folder: str | Path, name: str, before_m: np.ndarray, after_m: np.ndarray, strips: np.ndarray
) -> None:
    """Write ``name.npz`` for the report, which shows it turnable: points (N, 3) m under two
    mountings, of ``strips`` (N,) by name, to the centimetre. An empty folder writes nothing."""
    if not str(folder):
        return
    names, strip = np.unique(strips, return_inverse=True)
    cm = {"before_cm": before_m, "after_cm": after_m}
    cm = {key: np.rint(100 * p_m).astype(np.int16) for key, p_m in cm.items()}
    require_folder(Path(folder))
    with whole_file(Path(folder) / f"{name}.npz") as part, open(part, "wb") as file:
        np.savez_compressed(file, names=names, strip=strip.astype(np.uint8), **cm)


def profiles(ax: Axes, across_m: dict[str, np.ndarray], up_m: dict[str, np.ndarray]) -> Axes:
    """Slices of two clouds in one picture, the first drawn below."""
    colours = dict(zip(across_m, (OBJECT, ACCENT), strict=True))
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
