"""Commands ended at chosen moments, again and again, each time in a process of its own.

    python -m tests.paperrepro.ending FOLDER COMMAND...

The folder has `flight/` of a tiny survey; what a command writes lies in a folder of its name. What
became of the runs is printed as JSON. Processes are forked from one that has imported what they
need; commands with workers are not among them, since threads do not survive a fork.
"""

import atexit
import functools
import importlib
import json
import os
import signal
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import paperrepro as pr
from data_synth import make_config, presets
from paperrepro import cli
from paperrepro.flight import calibrate
from paperrepro.paper import reproduce
from paperrepro.study import simulated
from tests.paperrepro.study.sweeping import write_notebook

#: What Python reports of changes to files, by the `sys.audit` event: which argument is the path.
CHANGES = {"os.mkdir": 0, "os.rename": 1, "os.remove": 0, "os.rmdir": 0, "shutil.rmtree": 0,
           "tempfile.mkdtemp": 0}  # fmt: skip
#: Of each command, files whose change is in the middle of its work, and among its last.
MOMENTS = {
    "simulate": ("new/F4.laz", "out/truth.json"),
    "calibrate": ("report.html.part", "out/report.html"),
    "apply": ("new/F2.laz", "out/F7.laz"),
    "reproduce": ("/01_part.ipynb", "out/report.html"),
}
SIGNALS = {"TERM": signal.SIGTERM, "KILL": signal.SIGKILL}
#: One firing sequence in so many is simulated.
THINNING = 128
REPRODUCED = """
from pathlib import Path
from paperrepro.study.rows import SurveyKey, frame, write_csv
row = SurveyKey("mount", "quick", 1.0, seed).row("table4", "A", "omega", "deg", 0.5)
write_csv(frame([row]), Path(figures_dir) / "rows", "part")
(Path(figures_dir) / "part.txt").write_text(str(seed))
"""


def command_of(name: str, folder: Path, out: Path) -> list[str]:
    """Its arguments, for results in ``out``."""
    flight = folder / "flight"
    strips = [str(flight / f"{strip}.laz") for strip in ("F1", "F2", "F7")]
    files = [*strips, "--trajectory", str(flight / "mission.sbet"),
             "--mounting", str(flight / "mounting.toml"), "--out", str(out)]  # fmt: skip
    if name == "calibrate":
        return [name, *files, "--planes", "any", "--scenario", "SL", "--write-strips"]
    if name == "apply":
        return [name, *files, "--calibration", str(flight / "truth.json")]
    return [name, "--out", str(out), *(["--force"] if name == "simulate" else ["--jobs", "1"])]


def prepare(folder: Path) -> None:
    """Stand-ins for what is long: pulses, passes, notebooks."""
    presets.PROFILES["quick"] = THINNING
    survey, truth = simulated.simulate(make_config())
    strips = tuple(survey.strip(name) for name in ("F1", "F2", "F7"))
    own = pr.calibrate_flight(replace(survey, strips=strips), "SL", "any")
    calibrate.calibrate_flight = lambda *given: own
    few = [strip.take(slice(None, None, 10)) for strip in survey.strips]
    made = replace(survey, strips=tuple(few)), truth
    simulated.simulate = functools.wraps(simulated.simulate)(lambda config: made)
    reproduce.NOTEBOOKS = folder / "notebooks"
    reproduce.NOTEBOOKS.mkdir()
    write_notebook(reproduce.NOTEBOOKS / "01_part.ipynb", REPRODUCED)


def ended(command: list[str], folder: Path, at: str | None = None, how: int = 0) -> dict:
    """What becomes of ``command`` if signal ``how`` comes when a file whose name ends with ``at``
    is about to be changed (None: no signal)."""
    told, errors = folder / "told.txt", folder / "errors.txt"
    child = os.fork()
    if not child:
        os.environ |= {"PAPERREPRO_CACHE": str(folder / "cache"), "TMPDIR": str(folder / "tmp")}
        tempfile.tempdir = None
        os.dup2(os.open(told, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND), 1)
        os.dup2(os.open(errors, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND), 2)
        if at is not None:
            sys.addaudithook(lambda *event: _look(*event, folder, at, how))
        try:
            code = cli.main(command)
        except SystemExit as end:
            code = end.code
        atexit._run_exitfuncs()
        sys.stdout.flush(), sys.stderr.flush()
        os._exit(code)  # threads of libraries that were loaded before the fork cannot be ended
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return {"code": code, "told": told.read_text(), "errors": errors.read_text(),
            "left": left_in(folder)}  # fmt: skip


def _look(event: str, about: tuple, folder: Path, at: str, how: int) -> None:
    place = CHANGES.get(event)
    if event == "open" and isinstance(about[2], int) and about[2] & (os.O_WRONLY | os.O_RDWR):
        place = 0
    path = "" if place is None else str(about[place])
    if path.startswith(str(folder)) and path.endswith(at) and not _sent:
        _sent.append(how)
        os.kill(os.getpid(), how)


_sent: list[int] = []


def left_in(folder: Path) -> list[str]:
    """What lies in the folder of results, and unfinished in those of caches and temporary files."""
    found = [*(folder / "out").rglob("*"), *(folder / "tmp").rglob("*")]
    found += (folder / "cache").rglob("*part*")
    return sorted(str(path.relative_to(folder)) for path in found)


def ends_of(folder: Path, name: str) -> list[dict]:
    """What becomes of an undisturbed run, six that are ended, and one that goes on."""
    within = folder / name
    (within / "tmp").mkdir(parents=True)
    ends = [ended(command_of(name, folder, within / "undisturbed"), within)]
    command = command_of(name, folder, within / "out")
    for at in ("", *MOMENTS[name]):
        ends += [{"at": at, "how": how} | ended(command, within, at, SIGNALS[how])
                 for how in SIGNALS]  # fmt: skip
    return [*ends, ended(command, within)]


if __name__ == "__main__":
    import open3d  # noqa: F401  as the commands do

    folder, *names = sys.argv[1:]
    prepare(Path(folder))
    for module in (".figures.pages", ".figures.flight", ".flight.write"):
        importlib.import_module(module, "paperrepro")
    result = {name: ends_of(Path(folder), name) for name in names}
    print(json.dumps(result, indent=1))
