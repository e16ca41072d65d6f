"""One strip of several that is otherwise: a median over all would not show it."""

import numpy as np
import pytest

from paperrepro.errors import BadInput


def later(las):
    las.gps_time = np.asarray(las.gps_time) - 18.0


def aside(las):
    las.x = np.asarray(las.x) + 2.0


def higher(las):
    las.z = np.asarray(las.z) + 1.0


def upside_down(las):
    las.user_data = 15 - np.asarray(las.user_data)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (later, r"\+18 s are added to the strips' times"),
        (aside, r"-2\.\d+ m east, .* are added"),
        (higher, r"-1\.\d+ m"),
        (upside_down, "by other beams"),
    ],
)
def test_a_strip_that_differs_is_named(folder, change, words):
    given = folder()
    given.change_strips(change, names=("F2",))
    with pytest.raises(BadInput, match=rf"F2\.laz: .*{words}"):
        given.read()


def test_strips_that_do_not_differ_pass(folder):
    assert not any("scatter" in note for note in folder().read().notes)
