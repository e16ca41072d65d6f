"""Scanners without rings: rays are taken from points and poses, and little else is known."""

import re

import numpy as np
import pytest

from data_synth import make_config, simulate
from paperrepro._cache import cached
from paperrepro.errors import BadInput
from paperrepro.method.adjustment.calibrate import calibrate
from paperrepro.method.adjustment.trajectory_errors import find_noise
from paperrepro.method.coarse_to_fine import find_roofs


def without_rings(written, kind):
    """The folder's files as of a scanner of this ``kind``."""

    def drop(las):
        las.user_data[:] = 0

    written.change_strips(drop)
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


def test_without_a_kind_the_rings_are_missed(folder):
    with pytest.raises(BadInput, match=r'--ring-dimension, or .* kind = "line" or "any"'):
        without_rings(folder(), "").read()


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
