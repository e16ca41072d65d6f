"""How one setting's surveys are judged: comparisons, bounds, shares of surveys.

A *quantity* is a function of `Surveys` that gives a series by seed. Ledger unit of shares is "1".

Judges of what a method says of itself: sigmas, histograms, wrong matches.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
import pandas as pd
from scipy import stats

from paperrepro.frames import ANGLES
from paperrepro.method.adjustment.trajectory_equations import AXES, PRIOR_SIGMA
from paperrepro.paper.published import ATTITUDE_ACCURACY
from paperrepro.paper.verdicts import NO, OPEN, PARTLY, YES, Judge, Judged, shown, span
from paperrepro.study.simulated import BOUND, LEVER_ARM, SCREENED, WRONG
from paperrepro.study.statistics import CONFIDENCE, SIGMA, TWO_SIDED, Interval, Surveys, TooLittle

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


#: Lilliefors' 5 % limit of the KS distance from a normal distribution of estimated mean and sigma,
#: times the root of the sample size.
LILLIEFORS = 0.886


def coverage(scenario: str) -> Judge:
    """Share of 95 % intervals, one an angle, that hold the truth: yes unless it is below 95 %
    beyond chance. A survey's three angles count as one sample."""

    def judge(surveys: Surveys) -> Judged:
        (held,) = surveys.enough(_held(surveys, scenario))
        share = surveys.share(_whole_surveys(held))
        words = (
            f"{shown(held.mean(), 'share')} of {len(ANGLES) * len(held)} intervals hold the truth "
            f"({shown(share.low, 'share')} to {shown(share.high, 'share')}), "
            f"{shown(CONFIDENCE, 'share')} promised"
        )
        return Judged(share, "1", len(held), YES if share.high >= CONFIDENCE else NO, words)

    return judge


def _held(surveys: Surveys, scenario: str) -> pd.Series:
    """Share of a survey's angles whose intervals hold the truth."""
    parts = []
    for angle in ANGLES:
        error = surveys.of(scenario, f"error_{angle}")
        sigma = surveys.of(scenario, f"{SIGMA}error_{angle}")
        parts.append((error.abs() <= TWO_SIDED * sigma).where(error.notna() & sigma.notna()))
    return pd.concat(parts, axis=1).astype(float).mean(axis=1, skipna=False)


def _whole_surveys(share: pd.Series) -> pd.Series:
    """As many surveys that hold the truth as the shares make together."""
    return pd.Series(np.arange(len(share)) < round(share.sum()))


def standardised(scenario: str) -> Judge:
    """Mean squared error in units of the formal covariance, per angle: 1 if it is honest; yes
    unless it is above 1 beyond chance."""

    def judge(surveys: Surveys) -> Judged:
        (nees,) = surveys.enough(surveys.of(scenario, "nees"))
        mean = surveys.mean(nees)
        words = (
            f"{span(mean, '1')}, so errors are {shown(np.sqrt(mean.value), '1')} times as large "
            "as the sigmas say"
        )
        return Judged(mean, "1", len(nees), YES if mean.low <= 1 else NO, words)

    return judge


def near_bound(scenario: str, allowed: float) -> Judge:
    """RMS error of the angle that fares worst, over the Cramer-Rao bound on the same points: yes
    unless it is above ``allowed`` beyond chance."""

    def judge(surveys: Surveys) -> Judged:
        series = [surveys.of(scenario, f"error_{angle}") for angle in ANGLES]
        series += [surveys.of(BOUND, f"bound_{angle}") for angle in ANGLES]
        squares = np.square(np.column_stack(surveys.enough(*series)))
        ratio = _ratios(squares, axis=0)
        worst = int(np.argmax(ratio))
        spread = surveys.resampled(squares, lambda part, axis: _ratios(part, axis)[..., worst])
        words = ", ".join(
            f"{angle} {shown(r, '1')}" for angle, r in zip(ANGLES, ratio, strict=True)
        )
        words = f"RMS error over the bound: {words}; worst {span(spread, '1')}"
        return Judged(spread, "1", len(squares), YES if spread.low <= allowed else NO, words)

    return judge


