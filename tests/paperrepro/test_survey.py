"""The containers: poses between the trajectory's, and bad input named."""

import numpy as np
import pytest

from paperrepro.errors import BadInput, EmptyStrip, NotARotation, NotFinite, OutsideTrajectory
from paperrepro.frames import attitude_matrix
from paperrepro.survey import Mounting, Navigation, Rays, Scanner, Strip, Survey, Trajectory

RATE = 200.0
SCANNER = Scanner("two-beam", np.deg2rad([-5.0, 5.0]), 0.02, 1e-4)
NAVIGATION = Navigation("ins", np.full(3, 0.02), np.full(3, 1e-4), 20.0)


def trajectory(attitude=None, seconds=2.0, rate=RATE):
    time = 100 + np.arange(round(seconds * rate) + 1) / rate
    position = np.column_stack([0 * time, 4.5 * (time - 100), 0 * time + 30])
    attitude = np.zeros((len(time), 3)) if attitude is None else attitude(time)
    return Trajectory(time, position, attitude)


def strip(n=10, **columns):
    whole = {
        "time": np.linspace(100.1, 101.9, n),
        "ring": np.arange(n, dtype=np.uint8) % 2,
        "azimuth": np.linspace(-1, 1, n),
        "rho": np.full(n, 30.0),
    }
    return Strip("F1", **{**whole, **columns})


def survey(**parts):
    whole = {
        "strips": (strip(),),
        "trajectory": trajectory(),
        "mounting": Mounting(),
        "scanner": SCANNER,
        "navigation": NAVIGATION,
    }
    return Survey(**{**whole, **parts})


def spoilt(values, row, value=np.nan):
    values = np.array(values, float)
    values[row] = value
    return values


def message_of(error, *facts):
    for fact in facts:
        assert fact in str(error.value)


# --- poses ---------------------------------------------------------------------------------------


def vibration(time):
    """10 Hz, 0.03 deg."""
    wave = np.deg2rad(0.03) * np.sin(2 * np.pi * 10 * time)
    return np.column_stack([wave, 0 * time, 0 * time])


def test_vibration_is_met_as_the_docstring_says():
    given = trajectory(vibration)
    time = np.linspace(100.1, 101.9, 20_001)
    true = vibration(time)[:, 0]
    error = np.rad2deg(np.abs(given.at(time)[:, 3] - true).max())
    straight = np.interp(time, given.time, given.attitude[:, 0])
    assert error < 2.5e-5 < 20 * error
    assert np.rad2deg(np.abs(straight - true).max()) == pytest.approx(4e-4, rel=0.1)


def test_error_falls_with_the_cube_of_the_step():
    time = np.linspace(100.1, 101.9, 20_001)
    coarse, fine = (
        np.abs(trajectory(vibration, rate=rate).at(time)[:, 3] - vibration(time)[:, 0]).max()
        for rate in (RATE, 2 * RATE)
    )
    assert coarse / fine == pytest.approx(8, rel=0.15)


def test_poses_are_exact_at_the_trajectory_s_own_times():
    given = trajectory(vibration)
    poses = given.at(given.time)
    np.testing.assert_array_equal(poses, np.column_stack([given.position, given.attitude]))


