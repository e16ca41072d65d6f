"""Points that are no rays, pulses that stand in several files, times and coordinates too coarse."""

import shutil

import laspy
import numpy as np
import pyproj
import pytest

from data_synth.operator import GPS_WEEK, WEEK
from paperrepro.cli import main
from paperrepro.errors import BadInput
from paperrepro.flight import flight_lines
from paperrepro.survey import Strip
from tests.paperrepro.flight.test_round_trip import frame_of

START = GPS_WEEK * WEEK - 1e9


def at_sensor(folder, las, index):
    """Put points at the places of the sensor at their times."""
    sbet = np.fromfile(folder.sbet, "<f8").reshape(-1, 17)
    time = np.asarray(las.gps_time)[index] - START
    latitude, longitude, height = (np.interp(time, sbet[:, 0], sbet[:, k]) for k in (1, 2, 3))
    there = pyproj.Transformer.from_crs(4979, las.header.parse_crs(), always_xy=True)
    x, y = there.transform(np.degrees(longitude), np.degrees(latitude))
    for axis, values in zip("xyz", (x, y, height), strict=True):
        column = np.array(las[axis])
        column[index] = values
        setattr(las, axis, column)


@pytest.mark.parametrize("share", [0.2, 0.55])
def test_pulses_without_a_return(thinned, folder, tmp_path, share):
    survey, _ = thinned
    given, lost = folder(), {}

    def spoilt(las):
        index = np.flatnonzero(np.random.default_rng(1).random(len(las)) < share)
        at_sensor(given, las, index)
        lost[len(lost)] = index

    given.change_strips(spoilt)
    flight = given.read(frame=frame_of(given.site))
    for k, (true, strip) in enumerate(zip(survey.strips, flight.survey.strips, strict=True)):
        kept = np.setdiff1d(np.arange(len(true)), lost[k])
        np.testing.assert_allclose(strip.rho, true.rho[kept], atol=2e-4)
        words = f"{len(lost[k])} of {len(true)} points"
        assert any(words in note and "without a return" in note for note in flight.notes)
    assert main(given.arguments(tmp_path / "out")) == 0
    old, new = laspy.read(given.strips[0]), laspy.read(tmp_path / "out" / "F1.laz")
    np.testing.assert_array_equal(np.asarray(new.X)[lost[0]], np.asarray(old.X)[lost[0]])
    assert (np.asarray(new.X) != np.asarray(old.X)).mean() > 0.9 * (1 - share)


@pytest.mark.parametrize("stray", [0.0, -1.0, np.nan, 1e12])
def test_a_few_points_without_a_time(thinned, folder, stray, tmp_path):
    survey, _ = thinned
    given = folder()
    few = slice(1000, 1005)
    given.change_strips(lambda las: las.gps_time.__setitem__(few, stray), ["F1"])
    flight = given.read(frame=frame_of(given.site))
    true = survey.strip("F1")
    kept = np.setdiff1d(np.arange(len(true)), np.arange(1000, 1005))
    np.testing.assert_allclose(flight.survey.strip("F1").rho, true.rho[kept], atol=2e-4)
    assert any("5 of" in note and "outside of the flight" in note for note in flight.notes)
    assert main(given.arguments(tmp_path / "out")) == 0
    old, new = laspy.read(given.strips[0]), laspy.read(tmp_path / "out" / "F1.laz")
    np.testing.assert_array_equal(new.X[few], old.X[few])


def test_the_end_of_the_week_within_a_strip(thinned, folder):
    """Seconds of the week that fall to zero, in strips and trajectory."""
    survey, _ = thinned
    given = folder()
    shift = WEEK - float(np.median(survey.strip("F1").time))
    given.change_sbet(lambda t: t.__setitem__((slice(None), 0), (t[:, 0] + shift) % WEEK))
    given.change_strips(
        lambda las: setattr(las, "gps_time", (np.asarray(las.gps_time) - START + shift) % WEEK)
    )
    flight = given.read(frame=frame_of(given.site))
    for true, strip in zip(survey.strips, flight.survey.strips, strict=True):
        np.testing.assert_allclose(strip.time - shift, true.time, atol=1e-6)
        np.testing.assert_allclose(strip.rho, true.rho, atol=2e-4)


def test_times_of_single_precision(thinned, folder):
    """Of the week: steps of 31 ms, tolerated and named. Since 1980: of 16 s, refused."""
    given = folder()
    given.change_sbet(lambda table: table.__setitem__((slice(None), 0), table[:, 0] + 400_000))
    given.change_strips(
        lambda las: setattr(
            las, "gps_time",
            (np.asarray(las.gps_time) - START + 400_000).astype(np.float32).astype(float),
        )
    )  # fmt: skip
    flight = given.read()
    assert any("32 distinct times a second" in note for note in flight.notes)
    given.change_strips(
        lambda las: setattr(
            las, "gps_time", (np.asarray(las.gps_time) + START).astype(np.float32).astype(float)
        )
    )
    with pytest.raises(BadInput, match=r"F\d.laz: its times come in steps of 16 s"):
        given.read()


