"""Points that carry their poses: tables as the paper's record, and real flights where they lie."""

from pathlib import Path

import laspy
import numpy as np
import pandas as pd
import pytest

from paperrepro.errors import BadInput
from paperrepro.flight import flight_lines
from paperrepro.flight.read import read_flight
from paperrepro.flight.scanners import BEAMS_DEG
from paperrepro.flight.table import pose_columns
from paperrepro.method.georeference import georeference
from paperrepro.survey import Strip
from tests.paperrepro.flight.test_round_trip import frame_of

ARMO = Path(__file__).resolve().parents[4] / "shared" / "data" / "armo"
REAL = pytest.mark.skipif(not ARMO.is_dir(), reason="the real flights lie in ../shared/data/armo")
REAL_MOUNTING = """[nominal]
rotation = [[0, 0, 1], [0, -1, 0], [1, 0, 0]]
lever_arm_m = [0.161, 0, -0.016]
"""


def record(thinned, folder, name="F1"):
    """The paper's record of a strip, angles in degrees."""
    survey, _ = thinned
    strip = survey.strip(name)
    rays = survey.rays(strip)
    las = laspy.read(folder.path / f"{name}.laz")
    sbet = np.fromfile(folder.sbet, "<f8").reshape(-1, 17)
    at = [np.interp(strip.time, sbet[:, 0], sbet[:, k]) for k in (1, 2, 3)]
    frame = frame_of(folder.site)
    latitude, longitude, height = frame.to_geodetic(rays.pose[:, :3])
    np.testing.assert_allclose(latitude, at[0], atol=1e-8)
    return pd.DataFrame(
        {
            "x": np.asarray(las.x), "y": np.asarray(las.y), "z": np.asarray(las.z),
            "intensity": 0, "range": rays.rho,
            "vertical angle": np.degrees(rays.elevation),
            "horizontal angle": np.degrees(rays.azimuth),
            "latitude": np.degrees(latitude), "longitude": np.degrees(longitude),
            "elevation": height,
            # within 100 m of the origin the local level is turned by 16 urad at most
            "roll": np.degrees(rays.pose[:, 3]), "pitch": np.degrees(rays.pose[:, 4]),
            "heading": np.degrees(rays.pose[:, 5]), "gps_time": strip.time,
        }
    )  # fmt: skip


def test_the_paper_s_record(thinned, folder):
    survey, _ = thinned
    given = folder()
    table = record(thinned, given)
    path = given.path / "F1.csv"
    table.to_csv(path, index=False)
    flight = given.read(
        strips=[path], trajectory=None, crs="EPSG:32722", frame=frame_of(given.site)
    )
    true, strip = survey.strip("F1"), flight.survey.strip("F1")
    np.testing.assert_array_equal(strip.ring, true.ring)
    np.testing.assert_allclose(strip.rho, true.rho, atol=2e-4)
    found, expected = flight.survey.rays(strip), survey.rays(true)
    np.testing.assert_allclose(found.pose[:, :3], expected.pose[:, :3], atol=1e-5)
    turn = (found.pose - expected.pose)[:, 3:]
    assert np.abs(np.arctan2(np.sin(turn), np.cos(turn))).max() < 2.5e-5
    np.testing.assert_allclose(found.azimuth, expected.azimuth, atol=1e-4)
    assert strip.pose.shape == (len(true), 6)
    assert flight.survey.trajectory.time[0] == pytest.approx(true.time[0])


def test_a_table_without_times_or_rings_of_its_own(thinned, folder):
    given = folder()
    table = record(thinned, given).drop(columns="gps_time")
    table["vertical angle"] = np.radians(table["vertical angle"])
    path = given.path / "F1.csv"
    table.to_csv(path, index=False)
    flight = given.read(strips=[path], trajectory=None, crs="EPSG:32722")
    np.testing.assert_array_equal(flight.survey.strips[0].ring, thinned[0].strip("F1").ring)
    assert any("no time" in note for note in flight.notes)


@pytest.mark.parametrize(
    ("change", "fact"),
    [
        (lambda table: table.drop(columns="x"), "x missing"),
        (lambda table: table.drop(columns="heading"), "give --trajectory"),
        (lambda table: table.drop(columns="vertical angle"), "expected the ring of each point"),
        (lambda table: table.assign(roll=table.roll.where(table.index != 40)), "row 41"),
        (lambda table: table.assign(heading=table.heading + 7), "do not fit"),
        (lambda table: table[:0], "holds none"),
    ],
)
def test_a_table_that_cannot_be_used(thinned, folder, change, fact):
    given = folder()
    path = given.path / "F1.csv"
    change(record(thinned, given)).to_csv(path, index=False)
    with pytest.raises(BadInput, match=fact):
        given.read(strips=[path], trajectory=None, crs="EPSG:32722")


