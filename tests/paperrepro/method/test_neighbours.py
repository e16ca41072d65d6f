"""Mean distances to neighbours: the grid's are those of a tree, on clouds that try to break it."""

import numpy as np
import pytest

from paperrepro.method import outliers
from paperrepro.method.outliers import by_tree, mean_neighbour_distance

K = 16


def spread(rng, count=4000):
    """A surface, denser towards one side."""
    p_m = rng.uniform(0, 20, (count, 3)) ** [2, 1, 0.3]
    p_m[:, 2] *= 0.1
    return p_m


def shapes():
    rng = np.random.default_rng(5)
    surface = spread(rng)
    column = rng.normal(size=(300, 3)) * [0.05, 0.05, 6.0] + [80, 9, 6]
    line = np.column_stack([np.linspace(0, 400, 500), np.full(500, 7.0), np.full(500, 9.0)])
    dust = np.column_stack([rng.uniform(0, 20, (20, 2)), rng.uniform(10, 40, 20)])
    far = np.array([[5e4, -3e4, 0.0], [-2e5, 0.0, 1e3]])
    crossing = np.vstack([surface, surface[:, [1, 0, 2]] + [0, 300, 0]])
    return {
        "surface": surface,
        "columns, a wire and dust": np.vstack([surface, column, line, dust]),
        "points far away": np.vstack([surface, far]),
        "two places": np.vstack([surface, surface + 9e3]),
        "two strips": crossing,
        "points that coincide": np.vstack([surface, np.repeat(surface[:3], 30, axis=0)]),
        "a regular grid": np.argwhere(np.ones((40, 40, 2))).astype(float),
        "one line": line,
        "few points": surface[: K + 1],
        "coordinates of a map grid": surface + np.array([6.7e5, 7.15e6, 900.0]),
    }


@pytest.mark.parametrize("name", shapes())
def test_grid_and_tree_agree(name):
    p_m = shapes()[name][::-1].copy()
    expected = by_tree(p_m - p_m.mean(axis=0), K)
    exact = np.abs(p_m).max() * 1e-15 * 10  # differences of coordinates this large
    np.testing.assert_allclose(mean_neighbour_distance(p_m, K), expected, rtol=1e-13, atol=exact)


@pytest.mark.parametrize("name", ["surface", "columns, a wire and dust", "points far away"])
def test_a_surface_is_searched_by_the_grid(name, monkeypatch):
    """The comparison above must not be one of the tree with itself."""
    monkeypatch.setattr(outliers, "by_tree", None)
    assert len(mean_neighbour_distance(shapes()[name], K)) > 0


def test_what_no_grid_fits_goes_to_the_tree(monkeypatch):
    monkeypatch.setattr(outliers, "_by_grid", None)
    assert len(mean_neighbour_distance(shapes()["two places"], K)) > 0


def test_more_points_at_one_distance_than_there_is_room_for():
    """Heaps of equal points and a full search table; distances are 0 or those to the next heap."""
    rng = np.random.default_rng(6)
    heap = np.repeat([[10.0, 10.0, 0.0]], outliers.ROOM + 50, axis=0)
    p_m = np.vstack([spread(rng, 400_000), heap])
    distance = mean_neighbour_distance(p_m, K)
    assert distance[-1] == 0.0
    alone = rng.integers(len(p_m), size=200)
    squared = np.square(p_m[alone, None, :2] - p_m[None, :, :2]).sum(axis=2)
    squared += np.square(p_m[alone, None, 2] - p_m[None, :, 2])
    nearest = np.sqrt(np.partition(squared, K, axis=1)[:, : K + 1])
    np.testing.assert_allclose(distance[alone], nearest.sum(axis=1) / K, rtol=1e-12)


def test_threads_and_chunks_do_not_show(monkeypatch):
    p_m = spread(np.random.default_rng(7))
    expected = mean_neighbour_distance(p_m, K)
    monkeypatch.setattr(outliers, "OCCUPANCY", 0.7)
    np.testing.assert_allclose(mean_neighbour_distance(p_m, K), expected, rtol=1e-13)
