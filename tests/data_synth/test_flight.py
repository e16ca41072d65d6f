"""The plan is Table 1; the true motion is smooth and as rough as intended."""

from itertools import pairwise

import numpy as np
import pytest

from data_synth.flight import (
    EAST,
    HEIGHT,
    LINE_LENGTH,
    NORTH,
    SOUTH,
    SPEED,
    TABLE_1,
    FlightPlan,
    PlannedLine,
    covering,
    direction_words,
    flight_plan,
    fly,
    overlap,
    plan_of,
    swath_width,
)
from data_synth.motion import GUST_RMS, RECORD_STEP, VIBRATION_RMS, draw_disturbance
from paperrepro.errors import BadInput
from paperrepro.paper.published import TABLE1

LINES = {line.name: line for line in flight_plan()}


@pytest.fixture(scope="module")
def motion():
    return fly(flight_plan(), np.random.default_rng(3))


@pytest.mark.parametrize("pair", TABLE1)
def test_table_1(pair):
    a, b = (LINES[name] for name in pair)
    percent, words = TABLE1[pair]
    assert 100 * overlap(a, b) == pytest.approx(percent, abs=1e-10)
    assert 100 * overlap(b, a) == pytest.approx(percent, abs=1e-10)
    assert direction_words(a, b) == words


def test_swath_is_60_degrees_to_either_side_of_30_m():
    assert swath_width(HEIGHT) == pytest.approx(103.923, abs=1e-3)


def test_lines_are_flown_one_after_the_other_at_cruising_speed():
    lines = list(LINES.values())
    assert all(a.end_time < b.start_time for a, b in pairwise(lines))
    for line in lines:
        assert np.linalg.norm(line.velocity) == pytest.approx(SPEED)
        assert np.linalg.norm(line.end - line.start) == pytest.approx(LINE_LENGTH)
        course = (np.sin(line.heading), np.cos(line.heading))
        np.testing.assert_allclose(line.velocity, SPEED * np.array(course), atol=1e-12)


def test_crossing_lines_have_no_common_direction():
    with pytest.raises(BadInput, match="F1-F7"):
        direction_words(LINES["F1"], LINES["F7"])


def test_course_is_the_plan_on_the_lines(motion):
    for line in LINES.values():
        time = np.linspace(line.start_time, line.end_time, 50)
        planned = line.start + (time - line.start_time)[:, None] * line.velocity
        east, north, up, heading = motion.course(time).T
        np.testing.assert_allclose(np.column_stack([east, north]), planned, atol=1e-9)
        np.testing.assert_allclose(up, HEIGHT, atol=1e-9)
        np.testing.assert_allclose(np.cos(heading - line.heading), 1.0, atol=1e-12)


def test_course_has_no_jump_in_acceleration_and_none_beyond_a_multirotor(motion):
    time = np.arange(motion.start, motion.end, 0.01)
    acceleration = motion.course(time, nu=2)[:, :3]
    assert np.abs(np.diff(acceleration, axis=0)).max() < 0.05
    assert np.linalg.norm(acceleration, axis=1).max() < 3.0


def test_gusts_and_vibration_have_the_stated_size():
    time = np.arange(0.0, 4000.0, 0.02)
    value, rate = draw_disturbance(np.random.default_rng(0)).at(time)
    np.testing.assert_allclose(value.std(axis=0), np.hypot(GUST_RMS, VIBRATION_RMS), rtol=0.02)
    assert rate.std(axis=0)[3] > 2 * np.pi * 6 * VIBRATION_RMS[3]


def test_rate_is_the_derivative_of_the_value():
    disturbance = draw_disturbance(np.random.default_rng(1))
    time, step = np.linspace(5.0, 9.0, 40), 1e-5
    difference = (disturbance.at(time + step)[0] - disturbance.at(time - step)[0]) / (2 * step)
    np.testing.assert_allclose(difference, disturbance.at(time)[1], atol=1e-7)


