"""The chain on clouds made by hand and on simulated strips."""

import inspect

import numpy as np
import pytest

from data_synth import ObjectClass, make_config, simulate
from data_synth.evaluation import angles_between, judge_views, true_planes
from paperrepro.method import roofs as roofs_module
from paperrepro.method.georeference import georeference
from paperrepro.method.planes import GrowingParameters, RansacParameters
from paperrepro.method.roofs import RoofParameters, candidates, extract, objects
from tests.paperrepro.method.shapes import crown, gable, ground, hip

FINE, COARSE = RoofParameters(), RoofParameters().coarse()


def farmyard(rng, sigma=0.02):
    """A gable, a crown that touches it, a hip roof, and ground."""
    parts = [
        ground(rng, sigma=sigma),
        gable(rng, (-10.0, 0.0), 40.0, sigma=sigma)[0],
        crown(rng, (-4.5, 5.0, 5.0)),
        hip(rng) + np.array([20.0, 10.0, 0.0]),
    ]
    return np.vstack(parts), np.repeat(np.arange(4), [len(part) for part in parts])


@pytest.mark.parametrize("params", [FINE, COARSE], ids=["fine", "coarse"])
def test_one_gable_among_a_crown_a_hip_roof_and_ground(params):
    p_m, what = farmyard(np.random.default_rng(1))
    index = candidates(p_m)
    assert np.isin(np.flatnonzero(np.isin(what, [1, 3])), index).mean() > 0.999
    assert (what[index] == 0).mean() < 0.01
    found = extract(p_m[index], params, np.random.default_rng(0))
    assert len(found.gables) == 1
    assert len(found.faces) == 2
    assert {found.gables[0].left, found.gables[0].right} == {0, 1}
    for face in found.faces:
        assert (what[index][face.points] == 1).mean() > 0.99
        assert np.degrees(face.slope) == pytest.approx(25.0, abs=0.2)
    miss = found.gables[0].virtual_point - [-10.0, 0.0, 6.0]
    along = miss @ found.gables[0].ridge
    assert abs(along) < 1.0  # the crown hides a corner, which moves a centroid
    assert np.linalg.norm(miss - along * found.gables[0].ridge) < 0.03


def test_table_2_is_what_the_fine_pass_uses():
    assert FINE.ransac == RansacParameters(15, 0.10, (10.0, 80.0), 10)
    assert (FINE.ground.cell_m, FINE.ground.base_cells, FINE.ground.slope) == (1.0, 2, 0.05)
    assert (FINE.ground.windows, FINE.ground.largest_threshold_m) == ("exponential", 10.0)
    assert (FINE.growing.size[0], FINE.growing.max_gap_m) == (40, 4.0)
    # the two that differ from the printed 500 points and 1 degree say why
    assert (FINE.growing.size[1], FINE.growing.angle_deg) == (1000, 3.0)
    reason = inspect.getdoc(GrowingParameters)
    assert "``size`` ends at 1000:" in reason
    assert "``angle_deg`` is 3:" in reason


def test_extraction_repeats_with_its_generator_and_survives_little():
    p_m, _ = farmyard(np.random.default_rng(2))
    p_m = p_m[candidates(p_m)]
    one, two = (extract(p_m, FINE, np.random.default_rng(5)) for _ in range(2))
    assert [f.points.tolist() for f in one.faces] == [f.points.tolist() for f in two.faces]
    for few in (p_m[:0], p_m[:10]):
        assert extract(few, FINE, np.random.default_rng(0)) == roofs_module.Roofs((), ())


def test_objects_are_islands_seen_from_above():
    rng = np.random.default_rng(3)
    one, other = rng.uniform(0, 4, (200, 3)), rng.uniform([8, 0, 0], [12, 4, 4], (200, 3))
    found = objects(np.vstack([one, other]), 1.0)
    assert [set((members // 200).tolist()) for members in found] == [{0}, {1}]
    assert sum(len(members) for members in found) == 400


def extracted(survey, truth, strip, params):
    """Roofs of one strip under the true mounting, and each face as (strip, indices into it)."""
    p_m = georeference(survey.rays(strip), truth.mounting)
    index = candidates(p_m, params)
    found = extract(p_m[index], params, np.random.default_rng(0))
    return found, [(strip.name, index[face.points]) for face in found.faces]


def test_noise_free_faces_hold_999_of_1000_points_of_one_roof():
    config = make_config(noise_scale=0.0, sensor_noise=False, range_offset_sigma_m=0.0, seed=2)
    survey, truth = simulate(config)
    wrong, total = 0, 0
    for strip in survey.strips:
        found, views = extracted(survey, truth, strip, FINE)
        judged = judge_views(survey, truth, views)
        counts = np.array([len(index) for _, index in views])
        wrong += np.sum((1 - judged.purity) * counts)
        total += counts.sum()
        true = true_planes(truth, judged.label)
        normals = np.array([face.normal for face in found.faces])
        assert (judged.label >= 0).all()
        assert np.degrees(angles_between(normals, true[:, :3])).max() < 0.01
    assert wrong / total < 1e-3
    assert total > 40_000


@pytest.mark.parametrize("seed", [1, 2])
def test_noisy_strips_give_gables_only_and_good_normals(seed):
    survey, truth = simulate(make_config(seed=seed))
    angles = []
    for strip in survey.strips:
        found, views = extracted(survey, truth, strip, FINE)
        judged = judge_views(survey, truth, views)
        assert (judged.label >= 0).all()
        assert judged.purity.min() > 0.97
        for one in found.gables:  # both faces are of one building
            assert judged.label[one.left] // 2 == judged.label[one.right] // 2
        normals = np.array([face.normal for face in found.faces])
        angles += angles_between(normals, true_planes(truth, judged.label)[:, :3]).tolist()
    assert np.median(np.degrees(angles)) < 0.3  # APX-15: 0.08 deg in heading, 0.025 in roll
    assert len(angles) > 60


def test_candidates_leave_the_ground_and_dust_and_keep_the_roofs_under_a_boresight_of_3_degrees():
    survey, truth = simulate(make_config(boresight_deg=(3.0, -3.0, 3.0)))
    np.testing.assert_array_equal(survey.mounting.boresight, 0)
    for strip, kinds in zip(survey.strips[::3], truth.classes[::3], strict=True):
        kept = np.zeros(len(strip), dtype=bool)
        kept[candidates(georeference(survey.rays(strip), survey.mounting))] = True
        assert kept[kinds == ObjectClass.GROUND].mean() < 0.02
        assert kept[kinds == ObjectClass.GABLE_ROOF].mean() > 0.99
        assert kept[kinds == ObjectClass.DUST].mean() < 0.5
