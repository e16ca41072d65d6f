"""``report.html`` of an operator's calibration: one self-contained page, numbers from the result.

It is given its pictures, for what measures does not draw.
"""

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import jinja2
import numpy as np

from paperrepro import __version__
from paperrepro.adjustment.faces import face_states
from paperrepro.adjustment.normals import Unknowns
from paperrepro.adjustment.observability import AXIS_WORDS
from paperrepro.calibration_file import ANGLES
from paperrepro.own_flight import OwnFlight
from paperrepro.strip_distances import rms

HERE = Path(__file__).parent
NAME = "report.html"
CM = 100.0
SYMBOLS = {"omega": "Δω", "phi": "Δφ", "kappa": "Δκ"}
#: What a reader is told of a scenario, in a few words.
SCENARIOS = {
    "SL": "boresight and planes, points on planes (Skaloud and Lichti 2006)",
    "A": "boresight, centroids on the planes of reference strips",
    "B": "boresight and range offsets, points and centroids on the planes of reference strips",
    "C": "boresight, range offsets and planes, points and centroids on planes",
    "D": "boresight, range offsets, planes and the error of the trajectory over time",
}


@dataclass(frozen=True)
class Picture:
    """An SVG with its size in CSS pixels, a title, and words for those who do not see it."""

    svg: bytes
    width: float
    height: float
    title: str
    alt: str
    caption: str

    @property
    def uri(self) -> str:
        """The picture as a data URI."""
        return f"data:image/svg+xml;base64,{base64.b64encode(self.svg).decode()}"


@dataclass(frozen=True)
class Table:
    """``heads``, lines of texts, and which columns hold words instead of numbers."""

    heads: tuple[str, ...]
    lines: list[tuple[str, ...]]
    words: frozenset[int] = frozenset({0})

    @property
    def classes(self) -> tuple[str, ...]:
        """Of each column, by which the page sets it."""
        return tuple("word" if k in self.words else "number" for k in range(len(self.heads)))


