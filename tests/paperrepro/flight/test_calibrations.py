"""`apply` believes a calibration only as far as it can be one of these strips."""

import json
import os
import subprocess
import sys

import laspy
import matplotlib.pyplot as plt
import numpy as np
import pytest

from paperrepro import __version__
from paperrepro.cli import main
from paperrepro.errors import BadInput
from paperrepro.figures.flight import flight_map
from tests.paperrepro.flight.test_refusals import refused

DEG = {"omega": 0.5, "phi": -0.4, "kappa": 0.3}


@pytest.fixture
def given(folder):
    return folder()


def write(given, **content):
    (given.path / "truth.json").write_text(json.dumps({"boresight_deg": DEG} | content))


@pytest.mark.parametrize(
    ("content", "fact"),
    [
        ({"boresight_deg": {**DEG, "kappa": True}}, "3 finite numbers"),
        ({"boresight_deg": {**DEG, "kappa": "0.3"}}, "3 finite numbers"),
        ({"boresight_deg": {**DEG, "kappa": float("nan")}}, "3 finite numbers"),
        ({"boresight_deg": {**DEG, "kappa": 90.0}}, "up to 15"),
        ({"boresight_deg": {**DEG, "kappa": 10**400}}, "3 finite numbers"),
        ({"boresight_deg": [1, 2, 3]}, "omega, phi and kappa"),
        ({"range_offsets_m": [0.01] * 15}, "16 finite numbers"),
        ({"range_offsets_m": [0.01] * 15 + [7.0]}, "up to 1"),
        ({"range_offsets_m": "none"}, "finite numbers"),
        ({"lever_arm_m": [3.0, 0, 0]}, "another one"),
        ({"lever_arm_m": [3.0, 0]}, "3 finite numbers"),
        ({"sigma_deg": {**DEG, "omega": -1}}, "above 0"),
        ({"sigma_deg": {**DEG, "phi": 0.0}}, "above 0"),
        ({"sigma_deg": {"omega": 1}}, "sigma_deg with omega"),
        ({"paperrepro": "99.0.0"}, "got '99.0.0'"),
        ({"paperrepro": 3}, "up to"),
        ({"nominal": {"rotation": np.eye(3).tolist()}}, "nominal rotation"),
        ({"nominal": {"lever_arm_m": [0.1, -0.02, 0.16]}}, "nominal lever_arm_m"),
        ({"scanner": {"beam_elevations_deg": list(range(16))}}, "other beams"),
        ({"scanner": {"beam_elevations_deg": "all"}}, "other beams"),
        ({"beams": "all"}, "beams_deg: expected"),
        ({"beams": {"elevation_deg": [0.01] * 16}}, "beams_deg: expected"),
        ({"beams": {"elevation_deg": [9.0] * 16, "azimuth_deg": [0.0] * 16}}, "up to 5"),
    ],
)
def test_numbers_that_no_calibration_of_these_strips_has(given, capsys, content, fact):
    write(given, **content)
    refused(given, capsys, "truth.json", fact)


@pytest.mark.parametrize("text", ["[" * 100_000, "1" * 5000, "{", "[1]", "\ud800"])
def test_text_that_is_none(given, capsys, text):
    (given.path / "truth.json").write_bytes(text.encode("utf-8", "surrogatepass"))
    refused(given, capsys, "truth.json", "JSON")


def test_a_byte_order_mark_does_not_matter(given, tmp_path):
    path = given.path / "truth.json"
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    given.mounting.write_bytes(b"\xef\xbb\xbf" + given.mounting.read_bytes())
    assert main(given.arguments(tmp_path / "out")) == 0


def test_what_a_calibration_says_of_itself_is_passed_on(given, tmp_path, capsys):
    write(given, observability={"undetermined": ["yaw"]}, paperrepro=__version__)
    assert main(given.arguments(tmp_path / "out")) == 0
    assert "did not determine yaw" in capsys.readouterr().out


