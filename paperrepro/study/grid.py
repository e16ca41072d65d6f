"""The points of a study or sweep, and the version of all that their rows depend on.

Rows of two versions never mix: a point's name is another one when a parameter, the notebook, the
code or a package is.
"""

import itertools
import math
import platform
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import joblib
import nbformat

from paperrepro._cache import code_version_of
from paperrepro.errors import BadInput
from paperrepro.study.environment import package_versions
from paperrepro.study.notebooks import OUTPUT, Parameter

SEED = "seed"
_TRUTH = {"true": True, "false": False}
_LONGEST_NAME = 80


@dataclass(frozen=True)
class Fingerprint:
    """Hashes of the sources that are executed and of our modules that these use; versions of Python
    and of the packages that the project asks for."""

    notebook: str
    code: str
    packages: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, *sources: str) -> "Fingerprint":
        """Of pieces of Python, where this process runs; what is on disk is read anew."""
        plain = re.sub(r"^\s*[%!].*$", "", "\n".join(sources), flags=re.MULTILINE)
        versions = {"Python": platform.python_version(), **package_versions()}
        return cls(joblib.hash(list(sources)), code_version_of(plain), tuple(versions.items()))

    @classmethod
    def of_notebook(cls, text: str) -> "Fingerprint":
        """Of the cells of code of a notebook."""
        cells = nbformat.reads(text, as_version=4).cells
        return cls.of(*(cell.source for cell in cells if cell.cell_type == "code"))

    def __str__(self) -> str:
        return joblib.hash((self.notebook, self.code, self.packages))

    def as_json(self) -> dict:
        """For the files that a sweep leaves."""
        return {"fingerprint": str(self), "packages": dict(self.packages)}

    def differs_in(self, other: "Fingerprint") -> str:
        """What is not the same, in words; empty if all is."""
        words = [
            part for part in ("notebook", "code") if getattr(self, part) != getattr(other, part)
        ]
        ours, theirs = dict(self.packages), dict(other.packages)
        words += [
            f"{name} {theirs.get(name, 'missing')} instead of {ours.get(name, 'none')}"
            for name in {**ours, **theirs}
            if ours.get(name) != theirs.get(name)
        ]
        return ", ".join(words)


@dataclass(frozen=True, eq=False)
class Point:
    """One run: all its ``parameters``, and the ``name`` of its files."""

    name: str
    parameters: Mapping[str, Any]

    @classmethod
    def of(
        cls, parameters: Mapping[str, Any], fingerprint: Fingerprint, shown: Sequence[str]
    ) -> "Point":
        """Its name begins with the parameters ``shown``, and ends with a hash of all there is."""
        words = "_".join(f"{name}-{parameters[name]}" for name in shown)
        readable = re.sub(r"[^\w.-]+", "-", words)[:_LONGEST_NAME]
        key = joblib.hash((str(fingerprint), sorted(parameters.items())))
        return cls(f"{readable}_{key[:12]}".lstrip("_"), parameters)

    def __str__(self) -> str:
        return " ".join(f"{name}={value}" for name, value in self.parameters.items())


def read_grid(
    texts: Sequence[str], known: Mapping[str, Parameter], seeds: int | None = None
) -> dict[str, list]:
    """Values by parameter from ``texts`` such as "noise_scale=0,0.5,1", and seeds 1 to ``seeds``.

    Raises `BadInput` for a name that is not ``known``, or a value of another type than its own.
    """
    grid: dict[str, list] = {}
    for text in texts:
        name, _, values = text.partition("=")
        if name in grid:
            raise BadInput(f"--grid: {name} is given twice; give all its values at once")
        if name not in known or name == OUTPUT:
            raise _refused(f"--grid {text}: there is no parameter {name!r} to vary", known)
        parts = [part.strip() for part in values.split(",")]
        grid[name] = list(dict.fromkeys(_value(text, part, name, known) for part in parts))
    return {**grid, **_seeds(seeds, grid, known)}


def _seeds(seeds: int | None, grid: Mapping, known: Mapping[str, Parameter]) -> dict[str, list]:
    if seeds is None:
        return {}
    if seeds < 1:
        raise BadInput(f"--seeds: expected at least 1, got {seeds}; give a number of runs")
    if SEED in grid:
        raise BadInput("--seeds and --grid seed=... say the same; give one of them")
    if SEED not in known or known[SEED].kind is not int:
        raise _refused("--seeds: the notebook has no whole number named seed", known)
    return {SEED: list(range(1, seeds + 1))}


def _value(text: str, part: str, name: str, known: Mapping[str, Parameter]) -> Any:
    kind = known[name].kind
    try:
        value = _TRUTH[part.lower()] if kind is bool else kind(part)
        if part == "" or (kind is float and not math.isfinite(value)):
            raise ValueError(part)
    except (ValueError, KeyError):
        raise _refused(f"--grid {text}: expected {kind.__name__}, got {part!r}", known) from None
    return value


def _refused(what: str, known: Mapping[str, Parameter]) -> BadInput:
    names = "; ".join(str(known[name]) for name in known if name != OUTPUT) or "no parameters"
    return BadInput(f"{what}; the notebook has {names}")


def points(
    grid: Mapping[str, Sequence], known: Mapping[str, Parameter], fingerprint: Fingerprint
) -> list[Point]:
    """Every run of ``grid``; the seed changes last, so a part of a sweep has all its settings."""
    defaults = {name: about.default for name, about in known.items() if name != OUTPUT}
    names = sorted(grid, key=lambda name: name != SEED)
    runs = []
    for values in itertools.product(*(grid[name] for name in names)):
        chosen = {**defaults, **dict(zip(names, values, strict=True))}
        shown = [name for name in chosen if chosen[name] != ""]
        runs.append(Point.of(chosen, fingerprint, shown))
    return runs
