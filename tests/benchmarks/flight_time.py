"""Longer flights for scenario D: the same lines flown again, later."""

from dataclasses import replace

import numpy as np

from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.adjustment.trajectory_errors import calibrate_with_trajectory
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Rays, Survey, Trajectory


def repeated(survey: Survey, tie_planes: TiePlanes, times: int) -> tuple[Survey, TiePlanes]:
    """The flight ``times`` times over: as many views of each plane, and as long a trajectory."""
    flown = survey.trajectory
    lasts = flown.time[-1] - flown.time[0] + 1.0
    again = Trajectory(
        np.concatenate([flown.time + k * lasts for k in range(times)]),
        np.tile(flown.position, (times, 1)),
        np.tile(flown.attitude, (times, 1)),
    )
    faces = [tie_planes.rays.take(slice(first, last)) for first, last in tie_planes.ranges]
    views = [_later(face, k * lasts) for k in range(times) for face in faces]
    strips = [f"{name} {k}" for k in range(times) for name in tie_planes.strips]
    planes = [
        [k * len(faces) + f for k in range(times) for f in np.flatnonzero(tie_planes.plane == g)]
        for g in range(tie_planes.n_planes)
    ]
    pairs = [tuple(pair + k * len(faces)) for k in range(times) for pair in tie_planes.pairs]
    return replace(survey, trajectory=again), TiePlanes.build(views, strips, planes, pairs)


def _later(rays: Rays, by: float) -> Rays:
    return replace(rays, time=rays.time + by)


def solve(survey: Survey, tie_planes: TiePlanes, near: np.ndarray) -> CalibrationResult:
    """Scenario D, from ``near`` (3,) rad."""
    return calibrate_with_trajectory(survey, tie_planes, near=near)
