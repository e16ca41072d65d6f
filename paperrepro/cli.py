"""The command line. Exit codes: 0 done; 2 bad input, one line on stderr; 130 stopped; 1 others."""

import argparse
import sys
from collections.abc import Sequence

from paperrepro import __version__
from paperrepro.commands import apply, calibrate, reproduce, simulate, study, sweep
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
    except KeyboardInterrupt:
        print("paperrepro: stopped", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="paperrepro", description=__doc__.splitlines()[0])
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in (apply, calibrate, reproduce, simulate, study, sweep):
        command.add(commands)
    return parser
