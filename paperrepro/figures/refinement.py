"""Fig. 5, 6 and 9: points projected on target planes, roof profiles under several mountings, and a
profile that moves with the boresight: still in a picture, moving under sliders."""

from base64 import b64encode
from dataclasses import dataclass
from io import BytesIO

import ipywidgets as widgets
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgba_array
from matplotlib.lines import Line2D
from PIL import Image

from paperrepro.figures import SCENARIO_COLOURS, STRIP_COLOURS, canvas, scenario_name, thinned
from paperrepro.method.accuracy import rmse
from paperrepro.method.georeference import georeference
from paperrepro.paper.numbers import ANGLE_NAMES, SYMBOLS
from paperrepro.survey import Mounting, Rays

TARGET, POINT, FOOT = "#0072b2", "#d55e00", "#000000"


def projection(ax: Axes, target: np.ndarray, points: np.ndarray, feet: np.ndarray) -> Axes:
    """Fig. 5 in section: points of the ``target`` face, its plane through the ``feet`` (N, 2)
    of the projected ``points`` (N, 2), all as (across, up) m."""
    target, words = thinned(target, 100), "points of the target face"
    ax.plot(*target.T, "o", ms=2, mew=0, color=TARGET, alpha=0.5, label=words)
    ends = feet[[np.argmin(feet[:, 0]), np.argmax(feet[:, 0])]]
    ax.plot(*ends.T, color=TARGET, lw=1.2, label="target plane $π_T$")
    for point, foot in zip(points, feet, strict=True):
        ax.plot(*np.array([point, foot]).T, color=FOOT, lw=0.6, ls=(0, (3, 2)))
    ax.plot(*points.T, "o", ms=3.5, mew=0, color=POINT, label="points $p_j$ of the other strip")
    ax.plot(*feet.T, "o", ms=3, mfc="white", mec=FOOT, mew=0.7, ls="", label="projections $p_T$")
    ax.set_aspect("equal")
    ax.set(xlabel="down the slope (m)", ylabel="up (m)")
    ax.figure.legend(loc="outside lower center", ncols=2)
    return ax


@dataclass(frozen=True)
class Section:
    """A vertical section through ``origin`` (3,) m: ``along`` (3,) looks through it, ``across``
    (3,) lies in it, level."""

    origin: np.ndarray
    along: np.ndarray
    across: np.ndarray

    @classmethod
    def of_ridge(cls, left: np.ndarray, right: np.ndarray, near_m: np.ndarray) -> "Section":
        """Across the ridge of two planes (4,) as (n, d), where it passes ``near_m`` (3,)."""
        ridge = np.cross(left[:3], right[:3])
        ridge /= np.linalg.norm(ridge)
        origin = np.linalg.solve([left[:3], right[:3], ridge], [left[3], right[3], ridge @ near_m])
        across = np.cross(ridge, [0.0, 0.0, 1.0])
        return cls(origin, ridge, across / np.linalg.norm(across))

    @classmethod
    def down_slope(cls, normal: np.ndarray, origin: np.ndarray) -> "Section":
        """Down the slope of a plane with ``normal`` (3,), so that the normal lies in it."""
        across = np.array([normal[0], normal[1], 0.0]) / np.hypot(normal[0], normal[1])
        return cls(origin, np.cross(across, [0.0, 0.0, 1.0]), across)

    def coordinates(self, p_m: np.ndarray) -> np.ndarray:
        """(N, 2) across and up, m, of points (N, 3)."""
        return np.column_stack([(p_m - self.origin) @ self.across, p_m[:, 2]])

    def gable_line(self, planes: np.ndarray, reach_m: float) -> np.ndarray:
        """(3, 2) across and up, m, of the planes (2, 4) of a gable: eaves, ridge, eaves."""
        rise = np.sort(-(planes[:, :3] @ self.across) / planes[:, 2])[::-1]
        across_m = np.array([-reach_m, 0.0, reach_m])
        return np.column_stack([across_m, self.origin[2] + [rise[0], 0.0, rise[1]] * across_m])

    def table(self, clouds: dict[str, np.ndarray], strips: np.ndarray, half_m: float):
        """Points (N, 3) of the ``clouds`` within ``half_m`` of the section, of ``strips`` (N,), by
        name: columns cloud, strip, across_m, up_m."""
        tables = []
        for name, p_m in clouds.items():
            near = np.abs(p_m @ self.along - self.origin @ self.along) < half_m
            across_m, up_m = self.coordinates(p_m[near]).T
            columns = {"cloud": name, "strip": strips[near], "across_m": across_m, "up_m": up_m}
            tables.append(pd.DataFrame(columns))
        return pd.concat(tables, ignore_index=True)


