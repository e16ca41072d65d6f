"""``python -m tests.benchmarks``: time every stage, print the table, write rows and picture.

--every 16 4 1   densities, one in so many pulses
--out figures    folder of benchmarks.csv, benchmarks_targets.csv, benchmarks.png and .svg
--no-whole       not the whole method in a process of its own, for memory, growth and compiling
--icp PYTHON     of an environment with simpleicp: strips beside a rigid ICP (`rigid_icp`)
--no-commands    no reproduction, no sweep by one worker and by two, no reading of files
"""

import argparse
import os
import platform
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd
import psutil

from paperrepro.figures import save, study, use_style
from tests.benchmarks import commands, flight_time, rigid_icp, stages, whole
from tests.benchmarks.clock import Row
from tests.benchmarks.inputs import EVERY, Inputs
from tests.benchmarks.targets import judged

COLUMNS = ("stage", "every", "points", "seconds", "first_seconds", "peer", "peer_seconds", "ratio",
           "measure", "agreement", "memory_gib")  # fmt: skip


def rows_of(every: int, sparsest: bool) -> Iterator[Row]:
    """All stages at one density; SciPy and longer flights at the sparsest alone."""
    yield stages.simulation(every)
    inputs = Inputs.of(every)
    yield from stages.georeferencing(inputs)
    yield stages.outlier_removal(inputs)
    yield stages.ground_filter(inputs)
    yield stages.plane_growing(inputs)
    yield from stages.roofs(inputs)
    yield from stages.adjustments(inputs, with_peers=sparsest)
    if sparsest:
        yield from stages.longer_flights(inputs)


def rows_of_whole(every: int, sparsest: bool) -> Iterator[dict]:
    """The whole method, by parts; at the sparsest once more with nothing compiled."""
    warm = whole.in_a_process(every)
    first = whole.in_a_process(every, compiled=False)["seconds"] if sparsest else {}
    told = {"every": every, "points": warm["points"]}
    for part, seconds in warm["seconds"].items():
        yield {"stage": f"all of {part}", "seconds": seconds, "first_seconds": first.get(part),
               **told}  # fmt: skip
    total, memory = sum(warm["seconds"].values()), warm["memory"] / 2**30
    yield {"stage": "whole method", "seconds": total, "memory_gib": memory, **told}
    if sparsest:
        yield {"stage": "compiling", "seconds": sum(first.values()) - total, **told}


def rows_of_villages() -> Iterator[dict]:
    """Scenario D on villages of more and more roofs, flown for as much longer."""
    for size in flight_time.VILLAGES:
        found = flight_time.in_a_process(*size)
        yield {"stage": f"village, {found['roofs']} roofs", "points": found["points"],
               "seconds": found["seconds"], "memory_gib": found["memory"] / 2**30}  # fmt: skip


def measure(
    densities: list[int], with_whole: bool, with_commands: bool, icp: Path | None = None
) -> pd.DataFrame:
    """A row for each stage, density and peer."""
    rows: list[dict] = []

    def add(found: dict) -> None:
        rows.append(found)
        of = f"1/{found['every']}" if "every" in found else ""
        print(f"{found['stage']:20s} {of:5s} {found['seconds']:8.3f} s  "
              f"{found.get('peer') or '':12s} {found.get('peer_seconds', np.nan):8.3f}",
              flush=True)  # fmt: skip

    for every in densities:
        sparsest = every == max(densities)
        for row in rows_of(every, sparsest):
            add(row.as_dict())
        if with_whole:
            for row in rows_of_whole(every, sparsest):
                add(row)
    if with_whole:
        for row in rows_of_villages():
            add(row)
    if icp is not None:
        for row in rigid_icp.strips_together(Inputs.of(16).survey, 16, icp):
            add(row.as_dict())
    if with_commands:
        for found in commands.first_words():
            add(found)
        add(commands.reading())
        add(commands.reproduction("quick", 16))
        add(commands.reproduction("paper", 1))
        add(commands.sweep())
    return pd.DataFrame(rows)


def machine() -> str:
    """What all this was measured on."""
    memory = psutil.virtual_memory().total / 2**30
    return f"{os.cpu_count()} cores of {_processor()}, {memory:.0f} GiB"


def _processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":")[1].strip()
    return platform.machine()


def main() -> None:
    parser = argparse.ArgumentParser(prog="tests.benchmarks", description=__doc__)
    parser.add_argument("--every", type=int, nargs="+", default=list(EVERY))
    parser.add_argument("--out", type=Path, default=None)
    parser.add_argument("--whole", action=argparse.BooleanOptionalAction, default=True)
    parser.add_argument("--commands", action=argparse.BooleanOptionalAction, default=True)
    parser.add_argument("--icp", type=Path, default=None)
    chosen = parser.parse_args()
    rows = measure(chosen.every, chosen.whole, chosen.commands, chosen.icp).reindex(columns=COLUMNS)
    rows["peer"], rows["machine"] = rows.peer.fillna(""), machine()
    verdicts = judged(rows)
    print(rows.to_string(index=False, float_format=lambda v: f"{v:.4g}"))
    print(verdicts.to_string(index=False, float_format=lambda v: f"{v:.4g}"))
    if chosen.out is not None:
        use_style()
        save(study.time_against_points(rows), chosen.out, "benchmarks", rows)
        verdicts.to_csv(chosen.out / "benchmarks_targets.csv", index=False, float_format="%.6g")


if __name__ == "__main__":
    main()
