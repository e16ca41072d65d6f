"""How one setting's surveys are judged: an interval against what is asked.

A *quantity* is a function of `Surveys` that gives a series by seed. A *judge* measures one with its
interval over surveys and says yes where the claim is shown beyond chance, no where its opposite is,
or equality within a stated margin, and else that it is undecided: one burden of proof for whoever
makes the claim. What makes quantities and judges is written as a function of the surveys and of
more, and called without them.
"""

from collections.abc import Callable, Mapping
from functools import wraps

import numpy as np
import pandas as pd
from scipy import stats

from paperrepro.frames import ANGLES, BODY_AXES
from paperrepro.method.adjustment.trajectory_equations import PRIOR_SIGMA
from paperrepro.paper.numbers import shown, span
from paperrepro.paper.published import ATTITUDE_ACCURACY
from paperrepro.paper.verdicts import NO, OPEN, YES, Judged
from paperrepro.study.rows import BOUND, LEVER_ARM, SCREENED, WRONG
from paperrepro.study.statistics import CONFIDENCE, SIGMA, TWO_SIDED, Interval, Surveys, TooLittle

Quantity = Callable[[Surveys], pd.Series]
#: Quantities in the unit of another, by the words that name them beside it.
Beside = Mapping[str, Quantity]

#: Two methods are as good as each other if they differ by less than this share of the second; and
#: what is printed as "about so many percent" is met within so many.
MARGIN, ABOUT = 0.1, 0.1
#: A sigma is honest if errors are so many times as large as it says, at most; then 95 % intervals
#: hold the truth so often, and this is the mean square of errors in units of their covariance.
MOST_OVER_SIGMA = 4 / 3
LEAST_COVERAGE = 2 * float(stats.norm.cdf(TWO_SIDED / MOST_OVER_SIGMA)) - 1
MOST_NEES = MOST_OVER_SIGMA**2
#: What is said of every survey may fail in so many of them before it is refuted beyond chance.
EXCEPTIONS = 0.05
#: A growth with noise needs so many noise scales.
LEAST_SCALES = 2


def _uniform_from_normal() -> float:
    """KS distance between a uniform distribution and the normal one of its mean and sigma."""
    x = np.linspace(-np.sqrt(3), np.sqrt(3), 10_001)
    return float(np.abs(stats.uniform(x[0], x[-1] - x[0]).cdf(x) - stats.norm.cdf(x)).max())


#: KS distance that is nearer to a normal distribution than to a uniform one.
NEAR_NORMAL = _uniform_from_normal() / 2


def of_surveys(function: Callable) -> Callable:
    """``function(surveys, ...)`` called without the surveys waits for them."""

    @wraps(function)
    def bound(*args, **options) -> Callable:
        return lambda surveys: function(surveys, *args, **options)

    return bound


def state(yes: bool, no: bool) -> str:
    """What an interval says; ``yes`` comes first where it is within a margin and still beyond."""
    return YES if yes else NO if no else OPEN


# Judges


@of_surveys
def less(
    surveys: Surveys, one: Quantity, other: Quantity, unit: str, margin: float = MARGIN
) -> Judged:
    """``one`` below ``other`` in the same surveys: yes if the mean difference is below zero beyond
    chance; no if it is above, or within a ``margin`` of ``other``."""
    a, b = surveys.enough(one(surveys), other(surveys))
    words = f"against {shown(b.mean(), unit)}, lower in {(a < b).sum()} of {len(a)}"
    return _lower(surveys.mean(a - b), abs(b.mean()), unit, len(a), words, margin)


def lower(one: str, other: str, name: str, unit: str = "m", margin: float = MARGIN) -> Callable:
    """`less` of one metric of two scenarios."""
    return less(metric(one, name), metric(other, name), unit, margin)


def _lower(
    difference: Interval, size: float, unit: str, seeds: int, words: str, margin: float = MARGIN
) -> Judged:  # fmt: skip
    """Whether a ``difference`` is below zero, or alike within a ``margin`` of ``size``."""
    alike = max(-difference.low, difference.high) < margin * size
    words = f"{span(difference, unit, signed=True)} {words}"
    if alike and difference.high >= 0:
        words += f", alike within {shown(margin, 'share')}"
    verdict = state(difference.high < 0, difference.low > 0 or alike)
    return Judged(difference, unit, seeds, verdict, words, signed=True)


