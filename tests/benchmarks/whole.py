"""The whole method on one survey, in a process of its own, so that its memory is its own:
``python -m tests.benchmarks.whole EVERY`` prints JSON.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time

from paperrepro.method import calibrate_all, refine_all
from paperrepro.method.adjustment.calibrate import SCENARIO_NAMES
from paperrepro.method.coarse_to_fine import find_candidates, find_roofs
from tests.benchmarks.inputs import Inputs


def run(every: int) -> dict:
    """Seconds of each part, once after the other; the points; the greatest memory, bytes."""
    seconds, clock = {}, [time.perf_counter()]

    def lap(name: str) -> None:
        clock.append(time.perf_counter())
        seconds[name] = clock[-1] - clock[-2]

    survey = Inputs.of(every).survey
    lap("simulate")
    candidates = find_candidates(survey)
    lap("candidates")
    found = find_roofs(survey, candidates)
    lap("roofs")
    results = calibrate_all(survey, found, SCENARIO_NAMES)
    lap("scenarios")
    refine_all(survey, candidates, {"C": results["C"]})
    lap("refinement")
    used = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {"every": every, "points": sum(map(len, survey.strips)), "seconds": seconds,
            "memory": used}  # fmt: skip


def in_a_process(every: int, compiled: bool = True) -> dict:
    """What `run` gives in a new process; not ``compiled``: with an empty cache of kernels."""
    with tempfile.TemporaryDirectory() as empty:
        cache = {} if compiled else {"NUMBA_CACHE_DIR": empty}
        command = [sys.executable, "-m", "tests.benchmarks.whole", str(every)]
        done = subprocess.run(
            command, env={**os.environ, **cache}, check=True, capture_output=True, text=True
        )
    return json.loads(done.stdout.splitlines()[-1])


if __name__ == "__main__":
    print(json.dumps(run(int(sys.argv[1]))))
