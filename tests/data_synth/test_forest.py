"""The forest: a stand between houses; the farm is what it was before there was a forest."""

import numpy as np
import pytest

from data_synth import ObjectClass, make_config, simulate
from data_synth.farm import build_farm
from data_synth.forest import N_TREES, SITES, STAND_EXTENT, STEM_SPACING, build_forest, draw_stand
from data_synth.presets import SCENES
from data_synth.simulation import BUILDERS
from data_synth.terrain import draw_ground


@pytest.fixture(scope="module")
def forest():
    return build_forest(np.random.default_rng(1))


def test_every_scene_has_its_builder():
    assert set(BUILDERS) == set(SCENES)
    assert make_config().scene == "farm"


def test_the_default_farm_is_that_of_old(noisy):
    """Numbers of seed 1 from before there was a choice of scenes; libraries of mathematics may
    differ in the last digit, hence the tolerance."""
    survey, truth = noisy
    vertices = truth.scene.vertices
    assert vertices.shape == (126356, 3)
    assert len(truth.scene.triangles) == 55466
    assert np.abs(vertices).sum() == pytest.approx(11023079.306785041, rel=1e-12)
    weighted = vertices @ [1.0, 2.0, 3.0] @ np.cos(np.arange(len(vertices)))
    assert weighted == pytest.approx(3232.2994014339206, rel=1e-9)
    expected = [187674, 187586, 187683, 187474, 187520, 187470, 187548, 187687]
    assert [len(strip.rho) for strip in survey.strips] == expected
    assert survey.strips[0].rho.astype(float).sum() == pytest.approx(6922410.889517265, rel=1e-9)


def test_naming_the_farm_changes_no_bit(noisy):
    _, truth = noisy
    seeds = np.random.SeedSequence(make_config(scene="farm").seed).spawn(6)
    farm = build_farm(np.random.default_rng(seeds[0]))
    np.testing.assert_array_equal(farm.vertices, truth.scene.vertices)
    np.testing.assert_array_equal(farm.triangles, truth.scene.triangles)


def test_forest_has_a_gable_house_at_each_site(forest):
    assert len(forest.faces) == 2 * len(SITES)
    for face in forest.faces:
        middle = np.array(SITES[face.building])
        assert np.hypot(*(face.centroid[:2] - middle)) < 10.0


def test_stems_stand_apart_and_within_the_stand():
    rng = np.random.default_rng(2)
    trees = draw_stand([], draw_ground(rng), rng)
    stems = np.array([(tree.x, tree.y) for tree in trees])
    assert len(stems) == N_TREES
    assert (np.abs(stems) <= STAND_EXTENT).all()
    apart = np.hypot(*(stems[:, None] - stems[None]).transpose(2, 0, 1))
    assert apart[np.triu_indices(N_TREES, 1)].min() > STEM_SPACING
    assert all(8 <= tree.height <= 18 and tree.stem < tree.height for tree in trees)


def test_pulses_reach_the_ground_below_the_stand():
    survey, truth = simulate(make_config(scene="forest"))
    classes = np.concatenate(truth.classes)
    assert (classes == ObjectClass.LEAF).mean() > 0.1
    assert (classes == ObjectClass.GROUND).mean() > 0.3
    assert len(survey.strips) == 8
