"""Eq. (1) and (2) against an independent composition, their derivatives against differences."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from paperrepro.frames import R_NOMINAL, T_NED_ENU, boresight_matrix
from paperrepro.method.georeference import (
    OBSERVATIONS,
    boresight_derivatives,
    georeference,
    georeference_strip,
    point_jacobians,
)
from paperrepro.survey import Mounting, Navigation, Rays, Scanner, Strip, Survey, Trajectory

BORESIGHT = np.deg2rad([2.5, -3.0, 1.5])
LEVER = np.array([0.11, -0.23, 0.31])
OFFSETS = np.linspace(-0.03, 0.03, 16)
MOUNTING = Mounting(lever_arm=LEVER, boresight=BORESIGHT, range_offsets=OFFSETS)
#: Central differences of step h err by h^2 f'''/6 + eps f/h: for h = 1e-5 and 100 m, 1e-8 m/rad.
STEP, DIFFERENCE = 1e-5, 1e-7


def composed(observations, boresight, offset, lever=LEVER):
    """Eq. (1) and (2) with scipy's rotations: (9,) as `OBSERVATIONS` to (3,) m, m-frame."""
    roll, pitch, heading, rho, azimuth, elevation = observations[3:]
    r_l = (rho + offset) * np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    turn = Rotation.from_euler("ZYX", boresight[::-1])
    r_b = turn.apply(R_NOMINAL @ r_l) + lever
    level = Rotation.from_euler("ZYX", [heading, pitch, roll]).apply(r_b)
    return observations[:3] + T_NED_ENU @ level


def random_rays(n=50, seed=3):
    rng = np.random.default_rng(seed)
    pose = np.column_stack([rng.uniform(-50, 50, (n, 3)), rng.uniform(-3, 3, (n, 3))])
    ring = rng.integers(0, 16, n)
    azimuth, elevation = rng.uniform(-1, 1, n), np.deg2rad(np.linspace(-10, 10, 16))[ring]
    return Rays(pose, ring, azimuth, elevation, rng.uniform(5, 100, n))


def observations_of(rays):
    return np.column_stack([rays.pose, rays.rho, rays.azimuth, rays.elevation])


def jacobians(observations, boresight=BORESIGHT, offset=0.02):
    R_l_b, dR_l_b = boresight_matrix(boresight), boresight_derivatives(boresight, R_NOMINAL)
    return [a[0] for a in point_jacobians(observations[None], R_l_b, dR_l_b, LEVER, offset)]


def test_points_equal_an_independent_composition():
    rays = random_rays()
    expected = [
        composed(obs, BORESIGHT, OFFSETS[ring])
        for obs, ring in zip(observations_of(rays), rays.ring, strict=True)
    ]
    np.testing.assert_allclose(georeference(rays, MOUNTING), expected, rtol=0, atol=1e-12)


def test_a_level_nadir_ray_ends_below_the_lever_arm():
    """Heading east: body forward is east, right is south, down is down."""
    pose = np.array([[10.0, 20.0, 50.0, 0.0, 0.0, np.pi / 2]])
    rays = Rays(pose, np.array([0]), np.zeros(1), np.zeros(1), np.array([30.0]))
    point = georeference(rays, Mounting(lever_arm=np.array([0.1, 0.2, 0.3])))
    np.testing.assert_allclose(point, [[10.1, 19.8, 19.7]], rtol=0, atol=1e-13)


def test_a_ray_up_the_spin_axis_looks_ahead_and_one_to_azimuth_90_looks_left():
    pose = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0], (2, 1))
    rays = Rays(
        pose, np.zeros(2, int), np.deg2rad([0.0, 90.0]), np.deg2rad([90.0, 0.0]), np.ones(2)
    )
    ahead_and_left = [[0, 1, 0], [-1, 0, 0]]  # heading north
    np.testing.assert_allclose(georeference(rays, Mounting()), ahead_and_left, rtol=0, atol=1e-15)


