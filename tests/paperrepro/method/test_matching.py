"""Matching by virtual points: hand-made gables first, then ten farms without one false match."""

from dataclasses import replace

import numpy as np
import pytest

from data_synth import make_config
from data_synth.evaluation import faces_in_strip, judge_views, recall
from paperrepro.errors import TooFewPlanes
from paperrepro.method.georeference import georeference
from paperrepro.method.matching import FacePair, MatchParameters, connected_faces, match
from paperrepro.method.roofs import Face, Gable, RoofParameters, Roofs, extract
from paperrepro.study.simulated import SimulatedSurvey

FINE, COARSE = MatchParameters.fine(), MatchParameters.coarse()


def gable_at(point, azimuth_deg=0.0, pitch_deg=25.0, extent=(-6.0, 6.0), swap=False, tilt_deg=0.0):
    """Two faces and a gable: ridge of ``azimuth_deg`` through ``point``.

    ``swap`` describes the same roof from the other end of its ridge; ``tilt_deg`` steepens one
    side and flattens the other.
    """
    a = np.radians(azimuth_deg)
    ridge, aside = np.array([np.sin(a), np.cos(a), 0.0]), np.array([np.cos(a), -np.sin(a), 0.0])
    faces = []
    for sign in (-1, 1):
        slope = np.radians(pitch_deg + sign * tilt_deg)
        normal = sign * np.sin(slope) * aside + [0, 0, np.cos(slope)]
        faces.append(Face(normal, normal @ point, np.array(point), np.arange(3), 0.0, 50.0))
    point, extent = np.array(point, float), np.array(extent, float)
    if swap:
        return faces[::-1], Gable(0, 1, point, -ridge, -extent[::-1])
    return faces, Gable(0, 1, point, ridge, extent)


def roofs(*gables):
    """`Roofs` of what `gable_at` gives."""
    faces, numbered = [], []
    for pair, gable in gables:
        numbered.append(replace(gable, left=len(faces), right=len(faces) + 1))
        faces += pair
    return Roofs(tuple(faces), tuple(numbered))


def tie_planes(one, other, params=FINE):
    """Pairs of face numbers that `match` finds between two strips."""
    try:
        pairs = match({"F1": one, "F2": other}, params).pairs
    except TooFewPlanes:
        return set()
    assert all((p.reference[0], p.search[0]) == ("F1", "F2") for p in pairs)
    return {(p.reference[1], p.search[1]) for p in pairs}


def test_the_same_gable_is_matched_face_by_face():
    one, other = roofs(gable_at((0, 0, 6))), roofs(gable_at((0.3, 0.0, 6.4), tilt_deg=1.0))
    first, second = match({"F1": one, "F2": other}, FINE).pairs
    assert (first.reference, first.search) == (("F1", 0), ("F2", 0))
    assert (second.reference, second.search) == (("F1", 1), ("F2", 1))
    assert first.distance == second.distance == pytest.approx(0.5)
    assert [first.inclination, second.inclination] == pytest.approx(np.radians([1.0, 1.0]))


def test_a_gable_seen_from_the_other_end_swaps_left_and_right():
    one, other = roofs(gable_at((0, 0, 6))), roofs(gable_at((0, 0, 6), swap=True))
    assert tie_planes(one, other) == {(0, 1), (1, 0)}
    part, same = ((gable_at((0, 0, 6), extent=(-9.0, 2.0), swap=swap)) for swap in (False, True))
    assert match({"F1": roofs(part), "F2": roofs(same)}, FINE).pairs[0].distance < 1e-12


@pytest.mark.parametrize(("beside", "found"), [(0.9, True), (1.1, False)])
def test_distance_across_the_ridge_has_its_threshold(beside, found):
    one, other = roofs(gable_at((0, 0, 6), 30.0)), roofs(gable_at((0, 0, 6), 30.0))
    east, north = beside * np.cos(np.radians(30)), -beside * np.sin(np.radians(30))
    moved = roofs(gable_at((east, north, 6), 30.0))
    assert bool(tie_planes(one, moved)) is found
    assert tie_planes(one, other)


@pytest.mark.parametrize(("tilt_deg", "found"), [(2.9, True), (3.1, False)])
def test_inclination_has_its_threshold(tilt_deg, found):
    one, other = roofs(gable_at((0, 0, 6))), roofs(gable_at((0, 0, 6), tilt_deg=tilt_deg))
    assert bool(tie_planes(one, other)) is found


@pytest.mark.parametrize("wrong", [{"azimuth_deg": 60.0}, {"pitch_deg": 32.0}])
def test_another_roof_at_the_same_place_is_refused(wrong):
    assert tie_planes(roofs(gable_at((0, 0, 6))), roofs(gable_at((0, 0, 6), **wrong))) == set()


