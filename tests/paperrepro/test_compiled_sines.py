"""Sines of the ray before, turned, are as good as new ones."""

import numpy as np
import pytest

from paperrepro._compiled import SERIES, sines_near, turned


@pytest.mark.parametrize("spread", [1e-6, SERIES / 3, 3 * SERIES, 4.0])
def test_angles_one_after_the_other(spread):
    angles = 2.0 + np.cumsum(np.random.default_rng(1).uniform(-spread, spread, 2000))
    known = np.full((1, 3), np.nan)
    found = np.array([sines_near(angle, known, 0) for angle in angles])
    expected = np.column_stack([np.sin(angles), np.cos(angles)])
    np.testing.assert_allclose(found, expected, rtol=0, atol=4e-16)


def test_an_angle_beside_the_known_one_leaves_it():
    known = np.full((1, 3), np.nan)
    sines_near(1.0, known, 0)
    sines_near(1.0 + SERIES / 2, known, 0)
    assert known[0, 0] == 1.0
    sines_near(1.0 + 2 * SERIES, known, 0)
    assert known[0, 0] == 1.0 + 2 * SERIES


@pytest.mark.parametrize("by", [0.0, 1e-9, SERIES, -SERIES, 1.1 * SERIES, 3.0])
def test_an_angle_is_enlarged(by):
    found = turned(np.sin(0.7), np.cos(0.7), by)
    np.testing.assert_allclose(found, [np.sin(0.7 + by), np.cos(0.7 + by)], rtol=0, atol=4e-16)
