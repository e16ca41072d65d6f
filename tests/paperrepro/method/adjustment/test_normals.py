"""Layout of the unknowns, variances in the order of the observations, and the blocks they make."""

import numpy as np
import pytest

from paperrepro.method.adjustment.conditions import Unknowns, observation_variances, point_blocks
from paperrepro.survey import Mounting
from tests.paperrepro.labelled import NAVIGATION, SCANNER, matched_faces, with_noise

KNOWN = np.linspace(-0.03, 0.03, 16)


@pytest.mark.parametrize(
    ("range_offsets", "size", "offsets"),
    [("none", 3, KNOWN), ("common", 4, np.full(16, 3.0)), ("per_ring", 19, np.arange(3.0, 19.0))],
)
def test_unknowns_are_three_angles_then_offsets(range_offsets, size, offsets):
    """Offsets that are not estimated stay at the mounting's."""
    unknowns = Unknowns.layout(Mounting(range_offsets=KNOWN), 16, range_offsets)
    assert unknowns.size == size
    np.testing.assert_array_equal(unknowns.offsets(np.arange(float(size))), offsets)


def test_the_start_is_the_mounting_s_boresight_and_no_offset():
    mounting = Mounting(boresight=np.array([0.01, 0.02, 0.03]))
    start = Unknowns.layout(mounting, 16, "per_ring").start()
    np.testing.assert_array_equal(start, [0.01, 0.02, 0.03, *np.zeros(16)])


def test_variances_follow_the_order_of_the_observations():
    sigma = np.sqrt(observation_variances(NAVIGATION, SCANNER))
    np.testing.assert_allclose(sigma[:3], NAVIGATION.position_sigma)
    np.testing.assert_allclose(sigma[3:6], NAVIGATION.attitude_sigma)
    laser = [SCANNER.range_sigma, SCANNER.angle_sigma, SCANNER.angle_sigma]
    np.testing.assert_allclose(sigma[6:], laser)


@pytest.fixture(scope="module")
def blocks_at():
    tie_planes, truth, planes = matched_faces(n_roofs=2, count=20)
    tie_planes = with_noise(tie_planes, np.random.default_rng(2))
    unknowns = Unknowns.layout(truth, SCANNER.n_rings, "per_ring")
    origin = np.zeros((len(planes), 3))
    variances = observation_variances(NAVIGATION, SCANNER)

    def blocks(x, at_planes):
        arguments = (
            tie_planes.rays,
            tie_planes.plane_ranges,
            origin,
            at_planes,
            unknowns,
            x,
            variances,
        )
        return point_blocks(*arguments)

    return blocks, unknowns.start(), planes


def test_right_side_is_half_the_gradient_of_chi2(blocks_at):
    """At the adjusted observations chi2 is the least cost, and ``t`` is half its derivative."""
    blocks, x, planes = blocks_at
    t = blocks(x, planes).t
    for k in range(len(x)):
        h = 1e-6 * np.eye(len(x))[k]
        numeric = (blocks(x + h, planes).chi2 - blocks(x - h, planes).chi2) / 2e-6
        np.testing.assert_allclose(t[:, k], numeric / 2, rtol=1e-5, atol=1e-4 * np.abs(t).max())
    for k in range(4):
        h = 1e-6 * np.eye(4)[k]
        numeric = (blocks(x, planes + h).chi2 - blocks(x, planes - h).chi2) / 2e-6
        np.testing.assert_allclose(
            t[:, len(x) + k], numeric / 2, rtol=1e-5, atol=1e-4 * np.abs(t).max()
        )


def test_blocks_are_symmetric_and_count_every_point_once(blocks_at):
    condition = blocks_at[0](*blocks_at[1:])
    np.testing.assert_array_equal(condition.N, condition.N.transpose(0, 2, 1))
    np.testing.assert_array_equal(condition.count, np.full(4, 4 * 20))


def test_blocks_add(blocks_at):
    condition = blocks_at[0](*blocks_at[1:])
    twice = condition + condition
    for name in ("N", "t", "chi2", "count"):
        np.testing.assert_array_equal(getattr(twice, name), 2 * getattr(condition, name))
