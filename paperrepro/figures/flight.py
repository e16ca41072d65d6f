"""An operator's own flight: pictures of what its calibration changed, and the report, a page that
needs nothing else."""

import io
from collections.abc import Iterable, Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.image import AxesImage

from paperrepro.figures import SCENARIO_COLOURS, STRIP_COLOURS, STYLE, canvas, thinned
from paperrepro.figures.calibration import correlation_matrix
from paperrepro.figures.pages import Picture, Table, render
from paperrepro.flight.calibrate import OwnFlight
from paperrepro.frames import ANGLES
from paperrepro.method.accuracy import PairDistances, median_ratio, nmad, rmse
from paperrepro.method.adjustment.observability import AXIS_WORDS
from paperrepro.method.georeference import georeference
from paperrepro.paper.numbers import SYMBOLS, number
from paperrepro.study.statistics import TWO_SIDED

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
    """RMS distance of every pair of strips, before, after and with the trajectory adjusted, on a
    logarithmic axis."""
    y = np.arange(len(distances))[::-1]
    before = [CM * rmse(pair.before) for pair in distances]
    after = [CM * rmse(pair.after) for pair in distances]
    ax.hlines(y, after, before, color="#bfbfbf", lw=1.2, zorder=1)
    ax.plot(before, y, "o", color=SCENARIO_COLOURS["before"], label="before")
    ax.plot(after, y, "D", ms=4.5, color=SCENARIO_COLOURS["D"], label="after")
    if any(pair.adjusted is not None for pair in distances):
        adjusted = [CM * rmse(pair.adjusted) for pair in distances]
        ax.plot(adjusted, y, "D", ms=4.5, mfc="white", color=SCENARIO_COLOURS["D"],
                label="trajectory adjusted, too")  # fmt: skip
    ax.set_yticks(y, [_plain(f"{pair.first} – {pair.second}") for pair in distances])
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter("{x:g}")
    ax.grid(axis="x", which="both", lw=0.4)
    ax.set_ylim(-0.7, len(distances) - 0.3)
    ax.set_xlabel("RMS distance between the strips (cm)")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 1.0 + 0.9 / (len(distances) + 1)),
              ncols=3)  # fmt: skip
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


def difference_image(
    ax: Axes, p_m: np.ndarray, distances: np.ndarray, limit_m: float, cell_m: float = 1.0
) -> AxesImage:
    """Seen from above: mean of ``distances`` (N,) m of one strip's points (N, 3) m from another,
    in cells of ``cell_m``; colours end at ``limit_m``, and cells without points stay white.
    """
    low, high = p_m[:, :2].min(axis=0), p_m[:, :2].max(axis=0) + cell_m
    edges = [np.arange(a, b + cell_m, cell_m) for a, b in zip(low, high, strict=True)]
    count, *_ = np.histogram2d(*p_m[:, :2].T, edges)
    total, *_ = np.histogram2d(*p_m[:, :2].T, edges, weights=CM * distances)
    mean = np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)
    extent = (edges[0][0], edges[0][-1], edges[1][0], edges[1][-1])
    image = ax.imshow(mean.T, cmap="RdBu_r", vmin=-CM * limit_m, vmax=CM * limit_m, origin="lower",
                      extent=extent, interpolation="nearest")  # fmt: skip
    ax.set_xlabel("east (m)")
    ax.set_ylabel("north (m)")
    return image


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
    return Picture.of(text.getvalue(), "svg+xml", size, title=title, alt=alt, caption=caption)


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


# The report

#: What a reader is told of a scenario, in a few words.
SCENARIOS = {
    "SL": "boresight, range offsets and planes, points on planes (Skaloud and Lichti 2006)",
    "A": "boresight, centroids on the planes of reference strips",
    "B": "boresight and range offsets, points and centroids on the planes of reference strips",
    "C": "boresight, range offsets and planes, points and centroids on planes",
    "D": "boresight, range offsets, planes and the error of the trajectory over time",
}


def page(
    own: OwnFlight, pictures: Mapping[str, Picture], files: Mapping[str, str], notes: Iterable[str]
) -> str:
    """The report as text.

    Parameters
    ----------
    own : OwnFlight
        What `paperrepro.calibrate_flight` gives.
    pictures : mapping of str to Picture
        As `pictures` draws them.
    files, notes
        The files that were read, by what they are; sentences on the reading.
    """
    result, scanner = own.result, own.survey.scanner
    return render(
        "calibration_template.html",
        own=own, result=result, seen=result.observability, scenario_words=SCENARIOS,
        reasons=str(result.observability).split("; ")[2:], strips=len(own.survey.strips),
        scanner=scanner.name, navigation=own.survey.navigation.name, pictures=pictures,
        files=files, notes=[*notes, *own.remarks], angles=_angles(own),
        offsets=_offsets(own), pairs=_pair_table(own), planes=_planes(own), rejected=_rejected(own),
        noise=_noise(own), weak=_reliability(own), cm=CM, ratio=median_ratio(own.distances),
        passes=np.degrees(own.boresights), heights=_heights(own), heights_at=_heights_of(own),
    )  # fmt: skip


