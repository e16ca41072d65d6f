"""Surfaces that are no planes: the same for all, about their planes, of the stated size."""

import numpy as np
import pytest

from data_synth import ObjectClass
from data_synth.relief import HeightMap, Relief
from data_synth.scene import roof_face
from data_synth.surfaces import GROUND_STEP, KINDS, draw_reflectivity, ground_map, roof_map
from paperrepro.method.georeference import georeference
from paperrepro.survey import Rays

ROUGHNESS = 0.04


@pytest.fixture(scope="module")
def rough(thin):
    return thin(roof_surface="mixed", ground_roughness_m=ROUGHNESS)


def true_points(survey, truth, k: int) -> np.ndarray:
    strip = survey.strips[k]
    elevation = survey.scanner.beam_elevations[strip.ring]
    pose = truth.motion.at(strip.time)
    return georeference(Rays(pose, strip.ring, strip.azimuth, elevation, strip.rho), truth.mounting)


def over_planes(truth, face: int, p_m) -> np.ndarray:
    one = truth.faces[face]
    return p_m @ one.normal - one.d


@pytest.mark.parametrize("k", [0, 4, 6])
def test_every_strip_sees_the_same_surface(rough, k):
    survey, truth = rough
    p_m, seen = true_points(survey, truth, k), 0
    for face, one in zip(truth.faces, truth.relief.maps, strict=False):
        on_face = truth.labels[k] == face.id
        height = over_planes(truth, face.id, p_m[on_face])
        np.testing.assert_allclose(height, one.at(p_m[on_face]), atol=1e-4)
        seen += on_face.sum()
    assert seen > 300


def test_the_reference_sees_it_too(rough):
    survey, truth = rough
    ground = truth.relief.maps[-1]
    face, one = truth.faces[0], truth.relief.maps[0]
    a, b, _, d = face.corners
    shares = [(survey.reference - a) @ (c - a) / ((c - a) @ (c - a)) for c in (b, d)]
    above = over_planes(truth, 0, survey.reference)
    on_face = np.all([(s > 0.05) & (s < 0.95) for s in shares], axis=0) & (np.abs(above) < 0.1)
    assert on_face.sum() > 100
    off = above[on_face] - one.at(survey.reference[on_face])
    assert np.median(np.abs(off)) < 1e-4
    assert ground.heights.std() == pytest.approx(ROUGHNESS, rel=1e-4)


def test_planes_and_hidden_surfaces_stay_as_they_are(rough, plain):
    for one, other in zip(rough[1].faces, plain[1].faces, strict=True):
        np.testing.assert_array_equal(one.corners, other.corners)
        assert one.d == other.d
    for a, b in zip(rough[1].classes, plain[1].classes, strict=True):
        np.testing.assert_array_equal(a, b)
    on_wall = rough[1].classes[0] == ObjectClass.WALL
    np.testing.assert_array_equal(rough[0].strips[0].rho[on_wall], plain[0].strips[0].rho[on_wall])
    np.testing.assert_array_equal(rough[0].trajectory.position, plain[0].trajectory.position)


def face_of(length: float, depth: float):
    """A face of 30 degrees that falls to the east, its ridge north-south at (5, ., 8)."""
    low = (5 + depth * np.cos(np.pi / 6), 8 - depth * np.sin(np.pi / 6))
    corners = [(5, 0, 8), (5, length, 8), (low[0], length, low[1]), (low[0], 0, low[1])]
    return roof_face(0, 0, np.array(corners, float))


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_has_its_size_about_the_mean_plane(kind):
    one = roof_map(face_of(14.0, 6.0), {kind: 1.0}, 1.0, np.random.default_rng(2))
    heights = one.heights.astype(float)
    assert np.sqrt((heights**2).mean()) == pytest.approx(KINDS[kind][1], rel=1e-4)
    a, b = np.meshgrid(*(np.arange(n) for n in heights.shape), indexing="ij")
    design = np.column_stack([np.ones(a.size), a.ravel(), b.ravel()])
    plane, *_ = np.linalg.lstsq(design, heights.ravel(), rcond=None)
    np.testing.assert_allclose(plane * (1, *heights.shape), 0.0, atol=1e-6)
    twice = roof_map(face_of(14.0, 6.0), {kind: 1.0}, 2.0, np.random.default_rng(2))
    np.testing.assert_allclose(twice.heights, 2 * one.heights, rtol=1e-6)


