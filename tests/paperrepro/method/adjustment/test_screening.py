"""Wrong matches are found and left out, whatever the scenario."""

from dataclasses import replace

import numpy as np
import pytest

from paperrepro.errors import BadInput
from paperrepro.method.adjustment.calibrate import SCENARIO_NAMES, calibrate
from paperrepro.method.adjustment.screening import screen
from paperrepro.method.tie_planes import TiePlanes
from tests.paperrepro.labelled import survey_of
from tests.paperrepro.method.adjustment.flying import flown

SHARE = 0.1
SEEDS = range(8)


def with_wrong_matches(tie_planes: TiePlanes, seed):
    """A tenth of the faces moved to another plane; returns also which (F,) in the new order."""
    rng = np.random.default_rng(seed)
    n_faces = len(tie_planes.ranges)
    wrong = rng.choice(n_faces, int(SHARE * n_faces), replace=False)
    plane = tie_planes.plane.copy()
    # gables lie in pairs of planes: two on is another roof
    plane[wrong] = (plane[wrong] + 2) % tie_planes.n_planes
    faces = [tie_planes.rays.take(slice(first, last)) for first, last in tie_planes.ranges]
    ties = [list(np.flatnonzero(plane == g)) for g in range(tie_planes.n_planes)]
    ties = [tie for tie in ties if len(tie) > 1]
    order = np.array([face for tie in ties for face in tie])
    pairs = [(a, b) for tie in ties for i, a in enumerate(tie) for b in tie[i + 1 :]]
    built = TiePlanes.build(faces, list(tie_planes.strips), ties, pairs)
    return built, np.isin(order, wrong)


@pytest.fixture(scope="module")
def spoilt():
    """Surveys with and without wrong matches, and which faces are wrong."""
    out = []
    for seed in SEEDS:
        clean, truth = flown(seed, count=60)
        bad, wrong = with_wrong_matches(clean, seed)
        out.append((clean, bad, wrong, truth))
    return out


def test_right_matches_are_left_alone(spoilt):
    assert all(not screen(survey_of(), clean).rejected for clean, *_ in spoilt)


def test_what_is_rejected_is_wrong(spoilt):
    rejected = [(~screen(survey_of(), bad).kept, wrong) for _, bad, wrong, _ in spoilt]
    right = sum((out & wrong).sum() for out, wrong in rejected)
    assert right >= 0.95 * sum(out.sum() for out, _ in rejected)
    assert right >= 0.9 * sum(wrong.sum() for _, wrong in rejected)


@pytest.mark.parametrize("scenario", SCENARIO_NAMES)
def test_errors_hardly_grow(spoilt, scenario):
    def rms(which):
        errors = [
            calibrate(survey_of(), (clean, bad)[which], scenario).boresight - truth.boresight
            for clean, bad, _, truth in spoilt
        ]
        return np.sqrt(np.mean(np.square(errors)))

    # a tenth of the faces is lost, which alone costs a few percent
    assert rms(1) < 1.2 * rms(0)


def test_without_screening_they_bend_the_result(spoilt):
    _, bad, _, truth = spoilt[0]
    error = calibrate(survey_of(), bad, "SL", robust=False).boresight - truth.boresight
    assert np.abs(np.rad2deg(error)).max() > 0.5


def test_the_result_names_what_was_left_out(spoilt):
    _, bad, wrong, _ = spoilt[0]
    result = calibrate(survey_of(), bad, "A")
    assert len(result.rejected) == pytest.approx(wrong.sum(), abs=1)
    for rejection in result.rejected:
        assert rejection.misfit_m > rejection.limit_m > 0
        assert rejection.strip in bad.strips
        assert np.isfinite(rejection.centroid).all()


def test_screening_knows_trajectory_noise():
    tie_planes, _ = flown(2, scale=2.0)
    assert not screen(survey_of(), tie_planes).rejected


def test_unknown_scenario_is_refused(spoilt):
    with pytest.raises(BadInput, match="SL, A, B, C, D"):
        calibrate(survey_of(), spoilt[0][0], "E")


def test_thinning_keeps_faces_in_place(spoilt):
    tie_planes = spoilt[0][0]
    thin = tie_planes.thinned(10)
    assert len(thin.rays) == 10 * len(tie_planes.ranges)
    assert thin.strips == tie_planes.strips
    same = replace(thin, rays=tie_planes.rays, ranges=tie_planes.ranges)
    np.testing.assert_array_equal(same.plane, tie_planes.plane)
    np.testing.assert_array_equal(thin.rays.rho[:1], tie_planes.rays.rho[:1])
