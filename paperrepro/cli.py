"""Reproduce a calibration of UAV LiDAR, calibrate your own flight, or sweep simulated ones.

Exit codes: 0 done; 2 bad input, one line on stderr; 130 stopped by Ctrl-C, SIGTERM or SIGHUP; 1
anything else.
"""

import argparse
import importlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import paperrepro as pr
from paperrepro._files import require_folder, write_text, written_whole
from paperrepro.errors import BadInput, PaperReproError

# What can be chosen, spelt out so that --help need not load what offers it; a test compares them.
PRESETS, PROFILES = ("mount", "table4"), ("quick", "paper")
SCENES, TERRAINS = ("farm", "forest", "yard", "fields"), ("rolling", "natural")
PLANES = "auto", "gables", "any"
SITE = -25.754444, -49.394167, 900.0
#: Where `study` leaves its rows: the ledger reads them there.
STUDY = Path("figures/study.csv")
_LISTED = 20
#: Options that name a file, beside the strips.
_FILES = "trajectory", "mounting", "calibration", "checkpoints", "control", "accuracy", "site"
_EXAMPLE = "F*.laz --trajectory mission.sbet --mounting mounting.toml"
_STOPS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``paperrepro`` and ``python -m paperrepro``; gives the exit code."""
    verbose = False
    for stream in (sys.stdout, sys.stderr):  # names of files and symbols that a console has not
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    try:
        options = _parser().parse_args(arguments)
        verbose = options.verbose
        os.environ.setdefault("OPEN3D_DISABLE_WEB_VISUALIZER", "true")  # no web server
        if options.quiet:
            os.environ["TQDM_DISABLE"] = "1"  # no bar
        _require_files(options)
        with _signals(_end_at_once):  # nothing has been begun
            if options.needs and not options.quiet:
                print(f"{options.run.__name__.strip('_')}: loading libraries", flush=True)
            for module in options.needs:
                importlib.import_module(module, "paperrepro")
        with _signals(signal.default_int_handler):
            return options.run(options)
    except BadInput as error:
        return _told(str(error), 2)
    except PaperReproError as error:
        return _told(str(error), 1)
    except KeyboardInterrupt:
        return _told("stopped", 130)
    except BrokenPipeError:  # nobody reads on, as in `paperrepro ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _told(f"{where}{error.strerror or error}; make it readable, writable or larger", 1)
    except SystemExit:  # of --help
        raise
    except BaseException as error:  # a library of Rust panics with one that is no Exception
        if verbose:
            raise
        return _told(pr.study.environment.fault(error, arguments or sys.argv[1:]), 1)


def _require_files(options: argparse.Namespace) -> None:
    """Raise `BadInput` where a file is not there, before libraries take their seconds."""
    given = [*getattr(options, "strips", ()), *(getattr(options, name, None) for name in _FILES)]
    for path in given:
        if path is not None and not path.exists():
            raise BadInput(f"{path}: no such file; give one that is there")


def _told(words: str, code: int) -> int:
    print(f"paperrepro: {' '.join(words.split())}", file=sys.stderr)
    return code


def _end_at_once(*_) -> None:
    """Interrupting the import of a library would leave a traceback of its own."""
    os.write(2, b"paperrepro: stopped\n")
    os._exit(130)


@contextmanager
def _signals(handler: Callable) -> Iterator[None]:
    """A closed terminal and the end of a cluster's job are Ctrl-C, unless told to be ignored."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _STOPS}
    try:
        for number, was in before.items():
            if was is not signal.SIG_IGN:
                signal.signal(number, handler)
        yield
    finally:
        for number, was in before.items():
            signal.signal(number, was)


# Options


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str):
        raise BadInput(f"{message}; see {self.prog} --help")

    def option(self, name: str, words: str, default=None, **more) -> None:
        """An argument of the type of its ``default``, which ends its help."""
        if default is not None:
            more = {"type": type(default), **more}
            several = isinstance(default, tuple)
            shown = ",".join(map(str, default)) if several else default
            words += f" (default {shown})" if shown != "" else ""
        self.add_argument(name, default=default, help=words, **more)

    def flag(self, name: str, words: str) -> None:
        self.add_argument(name, action="store_true", help=words)


