"""The boresight from closest points: from far off, with few points, of any scene."""

from dataclasses import replace

import numpy as np
import pytest

from data_synth import make_config, simulate
from paperrepro.errors import TooFewPlanes
from paperrepro.method.closest_points import boresight_by_closest_points
from paperrepro.method.coarse_to_fine import sample_rays
from paperrepro.survey import Survey


def off(survey: Survey, truth, degrees) -> np.ndarray:
    """Error (3,) deg from a start that is ``degrees`` (3,) from the truth."""
    start = survey.mounting.with_calibration(truth.boresight + np.radians(degrees))
    survey = replace(survey, mounting=start)
    found = boresight_by_closest_points(survey, sample_rays(survey).rays)
    return np.abs(np.rad2deg(found - truth.boresight))


@pytest.fixture(scope="module")
def two(flown):
    """Two opposite lines over one track, one point in eight."""
    strips = [flown.survey.strip(name) for name in ("F1", "F2")]
    few = tuple(strip.take(slice(None, None, 8)) for strip in strips)
    return replace(flown.survey, strips=few)


@pytest.mark.parametrize("degrees", [(-7, 0, 7), (0, 10, 0), (0, 0, -10)])
def test_two_lines_find_it_from_ten_degrees_off(two, flown, degrees):
    error = off(two, flown.truth, degrees)
    assert (error < (0.1, 0.15, 0.4)).all()  # what two noisy lines tell


def test_a_yard_without_roofs():
    survey, truth = simulate(make_config(scene="yard", profile="quick", seed=4))
    strips = tuple(survey.strip(name).take(slice(None, None, 4)) for name in ("F1", "F2", "F5"))
    assert (off(replace(survey, strips=strips), truth, (2.0, 2.0, -2.0)) < 0.2).all()


def test_strips_that_share_nothing_are_named(flown):
    strips = tuple(flown.survey.strip(name).take(slice(0, 2000)) for name in ("F1", "F2"))
    with pytest.raises(TooFewPlanes, match="strips that overlap"):
        off(replace(flown.survey, strips=strips), flown.truth, (0, 0, 0))
