"""The report: what it says, what it owns to be missing, and that it opens alone and on a phone."""

import base64
import io
import json
import os
import re
import shutil
import struct
import subprocess
import zlib
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from paperrepro.errors import BadInput
from paperrepro.figures import pages, survey
from paperrepro.paper.artefacts import ARTEFACTS, CAPTIONS, Values, caption
from paperrepro.paper.verdicts import COLUMNS, FOLLOWS, OURS, SAYS
from paperrepro.study.rows import ADJUSTED, SurveyKey, frame

ROOT = Path(__file__).resolve().parents[3]
FIGURES = ROOT / "figures"
RUN = SurveyKey("mount", "quick", 1.0, 7)
NBSP = "\u00a0"
HOSTILE = '<script>alert("x")</script> & "quoted"'
CLAIMS = [
    ("c1", "RMSE falls by 90 %", "Fig. 7", SAYS, "0.9", "0.84", "0.8", "0.9", "1",
     "B 84 % (80 % to 90 %); C 83 % (80 % to 88 %)", "20", "does not hold", "reference too noisy"),
    ("c2", HOSTILE, "Fig. 11", SAYS, "0.4", "0.112", "0.08", "0.12", "m", "", "20",
     "holds under conditions", HOSTILE),
    ("c3", "Overlap as printed", "Table 1", FOLLOWS, "70", "70", "70", "70", "%", "", "1",
     "holds", ""),
    ("c4", "Lever arm with it", "section 4", OURS, "", "", "", "", "", "", "0",
     "not testable here", ""),
]  # fmt: skip


def png(width=70, height=30):
    """A grey picture of that size."""

    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    rows = zlib.compress((b"\0" + b"\x80" * width) * height)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    )


SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 249.4 175.7" width="249.4pt">'
    '<rect width="99" height="99"/></svg>'
)


@pytest.fixture
def folder(tmp_path):
    """A few artefacts of each kind, wide and long ones among them."""
    pd.DataFrame(CLAIMS, columns=list(COLUMNS)).to_csv(tmp_path / "claims.csv", index=False)
    rows = [
        RUN.row("fig08", s, metric, unit, value)
        for s in ("SL", "B", "C", "D", ADJUSTED)
        for metric, unit, value in [("mean", "m", 0.0234), ("sigma", "m", 0.04), ("ks", "1", 0.02)]
    ]
    frame(rows).to_csv(tmp_path / "rows.csv", index=False)
    wide = {f"a_rather_long_name_{k}_deg": [0.12341, -7.0] for k in range(12)}
    pd.DataFrame({"scenario": [HOSTILE, "B"], **wide, "preset": ["mount", "mount"]}).to_csv(
        tmp_path / "table4.csv", index=False
    )
    (tmp_path / "fig07.png").write_bytes(png(1417, 500))
    (tmp_path / "fig08.svg").write_text(SVG)
    (tmp_path / "fig08.png").write_bytes(png())
    (tmp_path / "of_nobody_knows.png").write_bytes(png())
    (tmp_path / "executed").mkdir()
    metadata = {"metadata": {"papermill": {"duration": 12.6}}, "cells": []}
    (tmp_path / "executed" / "07_accuracy.ipynb").write_text(json.dumps(metadata))
    return tmp_path


class Page(HTMLParser):
    """Elements of a page in their order, and whether each is closed where it should be."""

    VOID = frozenset({"meta", "link", "img", "input", "br", "hr"})

    def __init__(self, text):
        super().__init__()
        self.elements, self.open, self.text = [], [], text
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def all(self, *tags):
        return [attributes for tag, attributes in self.elements if tag in tags]

    def section(self, artefact):
        """The text of one artefact."""
        return re.search(rf'<article id="{artefact}"[^>]*>(.*?)</article>', self.text, re.S)[1]


@pytest.fixture
def page(folder):
    return Page(pages.write(folder, RUN).read_text(encoding="utf-8"))


# What it says


