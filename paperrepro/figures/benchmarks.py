"""Time of each stage against the number of points."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from paperrepro.figures import STRIP_COLOURS, canvas

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
