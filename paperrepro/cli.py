"""The command line. Exit codes: 0 done; 2 bad input, one line on stderr; 1 anything else."""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from paperrepro import __version__
from paperrepro.errors import BadInput, PaperReproError


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``paperrepro`` and ``python -m paperrepro``."""
    options = _parser().parse_args(arguments)
    try:
        return options.run(options)
    except BadInput as error:
        print(f"paperrepro: {error}", file=sys.stderr)
        return 2
    except PaperReproError as error:
        print(f"paperrepro: {error}", file=sys.stderr)
        return 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="paperrepro", description=__doc__.splitlines()[0])
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_reproduce(commands)
    _add_study(commands)
    return parser


def _add_reproduce(commands) -> None:
    command = commands.add_parser(
        "reproduce", help="execute every notebook and write tables and figures"
    )
    command.add_argument(
        "--profile", default="quick", help="quick (default) or paper: full density"
    )
    command.add_argument(
        "--preset", default="mount", help="true boresight: mount (default) or table4"
    )
    command.add_argument("--seed", type=int, default=1, help="of the simulated survey (default 1)")
    command.add_argument(
        "--noise-scale", type=float, default=1.0, help="multiplies the GNSS/INS error (default 1)"
    )
    command.add_argument("--out", type=Path, default=Path("figures"), help="default: figures")
    command.add_argument(
        "--only", default="", metavar="05,07", help="notebooks by the start of their names"
    )
    command.add_argument(
        "--jobs", type=int, help="notebooks at a time (default 2 for quick, 1 for paper: memory)"
    )
    command.set_defaults(run=_reproduce)


def _reproduce(options: argparse.Namespace) -> int:
    from data_synth import make_config
    from paperrepro import report
    from paperrepro.reproduce import reproduce
    from paperrepro.tables import Run

    parameters = {
        "preset": options.preset, "profile": options.profile,
        "seed": options.seed, "noise_scale": options.noise_scale,
    }  # fmt: skip
    make_config(**parameters)  # refuses what cannot be simulated, before anything runs
    start = time.perf_counter()
    only = tuple(part for part in options.only.split(",") if part)
    jobs = options.jobs or (2 if options.profile == "quick" else 1)
    seconds = reproduce(options.out, parameters, only, jobs)
    for name, spent in seconds.items():
        print(f"{name:32s} {spent:7.1f} s")
    report.write(options.out, Run(**parameters))
    print(f"{options.out}: done in {time.perf_counter() - start:.0f} s")
    return 0


def _add_study(commands) -> None:
    command = commands.add_parser(
        "study", help="measure many simulated surveys: the rows that the ledger of claims reads"
    )
    command.add_argument("--seeds", type=int, default=20, help="surveys a setting (default 20)")
    command.add_argument(
        "--noise-scale", type=_numbers, default=(0.5, 1.0, 2.0), metavar="0.5,1,2",
        help="factors on the GNSS/INS error (default 0.5,1,2)",
    )  # fmt: skip
    command.add_argument(
        "--preset", type=_names, default=("mount", "table4"), metavar="mount,table4",
        help="true boresights (default mount,table4)",
    )  # fmt: skip
    command.add_argument("--profile", default="quick", help="quick (default) or paper")
    command.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    command.add_argument(
        "--out", type=Path, default=Path("figures/study.csv"), help="default: figures/study.csv"
    )
    command.set_defaults(run=_study)


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(float(part) for part in text.split(","))


def _names(text: str) -> tuple[str, ...]:
    return tuple(text.split(","))


def _study(options: argparse.Namespace) -> int:
    import data_synth.evaluation
    from paperrepro.cache import code_version
    from paperrepro.montecarlo import run_seeds
    from paperrepro.study import FAILED
    from paperrepro.tables import Run, write_csv

    runs = [
        Run(preset, options.profile, noise_scale, seed)
        for seed in range(1, options.seeds + 1)
        for preset in options.preset
        for noise_scale in options.noise_scale
    ]
    if not runs:
        raise BadInput(f"seeds: expected at least 1, got {options.seeds}; give a number of surveys")
    for run in runs:
        data_synth.make_config(**asdict(run))  # refuses, before anything runs
    version = code_version("data_synth.simulation") + code_version("data_synth.evaluation")
    rows = run_seeds(simulate_one, runs, options.workers, version)
    write_csv(rows, options.out.parent, options.out.stem)
    failed = rows[rows.metric == FAILED]
    print(f"{options.out}: {len(runs)} surveys, {len(rows)} rows, {len(failed)} failures")
    return 0


def simulate_one(run):
    """A survey of the simulated farm, and what its truth tells a measurement."""
    from data_synth import make_config, simulate
    from data_synth.evaluation import judge_views, true_planes
    from paperrepro.study import Known

    config = make_config(**asdict(run))
    survey, truth = simulate(config)

    def judge(views):
        label = judge_views(survey, truth, views).label
        return label, true_planes(truth, label)

    return survey, Known(truth.mounting, judge, config.thinning)
