"""From what single settings say to one finding with its verdict.

Written rules: a claim *holds* if it does in every setting that has enough surveys, *holds under
conditions* if it does in some, or in part, and *does not hold* if it does in none. Where rows or
surveys are missing, or do not decide, it is *not testable here*, and that is said.

A claim of the paper, or of ours, with the rule that judges it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from paperrepro.paper.published import Published
from paperrepro.study.statistics import LEAST_SEEDS, Evidence, Interval, Setting, Surveys, TooLittle

HOLDS = "holds"
CONDITIONS = "holds under conditions"
FAILS = "does not hold"
UNTESTED = "not testable here"
VERDICTS = (HOLDS, CONDITIONS, FAILS, UNTESTED)

YES, PARTLY, NO, OPEN = "yes", "in part", "no", "undecided"
_OPENINGS = {YES: "holds", PARTLY: "in part", NO: "not", OPEN: "undecided"}


@dataclass(frozen=True)
class Finding:
    """What became of a claim; ``condition`` says when it holds, or why it does not."""

    measured: float
    low: float
    high: float
    unit: str
    seeds: int
    verdict: str
    condition: str


@dataclass(frozen=True)
class Judged:
    """What one setting says: ``state`` is one of the four above, ``words`` the numbers
    behind it."""

    measured: Interval
    unit: str
    seeds: int
    state: str
    words: str


Rule = Callable[[Evidence], Finding]
Judge = Callable[[Surveys], Judged]


def over_settings(judge: Judge, preset: str | None = None) -> Rule:
    """``judge`` in every setting, or in those of one preset; the first gives the measured value."""

    def rule(evidence: Evidence) -> Finding:
        try:
            settings = evidence.settings(preset)
        except TooLittle as missing:
            return untested(str(missing))
        groups = {str(s): [evidence.surveys(s, len(settings))] for s in settings}
        return _judge_all(groups, lambda group: judge(group[0]))

    return rule


def over_noise(judge: Callable[[list[Surveys]], Judged]) -> Rule:
    """``judge`` for every preset and profile, given its surveys at all noise scales, ascending; of
    those scales at which enough surveys gave a result."""

    def rule(evidence: Evidence) -> Finding:
        try:
            groups: dict[str, list[Setting]] = {}
            for setting in sorted(evidence.settings()):
                if (~evidence.surveys(setting).failed("all")).sum() >= LEAST_SEEDS:
                    groups.setdefault(setting.name, []).append(setting)
        except TooLittle as missing:
            return untested(str(missing))
        if not groups:
            return untested(f"at no noise scale {LEAST_SEEDS} surveys gave a result")
        surveys = {
            name: [evidence.surveys(setting, len(groups)) for setting in settings]
            for name, settings in groups.items()
        }
        return _judge_all(surveys, judge)

    return rule


def _judge_all(groups: dict[str, list[Surveys]], judge: Callable) -> Finding:
    judged, missing = {}, []
    for name, surveys in groups.items():
        try:
            judged[name] = judge(surveys)
        except TooLittle as error:
            missing.append(str(error))
    return combine(judged) if judged else untested(missing[0])


def combine(judged: dict[str, Judged]) -> Finding:
    """One finding of what settings, by name, say."""
    states = {each.state for each in judged.values()}
    verdict = CONDITIONS if states & {YES, PARTLY} else FAILS if NO in states else UNTESTED
    verdict = HOLDS if states == {YES} else verdict
    parts = []
    for state, opening in _OPENINGS.items():
        names = [name for name, each in judged.items() if each.state == state]
        if names:
            where = f"{opening} at {names[0]}: " if len(judged) > 1 else ""
            where = where or ("undecided: " if state == OPEN else "")
            alike = f"; likewise at {', '.join(names[1:])}" if len(names) > 1 else ""
            parts.append(f"{where}{judged[names[0]].words}{alike}")
    first = next(iter(judged.values()))
    return Finding(
        first.measured.value, first.measured.low, first.measured.high,
        first.unit, first.seeds, verdict, "; ".join(parts),
    )  # fmt: skip


def untested(reason: str) -> Finding:
    """Of a claim that these rows, or this simulation, cannot test."""
    return Finding(np.nan, np.nan, np.nan, "", 0, UNTESTED, reason)


def never(reason: str) -> Rule:
    """A claim outside of what is simulated."""
    return lambda evidence: untested(reason)


def fixed(measured: float, unit: str, holds: bool, words: str) -> Finding:
    """Of a claim that follows from the printed numbers alone: no survey, no interval."""
    verdict = HOLDS if holds else FAILS
    return Finding(float(measured), np.nan, np.nan, unit, 0, verdict, words)


def shown(value: float, unit: str, signed: bool = False) -> str:
    """A number in words: metres as centimetres, "share" as percent, others to three digits."""
    factor, digits, ending = {
        "m": (100, 2 if signed else 1, " cm"), "deg": (1, 3, "°"), "share": (100, 0, " %"),
        "1/m2": (1, 0, " /m²"), "s": (1, 2, " s"),
    }.get(unit, (1, _three_digits(value), ""))  # fmt: skip
    text = f"{factor * value:{'+' if signed else ''}.{digits}f}"
    if not text.strip("+-0."):
        text = text.lstrip("+-")  # what rounds to nothing has no sign
    return f"{text}{ending}".replace("-", "−")


def _three_digits(value: float) -> int:
    size = np.floor(np.log10(abs(value))) if value and np.isfinite(value) else 0
    return int(np.clip(2 - size, 0, 3))


def span(interval: Interval, unit: str, signed: bool = False) -> str:
    """A value with its interval in words."""
    value, low, high = (
        shown(v, unit, signed) for v in (interval.value, interval.low, interval.high)
    )
    return f"{value} ({low} to {high})"


#: A claim made in words, without a value; a claim that only this project makes.
STATEMENT, OURS = "statement", "ours"


@dataclass(frozen=True)
class Claim:
    """``text`` in our words, ``place`` in the paper; ``paper`` its value where one is printed.

    ``kind`` as in `published`, or `STATEMENT` or `OURS`. A ``headline`` is in the short table.
    """

    id: str
    text: str
    place: str
    rule: Rule
    paper: Published | None = None
    kind: str = STATEMENT
    headline: bool = False


def valued(
    id: str, text: str, paper: Published, rule: Rule, place: str = "", headline: bool = False
) -> Claim:
    """A claim with a printed value, at its place and of its kind unless another is given."""
    return Claim(id, text, place or paper.place, rule, paper, paper.kind, headline)


def ours(id: str, text: str, place: str, rule: Rule, headline: bool = False) -> Claim:
    return Claim(id, text, place, rule, None, OURS, headline)


def called(scenario: str) -> str:
    """How the paper calls a scenario."""
    return "[11]" if scenario == "SL" else scenario