def test_the_ledger_counts_every_verdict_and_states_it_in_words(page):
    top = page.text[page.text.index('<div class="counts">') :].partition("</div>")[0]
    lines = [re.findall(r"</svg>(\d+) ([\w ]+)</span>", line) for line in top.split("<b>")[1:]]
    assert [{v: int(n) for n, v in line} for line in lines] == [
        {"holds under conditions": 1, "does not hold": 1},  # the paper says
        {"holds": 1},  # follows
        {"not testable here": 1},  # ours
    ]
    chips = re.findall(r'<span class="chip (\w+)">\s*<svg.*?</svg>(.+?)</span>', page.text)
    assert {("fails", "does not hold"), ("holds", "holds")} <= set(chips)
    assert f"11.2{NBSP}cm" in page.text
    assert f"8.0{NBSP}cm to 12.0{NBSP}cm" in page.text
    assert "B 84 % (80 % to 90 %)<br>C 83 % (80 % to 88 %)" in page.text


def test_the_first_sentences_are_made_from_rows(folder):
    values = {
        "before": 0.395,
        "truth": 0.046,
        "SL": 0.046,
        "A": 0.047,
        "B": 0.052,
        "C": 0.048,
        "D": 0.046,
    }
    ending = dict.fromkeys("ABCD", "_calibration") | {"SL": "_calibration"}
    rows = [
        RUN.row("fig07", s, f"rmse_reference{ending.get(s, '')}", "m", value)
        for s, value in values.items()
    ]
    frame(rows).to_csv(folder / "rows.csv", index=False)
    lines = [
        (s, seed, 0.01 * (1 + seed), seed == 2) for s in ("SL", "A", "other") for seed in (1, 2)
    ]
    table = pd.DataFrame(lines, columns=["scenario", "seed", "error_deg", "held"])
    table.to_csv(folder / "errors_against_sigmas.csv", index=False)
    (folder / "errors_against_sigmas.png").write_bytes(png())
    text = pages.page(folder, RUN)
    top = text[: text.index("</header>")]
    assert f"falls from 39.5{NBSP}cm to 4.6{NBSP}cm ([11]), 4.7{NBSP}cm (A)" in top
    assert (
        "Over 2 surveys the boresight, three angles together, is wrong by 0.025° ([11]) and" in top
    )
    assert f"hold a true angle in 50{NBSP}% ([11]) and 50{NBSP}% (A) of" in top
    assert re.findall(r'<figure id="first-(\w+)"', text) == ["fig07", "errors_against_sigmas"]
    assert text.count('id="enlarge-fig07"') == 1  # and not once more in its place


def test_a_claim_stands_with_the_artefact_it_speaks_of(page):
    assert 'href="#claim-c1"' in page.section("fig07")
    assert 'href="#claim-c2"' in page.section("fig11")
    assert 'href="#claim-c2"' not in page.section("fig01")  # "Fig. 1" is not "Fig. 11"


def test_a_caption_sets_our_values_beside_the_papers(page):
    text = page.section("fig08")
    assert f"[11] 2.3{NBSP}cm and 4.0{NBSP}cm" in text
    assert f"less than 12{NBSP}%" in text


def test_a_caption_names_the_values_that_rows_lack(page):
    assert "missing in rows.csv: fig07/before/rmse_reference," in page.section("fig07")


def test_tables_have_units_signs_and_lines_of_a_preset_under_its_name(page):
    text = page.section("table4")
    heads = re.findall(r"<th[^>]*>(.*?)</th>", text)
    assert heads[:2] == ["scenario", "a rather long name 0 (°)"]
    assert heads[-1] == "<span>preset mount</span>"
    assert '<td class="number">0.1234</td>' in text
    assert "\u22127.0000" in text


def test_truth_estimate_and_error_lead_and_shares_are_percent():
    numbers = {"paper": [0.8, np.nan], "mean_left": [0.121, 0.1], "error_deg": [1e-5, 0.5]}
    table = pages.Table.of(pd.DataFrame({"scenario": ["SL", "A"], **numbers, "truth_deg": 1.0}))
    assert table.heads == ["scenario", "truth (°)", "error (°)", "paper (%)", "mean left (%)"]
    assert table.lines[0] == ("SL", "1", "0.00001", "80", "12.1")


