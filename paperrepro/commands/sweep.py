"""``paperrepro sweep``: a notebook executed over a grid of parameters, by Dask; rows and plots."""

import argparse
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from paperrepro.errors import BadInput

SEEDS = 20
_LISTED = 20


def add(commands) -> None:
    command = commands.add_parser(
        "sweep", help="execute a notebook over a grid of parameters, on this machine or a cluster"
    )
    command.add_argument(
        "--grid", action="append", default=[], metavar="NAME=VALUE,VALUE",
        help="values of a parameter, such as noise_scale=0,1,2; may be given for several",
    )  # fmt: skip
    command.add_argument("--seeds", type=int, help=f"seeds 1 to so many (default {SEEDS})")
    command.add_argument("--out", type=Path, required=True, help="folder; started again, goes on")
    command.add_argument("--workers", type=int, help="processes here (default: one a core)")
    command.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="a Dask scheduler that is running"
    )
    command.add_argument(
        "--notebook", type=Path, help="what is executed (default: one survey, measured)"
    )
    command.add_argument(
        "--retry-failed", action="store_true", help="make runs anew that have failed before"
    )
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    from paperrepro.paper.reproduce import NOTEBOOKS
    from paperrepro.study.grid import Fingerprint, points, read_grid
    from paperrepro.study.notebooks import declared, without_outputs
    from paperrepro.study.store import Store

    _refuse_what_contradicts(options)
    notebook = options.notebook or NOTEBOOKS / "08_noise_sweep_run.ipynb"
    known = declared(notebook)
    grid = read_grid(options.grid, known, _seeds(options, known))
    text = without_outputs(notebook)
    fingerprint = Fingerprint.of(text)
    runs = points(grid, known, fingerprint)
    _refuse_what_cannot_be_simulated(runs)
    with Store(options.out) as store, _terminated_as_interrupted():
        about = {"notebook": notebook.name, "grid": grid, **fingerprint.told()}
        waiting = [point for point in runs if _waits(store, point, options.retry_failed)]
        _announce(runs, waiting, store)
        progress = _drive(options, waiting, text, fingerprint, store)
        varied = [name for name, values in grid.items() if len(values) > 1]
        rows = store.write(runs, varied, about)
        _print_failures(store, runs, progress)
        done = sum(store.is_done(point) for point in runs)
        print(f"{options.out / 'sweep.csv'}: {done} of {len(runs)} runs, {len(rows)} rows")
        if progress.interrupted:
            print("stopped; the same command goes on where it stopped")
        elif done:
            _draw(rows, options.out)
    return 0 if done == len(runs) else 1


def _refuse_what_contradicts(options: argparse.Namespace) -> None:
    if options.workers is not None and options.scheduler:
        raise BadInput(
            "--workers and --scheduler: expected one of them; a scheduler brings its own workers"
        )
    if options.workers is not None and options.workers < 1:
        raise BadInput(f"--workers: expected at least 1, got {options.workers}; give a number")


def _seeds(options: argparse.Namespace, known) -> int | None:
    """As asked; the default only where the notebook has a seed and the grid does not name it."""
    from paperrepro.study.grid import SEED

    named = any(text.startswith(f"{SEED}=") for text in options.grid)
    return SEEDS if options.seeds is None and SEED in known and not named else options.seeds


def _refuse_what_cannot_be_simulated(runs) -> None:
    """The simulator's own checks, where the parameters are its own."""
    from dataclasses import fields

    from data_synth import SimulationConfig, make_config

    own = {field.name for field in fields(SimulationConfig)}
    for point in runs:
        make_config(**{name: value for name, value in point.parameters.items() if name in own})


def _waits(store, point, retry_failed: bool) -> bool:
    return not store.is_done(point) and (retry_failed or store.failure(point) is None)


def _announce(runs, waiting, store) -> None:
    done = sum(store.is_done(point) for point in runs)
    failed = len(runs) - done - len(waiting)
    words = [f"{len(runs)} runs", f"{done} done before", f"{len(waiting)} to do"]
    if failed:
        words.append(f"{failed} failed before (--retry-failed makes them anew)")
    print(", ".join(words))
    if others := store.others(runs):
        print(f"{store.folder}: {others} runs of other parameters, notebooks or versions, not used")


def _drive(options: argparse.Namespace, waiting, text: str, fingerprint, store):
    """Make the runs that are ``waiting``; Ctrl-C at any time ends it with what is done."""
    from paperrepro.study.workers import Progress, check_workers, cluster, drive

    if not waiting:
        return Progress()
    start = time.perf_counter()
    try:
        with cluster(options.scheduler, options.workers) as client:
            workers = check_workers(client, text, fingerprint)
            print(f"{workers} workers, dashboard {client.dashboard_link}", flush=True)
            progress = drive(client, waiting, text, fingerprint, store)
            seconds = time.perf_counter() - start
    except KeyboardInterrupt:
        return Progress(interrupted=True)
    made = len(progress.done) + len(progress.failed)
    print(
        f"{made} runs in {seconds:.1f} s, {progress.seconds / max(made, 1):.1f} s each: {progress}"
    )
    return progress


def _print_failures(store, runs, progress) -> None:
    failed = {point: store.failure(point) for point in runs}
    failed = {point: error for point, error in failed.items() if error} | progress.lost
    for point in list(failed)[:_LISTED]:
        told = " ".join(f"{name}={value}" for name, value in point.parameters.items())
        print(f"failed: {told}: {failed[point]}", file=sys.stderr)
    if len(failed) > _LISTED:
        more = len(failed) - _LISTED
        print(f"and {more} more, see {store.folder / 'failed.csv'}", file=sys.stderr)


def _draw(rows, folder: Path) -> None:
    from paperrepro import figures
    from paperrepro.figures import study as draw

    figures.use_style()
    for name, figure, data in draw.pictures(rows):
        figures.save(figure, folder, name, data)
        print(folder / f"{name}.png")


@contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """A cluster ends a job by SIGTERM: the same as Ctrl-C."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
