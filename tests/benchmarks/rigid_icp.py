"""Two strips brought together by a rigid ICP, PyPI's simpleicp, in an environment of its own.

python -m venv icp && icp/bin/pip install simpleicp "pandas<3"
python -m tests.benchmarks --icp icp/bin/python
"""

import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from paperrepro.flight.calibrate import calibrate_flight
from paperrepro.method.accuracy import correspondences, over_planes, rmse
from paperrepro.method.georeference import georeference
from paperrepro.survey import Survey
from tests.benchmarks.clock import Row, row, timed

#: Pairs of strips: one track, half an overlap, a crossing.
PAIRS = (("F1", "F2"), ("F2", "F4"), ("F1", "F7"))
#: Points of one cloud look for partners in the other within so many metres.
OVERLAP_M = 1.0
SCRIPT = """
import sys
import numpy as np
from simpleicp import PointCloud, SimpleICP
fixed, moving = (PointCloud(np.load(path), columns=["x", "y", "z"]) for path in sys.argv[1:3])
icp = SimpleICP()
icp.add_point_clouds(fixed, moving)
_, moved, _, _ = icp.run(max_overlap_distance=float(sys.argv[4]))
np.save(sys.argv[3], moved)
"""


def moved(python: str | Path, fixed: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """``moving`` (N, 3) m as simpleicp of the interpreter ``python`` lays it onto ``fixed``."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{name}.npy" for name in ("fixed", "moving", "moved")]
        for path, points in zip(paths, (fixed, moving), strict=False):
            np.save(path, points)
        command = [str(python), "-c", SCRIPT, *map(str, paths), str(OVERLAP_M)]
        subprocess.run(command, check=True, capture_output=True)
        return np.load(paths[-1])


def adjusted(survey: Survey) -> tuple[dict, dict]:
    """Points (N, 3) m of the strips under D's mounting, and under its trajectory, too."""
    result = calibrate_flight(survey).result
    rays = {strip.name: survey.rays(strip) for strip in survey.strips}
    mounted = {name: georeference(r, result.calibrated) for name, r in rays.items()}
    poses = {name: result.trajectory.apply(r) for name, r in rays.items()}
    return mounted, {name: georeference(r, result.calibrated) for name, r in poses.items()}


def left(clouds: dict[str, dict], first: str, second: str) -> dict[str, float]:
    """RMS distance, m, between two strips in each of ``clouds``, of the same points; they belong
    together as they do in the first."""
    near = next(iter(clouds.values()))
    both = correspondences(first, second, near)
    return {
        name: rmse(over_planes(p[first][both.index], p[second][both.neighbours]))
        for name, p in clouds.items()
    }


def strips_together(survey: Survey, every: int, python: str | Path) -> Iterator[Row]:
    """D with its trajectory, all strips at once, beside an ICP of each pair from D's mounting on:
    their distances as a share of what the ICP leaves."""
    ours_timed, *_ = timed(lambda: adjusted(survey))
    mounted, ours = ours_timed.result
    for first, second in PAIRS:
        (theirs,) = timed(lambda a=first, b=second: moved(python, mounted[a], mounted[b]))
        clouds = {"mounting": mounted, "ours": ours}
        clouds["icp"] = {first: mounted[first], second: theirs.result}
        found = left(clouds, first, second)
        print(", ".join(f"{name} {100 * value:.2f} cm" for name, value in found.items()))
        count = len(mounted[first]) + len(mounted[second])
        ratio = found["ours"] / found["icp"]
        yield row(
            f"strips {first}, {second}", every, count, ours_timed, "simpleicp", theirs,
            "RMS between the strips, ours / peer's", ratio,
        )  # fmt: skip
