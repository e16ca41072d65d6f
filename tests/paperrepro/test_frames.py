"""The conventions, one test each."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from paperrepro.errors import NotARotation
from paperrepro.frames import (
    R_NOMINAL,
    T_NED_ENU,
    attitude_matrix,
    boresight_matrix,
    require_rotation,
    rotation_zyx,
)

EXACT = {"rtol": 0, "atol": 1e-14}
FORWARD, RIGHT, DOWN = np.eye(3)
EAST, NORTH, UP = np.eye(3)


def test_map_is_east_north_up_and_navigation_north_east_down():
    np.testing.assert_array_equal(T_NED_ENU @ [1, 0, 0], NORTH)
    np.testing.assert_array_equal(T_NED_ENU @ [0, 1, 0], EAST)
    np.testing.assert_array_equal(T_NED_ENU @ [0, 0, 1], -UP)
    assert np.linalg.det(T_NED_ENU) == pytest.approx(1)


def test_body_is_forward_right_down_when_level_and_heading_north():
    np.testing.assert_allclose(attitude_matrix(0, 0, 0).T, [NORTH, EAST, -UP], **EXACT)


@pytest.mark.parametrize(
    ("heading_deg", "ahead"), [(0, NORTH), (90, EAST), (180, -NORTH), (270, -EAST)]
)
def test_heading_counts_clockwise_from_north(heading_deg, ahead):
    np.testing.assert_allclose(
        attitude_matrix(0, 0, np.deg2rad(heading_deg)) @ FORWARD, ahead, **EXACT
    )


def test_positive_roll_puts_the_right_wing_down():
    rolled = attitude_matrix(0.1, 0, 0.7)
    assert UP @ rolled @ RIGHT == pytest.approx(-np.sin(0.1))
    assert UP @ rolled @ FORWARD == pytest.approx(0, abs=1e-15)


def test_positive_pitch_puts_the_nose_up():
    pitched = attitude_matrix(0, 0.1, 0.7)
    assert UP @ pitched @ FORWARD == pytest.approx(np.sin(0.1))
    assert UP @ pitched @ RIGHT == pytest.approx(0, abs=1e-15)


def test_attitude_turns_by_heading_then_pitch_then_roll():
    roll, pitch, heading = 0.2, -0.3, 2.1
    intrinsic = Rotation.from_euler("ZYX", [heading, pitch, roll]).as_matrix()
    np.testing.assert_allclose(
        attitude_matrix(roll, pitch, heading), T_NED_ENU @ intrinsic, **EXACT
    )


def test_rotation_zyx_is_a_product_of_three_axis_turns():
    x, y, z = 0.3, -1.2, 2.5
    Rx, Ry, Rz = (Rotation.from_rotvec(turn).as_matrix() for turn in np.diag([x, y, z]))
    np.testing.assert_allclose(rotation_zyx(x, y, z), Rz @ Ry @ Rx, **EXACT)


def test_nominal_mounting_is_right_handed_with_the_spin_axis_forward():
    assert np.linalg.det(R_NOMINAL) == pytest.approx(1)
    np.testing.assert_allclose(R_NOMINAL @ R_NOMINAL.T, np.eye(3), **EXACT)
    np.testing.assert_array_equal(R_NOMINAL @ [0, 0, 1], FORWARD)


def test_azimuth_zero_is_nadir_and_a_quarter_turn_is_left():
    np.testing.assert_array_equal(R_NOMINAL @ [1, 0, 0], DOWN)
    np.testing.assert_array_equal(R_NOMINAL @ [0, 1, 0], -RIGHT)


@pytest.mark.parametrize(
    ("angle", "axis", "turned", "towards"),
    [(0, FORWARD, RIGHT, DOWN), (1, RIGHT, DOWN, FORWARD), (2, DOWN, FORWARD, RIGHT)],
    ids=["omega-forward", "phi-right", "kappa-down"],
)
def test_boresight_angles_turn_about_forward_right_and_down(angle, axis, turned, towards):
    boresight = np.zeros(3)
    boresight[angle] = 0.02
    turn = boresight_matrix(boresight, np.eye(3))
    np.testing.assert_allclose(turn @ axis, axis, **EXACT)
    assert (turn @ turned) @ towards == pytest.approx(np.sin(0.02))


def test_boresight_is_applied_after_the_nominal_mounting():
    boresight = np.array([0.02, -0.03, 0.05])
    turn = Rotation.from_euler("ZYX", boresight[::-1]).as_matrix()
    np.testing.assert_allclose(boresight_matrix(boresight), turn @ R_NOMINAL, **EXACT)
    np.testing.assert_array_equal(boresight_matrix(np.zeros(3)), R_NOMINAL)


def test_two_degrees_are_two_centimetres_off_the_small_angle_form():
    """The paper writes I + [w]x; 30 m below, that is 30 (1 - cos 2 deg) off."""
    w = np.deg2rad([2.0, 0.0, 0.0])
    apart = 30 * (boresight_matrix(w, np.eye(3)) @ DOWN - (DOWN + np.cross(w, DOWN)))
    assert np.linalg.norm(apart) == pytest.approx(0.018, abs=0.001)


def test_a_rotation_passes_unchanged():
    R = Rotation.from_euler("xyz", [0.1, 0.2, 0.3]).as_matrix()
    np.testing.assert_array_equal(require_rotation(R.tolist(), "mounting"), R)


@pytest.mark.parametrize(
    ("R", "facts"),
    [
        (np.diag([1.0, 1.0, -1.0]), ("right-handed", "det -1", "signs")),
        (1.01 * np.eye(3), ("det +1.03", "orthonormality by 2.01e-02")),
        (np.eye(3)[:2], ("3x3", "shape (2, 3)")),
        (np.full((3, 3), np.nan), ("finite 3x3",)),
    ],
    ids=["reflection", "scaled", "shape", "nan"],
)
def test_what_is_no_rotation_is_named(R, facts):
    with pytest.raises(NotARotation) as error:
        require_rotation(R, "mounting rotation")
    for fact in ("mounting rotation", "expected", *facts):
        assert fact in str(error.value)