@pytest.mark.parametrize("of", ["Sensor", "BeamOrigin"])
def test_extra_dimensions_that_hold_a_pose(of):
    own, place, turn = ["X", "Y", "Z"], [f"{of}{x}" for x in "XYZ"], ["Roll", "Pitch", "Heading"]
    found = pose_columns([*own, "gps_time", *place, *(f"{name}_deg" for name in turn)])
    assert found.position == tuple(place)
    assert not found.geodetic
    assert pose_columns([*own, *place, "BeamDirectionX"]) is None


def test_a_table_needs_its_reference_system(thinned, folder):
    given = folder()
    path = given.path / "F1.csv"
    record(thinned, given).to_csv(path, index=False)
    with pytest.raises(BadInput, match="--crs"):
        given.read(strips=[path], trajectory=None)


def test_strips_without_trajectory_or_poses(folder):
    given = folder()
    with pytest.raises(BadInput, match="give --trajectory"):
        given.read(trajectory=None)


# --- passes and times ----------------------------------------------------------------------------


def flown_line(seconds=20.0, speed=4.5, rate=500, turn_at=None):
    """A strip and its poses: north, and back after ``turn_at``."""
    time = np.arange(round(seconds * rate)) / rate
    north = speed * (time if turn_at is None else np.minimum(time, 2 * turn_at - time))
    pose = np.zeros((len(time), 6))
    pose[:, 1] = north
    strip = Strip("F", time, np.zeros(len(time), np.uint8), 0 * time, 0 * time + 30)
    return strip, pose


def test_one_pass_stays_whole():
    strip, pose = flown_line()
    parts, left_out = flight_lines.split(strip, lambda index: pose[index])
    assert parts == [strip]
    assert left_out == 0


def test_a_line_back_with_the_same_heading_is_another_pass():
    """A multirotor need not turn: the course tells."""
    strip, pose = flown_line(turn_at=10.0)
    parts, left_out = flight_lines.split(strip, lambda index: pose[index])
    assert [part.name for part in parts] == ["F.1", "F.2"]
    assert abs(len(parts[0]) - len(parts[1])) < 1500
    assert left_out + sum(map(len, parts)) == len(strip)


def test_a_pause_ends_a_pass():
    strip, pose = flown_line()
    kept = np.flatnonzero((strip.time < 8) | (strip.time > 14))
    parts, _ = flight_lines.split(strip.take(kept), lambda index: pose[kept][index])
    assert [len(part) for part in parts] == [4000, 2999]


def test_finer_times_follow_the_way():
    """At steady speed whole seconds give the times back, but for half a second's shift at most."""
    strip, pose = flown_line()
    coarse = np.floor(strip.time)
    assert flight_lines.whole_seconds(coarse)
    assert not flight_lines.whole_seconds(strip.time)
    fine = flight_lines.finer_times(coarse, pose[:, :3])
    np.testing.assert_allclose(fine, strip.time, atol=2e-3)
    assert (np.diff(fine) > 0).all()


# --- real flights --------------------------------------------------------------------------------


@REAL
@pytest.mark.parametrize(("name", "limit_deg"), [("Tent", 0.005), ("Car", 0.010)])
def test_real_flights(tmp_path, name, limit_deg):
    """The beams come out as the HDL-32E's table; two passes; the points come back."""
    mounting = tmp_path / "mounting.toml"
    mounting.write_text(REAL_MOUNTING)
    path = ARMO / f"{name}.adc.laz"
    flight = read_flight([path], None, mounting)
    survey = flight.survey
    assert survey.scanner.name == "HDL-32E"
    found = np.degrees(survey.scanner.beam_elevations)
    np.testing.assert_allclose(found, BEAMS_DEG["HDL-32E"], atol=limit_deg)
    assert any("from east" in note for note in flight.notes)
    assert any("whole seconds" in note for note in flight.notes)
    assert len(survey.strips) == 2
    turned = [np.median(strip.pose[:, 5]) for strip in survey.strips]
    assert np.cos(turned[0] - turned[1]) < -0.98
    for strip in survey.strips:
        assert (np.diff(strip.time) >= 0).all()
        assert len(np.unique(strip.time)) > 100
        assert 15 < strip.rho.min() < strip.rho.max() < 45
    points = np.concatenate(
        [georeference(survey.rays(strip), survey.mounting) for strip in survey.strips]
    )
    las = laspy.read(path)
    box = np.ptp(np.column_stack([las.x, las.y, las.z]), axis=0)
    np.testing.assert_allclose(np.ptp(points, axis=0)[2], box[2], atol=0.02)
