"""The command line: quick to help, one line for what is wrong, stopped in a line."""

import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import data_synth
from data_synth import operator, presets
from paperrepro import cli
from paperrepro.errors import NoConvergence
from paperrepro.flight.calibrate import PLANES

COMMANDS = ("reproduce", "simulate", "calibrate", "apply", "sweep", "study", "cache")


def ran(code, *arguments, **options):
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, **options)


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_costs_no_library(option):
    code = f"""
import sys, time
from paperrepro.cli import main
try:
    main(["{option}"])
except SystemExit as end:
    heavy = {{"numba", "pandas", "scipy", "matplotlib", "dask"}} & set(sys.modules)
    print(end.code, time.process_time(), heavy, file=sys.stderr)
"""
    code, seconds, heavy = ran(code).stderr.split(maxsplit=2)
    assert code == "0"
    assert heavy.strip() == "set()"
    assert float(seconds) < 0.3


def test_what_is_spelt_out_for_help_is_what_there_is():
    assert set(cli.PRESETS) == set(data_synth.PRESETS)
    assert set(cli.PROFILES) == set(data_synth.PROFILES)
    assert (cli.SCENES, cli.TERRAINS) == (presets.SCENES, presets.TERRAINS)
    assert cli.PLANES == PLANES
    assert cli.SITE == (operator.LATITUDE_DEG, operator.LONGITUDE_DEG, operator.HEIGHT_M)


@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_has_an_example(capsys, command):
    with pytest.raises(SystemExit):
        cli.main([command, "--help"])
    assert f"Example: paperrepro {command} " in capsys.readouterr().out


def test_help_shows_the_commands_and_an_example_of_each_in_the_order_of_work(capsys):
    with pytest.raises(SystemExit):
        cli.main(["--help"])
    listed, examples = capsys.readouterr().out.split("Examples, ")
    assert re.findall(r"^ {4}(\w+)", listed.partition("COMMAND\n")[2], re.M) == [*COMMANDS]
    assert re.findall(r"^  paperrepro (\w+) ", examples, re.M) == [*COMMANDS]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "COMMAND"),
        (["fly"], "invalid choice: 'fly'"),
        (["simulate", "--out", "x", "--preset", "other"], "invalid choice: 'other'"),
        (["reproduce", "--jobs", "0"], "--jobs: expected at least 1"),
        (["simulate", "--out", "/dev/null/x"], "/dev/null/x: cannot be written"),
        (
            ["calibrate", __file__, "--mounting", __file__, "--out", "x", "--set", "angle=2"],
            "'angle'",
        ),
        (["reproduce", "--out", "/dev/null/x"], "/dev/null/x: cannot be written"),
        (["study", "--out", "/dev/null/x/study.csv"], "/dev/null/x: cannot be written"),
    ],
)
def test_bad_input_is_one_line(capsys, arguments, words):
    assert cli.main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("paperrepro: ")
    assert words in line


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (NoConvergence("no end"), 1, "no end"),
        (OSError(28, "No space left on device", "/x"), 1, "/x: No space left on device"),
        (KeyError("what"), 1, "KeyError: 'what'; this is a fault of the program: report it"),
        (MemoryError("Unable to allocate 1 TiB"), 1, "out of memory (Unable to allocate 1 TiB)"),
        (KeyboardInterrupt(), 130, "stopped"),
    ],
)
def test_what_is_raised_is_one_line(monkeypatch, tmp_path, capsys, error, code, words):
    monkeypatch.setenv("PAPERREPRO_CACHE", str(tmp_path))
    simulate_raises(monkeypatch, error)
    assert cli.main(["simulate", "--out", "x"]) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line


def simulate_raises(monkeypatch, error):
    def fails(options):
        raise error

    fails.__name__ = "_simulate"
    monkeypatch.setattr(cli, "_simulate", fails)


class Panic(BaseException):
    """As a library of Rust raises it."""


@pytest.mark.parametrize("error", [ZeroDivisionError("division\nby zero"), Panic("index")])
def test_what_is_unforeseen_is_written_down(monkeypatch, tmp_path, capsys, error):
    monkeypatch.setenv("PAPERREPRO_CACHE", str(tmp_path / "cache"))
    simulate_raises(monkeypatch, error)
    assert cli.main(["simulate", "--out", "x y"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    (log,) = (tmp_path / "cache" / "faults").iterdir()
    assert str(log) in line
    text = log.read_text()
    assert "paperrepro simulate --out 'x y'" in text
    assert f"numpy: {np.__version__}" in text
    assert "Traceback" in text
    assert "in fails\n    raise error" in text
    (tmp_path / "file").touch()
    monkeypatch.setenv("PAPERREPRO_CACHE", str(tmp_path / "file"))
    assert cli.main(["simulate", "--out", "x y"]) == 1
    assert "with what --verbose shows" in capsys.readouterr().err


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("after_s", [0.15, 0.5, 1.5])
def test_stopped_at_any_time_it_says_so_in_a_line_and_leaves_nothing(tmp_path, how, after_s):
    command = [sys.executable, "-m", "paperrepro", "simulate", "--profile", "paper",
               "--out", str(tmp_path / "out")]  # fmt: skip
    environment = {**os.environ, "PAPERREPRO_CACHE": str(tmp_path / "cache")}
    process = subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, env=environment,
        preexec_fn=lambda: [signal.signal(number, signal.SIG_DFL) for number in cli._STOPS],
    )  # fmt: skip
    until_it_listens(process)
    time.sleep(after_s)
    process.send_signal(how)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.splitlines() == ["paperrepro: stopped"]
    assert not (tmp_path / "out").exists()


def until_it_listens(process):
    """Python itself has started, and the signals are ours."""
    while True:
        with open(f"/proc/{process.pid}/status") as status:
            (caught,) = [line.split()[1] for line in status if line.startswith("SigCgt")]
        if int(caught, 16) & 1 << (signal.SIGTERM - 1):
            return
        assert process.poll() is None
        time.sleep(0.005)


def test_a_hangup_that_is_ignored_stays_ignored():
    """As under nohup."""
    code = """
import signal
from paperrepro import cli
signal.signal(signal.SIGHUP, signal.SIG_IGN)
with cli._signals(signal.default_int_handler):
    print(signal.getsignal(signal.SIGHUP) == signal.SIG_IGN)
"""
    assert ran(code).stdout.strip() == "True"


def test_a_reader_that_goes_away_is_no_error():
    command = f"{sys.executable} -m paperrepro study --help | true"
    done = subprocess.run(command, shell=True, capture_output=True, text=True)
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("strip", "out", "err"),
    [
        ("none.laz", "", "paperrepro: none.laz: no such file; give one that is there\n"),
        (__file__, "calibrate: loading libraries\n", "a library\n"),
    ],
)
def test_before_libraries_are_loaded(strip, out, err):
    """A missing file is told, or what is to be done."""
    code = """
import sys
from paperrepro import cli
cli.importlib.import_module = lambda *_: sys.exit("a library")
sys.exit(cli.main(sys.argv[1:]))
"""
    more = ["calibrate", strip, "--mounting", __file__, "--out", "x"]
    ended = subprocess.run([sys.executable, "-c", code, *more], capture_output=True, text=True)
    assert (ended.stdout, ended.stderr) == (out, err)
