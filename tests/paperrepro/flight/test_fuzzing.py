"""Files changed at random, from a seed: each ends as a user may expect.

Exit 0, 1 or 2; at most one line on stderr; no traceback; nothing half-written. What is accepted,
whatever notes it gets, gives the rays of the files as they were: all points lie where they belong,
to a quarter of what four sigma of the boresight move them by.
"""

import json
import shutil
import struct
from dataclasses import replace

import laspy
import numpy as np
import pytest

from data_synth import make_config, simulate
from data_synth.operator import Site, write_survey
from paperrepro._cache import cached
from paperrepro.cli import main
from paperrepro.flight.geodesy import Grid
from paperrepro.method.georeference import georeference_strip
from tests.paperrepro.flight.test_posed import record
from tests.paperrepro.flight.test_round_trip import frame_of

#: Changes of each kind; together at least 300.
ROUNDS = 34
#: Points of a strip: every so many of the simulated ones.
THINNING = 160
#: What an undiscovered change may move, m; sigma of a flight like this are a hundredth of a degree
#: for roll and pitch and three for yaw, four of them 4 cm at 30 m.
MOVED = 0.01
NASTY = (0, 1, 0x7F, 0x80, 0xFF)
NUMBERS = (0.0, -1.0, 1e-300, 1e300, np.nan, np.inf, -np.inf, 2.0**31, 1e9, 0.1, 360.0)
TOKENS = ("", "true", "-1", "1e999", "[", "]", '"', "nan", "=", "\ufeff", "9" * 400, "{}", "null")


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A small flight, and where the points of its strips go under the true mounting."""
    survey, truth = cached(simulate, make_config())
    strips = [survey.strip(name).take(slice(None, None, THINNING)) for name in ("F1", "F7")]
    survey = replace(survey, strips=tuple(strips))
    folder = tmp_path_factory.mktemp("fuzzed")
    write_survey(folder, survey, truth, Site(), 1e-4)
    las = laspy.read(folder / "F1.laz")
    las.write(folder / "plain.las")
    return folder, {"survey": survey, "points": points(survey, truth.mounting)}


def some_bytes(data, rng, first=0, last=None):
    """A few bytes changed, cut, or repeated."""
    data, last = bytearray(data), min(last or len(data), len(data))
    kind = rng.integers(6)
    at = int(rng.integers(first, last))
    if kind == 0:
        return bytes(data[:at])
    if kind == 1:
        return bytes(data[:at] + data[at : at + 64] + data[at:])
    for place in rng.integers(first, last, rng.integers(1, 9)):
        data[place] = rng.choice(NASTY) if rng.random() < 0.5 else rng.integers(256)
    return bytes(data)


def some_number(data, rng, form, places):
    """One number of a header replaced."""
    data, place = bytearray(data), int(rng.choice(places))
    value = (
        rng.choice(NUMBERS) if form == "<d" else int(rng.integers(2 ** (8 * struct.calcsize(form))))
    )
    struct.pack_into(form, data, place, value)
    return bytes(data)


def some_token(data, rng):
    """A word of a text replaced, removed, or written twice."""
    words = data.decode().replace(",", " , ").split(" ")
    at = int(rng.integers(len(words)))
    kind = rng.integers(3)
    words[at : at + 1] = [[TOKENS[rng.integers(len(TOKENS))]], [], words[at : at + 1] * 2][kind]
    return " ".join(words).encode()


def some_record(data, rng):
    """A number of an SBET's record, or a whole column, replaced."""
    table = np.frombuffer(data, "<f8").reshape(-1, 17).copy()
    row = slice(None) if rng.random() < 0.3 else int(rng.integers(len(table)))
    table[row, rng.integers(11)] *= rng.choice([-1.0, 0.0, np.degrees(1), 1.001, 1e9, np.nan])
    return table.tobytes()


CHANGES = {
    "header of LAZ": ("F1.laz", lambda d, rng: some_bytes(d, rng, 4, 375)),
    "numbers of a header": ("F1.laz", lambda d, rng: some_number(d, rng, "<d", range(131, 227, 8))),
    "counts of a header": (
        "plain.las", lambda d, rng: some_number(d, rng, "<I", (96, 100, 107, 235, 243, 247)),
    ),
    "records of LAS": ("plain.las", lambda d, rng: some_bytes(d, rng, 375)),
    "records of LAZ": ("F1.laz", lambda d, rng: some_bytes(d, rng, 375)),
    "bytes of an SBET": ("mission.sbet", some_bytes),
    "records of an SBET": ("mission.sbet", some_record),
    "mounting": ("mounting.toml", some_token),
    "calibration": ("truth.json", some_token),
}  # fmt: skip


def strips_of(folder, name):
    return [
        folder / name if name.endswith(("las", "laz")) else folder / "F1.laz",
        folder / "F7.laz",
    ]


def arguments(folder, name, out):
    return [
        "apply", *map(str, strips_of(folder, name)), "--trajectory", str(folder / "mission.sbet"),
        "--mounting", str(folder / "mounting.toml"), "--calibration", str(folder / "truth.json"),
        "--out", str(out),
    ]  # fmt: skip


