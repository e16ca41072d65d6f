"""The same seed gives the same bits, and one kind of noise leaves the others alone."""

from dataclasses import fields

import numpy as np
import pytest

from data_synth import SimulationConfig, make_config, simulate
from data_synth.simulation import STREAMS
from paperrepro import _compiled

#: Sums over the default survey, weighted by the cosine of the record's number: position and sine of
#: attitude, measured and true; and the sum of the reference's cosines.
MEASURED = (
    (-65.54181256533164, -39.11400650006105, 40.01894026299564),
    (-0.03638782907725685, 0.032243833029132966, -0.7974671800883135),
)
TRUE = (
    (-65.84992249549809, -39.46551766595236, 39.973523466109846),
    (-0.03392988703518951, 0.023539193045875154, -0.7993086298785905),
)
REFERENCE = 216296.4987092822


def same_strips(a, b) -> bool:
    columns = ("time", "ring", "azimuth", "rho")
    return all(
        np.array_equal(getattr(one, c), getattr(other, c))
        for one, other in zip(a.strips, b.strips, strict=True)
        for c in columns
    )


def same_faces(a, b) -> bool:
    return all(
        np.array_equal(getattr(one, f.name), getattr(other, f.name))
        for one, other in zip(a.faces, b.faces, strict=True)
        for f in fields(one)
    )


@pytest.mark.parametrize("threads", [1, 2])
def test_same_seed_same_bits_on_any_number_of_threads(noisy, threads, monkeypatch):
    monkeypatch.setattr(_compiled, "threads", lambda: threads)
    survey, truth = simulate(make_config())
    assert same_strips(survey, noisy[0])
    assert same_faces(truth, noisy[1])
    np.testing.assert_array_equal(survey.reference, noisy[0].reference)
    np.testing.assert_array_equal(survey.trajectory.position, noisy[0].trajectory.position)
    for mine, theirs in zip(truth.labels, noisy[1].labels, strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_noise_scale_changes_the_trajectory_alone(noisy):
    survey, truth = simulate(make_config(noise_scale=2.0))
    assert same_strips(survey, noisy[0])
    assert same_faces(truth, noisy[1])
    np.testing.assert_array_equal(survey.reference, noisy[0].reference)
    error, before = (
        s.trajectory.position - t.trajectory.position for s, t in ((survey, truth), noisy)
    )
    np.testing.assert_allclose(error, 2 * before, atol=1e-12)


def test_sensor_noise_leaves_farm_flight_and_offsets(noisy, exact):
    assert same_faces(exact[1], noisy[1])
    np.testing.assert_array_equal(exact[1].range_offsets, noisy[1].range_offsets)
    np.testing.assert_array_equal(exact[1].trajectory.position, noisy[1].trajectory.position)
    for quiet, loud in zip(exact[1].labels, noisy[1].labels, strict=True):
        assert (quiet == loud).mean() > 0.99


def test_no_navigation_error_is_the_truth(exact):
    np.testing.assert_array_equal(exact[0].trajectory.position, exact[1].trajectory.position)
    np.testing.assert_allclose(
        exact[0].trajectory.attitude, exact[1].trajectory.attitude, atol=1e-15
    )


def test_another_seed_is_another_farm_and_flight(noisy):
    config = make_config(seed=2, preset="table4", range_offset_sigma_m=0.0)
    _, truth = simulate(config)
    assert not same_faces(truth, noisy[1])
    assert not np.array_equal(truth.trajectory.position, noisy[1].trajectory.position)
    np.testing.assert_array_equal(truth.boresight, config.boresight)
    assert not truth.range_offsets.any()


def test_the_operator_knows_the_lever_arm_and_nothing_of_the_boresight(noisy):
    survey, truth = noisy
    np.testing.assert_array_equal(survey.mounting.lever_arm, truth.lever_arm)
    assert not survey.mounting.boresight.any()
    assert survey.mounting.range_offsets is None
    assert 0.005 < truth.range_offsets.std() < 0.03


def test_the_default_trajectory_is_that_of_old(noisy):
    """Numbers of seed 1 from before there was more than one kind of error; libraries of mathematics
    may differ in the last digit, hence the tolerance."""
    survey, truth = noisy
    weight = np.cos(np.arange(len(truth.trajectory.time)))
    for path, position, attitude in (
        (survey.trajectory, MEASURED[0], MEASURED[1]),
        (truth.trajectory, TRUE[0], TRUE[1]),
    ):
        np.testing.assert_allclose(weight @ path.position, position, rtol=1e-9)
        np.testing.assert_allclose(weight @ np.sin(path.attitude), attitude, rtol=1e-7)
    assert np.cos(survey.reference).sum() == pytest.approx(REFERENCE, rel=1e-9)


def test_naming_the_defaults_changes_no_bit(noisy):
    survey, truth = simulate(make_config(**{f.name: f.default for f in fields(SimulationConfig)}))
    assert same_strips(survey, noisy[0])
    np.testing.assert_array_equal(survey.trajectory.attitude, noisy[0].trajectory.attitude)
    np.testing.assert_array_equal(truth.scene.planes, noisy[1].scene.planes)
    assert truth.relief is None


def test_a_new_stream_leaves_the_old_ones():
    """Streams are told apart by their place in the list."""
    assert STREAMS[:6] == ("scene", "flight", "navigation", "sensor", "offsets", "reference")
    few, many = (np.random.SeedSequence(1).spawn(count) for count in (6, len(STREAMS)))
    states = [[seed.generate_state(4).tolist() for seed in seeds] for seeds in (few, many)]
    assert states[1][:6] == states[0]
    assert len({tuple(state) for state in states[1]}) == len(STREAMS)
