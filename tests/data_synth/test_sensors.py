"""The scanner fires as its data sheet says."""

import numpy as np
import pytest

from data_synth.sensors import (
    HALF_ROSETTE,
    HALF_SWATH,
    LASER_PERIOD,
    N_RINGS,
    SCANNERS,
    SEQUENCE_PERIOD,
    VLP16_HIRES,
    azimuth_at,
    fire,
)
from paperrepro.flight.scanners import beams_named

FIRING_ORDER = VLP16_HIRES.firing_order
START, DURATION = 1002.0, 3.0


@pytest.fixture(scope="module")
def full():
    return fire(START, DURATION)


@pytest.fixture(scope="module")
def thin():
    return fire(START, DURATION, 16)


def test_beams():
    elevations = np.degrees(VLP16_HIRES.specification.beam_elevations)
    np.testing.assert_allclose(elevations[[0, -1]], (-10.0, 10.0))
    np.testing.assert_allclose(np.diff(elevations), 4.0 / 3.0)


def test_lower_and_upper_half_take_turns():
    assert FIRING_ORDER.tolist() == [0, 8, 1, 9, 2, 10, 3, 11, 4, 12, 5, 13, 6, 14, 7, 15]


@pytest.mark.parametrize("name", [name for name in SCANNERS if SCANNERS[name].n_rings > 1])
def test_scanners_are_those_that_an_operator_names(name):
    beams = np.degrees(SCANNERS[name].specification.beam_elevations)
    np.testing.assert_allclose(beams, beams_named(name), atol=1e-12)


def test_a_scanner_of_32_beams():
    """700000 points a second; lower and upper half take turns, too."""
    model = SCANNERS["HDL-32E"]
    pulses = fire(START, DURATION, model=model)
    whole = len(pulses) / DURATION * np.pi / HALF_SWATH
    assert whole == pytest.approx(700_000, rel=0.02)
    first = np.sort(pulses.time[pulses.ring == 0])[:2]
    assert np.diff(first) == pytest.approx(46.08e-6, abs=1e-11)
    np.testing.assert_array_equal(model.firing_order[:4], (0, 16, 1, 17))


def test_a_line_scanner_sweeps_a_plane_a_hundred_times_a_second():
    pulses = fire(START, DURATION, model=SCANNERS["line"])
    assert not pulses.ring.any()
    assert not pulses.elevation.any()
    assert len(pulses) / DURATION * np.pi / HALF_SWATH == pytest.approx(300_000, rel=1e-3)
    lines = np.count_nonzero(np.diff(pulses.azimuth) < 0) / DURATION
    assert lines == pytest.approx(100.0, abs=1.0)


@pytest.mark.parametrize("thinning", [1, 16])
@pytest.mark.parametrize("name", ["line", "solid-state"])
def test_scanners_without_rings_measure_as_many_points_as_the_first(name, thinning):
    count, first = (
        len(fire(START, DURATION, thinning, SCANNERS[each])) for each in (name, "VLP-16 Hi-Res")
    )
    assert count == pytest.approx(first, rel=0.05)


def test_a_solid_state_scanner_fills_a_cone_about_nadir_and_does_not_soon_repeat():
    pulses = fire(START, DURATION, model=SCANNERS["solid-state"])
    assert len(pulses) / DURATION == pytest.approx(100_000, rel=1e-3)
    off_nadir = np.arccos(np.cos(pulses.azimuth) * np.cos(pulses.elevation))
    assert off_nadir.max() == pytest.approx(HALF_ROSETTE, rel=1e-3)
    cells = np.floor(np.degrees(np.column_stack([pulses.azimuth, pulses.elevation])))
    seen = [len(np.unique(cells[: n * 10_000], axis=0)) for n in (1, 10)]
    assert seen[0] < seen[1]
    assert seen[1] > 0.9 * np.pi * np.degrees(HALF_ROSETTE) ** 2
    turns = [
        np.column_stack([p.azimuth, p.elevation])
        for p in (fire(START + k, 0.01, model=SCANNERS["solid-state"]) for k in (0, 1))
    ]
    assert np.abs(turns[0] - turns[1]).max() > 0.1


def test_times_within_and_between_sequences(full):
    step = np.diff(full.time)
    inside = step[full.ring[1:] != FIRING_ORDER[0]]
    assert inside[inside < 1e-3] == pytest.approx(LASER_PERIOD, abs=1e-11)
    between = step[full.ring[1:] == FIRING_ORDER[0]]
    pause = SEQUENCE_PERIOD - (N_RINGS - 1) * LASER_PERIOD
    assert between[between < 1e-3] == pytest.approx(pause, abs=1e-11)


def test_rate_is_300000_per_second_over_the_circle(full):
    whole = len(full) / DURATION * np.pi / HALF_SWATH
    assert whole == pytest.approx(N_RINGS / SEQUENCE_PERIOD, rel=1e-3)
    assert whole == pytest.approx(300_000, rel=0.05)


def test_azimuth_turns_ten_times_a_second_within_the_swath(full):
    assert np.abs(full.azimuth).max() <= HALF_SWATH
    np.testing.assert_allclose(np.cos(full.azimuth), np.cos(2 * np.pi * 10 * full.time), atol=1e-6)
    assert azimuth_at(np.array([1000.0])) == pytest.approx(0.0, abs=1e-9)
    assert azimuth_at(np.array([1000.01])) == pytest.approx(np.radians(36.0), abs=1e-6)


def test_a_thin_strip_holds_some_of_the_same_pulses(full, thin):
    assert len(thin) / len(full) == pytest.approx(1 / 16, rel=0.02)
    assert np.isin(thin.time, full.time).all()
    np.testing.assert_allclose(np.bincount(thin.ring), len(thin) / N_RINGS, rtol=0.02)


def test_a_thin_strip_spreads_over_all_azimuths(thin):
    """Whole sequences are 3.2 deg apart in a turn; within seconds the turns fill the gaps."""
    count = np.histogram(np.degrees(thin.azimuth[thin.ring == 3]), bins=240, range=(-60, 60))[0]
    assert count.min() > 0
    assert count.std() / count.mean() < 0.5
