"""Eq. (6)-(9): projections by hand, the boresight recovered, and who is the target."""

from dataclasses import replace

import numpy as np
import pytest

from paperrepro.errors import TooFewPlanes
from paperrepro.method.adjustment.scenarios import calibrate, orthogonal_projection, refine
from tests.paperrepro.labelled import matched_faces, survey_of, with_noise

OFFSETS = np.random.default_rng(9).uniform(-0.03, 0.03, 16)


def test_the_projection_is_the_nearest_point_of_the_plane():
    rng = np.random.default_rng(0)
    n = np.array([0.48, -0.36, 0.8])
    p_m = rng.uniform(-10, 10, (50, 3))
    foot, s = orthogonal_projection(p_m, np.append(n, 2.5))
    np.testing.assert_allclose(foot @ n, 2.5, atol=1e-12)
    np.testing.assert_allclose(np.cross(foot - p_m, n), 0, atol=1e-12)
    np.testing.assert_allclose(np.abs(s), np.linalg.norm(foot - p_m, axis=1), atol=1e-12)


def test_a_point_above_a_level_plane_is_projected_down():
    foot, s = orthogonal_projection(np.array([[1.0, 2.0, 5.0]]), np.array([0, 0, 1.0, 3.0]))
    np.testing.assert_array_equal(foot, [[1, 2, 3]])
    assert s == -2


@pytest.mark.parametrize("boresight_deg", [(1.1, -0.8, 1.3), (-3, 3, -2)], ids=str)
def test_points_without_noise_return_the_boresight_and_keep_the_offsets(boresight_deg):
    tie_planes, truth, _ = matched_faces(boresight_deg=boresight_deg, offsets=OFFSETS, count=40)
    start = truth.with_calibration(np.zeros(3), OFFSETS)
    result = refine(survey_of(), tie_planes, start)
    np.testing.assert_allclose(np.rad2deg(result.boresight - truth.boresight), 0, atol=1e-8)
    assert result.scenario == "refinement"
    np.testing.assert_array_equal(result.mounting.range_offsets, OFFSETS)


def test_refinement_mends_what_a_calibration_left():
    """A boresight half a degree off, as after wrong matches, comes back to the noise."""
    tie_planes, truth, _ = matched_faces(count=60)
    tie_planes = with_noise(tie_planes, np.random.default_rng(1))
    left = truth.with_calibration(truth.boresight + np.deg2rad([0.5, -0.5, 0.5]))
    result = refine(survey_of(), tie_planes, left)
    assert np.rad2deg(np.abs(result.boresight - truth.boresight)).max() < 0.05
    assert result.rmse_after < result.rmse_before / 2


def test_a_pair_s_first_face_gives_the_points_and_its_second_the_plane():
    """Here the first face of every plane is paired with each of its three others."""
    tie_planes, truth, _ = matched_faces(count=40)
    tie_planes = with_noise(tie_planes, np.random.default_rng(1))
    first = tie_planes.ranges[0]
    whole = replace(tie_planes, pairs=tie_planes.pairs[tie_planes.pairs[:, 0] % 4 == 0])
    result = refine(survey_of(), whole, truth)
    assert result.n_conditions == len(whole.pairs) * (first[1] - first[0])
    other = refine(survey_of(), replace(whole, pairs=whole.pairs[:, ::-1]), truth)
    assert np.abs(result.boresight - other.boresight).max() > 1e-6
    assert _with_shorter_face(whole, 0).n_conditions == result.n_conditions - 3 * 30
    assert _with_shorter_face(whole, 1).n_conditions == result.n_conditions


def _with_shorter_face(tie_planes, face):
    """Refined with ``face``, of plane 0, cut to 10 of its 40 points."""
    rows = np.delete(np.arange(len(tie_planes.rays)), np.arange(*tie_planes.ranges[face])[10:])
    ranges = tie_planes.ranges - 30 * (tie_planes.ranges > tie_planes.ranges[face, 0])
    return refine(
        survey_of(),
        replace(tie_planes, rays=tie_planes.rays.take(rows), ranges=ranges),
        survey_of().mounting,
    )


def test_refinement_starts_at_the_calibration_and_ends_where_it_would_from_zero():
    tie_planes, truth, _ = matched_faces(count=40)
    tie_planes = with_noise(tie_planes, np.random.default_rng(1))
    start = truth.with_calibration(calibrate(survey_of(), tie_planes, "A").boresight)
    near, far = (refine(survey_of(), tie_planes, m) for m in (start, survey_of().mounting))
    np.testing.assert_allclose(near.boresight, far.boresight, rtol=0, atol=1e-10)
    assert near.iterations < far.iterations
    assert near.rmse_before < far.rmse_before


def test_refinement_needs_pairs():
    tie_planes = replace(matched_faces(count=10)[0], pairs=np.zeros((0, 2), int))
    with pytest.raises(TooFewPlanes, match="pairs of faces"):
        refine(survey_of(), tie_planes, survey_of().mounting)