@of_surveys
def no_worse(
    surveys: Surveys, one: Quantity, other: Quantity, unit: str, either: bool = False
) -> Judged:
    """``one`` at most a `MARGIN` of ``other`` above it, or with ``either`` below it."""
    a, b = surveys.enough(one(surveys), other(surveys))
    difference, allowed = surveys.mean(a - b), MARGIN * abs(b.mean())
    low = -allowed if either else -np.inf
    sides = "± " if either else ""
    words = f"{span(difference, unit, signed=True)}, allowed {sides}{shown(allowed, unit)}"
    return _banded(difference, unit, len(a), words, low, allowed, signed=True)


@of_surveys
def within(
    surveys: Surveys, quantity: Quantity, unit: str, beside: Beside | None = None, *,
    low: float | None = None, high: Quantity | float | None = None,
) -> Judged:  # fmt: skip
    """Mean between two limits, of which one may be missing: yes if its interval is, no if that lies
    outside. The words name what stands ``beside``."""
    values = quantity(surveys)
    limits = [low, high(surveys) if callable(high) else high]
    asked = [values * 0 + limit for limit in limits if limit is not None]
    values, *asked = surveys.enough(values, *asked)
    mean, edges = surveys.mean(values), [limit.mean() for limit in asked]
    met = pd.Series(True, values.index)
    met &= True if low is None else values > asked[0]
    met &= True if high is None else values < asked[-1]
    words = (
        f"{span(mean, unit)}, {'limit' if len(edges) == 1 else 'asked'} "
        f"{' to '.join(shown(edge, unit) for edge in edges)}, met in {met.sum()} of {len(met)} "
        "surveys"
    )
    means = {name: other(surveys).mean() for name, other in (beside or {}).items()}
    words += "".join(f"; {name} {shown(mean, unit)}" for name, mean in means.items())
    least = -np.inf if low is None else edges[0]
    most = np.inf if high is None else edges[-1]
    return _banded(mean, unit, len(values), words, least, most)


@of_surveys
def median(
    surveys: Surveys, quantity: Quantity, high: float, unit: str, beside: Beside | None = None
) -> Judged:
    """Median at most ``high``: yes if its interval is below, no if above. The words name medians
    ``beside``."""
    (kept,) = surveys.enough(quantity(surveys))
    middle = surveys.resampled(kept.to_numpy(), np.median)
    words = f"median {span(middle, unit)}, limit {shown(high, unit)}, largest "
    words += shown(kept.max(), unit)
    means = {name: other(surveys).median() for name, other in (beside or {}).items()}
    words += "".join(f"; {name} {shown(value, unit)}" for name, value in means.items())
    return _banded(middle, unit, len(kept), words, -np.inf, high)


def about(
    quantity: Quantity, value: float, beside: Beside | None = None, margin: float = ABOUT,
    unit: str = "share",
) -> Callable:  # fmt: skip
    """`within` a margin of a value printed as "about"."""
    return within(quantity, unit, beside, low=value - margin, high=value + margin)


def gains(scenario: str, name: str, limit: float) -> Callable:
    """Whether a metric falls by more than the share ``limit``."""
    beside = {"the true mounting gains": reduced("truth", name)}
    return within(reduced(scenario, name), "share", beside, low=limit)


def normal(scenario: str) -> Callable:
    """Whether distances are nearer to a normal distribution than to a uniform one."""
    beside = {
        "uncalibrated": metric("before", "ks_reference"),
        "skewness": metric(scenario, "skewness_reference"),
        "excess kurtosis": metric(scenario, "kurtosis_reference"),
    }
    return within(metric(scenario, "ks_reference"), "1", beside, high=NEAR_NORMAL)


def _banded(
    measured: Interval, unit: str, seeds: int, words: str, low: float, high: float,
    signed: bool = False,
) -> Judged:  # fmt: skip
    inside = measured.low > low and measured.high < high
    outside = measured.high < low or measured.low > high
    return Judged(measured, unit, seeds, state(inside, outside), words, signed)


@of_surveys
def always(surveys: Surveys, mask: Quantity) -> Judged:
    """Share of surveys of which ``mask`` is true: yes if all; no if more than `EXCEPTIONS` are not,
    beyond chance. A survey without a value is left out."""
    (kept,) = surveys.enough(mask(surveys))
    kept = kept.astype(bool)
    share = surveys.share(kept)
    words = f"met in {kept.sum()} of {len(kept)} surveys"
    verdict = state(bool(kept.all()), share.high < 1 - EXCEPTIONS)
    return Judged(share, "share", len(kept), verdict, words)


