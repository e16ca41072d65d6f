"""A simulated survey against its truth, through the method's own LiDAR equation.

The simulator does not share that equation, so agreement here checks the signs of both.
"""

import json
import tomllib
from dataclasses import replace

import laspy
import numpy as np
import pytest
from scipy.spatial import cKDTree

from data_synth import ObjectClass
from data_synth.operator import write_survey
from data_synth.recording import DUST_SHARE
from data_synth.sensors import SCANNERS, azimuth_at
from paperrepro.errors import BadInput
from paperrepro.method.georeference import georeference
from paperrepro.survey import Rays


def rays_at(poses, survey, strip, index) -> Rays:
    ring, own = strip.ring[index], strip.elevation
    elevation = survey.scanner.beam_elevations[ring] if own is None else own[index]
    return Rays(
        poses.at(strip.time[index]), ring, strip.azimuth[index], elevation, strip.rho[index]
    )


def on_faces(poses, survey, truth, k: int):
    """Residuals m from the truth planes, points (M, 3), rays and faces of strip k's roof points."""
    index = np.flatnonzero(truth.labels[k] >= 0)
    rays = rays_at(poses, survey, survey.strips[k], index)
    p_m = georeference(rays, truth.mounting)
    face = truth.labels[k][index]
    normal = np.array([f.normal for f in truth.faces])[face]
    d = np.array([f.d for f in truth.faces])[face]
    return np.einsum("ij,ij->i", normal, p_m) - d, p_m, rays, face


def cloud(poses, survey, truth, k: int) -> np.ndarray:
    rays = rays_at(poses, survey, survey.strips[k], slice(None))
    return georeference(rays, truth.mounting)


@pytest.mark.parametrize("k", range(8))
def test_true_poses_and_mounting_put_points_on_their_planes(exact, k):
    survey, truth = exact
    residual, *_ = on_faces(truth.motion, survey, truth, k)
    assert len(residual) > 5000
    assert np.abs(residual).max() < 1e-9


def test_the_trajectory_of_200_hz_is_as_good_as_the_motion(exact):
    survey, truth = exact
    residual, *_ = on_faces(survey.trajectory, survey, truth, 1)
    assert np.abs(residual).max() < 1e-4
    assert residual.std() < 1e-5


def test_points_lie_within_the_face_they_are_labelled_with(exact):
    survey, truth = exact
    _, p_m, _, face = on_faces(truth.motion, survey, truth, 6)
    for one in np.unique(face):
        a, b, _, d = truth.faces[one].corners
        for side in (b - a, d - a):
            share = (p_m[face == one] - a) @ side / (side @ side)
            assert share.min() > -1e-4
            assert share.max() < 1 + 1e-4


def test_the_known_mounting_misses_by_the_boresight(exact):
    """About a degree at 30 m: decimetres, ten times any noise."""
    survey, truth = exact
    rays = rays_at(truth.motion, survey, survey.strips[0], truth.labels[0] >= 0)
    shift = georeference(rays, survey.mounting) - georeference(rays, truth.mounting)
    assert 0.4 < np.linalg.norm(shift, axis=1).mean() < 1.5


def test_residual_noise_along_the_beam_is_the_range_noise(noisy):
    """Steep hits only: elsewhere angle noise adds. 2 cm to 3 %."""
    survey, truth = noisy
    pooled = []
    for k in range(8):
        residual, _, rays, face = on_faces(truth.motion, survey, truth, k)
        longer = Rays(rays.pose, rays.ring, rays.azimuth, rays.elevation, rays.rho + 1.0)
        beam = georeference(longer, truth.mounting) - georeference(rays, truth.mounting)
        slope = np.einsum("ij,ij->i", np.array([f.normal for f in truth.faces])[face], beam)
        pooled.append((residual / slope)[slope < -0.95])
    pooled = np.concatenate(pooled)
    assert len(pooled) > 10_000
    assert pooled.std() == pytest.approx(survey.scanner.range_sigma, rel=0.03)
    assert abs(pooled.mean()) < 5 * survey.scanner.range_sigma / np.sqrt(len(pooled))


def test_recorded_azimuths_have_the_encoder_noise(noisy, exact):
    error = noisy[0].strips[2].azimuth - azimuth_at(noisy[0].strips[2].time)
    assert error.std() == pytest.approx(noisy[0].scanner.angle_sigma, rel=0.02)
    strip = exact[0].strips[2]
    np.testing.assert_array_equal(strip.azimuth, azimuth_at(strip.time))