def require_sane(code, captured, out):
    """What holds of every end."""
    assert code in (0, 1, 2)
    lines = captured.err.strip().splitlines()
    assert len(lines) <= 1, captured.err
    assert "Traceback" not in captured.err
    assert (code == 0) == (not lines), captured.err
    assert out.exists() == (code == 0)


def require_right(folder, name, out, right):
    """Written strips hold all points, each where it belongs."""
    frame, grid = frame_of(Site()), Grid(Site().epsg)
    for path in strips_of(folder, name):
        las = laspy.read(out / path.name)
        found = frame.from_geodetic(*grid.to_geodetic(np.column_stack([las.x, las.y, las.z])))
        assert len(found) == len(right[path.stem])
        off = np.linalg.norm(found - right[path.stem], axis=1)
        assert np.quantile(off, 0.99) < MOVED


def expected(folder, name, right):
    """Where points go: under the calibration as it reads now, where that was changed."""
    if name != "truth.json":
        return right["points"]
    said = json.loads((folder / name).read_text(encoding="utf-8-sig"))
    mounting = replace(right["survey"].mounting, lever_arm=np.array(said["lever_arm_m"]))
    boresight = np.radians([said["boresight_deg"][angle] for angle in ("omega", "phi", "kappa")])
    mounting = mounting.with_calibration(boresight, said.get("range_offsets_m"))
    return points(right["survey"], mounting)


def points(survey, mounting):
    """Of each strip, m, under ``mounting``."""
    found = {s.name: georeference_strip(survey, s, mounting) for s in survey.strips}
    return found | {"plain": found["F1"]}


def end_of(folder, name, right, out, capfd):
    """The exit code, and what is wrong with it, if anything."""
    try:
        code = main(arguments(folder, name, out))
    except Exception as error:
        capfd.readouterr()
        return 3, f"{type(error).__name__}: {error}"
    captured = capfd.readouterr()
    try:
        require_sane(code, captured, out)
        if code == 0:
            require_right(folder, name, out, expected(folder, name, right))
    except AssertionError as error:
        return code, f"exit {code}: {error}"
    finally:
        shutil.rmtree(out, ignore_errors=True)
    return code, ""


def test_changed_files(flight, tmp_path, capfd):
    folder, right = flight
    ends, wrong = {kind: [0] * 4 for kind in CHANGES}, []
    for kind, (name, change) in CHANGES.items():
        original = (folder / name).read_bytes()
        for number in range(ROUNDS):
            rng = np.random.default_rng([len(kind), number])
            (folder / name).write_bytes(change(original, rng))
            code, fault = end_of(folder, name, right, tmp_path / "out", capfd)
            ends[kind][code] += 1
            wrong += [f"{kind}, change {number}: {fault}"] if fault else []
        (folder / name).write_bytes(original)
    assert not wrong, "\n".join(wrong)
    assert sum(map(sum, ends.values())) >= 300
    assert all(refused for _, _, refused, _ in ends.values()), ends
    assert sum(taken for taken, *_ in ends.values()) > 20, ends


@pytest.mark.parametrize("number", range(12))
def test_changed_tables(thinned, folder, tmp_path, capfd, number):
    """A CSV with poses of its own."""
    given = folder()
    path = given.path / "F1.csv"
    table = record(thinned, given).iloc[::20]
    table.to_csv(path, index=False)
    text = path.read_text().splitlines()
    rng = np.random.default_rng(number)
    line = 0 if number % 3 == 0 else int(rng.integers(len(text)))
    text[line] = some_token(text[line].encode(), rng).decode()
    path.write_text("\n".join(text))
    arguments = ["calibrate", str(path), "--mounting", str(given.mounting), "--crs", "EPSG:32722"]
    code = main([*arguments, "--out", str(tmp_path / "out")])
    require_sane(code, capfd.readouterr(), tmp_path / "out")
    assert code == 2


@pytest.mark.parametrize(
    "change",
    [
        lambda a: [*a, "--crs", "EPSG:0"], lambda a: [*a, "--crs", ""],
        lambda a: [*a, "--crs", "x" * 999],
        lambda a: [*a, "--ring-dimension", ""], lambda a: [*a, "--ring-dimension", "X"],
        lambda a: [*a, "--ring-dimension", "gps_time"], lambda a: a[:1] + a[2:3] * 2 + a[3:],
        lambda a: [word.replace("mission.sbet", "") for word in a],
        lambda a: [word.replace("mounting.toml", "mission.sbet") for word in a],
        lambda a: [word.replace("truth.json", "mounting.toml") for word in a],
        lambda a: [word.replace("truth.json", "F1.laz") for word in a],
        lambda a: [word.replace("F7.laz", ".") for word in a],
    ],
    ids=range(12),
)  # fmt: skip
def test_changed_command_lines(flight, tmp_path, capfd, change):
    folder, _ = flight
    out = tmp_path / "out"
    code = main(change(arguments(folder, "F1.laz", out)))
    require_sane(code, capfd.readouterr(), out)
    assert code == 2
    assert json.loads((folder / "truth.json").read_text())