@of_surveys
def mostly(surveys: Surveys, mask: Quantity) -> Judged:
    """True of more than half of the surveys beyond chance; no if of fewer."""
    (kept,) = surveys.enough(mask(surveys))
    kept = kept.astype(bool)
    return _half(surveys.share(kept), f"so in {kept.sum()} of {len(kept)} surveys", len(kept))


@of_surveys
def mostly_less(surveys: Surveys, one: Quantity, other: Quantity) -> Judged:
    """Sign test: ``one`` below ``other`` in more than half of the surveys beyond chance; surveys in
    which they are equal say nothing."""
    a, b = surveys.enough(one(surveys), other(surveys))
    a, b = surveys.enough(a[a != b], b[a != b])
    words = f"lower in {(a < b).sum()} of {len(a)} surveys"
    return _half(surveys.share(a < b), words, len(a))


def _half(share: Interval, words: str, seeds: int) -> Judged:
    words = f"{words} ({_percent(share)})"
    return Judged(share, "share", seeds, state(share.low > 0.5, share.high < 0.5), words)


@of_surveys
def slower(by_noise: list[Surveys], one: str, other: str) -> Judged:
    """Error of ``one`` grows less with noise than that of ``other``: slopes over the noise scales,
    in the same surveys."""
    a, b = by_noise[0].enough(*(_growth(by_noise, scenario) for scenario in (one, other)))
    words = f"per noise scale, against {shown(b.mean(), 'deg')} of {other}"
    return _lower(by_noise[0].mean(a - b), abs(b.mean()), "deg", len(a), words)


@of_surveys
def grows(by_noise: list[Surveys], scenario: str, asked: bool) -> Judged:
    """Whether the error grows with noise beyond chance is as ``asked``: it does not if it changes
    by less than a `MARGIN` of its mean from one noise scale to the next."""
    (slope,) = by_noise[0].enough(_growth(by_noise, scenario))
    mean, size = by_noise[0].mean(slope), _errors_by_noise(by_noise, scenario).to_numpy().mean()
    steady = max(-mean.low, mean.high) < MARGIN * size or mean.high < 0
    words = f"error grows by {span(mean, 'deg', signed=True)} per noise scale"
    answers = (mean.low > 0, steady) if asked else (steady, mean.low > 0)
    return Judged(mean, "deg", len(slope), state(*answers), words, signed=True)


def _growth(by_noise: list[Surveys], scenario: str) -> pd.Series:
    """Slope of the error over the noise scale, deg, by seed. Raises `TooLittle`."""
    scale = np.array([surveys.setting.noise_scale for surveys in by_noise])
    if len(scale) < LEAST_SCALES:
        raise TooLittle(
            f"{len(scale)} noise scale of {by_noise[0].setting.name}, {LEAST_SCALES} are needed"
        )
    errors = _errors_by_noise(by_noise, scenario)
    return errors @ (scale - scale.mean()) / np.square(scale - scale.mean()).sum()


def _errors_by_noise(by_noise: list[Surveys], scenario: str) -> pd.DataFrame:
    return pd.concat([surveys.error(scenario) for surveys in by_noise], axis=1).dropna()


@of_surveys
def vanishes(by_noise: list[Surveys], scenario: str, name: str) -> Judged:
    """Share of the mean square of a metric at the specified noise that is gone without any: yes if
    it is more than half."""
    scales = {surveys.setting.noise_scale: surveys for surveys in by_noise}
    if not {0.0, 1.0} <= set(scales):
        raise TooLittle(f"no surveys of {by_noise[0].setting.name} with and without noise")
    still, moved = scales[1.0].enough(*(scales[k].of(scenario, name) ** 2 for k in (0.0, 1.0)))

    def gone(values: np.ndarray, axis: int = 0) -> np.ndarray:
        mean = values.mean(axis=axis)
        return 1 - mean[..., 0] / mean[..., 1]

    share = scales[1.0].resampled(np.column_stack([still, moved]), gone)
    words = f"{span(share, 'share')} of its mean square vanishes with the trajectory's error"
    return Judged(share, "share", len(still), state(share.low > 0.5, share.high < 0.5), words)