def test_a_few_returns_are_dust(noisy, exact):
    classes = np.concatenate(noisy[1].classes)
    dust = (classes == ObjectClass.DUST).sum()
    expected = DUST_SHARE * len(classes)
    assert abs(dust - expected) < 5 * np.sqrt(expected)
    assert (np.concatenate(noisy[1].labels)[classes == ObjectClass.DUST] == -1).all()
    assert not (np.concatenate(exact[1].classes) == ObjectClass.DUST).any()


def test_labels_and_classes_agree(noisy):
    _, truth = noisy
    for label, kind in zip(truth.labels, truth.classes, strict=True):
        np.testing.assert_array_equal(label >= 0, kind == ObjectClass.GABLE_ROOF)
        assert label.dtype == np.int32
        assert kind.dtype == np.uint8


def test_most_faces_are_seen_by_several_strips(noisy):
    _, truth = noisy
    seen = [[(label == face.id).sum() > 100 for face in truth.faces] for label in truth.labels]
    assert (np.sum(seen, axis=0) >= 2).sum() >= 20


def test_crowns_let_pulses_through(exact):
    """Within a metre of the trunks both leaves and the ground below them answer."""
    survey, truth = exact
    scene = truth.scene
    trunk = scene.vertices[scene.triangles[scene.triangle_class == ObjectClass.TRUNK]]
    stems = trunk.mean(axis=1)[:, :2]
    stems = stems[np.abs(stems).max(axis=1) < 50]
    p_m, kind = cloud(truth.motion, survey, truth, 0), truth.classes[0]
    near = cKDTree(stems).query(p_m[:, :2], distance_upper_bound=1.0)[0] < 1.0
    leaves, ground = ((near & (kind == k)).sum() for k in (ObjectClass.LEAF, ObjectClass.GROUND))
    assert leaves + ground > 300
    assert 0.1 < ground / (ground + leaves) < 0.6


def test_density_near_the_track_is_a_sixteenth_of_300(exact):
    """At full density 300 points per square metre within 20 m of the track, 200 over the swath."""
    survey, truth = exact
    p_m = cloud(truth.motion, survey, truth, 0)
    middle = (np.abs(p_m[:, 0]) < 20) & (np.abs(p_m[:, 1]) < 50)
    assert middle.sum() / (40 * 100) * 16 == pytest.approx(300, rel=0.2)


def test_strips_are_in_time_in_range_and_hold_all_rings(noisy):
    survey, truth = noisy
    for strip, line, kind in zip(survey.strips, truth.lines, truth.classes, strict=True):
        assert strip.check().name == line.name
        assert (np.diff(strip.time) > 0).all()
        assert line.start_time <= strip.time[0] < strip.time[-1] <= line.end_time + 1e-4
        assert strip.rho.max() < 100.1
        assert strip.rho[kind != ObjectClass.DUST].min() > 15  # nothing stands that high
        assert np.unique(strip.ring).tolist() == list(range(16))


def test_reference_covers_the_site_at_five_points_per_square_metre(exact):
    reference = exact[0].reference
    inner = reference[(np.abs(reference[:, :2]) < (90, 60)).all(axis=1)]
    assert len(inner) / (180 * 120) == pytest.approx(5.0, rel=0.05)


def face_residuals(reference, face):
    """Residuals of the reference points seen inside a face from above, its rim left out."""
    a, b, _, d = face.corners
    inside = np.ones(len(reference), bool)
    for side in ((b - a)[:2], (d - a)[:2]):
        share = (reference[:, :2] - a[:2]) @ side / (side @ side)
        inside &= (share > 0.15) & (share < 0.85)
    return reference[inside] @ face.normal - face.d


def test_reference_lies_on_the_roofs_but_for_its_stated_noise(exact, noisy):
    for face in noisy[1].faces:
        clean = face_residuals(exact[0].reference, face)
        assert np.median(np.abs(clean)) < 1e-9
    pooled = [face_residuals(noisy[0].reference, face) for face in noisy[1].faces]
    spread = np.array([1.4826 * np.median(np.abs(r - np.median(r))) for r in pooled])
    assert np.median(spread) == pytest.approx(0.03, rel=0.15)


def test_reference_is_shifted_as_a_whole(exact, noisy):
    """Plane by plane the offsets are those of one shift vector, up to the points' noise."""
    faces = noisy[1].faces
    offset = np.array([np.median(face_residuals(noisy[0].reference, face)) for face in faces])
    normal = np.array([face.normal for face in faces])
    shift, *_ = np.linalg.lstsq(normal, offset, rcond=None)
    assert np.std(offset - normal @ shift) < 0.01
    assert 0.01 < np.linalg.norm(shift) < 0.4


