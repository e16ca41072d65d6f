"""Virtual points on analytic roofs, and what is and is not a gable."""

from dataclasses import replace

import numpy as np
import pytest

from paperrepro.method.planes import fit_plane
from paperrepro.method.roofs import Face, GableParameters, find_gables, virtual_point
from tests.paperrepro.method.shapes import gable

PARAMS = GableParameters()


def face_of(p_m, points):
    plane = fit_plane(p_m[points])
    size = np.ptp(p_m[points][:, :2], axis=0)
    return Face(plane.normal, plane.d, plane.centroid, points, plane.rms, float(size.prod()))


def faces_of(p_m, side):
    return [face_of(p_m, np.flatnonzero(side == number)) for number in np.unique(side)]


def flat_face(normal, d, centroid):
    return Face(np.array(normal), d, np.array(centroid), np.arange(3), 0.0, 10.0)


def test_virtual_point_of_an_analytic_roof():
    """Ridge along north at x = 1, z = 7, slopes of 45 degrees."""
    s = np.sqrt(0.5)
    left = flat_face((-s, 0, s), s * 6.0, (-1.0, 2.0, 5.0))  # z = 6 + x
    right = flat_face((s, 0, s), s * 8.0, (4.0, 7.0, 4.0))  # z = 8 - x
    point, ridge = virtual_point(left, right)
    # the segment from (-1, 2) to (4, 7) crosses x = 1 at y = 4
    np.testing.assert_allclose(point, [1.0, 4.0, 7.0], atol=1e-12)
    np.testing.assert_allclose(ridge, [0.0, 1.0, 0.0], atol=1e-12)
    swapped, _ = virtual_point(right, left)
    np.testing.assert_allclose(swapped, point, atol=1e-12)


def test_virtual_point_takes_its_height_from_a_sloping_ridge():
    """z = 5 + 0.1 y - |x|: the ridge rises by 10 %."""
    n = np.sqrt(2.01)
    left = flat_face((-1 / n, -0.1 / n, 1 / n), 5 / n, (-2.0, -3.0, 2.7))
    right = flat_face((1 / n, -0.1 / n, 1 / n), 5 / n, (2.0, 5.0, 3.5))
    point, ridge = virtual_point(left, right)
    np.testing.assert_allclose(point, [0.0, 1.0, 5.1], atol=1e-12)
    np.testing.assert_allclose(ridge[2] / ridge[1], 0.1)


def test_no_virtual_point_without_a_ridge_between_the_centroids():
    s = np.sqrt(0.5)
    left, right = flat_face((-s, 0, s), 0.0, (-2, 0, -2)), flat_face((s, 0, s), 0.0, (-1, 0, 1))
    assert virtual_point(left, right) is None  # both centroids west of the ridge
    assert virtual_point(left, left) is None  # parallel planes


@pytest.mark.parametrize("azimuth_deg", [0.0, 35.0, 90.0, 160.0])
def test_a_gable_is_found_with_its_ridge_extent_and_sides(azimuth_deg):
    p_m, side = gable(np.random.default_rng(1), (3.0, -8.0), azimuth_deg)
    faces = faces_of(p_m, side)
    (found,) = find_gables(p_m, faces, PARAMS)
    np.testing.assert_allclose(found.virtual_point[:2], [3.0, -8.0], atol=0.4)
    assert found.virtual_point[2] == pytest.approx(6.0, abs=1e-9)
    along = [np.sin(np.radians(azimuth_deg)), np.cos(np.radians(azimuth_deg)), 0.0]
    assert abs(found.ridge @ along) == pytest.approx(1.0)
    assert np.ptp(found.extent) == pytest.approx(14.0, abs=0.5)
    left = np.array([-found.ridge[1], found.ridge[0], 0.0])
    assert left @ faces[found.left].normal > 0 > left @ faces[found.right].normal


def roof(seed=2, **kwargs):
    p_m, side = gable(np.random.default_rng(seed), **kwargs)
    return p_m, side


def without(p_m, side, drop):
    return p_m[~drop], side[~drop]


def broken_roofs():
    """Roofs that one rule of `GableParameters` forbids, and what would let them pass."""
    p_m, side = roof()
    x, y = np.abs(p_m[:, 0]), np.abs(p_m[:, 1])
    yield "butterfly", p_m * [1, 1, -1] + [0, 0, 12], side, {"ridge_gap_m": 9.0}
    drop = (side == 1) & (x > 1.7)
    yield "narrow side", *without(p_m, side, drop), {"width_ratio": 0.0}
    drop = (side == 1) & (x < 1.6)
    yield "gap at the ridge", *without(p_m, side, drop), {"ridge_gap_m": 9.0}
    beside = np.where(side == 1, p_m[:, 1] < 1.8, p_m[:, 1] > -1.8)
    yield "faces beside each other", *without(p_m, side, ~beside), {"overlap": 0.0}
    yield "hip", *without(p_m, side, y > 7.0 - (4.5 - x)), {"hip_inset": 1.0}
    yield (
        "sloping ridge",
        p_m + 0.12 * p_m[:, [1]] * [0, 0, 1],
        side,
        {
            "ridge_slope_deg": 10.0,
            "azimuth_deg": 40.0,
        },
    )
    turned = p_m + np.where(side == 1, 0.12 * p_m[:, 1], 0.0)[:, None] * [0, 0, 1]
    yield "slopes not opposite", turned, side, {"azimuth_deg": 30.0, "ridge_slope_deg": 10.0}
    yield "short", *without(p_m, side, y > 1.2), {"min_length_m": 1.0}


@pytest.mark.parametrize(
    ("p_m", "side", "relaxed"), [pytest.param(*case, id=name) for name, *case in broken_roofs()]
)
def test_what_breaks_one_rule_is_no_gable(p_m, side, relaxed):
    faces = faces_of(p_m, side)
    assert find_gables(p_m, faces, PARAMS) == []
    assert len(find_gables(p_m, faces, replace(PARAMS, **relaxed))) == 1


def test_hip_rule_forgives_a_swath_that_cuts_one_end():
    p_m, side = roof()
    x, y = p_m[:, 0], p_m[:, 1]
    p_m, side = without(p_m, side, y > 5.0 - (4.5 - np.abs(x)))
    assert len(find_gables(p_m, faces_of(p_m, side), PARAMS)) == 1


def test_a_face_belongs_to_one_gable_the_longest():
    p_m, side = roof(length=16.0)
    short = (side == 1) & (p_m[:, 1] > 4.0)
    faces = [face_of(p_m, np.flatnonzero(side == 0)), face_of(p_m, np.flatnonzero(short)),
             face_of(p_m, np.flatnonzero((side == 1) & ~short))]  # fmt: skip
    (found,) = find_gables(p_m, faces, PARAMS)
    assert {found.left, found.right} == {0, 2}
    loose = replace(PARAMS, min_length_m=20.0)
    assert find_gables(p_m, faces, loose) == []