@of_surveys
def coverage(surveys: Surveys, scenario: str) -> Judged:
    """Share of 95 % intervals, one an angle, that hold the truth, bootstrapped by survey: yes if it
    is above `LEAST_COVERAGE` beyond chance, no if below 95 %."""
    error = pd.concat(_errors(surveys, scenario), axis=1, keys=ANGLES)
    sigma = pd.concat(_errors(surveys, scenario, SIGMA), axis=1, keys=ANGLES)
    held = (error.abs() <= TWO_SIDED * sigma).astype(float).where(error.notna() & sigma.notna())
    (held,) = surveys.enough(held.mean(axis=1, skipna=False))
    share = surveys.mean_share(held)
    words = (
        f"{shown(held.mean(), 'share')} of {len(ANGLES) * len(held)} intervals hold the truth "
        f"({_percent(share)}), {shown(CONFIDENCE, 'share')} promised"
    )
    verdict = state(share.low > LEAST_COVERAGE, share.high < CONFIDENCE)
    return Judged(share, "share", len(held), verdict, words)


@of_surveys
def standardised(surveys: Surveys, scenario: str) -> Judged:
    """Mean squared error in units of the formal covariance, per angle, 1 if it is honest: yes if it
    is below `MOST_NEES` beyond chance, no if above 1."""
    (nees,) = surveys.enough(surveys.of(scenario, "nees"))
    mean = surveys.mean(nees)
    times = shown(np.sqrt(mean.value), "1")
    words = f"{span(mean, '1')}, so errors are {times} times as large as the sigmas say"
    return Judged(mean, "1", len(nees), state(mean.high < MOST_NEES, mean.low > 1), words)


@of_surveys
def near_bound(surveys: Surveys, scenario: str, allowed: float) -> Judged:
    """RMS error of the angle that fares worst, over the Cramer-Rao bound on the same points: yes if
    it is below ``allowed`` beyond chance, no if above."""
    series = _errors(surveys, scenario)
    series += [surveys.of(BOUND, f"bound_{angle}") for angle in ANGLES]
    squares = np.square(np.column_stack(surveys.enough(*series)))

    def ratios(squares: np.ndarray, axis: int = 0) -> np.ndarray:
        mean = squares.mean(axis=axis)
        return np.sqrt(mean[..., :3] / mean[..., 3:])

    worst = int(np.argmax(ratios(squares)))
    spread = surveys.resampled(squares, lambda part, axis: ratios(part, axis)[..., worst])
    each = zip(ANGLES, ratios(squares), strict=True)
    words = ", ".join(f"{angle} {shown(ratio, '1')}" for angle, ratio in each)
    words = f"RMS error over the bound: {words}; worst {span(spread, '1')}"
    return _banded(spread, "1", len(squares), words, -np.inf, allowed)


def _errors(surveys: Surveys, scenario: str, ending: str = "") -> list[pd.Series]:
    """Of the three angles, deg."""
    return [surveys.of(scenario, f"{ending}error_{angle}") for angle in ANGLES]


def _percent(share: Interval) -> str:
    return f"{shown(share.low, 'share')} to {shown(share.high, 'share')}"


# Quantities


def error(scenario: str) -> Quantity:
    """Size of the boresight error, deg."""
    return lambda surveys: surveys.error(scenario)


def metric(scenario: str, name: str) -> Quantity:
    """A metric of the study's rows."""
    return lambda surveys: surveys.of(scenario, name)


def left(scenario: str, name: str) -> Quantity:
    """Share of a metric before calibration that is left."""
    return lambda surveys: surveys.left(scenario, name)


def reduced(scenario: str, name: str) -> Quantity:
    """Share of a metric before calibration that is gone."""
    return lambda surveys: 1 - surveys.left(scenario, name)


@of_surveys
def gain_over(surveys: Surveys, scenario: str, other: str, name: str) -> pd.Series:
    """What a scenario gains of a metric, over what ``other`` gains on average."""
    before = surveys.of("before", name)
    return (before - surveys.of(scenario, name)) / (before - surveys.of(other, name)).mean()


@of_surveys
def corrected(surveys: Surveys, scenario: str) -> pd.Series:
    """Share of the boresight's error that is gone."""
    return 1 - surveys.error(scenario) / surveys.error("before")


@of_surveys
def ratio(surveys: Surveys, one: Quantity, other: Quantity) -> pd.Series:
    """One quantity over another."""
    return one(surveys) / other(surveys)