def by_strip(ax: Axes, table: pd.DataFrame, size: float = 3.0, legend: bool = False) -> Axes:
    """Points of a section's table in their strips' colours, shuffled so that none lies on top."""
    table = thinned(table, 20_000).sample(frac=1, random_state=0)
    ax.scatter(table.across_m, table.up_m, s=size, lw=0, color=table.strip.map(STRIP_COLOURS),
               rasterized=True)  # fmt: skip
    if legend:
        _strip_legend(ax, table.strip)
    ax.set_aspect("equal")
    return ax


def _strip_legend(ax: Axes, strips) -> None:
    names = sorted(set(strips))
    handles = [Line2D([], [], ls="", marker="o", color=STRIP_COLOURS[s], label=s) for s in names]
    ax.figure.legend(handles=handles, loc="outside lower center", ncols=len(names))


def by_scenario(ax: Axes, table: pd.DataFrame, scenarios, reference: np.ndarray, size=3.0) -> Axes:
    """Fig. 6b: points under the scenarios' mountings over the ``reference`` (K, 2), m."""
    table = table[table.cloud.isin(scenarios)].sample(frac=1, random_state=0)
    ax.scatter(table.across_m, table.up_m, s=size, lw=0, color=table.cloud.map(SCENARIO_COLOURS),
               rasterized=True)  # fmt: skip
    for name in scenarios:
        ax.plot([], [], "o", color=SCENARIO_COLOURS[name], label=scenario_name(name))
    reference_line(ax, reference)
    ax.set_aspect("equal")
    return ax


def reference_line(ax: Axes, reference: np.ndarray) -> None:
    """The reference's planes in section: eaves, ridge, eaves (K, 2), m."""
    ax.plot(*reference.T, color="#c00000", lw=1.0, label="reference", zorder=5)


def angle_changes(ax: Axes, table: pd.DataFrame) -> Axes:
    """Errors of the angles after calibration (open) and after refinement (filled): ``table`` has
    ``scenario``, ``angle``, ``calibrated_error_deg``, ``refined_error_deg``."""
    angles, scenarios = list(dict.fromkeys(table.angle)), list(dict.fromkeys(table.scenario))
    step = 0.72 / len(scenarios)
    for k, name in enumerate(scenarios):
        rows = table[table.scenario == name]
        x = np.arange(len(rows)) + (k - (len(scenarios) - 1) / 2) * step
        colour = SCENARIO_COLOURS[name]
        ax.vlines(x, rows.calibrated_error_deg, rows.refined_error_deg, color=colour, lw=1)
        ax.plot(x, rows.calibrated_error_deg, "o", mfc="white", mec=colour)
        ax.plot(x, rows.refined_error_deg, "o", color=colour, label=scenario_name(name))
    ax.axhline(0, color=SCENARIO_COLOURS["truth"], lw=0.7)
    ax.set_xticks(range(len(angles)), [ANGLE_NAMES[angle] for angle in angles])
    ax.set_ylabel("estimate − truth (°)")
    handles, labels = ax.get_legend_handles_labels()
    handles.append(Line2D([], [], ls="", marker="o", mfc="white", mec="#4d4d4d"))
    labels.append("before refinement")
    ax.figure.legend(handles, labels, loc="outside lower center", ncols=5, columnspacing=1)
    return ax


