"""From what single settings say to one finding with its verdict.

Written rules. In a setting (preset, density and noise) a claim is shown beyond chance, or its
opposite is, or equality within a stated margin; an interval that allows both leaves it undecided. A
claim *holds* if it does in every setting that has enough surveys, *holds under conditions* if it
does in some, *does not hold* if in none and is contradicted in one, and is *undecided* if no
setting decides. Where rows are missing, or no simulation could tell, it is *not testable here*. No
trajectory error at all is a limit, not a setting: it is said beside, and earns no verdict. Where a
claim is about several estimators, each in each setting counts like a setting.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np

from paperrepro.paper.numbers import shown, span
from paperrepro.paper.published import Published
from paperrepro.study.rows import FEW, MANY, SPECIFIED
from paperrepro.study.statistics import LEAST_SEEDS, Evidence, Interval, Setting, Surveys, TooLittle

HOLDS = "holds"
CONDITIONS = "holds under conditions"
FAILS = "does not hold"
UNDECIDED = "undecided"
UNTESTED = "not testable here"
VERDICTS = (HOLDS, CONDITIONS, FAILS, UNDECIDED, UNTESTED)

#: Whose a claim is: a sentence of the paper, what we deduce from its numbers, or this project's.
SAYS, FOLLOWS, OURS = "the paper says", "follows from what it prints", "ours"
KINDS = (SAYS, FOLLOWS, OURS)

#: What one setting says of a claim.
YES, NO, OPEN = "yes", "no", "undecided"
_OPENINGS = {YES: "holds", NO: "not", OPEN: "undecided"}

#: Columns of the ledger.
COLUMNS = (
    "id", "claim", "place", "kind", "paper", "measured", "low", "high", "unit", "values", "seeds",
    "verdict", "condition",
)  # fmt: skip


@dataclass(frozen=True)
class Finding:
    """What became of a claim; ``values`` in the first setting, of every estimator that it is about,
    the first of them also as a number; ``condition`` says when it holds, or why it does not."""

    measured: float
    low: float
    high: float
    unit: str
    values: str
    seeds: int
    verdict: str
    condition: str


@dataclass(frozen=True)
class Judged:
    """What one setting says: ``state`` is one of the three above, ``words`` the numbers behind it;
    ``signed`` where the measured value is a difference."""

    measured: Interval
    unit: str
    seeds: int
    state: str
    words: str
    signed: bool = False


#: How the paper calls what has another name here.
CALLED = {"SL": "[11]"}
#: Names of the rows by how the paper calls an estimator: few points a face, or all.
Reading = Mapping[str, str]
Rule = Callable[[Evidence, Reading], Finding]
Judge = Callable[[Surveys], Judged]
#: Judges by whom they judge; "" where there is one.
Judges = Callable[[Reading], Mapping[str, Judge]]


def each(names: Iterable[str], judge: Callable[[Reading, str], Judge]) -> Judges:
    """A judge of each estimator ``names``, by what the paper calls it."""
    return lambda reading: {CALLED.get(x, x): judge(reading, x) for x in names}


def one(judge: Callable[[Reading], Judge]) -> Judges:
    """A single judge."""
    return lambda reading: {"": judge(reading)}


def in_settings(
    judges: Judges, preset: str | None = None, errors: str = SPECIFIED, noise: float = 0.0
) -> Rule:
    """Every judge in every setting, or in those of one preset; of surveys with ``errors`` of one
    kind, and with ``noise`` at least."""

    def rule(evidence: Evidence, reading: Reading) -> Finding:
        try:
            settings = evidence.under(errors).settings(preset)
        except TooLittle as missing:
            return untested(str(missing))
        asked = [s for s in settings if s.noise_scale > 0 and s.noise_scale >= noise]
        if not asked:
            return untested(f"no setting with so much noise has {LEAST_SEEDS} surveys")
        limits = [s for s in settings if s.noise_scale == 0 and not noise]
        return _judge_all(evidence.under(errors), asked, judges(reading), limits)

    return rule


def under_kinds(judge: Judge, kinds: tuple[str, ...]) -> Rule:
    """``judge`` of the surveys with errors of each of ``kinds``."""

    def rule(evidence: Evidence, reading: Reading) -> Finding:
        judged, missing = {}, []
        for kind in kinds:
            try:
                settings = evidence.under(kind).settings()
                surveys = evidence.under(kind).surveys(settings[0], len(kinds))
                judged[kind, str(settings[0])] = _with_failures(judge(surveys), surveys)
            except TooLittle as error:
                missing.append(f"{kind}: {error}")
        return combine(judged, missing)

    return rule


def over_noise(judges: Callable[[Reading], Mapping[str, Callable]]) -> Rule:
    """Every judge for every preset and density, given its surveys at all noise scales, ascending;
    of those scales at which enough surveys gave a result."""

    def rule(evidence: Evidence, reading: Reading) -> Finding:
        groups: dict[str, list[Setting]] = {}
        try:
            for setting in sorted(evidence.settings()):
                if (~evidence.surveys(setting).failed("all")).sum() >= LEAST_SEEDS:
                    groups.setdefault(setting.name, []).append(setting)
        except TooLittle as missing:
            return untested(str(missing))
        judged, missing = {}, []
        named = judges(reading)
        lines = {name: settings for name, settings in groups.items() if len(settings) > 1}
        for name, settings in (lines or groups).items():
            together = len(lines or groups) * len(named)
            surveys = [evidence.surveys(setting, together) for setting in settings]
            for who, judge in named.items():
                try:
                    judged[who, name] = judge(surveys)
                except TooLittle as error:
                    missing.append(str(error))
        if not groups:
            return untested(f"at no noise scale {LEAST_SEEDS} surveys gave a result")
        return combine(judged, missing)

    return rule


def printed(finding: Callable[[], Finding]) -> Rule:
    """Of what the printed numbers decide: no survey is asked."""
    return lambda evidence, reading: finding()


def reasoned(reason: str) -> Rule:
    """Of a sentence that no survey of this simulation can test."""
    return lambda evidence, reading: untested(reason)


def _judge_all(evidence: Evidence, asked: list[Setting], named: Mapping, limits: list) -> Finding:
    judged, missing, beside = {}, [], []
    for setting in asked:
        surveys = evidence.surveys(setting, len(asked) * len(named))
        for who, judge in named.items():
            try:
                judged[who, str(setting)] = _with_failures(judge(surveys), surveys)
            except TooLittle as error:
                missing.append(str(error))
    for setting, (who, judge) in itertools.product(limits, named.items()):
        try:
            limit = judge(evidence.surveys(setting, len(asked) * len(named)))
        except TooLittle:
            continue
        if limit.state not in {each.state for (w, _), each in judged.items() if w == who}:
            beside.append(f"{who} {_OPENINGS[limit.state]} ({_value(limit)})".strip())
    finding = combine(judged, missing, beside)
    whole = {who for who, _ in judged} >= set(named)  # one that no setting judged is a condition
    return finding if whole or finding.verdict != HOLDS else replace(finding, verdict=CONDITIONS)


def _with_failures(judged: Judged, surveys: Surveys) -> Judged:
    """Says so where surveys gave no result."""
    failed = int(surveys.failed("all").sum())
    if not failed or judged.seeds == len(surveys):  # what is judged may be that they failed
        return judged
    words = f"{judged.words}, {failed} of {len(surveys)} surveys without a result left out"
    return Judged(**{**vars(judged), "words": words})


def combine(
    judged: Mapping[tuple[str, str], Judged],
    missing: list[str] | None = None,
    limits: list[str] | None = None,
) -> Finding:
    """One finding of what is ``judged`` by (whom, setting); what was ``missing``, and what is so in
    the limit of no trajectory error, is said."""
    missing = list(dict.fromkeys(missing or []))
    if not judged:
        return untested(missing[0] if missing else "no setting was judged")
    states = {each.state for each in judged.values()}
    verdict = CONDITIONS if YES in states else FAILS if NO in states else UNDECIDED
    verdict = HOLDS if states == {YES} else verdict
    whom = list(dict.fromkeys(who for who, _ in judged))
    parts = [_words({s: each for (w, s), each in judged.items() if w == who}, who) for who in whom]
    parts += [f"without trajectory error, a limit: {', '.join(limits)}"] if limits else []
    parts += [f"not judged: {', '.join(missing)}"] if missing else []
    firsts = {who: next(each for (w, _), each in judged.items() if w == who) for who in whom}
    values = "; ".join(f"{who} {_value(each)}".strip() for who, each in firsts.items())
    first = firsts[whom[0]]
    return Finding(
        first.measured.value, first.measured.low, first.measured.high,
        "1" if first.unit == "share" else first.unit, values, first.seeds, verdict,
        "; ".join(parts),
    )  # fmt: skip


def _words(settings: Mapping[str, Judged], who: str) -> str:
    """What the settings say of one estimator."""
    parts = []
    for state, opening in _OPENINGS.items():
        names = [name for name, each in settings.items() if each.state == state]
        if names:
            alike = f"; likewise at {', '.join(names[1:])}" if len(names) > 1 else ""
            parts.append(f"{opening} at {names[0]}: {settings[names[0]].words}{alike}")
    return f"{who}{': ' * bool(who)}{'; '.join(parts)}"


def _value(judged: Judged) -> str:
    if not np.isfinite(judged.measured.low):
        return shown(judged.measured.value, judged.unit, judged.signed)
    return span(judged.measured, judged.unit, judged.signed)


def untested(reason: str) -> Finding:
    """Of a claim that these rows, or this simulation, cannot test."""
    return Finding(np.nan, np.nan, np.nan, "", "", 0, UNTESTED, reason)


def fixed(measured: float, holds: bool, words: str, unit: str = "1") -> Finding:
    """Of a claim that follows from the printed numbers alone: no survey, no interval."""
    return Finding(
        float(measured), np.nan, np.nan, "1" if unit == "share" else unit, shown(measured, unit), 0,
        HOLDS if holds else FAILS, words,
    )  # fmt: skip


@dataclass(frozen=True)
class Claim:
    """``text`` in our words, ``place`` in the paper, whose it is, ``kind``; the ``rule`` that
    judges it, and the ``paper``'s value where it prints one."""

    id: str
    place: str
    kind: str
    rule: Rule
    text: str
    paper: Published | None = None

    def judged(self, evidence: Evidence) -> Finding:
        """By few points a face; where all of them turn the verdict, that is said."""
        few, every = self.rule(evidence, FEW), self.rule(evidence, MANY)
        if UNTESTED in (few.verdict, every.verdict) or few.verdict == every.verdict:
            return few
        words = f"with all points of a face: {every.verdict} ({every.values})"
        return replace(few, condition=f"{few.condition}; {words}")

    def line(self, evidence: Evidence) -> dict:
        """Of the ledger, with the columns `COLUMNS`."""
        finding = self.judged(evidence)
        return {
            "id": self.id, "claim": self.text, "place": self.place, "kind": self.kind,
            "paper": self.paper.value if self.paper else np.nan, **asdict(finding),
            "unit": finding.unit or (self.paper.unit if self.paper else ""),
        }  # fmt: skip
