"""Labelled faces that were flown: with times, and with an error of the trajectory that lasts."""

from dataclasses import replace

import numpy as np

from paperrepro.method.adjustment.trajectory_equations import GaussMarkov
from paperrepro.method.adjustment.trajectory_errors import specified_process
from paperrepro.method.tie_planes import TiePlanes
from tests.paperrepro.labelled import NAVIGATION, SCANNER, matched_faces

SPEED = 4.5
TURN = 20.0
LINE = 30.0


def with_times(tie_planes: TiePlanes, headings_deg) -> TiePlanes:
    """Times from the place along each line; the lines F1, F2, ... follow each other after turns."""
    strip = np.repeat(
        [int(name[1:]) - 1 for name in tie_planes.strips], np.diff(tie_planes.ranges, axis=1)[:, 0]
    )
    heading = np.deg2rad(headings_deg)[strip]
    pose = tie_planes.rays.pose
    along = pose[:, 0] * np.sin(heading) + pose[:, 1] * np.cos(heading)
    time = strip * (LINE + TURN) + LINE / 2 + along / SPEED
    return replace(tie_planes, rays=replace(tie_planes.rays, time=time))


def with_trajectory_error(tie_planes, rng, process: GaussMarkov, range_sigma=SCANNER.range_sigma):
    """Reported poses miss the true ones by a Gauss-Markov error; ranges have white noise."""
    rays = tie_planes.rays
    order = np.argsort(rays.time)
    error = np.empty((len(rays), 6))
    error[order] = realisation(rng, process, rays.time[order])
    rho = rays.rho + range_sigma * rng.standard_normal(len(rays))
    return replace(tie_planes, rays=replace(rays, pose=rays.pose - error, rho=rho))


def realisation(rng, process: GaussMarkov, time) -> np.ndarray:
    """(N, 6) of the process at ``time`` (N,) ascending, exactly."""
    out = np.empty((len(time), 6))
    state = process.sigma * rng.standard_normal(6)
    for i, gap in enumerate(np.diff(time, prepend=time[0])):
        kept = np.exp(-gap / process.correlation_time)
        state = kept * state + process.sigma * np.sqrt(1 - kept**2) * rng.standard_normal(6)
        out[i] = state
    return out


def flown(
    seed, headings=(0.0, 180.0, 90.0, 270.0), scale=1.0, count=120, n_roofs=6,
    range_sigma=SCANNER.range_sigma, azimuth_deg=None,
):  # fmt: skip
    """`TiePlanes` with the default trajectory error times ``scale``, and the true `Mounting`."""
    tie_planes, truth, _ = matched_faces(
        seed, count=count, n_roofs=n_roofs, headings=headings, azimuth_deg=azimuth_deg
    )
    tie_planes = with_times(tie_planes, headings)
    specified = specified_process(NAVIGATION)
    process = GaussMarkov(scale * specified.sigma, specified.correlation_time)
    rng = np.random.default_rng(1000 + seed)
    return with_trajectory_error(tie_planes, rng, process, range_sigma), truth