def test_a_part_of_a_roof_is_matched_though_its_virtual_point_slid_along_the_ridge():
    """12 m of roof; the other strip sees its northern 7 m, and a virtual point 2.5 m north."""
    whole, part = gable_at((0, 0, 6)), gable_at((0, 2.5, 6), extent=(-3.5, 3.5))
    assert tie_planes(roofs(whole), roofs(part)) == {(0, 0), (1, 1)}
    pair = match({"F1": roofs(whole), "F2": roofs(part)}, FINE).pairs[0]
    assert pair.distance == pytest.approx(0.0)


def test_a_slide_beyond_the_end_of_the_roof_counts():
    one = roofs(gable_at((0, 0, 6)))
    assert tie_planes(one, roofs(gable_at((0, 0.9, 6)))) == {(0, 0), (1, 1)}
    assert tie_planes(one, roofs(gable_at((0, 1.1, 6)))) == set()


@pytest.mark.parametrize("params", [FINE, COARSE], ids=["fine", "coarse"])
def test_a_neighbour_in_line_is_not_matched_though_the_roof_itself_was_not_seen(params):
    """Twins of 12 m, 1.5 m apart, displaced by 3 m towards each other."""
    one, other = roofs(gable_at((0, 0, 6))), roofs(gable_at((0, 13.5 - 3.0, 6)))
    assert tie_planes(one, other, params) == set()


def test_an_end_of_a_neighbour_in_line_is_not_matched_either():
    """Of a neighbour 1.5 m away, 4 m are seen, displaced by 3 m: they overlap by 1.5 m."""
    one, other = roofs(gable_at((0, 0, 6))), roofs(gable_at((0, 6.5, 6), extent=(-2.0, 2.0)))
    assert tie_planes(one, other, COARSE) == set()
    assert tie_planes(one, other, replace(COARSE, overlap=0.3)) == {(0, 0), (1, 1)}


@pytest.mark.parametrize("shift", [(3.2, 0.0, 0.0), (0.0, -3.2, 0.0), (2.2, 2.2, 0.5)])
def test_twins_keep_apart_under_a_shift_of_three_metres(shift):
    """Four equal gables, 10 m apart across and 15 m along the ridge."""
    places = np.array([(0, 0, 6), (10, 0, 6), (0, 15, 6), (10, 15, 6)], float)
    one = roofs(*(gable_at(p) for p in places))
    other = roofs(*(gable_at(p + shift) for p in places))
    assert tie_planes(one, other, COARSE) == {(k, k) for k in range(8)}


def test_two_equal_candidates_are_both_refused():
    one = roofs(gable_at((0, 0, 6)))
    other = roofs(gable_at((-3, 0, 6)), gable_at((3.3, 0, 6)))
    assert tie_planes(one, other, COARSE) == set()
    assert tie_planes(one, other, replace(COARSE, distinct=1.0)) == {(0, 0), (1, 1)}


def test_best_must_be_mutual():
    """B is nearest to A, but nearer to C: neither A-B nor, unclear beside it, a wrong pair."""
    one = roofs(gable_at((0, 0, 6)), gable_at((4.5, 0, 6)))
    other = roofs(gable_at((3.5, 0, 6)))
    assert tie_planes(one, other, COARSE) == {(2, 0), (3, 1)}


def test_nothing_in_common_raises_with_numbers_and_remedy():
    one, other = roofs(gable_at((0, 0, 6))), roofs(gable_at((50, 0, 6)), gable_at((80, 0, 6)))
    with pytest.raises(TooFewPlanes, match=r"F1 1, F2 2; fly over more gable roofs"):
        match({"F1": one, "F2": other}, FINE)
    with pytest.raises(TooFewPlanes, match="F1 0, F2 0"):
        match({"F1": roofs(), "F2": roofs()}, FINE)
    with pytest.raises(TooFewPlanes, match="no strips"):
        match({}, FINE)


def pair(one, other, distance=0.1):
    return FacePair((one[:2], int(one[2:])), (other[:2], int(other[2:])), distance, 0.0)


def test_tie_planes_are_connected_components():
    pairs = [pair("F10", "F20"), pair("F20", "F30"), pair("F11", "F31")]
    assert connected_faces(pairs) == ((("F1", 0), ("F2", 0), ("F3", 0)), (("F1", 1), ("F3", 1)))
    assert connected_faces([]) == ()


def test_a_second_face_of_a_strip_is_left_out_of_a_component():
    """F1-0 = F2-0 = F3-0 by near pairs; the far pair F3-0 = F1-1 contradicts them."""
    pairs = [pair("F30", "F11", 0.9), pair("F10", "F20", 0.1), pair("F20", "F30", 0.2)]
    assert connected_faces(pairs) == ((("F1", 0), ("F2", 0), ("F3", 0)),)


