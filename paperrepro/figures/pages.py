"""The report: one HTML page, self-contained, made from what lies in the folder of figures.

It reads ``claims.csv`` (the ledger), ``rows.csv``, the tables, the pictures and, for durations, the
executed notebooks. What is missing is named on the page.

``report.html`` of an operator's calibration: one self-contained page, numbers from the result.

It is given its pictures, for what measures does not draw.
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
from paperrepro.errors import BadInput
from paperrepro.flight.calibrate import OwnFlight
from paperrepro.frames import ANGLES, AXIS_WORDS
from paperrepro.method.accuracy import rms
from paperrepro.method.adjustment.conditions import Unknowns, face_states
from paperrepro.paper.artefacts import ARTEFACTS, Artefact, Values, caption
from paperrepro.paper.claims import HEADLINES
from paperrepro.paper.numbers import cells, heading, worded
from paperrepro.study.environment import package_versions
from paperrepro.study.rows import Run, frame

HERE = Path(__file__).parent
NAME = "report.html"

#: Columns of the ledger.
LEDGER = (
    "id", "claim", "place", "kind", "paper", "measured", "low", "high", "unit", "seeds", "verdict",
    "condition",
)  # fmt: skip
#: Verdicts of the ledger in their order, with the class of their chip.
VERDICTS = {
    "holds": "holds",
    "holds under conditions": "partly",
    "does not hold": "fails",
    "not testable here": "untested",
}
#: A larger SVG is shown as PNG: pictures of many points are heavy as vectors.
LARGEST_SVG_BYTES = 60_000
#: Pixels across an embedded picture.
WIDEST_PNG = 1400
#: Pictures are drawn 88 or 180 mm wide and shown a quarter larger than that.
PIXELS_PER_PNG_PIXEL = 1.25 * 96 / 200
PIXELS_PER_POINT = 1.25 * 96 / 72


@dataclass(frozen=True)
class Item:
    """An artefact as the page shows it; ``picture`` or ``table`` or neither, if it is missing."""

    artefact: Artefact
    caption: str
    claims: list[dict]
    picture: dict | None
    table: dict | None
    files: list[str]


def write(folder: str | Path, run: Run) -> Path:
    """Write ``folder/report.html`` from what lies in ``folder``, whole or not at all."""
    folder = Path(folder)
    path, part = folder / NAME, folder / f"{NAME}.part"
    try:
        part.write_text(page(folder, run), encoding="utf-8", newline="\n")
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
    return path


def page(folder: Path, run: Run) -> str:
    """The report on ``run`` as text."""
    rows, claims = _rows(folder), _claims(folder)
    values = Values.of(rows, run)
    items = [_item(folder, artefact, values, claims) for artefact in ARTEFACTS]
    unlisted = [_item(folder, artefact, values, claims) for artefact in _unlisted(folder)]
    return _template().render(
        css=(HERE / "report.css").read_text(encoding="utf-8"),
        claims=claims,
        headlines=[claim for claim in claims if claim["id"] in HEADLINES] or claims,
        others=_others(claims),
        verdicts=_counts(claims),
        chip=VERDICTS,
        tables=[item for item in items if item.artefact.name.startswith("table")],
        figures=[item for item in items if item.artefact.place.startswith("Fig.")],
        further=[item for item in items if not item.artefact.place] + unlisted,
        missing=[item.artefact for item in items if not (item.picture or item.table)],
        run=run,
        foreign=_foreign(rows, run),
        machine=_machine(),
        packages=package_versions(),
        durations=_durations(folder),
        version=__version__,
    )


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(HERE), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    return environment.get_template("report_template.html")


def _rows(folder: Path) -> pd.DataFrame:
    path = folder / "rows.csv"
    return pd.read_csv(path) if path.exists() else frame([])


def _claims(folder: Path) -> list[dict]:
    """The ledger's lines as text, numbers with their unit; empty without a ledger."""
    path = folder / "claims.csv"
    if not path.exists():
        return []
    table = pd.read_csv(path, dtype=str, keep_default_na=False)
    if lacking := [name for name in LEDGER if name not in table]:
        raise BadInput(
            f"{path}: expected the columns {', '.join(LEDGER)}, found none named "
            f"{', '.join(lacking)}; write the ledger anew"
        )
    return [_claim(line) for line in table.to_dict("records")]


def _claim(line: dict) -> dict:
    shown = {k: worded(line[k], line["unit"]) for k in ("paper", "measured", "low", "high")}
    low, high = shown["low"], shown["high"]
    span = f"{low} to {high}" if low and high and low != high else ""
    return {**line, **shown, "span": span}


def _others(claims: list[dict]) -> list[dict]:
    """The claims behind the headlines; none where no headline is among them."""
    others = [claim for claim in claims if claim["id"] not in HEADLINES]
    return others if len(others) < len(claims) else []


def _counts(claims: Iterable[dict]) -> dict[str, int]:
    """How many claims got each verdict; a verdict that is not known stands at the end."""
    given = [claim["verdict"] for claim in claims]
    return {verdict: given.count(verdict) for verdict in dict.fromkeys([*VERDICTS, *given])}