def _ratios(squares: np.ndarray, axis: int) -> np.ndarray:
    """RMS errors over bounds (..., 3) from squares (..., 6), over the seeds' ``axis``."""
    mean = squares.mean(axis=axis)
    return np.sqrt(mean[..., :3] / mean[..., 3:])


def critical_ks(surveys: Surveys) -> pd.Series:
    """KS distance that normal samples stay under in 95 % of cases. Points of one view of a face
    share one trajectory error: a view is one sample."""
    return LILLIEFORS / np.sqrt(surveys.of("all", "views"))


def critical_ks_of_points(surveys: Surveys) -> pd.Series:
    """The same if every point were a sample of its own, which it is not."""
    return LILLIEFORS / np.sqrt(surveys.of("all", "points"))


def centred(scenario: str) -> Quantity:
    """Mean distance to the true planes in units of what trajectory errors alone make of it: the
    RMS over surveys of the mean under the true mounting."""

    def quantity(surveys: Surveys) -> pd.Series:
        honest = np.sqrt((surveys.of("truth", "mean_truth") ** 2).mean())
        return surveys.of(scenario, "mean_truth").abs() / honest

    return quantity


def not_deceived(scenario: str):
    """No survey in which the histogram looks normal while the boresight error exceeds its own
    95 % region."""

    def mask(surveys: Surveys) -> pd.Series:
        normal = surveys.of(scenario, "ks_reference") < critical_ks(surveys)
        nees = surveys.of(scenario, "nees")
        beyond = len(ANGLES) * nees > stats.chi2.ppf(CONFIDENCE, len(ANGLES))
        return (~(normal & beyond)).astype(float).where(nees.notna())

    return mask


def within_specification(scenario: str):
    """All three angles within the attitude accuracy of the GNSS/INS."""

    def mask(surveys: Surveys) -> pd.Series:
        errors = [surveys.of(scenario, f"error_{angle}") for angle in ANGLES]
        limits = [ATTITUDE_ACCURACY[angle].value for angle in ANGLES]
        inside = [e.abs() <= limit for e, limit in zip(errors, limits, strict=True)]
        return pd.concat(inside, axis=1).all(axis=1).astype(float).where(errors[0].notna())

    return mask


def lever_arm_found(surveys: Surveys) -> pd.Series:
    """Scenario D finds the forward and right parts of the lever arm better than half of its prior
    sigma; the down part is not asked."""
    errors = [surveys.of(LEVER_ARM, f"error_{axis}") for axis in AXES[:2]]
    found = pd.concat([e.abs() <= PRIOR_SIGMA / 2 for e in errors], axis=1).all(axis=1)
    return found.astype(float).where(errors[0].notna())


def without_screening(scenario: str) -> Quantity:
    """Error with one wrong match, deg; endless where no solution was found."""
    return lambda surveys: _spoiled(surveys, scenario + WRONG)


def unharmed(scenario: str, screened: bool):
    """One wrong match adds less to the error than it typically is without."""

    def mask(surveys: Surveys) -> pd.Series:
        clean = surveys.error(scenario)
        spoiled = _spoiled(surveys, scenario + (SCREENED if screened else WRONG))
        typical = np.sqrt((clean**2).mean())
        added = spoiled - clean
        return (added < typical).astype(float).where(added.notna())

    return mask


def _spoiled(surveys: Surveys, name: str) -> pd.Series:
    failed = surveys.failed(name) & ~surveys.failed("all" + WRONG)
    try:
        error = surveys.error(name)
    except TooLittle:
        error = pd.Series(np.nan, failed.index)
    return error.mask(failed, np.inf)


def over_floor(scenario: str) -> Quantity:
    """RMSE against true planes over that under the true mounting."""
    return lambda surveys: surveys.of(scenario, "rmse_truth") / surveys.of("truth", "rmse_truth")
