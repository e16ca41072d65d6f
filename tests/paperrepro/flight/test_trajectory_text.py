"""Trajectories as text: layouts of post-processors' exports, and mistakes in them."""

import numpy as np
import pytest

from paperrepro.cli import main
from paperrepro.errors import BadInput
from paperrepro.flight.trajectory_file import TrajectoryFile

EVERY = 4  # of the SBET's records: text is slow to write


@pytest.fixture
def flown(folder):
    """The folder, and its trajectory as time, latitude, longitude, height, roll, pitch, heading in
    degrees (M, 7), and easting, northing (M, 2)."""
    written = folder()
    table = np.fromfile(written.sbet, "<f8").reshape(-1, 17)[::EVERY]
    grid = written.read().files[0].grid
    xyz = grid.from_geodetic(*table[:, 1:4].T)
    angles = np.degrees(table[:, [1, 2, 7, 8, 9]])
    columns = (table[:, 0], angles[:, 0], angles[:, 1], table[:, 3], *angles[:, 2:].T)
    return written, np.column_stack(columns), xyz


def lines(values, separator, digits):
    formats = [f"%.{d}f" for d in digits]
    return [separator.join(f % v for f, v in zip(formats, row, strict=True)) for row in values]


def pospac(values, xyz):
    """POSPac: a preamble, names with commas between, units, values with blanks between."""
    distance = np.zeros(len(values))
    whole = np.column_stack([values[:, 0], distance, xyz[:, :2], values[:, [3, 1, 2, 3, 4, 5, 6]]])
    return "\n".join(
        [
            "POS Export Utility [Version 8.4]", "", "Input file : sbet_mission.out",
            "Datum : WGS84", "Local transformation : None", "",
            "TIME, DISTANCE, EASTING, NORTHING, ELLIPSOID HEIGHT, LATITUDE, LONGITUDE, "
            "ELLIPSOID HEIGHT, ROLL, PITCH, HEADING",
            "  (time in Sec, distance in Meters, position in Meters, lat and long in Degrees, "
            "orientation angles in Degrees)", "",
            *lines(whole, "   ", (6, 3, 3, 3, 4, 10, 10, 4, 7, 7, 7)), "",
        ]
    )  # fmt: skip


def inertial_explorer(values, xyz):
    """Inertial Explorer: a header, names and units in columns."""
    week = np.full(len(values), 2300)
    whole = np.column_stack([week, values[:, 0], values[:, 1:]])
    return "\n".join(
        [
            "Project:     farm", "Program:     Inertial Explorer Version 8.90",
            "Profile:     pose", "Datum:       WGS84, (processing datum)", "",
            "  Week   GPSTime       Latitude      Longitude    H-Ell   Roll   Pitch  Heading",
            "         (sec)         (deg)         (deg)        (m)     (deg)  (deg)  (deg)",
            *lines(whole, "  ", (0, 6, 10, 10, 4, 7, 7, 7)),
        ]
    )  # fmt: skip


def comma_separated(values, xyz):
    """A table of map coordinates with angles in radians, units behind the names."""
    whole = np.column_stack([values[:, 0], xyz, np.radians(values[:, 4:])])
    head = "Time [s],Easting [m],Northing [m],Height [m],Roll [rad],Pitch [rad],Yaw [rad]"
    return "\r\n".join([head, *lines(whole, ",", (6, 4, 4, 4, 9, 9, 9))])


def sixtieths(values, xyz):
    """As Inertial Explorer, latitude and longitude in degrees, minutes and seconds."""
    rows = [
        f"2300 {time:.6f} {dms(lat)} {dms(lon)} " + " ".join(f"{v:.7f}" for v in rest)
        for time, lat, lon, *rest in values
    ]
    head = "  Week   GPSTime   Latitude   Longitude   H-Ell   Roll   Pitch  Heading"
    units = "  (weeks)  (sec)   (+/-D M S)  (+/-D M S)  (m)  (deg)  (deg)  (deg)"
    return "\n".join(["Project:  farm", "", head, units, *rows])


def dms(angle):
    degrees, rest = divmod(abs(angle), 1)
    minutes, rest = divmod(60 * rest, 1)
    return f"{'-' if angle < 0 else ''}{degrees:.0f} {minutes:02.0f} {60 * rest:.7f}"