def _item(folder: Path, artefact: Artefact, values: Values, claims: list[dict]) -> Item:
    picture = _picture(folder, artefact.name)
    path = folder / f"{artefact.name}.csv"
    table = None if picture or not path.exists() else _table(path)
    kinds = [k for k in ("csv", "svg", "png") if (folder / f"{artefact.name}.{k}").exists()]
    return Item(
        artefact,
        caption(artefact.name, values),
        [claim for claim in claims if artefact.place and _speaks_of(claim, artefact.place)],
        picture,
        table,
        [f"{artefact.name}.{kind}" for kind in kinds],
    )


def _speaks_of(claim: dict, place: str) -> bool:
    return re.search(rf"{re.escape(place)}(?!\d)", claim["place"]) is not None


def _unlisted(folder: Path) -> list[Artefact]:
    """Pictures that no one has described are shown under their names."""
    known = {artefact.name for artefact in ARTEFACTS}
    names = {path.stem for kind in ("png", "svg") for path in folder.glob(f"*.{kind}")}
    return [
        Artefact(name, name.replace("_", " "), "", f"Picture {name}.")
        for name in sorted(names - known)
    ]


def _picture(folder: Path, name: str) -> dict | None:
    """The picture as a data URI with its size in CSS pixels: SVG if it is light, else PNG."""
    svg, png = (folder / f"{name}.{kind}" for kind in ("svg", "png"))
    if svg.exists() and (not png.exists() or svg.stat().st_size <= LARGEST_SVG_BYTES):
        data, kind, size = svg.read_bytes(), "svg+xml", _svg_size
    elif png.exists():
        data, kind, size = _light_png(png), "png", lambda _: _png_size(png.read_bytes())
    else:
        return None
    width, height = size(data)
    uri = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
    return {"uri": uri, "width": round(width), "height": round(height)}


def _light_png(path: Path) -> bytes:
    """The picture with as many pixels as a sharp screen shows and a palette of 256 colours: a third
    of the bytes, which the page would else spend on print resolution."""
    picture = Image.open(path).convert("RGB")
    if picture.width > WIDEST_PNG:
        height = round(picture.height * WIDEST_PNG / picture.width)
        picture = picture.resize((WIDEST_PNG, height), Image.Resampling.LANCZOS)
    light = io.BytesIO()
    picture.quantize(256, dither=Image.Dither.NONE).save(light, "PNG", optimize=True)
    return light.getvalue()


def _png_size(data: bytes) -> tuple[float, float]:
    """From the header's IHDR chunk."""
    return tuple(int.from_bytes(data[at : at + 4], "big") * PIXELS_PER_PNG_PIXEL for at in (16, 20))


def _svg_size(data: bytes) -> tuple[float, float]:
    """From the viewBox, in points as matplotlib writes it."""
    found = re.search(rb'viewBox="0 0 ([\d.]+) ([\d.]+)"', data)
    return tuple(float(side) * PIXELS_PER_POINT for side in found.groups()) if found else (850, 400)


def _table(path: Path) -> dict:
    table = pd.read_csv(path)
    if "preset" in table:
        table.insert(0, "preset", table.pop("preset"))
    columns = [cells(table[column]) for column in table]
    return {
        "heads": [heading(column) for column in table],
        "classes": [
            "number" if pd.api.types.is_numeric_dtype(table[name]) else _class_of_words(words)
            for name, words in zip(table, columns, strict=True)
        ],
        "lines": list(zip(*columns, strict=True)),
    }


def _class_of_words(words: list[str]) -> str:
    return "long" if max(map(len, words), default=0) > 30 else "word"


def _foreign(rows: pd.DataFrame, run: Run) -> int:
    """How many rows are of another profile, noise or seed than the run's."""
    same = (
        (rows.profile == run.profile)
        & (rows.noise_scale == run.noise_scale)
        & (rows.seed == run.seed)
    )
    return int((~same).sum())


def _machine() -> dict[str, str]:
    return {
        "Python": f"{platform.python_implementation()} {platform.python_version()}",
        "Platform": platform.platform(),
        "Processors": str(os.cpu_count()),
    }


def _durations(folder: Path) -> dict[str, float]:
    """Seconds that each executed notebook took, where one lies in the folder."""
    seconds = {}
    for path in sorted((folder / "executed").glob("*.ipynb")):
        spent = json.loads(path.read_text(encoding="utf-8"))["metadata"].get("papermill", {})
        if spent.get("duration") is not None:
            seconds[path.name] = spent["duration"]
    return seconds


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


def calibration_page(
    own: OwnFlight, pictures: Mapping[str, Picture], files: Mapping[str, str], notes
) -> str:
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
    ranges = own.tie_planes.plane_ranges
    return face_states(own.tie_planes.rays, ranges, unknowns, own.result.boresight).centroid


def plane_table(own: OwnFlight) -> Table:
    """The planes of the result: how they lie, who sees them, how well their points fit."""
    result, tie_planes, middle = own.result, own.tie_planes, plane_middles(own)
    lines = []
    for k, plane in enumerate(result.planes):
        slope = np.degrees(np.arccos(np.clip(plane[2], -1, 1)))
        azimuth = np.degrees(np.arctan2(plane[0], plane[1])) % 360
        seen = ", ".join(np.array(tie_planes.strips)[tie_planes.plane == k])
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
