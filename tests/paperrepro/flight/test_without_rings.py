"""Scanners without rings: rays are taken from points and poses, and little else is known."""

import re
from dataclasses import replace

import numpy as np
import pytest

from data_synth import make_config, simulate
from paperrepro._cache import cached
from paperrepro.cli import main
from paperrepro.errors import BadInput
from paperrepro.flight import scanners
from paperrepro.flight.mounting import read_mounting
from paperrepro.method.adjustment.calibrate import calibrate
from paperrepro.method.adjustment.trajectory_errors import find_noise
from paperrepro.method.coarse_to_fine import find_roofs
from paperrepro.method.georeference import georeference
from tests.paperrepro.flight.test_posed import record


def drop_rings(las):
    las.user_data[:] = 0


def without_rings(written, kind, change=lambda las: las):
    """The folder's files, after a ``change``, as of a scanner of this ``kind``."""
    written.change_strips(change)
    written.change_strips(drop_rings)
    beams = re.search(r"beam_elevations_deg = .*", written.mounting.read_text())[0]
    written.change_mounting(beams, f'kind = "{kind}"' if kind else "")
    return written


def test_rays_are_those_of_the_points(folder, thinned):
    flight = without_rings(folder(), "any").read()
    beams = thinned[0].scanner.beam_elevations
    assert flight.survey.scanner.n_rings == 1
    for strip, given in zip(flight.survey.strips, thinned[0].strips, strict=True):
        rays = flight.survey.rays(strip)
        assert not rays.ring.any()
        np.testing.assert_allclose(rays.elevation, beams[given.ring], atol=2e-5)
        np.testing.assert_allclose(rays.rho, given.rho, atol=1e-3)
    assert any("do not tell whether signs" in note for note in flight.notes)


def test_a_fan_of_beams_is_no_line(folder):
    with pytest.raises(BadInput, match="do not fit"):
        without_rings(folder(), "line").read()


def test_a_scanner_with_rings_misses_them(folder):
    """The mounting names one."""
    with pytest.raises(BadInput, match=r"--ring-dimension, or .* --scanner line or any"):
        without_rings(folder(), "").read()


def unnamed(written):
    """The folder, whose mounting says nothing of the scanner."""
    text = written.mounting.read_text()
    written.mounting.write_text(re.sub(r"\[scanner\]\n(.+\n)*", "", text))
    return written


def test_files_without_rings_are_taken_as_they_are(folder, thinned):
    """A fan of beams is no line."""
    flight = unnamed(without_rings(folder(), "any")).read()
    assert any("names no scanner; the rays go anywhere" in note for note in flight.notes)
    assert flight.survey.scanner.n_rings == 1
    given = thinned[0].strips[0]
    beams = thinned[0].scanner.beam_elevations
    elevation = flight.survey.rays(flight.survey.strips[0]).elevation
    np.testing.assert_allclose(elevation, beams[given.ring], atol=2e-5)


def one_beam(las):
    return las[las.user_data == 7]


def test_one_beam_without_rings_is_a_line(folder):
    """And its mistakes are put right and named, as of a line scanner."""
    written = unnamed(without_rings(folder(), "any", one_beam))

    def late(table):
        table[:, 0] += 18.0

    written.change_sbet(late)
    flight = written.read()
    assert any("as of a line scanner" in note for note in flight.notes)
    assert any("leap seconds" in note for note in flight.notes)


@pytest.mark.parametrize(
    "rows", ["[1, 0, 0], [0, 0, -1], [0, 1, 0]", "[0, 1, 0], [-1, 0, 0], [0, 0, 1]"]
)
def test_the_mirror_may_turn_about_any_axis_of_the_laser(folder, rows):
    """Of x or y as of z."""
    written = without_rings(folder(), "line", one_beam)
    before = written.read()
    rotation = re.search(r"rotation = .*", written.mounting.read_text())[0]
    written.change_mounting(rotation, f"rotation = [{rows}]")
    flight = written.read()
    p_m, expected = (
        georeference(f.survey.rays(f.survey.strips[0]), f.survey.mounting) for f in (flight, before)
    )
    np.testing.assert_allclose(p_m, expected, atol=1e-4)


def test_one_file_alone_misses_its_rings(folder):
    written = unnamed(folder())
    written.change_strips(drop_rings, ["F7"])
    with pytest.raises(BadInput, match=r"F7.laz: expected the ring"):
        written.read()


def test_the_command_overrides_the_mounting(folder, thinned):
    written = folder()
    flight = written.read(scanner="any")
    assert flight.survey.scanner.n_rings == 1
    assert flight.survey.scanner.range_sigma == thinned[0].scanner.range_sigma
    out = written.path / "adjusted"
    assert main([*written.arguments(out), "--scanner", "line"]) == 2


