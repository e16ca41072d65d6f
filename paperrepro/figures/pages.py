"""Two pages, each one HTML file that needs nothing else: the reproduction's report, made from what
lies in the folder of figures, and that of an operator's calibration, made from its result.

The first reads ``claims.csv`` (the ledger), ``rows.csv``, the tables, the pictures and, for
durations, the executed notebooks; what is missing is named on the page. The second is given its
pictures.
"""

import base64
import io
import json
import os
import platform
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import jinja2
import numpy as np
import pandas as pd
from PIL import Image

from paperrepro import __version__
from paperrepro._files import write_text
from paperrepro.errors import BadInput
from paperrepro.flight.calibrate import OwnFlight
from paperrepro.frames import ANGLES
from paperrepro.method.accuracy import median_ratio, rmse
from paperrepro.method.adjustment.observability import AXIS_WORDS
from paperrepro.paper.artefacts import ARTEFACTS, Artefact, Values, caption
from paperrepro.paper.numbers import SYMBOLS, cells, heading, number, worded
from paperrepro.paper.tables import headlines, what_came_out
from paperrepro.paper.verdicts import (
    COLUMNS,
    CONDITIONS,
    FAILS,
    HOLDS,
    SAYS,
    UNDECIDED,
    UNTESTED,
)  # fmt: skip
from paperrepro.study.environment import package_versions
from paperrepro.study.rows import SurveyKey, frame
from paperrepro.study.statistics import TWO_SIDED

NAME = "report.html"
CM = 100.0
#: Verdicts of the ledger in their order, with the class of their chip.
CHIPS = {
    HOLDS: "holds", CONDITIONS: "partly", FAILS: "fails", UNDECIDED: "untested",
    UNTESTED: "untested",
}  # fmt: skip
#: A larger SVG is shown as PNG: pictures of many points are heavy as vectors.
LARGEST_SVG_BYTES = 60_000
#: Pixels across an embedded picture.
WIDEST_PNG = 1400
#: Pictures are drawn 88 or 180 mm wide and shown a quarter larger than that.
PIXELS_PER_PNG_PIXEL = 1.25 * 96 / 200
PIXELS_PER_POINT = 1.25 * 96 / 72
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
    """A picture as a data URI with its size in CSS pixels; a title, words for those who do not see
    it, and a caption."""

    uri: str
    width: int
    height: int
    title: str = ""
    alt: str = ""
    caption: str = ""

    @classmethod
    def of(cls, data: bytes, size: tuple[float, float], **words: str) -> "Picture":
        """From an SVG or PNG."""
        kind = "png" if data.startswith(b"\x89PNG") else "svg+xml"
        uri = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
        return cls(uri, round(size[0]), round(size[1]), **words)


@dataclass(frozen=True)
class Table:
    """``heads``, ``lines`` of texts, and of each column the class by which the page sets it:
    ``number``, ``word`` or ``long``."""

    heads: list[str]
    lines: list[tuple[str, ...]]
    classes: list[str]

    @classmethod
    def of(cls, table: pd.DataFrame) -> "Table":
        """From a table whose columns are named as `numbers` knows them."""
        columns = [cells(table[name]) for name in table]
        classes = [
            "number" if pd.api.types.is_numeric_dtype(table[name])
            else "long" if max(map(len, texts), default=0) > 30 else "word"
            for name, texts in zip(table, columns, strict=True)
        ]  # fmt: skip
        heads = [heading(name) for name in table]
        return cls(heads, list(zip(*columns, strict=True)), classes)


def _render(template: str, **content) -> str:
    """A page; its style and what both pages share come from ``base.html``."""
    here = Path(__file__).parent
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(here), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters["number"] = number
    css = (here / "report.css").read_text(encoding="utf-8")
    return environment.get_template(template).render(css=css, version=__version__, **content)


# The report on a reproduction


@dataclass(frozen=True)
class Item:
    """An artefact as the page shows it; ``picture`` or ``table`` or neither, if it is missing."""

    artefact: Artefact
    caption: str
    claims: list[dict]
    picture: Picture | None
    table: Table | None
    files: list[str]