def _angles(own: OwnFlight) -> Table:
    result, lasting = own.result, own.result.observability.lasting_sigma
    lines = []
    for k, (angle, axis) in enumerate(zip(ANGLES, AXIS_WORDS, strict=True)):
        value, sigma = np.degrees(result.boresight[k]), np.degrees(result.sigma[k])
        ends = [number(value + way * TWO_SIDED * sigma, 4) for way in (-1, 1)]
        lines.append(
            (
                f"{SYMBOLS[angle]} ({axis})", number(value, 4), number(sigma, 4),
                f"{ends[0]} to {ends[1]}",
                "" if lasting is None else number(np.degrees(lasting[k]), 4),
                "no" if axis in result.observability.undetermined else "yes",
            )
        )  # fmt: skip
    heads = [
        "angle", "estimate (°)", "σ (°)", "95 % interval (°)",
        "σ under lasting trajectory errors (°)", "determined",
    ]  # fmt: skip
    return Table(heads, lines, ["word", *["number"] * 4, "word"])


def _offsets(own: OwnFlight) -> Table | None:
    result = own.result
    if result.range_offsets is None:
        return None
    elevation = np.degrees(own.survey.scanner.beam_elevations)
    both = [(CM * result.range_offsets[k], CM * s) for k, s in enumerate(result.sigma_offsets)]
    if not len(elevation):
        lines = [(number(offset, 2), number(sigma, 2)) for offset, sigma in both]
        return Table(["range offset (cm)", "σ (cm)"], lines, ["number"] * 2)
    lines = [
        (str(ring), *(number(v, 2) for v in (elevation[ring], offset, sigma)))
        for ring, (offset, sigma) in enumerate(both)
    ]
    return Table(["ring", "elevation (°)", "range offset (cm)", "σ (cm)"], lines, ["number"] * 4)


def _pair_table(own: OwnFlight) -> Table:
    lines = []
    for pair in own.distances:
        stages = [d for d in (pair.before, pair.after, pair.adjusted) if d is not None]
        rms, middle = [rmse(d) for d in stages], [np.median(np.abs(d)) for d in stages]
        lines.append(
            (
                f"{pair.first} – {pair.second}", number(100 * pair.overlap, 0),
                number(len(pair.before)), *(number(CM * value, 1) for value in (*rms, *middle)),
            )
        )  # fmt: skip
    names = ["before", "after", "trajectory adjusted"]
    names = names if any(pair.adjusted is not None for pair in own.distances) else names[:2]
    heads = [f"{what} {name} (cm)" for what in ("RMS", "median |d|") for name in names]
    heads = ["strips", "overlap (%)", "points", *heads]
    return Table(heads, lines, ["word", *["number"] * (len(heads) - 1)])


#: How the report calls the clouds whose heights are compared.
CLOUDS = {"before": "before", "mounting": "mounting", "trajectory": "mounting and trajectory"}


def _heights(own: OwnFlight) -> Table | None:
    """Vertical accuracy at the checkpoints, cloud by cloud."""
    if own.checkpoints is None:
        return None
    found = {cloud: own.checkpoints.accuracy(cloud) for cloud in own.checkpoints.offsets}
    lines = [
        (CLOUDS[cloud], number(one.n), number(CM * one.mean, 1, signed=True),
         number(CM * one.rmse, 1), number(CM * one.at_95, 1))
        for cloud, one in found.items() if one
    ]  # fmt: skip
    heads = ["cloud", "points", "mean (cm)", "RMSE (cm)", "95 % (cm)"]
    return Table(heads, lines, ["word", *["number"] * 4])


def _heights_of(own: OwnFlight) -> Table | None:
    """Cloud minus checkpoint, point by point."""
    checked = own.checkpoints
    if checked is None:
        return None
    why = dict.fromkeys(checked.off, "off the strips") | dict.fromkeys(checked.uneven, "uneven")
    lines = [
        (name, number(CM * checked.points.sigma[k], 1),
         *("" if np.isnan(of[k]) else number(CM * of[k], 1, signed=True)
           for of in checked.offsets.values()), why.get(name, ""))
        for k, name in enumerate(checked.points.names)
    ]  # fmt: skip
    heads = ["point", "σ (cm)", *(f"{CLOUDS[cloud]} (cm)" for cloud in checked.offsets), "not used"]
    return Table(heads, lines, ["word", *["number"] * (len(heads) - 2), "word"])


