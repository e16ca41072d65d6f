"""Longer flights for scenario D: the same lines flown again, later, and larger villages, each in a
process of its own: ``python -m tests.benchmarks.flight_time ROWS COLUMNS`` prints JSON.
"""

import json
import resource
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import psutil

from data_synth.farm import SITES_PER_SHED, Layout
from data_synth.flight import HALF_SWATH, FlightLine, covering, flight_plan, fly
from data_synth.motion import Motion
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.adjustment.trajectory_errors import (
    calibrate_with_trajectory,
    specified_process,
)
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Mounting, Rays, Survey, Trajectory
from tests.paperrepro.labelled import (
    LEVER_ARM,
    NAVIGATION,
    SCANNER,
    gable_planes,
    reaching,
    survey_of,
)
from tests.paperrepro.method.adjustment.flying import with_trajectory_error


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


def village(rows: int, columns: int, count: int = 60, seed: int = 0) -> tuple[Survey, TiePlanes]:
    """Gable roofs of so many building sites, flown in lines to and fro and two across, ``count``
    points a view, under the errors that the specifications state."""
    rng, layout = np.random.default_rng(seed), Layout(rows, columns)
    lines = flight_plan(covering(*layout.extent))
    motion, truth = fly(lines, rng), Mounting(lever_arm=LEVER_ARM)
    planes, centres = gable_planes(rng, layout.n_gable)
    sites = np.delete(layout.sites, slice(SITES_PER_SHED - 1, None, SITES_PER_SHED), axis=0)
    sites = np.repeat(sites, 2, axis=0)
    centres[:, :2] = sites + 2 * planes[:, :2] / np.linalg.norm(planes[:, :2], axis=1)[:, None]
    planes[:, 3] = np.einsum("ga,ga->g", planes[:, :3], centres)
    faces, strips, planes_of = [], [], []
    for line in lines:
        seen, rays = _views(rng, planes, centres, line, motion, truth, count)
        faces += [rays.take(slice(k, k + count)) for k in range(0, len(rays), count)]
        strips += len(seen) * [line.name]
        planes_of += seen.tolist()
    ties = [np.flatnonzero(np.array(planes_of) == g).tolist() for g in range(len(planes))]
    flown = motion.record()
    pairs = [(tie[0], other) for tie in ties for other in tie[1:]]
    tie_planes = with_trajectory_error(
        TiePlanes.build(faces, strips, ties, pairs), rng, specified_process(NAVIGATION)
    )
    return replace(survey_of(), trajectory=flown), tie_planes


def _views(rng, planes, centres, line: FlightLine, motion: Motion, truth: Mounting, count: int):
    """Which roofs' sides (V,) ``line`` sees, and the rays, ``count`` a view."""
    along = line.velocity / np.linalg.norm(line.velocity)
    above = line.height - centres[:, 2:]
    target = centres[:, None, :2] + rng.uniform(-2, 2, (len(planes), count, 2))
    ring = rng.integers(0, SCANNER.n_rings, (len(planes), count))
    ahead = (target - line.start) @ along - above * np.tan(SCANNER.beam_elevations[ring])
    time = line.start_time + ahead / np.linalg.norm(line.velocity)
    across = (target - line.start) @ [along[1], -along[0]]
    seen = np.abs(across).max(axis=1) < 0.9 * (above * np.tan(HALF_SWATH))[:, 0]
    seen &= (time.min(axis=1) > line.start_time) & (time.max(axis=1) < line.end_time)
    (seen,) = np.nonzero(seen)
    if not len(seen):
        return seen, ()
    target, ring, time = (each[seen].reshape(-1, *each.shape[2:]) for each in (target, ring, time))
    pose = motion.at(time)
    across = (target - pose[:, :2]) @ [along[1], -along[0]]
    azimuth = pose[:, 5] - np.arctan2(across, np.repeat(above[seen], count))
    elevation, on = SCANNER.beam_elevations[ring], np.repeat(planes[seen], count, axis=0)
    rays = Rays(pose, ring, azimuth, elevation, np.zeros(len(time)), time)
    return seen, reaching(on, rays, truth)


#: Rows and columns of building sites, four of five with a gable roof: 24 to 500 roofs.
VILLAGES = ((5, 6), (6, 10), (10, 12), (15, 16), (25, 25))


def run(rows: int, columns: int) -> dict:
    """Scenario D on a `village`: roofs, s of flight, points, CPU s, bytes beyond the input's."""
    solve(*village(2, 3), np.zeros(3))  # compiles
    survey, tie_planes = village(rows, columns)
    before, start = psutil.Process().memory_info().rss, time.process_time()
    solve(survey, tie_planes, np.zeros(3))
    seconds, most = time.process_time() - start, 1024 * resource.getrusage(0).ru_maxrss
    flown = float(survey.trajectory.time[-1] - survey.trajectory.time[0])
    return {
        "roofs": tie_planes.n_planes // 2, "flown": flown, "points": len(tie_planes.rays),
        "seconds": seconds, "memory": most - before,
    }  # fmt: skip


def in_a_process(rows: int, columns: int) -> dict:
    """What `run` gives in a new process."""
    command = [sys.executable, "-m", "tests.benchmarks.flight_time", str(rows), str(columns)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout.splitlines()[-1])


if __name__ == "__main__":
    print(json.dumps(run(*map(int, sys.argv[1:]))))