def write(folder: str | Path, run: SurveyKey) -> Path:
    """Write ``folder/report.html``, whole or not at all.

    Parameters
    ----------
    folder : path
        What `paperrepro.reproduce` wrote: pictures, tables, ``rows.csv``, ``claims.csv``.
    run : SurveyKey
        The survey that pictures and captions are of.

    Raises
    ------
    BadInput
        If the ledger lacks columns.
    """
    path = Path(folder) / NAME
    write_text(path, page(Path(folder), run))
    return path


def page(folder: Path, run: SurveyKey) -> str:
    """The report on ``run`` as text."""
    path = folder / "rows.csv"
    rows = pd.read_csv(path) if path.exists() else frame([])
    claims = _claims(folder)
    values = Values.of(rows, run)
    items = [_item(folder, artefact, values, claims) for artefact in ARTEFACTS]
    unlisted = [_item(folder, artefact, values, claims) for artefact in _unlisted(folder)]
    table = pd.DataFrame(claims, columns=list(COLUMNS))
    first = {name: place for place, name in enumerate(headlines(table).id)}
    short = sorted((c for c in claims if c["id"] in first), key=lambda c: first[c["id"]])
    others = [claim for claim in claims if claim["id"] not in first]
    given = [claim["verdict"] for claim in claims if claim["kind"] == SAYS]
    return _render(
        "report_template.html",
        claims=claims,
        came_out=what_came_out(table),
        headlines=short or claims,
        others=others if short else [],
        verdicts={name: given.count(name) for name in dict.fromkeys([*CHIPS, *given])},
        chip=CHIPS,
        tables=[item for item in items if item.artefact.name.startswith("table")],
        figures=[item for item in items if item.artefact.place.startswith("Fig.")],
        further=[item for item in items if not item.artefact.place] + unlisted,
        missing=[item.artefact for item in items if not (item.picture or item.table)],
        run=run,
        foreign=len(rows) - len(values.own(rows, run)),
        machine={
            "Python": f"{platform.python_implementation()} {platform.python_version()}",
            "Platform": platform.platform(),
            "Processors": str(os.cpu_count()),
        },
        packages=package_versions(),
        durations=_durations(folder),
    )


def _claims(folder: Path) -> list[dict]:
    """The ledger's lines as text, numbers with their unit; empty without a ledger."""
    path = folder / "claims.csv"
    if not path.exists():
        return []
    table = pd.read_csv(path, dtype=str, keep_default_na=False)
    if lacking := [name for name in COLUMNS if name not in table]:
        raise BadInput(
            f"{path}: expected the columns {', '.join(COLUMNS)}, found none named "
            f"{', '.join(lacking)}; write the ledger anew"
        )
    return [_claim(line) for line in table.to_dict("records")]


def _claim(line: dict) -> dict:
    shown = {k: worded(line[k], line["unit"]) for k in ("paper", "measured", "low", "high")}
    low, high = shown["low"], shown["high"]
    span = f"{low} to {high}" if low and high and low != high else ""
    return {**line, **shown, "span": span}


def _item(folder: Path, artefact: Artefact, values: Values, claims: list[dict]) -> Item:
    picture = _picture(folder, artefact.name)
    path = folder / f"{artefact.name}.csv"
    table = None if picture or not path.exists() else pd.read_csv(path)
    if table is not None and "preset" in table:
        table.insert(0, "preset", table.pop("preset"))
    names = [f"{artefact.name}.{kind}" for kind in ("csv", "svg", "png")]
    place = re.compile(rf"{re.escape(artefact.place)}(?!\d)")
    return Item(
        artefact,
        caption(artefact.name, values),
        [claim for claim in claims if artefact.place and place.search(claim["place"])],
        picture,
        None if table is None else Table.of(table),
        [name for name in names if (folder / name).exists()],
    )


def _unlisted(folder: Path) -> list[Artefact]:
    """Pictures that no one has described are shown under their names."""
    known = {artefact.name for artefact in ARTEFACTS}
    names = {path.stem for kind in ("png", "svg") for path in folder.glob(f"*.{kind}")}
    return [
        Artefact(name, name.replace("_", " "), "", f"Picture {name}.")
        for name in sorted(names - known)
    ]


