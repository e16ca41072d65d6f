"""Roofs found in one strip: filtering, faces, virtual points."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from paperrepro.figures import GROUND, thinned
from paperrepro.segmentation.roofs import Roofs

#: Steps that a point can fall out at, in the order of drawing: colour, size
#: and words.
FATES = {
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


def fates(ax: Axes, x: np.ndarray, y: np.ndarray, fate: np.ndarray, size: float = 1.0) -> Axes:
    """Points in plan or section, coloured by what becomes of them; ``fate`` (N,) of `FATES`."""
    for name, (colour, area, _) in FATES.items():
        here = thinned(np.flatnonzero(fate == name), 40_000)
        rare = name == "outlier"  # large while they are few
        scale = max(0.3, min(1.0, 100 / max(len(here), 1))) if rare else size
        ax.scatter(x[here], y[here], s=scale * area, color=colour, lw=0, rasterized=True,
                   zorder=3 if rare else 2)  # fmt: skip
    ax.set_aspect("equal")
    return ax


def fate_legend(figure: Figure) -> None:
    """Legend of `fates`, below the figure."""
    handles = [
        Line2D([], [], ls="", marker="o", color=colour, label=words)
        for colour, _, words in FATES.values()
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
        Line2D(
            [],
            [],
            ls="",
            marker="o",
            ms=3,
            mfc="white",
            mec="black",
            mew=0.6,
            label="centroid of a face",
        ),
        Line2D([], [], color="black", lw=0.8, label="ridge"),
        Line2D([], [], ls="", marker="*", color="black", ms=7, label="virtual point"),
    ]
    ax.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)


def normal_errors(ax: Axes, table: pd.DataFrame) -> Axes:
    """Error of each view's normal against its points: ``table`` has ``n_points``, ``error_deg`` and
    ``beside_m``, the distance from the track, which is the colour."""
    dots = ax.scatter(table.n_points, table.error_deg, c=table.beside_m, s=12, lw=0)
    ax.figure.colorbar(dots, ax=ax, label="distance from the track (m)")
    ax.set(xscale="log", yscale="log")
    ax.set(xlabel="points on the face", ylabel="error of the normal (°)")
    return ax