def test_a_table_without_rings(folder, thinned):
    """And with its poses."""
    written = unnamed(folder())
    table = record(thinned, written).drop(columns="vertical angle")
    path = written.path / "F1.csv"
    table.to_csv(path, index=False)
    flight = written.read(strips=[path], trajectory=None, crs="EPSG:32722")
    assert any("the rays go anywhere" in note for note in flight.notes)
    rays, survey = flight.survey.rays(flight.survey.strips[0]), thinned[0]
    np.testing.assert_allclose(rays.elevation, survey.rays(survey.strip("F1")).elevation, atol=1e-4)


def test_times_that_no_ray_judges_are_not_coarse(folder):
    written = without_rings(folder(), "any")

    def rounded(las):
        las.gps_time = np.round(las.gps_time, 2)

    written.change_strips(rounded)
    with pytest.raises(BadInput, match=r"steps of 0.01 s.*export full GPS times"):
        written.read()


def test_gross_mistakes_are_named(folder):
    written = without_rings(folder(), "any")

    def spinning(table):  # degrees of a heading that is given in radians already
        table[:, 9] = np.angle(np.exp(1j * np.degrees(table[:, 9])))
        table[:, 7:9] = np.clip(np.degrees(table[:, 7:9]), -3, 3)

    written.change_sbet(spinning)
    with pytest.raises(BadInput, match="degrees"):
        written.read()


@pytest.mark.parametrize(
    ("line", "words"),
    [('kind = "laser"', "one of rings, line, any"),
     ('kind = "any"\nbeam_elevations_deg = [0, 1]', "leave beam_elevations_deg out")],
)  # fmt: skip
def test_kinds_that_cannot_be(folder, line, words):
    written = folder()
    beams = re.search(r"beam_elevations_deg = .*", written.mounting.read_text())[0]
    written.change_mounting(beams, line)
    with pytest.raises(BadInput, match=words):
        written.read()


@pytest.mark.parametrize("scanner", ["line", "solid-state"])
def test_the_boresight_of_a_scanner_without_rings(scanner):
    survey, truth = cached(simulate, make_config(scanner=scanner, seed=3))
    found = cached(find_roofs, survey)
    noise = find_noise(survey, found.tie_planes, found.agreed)
    result = calibrate(survey, found.tie_planes, "D", found=noise)
    assert len(result.range_offsets) == 1
    assert (np.abs(result.boresight - truth.boresight) < 3 * result.sigma).all()
    assert (np.degrees(result.sigma) < 0.06).all()


def test_the_boresight_does_not_need_rings():
    """A ring without a range offset of its own is worth nothing but its elevation."""
    survey = cached(simulate, make_config())[0]
    elevations = survey.scanner.beam_elevations
    bare = replace(
        survey,
        scanner=replace(survey.scanner, beam_elevations=np.empty(0)),
        strips=tuple(
            replace(s, ring=np.zeros_like(s.ring), elevation=elevations[s.ring].astype(np.float32))
            for s in survey.strips
        ),
    )
    results = [
        calibrate(one, cached(find_roofs, one).tie_planes, "SL without offsets")
        for one in (survey, bare)
    ]
    apart = results[1].boresight - results[0].boresight
    assert (np.abs(apart) < 0.1 * results[0].sigma).all()


# --- names ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "count", "lowest", "highest"),
    [
        ("Velodyne VLP-32C", 32, -25.0, 15.0), ("Hesai Pandar40P", 40, -25.0, 15.0),
        ("Hesai QT64", 64, -52.121, 52.133), ("Hesai XT32", 32, -16.0, 15.0),
        ("Hesai XT32M2X", 32, -20.8, 19.5),
    ],
)  # fmt: skip
def test_scanners_with_rings_by_name(name, count, lowest, highest):
    beams = scanners.beams_named(name)
    assert (len(beams), beams[0], beams[-1]) == (count, lowest, pytest.approx(highest))
    assert (np.diff(beams) > 0.3).all()
    assert scanners.kind_named(name) == "rings"


@pytest.mark.parametrize(
    ("name", "kind", "angle_deg"),
    [("RIEGL VUX-1UAV", "line", 0.01), ("Zenmuse L2", "any", 0.01),
     ("Livox MID-360", "any", 0.15)],
)  # fmt: skip
def test_scanners_without_rings_by_name(folder, name, kind, angle_deg):
    written = unnamed(folder())
    written.mounting.write_text(f'{written.mounting.read_text()}\n[scanner]\nname = "{name}"\n')
    given = read_mounting(written.mounting)
    assert (given.kind, given.kind_given, given.scanner.n_rings) == (kind, True, 1)
    assert np.degrees(given.scanner.angle_sigma) == pytest.approx(angle_deg)


def test_a_unit_may_have_a_table_of_its_own(folder):
    """Hesai's do: what the points show is taken, though the name is known."""
    written = folder()
    beams = re.search(r"beam_elevations_deg = .*", written.mounting.read_text())[0]
    name = re.search(r"name = .*", written.mounting.read_text())[0]
    written.change_mounting(beams, "")
    written.change_mounting(name, 'name = "Pandar40P"')
    flight = written.read()
    found = np.degrees(flight.survey.scanner.beam_elevations)
    np.testing.assert_allclose(found, np.linspace(-10, 10, 16), atol=0.01)
