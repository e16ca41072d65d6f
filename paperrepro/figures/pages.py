"""Pages of HTML that need nothing else: what they are made of, and the report on a reproduction.

The report is made from what lies in the folder of figures: ``claims.csv`` (the ledger),
``rows.csv``, the tables, the pictures, the cloud that can be turned and, for durations, the
executed notebooks; what is missing is named on the page.
"""

import base64
import io
import json
import os
import platform
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import jinja2
import numpy as np
import pandas as pd
from PIL import Image

from paperrepro import __version__
from paperrepro._files import write_text
from paperrepro.errors import BadInput
from paperrepro.figures import SCENARIO_COLOURS, STRIP_COLOURS
from paperrepro.paper.artefacts import ARTEFACTS, Artefact, Values, caption
from paperrepro.paper.numbers import cells, heading, number, worded
from paperrepro.paper.tables import headlines, printed_value
from paperrepro.paper.verdicts import (
    COLUMNS,
    CONDITIONS,
    FAILS,
    FOLLOWS,
    HOLDS,
    OURS,
    SAYS,
    UNDECIDED,
    UNTESTED,
)  # fmt: skip
from paperrepro.study.environment import package_versions
from paperrepro.study.rows import SurveyKey, frame

NAME = "report.html"
#: Verdicts of the ledger in their order, with the class of their chip.
CHIPS = {
    HOLDS: "holds", CONDITIONS: "partly", FAILS: "fails", UNDECIDED: "open",
    UNTESTED: "untested",
}  # fmt: skip
#: What stands at the top, and what can be turned beside the picture of an artefact.
FIRST, TURNED = ("fig07", "errors_against_sigmas"), "fig09"
#: Pictures are drawn for print, 88 or 180 mm wide at 300 dpi, and shown a quarter larger than that
#: with so many pixels for each of the page's.
SHOWN, PIXELS = 1.25 * 96, 1.3
#: A table's columns that lead, after those that name the line; those that are shares.
LEADING = ("truth_deg", "estimate_deg", "error_deg")
SHARES = ("coverage", "rmse_left", "mean_left")


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
    def of(cls, data: bytes, kind: str, size: tuple[float, float], **words: str) -> "Picture":
        """From the bytes of an image of that ``kind``, "svg+xml" or "webp"."""
        uri = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
        return cls(uri, round(size[0]), round(size[1]), **words)


@dataclass(frozen=True)
class Table:
    """``heads``, ``lines`` of texts, and of each column the class by which the page sets it:
    ``number``, ``word`` or ``long``; ``bands`` head the lines from a number on."""

    heads: list[str]
    lines: list[tuple[str, ...]]
    classes: list[str]
    bands: Mapping[int, str] = field(default_factory=dict)

    @classmethod
    def of(cls, table: pd.DataFrame) -> "Table":
        """From a table whose columns are named as `numbers` knows them: shares as percent, truth,
        estimate and error first, lines of one preset under its name."""
        bands = {}
        if "preset" in table:
            preset = table.pop("preset")
            bands = {k: f"preset {preset[k]}" for k in preset.index[preset != preset.shift()]}
        shares = [name for name in SHARES if name in table]
        shares += ["paper"] if shares and "paper" in table else []
        table = table.assign(**{name: 100 * table[name] for name in shares})
        table = table.rename(columns={name: f"{name}_percent" for name in shares})
        leading = [name for name in LEADING if name in table]
        keys = list(table.select_dtypes(exclude="number"))
        order = [*keys, *leading] if leading else []
        table = table[[*order, *(name for name in table if name not in order)]]
        columns = [cells(table[name]) for name in table]
        classes = [
            "number" if pd.api.types.is_numeric_dtype(table[name])
            else "long" if max(map(len, texts), default=0) > 30 else "word"
            for name, texts in zip(table, columns, strict=True)
        ]  # fmt: skip
        heads = [heading(name) for name in table]
        return cls(heads, list(zip(*columns, strict=True)), classes, bands)


