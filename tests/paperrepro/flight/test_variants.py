"""Files as other operators and programs write them give the same rays."""

import laspy
import numpy as np
import pyproj
import pytest

from data_synth.navigation import WHITE_SIGMA
from data_synth.operator import GPS_WEEK, WEEK, Site
from paperrepro.errors import BadInput
from paperrepro.flight.geodesy import Grid
from tests.paperrepro.flight.test_round_trip import differences, frame_of

#: The VLP-16's own numbering, by the order of fire, of rings by ascending elevation.
LASER_ID = np.arange(16).reshape(2, 8).T.ravel().argsort()


def read(folder, **options):
    return folder.read(frame=frame_of(folder.site), **options)


def require_same(survey, flight, rho=2e-4, azimuth=1e-4, time=4e-8):
    worst = differences(survey, flight.survey)
    assert worst["time"] < time
    assert worst["rho"] < rho
    assert worst["azimuth"] < azimuth
    assert worst["attitude"] < 1e-6


def to_zone(las, epsg):
    """The same points in another reference system of the same datum, to the same resolution."""
    old = Grid(las.header.parse_crs())
    xyz = Grid(epsg).from_geodetic(*old.to_geodetic(np.column_stack([las.x, las.y, las.z])))
    header = laspy.LasHeader(point_format=las.header.point_format, version=las.header.version)
    header.offsets, header.scales = np.floor(xyz.min(axis=0)), las.header.scales
    header.global_encoding = las.header.global_encoding
    header.add_crs(pyproj.CRS.from_user_input(epsg))
    new = laspy.LasData(header)
    for name in las.point_format.dimension_names:
        if name not in "XYZ":
            new[name] = las[name]
    new.x, new.y, new.z = xyz.T
    return new


@pytest.mark.parametrize("scale", [1e-3, 1e-2])
def test_coarse_coordinates(thinned, folder, scale):
    flight = read(folder(scale=scale))
    assert not flight.notes
    require_same(thinned[0], flight, rho=scale, azimuth=scale / 10)


def test_old_point_format_with_geotiff_keys(thinned, folder):
    """LAS 1.2, point format 1, the reference system as a GeoTIFF code."""

    def older(las):
        new = laspy.convert(las, point_format_id=1, file_version="1.2")
        new.header.add_crs(pyproj.CRS.from_epsg(folder_.site.epsg), keep_compatibility=True)
        return new

    folder_ = folder()
    folder_.change_strips(older)
    require_same(thinned[0], read(folder_))


def test_sirgas_2000_of_brazil(thinned, folder):
    """EPSG:31982: another ellipsoid, by 0.1 mm. The trajectory is taken in the strips' datum."""
    written = folder()
    written.change_strips(lambda las: to_zone(las, 31982))
    require_same(thinned[0], read(written), rho=5e-4)


def test_map_in_survey_feet(thinned, folder):
    """The reference system says feet, so they are taken as such, heights too."""
    written = folder(Site(43.0, -78.5, 100.0))
    written.change_strips(lambda las: to_zone(las, 2262))
    require_same(thinned[0], read(written), rho=5e-4)


def test_crs_given_by_hand(thinned, folder):
    def nameless(las):
        las.header.vlrs = laspy.vlrs.vlrlist.VLRList()

    written = folder()
    written.change_strips(nameless)
    require_same(thinned[0], read(written, crs="EPSG:32722"))


@pytest.mark.parametrize(
    "shift",
    [0.0, (GPS_WEEK - 1) * WEEK - 1e9, GPS_WEEK * WEEK],
    ids=["week seconds", "the week before", "standard time"],
)
def test_whole_weeks_are_reconciled(thinned, folder, shift):
    survey, _ = thinned
    written = folder()
    written.in_week_seconds(survey)
    written.change_strips(lambda las: setattr(las, "gps_time", np.asarray(las.gps_time) + shift))
    flight = read(written)
    assert not flight.notes
    require_same(survey, flight, time=3e-7)


def test_trajectory_in_adjusted_time(thinned, folder):
    written = folder()

    def adjusted(table):
        table[:, 0] += GPS_WEEK * WEEK - 1e9

    written.change_sbet(adjusted)
    require_same(thinned[0], read(written), time=1e-7)


def test_flight_across_the_end_of_a_week(thinned, folder):
    """The SBET's seconds fall back to zero within the flight; the strips' adjusted time runs on."""
    survey, _ = thinned
    written = folder()
    begin = WEEK - 1200.0  # of the recorded second 0; the lines lie at 1000-1450

    def rolled(table):
        table[:, 0] = (table[:, 0] + begin) % WEEK

    written.change_sbet(rolled)
    written.change_strips(lambda las: setattr(las, "gps_time", np.asarray(las.gps_time) + begin))
    flight = read(written)
    for true, strip in zip(survey.strips, flight.survey.strips, strict=True):
        np.testing.assert_allclose(strip.time - begin, true.time, atol=1e-7)
        np.testing.assert_allclose(strip.rho, true.rho, atol=2e-4)


