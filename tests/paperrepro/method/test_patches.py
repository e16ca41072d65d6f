"""Patches of any kind that strips share: level, sloped, upright; what is no plane is none."""

import numpy as np
import pytest

from paperrepro.method.patches import PatchParameters, find_patches, varied


def square(normal, centre, rng, size=12.0, density=60.0, noise=0.02):
    """Points on a square with ``normal``, evenly drawn."""
    n = np.asarray(normal, float) / np.linalg.norm(normal)
    _, _, rows = np.linalg.svd(n[None])
    q = rng.uniform(-size / 2, size / 2, (int(density * size**2), 2)) @ rows[1:]
    return q + centre + noise * rng.normal(size=(len(q), 1)) * n


def seen_by_two(*squares, noise=0.02, seed=1, **options):
    """The same squares, (normal, centre) each, as two strips see them."""
    rng = np.random.default_rng(seed)
    return {
        name: np.vstack([square(*of, rng, noise=noise, **options) for of in squares])
        for name in ("F1", "F2")
    }


@pytest.mark.parametrize("normal", [(0, 0, 1), (0.3, 0.2, 0.9), (1, 0.1, 0.05), (0, 1, 0)])
def test_a_plane_of_any_slope_is_covered_by_patches_that_lie_on_it(normal):
    centre = np.array([50.0, -20.0, 10.0])
    clouds = seen_by_two((normal, centre))
    found = find_patches(clouds)
    n = np.asarray(normal, float) / np.linalg.norm(normal)
    assert len(found) >= 20
    for patch in found:
        assert set(patch.views) == {"F1", "F2"}
        assert abs(patch.normal @ n) > np.cos(np.radians(5.0))
        for strip, index in patch.views.items():
            off = clouds[strip][index] - centre
            assert abs(off.mean(axis=0) @ n) < 0.02
            assert np.linalg.norm(clouds[strip][index] - patch.centre, axis=1).max() <= (
                patch.radius_m
            )


def test_no_point_belongs_to_two_patches():
    clouds = seen_by_two(((0, 0, 1), [0, 0, 0]), ((0.4, 0, 1), [20, 0, 3]))
    found = find_patches(clouds)
    assert len({patch.radius_m for patch in found}) > 1
    for strip in clouds:
        index = np.concatenate([patch.views[strip] for patch in found])
        assert len(index) == len(np.unique(index))


def test_large_patches_stand_where_there_is_room_and_small_ones_on_small_things():
    large, small = ((0, 0, 1), [0.0, 0, 0]), ((0, 0, 1), [40.0, 0, 2])
    rng = np.random.default_rng(5)
    clouds = {
        name: np.vstack([square(*large, rng, size=60.0), square(*small, rng, size=1.6)])
        for name in ("F1", "F2")
    }
    found = find_patches(clouds)
    on_small = [patch.radius_m for patch in found if patch.centre[2] > 1]
    assert on_small
    assert max(on_small) < max(patch.radius_m for patch in found)


def test_what_two_strips_see_apart_or_turned_is_no_patch():
    rng = np.random.default_rng(2)
    level = square((0, 0, 1), [0.0, 0, 0], rng)
    for other in ((0, 0, 1), [0.0, 0, 0.5]), ((0.3, 0, 1), [0.0, 0, 0]):
        assert len(find_patches({"F1": level, "F2": square(*other, rng)})) <= 1


def test_a_crown_and_a_lane_give_no_patches():
    rng = np.random.default_rng(3)
    crowns = {name: rng.normal(0.0, 1.5, (8000, 3)) for name in ("F1", "F2")}
    assert len(find_patches(crowns)) <= 2  # chance makes a plane of some
    lanes = {
        name: np.column_stack(
            [rng.uniform(0, 40, 3000), rng.uniform(0, 0.05, 3000), np.zeros(3000)]
        )
        for name in ("F1", "F2")
    }
    assert find_patches(lanes) == []


@pytest.mark.parametrize("count", [0, 3])
def test_few_points_make_no_patch(count):
    assert find_patches({"F1": np.zeros((count, 3)), "F2": np.zeros((count, 3))}) == []


def test_a_third_more_or_less_of_a_threshold_changes_few_patches():
    clouds = seen_by_two(((0, 0, 1), [0, 0, 0]), ((0.4, 0, 1), [20, 0, 3]), noise=0.015)
    usual = len(find_patches(clouds))
    for factor in (0.7, 1.3):
        changed = PatchParameters(
            min_points=round(20 * factor), rms_m=0.06 * factor, roughness=0.14 * factor,
            strangers=0.2 * factor, min_width=0.3 * factor, inclination_deg=3.0 * factor,
            distance_m=0.3 * factor, shift=0.5 * factor,
        )  # fmt: skip
        assert len(find_patches(clouds, changed)) > 0.6 * usual


def test_rare_directions_are_all_chosen_and_level_ground_is_spread_out():
    rng = np.random.default_rng(0)
    level = np.tile([0, 0, 1.0], (500, 1))
    roofs = np.array([[0.4, 0, 0.9], [-0.4, 0, 0.9], [0, 0.4, 0.9], [1.0, 0, 0]])
    normal = np.vstack([level, roofs])
    centroid = rng.uniform(-100, 100, (len(normal), 3))
    chosen = varied(normal, centroid, np.full(len(normal), 2), 60)
    assert len(chosen) == 60 == len(set(chosen.tolist()))
    assert set(range(500, 504)) <= set(chosen.tolist())
    ground = centroid[chosen[chosen < 500]]
    gap = np.linalg.norm(ground[:, None] - ground, axis=2) + 1e3 * np.eye(len(ground))
    assert gap.min() > 15.0  # 56 drawn at random lie 3 m apart somewhere
