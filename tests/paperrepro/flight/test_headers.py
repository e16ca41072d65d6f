"""What a header says of its data is compared with them: mended with a note, or refused."""

import struct
import time

import laspy
import numpy as np
import pytest
from laspy.vlrs.vlr import VLR
from laspy.vlrs.vlrlist import VLRList

from data_synth.operator import Site
from paperrepro.cli import main
from paperrepro.errors import BadInput
from tests.paperrepro.flight.test_round_trip import differences, frame_of

#: Places in a header of LAS 1.4.
N_VLRS, N_LEGACY, SCALES, BOX, N_EVLRS, N_POINTS = 100, 107, 131, 179, 243, 247


def patch(path, place, form, *values):
    data = bytearray(path.read_bytes())
    struct.pack_into(form, data, place, *values)
    path.write_bytes(data)


def as_las(folder, name):
    path = folder.path / f"{name}.las"
    laspy.read(folder.path / f"{name}.laz").write(path)
    return path


@pytest.mark.parametrize("box", [[0.0] * 6, [np.nan] * 6, [1e300, -1e300] * 3])
def test_the_box_is_not_believed(thinned, folder, box):
    given = folder()
    usual = given.read()
    for path in given.strips:
        patch(path, BOX, "<6d", *box)
    flight = given.read()
    assert flight.frame == usual.frame
    assert differences(usual.survey, flight.survey)["rho"] == 0


@pytest.mark.parametrize("share", [0, 1 / 3])
@pytest.mark.parametrize("kind", ["las", "laz"])
def test_a_count_too_small_is_mended_with_a_note(thinned, folder, tmp_path, kind, share):
    survey, _ = thinned
    given = folder()
    path = as_las(given, "F1") if kind == "las" else given.strips[0]
    count = len(survey.strip("F1"))
    patch(path, N_LEGACY, "<I", 0)
    patch(path, N_POINTS, "<Q", int(share * count))
    flight = given.read(strips=[path])
    assert len(flight.survey.strips[0]) == count
    assert any(f"the file holds {count}" in note for note in flight.notes)
    assert main(given.arguments(tmp_path / "out", strips=[path])) == 0
    assert len(laspy.read(tmp_path / "out" / path.name).points) == count


def test_old_compressed_strips_do_not_tell_their_number_and_are_refused(folder):
    given = folder()
    las = laspy.convert(laspy.read(given.strips[0]), point_format_id=1, file_version="1.2")
    las.points = las.points[np.tile(np.arange(len(las.points)), 8)]
    path = given.path / "old.laz"
    las.write(path)
    patch(path, N_LEGACY, "<I", 1000)
    with pytest.raises(BadInput, match="its header counts 1000 points, its chunks hold more than"):
        given.read(strips=[path], crs="EPSG:32722")


def test_a_count_too_large_is_a_file_cut_off(folder):
    given = folder()
    path = as_las(given, "F1")
    patch(path, N_POINTS, "<Q", 10**12)
    with pytest.raises(BadInput, match=r"F1.las: its points cannot be read from number .* cut off"):
        given.read(strips=[path])


@pytest.mark.parametrize(
    ("place", "form", "values"),
    [
        (N_VLRS, "<I", [2**32 - 2]),
        (N_EVLRS, "<I", [2**32 - 2]),
        (SCALES, "<3d", [0.0] * 3),
        (SCALES, "<3d", [np.nan] * 3),
        (25, "<B", [200]),
        (94, "<H", [60_000]),
        (105, "<H", [0]),
    ],
)
def test_numbers_that_no_header_has(folder, place, form, values):
    given = folder()
    path = given.strips[0]
    patch(path, place, form, *values)
    start = time.perf_counter()
    with pytest.raises(BadInput, match=r"F1.laz: its LAS header cannot be read") as error:
        given.read()
    assert time.perf_counter() - start < 10
    assert "\n" not in str(error.value)


def test_the_frame_lies_at_strips_across_the_date_line(thinned, folder):
    site = Site(-17.0, 180.0, 5.0)
    flight = folder(site).read()
    turned = np.angle(np.exp(1j * (flight.frame.longitude - np.pi)))
    assert abs(turned) * 6.378e6 < 200
    worst = differences(thinned[0], flight.survey)
    assert worst["rho"] < 2e-4
    assert worst["azimuth"] < 1e-4


# --- what cannot be written as it is -------------------------------------------------------------


def test_cloud_optimised_strips_are_written_as_common_ones(thinned, folder, tmp_path, capsys):
    given = folder()
    las = laspy.read(given.strips[0])
    las.header.vlrs.insert(0, VLR("copc", 1, "COPC info", bytes(160)))
    las.evlrs = VLRList([VLR("copc", 1000, "EPT hierarchy", bytes(32)), VLR("own", 7, "x", b"abc")])
    path = given.path / "F1.copc.laz"
    las.write(path)
    assert main(given.arguments(tmp_path / "out", strips=[path])) == 0
    assert "without its COPC index" in capsys.readouterr().out
    written = laspy.read(tmp_path / "out" / path.name)
    assert [record.user_id for record in written.evlrs] == ["own"]
    assert len(written.points) == len(las.points)


def test_las_1_0_is_written_as_1_2(thinned, folder, tmp_path):
    given = folder()
    las = laspy.convert(laspy.read(given.strips[0]), point_format_id=1, file_version="1.2")
    path = given.path / "old.las"
    las.write(path)
    patch(path, 24, "<BB", 1, 0)
    arguments = given.arguments(tmp_path / "out", strips=[path])
    assert main([*arguments, "--crs", "EPSG:32722"]) == 0
    written = laspy.read(tmp_path / "out" / "old.las")
    assert str(written.header.version) == "1.2"
    assert len(written.points) == len(thinned[0].strip("F1"))


def test_coordinates_that_fill_their_integers_are_refused_first(folder, tmp_path, capsys):
    given = folder()

    def full(las):
        middle = [np.asarray(las[axis]).mean() for axis in "xyz"]
        las.change_scaling(scales=[1e-4] * 3, offsets=np.array(middle) - [214_740, 0, 0])

    given.change_strips(full, ["F1"])
    assert main(given.arguments(tmp_path / "out")) == 2
    assert "F1.laz: its coordinates fill the 32 bits" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_metres_read_as_degrees(folder, capsys, tmp_path):
    given = folder()
    assert main([*given.arguments(tmp_path / "out"), "--crs", "EPSG:4326"]) == 2
    line = capsys.readouterr().err
    assert "lie outside of WGS 84, expected degrees" in line
    assert line.count("\n") == 1


def test_frame_of_is_the_site(folder):
    assert folder().read(frame=frame_of(Site())).frame == frame_of(Site())
