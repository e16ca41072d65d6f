"""How one setting's surveys are judged: comparisons, bounds, shares of surveys.

A *quantity* is a function of `Surveys` that gives a series by seed. Ledger unit of shares is "1".
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
import pandas as pd

from paperrepro.claims.evidence import Interval, Surveys, TooLittle
from paperrepro.claims.verdicts import NO, OPEN, PARTLY, YES, Judge, Judged, shown, span

Quantity = Callable[[Surveys], pd.Series]

#: Quantities by the words that name them.
Beside = Mapping[str, Quantity]
NOTHING: Beside = MappingProxyType({})

#: Two methods are as good as each other if they differ by less than this share of the second.
MARGIN = 0.1
#: A growth with noise needs so many noise scales.
LEAST_SCALES = 2


def error(scenario: str) -> Quantity:
    """Size of the boresight error, deg."""
    return lambda surveys: surveys.error(scenario)


def metric(scenario: str, name: str) -> Quantity:
    return lambda surveys: surveys.of(scenario, name)


def left(scenario: str, name: str) -> Quantity:
    """Share of a metric before calibration that is left."""
    return lambda surveys: surveys.left(scenario, name)


def reduced(scenario: str, name: str) -> Quantity:
    """Share of a metric before calibration that is gone."""
    return lambda surveys: 1 - surveys.left(scenario, name)


def at_most(scenario: str, name: str, limit: float) -> Quantity:
    """Whether a metric is so small, as `always` asks; missing where it was not measured."""

    def mask(surveys: Surveys) -> pd.Series:
        values = surveys.of(scenario, name)
        return (values <= limit).astype(float).where(values.notna())

    return mask


def largest(*quantities: Quantity) -> Quantity:
    return lambda surveys: pd.concat([q(surveys) for q in quantities], axis=1).max(
        axis=1, skipna=False
    )


def less(one: Quantity, other: Quantity, unit: str) -> Judge:
    """``one`` below ``other`` in the same surveys: yes if the mean difference is below zero beyond
    chance, else no."""

    def judge(surveys: Surveys) -> Judged:
        a, b = surveys.enough(one(surveys), other(surveys))
        difference = surveys.mean(a - b)
        state = YES if difference.high < 0 else NO
        beyond = difference.low > 0 or difference.high < 0
        chance = "" if beyond else ", no difference beyond chance"
        words = (
            f"{span(difference, unit, signed=True)} against {shown(b.mean(), unit)}, "
            f"lower in {(a < b).sum()} of {len(a)}{chance}"
        )
        return Judged(difference, _ledger_unit(unit), len(a), state, words)

    return judge


def below(
    quantity: Quantity, limit: Quantity | float, unit: str, beside: Beside = NOTHING
) -> Judge:
    """Mean under ``limit``: yes if its interval lies under it, no if above, else in part.

    ``beside`` are quantities in the same unit that the words name for comparison.
    """

    def judge(surveys: Surveys) -> Judged:
        bounds = limit(surveys) if callable(limit) else quantity(surveys) * 0 + limit
        values, bounds = surveys.enough(quantity(surveys), bounds)
        return _bounded(surveys, values, bounds, unit, beside, under=True)

    return judge


def above(quantity: Quantity, limit: float, unit: str, beside: Beside = NOTHING) -> Judge:
    """Mean over ``limit``: yes if its interval lies above it, no if under, else in part."""

    def judge(surveys: Surveys) -> Judged:
        (values,) = surveys.enough(quantity(surveys))
        return _bounded(surveys, values, values * 0 + limit, unit, beside, under=False)

    return judge


def _bounded(surveys, values, bounds, unit: str, beside: Beside, under: bool) -> Judged:
    mean, limit = surveys.mean(values), bounds.mean()
    sides = (mean.high < limit, mean.low > limit)
    inside, outside = sides if under else sides[::-1]
    met = (values < bounds) if under else (values > bounds)
    words = (
        f"{span(mean, unit)}, limit {shown(limit, unit)}, met in {met.sum()} of {len(met)} surveys"
        f"{_compared(surveys, beside, unit)}"
    )
    return Judged(mean, _ledger_unit(unit), len(values), _state(inside, outside), words)


def near(
    quantity: Quantity, value: float, within: float, unit: str, beside: Beside = NOTHING
) -> Judge:
    """Mean as far from ``value`` as ``within`` allows: by its interval, as in `below`."""

    def judge(surveys: Surveys) -> Judged:
        (values,) = surveys.enough(quantity(surveys))
        mean, low, high = surveys.mean(values), value - within, value + within
        state = _state(mean.low >= low and mean.high <= high, mean.high < low or mean.low > high)
        met = values.between(low, high).sum()
        words = (
            f"{span(mean, unit)}, asked {shown(low, unit)} to {shown(high, unit)}, met in {met} of "
            f"{len(values)} surveys{_compared(surveys, beside, unit)}"
        )
        return Judged(mean, _ledger_unit(unit), len(values), state, words)

    return judge


def no_worse(one: Quantity, other: Quantity, unit: str, margin: float = MARGIN) -> Judge:
    """``one`` at most a ``margin`` of ``other`` above it: by the interval of the difference, which
    may leave it undecided."""

    def judge(surveys: Surveys) -> Judged:
        a, b = surveys.enough(one(surveys), other(surveys))
        difference, allowed = surveys.mean(a - b), margin * b.mean()
        state = _state(difference.high <= allowed, difference.low > allowed, OPEN)
        words = f"{span(difference, unit, signed=True)}, allowed {shown(allowed, unit)}"
        return Judged(difference, _ledger_unit(unit), len(a), state, words)

    return judge


def similar(one: Quantity, other: Quantity, unit: str, margin: float = MARGIN) -> Judge:
    """Neither is worse than the other by more than ``margin``, or it is undecided."""

    def judge(surveys: Surveys) -> Judged:
        a, b = surveys.enough(one(surveys), other(surveys))
        difference, allowed = surveys.mean(a - b), margin * b.mean()
        inside = -allowed <= difference.low and difference.high <= allowed
        outside = difference.low > allowed or difference.high < -allowed
        words = f"{span(difference, unit, signed=True)}, allowed ± {shown(allowed, unit)}"
        state = _state(inside, outside, OPEN)
        return Judged(difference, _ledger_unit(unit), len(a), state, words)

    return judge


def always(mask: Callable[[Surveys], pd.Series]) -> Judge:
    """Share of surveys of which ``mask`` is true: yes if all, no if fewer than half."""

    def judge(surveys: Surveys) -> Judged:
        (kept,) = surveys.enough(mask(surveys))
        kept = kept.astype(bool)
        share = surveys.share(kept)
        words = f"met in {kept.sum()} of {len(kept)} surveys"
        return Judged(share, "1", len(kept), _state(kept.all(), share.value < 0.5), words)

    return judge


def mostly_less(one: Quantity, other: Quantity) -> Judge:
    """Sign test: yes if ``one`` is below ``other`` in more than half of the surveys beyond chance;
    surveys in which they are equal say nothing."""

    def judge(surveys: Surveys) -> Judged:
        a, b = surveys.enough(one(surveys), other(surveys))
        a, b = a[a != b], b[a != b]
        a, b = surveys.enough(a, b)
        share = surveys.share(a < b)
        words = f"lower in {(a < b).sum()} of {len(a)} surveys ({_percent(share)})"
        return Judged(share, "1", len(a), YES if share.low > 0.5 else NO, words)

    return judge


def steeper(one: str, other: str, unit: str = "deg") -> Callable[[list[Surveys]], Judged]:
    """Error of ``one`` grows less with noise than that of ``other``: slopes over the noise scales,
    in the same surveys."""

    def judge(by_noise: list[Surveys]) -> Judged:
        a, b = (growth(by_noise, scenario) for scenario in (one, other))
        a, b = by_noise[0].enough(a, b)
        difference = by_noise[0].mean(a - b)
        words = (
            f"{span(difference, unit, signed=True)} per noise scale, against "
            f"{shown(b.mean(), unit)} of {other}"
        )
        return Judged(difference, unit, len(a), YES if difference.high < 0 else NO, words)

    return judge


def grows(scenario: str, asked: bool, unit: str = "deg") -> Callable[[list[Surveys]], Judged]:
    """Whether the error grows with noise beyond chance is as ``asked``."""

    def judge(by_noise: list[Surveys]) -> Judged:
        (slope,) = by_noise[0].enough(growth(by_noise, scenario))
        mean = by_noise[0].mean(slope)
        words = f"error grows by {span(mean, unit, signed=True)} per noise scale"
        return Judged(mean, unit, len(slope), YES if (mean.low > 0) == asked else NO, words)

    return judge


def growth(by_noise: list[Surveys], scenario: str) -> pd.Series:
    """Slope of the error over the noise scale, deg, by seed. Raises `TooLittle`."""
    scale = np.array([surveys.setting.noise_scale for surveys in by_noise])
    if len(scale) < LEAST_SCALES:
        raise TooLittle(
            f"{len(scale)} noise scale of {by_noise[0].setting.name}, {LEAST_SCALES} are needed"
        )
    errors = pd.concat([surveys.error(scenario) for surveys in by_noise], axis=1)
    return errors @ (scale - scale.mean()) / np.square(scale - scale.mean()).sum()


def _state(inside: bool, outside: bool, else_: str = PARTLY) -> str:
    return YES if inside else NO if outside else else_


def _compared(surveys: Surveys, beside: Beside, unit: str) -> str:
    means = {name: quantity(surveys).mean() for name, quantity in beside.items()}
    return "".join(f"; {name} {shown(mean, unit)}" for name, mean in means.items())


def _percent(share: Interval) -> str:
    return f"{shown(share.low, 'share')} to {shown(share.high, 'share')}"


def _ledger_unit(unit: str) -> str:
    return "1" if unit == "share" else unit
