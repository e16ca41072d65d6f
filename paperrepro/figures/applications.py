"""Fig. 10: what calibrated clouds are for, a forest inventory and models of buildings."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection

from paperrepro.figures import thinned


def by_height(ax: Axes, table: pd.DataFrame, limits_m: tuple[float, float]) -> PathCollection:
    """A section's table (``across_m``, ``up_m``) coloured by height between ``limits_m``; returns
    the dots, for a colour bar."""
    table = thinned(table, 20_000).sample(frac=1, random_state=0)
    dots = ax.scatter(table.across_m, table.up_m, c=table.up_m, s=1.2, lw=0, vmin=limits_m[0],
                      vmax=limits_m[1], rasterized=True)  # fmt: skip
    ax.set_aspect("equal")
    ax.set_ylim(limits_m[0] - 1.5, limits_m[1] + 2.5)
    return dots


def ground_spread(p_m: np.ndarray, cell_m: float = 1.0, least: int = 10) -> float:
    """Median over level cells of the standard deviation, m, of heights of ground points (N, 3) m;
    cells of fewer than ``least`` points do not count."""
    east, north = (np.floor(x / cell_m).astype(np.int64) for x in p_m[:, :2].T)
    number = (east - east.min()) * (np.ptp(north) + 1) + north - north.min()
    count = np.maximum(np.bincount(number), 1)
    height = p_m[:, 2] - (np.bincount(number, p_m[:, 2]) / count)[number]
    many = count >= least
    variance = np.bincount(number, np.square(height))[many] / (count[many] - 1)
    return float(np.median(np.sqrt(variance)))