@pytest.mark.parametrize(("step", "word"), [(0.01, "0.01 s"), (0.001, "0.001 s")])
def test_rounded_times_are_named(folder, step, word):
    given = folder()
    given.change_strips(
        lambda las: setattr(las, "gps_time", np.round(np.asarray(las.gps_time) / step) * step)
    )
    assert any(f"steps of {word}" in note for note in given.read().notes)


def test_coarse_coordinates_are_named(folder):
    """The header's scale is fine, the numbers are not."""

    def coarse(las):
        for axis in "xyz":
            setattr(las, axis, np.round(np.asarray(las[axis]) / 0.05) * 0.05)

    given = folder()
    given.change_strips(coarse)
    notes = given.read().notes
    assert sum("its coordinates come in steps of 0.05 m" in note for note in notes) == 3


# --- the same pulses twice -----------------------------------------------------------------------


def require_once(thinned, flight, names=("F1", "F2", "F7")):
    for true, strip in zip((thinned[0].strip(n) for n in names), flight.survey.strips, strict=True):
        assert len(strip) == len(true)
        np.testing.assert_allclose(strip.rho, true.rho, atol=2e-4)
    assert any("taken once" in note for note in flight.notes)


def read(folder, strips):
    return folder.read(strips=strips, frame=frame_of(folder.site))


def test_copies_count_once(thinned, folder):
    given = folder()
    for path in given.strips:
        shutil.copy(path, given.path / f"{path.stem} (copy).laz")
    names = ("F1", "F1 (copy)", "F2", "F2 (copy)", "F7", "F7 (copy)")
    flight = read(given, [given.path / f"{name}.laz" for name in names])
    require_once(thinned, flight)
    assert [strip.name for strip in flight.survey.strips] == ["F1", "F2", "F7"]


def test_strips_beside_the_merged_file_count_once(thinned, folder):
    given = folder()
    parts = [laspy.read(path) for path in given.strips]
    merged = laspy.LasData(parts[0].header)
    merged.points = laspy.ScaleAwarePointRecord(
        np.concatenate([part.points.array for part in parts]), parts[0].point_format,
        parts[0].header.scales, parts[0].header.offsets,
    )  # fmt: skip
    merged.write(given.path / "all.laz")
    require_once(thinned, read(given, [*given.strips[:3], given.path / "all.laz"]))


def test_tiles_with_a_common_edge_are_one_line(thinned, folder):
    given = folder()
    las = laspy.read(given.strips[0])
    x = np.asarray(las.x)
    middle = np.median(x)
    for name, kept in (("west", x < middle + 5), ("east", x > middle - 5)):
        tile = laspy.LasData(las.header)
        tile.points = las.points[kept]
        tile.write(given.path / f"{name}.laz")
    flight = read(given, [given.path / f"{name}.laz" for name in ("west", "east", "F2", "F7")])
    require_once(thinned, flight)
    assert [strip.name for strip in flight.survey.strips] == ["west", "F2", "F7"]


def test_echoes_as_a_second_block_count_once(thinned, folder):
    given = folder()

    def doubled(las):
        las.points = las.points[np.tile(np.arange(len(las)), 2)]

    given.change_strips(doubled)
    require_once(thinned, read(given, given.strips))


def test_names_are_unique_after_the_lines_are_told_apart(thinned, folder):
    given = folder()
    parts = [laspy.read(given.path / name) for name in ("F1.laz", "F2.laz")]
    both = laspy.LasData(parts[0].header)
    both.points = laspy.ScaleAwarePointRecord(
        np.concatenate([part.points.array for part in parts]), parts[0].point_format,
        parts[0].header.scales, parts[0].header.offsets,
    )  # fmt: skip
    both.write(given.path / "A.laz")
    shutil.copy(given.path / "F7.laz", given.path / "A.1.laz")
    flight = read(given, [given.path / "A.laz", given.path / "A.1.laz"])
    assert [strip.name for strip in flight.survey.strips] == ["A.1", "A.2", "A.1 (2)"]
    for name, strip in zip(("F1", "F2", "F7"), flight.survey.strips, strict=True):
        np.testing.assert_allclose(strip.rho, thinned[0].strip(name).rho, atol=2e-4)


def test_second_echoes_of_one_pulse_stay():
    time = np.array([0.0, 1.0, 1.0, 2.0])
    strip = Strip("F", time, np.zeros(4, np.uint8), np.zeros(4), np.array([30.0, 30.0, 31.0, 30.0]))
    (found,), notes = flight_lines.joined([strip])
    assert len(found) == 4
    assert not notes
