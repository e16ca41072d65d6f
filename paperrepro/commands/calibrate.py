"""``paperrepro calibrate``: an operator's own flight."""

import argparse
from pathlib import Path

from paperrepro.errors import BadInput


def add(commands) -> None:
    command = commands.add_parser(
        "calibrate", help="calibrate your own flight: calibration.json, report.html, adjusted LAZ"
    )
    command.add_argument("strips", nargs="+", type=Path, metavar="STRIP", help="LAS or LAZ files")
    command.add_argument(
        "--trajectory", type=Path, metavar="FILE",
        help="SBET; not needed where the strips hold a pose for each point",
    )  # fmt: skip
    command.add_argument("--mounting", type=Path, required=True, metavar="FILE",
                         help="mounting.toml")  # fmt: skip
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="written whole")
    command.add_argument(
        "--scenario", default="D", help="SL, A, B, C of the paper, or D (default), ours"
    )
    command.add_argument(
        "--planes", default="auto", choices=("auto", "gables", "any"),
        help="gable roofs, patches of any kind, or (default) gables where there are enough",
    )  # fmt: skip
    command.add_argument(
        "--write-strips", action="store_true", help="write the strips under the new mounting, too"
    )
    command.add_argument("--accuracy", type=Path, metavar="FILE", help="SMRMSG of the trajectory")
    command.add_argument("--crs", help="of the strips, as EPSG:31982 (default: from the header)")
    command.add_argument(
        "--ring-dimension", default="user_data", metavar="NAME",
        help="where a point's ring stands (default user_data)",
    )  # fmt: skip
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    from paperrepro._files import written_whole
    from paperrepro.figures import pages
    from paperrepro.flight import calibration_file
    from paperrepro.flight.calibrate import calibrate_flight
    from paperrepro.flight.write import require_writable, write_strips

    _refuse_early(options)
    with written_whole(options.out) as draft, _Steps(len(options.strips)) as steps:
        flight = _read(options, steps)
        if options.write_strips:
            require_writable(flight, options.out)
        own = calibrate_flight(flight, options.scenario, options.planes, steps)
        steps("report")
        calibration_file.write(own, draft / calibration_file.NAME, notes=list(flight.notes))
        text = pages.calibration_page(own, _pictures(own), _files(options), flight.notes)
        (draft / pages.NAME).write_text(text, encoding="utf-8", newline="\n")
        if options.write_strips:
            steps("adjusted strips")
            write_strips(flight, own.result.calibrated, draft)
    print(f"{options.out}: {calibration_file.NAME}, {pages.NAME}")
    print("\n".join([*flight.notes, own.summary()]))
    return 0


def _refuse_early(options: argparse.Namespace) -> None:
    """Before hours of work: words that are unknown, files that are not there or would be lost."""
    from paperrepro.method.adjustment.calibrate import SCENARIO_NAMES

    if options.scenario not in SCENARIO_NAMES:
        raise BadInput(
            f"--scenario {options.scenario}: expected one of {', '.join(SCENARIO_NAMES)}; "
            "name one of them"
        )
    names = [path.name for path in options.strips]
    for path in options.strips:
        if names.count(path.name) > 1:
            raise BadInput(f"{path}: given twice, or two files have this name; rename one of them")
        target = options.out / path.name
        if options.write_strips and target.exists() and target.samefile(path):
            raise BadInput(
                f"{path}: --write-strips would overwrite it; choose another folder than "
                f"{options.out}"
            )


def _read(options: argparse.Namespace, steps):
    from paperrepro.flight.read import read_flight

    steps("reading")
    return read_flight(
        options.strips, options.trajectory, options.mounting, accuracy=options.accuracy,
        crs=options.crs, ring_dimension=options.ring_dimension,
    )  # fmt: skip


def _files(options: argparse.Namespace) -> dict[str, str]:
    given = {
        "Strips": ", ".join(path.name for path in options.strips),
        "Trajectory": options.trajectory and options.trajectory.name,
        "Accuracy": options.accuracy and options.accuracy.name,
        "Mounting": options.mounting.name,
    }
    return {what: name for what, name in given.items() if name}


def _pictures(own):
    from paperrepro.figures.flight import pictures

    return pictures(own)


class _Steps:
    """A progress bar, on a terminal alone. It grows with the work: how long it is going to be is
    known in part only."""

    #: Reading, three passes, the adjustment, distances, the report.
    USUAL = 7

    def __init__(self, n_strips: int):
        from tqdm import tqdm

        self.bar = tqdm(
            total=n_strips + self.USUAL, disable=None, leave=False,
            bar_format="{percentage:3.0f} %|{bar:30}| {elapsed} {desc}",
        )  # fmt: skip

    def __call__(self, words: str) -> None:
        if self.bar.disable:
            return
        self.bar.set_description_str(words, refresh=False)
        self.bar.total = max(self.bar.total, self.bar.n + 2)
        self.bar.update(1)

    def __enter__(self) -> "_Steps":
        return self

    def __exit__(self, kind, error, trace) -> None:
        self.bar.close()
