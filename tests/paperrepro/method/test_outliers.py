"""Statistical outlier removal on clouds with outliers that the test planted."""

import numpy as np

from paperrepro.method.outliers import statistical_outliers
from tests.paperrepro.method.shapes import ground


def test_removes_planted_outliers_and_nothing_else():
    rng = np.random.default_rng(1)
    cloud = ground(rng, half=20.0)
    alone = np.column_stack([rng.uniform(-20, 20, (15, 2)), np.linspace(8, 40, 15)])
    order = rng.permutation(len(cloud) + len(alone))
    keep = statistical_outliers(np.vstack([cloud, alone])[order])
    np.testing.assert_array_equal(keep, order < len(cloud))


def test_is_mu_plus_alpha_sigma_of_the_mean_distance_to_k_neighbours():
    p_m = np.random.default_rng(2).uniform(0, 10, (300, 3))
    distance = np.sort(np.linalg.norm(p_m[:, None] - p_m, axis=2), axis=1)
    mean = distance[:, 1:6].mean(axis=1)
    keep = statistical_outliers(p_m, k=5, alpha=1.0)
    np.testing.assert_array_equal(keep, mean <= mean.mean() + mean.std())
    assert 0 < (~keep).sum() < 100


def test_a_cloud_of_k_points_is_kept_whole():
    assert statistical_outliers(np.zeros((16, 3)), k=16).all()
    assert statistical_outliers(np.empty((0, 3))).shape == (0,)
