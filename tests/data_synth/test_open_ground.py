"""Yard and fields: no gable, what stands stands on the ground, and small planes are planes."""

import numpy as np
import pytest

from data_synth import ObjectClass
from data_synth.buildings import Plot
from data_synth.open_ground import CONTAINER, add_car, build_fields, build_yard
from data_synth.scene import SceneBuilder


@pytest.fixture(scope="module", params=[0, 1, 2])
def yard(request):
    return build_yard(np.random.default_rng(request.param))


def corners_of(scene, kind: ObjectClass) -> np.ndarray:
    """(T, 3, 3) corners of a class's triangles."""
    return scene.vertices[scene.triangles[scene.triangle_class == kind]]


def test_a_yard_has_all_but_gables(yard):
    present = set(yard.triangle_class.tolist())
    kinds = {ObjectClass.CAR, ObjectClass.CONTAINER, ObjectClass.HEAP, ObjectClass.WALL}
    assert kinds <= present
    assert not yard.faces
    assert ObjectClass.GABLE_ROOF not in present


def test_containers_are_of_twenty_feet_and_upright(yard):
    """Nine triangles would be no box: four sides and a lid have ten."""
    boxes = corners_of(yard, ObjectClass.CONTAINER).reshape(-1, 10, 3, 3)
    normal = yard.planes[yard.triangle_class == ObjectClass.CONTAINER, 2]
    assert (np.isclose(np.abs(normal), 1.0) | np.isclose(normal, 0.0, atol=1e-9)).all()
    for box in boxes:
        lid = box[8:].reshape(-1, 3)
        sides = np.linalg.norm(lid[[1, 2]] - lid[[0, 1]], axis=1)
        np.testing.assert_allclose(np.sort(sides), (CONTAINER[1], CONTAINER[0]), rtol=1e-9)


def test_heaps_have_planar_sides_at_the_angle_of_repose(yard):
    normal = yard.planes[yard.triangle_class == ObjectClass.HEAP, 2]
    slope = np.degrees(np.arccos(np.abs(normal)))
    sides = slope[slope > 1.0]
    assert len(sides) == 8 * 8 * 2
    # the flat sides of an octagon are steeper than its edges by 1 / cos(22.5 deg)
    assert sides.min() > 27.0
    assert sides.max() < 41.0


def test_a_car_is_as_long_as_its_plot_and_a_metre_and_a_half_high():
    builder = SceneBuilder()
    add_car(builder, Plot(0.0, 0.0, np.pi / 2, 4.5, 1.8, 100.0))
    vertices = builder.build().vertices
    np.testing.assert_allclose(np.ptp(vertices[:, :2], axis=0), (4.5, 1.8), atol=1e-9)
    np.testing.assert_allclose(vertices[:, 2].max() - 100.0, 1.45)


def test_fields_are_ground_and_trees_and_slopes_where_asked_for():
    plain, natural = (
        build_fields(np.random.default_rng(1), 1.0, rng) for rng in (None, np.random.default_rng(2))
    )
    kinds = {ObjectClass.GROUND, ObjectClass.LEAF, ObjectClass.TRUNK}
    kinds |= {ObjectClass.FENCE, ObjectClass.WIRE}
    for scene in (plain, natural):
        assert set(scene.triangle_class.tolist()) == kinds
    steepest = [
        np.arccos(scene.planes[scene.triangle_class == ObjectClass.GROUND, 2]).max()
        for scene in (plain, natural)
    ]
    assert np.degrees(steepest[0]) < 3.0
    assert np.degrees(steepest[1]) > 20.0