def _planes(own: OwnFlight) -> Table:
    """The planes of the result: how they lie, who sees them, how well their points fit."""
    result, ties = own.result, own.tie_planes
    middle = ties.plane_states(result.calibrated).centroid
    lines = []
    for k, plane in enumerate(result.planes):
        slope = np.degrees(np.arccos(np.clip(plane[2], -1, 1)))
        azimuth = np.degrees(np.arctan2(plane[0], plane[1])) % 360
        lines.append(
            (
                str(k), ", ".join(np.array(ties.strips)[ties.plane == k]),
                number(result.points_per_plane[k]), number(slope, 1),
                number(azimuth, 0) if slope > 1 else "", *(number(x, 1) for x in middle[k]),
                number(CM * result.rms_before[k], 1), number(CM * result.rms_after[k], 1),
            )
        )  # fmt: skip
    heads = [
        "plane", "seen in", "points", "slope (°)", "faces (° from north)", "east (m)",
        "north (m)", "up (m)", "RMS before (cm)", "RMS after (cm)",
    ]  # fmt: skip
    return Table(heads, lines, ["word", "word", *["number"] * 8])


def _rejected(own: OwnFlight) -> Table:
    lines = [
        (
            face.strip, *(number(x, 1) for x in face.centroid),
            number(CM * face.misfit_m, 1), number(CM * face.limit_m, 1),
        )
        for face in own.rejected
    ]  # fmt: skip
    heads = ["strip", "east (m)", "north (m)", "up (m)", "misses by (cm)", "limit (cm)"]
    return Table(heads, lines, ["word", *["number"] * 5])


def _reliability(own: OwnFlight) -> Table | None:
    """Of each plane, the view in which a gross error hides best: how much of it shows, how large it
    must be to be found, and how far it turns the boresight if it is not."""
    views = own.result.reliability
    if views is None:
        return None
    lines = []
    for plane in np.argsort(-views.of_planes()):
        of_plane = np.flatnonzero(views.plane == plane)
        worst = of_plane[np.argmax(views.detectable[of_plane])]
        turned = np.degrees(np.abs(views.turns[worst]))
        lines.append(
            (
                str(plane), views.strip[worst], number(100 * views.redundancy[worst], 2),
                number(CM * views.detectable[worst], 1), *(number(angle, 4) for angle in turned),
                number(np.abs(views.standardised[of_plane]).max(), 1),
            )
        )  # fmt: skip
    heads = [
        "plane", "weakest in", "redundancy (%)", "detectable (cm)",
        *(f"turns {SYMBOLS[angle]} (°)" for angle in ANGLES), "largest bias (σ)",
    ]  # fmt: skip
    return Table(heads, lines, ["word", "word", *["number"] * 6])


def _noise(own: OwnFlight) -> Table | None:
    """What the data say of the specifications, where scenario D asked them."""
    factors = own.result.components
    if factors is None:
        return None
    navigation, scanner = own.survey.navigation, own.survey.scanner
    tau = navigation.correlation_time
    east, north, up = (number(CM * sigma, 1) for sigma in navigation.position_sigma)
    roll, pitch, heading = (number(np.degrees(sigma), 3) for sigma in navigation.attitude_sigma)
    specified = {
        "horizontal": f"{east}, {north} cm", "height": f"{up} cm",
        "roll_pitch": f"{roll}, {pitch}°", "heading": f"{heading}°",
    }  # fmt: skip
    laser = f"{number(CM * scanner.range_sigma, 1)} cm"
    lines = [("laser range", laser, number(factors["range"], 2), "", "")]
    lines += [
        (
            name.replace("_", ", "), words, number(factors[name], 2),
            number(tau * factors[f"{name}_time"], 0), number(factors[f"{name}_fast"], 2),
        )
        for name, words in specified.items()
    ]  # fmt: skip
    surfaces = {
        "surface of a view": "surface_m", "roughness": "roughness_m", "bend of a face": "bending_m",
    }  # fmt: skip
    for name, key in surfaces.items():
        lines.append((name, "", f"{number(CM * factors[key], 2)} cm", "", ""))
    heads = ["σ of", "specified", "factor found", "lasting (s)", "share of a second's errors"]
    return Table(heads, lines, ["word", "word", "number", "number", "number"])