@pytest.mark.parametrize("leap", [18.0, -18.0])
def test_leap_seconds_are_put_right_with_a_word(thinned, folder, leap):
    written = folder()
    written.change_strips(lambda las: setattr(las, "gps_time", np.asarray(las.gps_time) + leap))
    flight = read(written)
    assert any(f"{-leap:+.0f} s are added" in note and "UTC" in note for note in flight.notes)
    require_same(thinned[0], flight)


@pytest.mark.parametrize("undulation", [-3.27, 48.6])
def test_heights_above_the_geoid_are_put_right_with_a_word(thinned, folder, undulation):
    def orthometric(las):
        las.z = np.asarray(las.z) - undulation

    written = folder(scale=1e-3)
    written.change_strips(orthometric)
    flight = read(written)
    assert flight.decoder.shift[2] == pytest.approx(undulation, abs=0.01)
    assert any("geoid" in note for note in flight.notes)
    require_same(thinned[0], flight, rho=0.012, azimuth=1e-3)


def test_geoid_and_leap_seconds_together(thinned, folder):
    def both(las):
        las.z = np.asarray(las.z) + 5.0
        las.gps_time = np.asarray(las.gps_time) - 18.0

    written = folder()
    written.change_strips(both)
    flight = read(written)
    assert len(flight.notes) == 2
    require_same(thinned[0], flight, rho=0.012, azimuth=1e-3)


def test_heading_against_grid_north_is_put_right_with_a_word(thinned, folder):
    written = folder()

    def to_grid(table):
        grid = Grid(written.site.epsg)
        table[:, 9] -= grid.convergence(table[:, 1], table[:, 2])

    written.change_sbet(to_grid)
    flight = read(written)
    assert any("grid north" in note for note in flight.notes)
    require_same(thinned[0], flight)


def test_heading_against_grid_north_close_to_the_central_meridian(thinned, folder):
    """A convergence of 0.03 deg would pass as a fit, and for boresight: it must not."""
    written = folder(Site(longitude_deg=-51.07))

    def to_grid(table):
        grid = Grid(written.site.epsg)
        table[:, 9] -= grid.convergence(table[:, 1], table[:, 2])

    written.change_sbet(to_grid)
    flight = read(written)
    assert any("grid north" in note for note in flight.notes)
    require_same(thinned[0], flight)


def test_heading_in_the_wander_frame_is_put_right_with_a_word(thinned, folder):
    def wandering(table):
        table[:, 10] = 0.7
        table[:, 9] += 0.7

    written = folder()
    written.change_sbet(wandering)
    flight = read(written)
    assert any("wander" in note for note in flight.notes)
    require_same(thinned[0], flight)


def test_wander_angle_alone_changes_nothing(thinned, folder):
    written = folder()
    written.change_sbet(lambda table: table[:, 10].fill(0.7))
    flight = read(written)
    assert not flight.notes
    require_same(thinned[0], flight)


@pytest.mark.parametrize(
    "number",
    [LASER_ID, np.arange(16)[::-1], np.arange(16) + 1],
    ids=["laser id", "from above", "from one"],
)
def test_rings_in_any_order_are_told_by_their_rays(thinned, folder, number):
    written = folder()
    written.change_strips(lambda las: setattr(las, "user_data", number[np.asarray(las.user_data)]))
    flight = read(written)
    assert any("told by their rays" in note for note in flight.notes)
    require_same(thinned[0], flight)


def test_beams_given_in_any_order(thinned, folder):
    written = folder()
    text = written.mounting.read_text()
    line = next(line for line in text.splitlines() if line.startswith("beam_elevations_deg"))
    beams = line.split("[")[1].rstrip("]").split(", ")
    written.mounting.write_text(
        text.replace(line, f"beam_elevations_deg = [{', '.join(beams[::-1])}]")
    )
    require_same(thinned[0], read(written))


def test_mounting_of_the_nominal_table_alone(thinned, folder):
    written = folder()
    text = written.mounting.read_text()
    written.mounting.write_text(text[: text.index("[scanner]")])
    flight = read(written)
    assert flight.survey.scanner.n_rings == 16
    assert [note for note in flight.notes if "APX-15" in note]
    require_same(thinned[0], flight)


