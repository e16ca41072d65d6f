"""``python -m tests.benchmarks``: time every stage, print the table, write rows and picture.

--every 16 4 1   densities, one in so many pulses
--out figures    folder of benchmarks.csv, benchmarks_targets.csv, benchmarks.png and .svg
--whole          the whole method in a process of its own, for memory, growth and compiling
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import pandas as pd

from paperrepro.figures import benchmarks, save, use_style
from tests.benchmarks import stages, whole
from tests.benchmarks.clock import Row
from tests.benchmarks.inputs import EVERY, Inputs
from tests.benchmarks.targets import judged


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
    """The whole method; at the sparsest once more with nothing compiled."""
    warm = whole.in_a_process(every)
    total = sum(warm["seconds"].values())
    told = {"every": every, "points": warm["points"], "memory_gib": warm["memory"] / 2**30}
    yield {"stage": "whole method", "seconds": total, "first_seconds": total, **told}
    if sparsest:
        first = sum(whole.in_a_process(every, compiled=False)["seconds"].values())
        yield {"stage": "compiling", "seconds": total, "first_seconds": first - total, **told}


def measure(densities: list[int], with_whole: bool) -> pd.DataFrame:
    """A row for each stage, density and peer."""
    rows: list[dict] = []
    for every in densities:
        sparsest = every == max(densities)
        for found in rows_of(every, sparsest):
            rows.append(found.as_dict())
            print(f"{found.stage:20s} 1/{every:<3d} {found.points:9d} points "
                  f"{found.seconds:8.3f} s  {found.peer:12s} {found.peer_seconds:8.3f}",
                  flush=True)  # fmt: skip
        if with_whole:
            rows += rows_of_whole(every, sparsest)
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(prog="tests.benchmarks", description=__doc__)
    parser.add_argument("--every", type=int, nargs="+", default=list(EVERY))
    parser.add_argument("--out", type=Path, default=None)
    parser.add_argument("--whole", action=argparse.BooleanOptionalAction, default=True)
    chosen = parser.parse_args()
    rows = measure(chosen.every, chosen.whole)
    rows["peer"] = rows.peer.fillna("")
    verdicts = judged(rows.assign(memory_gib=rows.get("memory_gib", float("nan"))))
    print(rows.to_string(index=False, float_format=lambda v: f"{v:.4g}"))
    print(verdicts.to_string(index=False, float_format=lambda v: f"{v:.4g}"))
    if chosen.out is not None:
        use_style()
        save(benchmarks.time_against_points(rows), chosen.out, "benchmarks", rows)
        verdicts.to_csv(chosen.out / "benchmarks_targets.csv", index=False, float_format="%.6g")


if __name__ == "__main__":
    main()
