"""Roofs found in one strip, virtual points (Fig. 4) and matches."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from paperrepro.figures import GROUND, SCENARIO_COLOURS, thinned
from paperrepro.figures.survey import upright
from paperrepro.method.roofs import Gable, Roofs

#: Filters that a point can fall out at, in the order of drawing: colour, size and words.
STEPS = {
    "ground": (GROUND, 0.5, "ground"),
    "candidate": ("#0072b2", 1.2, "candidate for a roof"),
    "outlier": ("#e6007e", 12.0, "outlier"),
}
#: A pair of tones for each of the colours that gables take in turn, left and right face.
FACE_TONES = (
    ("#0072b2", "#56b4e9"),
    ("#d55e00", "#e69f00"),
    ("#007a5a", "#5cc9a7"),
    ("#a8518a", "#dba3c3"),
)


def kept_and_lost(
    ax: Axes, x: np.ndarray, y: np.ndarray, step: np.ndarray, size: float = 1.0
) -> Axes:
    """Points in plan or section, coloured by the filter that they fall out at; ``step`` (N,) of
    `STEPS`."""
    for name, (colour, area, _) in STEPS.items():
        here = thinned(np.flatnonzero(step == name), 40_000)
        rare = name == "outlier"  # large while they are few
        scale = max(0.3, min(1.0, 100 / max(len(here), 1))) if rare else size
        ax.scatter(x[here], y[here], s=scale * area, color=colour, lw=0, rasterized=True,
                   zorder=3 if rare else 2)  # fmt: skip
    ax.set_aspect("equal")
    return ax


def step_legend(figure: Figure) -> None:
    """Legend of `kept_and_lost`, below the figure."""
    handles = [
        Line2D([], [], ls="", marker="o", color=colour, label=words)
        for colour, _, words in STEPS.values()
    ]
    figure.legend(handles=handles, ncols=len(handles), loc="outside lower center")


def faces(ax: Axes, p_m: np.ndarray, roofs: Roofs, size: float = 0.8) -> Axes:
    """Candidates (N, 3) in plan, grey; each gable in two tones, its ridge and virtual point."""
    ax.scatter(*thinned(p_m, 40_000)[:, :2].T, s=0.5, color="#c8c8c8", lw=0, rasterized=True)
    for number, gable in enumerate(roofs.gables):
        tones = FACE_TONES[number % len(FACE_TONES)]
        for face, tone in zip((gable.left, gable.right), tones, strict=True):
            members = thinned(roofs.faces[face].points)
            ax.scatter(*p_m[members, :2].T, s=size, color=tone, lw=0, rasterized=True)
            ax.plot(*roofs.faces[face].centroid[:2], "o", ms=3, mfc="white", mec="black", mew=0.6)
        ends = gable.virtual_point + gable.extent[:, None] * gable.ridge
        ax.plot(*ends[:, :2].T, color="black", lw=0.8)
        ax.plot(*gable.virtual_point[:2], "k*", ms=6, zorder=5)
    ax.set_aspect("equal")
    ax.set(xlabel="east (m)", ylabel="north (m)")
    return ax


def face_legend(ax: Axes) -> None:
    """Legend of `faces`."""
    handles = [
        Line2D([], [], ls="", marker="o", ms=3, color="#c8c8c8", label="candidate"),
        Line2D([], [], ls="", marker="o", ms=3, mfc="white", mec="black", mew=0.6,
               label="centroid of a face"),
        Line2D([], [], color="black", lw=0.8, label="ridge"),
        Line2D([], [], ls="", marker="*", color="black", ms=7, label="virtual point"),
    ]  # fmt: skip
    ax.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)


def normal_errors(ax: Axes, table: pd.DataFrame) -> Axes:
    """Error of each view's normal against its points: ``table`` has ``n_points``, ``error_deg`` and
    ``beside_m``, the distance from the track, which is the colour."""
    dots = ax.scatter(table.n_points, table.error_deg, c=table.beside_m, s=12, lw=0)
    ax.figure.colorbar(dots, ax=ax, label="distance from the track (m)")
    ax.set(xscale="log", yscale="log")
    ax.set(xlabel="points on the face", ylabel="error of the normal (°)")
    return ax


LEFT, RIGHT = "#0072b2", "#e69f00"


def gable_in_perspective(ax, p_m: np.ndarray, roofs: Roofs, gable: Gable) -> Axes:
    """Fig. 4a on measured points p_m (N, 3): faces, centroids, ridge, virtual point. 3-D axes."""
    for face, colour in ((gable.left, LEFT), (gable.right, RIGHT)):
        ax.scatter(*p_m[thinned(roofs.faces[face].points)].T, s=1, color=colour, lw=0, alpha=0.6,
                   depthshade=False, rasterized=True)  # fmt: skip
    _construction(ax, roofs, gable, slice(0, 3))
    ax.view_init(elev=30, azim=np.degrees(np.arctan2(*gable.ridge[1::-1])) + 198)
    both = np.concatenate([roofs.faces[face].points for face in (gable.left, gable.right)])
    ax.set_box_aspect(np.ptp(p_m[both], axis=0), zoom=1.2)
    upright(ax, *np.percentile(p_m[both, 2], [1, 99]))
    return ax


def gable_from_above(ax: Axes, p_m: np.ndarray, roofs: Roofs, gable: Gable) -> Axes:
    """Fig. 4b on measured points p_m (N, 3)."""
    names = {gable.left: (LEFT, "left face"), gable.right: (RIGHT, "right face")}
    for face, (colour, words) in names.items():
        shown = p_m[thinned(roofs.faces[face].points), :2]
        ax.scatter(*shown.T, s=2, color=colour, lw=0, alpha=0.6, rasterized=True)
        ax.plot([], [], "o", color=colour, label=words)
    _construction(ax, roofs, gable, slice(0, 2))
    ax.set_aspect("equal")
    ax.set(xlabel="east (m)", ylabel="north (m)")
    handles, labels = ax.get_legend_handles_labels()
    ax.figure.legend(handles, labels, loc="outside lower center", ncols=5)
    return ax


def _construction(ax, roofs: Roofs, gable: Gable, columns: slice) -> None:
    """Centroids, the segment between them, the ridge and where they cross."""
    centroids = np.array([roofs.faces[f].centroid for f in (gable.left, gable.right)])
    ends = gable.virtual_point + gable.extent[:, None] * gable.ridge
    ax.plot(*ends[:, columns].T, color="black", lw=1.4, label="ridge", zorder=5)
    ax.plot(*centroids[:, columns].T, color="black", lw=1, ls=":", zorder=5)
    ax.plot(*centroids[:, columns].T, "o", ms=5, mfc="white", mec="black", ls="", zorder=6,
            label="centroids $p_1$, $p_2$")  # fmt: skip
    ax.plot(*gable.virtual_point[columns, None], "*", ms=10, color="#d55e00", mec="black", mew=0.5,
            ls="", zorder=7, label="virtual point $p_A$")  # fmt: skip


def match_matrix(ax: Axes, counts: pd.DataFrame, false: pd.DataFrame) -> Axes:
    """Matched faces of each two strips above the diagonal, false ones among them below."""
    shown = np.where(np.triu(np.ones(counts.shape), 1) > 0, counts, np.nan)
    ax.imshow(shown, cmap="Blues", vmin=0, vmax=1.4 * max(counts.to_numpy().max(), 1))
    for i, j in np.ndindex(counts.shape):
        if i != j:
            value, colour = (counts.iat[i, j], "black") if j > i else (false.iat[i, j], "#b3003c")
            ax.text(j, i, f"{value}", ha="center", va="center", color=colour, fontsize=7.5)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_ticks(range(len(counts)), counts.index)
    ax.tick_params(length=0, labeltop=True, labelbottom=False)
    ax.spines[:].set_visible(False)
    ax.set_title("black: matched faces; red, below: false ones", loc="center")
    return ax


def pair_distances(ax: Axes, table: pd.DataFrame, limits: dict[str, tuple[float, float]]) -> Axes:
    """``distance_m`` and ``inclination_deg`` of the pairs of each ``step``; ``limits`` are the
    thresholds of the two."""
    colours = dict(zip(limits, (SCENARIO_COLOURS["before"], SCENARIO_COLOURS["SL"]), strict=True))
    for step, (distance, inclination) in limits.items():
        rows, colour = table[table.step == step], colours[step]
        ax.plot(rows.distance_m, rows.inclination_deg, "o", ms=2.5, mew=0, color=colour, label=step)
        ax.plot([1e-4, distance, distance], [inclination, inclination, 1e-4], color=colour,
                lw=0.8, ls=(0, (4, 2)))  # fmt: skip
    ax.set(xscale="log", yscale="log")
    ax.set_xlim(0.7 * table.distance_m.min(), 1.4 * max(d for d, _ in limits.values()))
    ax.set_ylim(0.7 * table.inclination_deg.min(), 1.4 * max(i for _, i in limits.values()))
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter("{x:g}")
    ax.set(xlabel="distance of the gables (m)", ylabel="inclination of the normals (°)")
    ax.plot([], [], color="#4d4d4d", lw=0.8, ls=(0, (4, 2)), label="thresholds")
    ax.figure.legend(loc="outside lower center", ncols=3)
    return ax


def tie_planes(ax: Axes, corners: list[np.ndarray], views: np.ndarray) -> Axes:
    """Faces (4, 3) from above, coloured and numbered by how many strips see them."""
    norm = BoundaryNorm(np.arange(1.5, 9.0), 256)
    faces = PolyCollection([c[:, :2] for c in corners], array=views, cmap="cividis", norm=norm,
                           edgecolors="black", lw=0.5)  # fmt: skip
    ax.add_collection(faces)
    for corner, count in zip(corners, views, strict=True):
        ax.text(*corner[:, :2].mean(axis=0), str(count), ha="center", va="center", fontsize=6.5,
                color="white" if count < 5 else "black")  # fmt: skip
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.figure.colorbar(faces, ax=ax, label="strips", ticks=range(2, 9), shrink=0.7)
    ax.set(xlabel="east (m)", ylabel="north (m)")
    return ax
