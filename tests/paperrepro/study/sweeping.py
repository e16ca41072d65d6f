"""A light notebook to sweep over, and what its rows have to be."""

import itertools

import nbformat
import pandas as pd
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

from paperrepro.study.rows import COLUMNS

PARAMETERS = """
preset: str = "mount"
profile: str = "quick"
seed: int = 1
noise_scale: float = 1.0
again: bool = False
lasts_s: float = 0.0  # how long a run takes
log: str = ""  # file that gets a line for each run that begins
figures_dir: str = ""  # empty: nothing is written
"""
#: A run without numpy and the like, so that it is over at once.
MEASURES = f"""
import os, threading, time
from pathlib import Path
if log:
    with open(log, "a") as file:
        print(noise_scale, seed, os.getpid(), flush=True, file=file)
leftover = "earlier" in globals()
earlier = True
time.sleep(lasts_s)
if noise_scale > 100:
    raise ValueError("noise so large\\nthat nothing matches")
if noise_scale == 99:
    os._exit(1)
lines = ["{",".join(COLUMNS)}"]
values = {{"one": seed + noise_scale / 7, "two": seed * noise_scale, "left": float(leftover),
           "threads": float(os.environ["NUMBA_NUM_THREADS"])}}
for metric, value in values.items():
    start = f"stand-in,SL,{{preset}},{{profile}},{{noise_scale}},specified,{{seed}}"
    lines.append(f"{{start}},{{metric}},1,{{value}},")
if figures_dir:
    (Path(figures_dir) / "rows").mkdir()
    (Path(figures_dir) / "rows" / "standin.csv").write_text("\\n".join(lines) + "\\n")
"""
METRICS = 4


def write_notebook(path, source=MEASURES, parameters=PARAMETERS, about="A stand-in"):
    first = new_code_cell(parameters.strip(), metadata={"tags": ["parameters"]})
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    cells = [new_markdown_cell(about), first, new_code_cell(source)]
    nbformat.write(new_notebook(cells=cells, metadata=kernel), path)
    return path


def arguments(notebook, out, *more, noise="0,1", seeds=2):
    """Of a sweep on the command line."""
    return ["sweep", "--notebook", str(notebook), "--out", str(out),
            "--grid", f"noise_scale={noise}", "--seeds", str(seeds), *more]  # fmt: skip


def begun(log):
    """Noise and seed of each run that began."""
    return [tuple(map(float, line.split()[:2])) for line in _lines(log)]


def kernels(log):
    """Process of the kernel of each run that began."""
    return [int(line.split()[2]) for line in _lines(log)]


def _lines(log):
    return log.read_text().splitlines() if log.exists() else []


def rows_of(out):
    return pd.read_csv(out / "sweep.csv")


def keys_of(rows):
    return sorted(zip(rows.noise_scale, rows.seed, rows.metric, strict=True))


def expected_keys(noises, seeds):
    metrics = ("one", "two", "left", "threads")
    return sorted(itertools.product(map(float, noises), range(1, seeds + 1), metrics))