def test_waves_of_sheets_run_down_the_slope_and_courses_of_tiles_along_it():
    sheet, tile = (
        roof_map(face_of(14.0, 6.0), {kind: 1.0}, 1.0, np.random.default_rng(1)).heights
        for kind in ("corrugated", "tiles")
    )
    assert sheet.std(axis=1).max() < 1e-6
    power = np.abs(np.fft.rfft(sheet[:, 0]))
    assert np.fft.rfftfreq(len(sheet), 0.03)[power.argmax()] == pytest.approx(1 / 0.177, rel=0.02)
    power = np.abs(np.fft.rfft(tile.mean(axis=0)))
    assert 0.30 < 1 / np.fft.rfftfreq(tile.shape[1], 0.03)[power.argmax()] < 0.38


def test_the_ground_repeats_without_a_seam():
    one = ground_map(0.05, np.random.default_rng(0))
    assert one.heights.std() == pytest.approx(0.05, rel=1e-4)
    assert abs(one.heights.mean()) < 1e-6
    p_m = np.random.default_rng(1).uniform(-60, 60, (500, 3))
    shift = one.heights.shape[0] * GROUND_STEP * np.array([1.0, -1.0, 0.0])
    np.testing.assert_allclose(one.at(p_m), one.at(p_m + shift), atol=1e-6)
    inside = np.abs(np.diff(one.heights, axis=0)).std()
    seam = np.abs(one.heights[0] - one.heights[-1]).std()
    assert seam == pytest.approx(inside, rel=0.3)


def test_a_ray_ends_at_its_first_crossing():
    """Against a dense search along each ray, from all sides and at all slopes up to 75 degrees."""
    rng = np.random.default_rng(3)
    heights = 0.05 * rng.standard_normal((60, 60)).astype(np.float32)
    one = HeightMap(heights, np.zeros(3), *np.eye(3)[:2], 0.1)
    count = 400
    tilt, azimuth = rng.uniform(0, np.radians(75), count), rng.uniform(0, 2 * np.pi, count)
    direction = np.column_stack(
        [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)]
    )
    target = np.column_stack([rng.uniform(2, 4, (count, 2)), np.zeros(count)])
    distance = rng.uniform(20, 40, count)
    origin = target - distance[:, None] * direction
    planes = np.array([[0.0, 0.0, 1.0, 0.0]])
    relief, hit = Relief((one,), np.zeros(1, np.int32)), np.zeros(count, np.int32)
    found = distance.copy()
    relief.displace(origin, direction, planes, found, hit)
    p_m = origin + found[:, None] * direction
    np.testing.assert_allclose(p_m[:, 2], one.at(p_m), atol=1e-5)
    late = 0
    for i in range(count):
        along = distance[i] + np.linspace(-1.0, 1.0, 4001) / np.cos(tilt[i]) * 0.25
        points = origin[i] + along[:, None] * direction[i]
        first = along[np.argmax(points[:, 2] <= one.at(points))]
        late += abs(found[i] - first) > 0.01
    assert late <= 0.02 * count  # a crest thinner than a step may be missed


def test_rays_that_miss_or_meet_planes_keep_their_distance():
    one = HeightMap(np.full((4, 4), 0.1, np.float32), np.zeros(3), *np.eye(3)[:2], 1.0)
    relief = Relief((one,), np.array([0, -1], np.int32))
    direction = np.tile([0.0, 0.0, -1.0], (3, 1))
    distance, hit = np.array([5.0, 5.0, np.nan]), np.array([0, 1, -1], np.int32)
    planes = np.array([[0.0, 0.0, 1.0, 0.0]] * 2)
    relief.displace(np.array([[1.0, 1.0, 5.0]] * 3), direction, planes, distance, hit)
    np.testing.assert_allclose(distance, [4.9, 5.0, np.nan], atol=1e-6)


def test_a_roof_has_one_reflectivity(plain):
    scene = plain[1].scene
    value = draw_reflectivity(scene, np.random.default_rng(0))
    assert value.shape == (len(scene.triangles),)
    assert value.min() >= 0.1
    assert value.max() <= 0.7
    for face in scene.faces[::2]:
        same = [value[scene.triangle_face == f.id] for f in scene.faces[face.id : face.id + 2]]
        assert np.ptp(np.concatenate(same)) == 0
    assert len(np.unique(value[scene.triangle_face >= 0])) == len(scene.faces) // 2
