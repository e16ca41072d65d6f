"""Matched faces: sorted by plane, pairs renumbered, too few planes named."""

import numpy as np
import pytest

from paperrepro.errors import RankDefect, TooFewPlanes
from paperrepro.method.tie_planes import TiePlanes, require_spread
from paperrepro.survey import Rays


def face(number, count):
    """A face whose every column holds its number."""
    column = np.full(count, float(number))
    return Rays(np.tile(column[:, None], 6), column.astype(int), column, column, column)


FACES = [face(number, number + 1) for number in range(9)]
STRIPS = [f"F{number}" for number in range(9)]
PLANES = [[4, 0], [2, 7, 1], [3, 8], [6]]


@pytest.fixture
def tie_planes():
    pairs = [(0, 4), (7, 1), (3, 8), (0, 7), (5, 2)]  # across two planes; with a face on none
    return TiePlanes.build(FACES, STRIPS, PLANES, pairs)


def test_faces_are_sorted_by_plane(tie_planes):
    assert tie_planes.strips == ("F4", "F0", "F2", "F7", "F1", "F3", "F8", "F6")
    np.testing.assert_array_equal(tie_planes.plane, [0, 0, 1, 1, 1, 2, 2, 3])
    assert tie_planes.n_planes == 4


def test_ranges_hold_each_face_s_own_points(tie_planes):
    for (first, stop), strip in zip(tie_planes.ranges, tie_planes.strips, strict=True):
        number = int(strip[1:])
        np.testing.assert_array_equal(tie_planes.rays.rho[first:stop], np.full(number + 1, number))


def test_plane_ranges_join_the_faces_of_a_plane(tie_planes):
    np.testing.assert_array_equal(tie_planes.plane_ranges, [[0, 6], [6, 19], [19, 32], [32, 39]])
    assert tie_planes.plane_ranges[-1, 1] == len(tie_planes.rays)


def test_pairs_follow_their_faces_and_only_within_a_plane(tie_planes):
    named = [(tie_planes.strips[a], tie_planes.strips[b]) for a, b in tie_planes.pairs]
    assert named == [("F0", "F4"), ("F7", "F1"), ("F3", "F8")]


def test_fewer_than_four_planes():
    with pytest.raises(TooFewPlanes) as error:
        TiePlanes.build(FACES, STRIPS, PLANES[:3], [])
    for fact in ("at least 4", "got 3", "more roofs", "thresholds"):
        assert fact in str(error.value)


def tilted(degrees):
    angle = np.deg2rad(degrees)
    return np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])


def test_parallel_planes_within_three_degrees():
    with pytest.raises(RankDefect) as error:
        require_spread(tilted(np.array([20.0, 21.0, 22.5, 20.5])))
    for fact in ("all 4 planes are parallel within 2.50 deg", "expected roofs", "inclined"):
        assert fact in str(error.value)


def test_planes_of_two_slopes_pass():
    require_spread(tilted(np.array([20.0, 20.0, 20.0, 24.0])))