def test_missing_artefacts_are_named_at_the_top_and_in_their_place(page):
    have = {"table4", "fig07", "fig08"}
    top = page.text[page.text.index("<strong>Missing</strong>") :].partition("</p>")[0]
    for artefact in ARTEFACTS:
        assert (f'href="#{artefact.name}"' in top) == (artefact.name not in have)
        assert ("<dt>Missing</dt>" in page.section(artefact.name)) == (artefact.name not in have)


def test_a_picture_that_is_not_registered_is_shown_all_the_same(page):
    assert "<img" in page.section("of_nobody_knows")


def test_every_artefact_links_to_its_notebook(page):
    for artefact in filter(lambda artefact: artefact.notebook, ARTEFACTS):
        assert f'href="../notebooks/{artefact.notebook}.ipynb"' in page.section(artefact.name)


def test_how_it_was_run(page):
    text = page.text[page.text.index("How it was run</h2>") :]
    assert "--preset mount --profile quick --seed 7 --noise-scale 1<" in text
    assert re.search(r"numpy</th><td>\d+\.\d+", text)
    assert re.search(r"Python</th><td>\w+ 3\.\d+", text)
    assert re.search(r"07_accuracy</th><td class=\"number\">13 s", text)


def test_executed_notebooks_are_linked_as_pages_where_they_are(folder):
    (folder / "executed" / "07_accuracy.html").write_text("<p>run</p>")
    assert 'href="executed/07_accuracy.html">07_accuracy</a>' in pages.page(folder, RUN)


def test_rows_of_another_run_are_owned_to(folder):
    text = pages.page(folder, SurveyKey("mount", "quick", 1.0, 8))
    assert "15 values in rows.csv are of another profile, noise scale or seed" in text
    assert "missing in rows.csv: fig08/SL/mean" in text


def test_an_empty_folder_gives_a_page_that_says_so(tmp_path):
    page = Page(pages.write(tmp_path, RUN).read_text(encoding="utf-8"))
    assert "there is no ledger (claims.csv)" in page.text
    assert page.text.count("<dt>Missing</dt>") == len(ARTEFACTS)
    assert not page.all("img")


def test_a_ledger_without_its_columns_is_refused(folder):
    (folder / "claims.csv").write_text("id,claim\n1,all is well\n")
    with pytest.raises(BadInput, match=r"claims\.csv: expected the columns .* verdict"):
        pages.write(folder, RUN)


# Its form


def test_text_from_files_is_escaped(page):
    assert "<script" not in page.text
    assert page.text.count("&lt;script&gt;") >= 3


def test_nothing_is_loaded_from_elsewhere(page):
    for attributes in page.all("img", "script", "source", "iframe", "object", "embed"):
        assert attributes["src"].startswith("data:")
    assert [attributes["href"] for attributes in page.all("link")] == ["data:,"]
    assert all(attributes["href"].startswith("#") for attributes in page.all("use"))
    assert "url(" not in page.text
    assert "@import" not in page.text


def test_a_picture_is_embedded_as_screens_show_it(folder):
    shown = pages._picture(folder, "fig07")
    kind, _, data = shown.uri.partition(",")
    assert kind == "data:image/webp;base64"
    with Image.open(io.BytesIO(base64.b64decode(data))) as image:
        assert image.size == (round(1.3 * 567), round(1.3 * 200))
    assert (shown.width, shown.height) == (567, 200)  # 1417 pixels at 300 dpi, a quarter larger