def test_steady_motion_is_met_exactly_even_with_uneven_steps():
    time = np.cumsum(np.random.default_rng(0).uniform(0.003, 0.2, 50))
    speed = np.array([1.0, -2.0, 0.3])
    given = Trajectory(time, time[:, None] * speed, time[:, None] * speed / 50)
    between = np.linspace(time[0], time[-1], 777)
    expected = between[:, None] * np.r_[speed, speed / 50]
    np.testing.assert_allclose(given.at(between), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("seam_deg", [0.0, 180.0], ids=["0-360", "-180-180"])
def test_heading_wraps_without_a_jump(seam_deg):
    def turning(time):
        heading = np.deg2rad(seam_deg + 4 * (time - 101))  # crosses the seam half-way
        low = 0 if seam_deg == 0 else -np.pi
        return np.column_stack([0 * time, 0 * time, (heading - low) % (2 * np.pi) + low])

    given = trajectory(turning)
    assert np.abs(np.diff(given.attitude[:, 2])).max() > 6  # the seam is in there
    time = np.linspace(100.9, 101.1, 501)
    headings = given.at(time)[:, 5]
    np.testing.assert_allclose(np.diff(headings), np.deg2rad(4) * 0.2 / 500, rtol=1e-6)
    expected = attitude_matrix(0, 0, np.deg2rad(seam_deg))
    np.testing.assert_allclose(attitude_matrix(*given.at([101.0])[0, 3:]), expected, atol=1e-12)


@pytest.mark.parametrize("time", [[99.99, 100.5], [100.5, 102.01]], ids=["before", "after"])
def test_points_outside_the_trajectory(time):
    with pytest.raises(OutsideTrajectory) as error:
        trajectory().at(np.array(time), "F3")
    message_of(error, "F3", f"{time[0]:.3f}-{time[1]:.3f}", "100.000-102.000", "same time system")


def test_the_first_and_last_pose_are_inside():
    assert trajectory().at(np.array([100.0, 102.0])).shape == (2, 6)


def with_gap():
    whole = trajectory(seconds=4.0)
    kept = (whole.time < 101) | (whole.time > 102.5)
    return Trajectory(whole.time[kept], whole.position[kept], whole.attitude[kept])


def test_points_in_a_gap():
    with pytest.raises(OutsideTrajectory) as error:
        with_gap().at(np.array([100.5, 101.5, 102.0, 103.0]), "F3")
    message_of(error, "F3", "2 points", "gap of 1.5 s", "after 100.995 s", "without gaps")


def test_points_beside_a_gap():
    np.testing.assert_allclose(
        with_gap().at(np.array([100.5, 103.0]))[:, 1], [2.25, 13.5], atol=1e-12
    )


# --- bad input -----------------------------------------------------------------------------------


@pytest.mark.parametrize("column", ["time", "azimuth", "rho"])
def test_nan_in_a_strip(column):
    bad = strip(**{column: spoilt(getattr(strip(), column), 4)})
    with pytest.raises(NotFinite) as error:
        survey().rays(bad)
    message_of(error, "F1", column, "row 4", "expected finite", "drop")


@pytest.mark.parametrize("column", ["time", "position", "attitude"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_nan_or_infinity_in_a_trajectory(column, value):
    good = trajectory()
    columns = {name: getattr(good, name) for name in ("time", "position", "attitude")}
    columns[column] = spoilt(columns[column], 7, value)
    with pytest.raises(NotFinite) as error:
        Trajectory(**columns)
    message_of(error, "trajectory", column, "row 7")


@pytest.mark.parametrize(
    ("part", "values"),
    [
        ("lever_arm", [0, np.nan, 0]),
        ("boresight", [0, 0, np.inf]),
        ("range_offsets", [0.01, np.nan]),
    ],
)
def test_nan_in_a_mounting(part, values):
    with pytest.raises(NotFinite, match=part.replace("_", " ")):
        Mounting(**{part: np.array(values)})


@pytest.mark.parametrize("part", ["lever_arm", "boresight"])
def test_a_mounting_needs_three_numbers_each(part):
    with pytest.raises(BadInput) as error:
        Mounting(**{part: np.zeros(2)})
    message_of(error, part.replace("_", " "), "expected three", "shape (2,)", "body axis")


@pytest.mark.parametrize(
    "R", [-np.eye(3), 2 * np.eye(3), np.eye(4)], ids=["reflection", "scaled", "shape"]
)
def test_a_mounting_that_is_no_rotation(R):
    with pytest.raises(NotARotation, match="mounting rotation: expected"):
        Mounting(R_nominal=R)


def test_fewer_range_offsets_than_rings():
    with pytest.raises(BadInput) as error:
        Mounting(range_offsets=np.zeros(8)).offsets(16)
    message_of(error, "range offsets", "16 rings", "shape (8,)", "per beam")


def test_an_empty_strip():
    with pytest.raises(EmptyStrip) as error:
        survey().rays(strip(0))
    message_of(error, "F1", "expected points", "leave it out")


@pytest.mark.parametrize("column", ["ring", "azimuth", "rho"])
def test_strip_columns_of_different_length(column):
    with pytest.raises(BadInput) as error:
        strip(**{column: getattr(strip(), column)[:-1]}).check()
    message_of(error, "F1", "one length", f"{column} 9", "time 10")


@pytest.mark.parametrize("column", ["time", "position", "attitude"])
def test_trajectory_columns_of_different_length(column):
    good = trajectory()
    columns = {name: getattr(good, name) for name in ("time", "position", "attitude")}
    columns[column] = columns[column][:-1]
    with pytest.raises(BadInput) as error:
        Trajectory(**columns)
    message_of(error, "trajectory", "one length", f"{column} 400")


@pytest.mark.parametrize(
    "time", [[0.0], [0.0, 1.0, 1.0], [0.0, 2.0, 1.0]], ids=["one", "repeat", "backwards"]
)
def test_trajectory_times_must_increase(time):
    with pytest.raises(BadInput, match="expected at least two poses with increasing time"):
        Trajectory(np.array(time), np.zeros((len(time), 3)), np.zeros((len(time), 3)))


@pytest.mark.parametrize("ring", [[0, 2], [-1, 0]], ids=["above", "below"])
def test_a_ring_that_the_scanner_lacks(ring):
    bad = strip(2, ring=np.array(ring))
    with pytest.raises(BadInput) as error:
        survey().rays(bad)
    message_of(error, "F1", f"rings {ring[0]} to {ring[1]}", "two-beam has 2", "ring column")


def test_a_strip_outside_the_survey_s_trajectory():
    late = strip(time=np.linspace(500.0, 501.0, 10))
    with pytest.raises(OutsideTrajectory, match=r"F1: its points span 500\.000-501\.000 s"):
        survey().rays(late)


# --- the containers themselves -------------------------------------------------------------------


def test_rays_carry_pose_and_the_beam_s_elevation():
    rays = survey().rays(strip())
    np.testing.assert_array_equal(rays.elevation, SCANNER.beam_elevations[strip().ring])
    np.testing.assert_allclose(rays.pose[:, 1], 4.5 * (strip().time - 100), atol=1e-12)
    assert len(rays) == 10


def test_chosen_rays_are_rows_of_all_rays():
    index = np.array([3, 1, 7])
    chosen, whole = survey().rays(strip(), index), survey().rays(strip()).take(index)
    for name in vars(whole):
        np.testing.assert_array_equal(getattr(chosen, name), getattr(whole, name))


def test_joined_rays_follow_one_another():
    rays = survey().rays(strip())
    joined = Rays.join([rays.take(slice(0, 4)), rays.take(slice(4, None))])
    for name in vars(rays):
        np.testing.assert_array_equal(getattr(joined, name), getattr(rays, name))


def test_joined_rays_have_times_only_where_all_have():
    rays = survey().rays(strip())
    np.testing.assert_array_equal(rays.time, strip().time)
    timeless = Rays(*(getattr(rays, name) for name in list(vars(rays))[:5]))
    assert timeless.take(slice(3)).time is None
    assert Rays.join([rays, timeless]).time is None
    np.testing.assert_array_equal(Rays.join([rays, rays]).time, np.tile(strip().time, 2))


def test_a_mounting_keeps_rotation_and_lever_arm_when_calibrated():
    before = Mounting(lever_arm=np.array([0.1, 0.2, 0.3]))
    after = before.with_calibration([0.01, 0.02, 0.03], np.full(16, 0.01))
    np.testing.assert_array_equal(after.lever_arm, before.lever_arm)
    np.testing.assert_array_equal(after.R_nominal, before.R_nominal)
    np.testing.assert_array_equal(after.boresight, [0.01, 0.02, 0.03])
    np.testing.assert_array_equal(after.offsets(16), np.full(16, 0.01))
    np.testing.assert_array_equal(before.offsets(16), np.zeros(16))


def test_a_strip_is_found_by_name():
    two = survey(strips=(strip(), Strip("F2", *(np.zeros(1) for _ in range(4)))))
    assert two.strip("F2").name == "F2"


def test_a_scanner_without_rings_has_an_elevation_per_point():
    own = np.linspace(-0.2, 0.3, 10)
    flown = strip(ring=np.zeros(10, np.uint8), elevation=own)
    seen = survey(strips=(flown,), scanner=Scanner("line", np.empty(0), 0.02, 1e-4))
    assert seen.scanner.n_rings == 1
    np.testing.assert_array_equal(seen.rays(flown, [2, 0]).elevation, own[[2, 0]])
