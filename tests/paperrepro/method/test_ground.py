"""The progressive morphological filter: its windows, its thresholds, and what it calls ground."""

from dataclasses import replace

import numpy as np
import pytest

from paperrepro.method.ground import (
    GroundParameters,
    height_thresholds,
    progressive_morphological_filter,
    window_sizes,
)
from tests.paperrepro.method.shapes import crown, gable, ground

TABLE_2 = GroundParameters()


def test_windows_of_table_2_are_exponential():
    assert window_sizes(TABLE_2) == [5, 9, 17, 33]  # 2 b^k + 1, b = 2


def test_windows_of_the_text_are_linear():
    linear = replace(TABLE_2, windows="linear", largest_window_m=17.0)
    assert window_sizes(linear) == [5, 9, 13, 17]  # 2 k b + 1, b = 2


def test_windows_scale_with_the_cell():
    assert window_sizes(replace(TABLE_2, cell_m=2.0)) == [5, 9]


@pytest.mark.parametrize("wrong", [{"windows": "square"}, {"base_cells": 1}, {"base_cells": 0}])
def test_windows_that_do_not_grow_are_refused(wrong):
    with pytest.raises(ValueError, match="PMF windows: expected"):
        window_sizes(replace(TABLE_2, **wrong))


def test_thresholds_follow_the_slope_up_to_the_greatest():
    params = replace(TABLE_2, largest_threshold_m=1.5)
    assert height_thresholds([5, 9, 17, 33], params) == pytest.approx([1.0, 1.2, 1.4, 1.5])


@pytest.mark.parametrize(("windows", "slope"), [("linear", 0.04), ("exponential", 0.09)])
def test_roofs_and_crowns_rise_from_sloping_ground(windows, slope):
    """4 % is rolling ground, 9 % the same with three degrees of boresight."""
    rng = np.random.default_rng(4)
    parts = [ground(rng, slope=slope), gable(rng, (-10, 5))[0], crown(rng, (15, -12, 5.0))]
    parts[1][:, 2] += slope * parts[1][:, 0]
    parts[2][:, 2] += slope * parts[2][:, 0]
    mask = progressive_morphological_filter(np.vstack(parts), replace(TABLE_2, windows=windows))
    on_ground, on_roof, in_crown = np.split(mask, np.cumsum([len(p) for p in parts])[:-1])
    assert on_ground.mean() > 0.995
    assert not on_roof.any()
    assert in_crown.mean() < 0.01


def test_a_building_cut_by_the_edge_of_the_swath_is_no_ground():
    rng = np.random.default_rng(5)
    cloud, roof = ground(rng), gable(rng, (38.0, 0.0), length=20.0)[0]
    p_m = np.vstack([cloud, roof])
    seen = p_m[:, 0] < 40.0
    mask = progressive_morphological_filter(p_m[seen])
    assert not mask[len(cloud) :].any()


def test_ground_that_a_building_hides_does_not_lift_the_rest():
    rng = np.random.default_rng(6)
    cloud, roof = ground(rng), gable(rng)[0]
    visible = (np.abs(cloud[:, :2]) > [4.5, 7.0]).any(axis=1)
    mask = progressive_morphological_filter(np.vstack([cloud[visible], roof]))
    assert mask[: visible.sum()].all()
    assert not mask[visible.sum() :].any()


def test_water_that_returns_nothing_does_not_turn_a_house_beside_it_into_ground():
    rng = np.random.default_rng(7)
    cloud, roof = ground(rng), gable(rng, (-12.0, 0.0))[0]
    shore = np.hypot(*cloud[:, :2].T) > 7.4
    mask = progressive_morphological_filter(np.vstack([cloud[shore], roof]))
    assert mask[: shore.sum()].all()
    assert not mask[shore.sum() :].any()


def test_no_points_no_ground():
    assert progressive_morphological_filter(np.empty((0, 3))).shape == (0,)
