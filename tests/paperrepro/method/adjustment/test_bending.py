"""Faces that bend: found whatever trajectory and offsets do, and taken off the ranges."""

from dataclasses import replace

import numpy as np
import pytest

from paperrepro.method.adjustment.bending import _Plane, without_bends
from paperrepro.method.adjustment.trajectory_errors import calibrate_with_trajectory, find_noise
from paperrepro.method.georeference import georeference
from paperrepro.survey import Mounting
from tests.paperrepro.labelled import SCANNER, survey_of
from tests.paperrepro.method.adjustment.flying import flown

SAG = 0.02


def sagging(tie_planes, truth, rng):
    """With ranges to planes that sag between their ends, by `SAG` times a normal number."""
    rays = tie_planes.rays
    p_m, rho = georeference(rays, truth), rays.rho.copy()
    for first, last in tie_planes.plane_ranges:
        plane = _Plane.through(p_m[first:last])
        at, _, sight = plane.seen(p_m[first:last], rays.pose[first:last, :3])
        rho[first:last] += SAG * rng.normal() * (1 - at[:, 0] ** 2) / sight
    return replace(tie_planes, rays=replace(rays, rho=rho))


def bent(tie_planes, flat, truth):
    """RMS, m, of what ranges to planes have beyond those of ``flat`` that no plane has."""
    p_m, squares = georeference(flat.rays, truth), 0.0
    for first, last in flat.plane_ranges:
        plane = _Plane.through(p_m[first:last])
        at, _, sight = plane.seen(p_m[first:last], flat.rays.pose[first:last, :3])
        more = sight * (tie_planes.rays.rho - flat.rays.rho)[first:last]
        rigid = np.column_stack([np.ones(len(at)), at])
        squares += np.square(more - rigid @ np.linalg.lstsq(rigid, more, rcond=None)[0]).sum()
    return np.sqrt(squares / len(p_m))


def test_planes_are_left_as_they_are():
    tie_planes, truth = flown(1)
    even, sigma = without_bends(tie_planes, SCANNER, Mounting(lever_arm=truth.lever_arm))
    assert sigma == 0.0
    assert even is tie_planes


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_sag_is_taken_off_under_errors_of_trajectory_offsets_and_boresight(seed):
    flat, truth = flown(seed, scale=2.0, count=300)
    near = Mounting(lever_arm=truth.lever_arm, boresight=truth.boresight + np.deg2rad(0.05))
    tie_planes = sagging(flat, truth, np.random.default_rng(seed))
    even, sigma = without_bends(tie_planes, SCANNER, near)
    assert 0.05 * SAG < sigma < SAG  # one of twelve coefficients is a sag
    assert bent(even, flat, truth) < 0.0025 < 0.005 < bent(tie_planes, flat, truth)


def test_d_takes_bends_off_and_measures_the_faces_as_they_are():
    flat, truth = flown(3, count=150)
    tie_planes = sagging(flat, truth, np.random.default_rng(3))
    found = find_noise(survey_of(), tie_planes, truth.boresight)
    assert found.named()["bending_m"] == found.bending > 0.05 * SAG
    result, bending = (
        calibrate_with_trajectory(survey_of(), tie_planes, found=noise, near=truth.boresight)
        for noise in (found, replace(found, bending=0.0))
    )
    assert result.sigma0 < 0.9 * bending.sigma0
    np.testing.assert_allclose(result.rms_after, bending.rms_after, rtol=0.2)


def test_planes_through_control_points_are_left_as_they_are():
    flat, truth = flown(2, count=300)
    tie_planes = sagging(flat, truth, np.random.default_rng(2))
    control = np.full((tie_planes.n_planes, 4), np.nan)
    control[0] = 0.0
    even, _ = without_bends(replace(tie_planes, control=control), SCANNER, truth)
    first, last = tie_planes.plane_ranges[0]
    same = even.rays.rho == tie_planes.rays.rho
    assert same[first:last].all()
    assert not same[last:].any()


def with_folds(tie_planes, truth, share, depth):
    """Every ``share``-th plane a ridge, ``depth`` m high, and which planes these are."""
    rays = tie_planes.rays
    p_m, rho = georeference(rays, truth), rays.rho.copy()
    folded = np.arange(tie_planes.n_planes) % share == 0
    for first, last in tie_planes.plane_ranges[folded]:
        plane = _Plane.through(p_m[first:last])
        at, _, sight = plane.seen(p_m[first:last], rays.pose[first:last, :3])
        rho[first:last] += depth * np.abs(at[:, 0]) / sight
    return replace(tie_planes, rays=replace(rays, rho=rho)), folded


def test_few_folds_among_planes_are_uneven_and_taken_off():
    flat, truth = flown(4, scale=2.0, count=300)
    tie_planes, folded = with_folds(flat, truth, 6, 0.15)
    uneven = tie_planes.unevenness(truth, SCANNER)
    assert np.square(uneven).mean() == pytest.approx(1.0)
    of_folds = folded[tie_planes.plane]
    assert uneven[of_folds].mean() > 3 * uneven[~of_folds].mean()
    even, sigma = without_bends(tie_planes, SCANNER, truth)
    assert sigma > 0
    moved = np.abs(even.rays.rho - tie_planes.rays.rho)
    on_fold = folded[tie_planes.plane_of_point]
    assert moved[on_fold].mean() > 10 * moved[~on_fold].mean()


def test_faces_of_three_points_are_all_as_even():
    few = flown(1)[0].thinned(3)
    np.testing.assert_allclose(few.unevenness(flown(1)[1], SCANNER), 1.0)
