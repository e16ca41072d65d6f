"""Cells and the thinned cloud."""

import numpy as np

from paperrepro.method.cells import thin


def test_each_occupied_voxel_gives_its_mean_and_its_members():
    p_m = np.random.default_rng(1).uniform(-3, 3, (500, 3))
    thinned = thin(p_m, 1.0)
    cell = np.floor((p_m - p_m.min(axis=0)) / 1.0).astype(int)
    assert len(thinned) == len(np.unique(cell, axis=0))
    for voxel in range(len(thinned)):
        members = thinned.members(np.array([voxel]))
        assert len(np.unique(cell[members], axis=0)) == 1
        np.testing.assert_allclose(thinned.p_m[voxel], p_m[members].mean(axis=0))
    everything = thinned.members(np.arange(len(thinned)))
    np.testing.assert_array_equal(np.sort(everything), np.arange(len(p_m)))


def test_members_of_several_voxels_come_voxel_by_voxel():
    thinned = thin(np.random.default_rng(2).uniform(0, 3, (200, 3)), 1.0)
    several = thinned.members(np.array([5, 2]))
    one_by_one = [thinned.members(np.array([voxel])) for voxel in (5, 2)]
    np.testing.assert_array_equal(several, np.concatenate(one_by_one))
    assert len(thinned.members(np.array([], dtype=int))) == 0


def test_nothing_thins_to_nothing():
    assert len(thin(np.empty((0, 3)), 0.5)) == 0
