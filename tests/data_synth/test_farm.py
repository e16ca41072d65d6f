"""Every seed gives a farm that can stand."""

from itertools import combinations

import numpy as np
import pytest

from data_synth import ObjectClass
from data_synth.buildings import Plot
from data_synth.farm import Layout, build_farm
from data_synth.terrain import MAX_SLOPE

SEEDS = (0, 1, 2, 3, 4)
N_GABLE = Layout().n_gable


@pytest.fixture(scope="module", params=SEEDS)
def scene(request):
    return build_farm(np.random.default_rng(request.param))


def footprint(scene, building: int) -> np.ndarray:
    """(4, 2) corners of both faces together: the eaves."""
    a, b = (face.corners for face in scene.faces if face.building == building)
    return np.array([a[3], a[2], b[2], b[3]])[:, :2]


def apart(a: np.ndarray, b: np.ndarray) -> bool:
    for polygon in (a, b):
        for edge in np.roll(polygon, -1, axis=0) - polygon:
            normal = np.array([-edge[1], edge[0]])
            if (a @ normal).max() < (b @ normal).min() or (b @ normal).max() < (a @ normal).min():
                return True
    return False


def test_houses_stand_apart(scene):
    ground_plans = [footprint(scene, number) for number in range(N_GABLE)]
    assert all(apart(a, b) for a, b in combinations(ground_plans, 2))


def test_sheds_stand_apart_from_houses(scene):
    sheds = scene.vertices[scene.triangles[scene.triangle_class == ObjectClass.SHED_ROOF]]
    for number in range(N_GABLE):
        eaves = footprint(scene, number)
        assert all(apart(eaves, triangle[:, :2]) for triangle in sheds)


def test_ground_is_gentle(scene):
    normal_z = scene.planes[scene.triangle_class == ObjectClass.GROUND, 2]
    assert np.tan(np.arccos(normal_z.min())) <= MAX_SLOPE


def test_faces_are_flat_tilted_rectangles_that_meet_in_a_level_ridge(scene):
    assert len(scene.faces) == 2 * N_GABLE
    for face in scene.faces:
        np.testing.assert_allclose(face.corners @ face.normal, face.d, atol=1e-12)
        assert np.linalg.norm(face.normal) == pytest.approx(1.0, abs=1e-15)
        assert 15 <= np.degrees(np.arccos(face.normal[2])) <= 35
        sides = np.linalg.norm(face.corners - np.roll(face.corners, 1, axis=0), axis=1)
        assert face.area == pytest.approx(sides[0] * sides[1])
        np.testing.assert_allclose(face.centroid @ face.normal, face.d, atol=1e-12)
    for one, other in zip(scene.faces[::2], scene.faces[1::2], strict=True):
        assert one.building == other.building
        np.testing.assert_allclose(one.corners[:2], other.corners[:2], atol=1e-12)
        assert one.corners[0, 2] == one.corners[1, 2]


def test_planes_hold_their_triangles(scene):
    corners = scene.vertices[scene.triangles]
    gap = np.einsum("tki,ti->tk", corners, scene.planes[:, :3]) - scene.planes[:, 3:]
    assert np.abs(gap).max() < 1e-11
    on_face = scene.triangle_face >= 0
    np.testing.assert_array_equal(on_face, scene.triangle_class == ObjectClass.GABLE_ROOF)


def test_everything_is_there(scene):
    present = set(scene.triangle_class.tolist())
    of_yards = {ObjectClass.CAR, ObjectClass.CONTAINER, ObjectClass.HEAP}
    assert set(ObjectClass) - present - of_yards <= {ObjectClass.DORMER, ObjectClass.DUST}


def test_azimuths_and_pitches_vary(scene):
    normal = np.array([face.normal for face in scene.faces])
    azimuth = np.degrees(np.arctan2(normal[:, 0], normal[:, 1])) % 180
    assert np.ptp(azimuth) > 90
    assert np.ptp(np.degrees(np.arccos(normal[:, 2]))) > 8


def test_a_plot_knows_its_distance_and_neighbours():
    plot = Plot(10.0, 5.0, np.pi / 2, 8.0, 4.0)  # long side east
    np.testing.assert_allclose(plot.distance([(10, 5), (15, 5), (10, 8), (17, 11)]), [0, 1, 1, 5])
    assert plot.clear_of(Plot(10.0, 10.0, np.pi / 2, 8.0, 4.0), 0.9)
    assert not plot.clear_of(Plot(10.0, 10.0, np.pi / 2, 8.0, 4.0), 1.1)
    assert not plot.clear_of(Plot(12.0, 6.0, 0.3, 8.0, 4.0), 0.0)


def test_the_default_layout_is_three_rows_of_five():
    layout = Layout()
    expected = [(x, y) for x in (-72.0, -36.0, 0.0, 36.0, 72.0) for y in (-38.0, 0.0, 38.0)]
    assert layout.sites == expected
    assert layout.n_gable == 12
    assert layout.middle == 0.0
    np.testing.assert_array_equal(layout.extent, (100.0, 62.0))
    np.testing.assert_array_equal(layout.ground_extent, (200.0, 150.0))


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (2, 4), (5, 6)])
def test_other_layouts_have_their_houses_apart_and_on_the_ground(rows, columns):
    layout = Layout(rows, columns)
    scene = build_farm(np.random.default_rng(1), layout=layout)
    assert len(scene.faces) == 2 * (rows * columns - rows * columns // 5)
    plans = [footprint(scene, number) for number in range(layout.n_gable)]
    assert all(apart(a, b) for a, b in combinations(plans, 2))
    assert (np.abs(np.concatenate(plans)) < layout.extent).all()
    ground = scene.vertices[scene.triangles[scene.triangle_class == ObjectClass.GROUND]]
    assert (np.abs(ground).max(axis=(0, 1))[:2] >= layout.ground_extent).all()
