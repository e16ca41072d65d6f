"""Matching patches without outlines, choosing planes, and the footprint that views share."""

import numpy as np

from paperrepro.method.patches import (
    Patches,
    PatchMatchParameters,
    choose,
    match_patches,
    seen_by_all,
)

FINE = PatchMatchParameters(0.3, 4.0, 3.0, same_tile=True)
COARSE = PatchMatchParameters(3.0, 4.0, 10.0, same_tile=False)


def patches(centroid, normal):
    centroid, normal = np.asarray(centroid, float), np.asarray(normal, float)
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    tile = np.column_stack([np.full(len(centroid), 2), np.floor(centroid[:, :2] / 4).astype(int)])
    none = np.zeros(len(centroid))
    return Patches(normal, centroid, none, tile, np.empty(0, int), np.zeros(len(centroid) + 1, int))


def test_same_tile_same_plane_is_a_match_in_every_strip():
    roof, ground = [0.4, 0, 1], [0, 0, 1]
    one = patches([[2, 2, 5], [2, 2, 0]], [roof, ground])
    other = patches([[2.5, 1.5, 0.05], [2.2, 2, 4.95]], [ground, roof])
    ties = match_patches({"F1": one, "F2": other, "F3": one}, FINE)
    assert ties == ((("F1", 0), ("F2", 1), ("F3", 0)), (("F1", 1), ("F2", 0), ("F3", 1)))


def test_another_slope_another_height_and_another_tile_are_none():
    one = patches([[2, 2, 0]], [[0, 0, 1]])
    for centroid, normal in (
        ([2, 2, 0], [0.1, 0, 1]), ([2, 2, 0.5], [0, 0, 1]), ([5, 2, 0], [0, 0, 1]),
    ):  # fmt: skip
        assert match_patches({"F1": one, "F2": patches([centroid], [normal])}, FINE) == ()
    assert len(match_patches({"F1": one, "F2": patches([[5, 2, 0.5]], [[0.1, 0, 1]])}, COARSE)) == 1


def test_each_is_the_others_best():
    one = patches([[2, 2, 0.0]], [[0, 0, 1]])
    two = patches([[2, 2, 0.2], [2.1, 2, 0.01]], [[0, 0, 1], [0, 0, 1]])
    assert match_patches({"F1": one, "F2": two}, FINE) == ((("F1", 0), ("F2", 1)),)
    assert match_patches({"F1": one, "F2": patches(np.empty((0, 3)), np.empty((0, 3)))}, FINE) == ()


def test_rare_directions_are_all_chosen_and_level_ground_is_spread_out():
    rng = np.random.default_rng(0)
    level = np.tile([0, 0, 1.0], (500, 1))
    roofs = np.array([[0.4, 0, 0.9], [-0.4, 0, 0.9], [0, 0.4, 0.9], [1.0, 0, 0]])
    normal = np.vstack([level, roofs])
    centroid = rng.uniform(-100, 100, (len(normal), 3))
    chosen = choose(normal, centroid, np.full(len(normal), 2), 60)
    assert len(chosen) == 60 == len(set(chosen.tolist()))
    assert set(range(500, 504)) <= set(chosen.tolist())
    ground = centroid[chosen[chosen < 500]]
    gap = np.linalg.norm(ground[:, None] - ground, axis=2) + 1e3 * np.eye(len(ground))
    assert gap.min() > 15.0  # 56 drawn at random lie 3 m apart somewhere


def test_views_are_cut_to_what_all_of_them_show():
    rng = np.random.default_rng(1)
    full, half, corner = (
        np.column_stack([rng.uniform(0, [x, y], (2000, 2)), np.zeros(2000)])
        for x, y in ((4, 4), (2, 4), (1, 1))
    )
    members = [np.arange(2000)] * 3
    in_full, in_half, in_corner = seen_by_all(members, [full, half, corner], axis=2, tile_m=4.0)
    assert len(in_corner) == 0
    assert len(in_half) == 2000
    np.testing.assert_array_equal(in_full, np.flatnonzero(full[:, 0] < 2))
