"""Mistakes that no ray shows: the strips' agreement names them, or they are called implausible."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from paperrepro.errors import BadInput
from paperrepro.flight import ray_test
from paperrepro.flight.agreement import implausible
from paperrepro.flight.calibrate import calibrate_flight
from paperrepro.method.georeference import georeference
from paperrepro.survey import Trajectory


@pytest.fixture(scope="module", autouse=True)
def fewer_planes():
    """Enough for these tests, and ten times as fast as the usual number."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("paperrepro.method.coarse_to_fine.MOST_PLANES", 60)
        yield


def as_read(survey, trajectory):
    """The survey as read with another trajectory: its points stay where they are."""
    strips = []
    for strip in survey.strips:
        p_m = georeference(survey.rays(strip), survey.mounting)
        pose = trajectory.at(strip.time)
        azimuth, _, rho = ray_test.laser_rays(pose, p_m, survey.mounting)
        strips.append(replace(strip, azimuth=azimuth, rho=rho))
    return replace(survey, strips=tuple(strips), trajectory=trajectory)


@pytest.fixture(scope="module")
def few(flown):
    survey = flown.survey
    strips = tuple(survey.strip(name) for name in ("F1", "F2", "F7", "F8"))
    return replace(survey, strips=strips)


def turned(survey, factor):
    path = survey.trajectory
    return as_read(survey, Trajectory(path.time, path.position, path.attitude * [factor, 1, 1]))


@pytest.mark.parametrize("names", [("F1", "F2"), ("F1", "F2", "F7", "F8")], ids=len)
def test_a_wrong_sign_of_roll_is_named(few, names):
    some = replace(few, strips=tuple(few.strip(name) for name in names))
    with pytest.raises(BadInput, match="the roll is counted left wing down: so the strips would"):
        calibrate_flight(turned(some, -1), "D", "any")


def test_the_right_sign_is_taken(few, flown):
    """And what comes out can be read."""
    two = replace(few, strips=few.strips[:2])
    own = calibrate_flight(turned(two, 1), "D", "any")
    assert (np.abs(own.result.boresight - flown.truth.boresight) < 4 * own.result.sigma).all()
    assert not implausible(own.result)
    assert "sigma0" in own.summary()
    assert "<pre>" in own._repr_html_()
    assert len(repr(own)) < 500


@pytest.mark.parametrize(
    ("components", "sigma0", "said"),
    [
        ({"range": 1.0, "height": 1.4, "heading": 5.2}, 1.0, "heading 5.2 times"),
        ({"range": 1.2, "height": 2.5, "heading": 2.0}, 1.0, ""),
        (None, 3.4, "3.4 times what the noise explains"),
        (None, 1.2, ""),
    ],
)
def test_noise_that_is_no_noise_is_said(components, sigma0, said):
    result = SimpleNamespace(components=components, sigma0=sigma0, scenario="D")
    remarks = implausible(result)
    assert bool(remarks) == bool(said)
    assert not said or said in remarks[0]