def test_a_200_hz_record_interpolates_to_the_true_motion(motion):
    """Cubic Hermite through 5 ms records: a 15 Hz vibration of 0.03 deg is missed by 1e-4 deg."""
    record, line = motion.record(), LINES["F2"]  # heads south: heading wraps on the way
    assert np.abs(np.diff(record.attitude[:, 2])).max() > 6.0
    time = np.random.default_rng(0).uniform(line.start_time, line.end_time, 20_000)
    error = record.at(time) - motion.at(time)
    error[:, 5] = (error[:, 5] + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(error[:, :3]).max() < 1e-5
    assert np.degrees(np.abs(error[:, 3:])).max() < 1e-4
    assert np.degrees(error[:, 3:].std(axis=0)).max() < 3e-5


def test_motion_and_record_agree_at_the_record(motion):
    record = motion.record()
    assert np.diff(record.time) == pytest.approx(RECORD_STEP)
    some = slice(1000, 3000)
    pose = motion.at(record.time[some])
    np.testing.assert_allclose(pose[:, :3], record.position[some], atol=1e-9)
    np.testing.assert_allclose(pose[:, 3:], record.attitude[some], atol=1e-10)


def test_gusts_and_vibration_scale_the_same_motion():
    time = np.arange(0.0, 400.0, 0.02)
    calm, plain, rough = (
        draw_disturbance(np.random.default_rng(0), gusts, vibration)
        for gusts, vibration in ((0.0, 1.0), (1.0, 1.0), (2.0, 3.0))
    )
    np.testing.assert_allclose(rough.amplitude[:, :12], 2 * plain.amplitude[:, :12])
    np.testing.assert_allclose(rough.amplitude[:, 12:], 3 * plain.amplitude[:, 12:])
    np.testing.assert_array_equal(rough.phase, plain.phase)
    np.testing.assert_allclose(calm.at(time)[0].std(axis=0), VIBRATION_RMS, rtol=0.05)


def test_a_plan_of_two_lines_higher_up():
    plan = FlightPlan(
        (PlannedLine("A", -0.25, NORTH), PlannedLine("B", 0.25, SOUTH)), 100.0, 50.0, 6.0
    )
    a, b = flight_plan(plan)
    swath = 2 * 50.0 * np.tan(np.radians(60.0))
    np.testing.assert_allclose(a.start, (-0.25 * swath, -50.0), atol=1e-9)
    np.testing.assert_allclose(b.velocity, (0.0, -6.0), atol=1e-12)
    assert overlap(a, b) == pytest.approx(0.5)
    assert direction_words(a, b) == "North-South"
    motion = fly((a, b), np.random.default_rng(0))
    pose = motion.course(np.array([a.start_time, b.end_time]))
    np.testing.assert_allclose(pose[:, 2], 50.0)
    np.testing.assert_allclose(pose[1, :2], b.end, atol=1e-9)


def test_some_lines_of_a_plan():
    assert [line.name for line in flight_plan(TABLE_1.only("F7", "F2"))] == ["F2", "F7"]


def test_a_covering_plan_covers():
    lines = flight_plan(covering(160.0, 130.0, 0.6))
    north = [line for line in lines if line.heading in (NORTH, SOUTH)]
    swaths = [line.swath()[:, 0] for line in north]
    assert min(low for low, _ in swaths) <= -160.0
    assert max(high for _, high in swaths) >= 160.0
    assert all(overlap(a, b) == pytest.approx(0.6) for a, b in pairwise(north))
    assert lines[len(north)].heading == EAST


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: FlightPlan(()),
        lambda: FlightPlan((PlannedLine("A", 0.0, NORTH), PlannedLine("A", 0.3, NORTH))),
        lambda: FlightPlan((PlannedLine("A", 0.0, 0.5),)),
        lambda: FlightPlan((PlannedLine("A", 0.0, NORTH),), height=0.0),
        lambda: TABLE_1.only("F9"),
        lambda: FlightPlan((PlannedLine("A", 0.0, NORTH),), height=100.0),
        lambda: FlightPlan((PlannedLine("A", np.nan, NORTH),)),
        lambda: FlightPlan((PlannedLine("A", 0.0, NORTH, speed=-1.0),)),
        lambda: FlightPlan((PlannedLine("a/b", 0.0, NORTH),)),
        lambda: covering(50.0, 50.0, 1.0),
        lambda: covering(50.0, 50.0, height=0.0),
    ],
)
def test_a_plan_that_cannot_be_flown_is_refused(wrong):
    with pytest.raises(BadInput):
        wrong()


def test_a_table_of_lines_is_a_plan():
    """Each at its own height and speed; the climb between them is part of the turn."""
    table = [
        {"offset_m": -20.0, "heading_deg": 0},
        {"name": "low", "offset_m": 10, "heading_deg": 270, "length_m": 80, "height_m": 20.0,
         "speed_m_s": 3.0},
    ]  # fmt: skip
    first, low = flight_plan(plan_of(table))
    assert (first.name, low.name) == ("F1", "low")
    np.testing.assert_allclose(first.start, (-20.0, -LINE_LENGTH / 2), atol=1e-9)
    np.testing.assert_allclose(low.start, (40.0, 10.0), atol=1e-9)
    np.testing.assert_allclose(low.velocity, (-3.0, 0.0), atol=1e-12)
    assert (first.height, low.height) == (HEIGHT, 20.0)
    motion = fly((first, low), np.random.default_rng(0))
    time = np.arange(first.end_time, low.start_time, 0.1)
    assert motion.course(np.array([low.start_time]))[0, 2] == pytest.approx(20.0)
    assert np.linalg.norm(motion.course(time, nu=2)[:, :3], axis=1).max() < 3.0


@pytest.mark.parametrize(
    ("row", "fact"),
    [
        ({"heading_deg": 0}, "line F1: offset_m: expected a number, got None"),
        ({"offset_m": 0.0, "heading_deg": "north"}, "line F1: heading_deg: expected a number"),
        ({"offset_m": 0.0, "heading_deg": 0, "heigth_m": 3.0}, "line F1: expected .* got heigth_m"),
        ({"offset_m": 0.0, "heading_deg": 45}, "F1: expected a heading"),
        ({"offset_m": 0.0, "heading_deg": 0, "height_m": 120}, "F1: height: expected below 100 m"),
        (3, "line number 1: expected"),
    ],
)
def test_a_table_that_is_no_plan_is_refused(row, fact):
    with pytest.raises(BadInput, match=fact):
        plan_of([row])


def test_table_1_as_a_table_is_table_1():
    table = [
        {"name": line.name, "offset_m": line.offset * swath_width(HEIGHT),
         "heading_deg": np.degrees(line.heading)} for line in TABLE_1.lines
    ]  # fmt: skip
    for a, b in zip(flight_plan(plan_of(table)), LINES.values(), strict=True):
        assert (a.name, a.height) == (b.name, b.height)
        np.testing.assert_allclose(a.start, b.start, atol=1e-9)
        assert a.end_time == pytest.approx(b.end_time)
