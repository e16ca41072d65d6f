"""``paperrepro apply``: strips under a calibration; all but the coordinates stays as it is."""

import argparse
from pathlib import Path


def add(commands) -> None:
    command = commands.add_parser(
        "apply", help="write strips anew (LAS, LAZ) under the result of a calibration"
    )
    command.add_argument("strips", type=Path, nargs="+", metavar="STRIP", help="LAS or LAZ")
    command.add_argument(
        "--calibration", type=Path, required=True, metavar="FILE", help="calibration.json"
    )
    command.add_argument("--trajectory", type=Path, metavar="FILE", help="SBET")
    command.add_argument(
        "--mounting",
        type=Path,
        required=True,
        metavar="FILE",
        help="mounting.toml: the nominal one",
    )
    command.add_argument("--out", type=Path, required=True, help="folder to write into")
    command.add_argument(
        "--crs", help="of the strips, such as EPSG:32722 (default: their header's)"
    )
    command.add_argument(
        "--ring-dimension", default="user_data", metavar="NAME", help="default: user_data"
    )
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    from paperrepro.flight.write import apply_calibration

    written = apply_calibration(
        options.strips, options.trajectory, options.mounting, options.calibration, options.out,
        crs=options.crs, ring_dimension=options.ring_dimension,
    )  # fmt: skip
    for note in written.notes:
        print(f"note: {note}")
    print(f"{options.out}: {len(written.strips)} strips, {written.points} points")
    return 0