def page(own: OwnFlight, pictures: Mapping[str, Picture], files: Mapping[str, str], notes) -> str:
    """The report as text. ``pictures`` by the names that the template asks for, ``files`` that
    were read by what they are, ``notes`` of the reading, a sentence each."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(HERE), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    result = own.result
    return environment.get_template("calibration_template.html").render(
        css=(HERE / "report.css").read_text(encoding="utf-8"),
        own=own, result=result, seen=result.observability, scenario_words=SCENARIOS,
        reasons=str(result.observability).split("; ")[2:],
        strips=len(own.survey.strips), scanner=own.survey.scanner.name,
        navigation=own.survey.navigation.name, pictures=pictures, files=files,
        notes=[*notes, *own.remarks], angles=angle_table(own), offsets=offset_table(own),
        pairs=pair_table(own), planes=plane_table(own), rejected=rejected_table(own),
        noise=noise_table(own), version=__version__, cm=CM, ratio=median_ratio(own),
    )  # fmt: skip


def median_ratio(own: OwnFlight) -> float | None:
    """Distance between the strips after, as a share of that before: of all points of all pairs."""
    if not own.distances:
        return None
    before, after = (
        np.concatenate([getattr(pair, when) for pair in own.distances])
        for when in ("before", "after")
    )
    return float(np.median(np.abs(after)) / np.median(np.abs(before)))


def angle_table(own: OwnFlight) -> Table:
    result, lasting = own.result, own.result.observability.lasting_sigma
    lines = []
    for k, (name, axis) in enumerate(zip(ANGLES, AXIS_WORDS, strict=True)):
        value, sigma = np.degrees(result.boresight[k]), np.degrees(result.sigma[k])
        said = "no" if axis in result.observability.undetermined else "yes"
        lasts = "" if lasting is None else f"{np.degrees(lasting[k]):.4f}"
        span = f"{_signed(value - 1.96 * sigma)} to {_signed(value + 1.96 * sigma)}"
        lines.append(
            (f"{SYMBOLS[name]} ({axis})", _signed(value), f"{sigma:.4f}", span, lasts, said)
        )
    heads = (
        "angle", "estimate (°)", "σ (°)", "95 % interval (°)",
        "σ under lasting trajectory errors (°)", "determined",
    )  # fmt: skip
    return Table(heads, lines, frozenset({0, 5}))


def _signed(value: float) -> str:
    """With a minus sign that is as wide as a plus."""
    return f"{value:.4f}".replace("-", "−")


def offset_table(own: OwnFlight) -> Table | None:
    result = own.result
    if result.range_offsets is None:
        return None
    elevation = np.degrees(own.survey.scanner.beam_elevations)
    lines = [
        (str(k), f"{elevation[k]:.2f}", f"{CM * offset:.2f}", f"{CM * sigma:.2f}")
        for k, (offset, sigma) in enumerate(
            zip(result.range_offsets, result.sigma_offsets, strict=False)
        )
    ]
    return Table(("ring", "elevation (°)", "range offset (cm)", "σ (cm)"), lines, frozenset())


def pair_table(own: OwnFlight) -> Table:
    lines = []
    for pair in own.distances:
        middle = [np.median(np.abs(values)) for values in (pair.before, pair.after)]
        lines.append(
            (
                f"{pair.first} – {pair.second}", f"{100 * pair.overlap:.0f}",
                f"{len(pair.before)}",
                *(f"{CM * rms(values):.1f}" for values in (pair.before, pair.after)),
                *(f"{CM * value:.1f}" for value in middle),
            )
        )  # fmt: skip
    heads = (
        "strips", "overlap (%)", "points", "RMS before (cm)", "RMS after (cm)",
        "median |d| before (cm)", "median |d| after (cm)",
    )  # fmt: skip
    return Table(heads, lines)


def plane_middles(own: OwnFlight) -> np.ndarray:
    """(G, 3) m, m-frame: the middle of all points of each plane under the calibrated mounting."""
    unknowns = Unknowns.layout(own.survey.mounting, own.survey.scanner.n_rings, "none")
    ranges = own.matched.plane_ranges
    return face_states(own.matched.rays, ranges, unknowns, own.result.boresight).centroid


def plane_table(own: OwnFlight) -> Table:
    """The planes of the result: how they lie, who sees them, how well their points fit."""
    result, matched, middle = own.result, own.matched, plane_middles(own)
    lines = []
    for k, plane in enumerate(result.planes):
        slope = np.degrees(np.arccos(np.clip(plane[2], -1, 1)))
        azimuth = np.degrees(np.arctan2(plane[0], plane[1])) % 360
        seen = ", ".join(np.array(matched.strips)[matched.plane == k])
        lines.append(
            (
                str(k), seen, f"{result.points_per_plane[k]}", f"{slope:.1f}",
                f"{azimuth:.0f}" if slope > 1 else "", *(f"{c:.1f}" for c in middle[k]),
                f"{CM * result.rms_before[k]:.1f}", f"{CM * result.rms_after[k]:.1f}",
            )
        )  # fmt: skip
    heads = (
        "plane", "seen in", "points", "slope (°)", "faces (° from north)", "east (m)",
        "north (m)", "up (m)", "RMS before (cm)", "RMS after (cm)",
    )  # fmt: skip
    return Table(heads, lines, frozenset({0, 1}))


def rejected_table(own: OwnFlight) -> Table:
    lines = [
        (
            face.strip, *(f"{c:.1f}" for c in face.centroid),
            f"{CM * face.misfit_m:.1f}", f"{CM * face.limit_m:.1f}",
        )
        for face in own.rejected
    ]  # fmt: skip
    heads = ("strip", "east (m)", "north (m)", "up (m)", "misses by (cm)", "limit (cm)")
    return Table(heads, lines)


def noise_table(own: OwnFlight) -> Table | None:
    """What the data say of the specifications, where scenario D asked them."""
    factors = own.result.components
    if factors is None:
        return None
    navigation, scanner = own.survey.navigation, own.survey.scanner
    position = ", ".join(f"{CM * s:.1f}" for s in navigation.position_sigma)
    attitude = ", ".join(f"{np.degrees(s):.3f}" for s in navigation.attitude_sigma)
    lines = [
        ("laser range", f"{CM * scanner.range_sigma:.1f} cm", f"{factors['range']:.2f}"),
        ("position east, north, up", f"{position} cm", f"{factors['position']:.2f}"),
        ("attitude roll, pitch, heading", f"{attitude}°", f"{factors['attitude']:.2f}"),
        (
            "correlation time", f"{navigation.correlation_time:.0f} s",
            f"{factors['correlation_time']:.2f}",
        ),
    ]  # fmt: skip
    return Table(("σ of", "specified", "factor found"), lines, frozenset({0, 1}))
