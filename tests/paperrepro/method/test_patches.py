"""Patches of any kind: level, sloped, upright; what is no plane is none."""

import numpy as np
import pytest

from paperrepro.method.patches import PatchParameters, find_patches, tiles

FINE = PatchParameters.fine(4.0)


def square(normal, centre, rng, size=12.0, density=30.0, noise=0.02):
    """Points on a square with ``normal``, evenly drawn."""
    n = np.asarray(normal, float) / np.linalg.norm(normal)
    _, _, rows = np.linalg.svd(n[None])
    q = rng.uniform(-size / 2, size / 2, (int(density * size**2), 2)) @ rows[1:]
    return q + centre + noise * rng.normal(size=(len(q), 1)) * n


@pytest.mark.parametrize(
    ("normal", "axis"), [((0, 0, 1), 2), ((0.3, 0.2, 0.9), 2), ((1, 0.1, 0.05), 0), ((0, 1, 0), 1)]
)
def test_a_plane_of_any_slope_is_cut_into_tiles_that_lie_on_it(normal, axis):
    rng = np.random.default_rng(1)
    p_m = square(normal, [50.0, -20.0, 10.0], rng)
    found = find_patches(p_m, FINE)
    n = np.asarray(normal, float) / np.linalg.norm(normal)
    assert len(found) >= 4
    assert (found.tile[:, 0] == axis).all()
    assert np.abs(found.normal @ n).min() > np.cos(np.radians(1.0))
    assert np.abs((found.centroid - [50.0, -20.0, 10.0]) @ n).max() < 0.01
    np.testing.assert_allclose(np.median(found.rms), 0.02, atol=0.004)
    for k in range(len(found)):
        place = tiles(p_m[found.members(k)], np.full(len(found.members(k)), axis), 4.0)
        # voxels are cut whole, so a point may lie a voxel beyond its tile's edge
        assert np.abs(place - found.tile[k, 1:]).max() <= 1


def test_two_surfaces_in_one_tile_stay_apart():
    rng = np.random.default_rng(2)
    low, high = (square((0, 0, 1), [2.0, 2.0, z], rng, size=3.6) for z in (0.0, 3.0))
    found = find_patches(np.vstack([low, high]), FINE)
    assert sorted(found.centroid[:, 2].round(1).tolist()) == [0.0, 3.0]


def test_a_crown_gives_no_patches():
    rng = np.random.default_rng(3)
    crown = rng.normal(0.0, 1.5, (4000, 3))
    assert len(find_patches(crown, FINE)) <= 1  # chance makes a plane of some


def test_a_lane_is_too_narrow():
    rng = np.random.default_rng(4)
    lane = np.column_stack([rng.uniform(0, 40, 3000), rng.uniform(0, 0.6, 3000), np.zeros(3000)])
    assert len(find_patches(lane, FINE)) == 0


@pytest.mark.parametrize("count", [0, 3])
def test_few_points_make_no_patch(count):
    assert len(find_patches(np.zeros((count, 3)), FINE)) == 0
