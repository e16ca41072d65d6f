"""The backward derivatives against the forward ones of Eq. (1), and adjusted observations."""

import numpy as np
import pytest

from paperrepro.frames import R_NOMINAL, boresight_matrix
from paperrepro.method.adjustment.conditions import FINAL, PreparedRays, axes
from paperrepro.method.adjustment.kernels import adjust_observations
from paperrepro.method.georeference import boresight_derivatives, point_jacobians
from paperrepro.survey import Rays

BORESIGHT, LEVER = np.array([0.02, -0.03, 0.05]), np.array([0.1, -0.02, 0.15])
VARIANCES = np.square([0.03, 0.03, 0.05, 4e-4, 4e-4, 1.4e-3, 0.02, 2e-4, 2e-4])
OFFSET = 0.013


@pytest.fixture
def observed():
    rng = np.random.default_rng(3)
    pose = [12.0, -7.0, 31.0, *rng.uniform(-0.2, 0.2, 2), 2.3]
    return np.array([*pose, 33.0, *rng.uniform(-0.6, 0.6, 2)])


def final_m(observed, plane, variances):
    """w, s, v, b, row of one ray."""
    rays = Rays(observed[None, :6], np.zeros(1, int), *observed[None, [7, 8, 6]].T)
    position, turns, rho, _ = PreparedRays.of(rays).columns()
    R, dR = boresight_matrix(BORESIGHT), boresight_derivatives(BORESIGHT, R_NOMINAL)
    v, b, row, origin = np.empty(9), np.empty(9), np.empty(8), np.array([5.0, 4.0, 1.0])
    mounted = R, axes(R, dR), LEVER, OFFSET
    last = variances, FINAL, v, b, row
    w, s = adjust_observations(position[0], turns[0], rho[0], plane, origin, *mounted, *last)
    return w, s, v, b, row, origin


def forward(observed):
    """Point, its derivatives by the unknowns (3, 4) and by the observations (3, 9)."""
    R, dR = boresight_matrix(BORESIGHT), boresight_derivatives(BORESIGHT, R_NOMINAL)
    return [a[0] for a in point_jacobians(observed[None], R, dR, LEVER, OFFSET)]


@pytest.mark.parametrize("misclosure", [0.02, 15.0])
def test_derivatives_are_those_of_the_equation_at_the_adjusted_observations(observed, misclosure):
    """15 m away the angles' residuals are too large for the series."""
    normal = np.array([0.3, -0.2, 0.8]) / np.linalg.norm([0.3, -0.2, 0.8])
    p, _, _ = forward(observed)
    plane = np.array([*normal, normal @ (p - [5.0, 4.0, 1.0]) + misclosure])
    w, s, v, b, row, origin = final_m(observed, plane, VARIANCES)
    assert (np.abs(v[3:6]).max() > 0.02) == (misclosure > 1)
    p, J_x, J_l = forward(observed + v)
    np.testing.assert_allclose(b, normal @ J_l, atol=1e-13)
    np.testing.assert_allclose(row[:4], normal @ J_x, atol=1e-13)
    np.testing.assert_allclose(row[4:], [*(p - origin), -1.0], atol=1e-13)
    np.testing.assert_allclose(s, np.square(normal @ J_l) @ VARIANCES, rtol=1e-13)
    np.testing.assert_allclose(w, normal @ (p - origin) - plane[3] - b @ v, atol=1e-13)
    assert abs(normal @ (p - origin) - plane[3]) < 1e-9  # the adjusted point lies on the plane


def test_what_is_prepared_is_not_prepared_again(observed):
    rays = Rays(observed[None, :6], np.zeros(1, int), *observed[None, [7, 8, 6]].T)
    prepared = PreparedRays.of(rays)
    assert PreparedRays.of(prepared) is prepared