@pytest.mark.parametrize(
    "text",
    [
        "nominal = 3", "[nominal]\nrotation = true\nlever_arm_m = [0, 0, 0]",
        "[nominal]\nrotation = [[1, 0, 0], [0, 1, 0], [0, 0]]\nlever_arm_m = [0, 0, 0]",
        "[nominal]\nrotation = [[0,0,1],[0,-1,0],[1,0,0]]\nlever_arm_m = [true, 0, 0]",
        "[nominal]\nrotation = [[0,0,1],[0,-1,0],[1,0,0]]\nlever_arm_m = ['0', '0', '0']",
        "scanner = 4\n[nominal]\nrotation = [[0,0,1],[0,-1,0],[1,0,0]]\nlever_arm_m = [0,0,0]",
        "a = " + "[" * 20_000, f"a = {'9' * 5000}",
        f"[nominal]\nrotation = [[0,0,1],[0,-1,0],[1,0,0]]\nlever_arm_m = [1{'0' * 400}, 0, 0]",
        "[nominal]\nrotation = " + "[" * 90 + "1" + "]" * 90 + "\nlever_arm_m = [0, 0, 0]",
    ],
)  # fmt: skip
def test_mountings_of_wrong_types(given, capsys, text):
    given.mounting.write_text(text)
    refused(given, capsys, "mounting.toml")


def test_strips_that_are_corrected_already(given, tmp_path):
    """Told by their rays, which fit a boresight; and by the header where they cannot."""
    assert main(given.arguments(tmp_path / "out")) == 0
    corrected = sorted((tmp_path / "out").glob("*.laz"))
    with pytest.raises(BadInput, match=r"fit a boresight of .* corrected by a calibration already"):
        given.read(strips=corrected)
    write(given, boresight_deg={"omega": 0.3, "phi": 0.0, "kappa": 0.0})
    assert main(given.arguments(tmp_path / "rolled")) == 0
    notes = given.read(strips=sorted((tmp_path / "rolled").glob("*.laz"))).notes
    assert sum("was written under a calibration" in note for note in notes) == 3


def test_a_datum_some_decimetres_off_is_mended_with_a_note(given):
    """As between epochs of one datum: a constant shift in plan and height."""

    def moved(las):
        for axis, shift in zip("xyz", (0.8, -0.5, 0.3), strict=True):
            setattr(las, axis, np.asarray(las[axis]) + shift)

    given.change_strips(moved)
    flight = given.read()
    np.testing.assert_allclose(flight.decoder.shift[2], -0.3, atol=0.01)
    np.testing.assert_allclose(np.linalg.norm(flight.decoder.shift[:2]), np.hypot(0.8, 0.5),
                               atol=0.02)  # fmt: skip
    assert any("different datums or epochs" in note for note in flight.notes)
    assert laspy.read(given.strips[0]).header.point_count == sum(
        len(strip) for strip in flight.survey.strips[:1]
    )


def test_names_that_no_console_and_no_formula_can_hold(given, tmp_path):
    """Bytes that are no UTF-8, dollars; a console of ASCII alone."""
    strips = []
    odd = (b"a$x_{.laz", b"stra\xdfe.laz", b"\xe2\x82\xac.laz")
    for path, name in zip(given.strips, odd, strict=True):
        strips.append(path.rename(path.with_name(os.fsdecode(name))))
    arguments = given.arguments(tmp_path / "out", strips=strips)
    ran = subprocess.run(
        [sys.executable, "-m", "paperrepro", *arguments], capture_output=True,
        env=os.environ | {"PYTHONIOENCODING": "ascii"},
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    assert ran.stderr == b""
    assert len(list((tmp_path / "out").iterdir())) == 3
    names = [strip.name for strip in given.read(strips=strips).survey.strips]
    assert names == ["a$x_{", "stra?e", "€"]


def test_a_map_of_strips_named_as_formulas():
    line = np.arange(30.0).reshape(10, 3)
    figure, ax = plt.subplots()
    flight_map(ax, {"a$x_{$b": line}, {"a$x_{$b": line}, line)
    figure.canvas.draw()
    plt.close(figure)
