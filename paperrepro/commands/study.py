"""``paperrepro study``: many simulated surveys measured, the rows that the ledger reads."""

import argparse
from dataclasses import asdict, replace
from pathlib import Path

from paperrepro.errors import BadInput
from paperrepro.study.simulated import simulate_one

#: Factors by which scenario D is told a wrong specification of the GNSS/INS.
MISTAKEN = (0.5, 2.0)
#: Significant digits of a study's numbers.
DIGITS = 4


def add(commands) -> None:
    command = commands.add_parser(
        "study", help="measure many simulated surveys: the rows that the ledger of claims reads"
    )
    command.add_argument("--seeds", type=int, default=20, help="surveys a setting (default 20)")
    command.add_argument(
        "--coverage-seeds", type=int, default=0, metavar="N",
        help="surveys of the first preset of which boresight and sigma are measured: shares of "
        "intervals need many (default 0: no more than --seeds)",
    )  # fmt: skip
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
    from paperrepro._cache import code_version
    from paperrepro.study.montecarlo import run_seeds
    from paperrepro.study.rows import write_csv
    from paperrepro.study.simulated import FAILED

    runs = _runs(options)
    if not runs:
        raise BadInput(f"seeds: expected at least 1, got {options.seeds}; give a number of surveys")
    for run in runs:
        data_synth.make_config(**asdict(run))  # refuses, before anything runs
    version = code_version("data_synth.simulation") + code_version("data_synth.evaluation")
    rows = run_seeds(simulate_one, runs, options.workers, version)
    for column in ("value", "sigma"):  # a study is kept: what chance decides is not written
        rows[column] = [float(f"{number:.{DIGITS}g}") for number in rows[column]]
    write_csv(rows, options.out.parent, options.out.stem)
    failed = rows[rows.metric == FAILED]
    print(f"{options.out}: {len(runs)} surveys, {len(rows)} rows, {len(failed)} failures")
    return 0


def _runs(options: argparse.Namespace) -> dict:
    """Surveys and how deep each is measured: all of it for the first seeds; of the further ones,
    of the first preset alone, boresight and sigma. At the specified noise scenario D is also told
    a specification wrong by two."""
    from paperrepro.study.rows import SurveyKey
    from paperrepro.study.simulated import ANGLES_ONLY, Depth

    runs = {}
    for seed in range(1, max(options.seeds, options.coverage_seeds) + 1):
        for preset in options.preset:
            for noise_scale in options.noise_scale:
                first = preset == options.preset[0]
                depth = Depth() if seed <= options.seeds else ANGLES_ONLY
                if first and noise_scale == 1 and options.coverage_seeds:
                    depth = replace(depth, mistaken=MISTAKEN)
                if first or seed <= options.seeds:
                    runs[SurveyKey(preset, options.profile, noise_scale, seed)] = depth
    return runs
