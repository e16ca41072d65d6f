"""Natural terrain has planar slopes where nothing stands."""

import numpy as np
import pytest

from data_synth import ObjectClass
from data_synth.buildings import Plot
from data_synth.farm import build_farm
from data_synth.forest import build_forest
from data_synth.terrain import MAX_SLOPE, Slopes, add_features, draw_ground

STEEP = np.radians(20.0), np.radians(35.0)


def natural_farm(seed: int):
    return build_farm(np.random.default_rng(seed), 1.0, np.random.default_rng(100 + seed))


def slope_of(scene) -> np.ndarray:
    """Slopes rad of the ground's triangles."""
    return np.arccos(scene.planes[scene.triangle_class == ObjectClass.GROUND, 2])


def test_heights_of_a_dam_and_a_ditch_by_hand():
    """Sides 1:2 and 1:1 about a crest of 2 m, the long side east."""
    plot = Plot(10.0, 0.0, np.pi / 2, 20.0, 8.0)
    for sign in (1.0, -1.0):
        one = Slopes(plot, 0.5, 1.0, 1.0, sign * 2.0)
        t = plot.axes[1]  # across: south
        across = np.array([-4.0, -3.0, -2.0, 0.0, 1.5, 2.0, 3.0, 4.0, 5.0])
        x, y = 10.0 + across * t[0], across * t[1]
        expected = [0, 0.5, 1, 2, 2, 2, 1, 0, 0]
        np.testing.assert_allclose(one.rise(x, y), sign * np.array(expected), atol=1e-12)
        assert one.rise(19.0, 0.0) == pytest.approx(sign)


@pytest.mark.parametrize("seed", range(5))
def test_there_are_slopes_enough_and_they_are_planar(seed):
    """Some hundred square metres that are steep, most of them in regions of one normal."""
    rng = np.random.default_rng(seed)
    scene = natural_farm(seed)
    ground = scene.triangle_class == ObjectClass.GROUND
    corners, normal = scene.vertices[scene.triangles[ground]], scene.planes[ground, :3]
    area = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    slope = np.arccos(normal[:, 2])
    steep = (slope > STEEP[0] - np.arctan(MAX_SLOPE)) & (slope < STEEP[1] + np.arctan(MAX_SLOPE))
    assert area[steep].sum() > 300.0
    middle = corners.mean(axis=1)
    flat = 0
    chosen = rng.choice(np.flatnonzero(steep), 200)
    for i in chosen:
        near = np.hypot(*(middle[:, :2] - middle[i, :2]).T) < 1.0
        flat += (normal[near] @ normal[i]).min() > np.cos(np.radians(2.0))
    assert flat > 0.2 * len(chosen)


@pytest.mark.parametrize("build", [build_farm, build_forest])
def test_houses_stand_where_they_stood_and_on_no_slope(build):
    plain = build(np.random.default_rng(3))
    natural = build(np.random.default_rng(3), 1.0, np.random.default_rng(103))
    for one, other in zip(plain.faces, natural.faces, strict=True):
        np.testing.assert_array_equal(one.corners, other.corners)
    assert slope_of(plain).max() < np.arctan(MAX_SLOPE)
    assert slope_of(natural).max() > STEEP[0]


def test_features_stay_clear_of_what_stands_and_of_one_another():
    rng = np.random.default_rng(5)
    ground = draw_ground(rng)
    taken = [Plot(x, y, 0.3, 20.0, 12.0) for x in (-72, -36, 0, 36, 72) for y in (-38, 0, 38)]
    plots = [f.plot for f in add_features(ground, taken, rng).features]
    assert len(plots) >= 6
    for k, plot in enumerate(plots):
        assert all(plot.clear_of(other, 1.0) for other in taken + plots[:k])


def test_relief_is_a_factor_on_the_same_ground():
    x, y = np.random.default_rng(0).uniform(-100, 100, (2, 50))
    once, half, level = (draw_ground(np.random.default_rng(1), r) for r in (1.0, 0.5, 0.0))
    np.testing.assert_allclose(half.height(x, y), 0.5 * once.height(x, y), rtol=1e-12)
    assert not level.height(x, y).any()