def render(template: str, **content) -> str:
    """A page; its style and what all pages share come from ``base.html``."""
    here = Path(__file__).parent
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(here), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters["number"] = number
    files = {name: (here / f"report.{name}").read_text(encoding="utf-8") for name in ("css", "js")}
    return environment.get_template(template).render(**files, version=__version__, **content)


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

    @property
    def wide(self) -> bool:
        """Whether it takes both columns of the page."""
        return self.picture.width > 500 if self.picture else bool(self.table)


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
    items += [_item(folder, artefact, values, claims) for artefact in _unlisted(folder)]
    first = [*headlines(pd.DataFrame(claims, columns=list(COLUMNS))).id]
    short = (
        sorted((c for c in claims if c["id"] in first), key=lambda c: first.index(c["id"]))
        or claims
    )
    others = [claim for claim in claims if claim not in short]
    further = [item for item in items if not item.artefact.place]
    return render(
        "report_template.html",
        sentences=[*_rmse_sentence(values), *_sigma_sentences(folder)],
        first=[item for item in items if item.artefact.name in FIRST and item.picture],
        counts=_by_kind(claims),
        claims=claims,
        headlines=short,
        others=_by_kind(others),
        chip=CHIPS,
        tables=[item for item in items if item.artefact.name.startswith("table")],
        figures=[item for item in items if item.artefact.place.startswith("Fig.")],
        further={
            name: [item for item in further if item.artefact.notebook == name]
            for name in dict.fromkeys(item.artefact.notebook for item in further)
        },
        missing=[item.artefact for item in items if not (item.picture or item.table)],
        turned=TURNED,
        cloud=_cloud(folder / f"{TURNED}_cloud.npz"),
        run=run,
        foreign=len(rows) - len(values.own(rows, run)),
        machine={
            "Python": f"{platform.python_implementation()} {platform.python_version()}",
            "Platform": platform.platform(),
            "Processors": str(os.cpu_count()),
        },
        packages=package_versions(),
        durations=_durations(folder),
        executed={path.stem for path in folder.glob("executed/*.html")},
    )


def _rmse_sentence(values: Values) -> list[str]:
    """What calibration made of the cloud of this run; empty if rows lack it."""
    keys = {"before": "fig07/before/rmse_reference", "truth": "fig07/truth/rmse_reference"}
    keys |= {s: f"fig07/{s}/rmse_reference_calibration" for s in ("SL", "A", "B", "C", "D")}
    if not all(key in values for key in keys.values()):
        return []
    shown = {s: f"{values[key]:cm}" for s, key in keys.items()}
    after = _listed({s: text for s, text in shown.items() if s not in ("before", "truth")})
    return [
        f"In the survey drawn, the RMSE of roof points against the airborne reference falls from "
        f"{shown['before']} to {after}; the true mounting leaves {shown['truth']}."
    ]


def _sigma_sentences(folder: Path) -> list[str]:
    """How large the boresight's errors are over many surveys, and how often intervals hold it; of
    what the picture beside shows."""
    path = folder / f"{FIRST[1]}.csv"
    if not path.exists():
        return []
    table = pd.read_csv(path)
    table = table[table.scenario.isin(SCENARIO_COLOURS)]
    names = dict.fromkeys(sorted(table.scenario, key=list(SCENARIO_COLOURS).index))
    mean = table.groupby("scenario")[["error_deg", "held"]].mean()
    errors = {s: f"{number(mean.error_deg[s], 3)}°" for s in names}
    held = {s: f"{number(100 * mean.held[s], 0)}\u00a0%" for s in names}
    return [
        f"Over {table.seed.nunique()} surveys the boresight, three angles together, is wrong by "
        f"{_listed(errors)} on average, few points of a face entering but in D.",
        f"The 95\u00a0% intervals that the σ promise hold a true angle in {_listed(held)} of the "
        "cases.",
    ]


