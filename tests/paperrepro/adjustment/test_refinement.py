"""Eq. (6)-(9): projection on the target plane, and the boresight that shortens it."""

from dataclasses import replace

import numpy as np
import pytest

from paperrepro.adjustment.refinement import orthogonal_projection, refine
from paperrepro.errors import TooFewPlanes
from paperrepro.survey import Mounting
from tests.paperrepro.labelled import LEVER_ARM, matched_faces, survey_of


def test_projection_meets_the_plane_along_its_normal():
    rng = np.random.default_rng(0)
    n = np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9])
    plane, p = np.array([*n, 4.0]), rng.normal(size=(50, 3)) * 10
    foot, s = orthogonal_projection(p, plane)
    np.testing.assert_allclose(foot @ n, 4.0, atol=1e-12)  # Eq. (6), first line
    np.testing.assert_allclose(foot - p, s[:, None] * n, atol=1e-12)  # second line
    np.testing.assert_allclose(s, 4.0 - p @ n, atol=1e-12)  # Eq. (7)


@pytest.mark.parametrize("off_deg", [(0.05, -0.03, 0.08), (-0.5, 0.4, 0.6)])
def test_refines_to_the_truth_and_leaves_offsets_alone(off_deg):
    offsets = np.random.default_rng(1).normal(0, 0.015, 16)
    matched, truth, _ = matched_faces(offsets=offsets)
    start = Mounting(
        lever_arm=LEVER_ARM, boresight=truth.boresight + np.deg2rad(off_deg), range_offsets=offsets
    )
    result = refine(survey_of(), matched, start)
    np.testing.assert_allclose(np.rad2deg(result.boresight - truth.boresight), 0, atol=1e-9)
    assert result.covariance.shape == (3, 3)
    assert result.rmse_after < 1e-6 < result.rmse_before


def test_points_come_from_the_first_face_of_a_pair_and_the_plane_from_the_second():
    matched, truth, _ = matched_faces(n_roofs=3)
    rho = matched.rays.rho.copy()
    first, last = matched.ranges[matched.pairs[0, 0]]
    rho[first:last] += 0.5 * np.random.default_rng(0).normal(size=last - first)
    spoilt = replace(matched, rays=replace(matched.rays, rho=rho), pairs=matched.pairs)
    one_way = refine(survey_of(), spoilt, truth)
    other = refine(survey_of(), replace(spoilt, pairs=spoilt.pairs[:, ::-1]), truth)
    assert abs(one_way.boresight - other.boresight).max() > 1e-6


def test_three_planes_are_too_few():
    with pytest.raises(TooFewPlanes, match="at least 4"):
        matched_faces(n_roofs=1)
