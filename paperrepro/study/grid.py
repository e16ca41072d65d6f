"""Which runs a sweep has: a grid over parameters that the notebook declares.

What the rows of a run depend on beside its parameters: rows of two versions never mix.
"""

import itertools
import math
import platform
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import joblib
import nbformat

from paperrepro._cache import code_version_of
from paperrepro.errors import BadInput
from paperrepro.study.environment import package_versions
from paperrepro.study.notebooks import OUTPUT, Parameter


@dataclass(frozen=True)
class Fingerprint:
    """Hashes of the notebook's code and of our modules that it uses; versions of Python and of the
    packages that the project asks for."""

    notebook: str
    code: str
    packages: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, notebook: str) -> "Fingerprint":
        """Of the text of a notebook, where this process runs; what is on disk is read anew."""
        cells = nbformat.reads(notebook, as_version=4).cells
        sources = [cell.source for cell in cells if cell.cell_type == "code"]
        plain = re.sub(r"^\s*[%!].*$", "", "\n".join(sources), flags=re.MULTILINE)
        versions = {"Python": platform.python_version(), **package_versions()}
        return cls(joblib.hash(sources), code_version_of(plain), tuple(versions.items()))

    def __str__(self) -> str:
        return joblib.hash((self.notebook, self.code, self.packages))

    def told(self) -> dict:
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


SEED = "seed"
_TRUTH = {"true": True, "false": False}
_LONGEST_NAME = 80


@dataclass(frozen=True, eq=False)
class Point:
    """One run: all ``parameters`` of the notebook, and the ``name`` of its files, which is another
    one when a parameter, the notebook or the code is."""

    name: str
    parameters: Mapping[str, Any]


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
        kind = known[name].kind
        grid[name] = list(dict.fromkeys(_value(text, part, kind, known) for part in _split(values)))
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


def _split(values: str) -> list[str]:
    return [part.strip() for part in values.split(",")]


def _value(text: str, part: str, kind: type, known: Mapping[str, Parameter]) -> Any:
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
    return [_point({**defaults, **chosen}, known, fingerprint) for chosen in _combined(grid)]


def _combined(grid: Mapping[str, Sequence]) -> Iterator[dict]:
    names = sorted(grid, key=lambda name: name != SEED)
    for values in itertools.product(*(grid[name] for name in names)):
        yield dict(zip(names, values, strict=True))


def _point(parameters: dict, known: Mapping[str, Parameter], fingerprint: Fingerprint) -> Point:
    told = "_".join(
        f"{name}-{value}"
        for name, value in parameters.items()
        if name == SEED or value != known[name].default
    )
    readable = re.sub(r"[^\w.-]+", "-", told)[:_LONGEST_NAME]
    key = joblib.hash((str(fingerprint), sorted(parameters.items())))
    return Point(f"{readable}_{key[:12]}".lstrip("_"), parameters)
