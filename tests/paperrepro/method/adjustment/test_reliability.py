"""Minimal detectable biases: put one in and see that it is found, and what it does."""

from dataclasses import replace

import numpy as np
import pytest

from paperrepro.method.adjustment.quality import NON_CENTRALITY
from paperrepro.method.adjustment.trajectory_errors import calibrate_with_trajectory
from paperrepro.method.georeference import georeference
from tests.paperrepro.labelled import survey_of
from tests.paperrepro.method.adjustment.flying import flown

VIEW = 5


def biased(tie_planes, truth, view, normal, bias):
    """``tie_planes``, points of one view moved by ``bias`` m along ``normal`` by their ranges."""
    rows = slice(*tie_planes.ranges[view])
    rays = tie_planes.rays
    longer = georeference(replace(rays, rho=rays.rho + 1.0), truth) - georeference(rays, truth)
    rho = rays.rho.copy()
    rho[rows] += bias / (longer[rows] @ normal)
    return replace(tie_planes, rays=replace(rays, rho=rho))


@pytest.fixture(scope="module")
def pair():
    """Results without and with a bias as large as just detectable in one view."""
    tie_planes, truth = flown(2, count=60)
    clean = calibrate_with_trajectory(survey_of(), tie_planes)
    normal = clean.planes[tie_planes.plane[VIEW], :3]
    size = clean.reliability.detectable[VIEW]
    wrong = biased(tie_planes, truth, VIEW, normal, size)
    return clean, calibrate_with_trajectory(survey_of(), wrong)


def test_a_minimal_detectable_bias_is_seen_as_promised(pair):
    clean, wrong = (result.reliability for result in pair)
    gained = wrong.standardised[VIEW] - clean.standardised[VIEW]
    assert gained == pytest.approx(NON_CENTRALITY, rel=0.02)
    assert wrong.bias[VIEW] - clean.bias[VIEW] == pytest.approx(clean.detectable[VIEW], rel=0.02)


def test_it_turns_the_boresight_as_foretold(pair):
    clean, wrong = pair
    turned = wrong.boresight - clean.boresight
    foretold = clean.reliability.turns[VIEW]
    np.testing.assert_allclose(turned, foretold, atol=0.03 * np.abs(foretold).max())


def test_the_biased_view_stands_out(pair):
    _, wrong = pair
    same_plane = wrong.reliability.plane == wrong.reliability.plane[VIEW]
    worst = np.argmax(np.where(same_plane, np.abs(wrong.reliability.standardised), 0))
    assert worst == VIEW


def test_standardised_biases_are_standard_normal_where_nothing_is_wrong():
    found = []
    for seed in range(8):
        tie_planes, _ = flown(seed, count=40)
        found.append(calibrate_with_trajectory(survey_of(), tie_planes).reliability.standardised)
    assert np.std(np.concatenate(found)) == pytest.approx(1.0, abs=0.12)


def test_redundancy_is_a_share_and_a_second_view_of_a_plane_helps(pair):
    clean, _ = pair
    q = clean.reliability
    assert ((q.redundancy > 0) & (q.redundancy < 1)).all()
    tie_planes, _ = flown(2, count=60)
    fewer = np.ones(len(tie_planes.ranges), bool)
    others = np.flatnonzero(tie_planes.plane == tie_planes.plane[VIEW])
    fewer[others[others != VIEW][:2]] = False
    poorer = calibrate_with_trajectory(survey_of(), tie_planes.subset(fewer)).reliability
    now = np.flatnonzero(poorer.plane == q.plane[VIEW])
    assert poorer.detectable[now].max() > q.detectable[VIEW]


def test_of_planes_takes_the_worst_view(pair):
    q = pair[0].reliability
    of_planes = q.of_planes()
    assert len(of_planes) == pair[0].n_planes
    assert of_planes[3] == q.detectable[q.plane == 3].max()