def test_noise_withheld_and_repeated_echoes_are_left_out(thinned, folder):
    """Every third point noise, every fifth withheld; each echo of the rest twice."""
    survey, _ = thinned

    def spoilt(las):
        las.classification[::3] = 7
        las.withheld[::5] = 1
        twice = laspy.LasData(las.header)
        twice.points = las.points[np.repeat(np.arange(len(las)), 2)]
        twice.return_number[1::2], twice.number_of_returns[:] = 2, 2
        return twice

    written = folder()
    written.change_strips(spoilt)
    flight = read(written)
    for true, strip in zip(survey.strips, flight.survey.strips, strict=True):
        number = np.arange(len(true))
        kept = (number % 3 != 0) & (number % 5 != 0)
        np.testing.assert_array_equal(strip.ring, true.ring[kept])
        np.testing.assert_allclose(strip.rho, true.rho[kept], atol=2e-4)


def test_second_returns_are_points_too(thinned, folder):
    def second(las):
        las.return_number[::2], las.number_of_returns[:] = 2, 2

    written = folder()
    written.change_strips(second)
    require_same(thinned[0], read(written))


def test_points_out_of_order_are_sorted(thinned, folder):
    survey, _ = thinned

    def shuffled(las):
        las.points = las.points[np.random.default_rng(0).permutation(len(las))]

    written = folder()
    written.change_strips(shuffled)
    flight = read(written)
    for true, strip in zip(survey.strips, flight.survey.strips, strict=True):
        np.testing.assert_allclose(strip.time, true.time, atol=4e-8)
        np.testing.assert_allclose(strip.rho, true.rho, atol=2e-4)


def test_several_passes_in_one_file_are_strips_of_their_own(thinned, folder):
    survey, _ = thinned
    written = folder()
    parts = [laspy.read(path) for path in written.strips]
    joined = laspy.LasData(parts[0].header)
    records = np.concatenate([part.points.array for part in parts])
    joined.points = laspy.ScaleAwarePointRecord(
        records, parts[0].point_format, parts[0].header.scales, parts[0].header.offsets
    )
    path = written.path / "all.laz"
    joined.write(path)
    flight = read(written, strips=[path])
    assert [strip.name for strip in flight.survey.strips] == ["all.1", "all.2", "all.3"]
    assert any("3 passes" in note for note in flight.notes)
    for true, strip in zip(survey.strips, flight.survey.strips, strict=True):
        np.testing.assert_allclose(strip.rho, true.rho, atol=2e-4)


def test_hundred_hertz_trajectory(thinned, folder):
    """Coordinates were made at 200 Hz. A record left out differs from what its neighbours tell by
    1.3 sigma of the white noise, and the worst of 30 000 points by five times that."""
    survey, _ = thinned
    written = folder()
    written.change_sbet(lambda table: table[::2])
    flight = read(written)
    assert not flight.notes
    worst = differences(survey, flight.survey)
    white, nearest = WHITE_SIGMA, min(strip.rho.min() for strip in survey.strips)
    assert worst["position"] < 6.5 * white[0]
    assert worst["attitude"] < 6.5 * white[5]
    assert worst["azimuth"] < 6.5 * (white[0] / nearest + white[3])


def test_rotation_with_few_digits_is_made_exact(thinned, folder):
    written = folder()
    written.change_mounting("[0.0, -1.0, 0.0]", "[0.0, -1.0, 0.0004]")
    flight = read(written)
    assert any("orthonormality" in note for note in flight.notes)
    R = flight.survey.mounting.R_nominal
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)


def test_accuracy_file_sets_the_sigmas(thinned, folder):
    written = folder()
    accuracy = np.zeros((100, 10))
    flown = np.fromfile(written.sbet, "<f8")[::17]
    accuracy[:, 0] = np.linspace(flown[0], flown[-1], 100)
    accuracy[:, 1:4], accuracy[:, 7:] = [0.01, 0.02, 0.03], [1.5, 1.6, 4.8]
    accuracy[:, 9] *= np.tile([0.6, np.sqrt(2 - 0.36)], 50)
    path = written.path / "smrmsg.out"
    accuracy.astype("<f8").tofile(path)
    navigation = read(written, accuracy=path).survey.navigation
    np.testing.assert_allclose(navigation.profile[1][:3, 5], [0.6, np.sqrt(2 - 0.36), 0.6])
    np.testing.assert_allclose(navigation.position_sigma, [0.02, 0.01, 0.03])
    np.testing.assert_allclose(np.degrees(navigation.attitude_sigma) * 60, [1.5, 1.6, 4.8])
    assert navigation.correlation_time == thinned[0].navigation.correlation_time


def test_an_accuracy_file_of_another_flight_is_refused(folder):
    written = folder()
    accuracy = np.ones((100, 10))
    accuracy[:, 0] = np.fromfile(written.sbet, "<f8")[-17] + np.arange(1, 101)
    path = written.path / "smrmsg.out"
    accuracy.astype("<f8").tofile(path)
    with pytest.raises(BadInput, match=r"smrmsg.out: its times, .* none of the trajectory's"):
        read(written, accuracy=path)