def test_a_cloud_is_packed_to_the_centimetre_and_its_steps(folder):
    rng = np.random.default_rng(0)
    after = rng.uniform(-100, 100, (500, 3))
    before = after + rng.uniform(-1.2, 1.2, (500, 3))
    strips = rng.choice(["F1", "F4"], 500)
    survey.save_cloud(folder, "fig09_cloud", before, after, strips)
    cloud = pages._cloud(folder / "fig09_cloud.npz")
    data, step = base64.b64decode(cloud["data"]), float(cloud["step"]) / 100
    assert len(data) == 10 * cloud["points"] == 5000
    packed = np.frombuffer(data[:3000], "<i2").reshape(-1, 3) / 100
    np.testing.assert_allclose(packed, after, atol=0.0051)
    shift = np.frombuffer(data[3000:4500], "i1").reshape(-1, 3) * step
    np.testing.assert_allclose(packed + shift, before, atol=0.011 + step)
    names = np.array(list(cloud["colours"]))
    assert (names[np.frombuffer(data[4500:], "u1")] == strips).all()
    assert "<canvas" in Page(pages.page(folder, RUN)).section("fig09")


def test_the_page_is_well_formed_and_can_be_walked_by_ear(page):
    assert not page.open
    assert page.all("html") == [{"lang": "en"}]
    levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch(r"h\d", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(deeper - level <= 1 for level, deeper in pairwise(levels))
    assert all(len(attributes["alt"]) > 10 for attributes in page.all("img"))
    assert all(attributes["width"].isdigit() for attributes in page.all("img"))


def test_links_within_the_page_lead_somewhere(page):
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    inner = {a["href"][1:] for a in page.all("a", "use") if a["href"].startswith("#")}
    assert inner <= set(ids)
    assert "main" in inner  # the skip link


def test_a_report_that_fails_leaves_the_old_one(folder, monkeypatch):
    path = pages.write(folder, RUN)
    before = path.read_bytes()

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="disk full"):
        pages.write(folder, SurveyKey("mount", "quick", 1.0, 8))
    assert path.read_bytes() == before
    assert not list(folder.glob("*.part"))


def test_the_same_folder_gives_the_same_bytes(folder):
    assert pages.write(folder, RUN).read_bytes() == pages.write(folder, RUN).read_bytes()


# The register


def test_every_artefact_that_a_notebook_writes_is_registered_with_it():
    registered = {artefact.name: artefact.notebook for artefact in ARTEFACTS}
    assert len(registered) == len(ARTEFACTS)
    for path in sorted((ROOT / "notebooks").glob("[0-9]*.ipynb")):
        if path.name.startswith("00"):
            continue  # recipes, which `reproduce` leaves out
        cells_of = json.loads(path.read_text(encoding="utf-8"))["cells"]
        code = "\n".join("".join(c["source"]) for c in cells_of if c["cell_type"] == "code")
        names = re.findall(r'(?:save|write_csv)\(\s*\w+, figures_dir, "(\w+)"', code)
        for name in set(names) - {"claims"}:  # the ledger heads the page, it is no artefact in it
            assert registered.get(name) == path.stem, name


def test_the_papers_tables_and_figures_are_all_registered():
    places = {artefact.place for artefact in ARTEFACTS}
    assert places >= {f"Table {k}" for k in range(1, 6)} | {f"Fig. {k}" for k in range(1, 12)}
    assert set(CAPTIONS) <= {artefact.name for artefact in ARTEFACTS}
    for artefact in ARTEFACTS:
        if artefact.notebook:
            assert (ROOT / "notebooks" / f"{artefact.notebook}.ipynb").exists()
        assert bool(artefact.place) == bool(artefact.paper)


@pytest.mark.skipif(not (FIGURES / "rows.csv").exists(), reason="no figures/rows.csv yet")
def test_the_committed_rows_have_every_value_of_the_captions():
    rows = pd.read_csv(FIGURES / "rows.csv")
    run = SurveyKey(
        "mount", *rows.loc[rows.artefact == "fig07", ["profile", "noise_scale", "seed"]].iloc[0]
    )
    for name in CAPTIONS:
        assert "missing in rows.csv" not in caption(name, Values.of(rows, run))


# In a browser