def test_matches_are_free_of_contradictions():
    """One strip saw two roofs 1.5 m apart where the others saw one, drifting from the first to the
    second: strip by strip all agree, together they cannot."""
    strips = {
        "F1": roofs(gable_at((0.0, 0, 6)), gable_at((1.5, 0, 6))),
        "F2": roofs(gable_at((0.6, 0, 6))),
        "F3": roofs(gable_at((1.2, 0, 6))),
    }
    each = [match({a: strips[a], b: strips[b]}, FINE).pairs
            for a, b in (("F1", "F2"), ("F1", "F3"), ("F2", "F3"))]  # fmt: skip
    assert [{p.reference[1] for p in pairs} for pairs in each] == [{0, 1}, {2, 3}, {0, 1}]
    found = match(strips, FINE)
    assert found.connected_faces() == connected_faces(found.pairs)
    # nearest first: F1-F3 stays, with it F1-F2, and F2-F3 would tie both roofs of F1
    assert {p.reference[0] + p.search[0] for p in found.pairs} == {"F1F3", "F1F2"}
    assert len(found.pairs) == 4


class Flight:
    """A simulated survey; its candidates come, as in practice, from the mounting as known."""

    def __init__(self, **config):
        flown = SimulatedSurvey(make_config(**config), kept=True)
        self.survey, self.truth, self.points = flown.survey, flown.truth, flown.points

    def tie_planes(self, boresight, roofs, matching, fan_deg=90.0):
        """Truth's labels (P, 2) of the faces paired in one pass under ``boresight`` (3,) rad."""
        mounting, found, views = self.survey.mounting.with_calibration(boresight), {}, {}
        for strip in self.survey.strips:
            index, rays = self.points.index[strip.name], self.points.rays[strip.name]
            used = np.flatnonzero(np.abs(rays.elevation) <= np.radians(fan_deg))
            p_m = georeference(rays.take(used), mounting)
            found[strip.name] = extract(p_m, roofs, np.random.default_rng(0))
            views[strip.name] = [
                (strip.name, index[used[face.points]]) for face in found[strip.name].faces
            ]
        label = {s: judge_views(self.survey, self.truth, views[s]).label for s in views}
        pairs = match(found, matching).pairs
        return np.array([[label[s][f] for s, f in (p.reference, p.search)] for p in pairs])

    def fine(self, error_deg):
        boresight = self.truth.boresight + np.radians(error_deg)
        return self.tie_planes(boresight, RoofParameters(), FINE)

    def coarse(self, error_deg):
        boresight = self.truth.boresight + np.radians(error_deg)
        return self.tie_planes(boresight, RoofParameters().coarse(), COARSE, fan_deg=3.5)

    def recall(self, label):
        """Of the faces of 20 m² or more that lie in two strips or more."""
        in_strips = [
            faces_in_strip(georeference(self.survey.rays(s), self.truth.mounting), of, self.truth)
            for s, of in zip(self.survey.strips, self.truth.labels, strict=True)
        ]
        return recall(self.truth, in_strips, label, least_area=20.0, least_strips=2)


def false(pairs):
    """Rows of (P, 2) labels that are not one and the same gable face."""
    return pairs[(pairs[:, 0] != pairs[:, 1]) | (pairs[:, 0] < 0)].tolist()


@pytest.mark.slow
def test_ten_farms_without_a_false_match_and_hardly_a_roof_missed():
    """Fine pass: 95 % of the faces found. Coarse pass: gables enough to go on from, in four corners
    of the range of boresights."""
    corners = [(3, 3, 3), (-3, 3, -3), (3, -3, -3), (-3, -3, 3)]
    expected, found = 0, 0
    for seed in range(1, 11):
        flight = Flight(seed=seed)
        fine = flight.fine((0.05, -0.05, 0.05))
        assert false(fine) == [], seed
        outcome = flight.recall(fine)
        expected, found = expected + len(outcome.expected), found + len(outcome.found)
        coarse = flight.coarse(corners[seed % 4])
        assert false(coarse) == [], seed
        assert len(np.unique(coarse // 2)) >= 6, seed
    assert expected > 200
    assert found / expected >= 0.95


def test_a_true_boresight_of_three_degrees_is_survived_from_zero():
    """The candidates, too, come from the wrong mounting."""
    flight = Flight(seed=3, boresight_deg=(3.0, -3.0, -3.0))
    pairs = flight.coarse((-3.0, 3.0, 3.0))
    assert false(pairs) == []
    assert len(pairs) > 40
    places = np.array([flight.truth.faces[face].centroid for face in np.unique(pairs)])
    assert len(places) >= 12
    assert (np.ptp(places, axis=0)[:2] > 60.0).all()  # over the farm, not in a corner of it
