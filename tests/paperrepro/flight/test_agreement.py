"""Mistakes that no ray shows: the strips' agreement names them, or they are called implausible."""

from dataclasses import replace

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


def test_a_wrong_sign_of_roll_is_named(few):
    path = few.trajectory
    turned = Trajectory(path.time, path.position, path.attitude * [-1, 1, 1])
    with pytest.raises(BadInput, match="the roll is counted left wing down: so the strips would"):
        calibrate_flight(as_read(few, turned), "D", "any")


def test_two_lines_tell_it_too(few):
    path = few.trajectory
    turned = Trajectory(path.time, path.position, path.attitude * [-1, 1, 1])
    two = replace(few, strips=few.strips[:2])
    with pytest.raises(BadInput, match="turn its sign: right wing down is positive"):
        calibrate_flight(as_read(two, turned), "SL", "any")


def test_the_right_sign_is_taken(few, flown):
    own = calibrate_flight(as_read(few, few.trajectory), "D", "any")
    error = own.result.boresight - flown.truth.boresight
    assert (np.abs(error) < 4 * own.result.sigma).all()
    assert not implausible(own.result)
    assert not any("above its specification" in remark for remark in own.remarks)
    assert "sigma0" in own.summary()
    assert len(repr(own)) < 500


def test_noise_that_is_no_noise_is_said(few, flown):
    """A roll whose sign is right, but which is too large by a half."""
    path = few.trajectory
    turned = Trajectory(path.time, path.position, path.attitude * [1.5, 1, 1])
    own = calibrate_flight(as_read(few, turned), "D", "any")
    error = np.abs(own.result.boresight - flown.truth.boresight)
    said = any("systematic error" in remark for remark in own.remarks)
    assert said or (error < 4 * own.result.sigma).all()
