"""Pictures: one style, fixed colours, and files that come whole or not at all.

Plot functions in the modules of this package take data and an `Axes` (a `Figure` where they fill
several panels) and return it. Nothing else in `paperrepro` draws.
"""

from contextlib import ExitStack
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from paperrepro._files import require_folder, whole_file

STYLE = Path(__file__).with_name("paperrepro.mplstyle")
MM = 1 / 25.4
WIDTH_MM = {"single": 88, "double": 180}

#: Okabe and Ito's colours, told apart by colour-blind readers; one for each scenario, everywhere.
SCENARIO_COLOURS = {
    "before": "#8c8c8c",
    "SL": "#0072b2",
    "A": "#e69f00",
    "B": "#cc79a7",
    "C": "#009e73",
    "D": "#d55e00",
    "D trajectory adjusted": "#7f3800",
    "truth": "#000000",
}
SCENARIO_NAMES = {
    "before": "before",
    "SL": "[11] = SL",
    "D": "D (ours)",
    "D noise found": "D, noise found",
    "D trajectory adjusted": "D (ours), trajectory adjusted",
    "truth": "true mounting",
}

#: Tol's muted colours, for colour-blind readers too, and no scenario's.
STRIP_COLOURS = {
    "F1": "#332288",
    "F2": "#cc6677",
    "F3": "#117733",
    "F4": "#ddcc77",
    "F5": "#88ccee",
    "F6": "#882255",
    "F7": "#44aa99",
    "F8": "#999933",
}
GROUND, OBJECT, ACCENT = "#b9a684", "#56b4e9", "#d55e00"


def use_style() -> None:
    """Make the package's style that of all figures of this process."""
    plt.style.use(STYLE)


def canvas(width: str = "double", height_mm: float = 70, mosaic: str | None = None, **subplots):
    """``plt.subplots``, or ``plt.subplot_mosaic`` if ``mosaic`` is given, on a figure of journal
    width: ``single`` (88 mm) or ``double`` (180 mm)."""
    size = (WIDTH_MM[width] * MM, height_mm * MM)
    if mosaic is not None:
        return plt.subplot_mosaic(mosaic, figsize=size, **subplots)
    return plt.subplots(figsize=size, **subplots)


def thinned(points, limit: int = 6000):
    """At most ``limit`` of ``points``, rows of an array or a table, drawn at random but always the
    same, in their order: what a picture can show."""
    if len(points) <= limit:
        return points
    chosen = np.sort(np.random.default_rng(0).permutation(len(points))[:limit])
    return points.iloc[chosen] if isinstance(points, pd.DataFrame) else points[chosen]


def scenario_name(scenario: str) -> str:
    """What a reader of the paper calls it."""
    return SCENARIO_NAMES.get(scenario, scenario)


def narrow_name(scenario: str) -> str:
    """`scenario_name` for a tick: the least of it, a word a line."""
    return scenario_name(scenario).split(" = ")[0].replace(" ", "\n")


def save(
    figure: Figure, folder: str | Path, name: str, data: pd.DataFrame | None = None
) -> list[Path]:
    """Write ``name`` as PNG of 300 dpi and SVG, and ``data``, the plotted values, as CSV.

    Parameters
    ----------
    figure : matplotlib Figure
    folder : path
        Made if it is not there; an empty one writes nothing.
    name : str
        Of the files, without their endings.
    data : DataFrame, optional
        What is plotted.

    Returns
    -------
    list of Path
        The files, which appear all together or not at all; the same figure gives the same bytes.
    """
    if not str(folder):
        return []
    with ExitStack() as stack:
        kinds = ("png", "svg", "csv")[: 2 + (data is not None)]
        paths = [Path(folder) / f"{name}.{kind}" for kind in kinds]
        require_folder(Path(folder))
        parts = [stack.enter_context(whole_file(path)) for path in paths]
        with plt.rc_context({"svg.hashsalt": "paperrepro"}):
            figure.savefig(parts[0], format="png", dpi=300)
            figure.savefig(parts[1], format="svg", dpi=200, metadata={"Date": None})
        if data is not None:
            data.to_csv(parts[2], index=False, float_format="%.10g")
    return paths