LAYOUTS = {
    "POSPac": pospac, "Inertial Explorer": inertial_explorer, "table": comma_separated,
    "degrees, minutes, seconds": sixtieths,
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_exports_are_read_as_the_sbet(flown, layout):
    written, values, xyz = flown
    expected = written.read()
    path = written.path / "mission.txt"
    path.write_text("\ufeff" + LAYOUTS[layout](values, xyz), encoding="utf-8")
    found = written.read(trajectory=path)
    assert found.notes == expected.notes
    at = values[10:-10:50, 0]
    change = found.survey.trajectory.at(at) - expected.survey.trajectory.at(at)
    assert np.abs(change[:, :3]).max() < 1e-3
    assert np.abs(np.angle(np.exp(1j * change[:, 3:]))).max() < 1e-7


def test_columns_are_named_where_no_head_line_does(flown):
    written, values, _ = flown
    path = written.path / "mission.txt"
    path.write_text("\n".join(lines(values, ";", (6, 10, 10, 4, 7, 7, 7))).replace(".", ","))
    with pytest.raises(BadInput, match=r"mission.txt, line 1: 7 columns.*--columns"):
        written.read(trajectory=path)
    found = written.read(trajectory=path, columns="time,lat,lon,height,roll,pitch,heading")
    assert len(found.survey.trajectory.time) == len(values)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ("time,lon,lat,height,roll,pitch,heading", "interchanged"),
        ("time,lat,lon,height,pitch,roll,heading", "do not fit|interchanged"),
        ("time,lat,lon,height,roll,pitch", "7 columns, 6 are named"),
        ("time,lat,lon,height,roll,pitch,track", "expected columns time, latitude"),
    ],
)
def test_columns_named_by_mistake_are_refused(flown, columns, words):
    written, values, _ = flown
    path = written.path / "mission.txt"
    path.write_text("\n".join(lines(values, " ", (6, 10, 10, 4, 7, 7, 7))))
    with pytest.raises(BadInput, match=words):
        written.read(trajectory=path, columns=columns)


def test_a_line_that_holds_no_pose_is_named(flown):
    written, values, xyz = flown
    rows = comma_separated(values, xyz).split("\r\n")
    path = written.path / "mission.csv"
    path.write_text("\n".join([*rows, "", "# end of file"]))
    assert len(written.read(trajectory=path).survey.trajectory.time) == len(values)
    rows[500] = "lost," + rows[500].split(",", 1)[1]
    path.write_text("\n".join(rows))
    with pytest.raises(BadInput, match=r"mission.csv, line 501: expected numbers"):
        written.read(trajectory=path)


def test_strips_are_written_under_a_text_as_under_the_sbet(flown, tmp_path):
    written, values, xyz = flown
    written.sbet = written.path / "mission.txt"
    written.sbet.write_text(pospac(values, xyz))
    assert main(written.arguments(tmp_path / "out")) == 0
    assert len(list((tmp_path / "out").glob("*.laz"))) == len(written.strips)


def test_the_sign_of_no_degrees_is_kept(tmp_path):
    path = tmp_path / "london.txt"
    pose = "30.0 0.1 0.2 350.0"
    path.write_text(
        "time lat lon height roll pitch heading\n"
        f"1.0 51 28 30.0 -0 12 36.0 {pose}\n2.0 51 28 30.0 0 12 36.0 {pose}\n"
    )
    records = TrajectoryFile(path).records()
    np.testing.assert_allclose(np.degrees(records[:, 1]), 51.475)
    np.testing.assert_allclose(np.degrees(records[:, 2]), [-0.21, 0.21])


def test_degrees_minutes_and_seconds_in_one_field_are_refused(tmp_path):
    path = tmp_path / "london.txt"
    path.write_text("time lat lon h roll pitch heading\n1.0 51:28:30.0 -0:12:36.0 30 0.1 0.2 350\n")
    with pytest.raises(BadInput, match=r"london.txt: degrees, minutes and seconds .* decimal"):
        TrajectoryFile(path).records()


def test_records_of_another_format_are_refused(tmp_path):
    path = tmp_path / "mission.pof"
    path.write_bytes(bytes(range(256)) * 10)
    with pytest.raises(BadInput, match=r"mission.pof: .*RIEGL POF: export SBET or text"):
        TrajectoryFile(path).records()
