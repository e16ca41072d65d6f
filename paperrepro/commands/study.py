"""``paperrepro study``: many simulated surveys measured, the rows that the ledger reads."""

import argparse
from dataclasses import asdict
from pathlib import Path

from paperrepro.errors import BadInput


def add(commands) -> None:
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
    command.set_defaults(run=run)


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(float(part) for part in text.split(","))


def _names(text: str) -> tuple[str, ...]:
    return tuple(text.split(","))


def run(options: argparse.Namespace) -> int:
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