def test_a_range_offset_is_added_to_the_measured_range_of_its_ring():
    rays = random_rays()
    longer = Rays(rays.pose, rays.ring, rays.azimuth, rays.elevation, rays.rho + OFFSETS[rays.ring])
    without = MOUNTING.with_calibration(BORESIGHT)
    np.testing.assert_allclose(
        georeference(rays, MOUNTING), georeference(longer, without), rtol=0, atol=1e-12
    )


def test_beam_offsets_turn_the_rays_of_their_ring():
    rays = random_rays()
    by = 1e-3 * np.random.default_rng(3).standard_normal((16, 2))
    turned = replace(
        rays,
        elevation=rays.elevation + by[rays.ring, 0],
        azimuth=rays.azimuth + by[rays.ring, 1],
    )
    p_m = georeference(rays, replace(MOUNTING, beam_offsets=by))
    np.testing.assert_allclose(p_m, georeference(turned, MOUNTING), atol=1e-12)


def test_an_empty_set_of_rays_gives_no_points():
    assert georeference(random_rays().take(slice(0, 0)), MOUNTING).shape == (0, 3)


def test_a_strip_is_georeferenced_under_the_survey_s_mounting_or_another():
    trajectory = Trajectory(
        np.array([0.0, 1.0]), np.array([[0.0, 0, 30], [0, 5, 30]]), np.zeros((2, 3))
    )
    scanner = Scanner("s", np.deg2rad([-10.0, 10.0]), 0.02, 1e-4)
    navigation = Navigation("n", np.full(3, 0.02), np.full(3, 1e-4), 20.0)
    strip = Strip("F1", np.array([0.2, 0.4]), np.array([0, 1]), np.zeros(2), np.full(2, 30.0))
    survey = Survey((strip,), trajectory, MOUNTING, scanner, navigation)
    rays = survey.rays(strip)
    np.testing.assert_array_equal(georeference_strip(survey, strip), georeference(rays, MOUNTING))
    np.testing.assert_array_equal(
        georeference_strip(survey, strip, Mounting()), georeference(rays, Mounting())
    )


def test_the_point_beside_its_derivatives_is_the_georeferenced_point():
    for obs in observations_of(random_rays()):
        expected = composed(obs, BORESIGHT, 0.02)
        np.testing.assert_allclose(jacobians(obs)[0], expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("column", range(4), ids=["omega", "phi", "kappa", "range_offset"])
def test_derivative_by_a_parameter(column):
    parameters = np.append(BORESIGHT, 0.02)
    step = STEP * np.eye(4)[column]
    for obs in observations_of(random_rays()):
        high, low = parameters + step, parameters - step
        numeric = (composed(obs, high[:3], high[3]) - composed(obs, low[:3], low[3])) / (2 * STEP)
        np.testing.assert_allclose(jacobians(obs)[1][:, column], numeric, rtol=0, atol=DIFFERENCE)


@pytest.mark.parametrize("column", range(9), ids=OBSERVATIONS)
def test_derivative_by_an_observation(column):
    step = STEP * np.eye(9)[column]
    for obs in observations_of(random_rays()):
        high, low = composed(obs + step, BORESIGHT, 0.02), composed(obs - step, BORESIGHT, 0.02)
        numeric = (high - low) / (2 * STEP)
        np.testing.assert_allclose(jacobians(obs)[2][:, column], numeric, rtol=0, atol=DIFFERENCE)


@pytest.mark.parametrize("angle", range(3), ids=["omega", "phi", "kappa"])
def test_derivative_of_the_boresight_matrix(angle):
    step = STEP * np.eye(3)[angle]
    numeric = (boresight_matrix(BORESIGHT + step) - boresight_matrix(BORESIGHT - step)) / (2 * STEP)
    analytic = boresight_derivatives(BORESIGHT, R_NOMINAL)[angle]
    np.testing.assert_allclose(analytic, numeric, rtol=0, atol=1e-10)
