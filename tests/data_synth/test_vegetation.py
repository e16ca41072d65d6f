"""A crown lets through what leaves at random angles let through."""

import numpy as np
import pytest

from data_synth import ObjectClass
from data_synth.raycast import Raycaster
from data_synth.scene import SceneBuilder
from data_synth.vegetation import LEAF_AREA_INDEX, Tree, add_tree


def test_vertical_pulses_pass_as_the_leaf_area_says():
    """Beer's law with half the leaf area facing the pulse, path by path through the ellipsoid."""
    tree = Tree(x=0.0, y=0.0, base=0.0, height=8.0, radius=3.0, stem=2.0)
    rng = np.random.default_rng(0)
    builder = SceneBuilder()
    for _ in range(20):  # twenty crowns apart
        add_tree(builder, tree, rng)
        tree = Tree(tree.x + 10.0, 0.0, 0.0, 8.0, 3.0, 2.0)
    origin = np.column_stack([rng.uniform(-3, 3, (200_000, 2)), np.full(200_000, 30.0)])
    radius = np.hypot(*origin[:, :2].T)
    origin = origin[(radius < 2.8) & (radius > 0.3)]  # beside the trunk, inside the ragged rim
    radius = np.hypot(*origin[:, :2].T)
    origin[:, 0] += 10.0 * rng.integers(0, 20, len(origin))
    down = np.broadcast_to((0.0, 0.0, -1.0), origin.shape)
    _, triangle = Raycaster(builder.build()).cast(origin, down)
    share_of_path = 1.5 * np.sqrt(1 - (radius / 3.0) ** 2)
    expected = np.exp(-0.5 * LEAF_AREA_INDEX * share_of_path).mean()
    assert 0.15 < expected < 0.5
    assert (triangle < 0).mean() == pytest.approx(expected, rel=0.12)


def test_leaves_stay_in_the_crown():
    builder = SceneBuilder()
    add_tree(builder, Tree(5.0, 6.0, 1.0, 8.0, 3.0, 2.0), np.random.default_rng(1))
    scene = builder.build()
    leaf = scene.vertices[scene.triangles[scene.triangle_class == ObjectClass.LEAF]].mean(axis=1)
    assert (np.hypot(leaf[:, 0] - 5.0, leaf[:, 1] - 6.0) < 3.0).all()
    assert (np.abs(leaf[:, 2] - 6.0) < 3.0).all()
