"""Strips under another mounting: where the points go, and what stays."""

import laspy
import numpy as np
import pytest

from paperrepro.cli import main
from paperrepro.flight.calibration_file import read_calibration
from paperrepro.flight.write import write_strips
from paperrepro.method.georeference import georeference_strip
from tests.paperrepro.flight.test_round_trip import frame_of


def dressed(las):
    """Every other dimension filled, two of them extra."""
    rng = np.random.default_rng(3)
    las.add_extra_dim(laspy.ExtraBytesParams("pulse_width", np.float32))
    las.add_extra_dim(laspy.ExtraBytesParams("target", np.uint16))
    las.pulse_width, las.target = rng.random(len(las)), rng.integers(0, 9999, len(las))
    las.intensity, las.classification = rng.integers(0, 65535, (2, len(las))) // [[1], [3000]]
    las.scan_angle, las.point_source_id = rng.integers(-900, 900, len(las)), np.full(len(las), 77)
    las.withheld[::50] = 1


def others(las):
    return [name for name in las.point_format.dimension_names if name not in "XYZ"]


def test_the_nominal_mounting_gives_the_file_back(folder, tmp_path):
    given = folder()
    given.change_strips(dressed)
    flight = given.read()
    written = write_strips(flight, flight.survey.mounting, tmp_path / "same")
    for old, new in zip(map(laspy.read, given.strips), map(laspy.read, written), strict=True):
        for name in old.point_format.dimension_names:
            np.testing.assert_array_equal(old[name], new[name])
        assert old.header.parse_crs() == new.header.parse_crs()
        assert list(old.header.scales) == list(new.header.scales)
        assert old.header.global_encoding.value == new.header.global_encoding.value
        assert old.header.point_format == new.header.point_format


def test_points_of_the_true_mounting(thinned, folder, tmp_path):
    """By way of the command; where the method's own equation puts them, to the resolution."""
    survey, truth = thinned
    given = folder()
    given.change_strips(dressed)
    assert main(given.arguments(tmp_path / "out")) == 0
    frame, flight = frame_of(given.site), given.read()
    for path, strip in zip(given.strips, survey.strips, strict=True):
        old, new = laspy.read(path), laspy.read(tmp_path / "out" / path.name)
        for name in others(old):
            np.testing.assert_array_equal(old[name], new[name])
        grid = flight.files[0].grid
        found = frame.from_geodetic(*grid.to_geodetic(np.column_stack([new.x, new.y, new.z])))
        expected = georeference_strip(survey, strip, truth.mounting)
        assert np.abs(found - expected).max() < 2e-4
        moved = np.linalg.norm(expected - georeference_strip(survey, strip), axis=1)
        assert np.median(moved) > 0.3


def test_a_height_shift_is_taken_off_again(folder, tmp_path):
    """Heights above the geoid stay heights above the geoid."""
    given = folder()
    given.change_strips(lambda las: setattr(las, "z", np.asarray(las.z) - 7.0))
    flight = given.read()
    written = write_strips(flight, flight.survey.mounting, tmp_path / "same")
    np.testing.assert_array_equal(laspy.read(written[0]).Z, laspy.read(given.strips[0]).Z)


def test_a_failure_half_way_leaves_nothing(folder, tmp_path):
    given = folder()
    flight = given.read()
    path = given.strips[-1]
    path.write_bytes(path.read_bytes()[:-5000])
    with pytest.raises(ValueError, match="cut off"):
        write_strips(flight, flight.survey.mounting, tmp_path / "a" / "b")
    assert not (tmp_path / "a").exists()


def test_calibration_file(thinned, folder):
    survey, truth = thinned
    given = folder()
    path = given.path / "truth.json"
    mounting = read_calibration(path, survey.mounting, survey.scanner).mounting
    np.testing.assert_allclose(mounting.boresight, truth.boresight, rtol=1e-12)
    np.testing.assert_allclose(mounting.range_offsets, truth.range_offsets)
    np.testing.assert_allclose(mounting.lever_arm, truth.lever_arm)
    np.testing.assert_array_equal(mounting.R_nominal, survey.mounting.R_nominal)
