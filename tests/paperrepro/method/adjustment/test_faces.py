"""Centroid and plane of a face: their values against numpy's, their derivatives by differences."""

import numpy as np
import pytest

from paperrepro.method.adjustment.conditions import Unknowns, face_states
from paperrepro.method.georeference import georeference
from tests.paperrepro.labelled import SCANNER, matched_faces, with_noise
from tests.paperrepro.method.adjustment.dense import best_plane

#: Central differences of step 1e-6 rad or m: what remains is rounding, 1e-15 * 30 m / 1e-6.
STEP, DIFFERENCE = 1e-6, 1e-7


@pytest.fixture(scope="module")
def faces():
    """Noisy faces, so that the points scatter about their planes."""
    tie_planes, truth, _ = matched_faces(n_roofs=2, count=30, offsets=np.linspace(-0.02, 0.02, 16))
    return with_noise(tie_planes, np.random.default_rng(8)), truth


@pytest.fixture(scope="module", params=["none", "common", "per_ring"])
def at(request, faces):
    """States as a function of x, and an x that is not the truth."""
    tie_planes, truth = faces
    unknowns = Unknowns.layout(truth, SCANNER.n_rings, request.param)
    x = np.random.default_rng(1).normal(0, 0.02, unknowns.size)
    return lambda at_x: face_states(tie_planes.rays, tie_planes.ranges, unknowns, at_x), x


def differences(function, x):
    steps = STEP * np.eye(len(x))
    return np.stack([(function(x + h) - function(x - h)) / (2 * STEP) for h in steps], axis=-1)


def test_derivative_of_the_centroid(at):
    states, x = at
    numeric = differences(lambda y: states(y).centroid, x)
    np.testing.assert_allclose(states(x).J_centroid, numeric, rtol=0, atol=DIFFERENCE)


def test_derivative_of_the_plane(at):
    states, x = at
    numeric = differences(lambda y: states(y).plane, x)
    np.testing.assert_allclose(states(x).J_plane, numeric, rtol=0, atol=DIFFERENCE)


def test_states_are_those_of_the_georeferenced_points(faces):
    tie_planes, truth = faces
    unknowns = Unknowns.layout(truth, SCANNER.n_rings, "none")
    states = face_states(tie_planes.rays, tie_planes.ranges, unknowns, truth.boresight)
    p_m = georeference(tie_planes.rays, truth)
    for f, (first, stop) in enumerate(tie_planes.ranges):
        plane = best_plane(p_m[first:stop])
        distances = p_m[first:stop] @ plane[:3] - plane[3]
        assert states.count[f] == stop - first
        np.testing.assert_allclose(states.centroid[f], p_m[first:stop].mean(axis=0), atol=1e-12)
        np.testing.assert_allclose(states.plane[f], plane, rtol=0, atol=1e-10)
        assert states.rms[f] == pytest.approx(np.sqrt(np.mean(distances**2)), rel=1e-9)
        narrow = np.linalg.svd(p_m[first:stop] - states.centroid[f])[1][1]
        assert states.width[f] == pytest.approx(narrow / np.sqrt(stop - first), rel=1e-9)


def test_a_plane_is_normal_dot_point_minus_d_with_an_upward_unit_normal(faces):
    tie_planes, truth = faces
    unknowns = Unknowns.layout(truth, SCANNER.n_rings, "none")
    states = face_states(tie_planes.rays, tie_planes.ranges, unknowns, truth.boresight)
    n, d = states.plane[:, :3], states.plane[:, 3]
    np.testing.assert_allclose((n**2).sum(axis=1), 1, atol=1e-14)
    np.testing.assert_allclose((n * states.centroid).sum(axis=1) - d, 0, atol=1e-12)
    assert (n[:, 2] > 0.8).all()  # roofs of at most 33 deg


def test_the_true_boresight_finds_the_true_planes():
    tie_planes, truth, planes = matched_faces(n_roofs=2, count=30)
    unknowns = Unknowns.layout(truth, SCANNER.n_rings, "none")
    states = face_states(tie_planes.rays, tie_planes.ranges, unknowns, truth.boresight)
    np.testing.assert_allclose(states.plane, planes[tie_planes.plane], rtol=0, atol=1e-10)
    assert states.rms.max() < 1e-6  # sqrt of a rounded zero eigenvalue
