"""Longer flights for scenario D: the same lines flown again, later."""

from dataclasses import replace

import numpy as np

from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.adjustment.trajectory_errors import calibrate_with_trajectory
from paperrepro.method.tie_planes import MatchedFaces
from paperrepro.survey import Rays, Survey, Trajectory


def repeated(survey: Survey, matched: MatchedFaces, times: int) -> tuple[Survey, MatchedFaces]:
    """The flight ``times`` times over: as many views of each plane, and as long a trajectory."""
    flown = survey.trajectory
    lasts = flown.time[-1] - flown.time[0] + 1.0
    again = Trajectory(
        np.concatenate([flown.time + k * lasts for k in range(times)]),
        np.tile(flown.position, (times, 1)),
        np.tile(flown.attitude, (times, 1)),
    )
    faces = [matched.rays.take(slice(first, last)) for first, last in matched.ranges]
    views = [_later(face, k * lasts) for k in range(times) for face in faces]
    strips = [f"{name} {k}" for k in range(times) for name in matched.strips]
    planes = [
        [k * len(faces) + f for k in range(times) for f in np.flatnonzero(matched.plane == g)]
        for g in range(matched.n_planes)
    ]
    pairs = [tuple(pair + k * len(faces)) for k in range(times) for pair in matched.pairs]
    return replace(survey, trajectory=again), MatchedFaces.build(views, strips, planes, pairs)


def _later(rays: Rays, by: float) -> Rays:
    return replace(rays, time=rays.time + by)


def solve(survey: Survey, matched: MatchedFaces, near: np.ndarray) -> CalibrationResult:
    """Scenario D, from ``near`` (3,) rad."""
    return calibrate_with_trajectory(survey, matched, near=near)
