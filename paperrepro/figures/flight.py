"""Pictures of an operator's own flight and of what its calibration changed."""

import io
from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from paperrepro.figures import SCENARIO_COLOURS, STRIP_COLOURS, STYLE, canvas, thinned
from paperrepro.figures.calibration import correlation_matrix
from paperrepro.figures.pages import Picture
from paperrepro.flight.calibrate import OwnFlight
from paperrepro.method.accuracy import PairDistances, nmad, rmse
from paperrepro.method.georeference import georeference
from paperrepro.paper.numbers import SYMBOLS, number

CM = 100.0


def strip_colours(names: Sequence[str]) -> dict[str, str]:
    """A colour for each strip, its own where it has one; from the ninth strip on they repeat."""
    cycle = list(STRIP_COLOURS.values())
    return {n: STRIP_COLOURS.get(n, cycle[k % len(cycle)]) for k, n in enumerate(names)}


def _plain(name: str) -> str:
    """A strip's name that is not read as a formula."""
    return name.replace("$", r"\$")


def flight_map(
    ax: Axes, points_m: Mapping[str, np.ndarray], paths_m: Mapping[str, np.ndarray], planes_m
) -> Axes:
    """Strips seen from above, ``points_m`` (N, 3) each, the trajectory over them, ``paths_m``
    (M, 3) in order of time, and the middles of the planes, ``planes_m`` (G, 3)."""
    colours = strip_colours(list(points_m))
    for name, p_m in points_m.items():
        few = thinned(p_m, 1500)
        ax.plot(few[:, 0], few[:, 1], ".", ms=1.2, mew=0, alpha=0.55, color=colours[name],
                rasterized=True)  # fmt: skip
    for name, path in paths_m.items():
        ax.plot(path[:, 0], path[:, 1], color=colours[name], lw=1.6, label=_plain(name))
        middle = len(path) // 2
        if (step := path[min(middle + 1, len(path) - 1)] - path[middle])[:2].any():
            ax.annotate("", path[middle, :2] + step[:2] / np.linalg.norm(step[:2]),
                        path[middle, :2], arrowprops={"arrowstyle": "-|>", "lw": 0,
                        "color": colours[name], "mutation_scale": 14})  # fmt: skip
    ax.plot(planes_m[:, 0], planes_m[:, 1], "s", ms=3, mfc="white", mec="black", mew=0.7,
            label="planes used")  # fmt: skip
    ax.set_aspect("equal")
    ax.set_xlabel("east (m)")
    ax.set_ylabel("north (m)")
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), handlelength=1.2)
    return ax


def pair_changes(ax: Axes, distances: Sequence[PairDistances]) -> Axes:
    """RMS distance of every pair of strips, before and after, on a logarithmic axis."""
    y = np.arange(len(distances))[::-1]
    before = [CM * rmse(pair.before) for pair in distances]
    after = [CM * rmse(pair.after) for pair in distances]
    ax.hlines(y, after, before, color="#bfbfbf", lw=1.2, zorder=1)
    ax.plot(before, y, "o", color=SCENARIO_COLOURS["before"], label="before")
    ax.plot(after, y, "D", ms=4.5, color=SCENARIO_COLOURS["D"], label="after")
    ax.set_yticks(y, [_plain(f"{pair.first} – {pair.second}") for pair in distances])
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter("{x:g}")
    ax.grid(axis="x", which="both", lw=0.4)
    ax.set_ylim(-0.7, len(distances) - 0.3)
    ax.set_xlabel("RMS distance between the strips (cm)")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 1.0 + 0.9 / (len(distances) + 1)),
              ncols=2)  # fmt: skip
    return ax


def distance_histogram(ax: Axes, distances: np.ndarray, colour: str, words: str) -> Axes:
    """Signed distances (N,) m within their 99 % span, with median and robust spread in words."""
    limit = np.quantile(np.abs(distances), 0.99)
    ax.hist(CM * distances, np.linspace(-CM * limit, CM * limit, 61), color=colour, alpha=0.75)
    ax.axvline(0.0, color="#4d4d4d", lw=0.6)
    ax.set_title(f"{words}\nmedian {number(CM * np.median(distances), 1)} cm, "
                 f"robust σ {number(CM * nmad(distances), 1)} cm")  # fmt: skip
    ax.set_xlabel("distance between strips (cm)")
    ax.set_ylabel("points")
    return ax


