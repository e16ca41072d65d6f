"""The centroid as a virtual ray: derivatives by differences, variances by hand."""

import numpy as np
import pytest

from paperrepro.method.adjustment.conditions import (
    Unknowns,
    centroid_blocks,
    centroid_variances,
    face_states,
    virtual_jacobians,
)
from paperrepro.survey import Mounting
from tests.paperrepro.labelled import SCANNER, matched_faces, survey_of
from tests.paperrepro.method.adjustment import dense

STEP = 1e-6


@pytest.fixture(scope="module")
def model():
    tie_planes, truth, planes = matched_faces(n_roofs=2, count=30)
    unknowns = Unknowns.layout(truth, SCANNER.n_rings, "per_ring")
    x = np.append(np.deg2rad([2.0, -1.0, 3.0]), np.linspace(-0.02, 0.02, 16))
    return tie_planes, unknowns, x, planes


def test_derivatives_of_the_virtual_ray(model):
    """The ray from the mean pose to the centroid, which ends there, moved in each observation."""
    tie_planes, unknowns, x, _ = model
    states, poses = (
        face_states(tie_planes.rays, tie_planes.ranges, unknowns, x),
        tie_planes.mean_poses(),
    )
    problem = dense.Problem.of(survey_of(), tie_planes, "per_ring")
    ends = dense.points(x[:3], 0.0, problem.virtual_rays(x)[0], unknowns.mounting)
    np.testing.assert_allclose(ends, states.centroid, rtol=0, atol=1e-12)
    J_l = virtual_jacobians(states.centroid, poses, unknowns, x)
    np.testing.assert_allclose(J_l, problem.virtual_derivatives(x), rtol=0, atol=1e-11)


def test_mean_poses_are_the_means_of_the_faces(model):
    tie_planes = model[0]
    expected = [tie_planes.rays.pose[first:stop].mean(axis=0) for first, stop in tie_planes.ranges]
    np.testing.assert_allclose(tie_planes.mean_poses(), expected, rtol=0, atol=1e-12)


def test_averaging_lowers_the_laser_s_variance_but_not_the_pose_s():
    J_l = np.zeros((1, 3, 9))
    J_l[0, 2] = 1.0
    n = np.array([[0.0, 0.0, 1.0]])
    pose, laser = np.r_[np.ones(6), np.zeros(3)], np.r_[np.zeros(6), np.ones(3)]
    for count in (1, 10, 1000):
        one = np.array([count])
        assert centroid_variances(n, J_l, one, pose) == pytest.approx(6)
        assert centroid_variances(n, J_l, one, laser) == pytest.approx(3 / count)


def test_height_of_a_level_nadir_centroid_has_the_range_s_and_the_height_s_variance():
    """30 m below a level scanner only height and range move the centroid up and down."""
    pose = np.array([[0.0, 0, 30, 0, 0, 0]])
    unknowns = Unknowns.layout(Mounting(), 16, "none")
    J_l = virtual_jacobians(np.zeros((1, 3)), pose, unknowns, np.zeros(3))
    expected = [0, 0, 1, 0, 0, 0, -1, 0, 0]
    np.testing.assert_allclose(J_l[0, 2], expected, rtol=0, atol=1e-13)


def test_blocks_are_the_normal_equations_of_the_written_rows(model):
    """Misclosure and design row of ``n . c(x) - d`` by differences, summed per plane."""
    tie_planes, unknowns, x, planes = model
    face, s = np.arange(len(tie_planes.ranges)), np.linspace(1e-4, 3e-4, len(tie_planes.ranges))
    origin = planes[:, :3] * planes[:, 3:]

    def states(at):
        return face_states(tie_planes.rays, tie_planes.ranges, unknowns, at)

    def conditions(at, shifted):
        n, d = shifted[tie_planes.plane, :3], shifted[tie_planes.plane, 3]
        return ((states(at).centroid - origin[tie_planes.plane]) * n).sum(axis=1) - d

    relative = planes.copy()
    relative[:, 3] -= (planes[:, :3] * origin).sum(axis=1)
    blocks = centroid_blocks(face, tie_planes.plane, states(x), origin, relative, s)
    w = conditions(x, relative)
    for g in range(len(planes)):
        rows = tie_planes.plane == g
        row = _row(conditions, x, relative, rows)
        np.testing.assert_allclose(blocks.N[g], row.T @ (row / s[rows, None]), rtol=1e-5, atol=1)
        np.testing.assert_allclose(blocks.t[g], row.T @ (w / s)[rows], rtol=1e-5, atol=0.1)
        assert blocks.chi2[g] == pytest.approx((w**2 / s)[rows].sum())
        assert blocks.count[g] == rows.sum()


def _row(conditions, x, planes, rows):
    def along(at):
        return conditions(at[: len(x)], planes + at[len(x) :])[rows]

    at = np.append(x, np.zeros(4))
    steps = STEP * np.eye(len(at))
    return np.column_stack([(along(at + h) - along(at - h)) / (2 * STEP) for h in steps])
