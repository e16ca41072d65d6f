"""Commands ended by a signal at their begin, in their middle and among their last words, started
again, and compared with one that nobody disturbed. Those with workers: study/test_processes.py."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace

import pytest

from data_synth.operator import Site, write_survey
from paperrepro.study.environment import ONE_THREAD
from tests.paperrepro.ending import MOMENTS

#: Every so many points of the strips.
THINNING = 40
#: Written with times and lengths of their making.
VARYING = ("_part.html", ".ipynb", ".lock")


@pytest.fixture(scope="module")
def ends(flown, tmp_path_factory):
    """What became of all runs, by command, and where they wrote."""
    folder = tmp_path_factory.mktemp("ended")
    names = ("F1", "F2", "F7")
    strips = [flown.survey.strip(name).take(slice(None, None, THINNING)) for name in names]
    (folder / "flight").mkdir()
    survey = replace(flown.survey, strips=tuple(strips))
    write_survey(folder / "flight", survey, flown.truth, Site(), 1e-4)
    command = [sys.executable, "-m", "tests.paperrepro.ending", str(folder), *MOMENTS]
    one_thread = {**os.environ, **ONE_THREAD}  # threads do not survive a fork
    done = subprocess.run(command, capture_output=True, text=True, env=one_thread, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), folder


def files(folder):
    found = {str(path.relative_to(folder)): path for path in folder.rglob("*") if path.is_file()}
    return {name: path for name, path in found.items() if not name.endswith(VARYING)}


def without_times(path):
    return re.sub(rb"[0-9.]+ s\b", b"", path.read_bytes())


@pytest.mark.parametrize("name", MOMENTS)
def test_ended_and_started_again_it_gives_what_an_undisturbed_run_gives(ends, name):
    runs, folder = ends[0][name], ends[1] / name
    assert [run["code"] for run in runs] == [0, *[130, -9] * 3, 0], runs
    right, found = files(folder / "undisturbed"), files(folder / "out")
    assert right
    assert set(found) == set(right)
    for path, whole in right.items():
        assert without_times(found[path]) == without_times(whole), path


@pytest.mark.parametrize("name", MOMENTS)
def test_a_signal_ends_it_in_a_line_and_leaves_nothing_half_written(ends, name):
    runs = [run for run in ends[0][name] if run.get("how") == "TERM"]
    for run in runs:
        assert "Traceback" not in run["errors"], run
        # a kernel whose parent has gone may say so last
        said = [line for line in run["errors"].splitlines() if "IPKernelApp" not in line]
        assert "paperrepro: stopped" in said[-1], run
        left = [path for path in run["left"] if not path.startswith("tmp/paperrepro-files-")]
        assert left == [], run


@pytest.mark.parametrize("name", MOMENTS)
def test_what_a_kill_leaves_the_next_start_clears(ends, name):
    *_, last = ends[0][name]
    left = [path for path in last["left"] if "unfinished" in path or path.endswith(".part")]
    assert left == []
    temporary = [path for path in last["left"] if path.startswith("tmp/")]
    assert len(temporary) <= 1, temporary  # the folder in which they would lie