PROBE = """<script>addEventListener("load", () => parent.postMessage({
  wide: document.documentElement.scrollWidth,
  window: innerWidth,
  broken: [...document.images].filter((image) => !image.naturalWidth).length,
  pictures: document.images.length,
  turnable: document.querySelector("#turning:not([hidden]) canvas") !== null,
  fetched: performance.getEntriesByType("resource").map((entry) => entry.name)
    .filter((name) => !name.startsWith("data:")),
}, "*"));</script>"""
FRAME = """<!DOCTYPE html><iframe src="probed.html" style="width:390px;height:800px;border:0">
</iframe><pre id="told">nothing</pre><script>addEventListener("message", (event) => {
document.getElementById("told").textContent = "TOLD" + JSON.stringify(event.data) + "END"; });
</script>"""
FLAGS = (
    "--headless", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage",
    "--enable-logging=stderr", "--v=0", "--enable-unsafe-swiftshader",
    "--virtual-time-budget=10000", "--dump-dom",
)  # fmt: skip


@pytest.fixture(scope="module")
def browser():
    for name in ("chromium", "chromium-browser", "google-chrome"):
        found = shutil.which(name)
        if found and _runs(found):
            return found
    return pytest.skip("neither chromium nor google-chrome runs here")


def _runs(program):
    """Some systems have a stub that only tells how to install it."""
    answer = subprocess.run([program, "--version"], capture_output=True, timeout=60, check=False)
    return answer.returncode == 0


def open_at_390_pixels(browser, text, folder):
    """What the page reports of itself in a frame of a phone's width, and the console's lines."""
    (folder / "probed.html").write_text(text.replace("</head>", f"{PROBE}</head>", 1), "utf-8")
    (folder / "frame.html").write_text(FRAME, "utf-8")
    root = ["--no-sandbox"] if os.geteuid() == 0 else []
    profile = f"--user-data-dir={folder / 'profile'}"
    done = subprocess.run(
        [browser, *FLAGS, *root, profile, (folder / "frame.html").as_uri()],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    told = re.search("TOLD(.*)END", done.stdout)
    assert told, done.stderr
    console = [line for line in done.stderr.splitlines() if ":CONSOLE" in line]
    return json.loads(told[1].replace("&amp;", "&")), console


def assert_fit_for_a_phone(browser, text, folder, pictures):
    told, console = open_at_390_pixels(browser, text, folder)
    assert console == []
    assert told["window"] == 390
    assert told["wide"] <= 390
    assert told["broken"] == 0
    assert told["pictures"] == pictures
    assert told["fetched"] == []
    return told


def test_it_opens_in_a_browser_at_a_phones_width(browser, folder, tmp_path_factory):
    points = np.random.default_rng(0).normal(size=(50, 3))
    survey.save_cloud(folder, "fig09_cloud", points, points, np.full(50, "F1"))
    text = pages.page(folder, RUN)
    folder = tmp_path_factory.mktemp("browser")
    assert assert_fit_for_a_phone(browser, text, folder, pictures=3)["turnable"]


def test_the_browser_test_sees_what_is_wrong(browser, tmp_path):
    page = (
        '<!DOCTYPE html><html><head></head><body><img src="data:image/png;base64,AAAA" alt="no">'
        '<div style="width:900px">wide</div><script>nowhere()</script></body></html>'
    )
    told, console = open_at_390_pixels(browser, page, tmp_path)
    assert told["wide"] >= 900
    assert told["broken"] == 1
    assert "nowhere" in "".join(console)


@pytest.mark.skipif(not (FIGURES / pages.NAME).exists(), reason="no figures/report.html yet")
def test_the_committed_report_opens_in_a_browser_at_a_phones_width(browser, tmp_path):
    text = (FIGURES / pages.NAME).read_text(encoding="utf-8")
    assert_fit_for_a_phone(browser, text, tmp_path, pictures=text.count("<img "))


@pytest.mark.skipif(not (FIGURES / pages.NAME).exists(), reason="no figures/report.html yet")
def test_the_committed_report_is_light():
    assert (FIGURES / pages.NAME).stat().st_size <= 2_000_000
