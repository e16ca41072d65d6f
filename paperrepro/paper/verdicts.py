"""From what single settings say to one finding with its verdict.

Written rules: a claim *holds* if it does in every setting that has enough surveys, *holds under
conditions* if it does in some, or in part, and *does not hold* if it does in none. Where rows or
surveys are missing, or do not decide, it is *not testable here*, and that is said.
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

#: Kinds of claims beside those of `published`: made in words; made by this project alone.
STATEMENT, OURS = "statement", "ours"

#: What one setting says of a claim.
YES, PARTLY, NO, OPEN = "yes", "in part", "no", "undecided"
_OPENINGS = {YES: "holds", PARTLY: "in part", NO: "not", OPEN: "undecided"}

#: Columns of the ledger.
COLUMNS = (
    "id", "claim", "place", "kind", "paper", "measured", "low", "high", "unit", "seeds",
    "verdict", "condition",
)  # fmt: skip


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


def in_settings(judge: Judge, preset: str | None = None) -> Rule:
    """``judge`` in every setting, or in those of one preset; the first gives the measured value."""

    def rule(evidence: Evidence) -> Finding:
        try:
            settings = evidence.settings(preset)
        except TooLittle as missing:
            return untested(str(missing))
        surveys = {str(s): evidence.surveys(s, len(settings)) for s in settings}
        return _judge_all(surveys, judge)

    return rule


def under_errors(kind: str) -> Callable[[Judge], Rule]:
    """`in_settings`, of the surveys with errors of another kind than specified."""
    return lambda judge: lambda evidence: in_settings(judge)(evidence.under(kind))


def over_noise(judge: Callable[[list[Surveys]], Judged]) -> Rule:
    """``judge`` for every preset and profile, given its surveys at all noise scales, ascending; of
    those scales at which enough surveys gave a result."""

    def rule(evidence: Evidence) -> Finding:
        groups: dict[str, list[Setting]] = {}
        try:
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


def printed(rule: Rule) -> Rule:
    """Of what the printed numbers decide, or nothing: the rule asks no survey."""
    return rule


def _judge_all(groups: dict, judge: Callable) -> Finding:
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


def fixed(measured: float, holds: bool, words: str) -> Finding:
    """Of a claim that follows from the printed numbers alone: no survey, no interval."""
    verdict = HOLDS if holds else FAILS
    return Finding(float(measured), np.nan, np.nan, "1", 0, verdict, words)


@dataclass(frozen=True)
class Claim:
    """``text`` in our words, ``place`` in the paper, ``of`` a kind or of a value that the paper
    prints; a ``judge`` of one setting, which ``over`` makes a rule over all."""

    id: str
    place: str
    of: str | Published
    judge: Callable
    text: str
    over: Callable[[Callable], Rule] = in_settings

    @property
    def rule(self) -> Rule:
        return self.over(self.judge)

    @property
    def paper(self) -> Published | None:
        return self.of if isinstance(self.of, Published) else None

    @property
    def kind(self) -> str:
        return self.of.kind if isinstance(self.of, Published) else self.of
