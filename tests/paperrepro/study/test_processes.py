"""Sweeps and studies whose processes are killed, stopped, or belong to another's scheduler."""

import itertools
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pandas as pd
import psutil
import pytest
from dask.distributed import Client, Security

from paperrepro.cli import main
from paperrepro.study import workers
from tests.paperrepro.study.sweeping import (
    MEASURES,
    arguments,
    begun,
    expected_keys,
    kernels,
    keys_of,
    rows_of,
    write_notebook,
)

pytestmark = pytest.mark.slow

NOISES, SEEDS = "0,1,2", 4
RUNS = 12
PATIENCE_S = 120


@pytest.fixture
def sweep(tmp_path):
    """A sweep of a dozen runs of a second, each leaving a line in ``log``, as its arguments."""
    notebook = write_notebook(tmp_path / "standin.ipynb")
    more = ["--grid", "lasts_s=0.6", "--grid", f"log={tmp_path / 'log'}"]
    return arguments(notebook, tmp_path / "out", *more, noise=NOISES, seeds=SEEDS)


@contextmanager
def started(command, text=False, env=None):
    """A process in a group of its own, as a shell starts it in the foreground: it heeds SIGINT even
    where these tests, started in the background, were told not to. Ended with all it started."""
    pipe = subprocess.PIPE if text else subprocess.DEVNULL
    process = subprocess.Popen(
        command, start_new_session=True, text=True, stdout=pipe, stderr=pipe, env=env,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    try:
        yield process
    finally:
        for one in family(process):
            one.kill()
        process.wait()


def paperrepro(arguments):
    return [sys.executable, "-m", "paperrepro", *arguments]


def family(process):
    """It and all processes below it, kernels too."""
    try:
        parent = psutil.Process(process.pid)
        return [*parent.children(recursive=True), parent]
    except psutil.NoSuchProcess:
        return []


def until(happened, process=None):
    end = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < end, "it took too long"
        assert process is None or process.poll() is None, "the process is over already"
        time.sleep(0.02)


def finished(folder):
    return {path.stem for path in (folder / "out" / "runs").glob("*.csv")}


def all_gone(processes):
    return not psutil.wait_procs(processes, timeout=30)[1]


def test_a_worker_that_is_killed_loses_and_doubles_nothing(sweep, tmp_path):
    log = tmp_path / "log"
    with started(paperrepro([*sweep, "--workers", "2"]), text=True) as process:
        until(lambda: len(finished(tmp_path)) >= 2, process)
        before = len(begun(log))
        until(lambda: len(begun(log)) > before, process)  # a run has just begun
        kernel = psutil.Process(kernels(log)[-1])
        worker = kernel.parent()
        assert process.pid in {parent.pid for parent in worker.parents()}
        worker.kill()
        assert all_gone([kernel]), "the kernel outlives its worker"
        out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, err
    assert f"{RUNS} of {RUNS} runs" in out
    rows = rows_of(tmp_path / "out")
    assert keys_of(rows) == expected_keys(NOISES.split(","), SEEDS)
    assert len(begun(log)) == RUNS + 1  # what the worker was at is begun again


def test_a_sweep_that_is_ended_again_and_again_goes_on_with_what_is_missing(sweep, tmp_path):
    """At its start, in its middle and close to its end, by a signal that it heeds and by one that
    it cannot."""
    log, command = tmp_path / "log", paperrepro([*sweep, "--workers", "1"])
    log.touch()
    kept, ends = set(), itertools.product((0, 4, RUNS - 2), (signal.SIGTERM, signal.SIGKILL))
    for moment, how in ends:
        with started(command) as process:
            until(lambda: len(family(process)) > 2, process)
            until(lambda moment=moment: len(finished(tmp_path)) >= moment, process)
            processes = family(process)
            process.send_signal(how)
            assert all_gone(processes), "workers or kernels outlive the sweep"
        assert kept <= finished(tmp_path)
        kept = finished(tmp_path)
        assert moment <= len(kept) < RUNS
    lines = len(begun(log))
    subprocess.run(command, check=True, capture_output=True)
    again = begun(log)[lines:]
    assert len(again) == len(set(again)) == RUNS - len(kept)
    assert not list(tmp_path.rglob("*.part"))
    assert keys_of(rows_of(tmp_path / "out")) == expected_keys(NOISES.split(","), SEEDS)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_stopped_it_ends_cleanly_and_says_how_to_go_on(sweep, tmp_path, how):
    with started(paperrepro([*sweep, "--workers", "2"]), text=True) as process:
        until(lambda: len(finished(tmp_path)) >= 2, process)
        processes = family(process)
        # a terminal sends Ctrl-C to the whole group, a cluster its signal to the job
        (os.killpg if how == signal.SIGINT else os.kill)(process.pid, how)
        out, err = process.communicate(timeout=PATIENCE_S)
        assert all_gone(processes), "workers or kernels outlive the sweep"
    kept = len(finished(tmp_path))
    assert process.returncode == 130
    assert "Traceback" not in err, err
    assert f"{kept} of {RUNS} runs" in out
    assert "stopped (interrupted); the same command goes on" in err
    assert 2 <= kept < RUNS
    assert len(rows_of(tmp_path / "out")) == len(expected_keys("0", 1)) * kept


@contextmanager
def scheduler(folder, workers, *more):
    """A Dask scheduler and so many workers, each a process that knows only its address."""
    dask = Path(sys.executable).with_name("dask")
    with ExitStack() as stack:
        address = folder / "scheduler.json"
        command = [dask, "scheduler", "--port", "0", "--no-dashboard", "--host", "127.0.0.1"]
        process = stack.enter_context(started([*command, "--scheduler-file", address]))
        until(address.exists)
        found = re.search(r"tcp://[\d.:]+", address.read_text())[0]
        command = [dask, "worker", found, "--nthreads", "1", "--no-dashboard", *more]
        places = [folder / f"worker{k}" for k in range(workers)]
        processes = [
            stack.enter_context(started([*command, "--local-directory", place])) for place in places
        ]
        yield found, processes, process


def test_an_external_scheduler_gives_the_rows_of_a_local_one(sweep, tmp_path, capsys):
    local = [*sweep, "--workers", "2"]
    subprocess.run(paperrepro(local), check=True, capture_output=True)
    rows = rows_of(tmp_path / "out")
    elsewhere = [str(tmp_path / "far") if part == str(tmp_path / "out") else part for part in sweep]
    with scheduler(tmp_path, 2) as (address, workers, _):
        lines = len(begun(tmp_path / "log"))
        command = paperrepro([*elsewhere, "--scheduler", address])
        made = subprocess.run(command, check=True, capture_output=True, text=True)
        used = {psutil.Process(worker.pid) for worker in workers}
        left = [one for worker in used for one in worker.children(recursive=True)]
        assert not any("ipykernel" in " ".join(one.cmdline()) for one in left)
        # asked again, nothing is done
        subprocess.run(command, check=True, capture_output=True)
    assert "2 workers" in made.stdout
    assert len(begun(tmp_path / "log")) - lines == RUNS
    assert len(set(kernels(tmp_path / "log")[lines:])) == 2  # both workers had a part
    pd.testing.assert_frame_equal(rows_of(tmp_path / "far"), rows)


def test_where_no_scheduler_answers(sweep, monkeypatch, capsys):
    monkeypatch.setattr(workers, "_CONNECT_S", 1)
    assert main([*sweep, "--scheduler", "tcp://127.0.0.1:9"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "tcp://127.0.0.1:9" in line
    assert "dask scheduler" in line


def test_a_kernel_that_dies_is_a_failure_of_its_run_alone(tmp_path):
    notebook = write_notebook(tmp_path / "standin.ipynb")
    command = arguments(notebook, tmp_path / "out", "--workers", "1", noise="99,1", seeds=1)
    done = subprocess.run(paperrepro(command), capture_output=True, text=True)
    assert done.returncode == 1
    assert re.search(r"failed: .*noise_scale=99.0.*: DeadKernelError", done.stderr)
    rows = rows_of(tmp_path / "out")
    assert keys_of(rows[rows.metric != "failed"]) == expected_keys("1", 1)


def test_a_scheduler_without_workers_is_waited_for_with_words_and_a_limit(sweep, tmp_path):
    with scheduler(tmp_path, 0) as (address, _, _):
        command = paperrepro([*sweep, "--scheduler", address, "--wait", "2"])
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 2
    assert "no worker has joined yet; waiting up to 2 s" in done.stdout
    (line,) = done.stderr.splitlines()
    assert f"dask worker {address}" in line


def test_a_scheduler_that_is_killed_is_said_in_a_line(sweep, tmp_path):
    with scheduler(tmp_path, 1) as (address, _, asked):
        command = paperrepro([*sweep, "--scheduler", address])
        with started(command, text=True) as process:
            until(lambda: len(finished(tmp_path)) >= 1, process)
            asked.kill()
            out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert "stopped (the scheduler is gone); the same command goes on" in err
    assert "failed" not in err.replace("0 failed", "")
    kept = len(finished(tmp_path))
    assert f"{kept} of {RUNS} runs" in out
    assert not (tmp_path / "out" / "failed.csv").exists()


def test_workers_that_are_gone_for_good_end_the_sweep(sweep, tmp_path):
    with scheduler(tmp_path, 1) as (address, (worker,), _):
        command = paperrepro([*sweep, "--scheduler", address, "--wait", "3"])
        with started(command, text=True) as process:
            until(lambda: len(finished(tmp_path)) >= 1, process)
            for one in family(worker):
                one.kill()
            _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert "all workers are gone since 3 s" in err


def test_a_run_that_eats_memory_or_talks_too_much_harms_itself_alone(tmp_path):
    """A worker has a share of the machine's memory, here 400 MB."""
    source = """
if noise_scale == 50:
    hoard = bytearray(2**30)
    hoard[:: 4096] = b"x" * len(hoard[:: 4096])
    import time; time.sleep(20)
if noise_scale == 60:
    print("word " * 1_000_000)
"""
    notebook = write_notebook(tmp_path / "standin.ipynb", source + MEASURES)
    with scheduler(tmp_path, 1, "--memory-limit", "400MB") as (address, _, _):
        more = ["--scheduler", address]
        command = arguments(notebook, tmp_path / "out", *more, noise="50,60,1", seeds=1)
        done = subprocess.run(paperrepro(command), capture_output=True, text=True)
    assert done.returncode == 1
    (line,) = (line for line in done.stderr.splitlines() if line.startswith("failed"))
    assert "noise_scale=50.0" in line
    assert "it took more than the 0.4 GiB of its worker" in line
    rows = rows_of(tmp_path / "out")
    assert keys_of(rows[rows.metric != "failed"]) == expected_keys(["1", "60"], 1)
    (talker,) = (tmp_path / "out" / "runs").glob("*noise_scale-60.0*.ipynb")
    assert talker.stat().st_size < 100_000
    assert "characters more" in talker.read_text()


def test_workers_on_this_machine_do_not_talk_to_strangers():
    with workers.cluster(workers=1) as client:
        address = client.scheduler.address
        assert address.startswith("tls://127.0.0.1:")
        with pytest.raises((OSError, TimeoutError)):
            Client(address.replace("tls", "tcp"), timeout=2)
        with pytest.raises((OSError, TimeoutError, TypeError, RuntimeError)):
            Client(address, timeout=2, security=Security.temporary())


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
@pytest.mark.parametrize("moment", ["start", "workers", "survey"])
def test_a_study_that_is_ended_leaves_no_process_and_goes_on(tmp_path, how, moment):
    """Of surveys in no time, by workers of its own."""
    environment = {**os.environ, "PAPERREPRO_CACHE": str(tmp_path / "cache")}
    study = paperrepro(["study", "--seeds", "2", "--noise-scale", "1", "--preset", "mount",
                        "--workers", "1", "--out", str(tmp_path / "study.csv")])  # fmt: skip
    with started(study, env=environment) as process:
        if moment != "start":
            until(lambda: len(family(process)) > 2, process)
        time.sleep(6.0 if moment == "survey" else 1.0)
        processes = family(process)
        os.kill(process.pid, how)
        code = process.wait(timeout=PATIENCE_S)
        assert all_gone(processes), "workers outlive the study"
    assert code == (130 if how == signal.SIGTERM else -signal.SIGKILL)
    assert not (tmp_path / "study.csv").exists()
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.skipif(not shutil.which("setpriv"), reason="needs setpriv of Linux")
def test_a_kernel_ends_with_the_process_that_started_it(tmp_path):
    """At once, even where that was killed and the kernel, here a slow one, is still starting."""
    (tmp_path / "sitecustomize.py").write_text("import time; time.sleep(5)")
    code = f"""
import os, signal
from paperrepro.study.kernel import Kernel
kernel = Kernel("one", {{"PYTHONPATH": {str(tmp_path)!r}}})
print(kernel._manager.provisioner.process.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""
    told = tmp_path / "pid"
    with told.open("w") as file:
        assert subprocess.run([sys.executable, "-c", code], stdout=file).returncode < 0
    deadline = time.monotonic() + 2.5
    while alive(int(told.read_text())):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def alive(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
