"""PCA, RANSAC and region growing on known planes."""

from dataclasses import replace

import numpy as np
import pytest

from paperrepro.method.planes import (
    GrowingParameters,
    RansacParameters,
    fit_plane,
    grow_regions,
    neighbourhood,
    ransac_planes,
)
from tests.paperrepro.method.shapes import crown, gable, patch

RANSAC, GROWING = RansacParameters(), GrowingParameters()


def around(p_m):
    return neighbourhood(p_m, GROWING.neighbours, GROWING.max_gap_m)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_plane_fit_recovers_a_plane_with_its_normal_up(sign):
    rng = np.random.default_rng(1)
    normal = np.array([0.3, -0.5, np.sqrt(1 - 0.34)])
    u, v = np.linalg.svd(sign * normal[None])[2][1:]
    p_m = 12.5 * normal + rng.uniform(-4, 4, (50, 2)) @ [u, v]
    plane = fit_plane(p_m)
    np.testing.assert_allclose(plane.normal, normal, atol=1e-12)
    assert plane.d == pytest.approx(12.5, abs=1e-12)
    assert plane.rms < 1e-7
    assert np.cos(plane.slope) == pytest.approx(normal[2])
    np.testing.assert_allclose(plane.centroid, p_m.mean(axis=0))


def test_plane_fit_reports_distances_and_their_rms():
    p_m = patch(np.random.default_rng(2), 4000, 10, 10, sigma=0.05)
    plane = fit_plane(p_m)
    distance = plane.distance(p_m)
    assert plane.rms == pytest.approx(0.05, rel=0.05)
    assert np.sqrt(np.mean(distance**2)) == pytest.approx(plane.rms, rel=1e-9)
    assert plane.distance(plane.centroid[None] + [0, 0, 1.0])[0] > 0.99


def test_neighbourhood_knows_local_normals_and_leaves_gaps_open():
    p_m = patch(np.random.default_rng(3), 400, 8, 8)
    p_m = np.vstack([p_m, [[20.0, 0, 0]]])
    near = around(p_m)
    assert (near.index[-1] == -1).all()
    assert (near.index[:-1] != 400).all()
    np.testing.assert_allclose(near.normal[:-1], np.tile([0, 0, 1.0], (400, 1)), atol=1e-9)
    assert near.residual[:-1].max() < 1e-7
    assert not (near.index == np.arange(401)[:, None]).any()


def roof_and_crown(seed=4):
    """Two faces of a gable at 4 points/m², and a crown beside it: points (V, 3), what (V,)."""
    rng = np.random.default_rng(seed)
    roof, side = gable(rng, per_m2=4.0, sigma=0.01)
    leaves = crown(rng, (7.0, 0.0, 5.0), count=300)
    return np.vstack([roof, leaves]), np.concatenate([side, np.full(len(leaves), 2)])


def test_ransac_finds_both_faces_first_and_hardly_a_leaf():
    p_m, what = roof_and_crown()
    everything = np.arange(len(p_m))
    sets = ransac_planes(p_m, around(p_m), everything, RANSAC, np.random.default_rng(0))
    assert 2 <= len(sets) <= RANSAC.max_sets
    assert {np.bincount(what[s]).argmax() for s in sets[:2]} == {0, 1}
    assert min(np.bincount(what[s], minlength=3)[:2].max() / len(s) for s in sets[:2]) > 0.97
    # faces lose the rows at the ridge, whose normals are of both sides
    assert sum(len(s) for s in sets[:2]) > 0.8 * (what < 2).sum()
    assert all(len(s) >= RANSAC.min_inliers for s in sets)
    together = np.concatenate(sets)
    assert len(np.unique(together)) == len(together)


@pytest.mark.parametrize(("pitch_deg", "expected"), [(5.0, 0), (12.0, 1), (70.0, 1), (85.0, 0)])
def test_ransac_takes_slopes_of_table_2_only(pitch_deg, expected):
    p_m = patch(np.random.default_rng(5), 200, 6, 6, sigma=0.01)
    c, s = np.cos(np.radians(pitch_deg)), np.sin(np.radians(pitch_deg))
    p_m = p_m @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    params = replace(RANSAC, tolerance_m=0.05)
    sets = ransac_planes(p_m, around(p_m), np.arange(200), params, np.random.default_rng(0))
    large = [s for s in sets if len(s) > 150]
    assert len(large) == expected


def test_ransac_asks_for_min_inliers_and_repeats_with_its_generator():
    p_m, _ = roof_and_crown()
    near, everything = around(p_m), np.arange(len(p_m))
    few = replace(RANSAC, min_inliers=len(p_m))
    assert ransac_planes(p_m, near, everything, few, np.random.default_rng(0)) == []
    one, two = (
        ransac_planes(p_m, near, everything, RANSAC, np.random.default_rng(7)) for _ in range(2)
    )
    assert [a.tolist() for a in one] == [b.tolist() for b in two]


def test_growing_separates_what_a_gap_separates():
    rng = np.random.default_rng(6)
    p_m = np.vstack([patch(rng, 300, 8, 8), patch(rng, 200, 8, 8) + np.array([20.0, 0, 0])])
    label = grow_regions(around(p_m), np.zeros(500, dtype=int), GROWING)
    assert len(set(label[:300])) == 1
    assert len(set(label[300:])) == 1
    assert label[0] != label[300]
    assert (label >= 0).all()


def test_growing_stops_at_a_ridge():
    """|n_c.n_b| > cos(angle) joins; with the printed sign a segment would only cross the ridge."""
    p_m, side = gable(np.random.default_rng(7), per_m2=6.0)
    label = grow_regions(around(p_m), np.zeros(len(p_m), dtype=int), GROWING)
    one, other = (label == number for number in np.argsort(-np.bincount(label[label >= 0]))[:2])
    # a point at the ridge may carry the normal of the other side
    assert abs(side[one].mean() - side[other].mean()) > 0.98
    assert (one | other).mean() > 0.7


def test_growing_joins_a_bent_sheet_when_the_angle_allows():
    p_m = patch(np.random.default_rng(8), 1200, 20, 10)
    p_m[:, 2] = p_m[:, 0] ** 2 / 40  # turns by 2.9 degrees a metre
    ones = np.zeros(len(p_m), dtype=int)
    wide = grow_regions(around(p_m), ones, replace(GROWING, angle_deg=10.0))
    narrow = grow_regions(around(p_m), ones, replace(GROWING, angle_deg=0.3))
    assert np.bincount(wide[wide >= 0]).max() > 0.95 * len(p_m)
    assert np.bincount(narrow[narrow >= 0]).max() < 0.5 * len(p_m)


def test_growing_stays_in_its_group_and_out_of_minus_one():
    p_m = patch(np.random.default_rng(9), 400, 10, 10)
    group = np.where(p_m[:, 0] > 1.0, 0, np.where(p_m[:, 0] > -1.0, -1, 1))
    label = grow_regions(around(p_m), group, GROWING)
    np.testing.assert_array_equal(label == -1, group == -1)
    assert set(label[group == 0]).isdisjoint(label[group == 1])