@dataclass(frozen=True)
class MovingProfile:
    """A gable that several strips see, to be looked at under any boresight.

    ``rays`` of N points on it, their ``strips`` (N,) and the ``planes`` (N, 4) as (n, d) that they
    should lie on; ``mounting`` whose range offsets stay; ``section`` that is drawn, as far as
    ``half_m`` before and behind, with the reference as a ``line`` (3, 2) across and up, m.
    """

    rays: Rays
    strips: np.ndarray
    planes: np.ndarray
    mounting: Mounting
    section: Section
    line: np.ndarray
    half_m: float = 0.75

    def points(self, boresight_deg) -> np.ndarray:
        """(N, 3) m, m-frame, under the angles omega, phi, kappa (3,)."""
        offsets = self.mounting.range_offsets
        return georeference(
            self.rays, self.mounting.with_calibration(np.radians(boresight_deg), offsets)
        )

    def rmse(self, p_m: np.ndarray) -> float:
        """Of the distances of all points (N, 3) from their planes, m."""
        distance = np.einsum("na,na->n", p_m, self.planes[:, :3])
        return rmse(distance - self.planes[:, 3])

    def draw(self, ax: Axes, boresight_deg, legend: bool = False) -> Axes:
        """The section by strip; angles and RMSE in the title."""
        ax.scatter([], [], s=3.0, lw=0, rasterized=True)
        if legend:
            _strip_legend(ax, self.strips)
        reference_line(ax, self.line)
        reach, up_m = 1.3 * np.abs(self.line[:, 0]).max(), self.line[:, 1]
        ax.set(xlabel="across the ridge (m)", ylabel="up (m)", xlim=(-reach, reach), aspect="equal")
        ax.set_ylim(up_m.min() - 0.9, up_m.max() + 0.9)
        self.move(ax, boresight_deg)
        return ax

    def move(self, ax: Axes, boresight_deg) -> list[Artist]:
        """What `draw` has drawn, under other angles; gives what moves and what lies over it."""
        p_m = self.points(boresight_deg)
        near = np.abs((p_m - self.section.origin) @ self.section.along) < self.half_m
        order = np.random.default_rng(0).permutation(np.flatnonzero(near))  # none lies on top
        names, strip = np.unique(self.strips, return_inverse=True)
        (dots,) = ax.collections
        dots.set_offsets(self.section.coordinates(p_m[order]))
        dots.set_facecolor(to_rgba_array([STRIP_COLOURS[s] for s in names])[strip[order]])
        angles = zip(SYMBOLS.values(), boresight_deg, strict=True)
        words = [f"{symbol} {angle:.2f}°" for symbol, angle in angles]
        title = ax.set_title(f"{', '.join(words)}\nRMSE {100 * self.rmse(p_m):.1f} cm")
        return [dots, *ax.lines, title]


class Sliders(widgets.VBox):
    """Sliders for the three angles, ``reach_deg`` about ``start_deg`` (3,), over the picture of a
    `MovingProfile` that they redraw; without a running kernel the picture at the start."""

    #: Width of the picture on the screen, CSS pixels; it has two of its own for each.
    WIDTH_PX = 560

    def __init__(self, profile: MovingProfile, start_deg, reach_deg: float = 1.0):
        sliders = [
            widgets.FloatSlider(
                value=start, min=start - reach_deg, max=start + reach_deg, step=0.01,
                description=name, readout_format=".2f", style={"description_width": "80px"},
                layout={"width": f"{self.WIDTH_PX}px"},
            )
            for name, start in zip(ANGLE_NAMES.values(), start_deg, strict=True)
        ]  # fmt: skip
        figure, ax = canvas("single", 52)
        plt.close(figure)
        figure.set_dpi(2 * self.WIDTH_PX / figure.get_figwidth())
        drawing = FigureCanvasAgg(figure)
        profile.draw(ax, start_deg, legend=True)
        moving = profile.move(ax, start_deg)
        for artist in moving:
            artist.set_animated(True)
        drawing.draw()
        still = drawing.copy_from_bbox(figure.bbox)

        def png() -> bytes:
            """What moves, over what is drawn once: axes and legend take most of the time."""
            drawing.restore_region(still)
            for artist in moving:
                ax.draw_artist(artist)
            pixels = Image.fromarray(np.asarray(drawing.buffer_rgba())[..., :3])
            with BytesIO() as file:  # of 256 colours: a third of the bytes in a third of the time
                pixels.quantize(256, Image.Quantize.FASTOCTREE, dither=0).save(file, "png")
                return file.getvalue()

        def redraw(_) -> None:
            profile.move(ax, [slider.value for slider in sliders])
            picture.value = png()

        picture = widgets.Image(value=png(), layout={"width": f"{self.WIDTH_PX}px"})
        for slider in sliders:
            slider.observe(redraw, names="value")
        super().__init__([*sliders, picture])

    def _repr_mimebundle_(self, **kwargs):
        shown = super()._repr_mimebundle_(**kwargs)
        shown["image/png"] = b64encode(self.children[-1].value).decode()
        shown["text/plain"] = "Three sliders over a picture: run this cell in JupyterLab"
        return shown, {"image/png": {"width": self.WIDTH_PX}}
