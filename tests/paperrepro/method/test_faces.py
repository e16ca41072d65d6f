"""Segments of the thinned cloud brought back to the full density."""

from dataclasses import replace

import numpy as np
import pytest

from paperrepro.method.cells import thin
from paperrepro.method.roofs import AssignmentParameters, assign
from tests.paperrepro.method.shapes import gable

PARAMS, CELL = AssignmentParameters(), 0.5


def segments_of(p_m, side, thinned, margin=0.4):
    """Voxels of each side that keep ``margin`` m from ridge and edges, as growing leaves them."""
    inner = (np.abs(np.abs(p_m[:, 0]) - 2.25) < 2.25 - margin) & (np.abs(p_m[:, 1]) < 7.0 - margin)
    voxels = [np.unique(side[thinned.members(np.array([v]))]) for v in range(len(thinned))]
    whole = [inner[thinned.members(np.array([v]))].all() for v in range(len(thinned))]
    return [
        np.array([v for v in range(len(thinned)) if whole[v] and voxels[v].tolist() == [number]])
        for number in (0, 1)
    ]


def faces_of(p_m, side, params=PARAMS):
    thinned = thin(p_m, CELL)
    return assign(p_m, thinned, segments_of(p_m, side, thinned), CELL, params)


def test_noise_free_faces_are_pure_and_reach_to_their_edges():
    p_m, side = gable(np.random.default_rng(1))
    faces = faces_of(p_m, side)
    for number, face in enumerate(faces):
        assert (side[face.points] == number).all()
        assert len(face.points) > 0.95 * (side == number).sum()
        assert face.rms < 1e-7
        assert np.degrees(face.slope) == pytest.approx(25.0, abs=1e-6)
        assert face.area == pytest.approx(14 * 4.5 / np.cos(np.radians(25)), rel=0.05)
        assert face.normal @ face.centroid == pytest.approx(face.d)


def test_noisy_faces_keep_what_three_sigma_keep():
    p_m, side = gable(np.random.default_rng(2), per_m2=100.0, sigma=0.03)
    for number, face in enumerate(faces_of(p_m, side)):
        assert (side[face.points] == number).mean() > 0.998
        assert len(face.points) > 0.93 * (side == number).sum()
        assert face.rms == pytest.approx(0.03 * np.cos(np.radians(25)), rel=0.05)


def test_a_chimney_is_left_out():
    p_m, side = gable(np.random.default_rng(3), per_m2=100.0, sigma=0.02)
    chimney = np.flatnonzero((np.abs(p_m[:, 0] - 2.0) < 0.3) & (np.abs(p_m[:, 1]) < 0.3))
    p_m[chimney, 2] += 1.0
    belongs = np.concatenate([face.points for face in faces_of(p_m, side)])
    assert len(chimney) > 20
    assert not np.isin(chimney, belongs).any()


def test_a_point_that_fits_both_faces_is_of_neither():
    p_m, side = gable(np.random.default_rng(3), per_m2=100.0, sigma=0.02)
    faces = faces_of(p_m, side, replace(PARAMS, reach_cells=4.0))  # each face tries the whole ridge
    belongs = np.concatenate([face.points for face in faces])
    at_ridge = np.flatnonzero(np.abs(p_m[:, 0]) < 0.02)
    assert np.isin(at_ridge, belongs).mean() < 0.05
    assert len(np.unique(belongs)) == len(belongs) > 0.9 * len(p_m)


def test_the_limit_follows_the_spread_between_floor_and_ceiling():
    p_m, side = gable(np.random.default_rng(4), per_m2=60.0, sigma=0.10)
    narrow = faces_of(p_m, side, replace(PARAMS, ceiling_m=0.05))
    wide = faces_of(p_m, side, replace(PARAMS, ceiling_m=1.0))
    assert np.abs(p_m[narrow[0].points] @ narrow[0].normal - narrow[0].d).max() < 0.06
    assert wide[0].rms > 2 * narrow[0].rms
    exact, side = gable(np.random.default_rng(5))
    exact[::7, 2] += 0.01
    assert len(faces_of(exact, side)[0].points) < len(
        faces_of(exact, side, replace(PARAMS, floor_m=0.02))[0].points
    )


def test_no_segments_no_faces():
    p_m, _ = gable(np.random.default_rng(6))
    assert assign(p_m, thin(p_m, CELL), [], CELL, PARAMS) == []
