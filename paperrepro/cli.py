"""The command line. Exit codes: 0 done; 2 bad input, one line on stderr; 1 anything else."""

import argparse
import sys
import time
from collections.abc import Sequence
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
    command.set_defaults(run=_reproduce)


def _reproduce(options: argparse.Namespace) -> int:
    from data_synth import make_config
    from paperrepro.reproduce import reproduce

    parameters = {
        "preset": options.preset, "profile": options.profile,
        "seed": options.seed, "noise_scale": options.noise_scale,
    }  # fmt: skip
    make_config(**parameters)  # refuses what cannot be simulated, before anything runs
    start = time.perf_counter()
    only = tuple(part for part in options.only.split(",") if part)
    seconds = reproduce(options.out, parameters, only)
    for name, spent in seconds.items():
        print(f"{name:32s} {spent:7.1f} s")
    print(f"{options.out}: done in {time.perf_counter() - start:.0f} s")
    return 0