def plane_directions(ax: Axes, normals: np.ndarray) -> Axes:
    """Which way planes (G, 3) face: direction from north clockwise, slope outwards, polar axes."""
    azimuth = np.arctan2(normals[:, 0], normals[:, 1])
    slope = np.degrees(np.arccos(np.clip(normals[:, 2], -1, 1)))
    ax.set_theta_zero_location("N")
    ax.set_theta_direction(-1)
    ax.plot(azimuth, slope, "o", ms=3.5, mew=0, alpha=0.7, color=SCENARIO_COLOURS["SL"])
    ax.set_rlim(0, max(10.0, 1.1 * float(slope.max())))
    ax.set_rlabel_position(22.5)
    ax.yaxis.set_major_formatter("{x:.0f}°")
    ax.set_xticks(np.radians(np.arange(0, 360, 90)), ["N", "E", "S", "W"])
    return ax


def pictures(own: OwnFlight) -> dict[str, Picture]:
    """All pictures of the report on an `OwnFlight`, by the names its template asks for."""
    with plt.style.context(STYLE):
        drawn = {
            "map": _map(own), "directions": _directions(own), "correlation": _correlation(own)
        }  # fmt: skip
        if own.distances:
            drawn |= {"pairs": _pairs(own), "histogram": _histogram(own)}
    return drawn


def _picture(figure, title: str, alt: str, caption: str) -> Picture:
    text = io.BytesIO()
    with plt.rc_context({"svg.hashsalt": "paperrepro"}):
        figure.savefig(text, format="svg", dpi=200, metadata={"Date": None})
    size = 1.25 * 96 * figure.get_size_inches()
    plt.close(figure)
    return Picture.of(text.getvalue(), size, title=title, alt=alt, caption=caption)


def _map(own: OwnFlight) -> Picture:
    survey, mounting = own.survey, own.result.calibrated
    points, paths = {}, {}
    for strip in survey.strips:
        few = np.linspace(0, len(strip) - 1, min(1500, len(strip))).astype(int)
        rays = survey.rays(strip, few)
        points[strip.name] = georeference(rays, mounting)
        paths[strip.name] = rays.pose[np.argsort(rays.time, kind="stable"), :3]
    planes = own.tie_planes.plane_states(mounting).centroid
    figure, ax = canvas("double", 105)
    flight_map(ax, points, paths, planes)
    words = f"{len(points)} strips, their trajectory and {len(planes)} planes seen from above"
    return _picture(figure, "Map", f"Map: {words}.", f"{words}; arrows point in flight direction.")


def _pairs(own: OwnFlight) -> Picture:
    figure, ax = canvas("double", 28 + 5.2 * len(own.distances))
    pair_changes(ax, own.distances)
    words = "RMS distance of each pair of strips before and after calibration"
    return _picture(figure, "Pairs", f"{words}; the values are in the table below.", f"{words}.")


def _histogram(own: OwnFlight) -> Picture:
    figure, axes = canvas("double", 62, ncols=2)
    for ax, when, colour in zip(axes, ("before", "after"), ("before", "D"), strict=True):
        values = np.concatenate([getattr(pair, when) for pair in own.distances])
        distance_histogram(ax, values, SCENARIO_COLOURS[colour], f"{when} calibration")
    words = "Histograms of the distances between strips, before and after calibration"
    caption = f"{words}. Mind the different scales."
    return _picture(figure, "Histograms", f"{words}.", caption)


def _correlation(own: OwnFlight) -> Picture:
    size = len(own.result.covariance)
    labels = [*SYMBOLS.values(), *(f"Δρ {k}" for k in range(size - 3))]
    figure, ax = canvas("single", 72)
    correlation_matrix(ax, own.result.correlation, labels)
    largest = _strongest(own.result.correlation[:3, :3], labels[:3])
    words = f"Correlations between the {size} unknowns"
    after = f"{words}: angles, then range offsets. {largest}" if size > 3 else f"{words}. {largest}"
    return _picture(figure, "Correlations", f"{words}. {largest}", after)


def _strongest(correlation: np.ndarray, labels: Sequence[str]) -> str:
    """A sentence on the strongest correlation between two of ``labels``."""
    off = np.abs(np.triu(correlation, 1))
    i, j = np.unravel_index(off.argmax(), off.shape)
    value = number(correlation[i, j], 2, signed=True)
    return f"The strongest between angles: {labels[i]} and {labels[j]}, {value}."


def _directions(own: OwnFlight) -> Picture:
    figure, ax = canvas("single", 70, subplot_kw={"projection": "polar"})
    plane_directions(ax, own.result.planes[:, :3])
    words = "Slope and direction that the planes face"
    caption = (
        f"{words}. Planes that face many ways, steeply, separate the three angles; level ground "
        "alone does not tell yaw."
    )
    return _picture(figure, "Planes", f"{words}, on a compass.", caption)