def _listed(texts: Mapping[str, str]) -> str:
    """ "0.1 ([11]), 0.2 (A) and 0.3 (D, ours)"."""
    called = {"SL": "[11]", "D": "D, ours"}
    *most, last = (f"{text} ({called.get(s, s)})" for s, text in texts.items())
    return f"{', '.join(most)} and {last}"


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
    shown = {k: worded(line[k], line["unit"]) for k in ("measured", "low", "high")}
    shown["paper"] = printed_value(float(line["paper"] or "nan"), line["unit"])
    low, high = shown["low"], shown["high"]
    span = f"{low} to {high}" if low and high and low != high else ""
    seeds = line["seeds"] if line["seeds"].strip("0") else "–"
    return {**line, **shown, "span": span, "seeds": seeds}


def _by_kind(claims: list[dict]) -> dict[str, dict[str, list[dict]]]:
    """Claims by whose they are, the paper's first, and by verdict in the order of `CHIPS`."""
    words = {SAYS: "The paper says", FOLLOWS: "Follows from what it prints", OURS: "Ours"}
    kinds = {text: [c for c in claims if c["kind"] == of] for of, text in words.items()}
    names = dict.fromkeys([*CHIPS, *(c["verdict"] for c in claims)])
    return {
        kind: {name: [c for c in of_kind if c["verdict"] == name] for name in names}
        for kind, of_kind in kinds.items()
        if of_kind
    }


def _item(folder: Path, artefact: Artefact, values: Values, claims: list[dict]) -> Item:
    picture = _picture(folder, artefact.name)
    path = folder / f"{artefact.name}.csv"
    table = None if picture or not path.exists() else pd.read_csv(path)
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
    """The lightest form of a picture as sharp screens show it, see `PIXELS`: few colours without
    loss, as lines and letters want it, or many with a loss that nobody sees, as clouds do."""
    path = folder / f"{name}.png"
    if not path.exists():
        return None
    with Image.open(path) as picture:
        inches = [side / picture.info.get("dpi", (300, 300))[0] for side in picture.size]
        size = [SHOWN * side for side in inches]
        pixels = [round(PIXELS * side) for side in size]
        picture = picture.convert("RGB").resize(pixels, Image.Resampling.LANCZOS)
    few = picture.quantize(64, dither=Image.Dither.NONE).convert("RGB")
    forms = [_webp(few, lossless=True), _webp(picture, quality=60, use_sharp_yuv=True)]
    return Picture.of(min(forms, key=len), "webp", size)


def _webp(picture: Image.Image, **how) -> bytes:
    file = io.BytesIO()
    picture.save(file, "WEBP", method=6, **how)
    return file.getvalue()


def _cloud(path: Path) -> dict | None:
    """What `paperrepro.figures.survey.save_cloud` wrote, packed for the page: positions after in
    centimetres, those before as steps from there, strips."""
    if not path.exists():
        return None
    with np.load(path) as file:
        before, after, strip, names = (file[k] for k in ("before_cm", "after_cm", "strip", "names"))
    shift = before - after.astype(int)
    step = max(np.abs(shift).max() / 127, 1e-6)
    packed = [after.astype("<i2"), np.rint(shift / step).astype("i1"), strip.astype("u1")]
    data = b"".join(part.tobytes() for part in packed)
    return {
        "points": len(after), "step": f"{step:.4g}", "data": base64.b64encode(data).decode(),
        "colours": {name: STRIP_COLOURS[name] for name in names.tolist()},
    }  # fmt: skip


def _durations(folder: Path) -> dict[str, float]:
    """Seconds that each executed notebook took, where one lies in the folder."""
    seconds = {}
    for path in sorted((folder / "executed").glob("*.ipynb")):
        spent = json.loads(path.read_text(encoding="utf-8"))["metadata"].get("papermill", {})
        if spent.get("duration") is not None:
            seconds[path.stem] = spent["duration"]
    return seconds
