"""What the truth says of a method's output, on output made by hand."""

import numpy as np
import pytest

from data_synth.evaluation import (
    angles_between,
    faces_in_strip,
    overlap_of_points,
    recall,
    trajectory_error,
)


def _on_face(face, share):
    """Points that cover ``share`` of a face, from one eaves' end on."""
    u, v = np.meshgrid(np.linspace(0, share, 200), np.linspace(0, 1, 200))
    a, b, _, d = face.corners
    return a + u.reshape(-1, 1) * (b - a) + v.reshape(-1, 1) * (d - a)


@pytest.mark.parametrize(("share", "lies"), [(1.0, True), (0.25, False)])
def test_face_lies_in_a_strip_that_covers_half_of_it(exact, share, lies):
    _, truth = exact
    face = truth.faces[0]
    p_m = _on_face(face, share)
    found = faces_in_strip(p_m, np.full(len(p_m), face.id), truth)
    assert found.tolist() == [face.id] * lies


def test_points_on_nothing_put_no_face_in_a_strip(exact):
    _, truth = exact
    p_m = _on_face(truth.faces[0], 1.0)
    assert faces_in_strip(p_m, np.full(len(p_m), -1), truth).size == 0


def test_recall_counts_large_faces_in_enough_strips(exact):
    _, truth = exact
    large = [face.id for face in truth.faces if face.area >= 60.0]
    once, twice, thrice = large[:3]
    strips = [np.array([once, twice, thrice]), np.array([twice, thrice]), np.array([thrice])]
    outcome = recall(truth, strips, np.array([once, twice, -1]), least_area=60.0, least_strips=2)
    assert outcome.expected.tolist() == sorted([twice, thrice])
    assert outcome.found.tolist() == [twice]
    assert outcome.missed.tolist() == [thrice]
    assert outcome.share == 0.5
    assert recall(truth, strips, np.array([once]), least_area=0.0).expected.size == 3


def test_angles_between_are_exact_when_small():
    tilt = np.array([0.0, 1e-9, 0.3])
    turned = np.column_stack([np.sin(tilt), np.zeros(3), np.cos(tilt)])
    np.testing.assert_allclose(angles_between(np.tile([0.0, 0.0, 1.0], (3, 1)), turned), tilt)


def test_exact_trajectory_has_no_error(exact):
    assert np.abs(trajectory_error(*exact)).max() < 1e-12


def test_trajectory_error_does_not_jump_where_headings_wrap(noisy):
    assert np.abs(trajectory_error(*noisy)[:, 3:]).max() < np.radians(1.0)


def test_overlap_of_points_is_the_share_of_cells():
    x, y = (c.ravel() for c in np.meshgrid(np.arange(0.5, 10), np.arange(0.5, 10)))
    p_m = np.column_stack([x, y, np.zeros(100)])
    assert overlap_of_points(p_m, p_m + np.array([5, 0, 1]), cell_m=1.0) == 0.5
    assert overlap_of_points(p_m, p_m + np.array([50, 0, 0]), cell_m=1.0) == 0.0