def _parser() -> argparse.ArgumentParser:
    how = argparse.RawDescriptionHelpFormatter
    parser = _Parser(prog="paperrepro", description=__doc__.splitlines()[0], formatter_class=how)
    parser.add_argument("--version", action="version", version=pr.__version__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for add in _COMMANDS:
        add(commands)
    examples = [command.epilog.partition(": ")[2] for command in commands.choices.values()]
    words = "Examples, in the order of work; each command has --help:"
    parser.epilog = "\n  ".join([words, *examples])
    return parser


def _command(commands, run: Callable, words: str, example: str, needs: str) -> _Parser:
    """A command with the options that all have; its modules ``needs`` are loaded before it runs."""
    name = run.__name__.strip("_")
    command = commands.add_parser(name, help=words, description=f"{words[0].upper()}{words[1:]}.")
    command.epilog = f"Example: paperrepro {name} {example}"
    how = command.add_mutually_exclusive_group()
    how.add_argument("-q", "--quiet", action="store_true", help="only say what went wrong")
    how.add_argument("-v", "--verbose", action="store_true", help="each step; origins of errors")
    command.set_defaults(run=run, needs=needs.split())
    return command


def _survey(command: _Parser, seed: int | None = 1, words: str = "of the survey") -> None:
    """Options of a simulated survey."""
    command.option("--preset", "true boresight: a degree, or Table 4's", "mount", choices=PRESETS)
    command.option("--profile", "one pulse in 16, or all", "quick", choices=PROFILES)
    command.option("--seed", words, seed, type=int)
    command.option("--noise-scale", "multiplies the GNSS/INS error", 1.0, metavar="FACTOR")


def _strips(command: _Parser) -> None:
    """An operator's files, and where what is made of them goes."""
    command.option("strips", "LAS or LAZ files", nargs="+", type=Path, metavar="STRIP")
    words = "SBET or text, unless the points hold poses"
    command.option("--trajectory", words, type=Path, metavar="FILE")
    command.option("--columns", "of a text without a head line, as time,lat,lon,height,roll,...")
    command.option("--mounting", "nominal mounting.toml", type=Path, required=True, metavar="FILE")
    command.option("--crs", "of the strips, as EPSG:31982; else their header's")
    command.option("--ring-dimension", "where a point's ring stands", "user_data", metavar="NAME")
    words = "rings, or without: one line, any rays; else as the mounting or the points say"
    command.option("--scanner", words, choices=("rings", "line", "any"))
    command.option("--out", "written whole", type=Path, required=True, metavar="DIR")
    command.flag("--mounting-only", "strips are written with the trajectory as reported")
    words = "CSV of surveyed points (name, x, y, z, sigma) that judge heights"
    command.option("--checkpoints", words, type=Path, metavar="FILE")


def _workers(command: _Parser) -> None:
    """Who does the work of many surveys."""
    command.option("--workers", "processes here; else one a core", type=int)
    command.option("--scheduler", "a Dask scheduler that is running", metavar="tcp://HOST:PORT")
    command.option("--wait", "how long its workers are waited for", 60.0, metavar="SECONDS")
    command.flag("--retry-failed", "make anew what has failed before")


def _work(options: argparse.Namespace) -> dict:
    return {
        "workers": options.workers, "scheduler": options.scheduler, "wait_s": options.wait,
        "retry_failed": options.retry_failed,
    }  # fmt: skip


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(float(part) for part in text.split(","))


def _names(text: str) -> tuple[str, ...]:
    return tuple(text.split(","))


def _say(options: argparse.Namespace) -> Callable[[str], None]:
    """How a command tells what it does."""
    return (lambda words: None) if options.quiet else lambda words: print(words, flush=True)


#: Reading, three passes, the adjustment, distances, the report.
_USUAL_STEPS = 7


def _steps(options: argparse.Namespace):
    """How a command on strips tells how far it is."""
    from paperrepro._progress import Steps

    lines = options.verbose or not sys.stderr.isatty()
    return Steps(len(options.strips) + _USUAL_STEPS, lines, options.quiet)


def _reproduce_options(commands) -> None:
    words = "execute every notebook; tables, figures, report (needs a clone)"
    needs = ".paper.reproduce .figures.pages"
    command = _command(commands, _reproduce, words, "--profile paper", needs)
    _survey(command, None, "of the survey; else the median one of the study in figures")
    words = "else figures with --profile paper, runs/quick without"
    command.option("--out", words, type=Path, metavar="DIR")
    command.option("--only", "notebooks by the start of their names", metavar="05,07", type=_names)
    command.option("--jobs", "notebooks at a time", 2)


def _reproduce(options: argparse.Namespace) -> int:
    import data_synth

    if options.jobs < 1:
        raise BadInput(f"--jobs: expected at least 1, got {options.jobs}; give a number")
    out = options.out or Path("figures" if options.profile == "paper" else "runs/quick")
    options.seed = options.seed or pr.paper.reproduce.median_seed()
    parameters = {k: getattr(options, k) for k in ("preset", "profile", "seed", "noise_scale")}
    data_synth.make_config(**parameters)  # refuses what cannot be, before anything runs
    say, start = _say(options), time.perf_counter()
    run = pr.study.rows.SurveyKey(**parameters)
    finish = lambda folder: pr.figures.pages.write(folder, run)  # noqa: E731
    pr.reproduce(out, parameters, options.only or (), options.jobs, say, finish)
    say(f"{out}: done in {time.perf_counter() - start:.0f} s")
    return 0


def _simulate_options(commands) -> None:
    words = "write a simulated survey as an operator has it: LAZ, SBET, mounting"
    command = _command(commands, _simulate, words, "--out flight", ".study.simulated open3d")
    command.option("--out", "written whole", type=Path, required=True, metavar="DIR")
    command.flag("--force", "replace files that are there")
    _survey(command)
    command.option("--scene", "what is flown over", "farm", choices=SCENES)
    command.option("--terrain", "how the ground runs", "rolling", choices=TERRAINS)
    words = "an error, or another parameter of the simulation, such as clock_delay_s=0.005"
    command.option("--error", words, action="append", metavar="NAME=VALUE")
    words = "TOML of the site's size, the flight plan and the scanner; else the farm, Table 1's"
    command.option("--site", words, type=Path, metavar="FILE")
    latitude, longitude, height = SITE
    command.option("--latitude", "of the farm, south negative", latitude, metavar="DEG")
    command.option("--longitude", "of the farm, west negative", longitude, metavar="DEG")
    command.option("--height", "of the farm, ellipsoidal", height, metavar="M")
    command.option("--zone", "of UTM; else the site's own", type=int)
    command.option("--scale", "resolution of the LAZ coordinates", 0.0001, metavar="M")


def _simulate(options: argparse.Namespace) -> int:
    import data_synth
    from data_synth.operator import Site, write_survey

    names = "preset", "profile", "seed", "noise_scale", "scene", "terrain"
    more = data_synth.presets.read_site(options.site) if options.site else {}
    more |= data_synth.presets.parse_parameters(options.error or ())
    config = data_synth.make_config(**{name: getattr(options, name) for name in names} | more)
    site = Site(options.latitude, options.longitude, options.height, options.zone)
    flown = pr.study.simulated.SimulatedSurvey(config, kept=True)
    with written_whole(options.out, options.force) as draft:
        write_survey(draft, flown.survey, flown.truth, site, options.scale)
    strips = flown.survey.strips
    words = f"{len(strips)} strips, {sum(map(len, strips))} points, EPSG:{site.epsg}"
    _say(options)(f"{options.out}: {words}")
    return 0


def _calibrate_options(commands) -> None:
    command = _command(
        commands, _calibrate, "calibrate your own flight: calibration.json, report.html, strips",
        f"{_EXAMPLE} --out calibrated",
        ".flight.read .flight.calibrate .flight.write .figures.pages .figures.flight",
    )  # fmt: skip
    _strips(command)
    words = "SL, A, B, C of the paper, D, ours, or as 'B 3', three points a face"
    command.option("--scenario", words, "D", metavar="NAME")
    command.option("--planes", "gable roofs, or patches of any kind", "auto", choices=PLANES)
    command.flag("--write-strips", "write the strips, too: new mounting, adjusted trajectory (D)")
    command.flag("--write-trajectory", "write the adjusted trajectory, too (D): SBET, SMRMSG")
    command.flag("--lever-arm", "estimate the lever arm, too (D); the given one is its prior")
    command.option("--control", "such points that enter D", type=Path, metavar="FILE")
    command.option("--accuracy", "SMRMSG of the trajectory", type=Path, metavar="FILE")
    command.option("--set", "parameters of Table 2, or a TOML file", "", metavar="NAME=VALUE,…")


def _calibrate(options: argparse.Namespace) -> int:
    pr.method.adjustment.scenarios.by_name(options.scenario)  # refuses what there is not
    parameters = pr.method.parameters.Parameters.read(options.set)
    if options.write_strips:
        pr.flight.read.require_apart(options.strips, options.out)
    if options.write_trajectory and (options.scenario[0] != "D" or not options.trajectory):
        raise BadInput("--write-trajectory: needs scenario D and --trajectory; give both")
    calibration, pages = pr.flight.calibration_file, pr.figures.pages
    with written_whole(options.out) as draft, _steps(options) as steps:
        steps("reading")
        flight = pr.read_flight(
            options.strips, options.trajectory, options.mounting, accuracy=options.accuracy,
            crs=options.crs, ring_dimension=options.ring_dimension, columns=options.columns,
            scanner=options.scanner, progress=steps.within,
        )  # fmt: skip
        if options.write_strips:
            pr.flight.write.require_writable(flight, options.out)
        ground = [pr.flight.read.read_control(path, flight)
                  for path in (options.checkpoints, options.control)]  # fmt: skip
        own = pr.calibrate_flight(
            flight, options.scenario, options.planes, steps, parameters, options.lever_arm, *ground
        )
        steps("report")
        errors, files = own.result.trajectory, None
        if options.write_trajectory:
            flown = flight.trajectory_file
            files = pr.flight.trajectory_file.write_adjusted(flown, flight.frame, errors, draft)
        calibration.write(own, draft / calibration.NAME, notes=list(flight.notes), trajectory=files)
        pictures = pr.figures.flight.pictures(own)
        page = pr.figures.flight.page(own, pictures, _files(options), flight.notes)
        write_text(draft / pages.NAME, page)
        if options.write_strips:
            steps("adjusted strips")
            correct = errors.poses if errors and not options.mounting_only else None
            mounting = own.result.calibrated
            pr.flight.write.write_strips(flight, mounting, draft, correct, steps.within)
    first = f"{options.out}: {calibration.NAME}, {pages.NAME}"
    _say(options)("\n".join([first, *flight.notes, own.summary()]))
    return 0


def _files(options: argparse.Namespace) -> dict[str, str]:
    """Names of what was given, for the report."""
    names = "trajectory", "accuracy", "mounting", "checkpoints", "control"
    given = {name.capitalize(): getattr(options, name) for name in names}
    strips = {"Strips": ", ".join(path.name for path in options.strips)}
    return strips | {what: path.name for what, path in given.items() if path}


def _apply_options(commands) -> None:
    command = _command(
        commands, _apply, "write strips anew (LAS, LAZ) under the result of a calibration",
        f"{_EXAMPLE} --calibration calibrated/calibration.json --out adjusted",
        ".flight.read .flight.write",
    )  # fmt: skip
    _strips(command)
    command.option("--calibration", "calibration.json", type=Path, required=True, metavar="FILE")


def _apply(options: argparse.Namespace) -> int:
    say = _say(options)
    with _steps(options) as steps:
        applied = pr.apply_calibration(
            options.strips, options.trajectory, options.mounting, options.calibration, options.out,
            crs=options.crs, ring_dimension=options.ring_dimension, columns=options.columns,
            scanner=options.scanner, mounting_only=options.mounting_only,
            checkpoints=options.checkpoints, progress=steps.within,
        )  # fmt: skip
    written = f"{options.out}: {len(applied.strips)} strips, {applied.points} points"
    say("\n".join([*(f"note: {note}" for note in applied.notes), written, *applied.heights]))
    return 0


def _sweep_options(commands) -> None:
    command = _command(
        commands, _sweep,
        "execute a notebook over a grid of parameters (needs a clone, or --notebook)",
        "--grid noise_scale=0,1,2 --seeds 20 --out sweeps/noise",
        ".study.workers .study.simulated .paper.reproduce .figures.study",
    )  # fmt: skip
    words = "values of a parameter, such as noise_scale=0,1,2; may be given for several"
    more = {"action": "append", "metavar": "NAME=VALUE,VALUE"}
    command.add_argument("--grid", default=[], help=words, **more)
    command.option("--seeds", "seeds 1 to so many; else 20", type=int)
    command.option("--out", "folder; started again, goes on", type=Path, required=True)
    command.option("--notebook", "what is executed; else one survey, measured", type=Path)
    _workers(command)


def _sweep(options: argparse.Namespace) -> int:
    say, notebook = _say(options), options.notebook
    if notebook is None:
        notebook = pr.paper.reproduce.NOTEBOOKS / "08_noise_sweep_run.ipynb"
        if not notebook.exists():
            raise BadInput("sweep: needs a clone of the repository, or --notebook; give one")
    finished = pr.run_sweep(
        notebook, options.grid, options.out, seeds=options.seeds, progress=say, **_work(options)
    )
    _print_failures(finished, f"see {options.out / 'failed.csv'}")
    say(
        f"{options.out / 'sweep.csv'}: {finished.done} of {len(finished.points)} runs, "
        f"{len(finished.rows)} rows"
    )
    if finished.done and not finished.stopped:
        _draw(finished.rows, options.out, say)
    return _stopped(finished) or int(finished.done < len(finished.points))


def _print_failures(finished, more: str) -> None:
    failed = finished.failed | finished.lost
    for point in list(failed)[:_LISTED]:
        print(f"failed: {point}: {failed[point]}", file=sys.stderr)
    if len(failed) > _LISTED:
        print(f"and {len(failed) - _LISTED} more, {more}", file=sys.stderr)


def _stopped(finished) -> int:
    """Exit code of a study or sweep that ended early, 0 of others."""
    if not finished.stopped:
        return 0
    words = f"stopped ({finished.stopped}); the same command goes on where it stopped"
    print(f"paperrepro: {words}", file=sys.stderr)
    return 130 if finished.stopped == "interrupted" else 1


def _draw(rows, folder: Path, say: Callable[[str], None]) -> None:
    pr.figures.use_style()
    for name, figure, data in pr.figures.study.pictures(rows):
        pr.figures.save(figure, folder, name, data)
        say(f"{folder / name}.png")


def _study_options(commands) -> None:
    command = _command(
        commands, _study, "measure many simulated surveys: what the ledger of claims reads",
        "--seeds 20 --noise-scale 0.5,1,2 --out study.csv", ".study.workers .study.simulated",
    )  # fmt: skip
    command.option("--seeds", "surveys a setting", 20)
    words = "surveys of the first preset of which boresight and sigma are measured; else --seeds"
    command.option("--coverage-seeds", words, 0, metavar="N")
    words = "factors on the GNSS/INS error"
    command.option("--noise-scale", words, (0.5, 1.0, 2.0), type=_numbers, metavar="0.5,1,2")
    command.option("--preset", "true boresights", PRESETS, type=_names, metavar="mount,table4")
    words = "kinds of errors, such as specified,smoother,clock"
    command.option("--errors", words, ("specified",), type=_names, metavar="specified,clock")
    command.option("--profile", "one pulse in 16, or all", "quick", choices=PROFILES)
    command.option("--out", "where the rows go", STUDY, type=Path)
    _workers(command)


def _study(options: argparse.Namespace) -> int:
    say, tidy = _say(options), pr.study.rows
    surveys = pr.study.simulated.planned(
        options.seeds, options.coverage_seeds, options.noise_scale, options.preset, options.profile,
        options.errors,
    )  # fmt: skip
    require_folder(options.out.parent)
    finished = pr.run_study(surveys, progress=say, **_work(options))
    _print_failures(finished, f"see the rows of metric {tidy.FAILED}")
    if finished.lost or finished.stopped:
        print(f"paperrepro: {options.out}: not written, surveys are missing", file=sys.stderr)
        return _stopped(finished) or 1
    rows = finished.rows
    tidy.write_csv(tidy.rounded(rows), options.out.parent, options.out.stem)
    failures = (rows.metric == tidy.FAILED).sum()
    say(f"{options.out}: {len(surveys)} surveys, {len(rows)} rows, {failures} failures")
    return 0


def _cache_options(commands) -> None:
    words = "how much is kept of surveys and roofs so as not to be computed again"
    command = _command(commands, _cache, words, "--clear", "")
    command.add_argument("--clear", action="store_true", help="remove it")


def _cache(options: argparse.Namespace) -> int:
    from paperrepro import _cache as kept

    entries = kept.clear() if options.clear else kept.entries()
    size = sum(entry.size for entry in entries) / 1e9
    what = "removed" if options.clear else f"of at most {kept.limit() / 1e9:g} GB ({kept.LIMIT})"
    _say(options)(f"{kept.cache_folder()}: {len(entries)} entries, {size:.2f} GB {what}")
    return 0


_COMMANDS = (
    _reproduce_options, _simulate_options, _calibrate_options, _apply_options, _sweep_options,
    _study_options, _cache_options,
)  # fmt: skip
