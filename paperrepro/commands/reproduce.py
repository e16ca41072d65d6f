"""``paperrepro reproduce``: every notebook executed; tables, figures and the report written."""

import argparse
import time
from pathlib import Path


def add(commands) -> None:
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
    command.add_argument("--jobs", type=int, default=2, help="notebooks at a time (default 2)")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    from data_synth import make_config
    from paperrepro.figures import pages
    from paperrepro.paper.reproduce import reproduce
    from paperrepro.study.rows import SurveyKey

    parameters = {
        "preset": options.preset, "profile": options.profile,
        "seed": options.seed, "noise_scale": options.noise_scale,
    }  # fmt: skip
    make_config(**parameters)  # refuses what cannot be simulated, before anything runs
    start = time.perf_counter()
    only = tuple(part for part in options.only.split(",") if part)
    seconds = reproduce(options.out, parameters, only, options.jobs)
    for name, spent in seconds.items():
        print(f"{name:32s} {spent:7.1f} s")
    pages.write(options.out, SurveyKey(**parameters))
    print(f"{options.out}: done in {time.perf_counter() - start:.0f} s")
    return 0