def test_another_scanner_over_a_larger_site(thin):
    """32 beams, a row of houses more, two lines of which each has its height; the reference
    reaches as far as the houses do."""
    plan = [
        {"offset_m": -20.0, "heading_deg": 0, "length_m": 60.0},
        {"offset_m": 20.0, "heading_deg": 180, "length_m": 60.0, "height_m": 45.0},
    ]
    survey, truth = thin(
        site_rows=6, site_columns=9, scanner="HDL-32E", plan=plan, beam_elevation_sigma_deg=0.0
    )
    assert survey.scanner.n_rings == len(truth.range_offsets) == 32
    assert {len(np.unique(strip.ring)) for strip in survey.strips} == {32}
    assert len({face.building for face in truth.faces}) == 6 * 9 - 6 * 9 // 5
    for k in (0, 1):
        residual, *_ = on_faces(truth.motion, survey, truth, k)
        assert len(residual) > 100
        assert np.abs(residual).max() < 1e-9
    houses = np.array([face.centroid for face in truth.faces])
    cells = {tuple(cell) for cell in np.floor(survey.reference[:, :2] / 5.0).astype(int)}
    assert all(tuple(cell) in cells for cell in np.floor(houses[:, :2] / 5.0).astype(int))


def test_a_line_beside_the_site_is_refused(thin):
    with pytest.raises(BadInput, match="line away: no pulse meets anything"):
        thin(plan=[{"name": "away", "offset_m": 2000.0, "heading_deg": 0}])


@pytest.mark.parametrize(("scanner", "rings"), [("line", 1), ("solid-state", 0)])
def test_scanners_without_rings_measure_the_same_roofs(thin, scanner, rings):
    survey, truth = thin(scanner=scanner)
    assert len(survey.scanner.beam_elevations) == rings
    for k, strip in enumerate(survey.strips[:2]):
        assert (strip.elevation is None) == bool(rings)
        residuals, *_ = on_faces(truth.motion, survey, truth, k)
        assert len(residuals) > 400
        assert np.abs(residuals).max() < 1e-9


#: Scanners without rings, and what an operator calls their kind.
KINDS = {"line": "line", "solid-state": "any"}


@pytest.fixture(scope="module", params=KINDS)
def over_a_yard(request, thin):
    """A scanner without rings, one line over a yard, a beam off by half a degree: its name, survey
    and truth."""
    plan = [{"name": "F1", "offset_m": 0.0, "heading_deg": 0}]
    of = {"scene": "yard", "plan": plan, "beam_elevation_sigma_deg": 0.5}
    return request.param, *thin(scanner=request.param, **of)


def test_scanners_without_rings_measure_containers_cars_and_heaps(over_a_yard):
    _, survey, truth = over_a_yard
    (off,) = truth.scanner_errors.elevation_offsets
    assert abs(off) > np.radians(0.05)
    for kind in ObjectClass.CONTAINER, ObjectClass.CAR, ObjectClass.HEAP:
        rays = rays_at(truth.motion, survey, survey.strips[0], truth.classes[0] == kind)
        planes = truth.scene.planes[truth.scene.triangle_class == kind]
        true, told = (
            np.abs(georeference(r, truth.mounting) @ planes[:, :3].T - planes[:, 3]).min(axis=1)
            for r in (replace(rays, elevation=rays.elevation + off), rays)
        )
        assert len(true) > 20
        assert true.max() < 1e-9
        assert told.max() > 1e-3


def test_files_of_scanners_without_rings_say_of_which_kind_they_are(over_a_yard, tmp_path):
    name, survey, truth = over_a_yard
    write_survey(tmp_path, survey, truth)
    points = laspy.read(tmp_path / "F1.laz")
    assert len(points) == len(survey.strips[0])
    assert not np.any(points.user_data)
    told = tomllib.loads((tmp_path / "mounting.toml").read_text())["scanner"]
    assert told["kind"] == KINDS[name]
    assert "beam_elevations_deg" not in told
    assert told["range_sigma_m"] == survey.scanner.range_sigma
    true = json.loads((tmp_path / "truth.json").read_text())
    of_beams = "range_offsets_m", "beam_elevation_offsets_deg", "beam_azimuth_offsets_deg"
    assert all(len(true[each]) == 1 for each in of_beams)


def test_angle_noise_leaves_the_recorded_elevation_nominal(thin):
    plan = [{"name": "F1", "offset_m": 0.0, "heading_deg": 0}]
    survey, _ = thin(scanner="solid-state", scene="yard", plan=plan, sensor_noise=True)
    (strip,) = survey.strips
    azimuth, elevation = SCANNERS["solid-state"].directions(strip.time, strip.ring)
    np.testing.assert_array_equal(strip.elevation, elevation)
    assert (strip.azimuth - azimuth).std() == pytest.approx(survey.scanner.angle_sigma, rel=0.1)
