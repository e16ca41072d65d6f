"""Simulated rays written as an operator's files and read again are the same rays."""

import numpy as np
import pytest

from data_synth.operator import Site, sbet_records
from paperrepro.flight.geodesy import Grid, LocalFrame
from paperrepro.flight.sbet import read_sbet

#: 150 km from the central meridian of zone 22 at the paper's latitude: 1.5 degrees.
SITES = {
    "paper": Site(),
    "150 km off": Site(longitude_deg=-49.5),
    "on the central meridian": Site(longitude_deg=-51.0),
    "west edge of a zone": Site(longitude_deg=-53.99999),
    "east edge of a zone": Site(longitude_deg=-48.00001),
    "in the neighbour's zone": Site(longitude_deg=-47.9, zone=22),
    "north": Site(60.2, 24.9, 30.0),
    "across the equator": Site(0.0, -51.0, 20.0),
    "across the date line": Site(-17.0, 180.0, 5.0),
}


def frame_of(site):
    return LocalFrame(np.radians(site.latitude_deg), np.radians(site.longitude_deg), site.height)


def differences(survey, read):
    """Largest absolute difference of each quantity, over all rays of all strips."""
    worst = {}
    for true, strip in zip(survey.strips, read.strips, strict=True):
        assert true.name == strip.name
        np.testing.assert_array_equal(true.ring, strip.ring)
        expected, found = survey.rays(true), read.rays(strip)
        turn = (found.pose - expected.pose)[:, 3:]
        parts = {
            "time": found.time - expected.time,
            "azimuth": found.azimuth - expected.azimuth,
            "rho": found.rho - expected.rho,
            "elevation": found.elevation - expected.elevation,
            "position": (found.pose - expected.pose)[:, :3],
            "attitude": np.arctan2(np.sin(turn), np.cos(turn)),
        }
        for name, part in parts.items():
            worst[name] = max(worst.get(name, 0.0), float(np.abs(part).max()))
    return worst


@pytest.mark.parametrize("site", SITES.values(), ids=SITES.keys())
def test_rays_come_back(thinned, folder, site):
    """At 0.1 um of resolution the azimuth is met to that over the shortest range."""
    survey, _ = thinned
    written = folder(site, scale=1e-7)
    written.in_week_seconds(survey)
    read = written.read(frame=frame_of(site)).survey
    worst = differences(survey, read)
    nearest = min(strip.rho.min() for strip in survey.strips)
    assert worst["time"] < 1e-9
    assert worst["attitude"] < 1e-9
    assert worst["position"] < 1e-7
    assert worst["elevation"] < 1e-12
    assert worst["azimuth"] < 1.5e-7 / nearest
    assert worst["rho"] < 1e-5  # float32


def test_resolution_of_a_tenth_of_a_millimetre(thinned, folder):
    """What the default resolution and adjusted standard time (60 ns near 2e8 s) cost."""
    survey, _ = thinned
    site = Site()
    worst = differences(survey, folder().read(frame=frame_of(site)).survey)
    assert 1e-9 < worst["time"] < 4e-8
    assert 1e-5 < worst["rho"] < 1e-4
    nearest = min(strip.rho.min() for strip in survey.strips)
    assert worst["azimuth"] < 1e-4 / nearest
    assert worst["attitude"] < 2e-8


def test_the_frame_is_at_the_strips(thinned, folder):
    """Another origin turns and shifts the poses, and leaves the rays as they are."""
    survey, _ = thinned
    flight = folder().read()
    worst = differences(survey, flight.survey)
    assert worst["azimuth"] < 1e-4
    assert worst["rho"] < 1e-4
    assert 1e-9 < worst["attitude"] < 1e-4
    assert not flight.notes
    truth = frame_of(Site())
    place = (flight.frame.latitude, flight.frame.longitude, flight.frame.height)
    origin = truth.from_geodetic(*(np.array([value]) for value in place))
    np.testing.assert_allclose(origin[0], 0.0, atol=100.0)


def test_attitude_far_from_the_origin_is_turned_with_the_meridian():
    """At 60 degrees north and 1 km east true north has turned by 0.27 mrad, to the west."""
    site = SITES["north"]
    frame = frame_of(site)
    latitude, longitude, _ = frame.to_geodetic(np.array([[1000.0, 0.0, 0.0]]))
    turned = frame.attitude_from_level(latitude, longitude, np.zeros((1, 3)))
    expected = -(longitude[0] - frame.longitude) * np.sin(latitude[0])
    assert turned[0, 2] == pytest.approx(expected, rel=1e-6)
    assert expected == pytest.approx(-1000 / 6.39e6 * np.tan(np.radians(60.2)), rel=2e-3)
    assert turned[0, 0] == pytest.approx(1000 / 6.39e6, rel=2e-3)  # east side down: right wing


def test_sbet_written_by_the_simulator_is_read(thinned, folder):
    survey, _ = thinned
    written = folder()
    poses = read_sbet(written.sbet)
    table = sbet_records(survey, written.site)
    np.testing.assert_array_equal(poses.time, survey.trajectory.time)
    np.testing.assert_array_equal(poses.attitude, table[:, 7:10])
    assert np.degrees(poses.latitude).mean() == pytest.approx(-25.754, abs=1e-3)


@pytest.mark.parametrize("site", SITES.values(), ids=SITES.keys())
def test_convergence_is_that_of_proj(site):
    import pyproj

    grid = Grid(site.epsg)
    here = np.radians([site.latitude_deg]), np.radians([site.longitude_deg])
    factors = pyproj.Proj(site.epsg).get_factors(site.longitude_deg, site.latitude_deg)
    found = np.degrees(grid.convergence(*here)[0])
    assert found == pytest.approx(factors.meridian_convergence, abs=1e-7)