def _picture(folder: Path, name: str) -> Picture | None:
    """SVG if it is light, else PNG."""
    svg, png = (folder / f"{name}.{kind}" for kind in ("svg", "png"))
    if svg.exists() and (not png.exists() or svg.stat().st_size <= LARGEST_SVG_BYTES):
        data = svg.read_bytes()
        box = re.search(rb'viewBox="0 0 ([\d.]+) ([\d.]+)"', data)  # points, as matplotlib writes
        sides = [float(side) * PIXELS_PER_POINT for side in box.groups()] if box else (850, 400)
        return Picture.of(data, sides)
    if png.exists():
        with Image.open(png) as picture:
            size = [side * PIXELS_PER_PNG_PIXEL for side in picture.size]
            return Picture.of(_light_png(picture), size)
    return None


def _light_png(picture: Image.Image) -> bytes:
    """The picture with as many pixels as a sharp screen shows and a palette of 256 colours: a third
    of the bytes, which the page would else spend on print resolution."""
    picture = picture.convert("RGB")
    if picture.width > WIDEST_PNG:
        height = round(picture.height * WIDEST_PNG / picture.width)
        picture = picture.resize((WIDEST_PNG, height), Image.Resampling.LANCZOS)
    light = io.BytesIO()
    picture.quantize(256, dither=Image.Dither.NONE).save(light, "PNG", optimize=True)
    return light.getvalue()


def _durations(folder: Path) -> dict[str, float]:
    """Seconds that each executed notebook took, where one lies in the folder."""
    seconds = {}
    for path in sorted((folder / "executed").glob("*.ipynb")):
        spent = json.loads(path.read_text(encoding="utf-8"))["metadata"].get("papermill", {})
        if spent.get("duration") is not None:
            seconds[path.name] = spent["duration"]
    return seconds


# The report on an operator's calibration


def calibration_page(
    own: OwnFlight, pictures: Mapping[str, Picture], files: Mapping[str, str], notes: Iterable[str]
) -> str:
    """The report as text.

    Parameters
    ----------
    own : OwnFlight
        What `paperrepro.calibrate_flight` gives.
    pictures : mapping of str to Picture
        As `paperrepro.figures.flight.pictures` draws them.
    files, notes
        The files that were read, by what they are; sentences on the reading.
    """
    result, scanner = own.result, own.survey.scanner
    return _render(
        "calibration_template.html",
        own=own, result=result, seen=result.observability, scenario_words=SCENARIOS,
        reasons=str(result.observability).split("; ")[2:], strips=len(own.survey.strips),
        scanner=scanner.name, navigation=own.survey.navigation.name, pictures=pictures,
        files=files, notes=[*notes, *own.remarks], angles=_angles(own),
        offsets=_offsets(own), pairs=_pairs(own), planes=_planes(own), rejected=_rejected(own),
        noise=_noise(own), weak=_reliability(own), cm=CM, ratio=median_ratio(own.distances),
        passes=np.degrees(own.boresights),
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
    both = zip(result.range_offsets, result.sigma_offsets, strict=False)
    lines = [
        (str(ring), *(number(v, 2) for v in (elevation[ring], CM * offset, CM * sigma)))
        for ring, (offset, sigma) in enumerate(both)
    ]
    return Table(["ring", "elevation (°)", "range offset (cm)", "σ (cm)"], lines, ["number"] * 4)


def _pairs(own: OwnFlight) -> Table:
    lines = []
    for pair in own.distances:
        both = (pair.before, pair.after)
        rms, middle = [rmse(d) for d in both], [np.median(np.abs(d)) for d in both]
        lines.append(
            (
                f"{pair.first} – {pair.second}", number(100 * pair.overlap, 0),
                number(len(pair.before)), *(number(CM * value, 1) for value in (*rms, *middle)),
            )
        )  # fmt: skip
    heads = [
        "strips", "overlap (%)", "points", "RMS before (cm)", "RMS after (cm)",
        "median |d| before (cm)", "median |d| after (cm)",
    ]  # fmt: skip
    return Table(heads, lines, ["word", *["number"] * 6])


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
    for name, key in (("surface of a view", "surface_m"), ("roughness", "roughness_m")):
        lines.append((name, "", f"{number(CM * factors[key], 2)} cm", "", ""))
    heads = ["σ of", "specified", "factor found", "lasting (s)", "share of a second's errors"]
    return Table(heads, lines, ["word", "word", "number", "number", "number"])