@of_surveys
def largest(surveys: Surveys, *quantities: Quantity) -> pd.Series:
    """The largest of several quantities of a survey."""
    each = [quantity(surveys) for quantity in quantities]
    return pd.concat(each, axis=1).max(axis=1, skipna=False)


@of_surveys
def centred(surveys: Surveys, scenario: str) -> pd.Series:
    """Mean distance to the true planes in units of what trajectory errors alone make of it: the
    RMS over surveys of the mean under the true mounting."""
    honest = np.sqrt((surveys.of("truth", "mean_truth") ** 2).mean())
    return surveys.of(scenario, "mean_truth").abs() / honest


def over_floor(scenario: str) -> Quantity:
    """RMSE against true planes over that under the true mounting."""
    return ratio(metric(scenario, "rmse_truth"), metric("truth", "rmse_truth"))


def without_screening(scenario: str) -> Quantity:
    """Error with one wrong match, deg; endless where no solution was found."""
    return lambda surveys: _spoiled(surveys, scenario + WRONG)


def _spoiled(surveys: Surveys, name: str) -> pd.Series:
    failed = surveys.failed(name) & ~surveys.failed("all" + WRONG)
    try:
        error = surveys.error(name)
    except TooLittle:
        if not failed.any():
            raise
        error = pd.Series(np.nan, failed.index)
    return error.mask(failed, np.inf)


# What is true of a survey or not, as `always` and `mostly` ask: 1, 0, or missing where it was not
# measured


@of_surveys
def at_most(surveys: Surveys, quantity: Quantity, limit: float) -> pd.Series:
    """A quantity is so small."""
    return _true(quantity(surveys) <= limit, quantity(surveys))


def any_false(surveys: Surveys) -> pd.Series:
    """The first pass, under the mounting to start from, makes a false match."""
    false = surveys.of("before", "false_pairs") + surveys.of("before", "rejected")
    return _true(false > 0, false)


@of_surveys
def unknowns_follow(surveys: Surveys, scenario: str, each: int) -> pd.Series:
    """The number of unknowns is a constant and ``each`` for every plane."""
    rest = surveys.of(scenario, "unknowns") - each * surveys.of("all", "planes")
    return _true(rest == rest.min(), rest)


def completes(scenario: str) -> Quantity:
    """The scenario gives a result."""
    return lambda surveys: (~surveys.failed(scenario)).astype(float)


@of_surveys
def not_deceived(surveys: Surveys, scenario: str, near_normal: float) -> pd.Series:
    """Of surveys whose histogram is so near to normal: the boresight's error lies in its own 95 %
    region. The others say nothing."""
    nees, ks = surveys.of(scenario, "nees"), surveys.of(scenario, "ks_reference")
    inside = len(ANGLES) * nees <= stats.chi2.ppf(CONFIDENCE, len(ANGLES))
    return _true(inside, nees.where(ks < near_normal))


@of_surveys
def within_specification(surveys: Surveys, scenario: str) -> pd.Series:
    """All three angles within the attitude accuracy of the GNSS/INS."""
    limits = [ATTITUDE_ACCURACY[angle].value for angle in ANGLES]
    return _all_within(_errors(surveys, scenario), limits)


def lever_arm_found(surveys: Surveys) -> pd.Series:
    """Scenario D finds the forward and right parts of the lever arm better than half of its prior
    sigma; the down part is not asked."""
    errors = [surveys.of(LEVER_ARM, f"error_{axis}") for axis in BODY_AXES[:2]]
    return _all_within(errors, [PRIOR_SIGMA / 2] * 2)


@of_surveys
def unharmed(surveys: Surveys, scenario: str) -> pd.Series:
    """One wrong match, screened, adds less to the error than it typically is without."""
    clean = surveys.error(scenario)
    added = _spoiled(surveys, scenario + SCREENED) - clean
    return _true(added < np.sqrt((clean**2).mean()), added)


def _all_within(errors: list[pd.Series], limits: list[float]) -> pd.Series:
    inside = [e.abs() <= limit for e, limit in zip(errors, limits, strict=True)]
    return _true(
        pd.concat(inside, axis=1).all(axis=1), pd.concat(errors, axis=1).sum(axis=1, skipna=False)
    )


def _true(mask: pd.Series, measured: pd.Series) -> pd.Series:
    return mask.astype(float).where(measured.notna())
