"""Accuracy: what calibration gains against the reference and against the truth."""

import numpy as np
import pytest

from data_synth.evaluation import true_planes
from paperrepro.errors import TooFewPlanes
from paperrepro.method import calibrate_all
from paperrepro.method.accuracy import (
    Distribution,
    ReferencePlanes,
    VirtualPoints,
    point_to_plane,
    reference_planes,
    reference_roofs,
    rmse,
    vertical_offsets,
    virtual_points,
)
from paperrepro.method.roofs import Roofs

SCENARIOS = ("SL", "A", "B", "C")


def truth_planes(flown) -> ReferencePlanes:
    first = np.searchsorted(
        flown.found.tie_planes.plane, np.arange(flown.found.tie_planes.n_planes)
    )
    return ReferencePlanes(true_planes(flown.truth, flown.views.label[first]))


def rmses(flown) -> dict[str, float]:
    survey, tie_planes = flown.survey, flown.found.tie_planes
    results = calibrate_all(survey, flown.found, SCENARIOS)
    mountings = {
        name: survey.mounting.with_calibration(r.boresight, r.range_offsets)
        for name, r in results.items()
    }
    mountings |= {"before": survey.mounting, "floor": flown.truth.mounting}
    planes = truth_planes(flown)
    return {name: rmse(point_to_plane(tie_planes, m, planes)) for name, m in mountings.items()}


def test_mount_falls_by_80_percent_in_every_scenario(flown):
    found = rmses(flown)
    for name in SCENARIOS:
        assert found[name] < 0.2 * found["before"], name
        assert found[name] < 1.5 * found["floor"], name


def test_table4_leaves_little_to_gain(flown_table4):
    found = rmses(flown_table4)
    # the whole misalignment moves a point by 1.3 cm; range and trajectory noise are 3 cm
    assert found["before"] < 1.2 * found["floor"]
    assert all(found[name] > 0.8 * found["before"] for name in SCENARIOS)


def test_reference_planes_are_those_of_the_same_roofs(flown):
    reference = reference_planes(flown.found, reference_roofs(flown.survey.reference))
    truth = truth_planes(flown).planes
    assert reference.found.mean() > 0.9
    cosine = np.einsum("ga,ga->g", reference.planes[:, :3], truth[:, :3])[reference.found]
    assert np.rad2deg(np.arccos(np.minimum(cosine, 1))).max() < 1.0
    # the reference is off by 5 to 8 cm a coordinate, by its flight
    centre = np.array([face.centroid for face in flown.truth.faces]).mean(axis=0)
    gap = (reference.planes - truth) @ [*centre, -1.0]
    assert np.abs(gap[reference.found]).max() < 0.5


def test_without_a_common_roof_there_is_no_reference(flown):
    with pytest.raises(TooFewPlanes, match="0 gables"):
        reference_planes(flown.found, Roofs((), ()))


def test_distances_take_only_planes_that_have_a_reference(flown):
    tie_planes, planes = flown.found.tie_planes, truth_planes(flown).planes
    none_of_first = planes.copy()
    none_of_first[0] = np.nan
    everything = point_to_plane(tie_planes, flown.truth.mounting, ReferencePlanes(planes))
    fewer = point_to_plane(tie_planes, flown.truth.mounting, ReferencePlanes(none_of_first))
    in_first = np.diff(tie_planes.ranges, axis=1)[tie_planes.plane == 0].sum()
    assert len(everything) - len(fewer) == in_first > 0
    np.testing.assert_allclose(everything[in_first:], fewer, rtol=0, atol=1e-12)


def test_virtual_points_lie_on_true_ridges_under_the_true_mounting(flown):
    points = virtual_points(flown.found, flown.truth.mounting)
    offsets = vertical_offsets(points, truth_planes(flown))
    assert len(offsets) > 20
    assert np.isfinite(offsets).all()
    assert np.abs(offsets).max() < 0.15  # 4 cm of height error, several sigma
    before = vertical_offsets(
        virtual_points(flown.found, flown.survey.mounting), truth_planes(flown)
    )
    assert np.abs(before).mean() > 5 * np.abs(offsets).mean()


def test_vertical_offset_of_a_constructed_ridge():
    pitch = np.deg2rad(30)
    left = [-np.sin(pitch), 0, np.cos(pitch)]
    right = [np.sin(pitch), 0, np.cos(pitch)]
    top = 7.0 * np.cos(pitch)  # the ridge runs north at x = 0, z = 7
    planes = ReferencePlanes(np.array([[*left, top], [*right, top]]))
    points = VirtualPoints(
        np.array([[0.4, 12.0, 7.25]]), np.zeros(1, int), ("F1",), np.array([[0, 1]])
    )
    np.testing.assert_allclose(vertical_offsets(points, planes), [0.25], atol=1e-12)


def test_distribution_knows_a_normal_from_a_shifted_mixture():
    rng = np.random.default_rng(0)
    normal = Distribution.of(rng.normal(0.01, 0.02, 20000))
    mixed = Distribution.of(rng.normal(0, 0.02, 20000) + np.where(rng.random(20000) < 0.5, 0.2, 0))
    assert normal.mean == pytest.approx(0.01, abs=6e-4)
    assert normal.nmad == pytest.approx(0.02, rel=0.03)
    assert normal.ks < 0.01 < 0.1 < mixed.ks
