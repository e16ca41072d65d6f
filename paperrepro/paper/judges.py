"""How one setting's surveys are judged: an interval against a band.

A *quantity* is a function of `Surveys` that gives a series by seed. A *judge* measures one with its
interval and asks whether that lies inside a band, outside, or across an edge of it; what the last
means is the judge's own: "not worse than" bears a lighter burden than "better than". What makes
quantities and judges is written as a function of the surveys and of more, and called without them.
"""

from collections.abc import Callable, Mapping
from functools import wraps

import numpy as np
import pandas as pd
from scipy import stats

from paperrepro.frames import ANGLES
from paperrepro.method.adjustment.trajectory_equations import AXES, PRIOR_SIGMA
from paperrepro.paper.numbers import shown, span
from paperrepro.paper.published import ATTITUDE_ACCURACY
from paperrepro.paper.verdicts import NO, OPEN, PARTLY, YES, Judged
from paperrepro.study.rows import BOUND, LEVER_ARM, SCREENED, WRONG
from paperrepro.study.statistics import CONFIDENCE, SIGMA, TWO_SIDED, Interval, Surveys, TooLittle

Quantity = Callable[[Surveys], pd.Series]
#: Quantities in the unit of another, by the words that name them beside it.
Beside = Mapping[str, Quantity]

#: Two methods are as good as each other if they differ by less than this share of the second.
MARGIN = 0.1
#: A growth with noise needs so many noise scales.
LEAST_SCALES = 2
#: Lilliefors' 5 % limit of the KS distance from a normal distribution of estimated mean and sigma,
#: times the root of the sample size.
LILLIEFORS = 0.886


def of_surveys(function: Callable) -> Callable:
    """``function(surveys, ...)`` called without the surveys waits for them."""

    @wraps(function)
    def bound(*args, **options) -> Callable:
        return lambda surveys: function(surveys, *args, **options)

    return bound


def banded(
    measured: Interval, unit: str, seeds: int, words: str, across: str,
    low: float = -np.inf, high: float = np.inf,
) -> Judged:  # fmt: skip
    """Yes if the whole interval lies between ``low`` and ``high``, no if none of it does, and
    ``across`` if a part does. Shares are in the unit "1" of the ledger."""
    inside = measured.low > low and measured.high < high
    outside = measured.high < low or measured.low > high
    state = YES if inside else NO if outside else across
    return Judged(measured, "1" if unit == "share" else unit, seeds, state, words)


# Judges


@of_surveys
def less(surveys: Surveys, one: Quantity, other: Quantity, unit: str) -> Judged:
    """``one`` below ``other`` in the same surveys: yes if the mean difference is below zero beyond
    chance, else no."""
    a, b = surveys.enough(one(surveys), other(surveys))
    difference = surveys.mean(a - b)
    beyond = difference.low > 0 or difference.high < 0
    words = (
        f"{span(difference, unit, signed=True)} against {shown(b.mean(), unit)}, lower in "
        f"{(a < b).sum()} of {len(a)}{'' if beyond else ', no difference beyond chance'}"
    )
    return banded(difference, unit, len(a), words, NO, high=0)


@of_surveys
def no_worse(
    surveys: Surveys, one: Quantity, other: Quantity, unit: str, either: bool = False
) -> Judged:
    """``one`` at most a `MARGIN` of ``other`` above it, or with ``either`` below it: by the
    interval of the difference, which may leave it undecided."""
    a, b = surveys.enough(one(surveys), other(surveys))
    difference, allowed = surveys.mean(a - b), MARGIN * b.mean()
    sides, low = ("± ", -allowed) if either else ("", -np.inf)
    words = f"{span(difference, unit, signed=True)}, allowed {sides}{shown(allowed, unit)}"
    return banded(difference, unit, len(a), words, OPEN, low, allowed)


@of_surveys
def within(
    surveys: Surveys, quantity: Quantity, unit: str, beside: Beside | None = None, *,
    low: float | None = None, high: Quantity | float | None = None,
) -> Judged:  # fmt: skip
    """Mean between two limits, of which one may be missing: yes if its interval is, no if that lies
    outside, else in part. The words name what stands ``beside``."""
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
    return banded(mean, unit, len(values), words, PARTLY, least, most)


@of_surveys
def always(surveys: Surveys, mask: Quantity) -> Judged:
    """Share of surveys of which ``mask`` is true: yes if all, no if fewer than half."""
    (kept,) = surveys.enough(mask(surveys))
    kept = kept.astype(bool)
    share = surveys.share(kept)
    state = YES if kept.all() else NO if share.value < 0.5 else PARTLY
    return Judged(share, "1", len(kept), state, f"met in {kept.sum()} of {len(kept)} surveys")


@of_surveys
def mostly_less(surveys: Surveys, one: Quantity, other: Quantity) -> Judged:
    """Sign test: yes if ``one`` is below ``other`` in more than half of the surveys beyond chance;
    surveys in which they are equal say nothing."""
    a, b = surveys.enough(one(surveys), other(surveys))
    a, b = surveys.enough(a[a != b], b[a != b])
    share = surveys.share(a < b)
    words = f"lower in {(a < b).sum()} of {len(a)} surveys ({_percent(share)})"
    return banded(share, "1", len(a), words, NO, low=0.5)


@of_surveys
def slower(by_noise: list[Surveys], one: str, other: str) -> Judged:
    """Error of ``one`` grows less with noise than that of ``other``: slopes over the noise scales,
    in the same surveys."""
    a, b = by_noise[0].enough(*(_growth(by_noise, scenario) for scenario in (one, other)))
    difference = by_noise[0].mean(a - b)
    grown = span(difference, "deg", signed=True)
    words = f"{grown} per noise scale, against {shown(b.mean(), 'deg')} of {other}"
    return banded(difference, "deg", len(a), words, NO, high=0)


@of_surveys
def grows(by_noise: list[Surveys], scenario: str, asked: bool) -> Judged:
    """Whether the error grows with noise beyond chance is as ``asked``."""
    (slope,) = by_noise[0].enough(_growth(by_noise, scenario))
    mean = by_noise[0].mean(slope)
    words = f"error grows by {span(mean, 'deg', signed=True)} per noise scale"
    band = {"across": NO, "low": 0} if asked else {"across": YES, "high": 0}
    return banded(mean, "deg", len(slope), words, **band)


def _growth(by_noise: list[Surveys], scenario: str) -> pd.Series:
    """Slope of the error over the noise scale, deg, by seed. Raises `TooLittle`."""
    scale = np.array([surveys.setting.noise_scale for surveys in by_noise])
    if len(scale) < LEAST_SCALES:
        raise TooLittle(
            f"{len(scale)} noise scale of {by_noise[0].setting.name}, {LEAST_SCALES} are needed"
        )
    errors = pd.concat([surveys.error(scenario) for surveys in by_noise], axis=1)
    return errors @ (scale - scale.mean()) / np.square(scale - scale.mean()).sum()


@of_surveys
def coverage(surveys: Surveys, scenario: str) -> Judged:
    """Share of 95 % intervals, one an angle, that hold the truth: yes unless it is below 95 %
    beyond chance. A survey's three angles count as one sample."""
    error = pd.concat(_errors(surveys, scenario), axis=1, keys=ANGLES)
    sigma = pd.concat(_errors(surveys, scenario, SIGMA), axis=1, keys=ANGLES)
    held = (error.abs() <= TWO_SIDED * sigma).astype(float).where(error.notna() & sigma.notna())
    (held,) = surveys.enough(held.mean(axis=1, skipna=False))
    whole = pd.Series(np.arange(len(held)) < round(held.sum()))  # as many surveys as hold all
    share = surveys.share(whole)
    words = (
        f"{shown(held.mean(), 'share')} of {len(ANGLES) * len(held)} intervals hold the truth "
        f"({_percent(share)}), {shown(CONFIDENCE, 'share')} promised"
    )
    return banded(share, "1", len(held), words, YES, low=CONFIDENCE)


@of_surveys
def standardised(surveys: Surveys, scenario: str) -> Judged:
    """Mean squared error in units of the formal covariance, per angle: 1 if it is honest; yes
    unless it is above 1 beyond chance."""
    (nees,) = surveys.enough(surveys.of(scenario, "nees"))
    mean = surveys.mean(nees)
    times = shown(np.sqrt(mean.value), "1")
    words = f"{span(mean, '1')}, so errors are {times} times as large as the sigmas say"
    return banded(mean, "1", len(nees), words, YES, high=1)


@of_surveys
def near_bound(surveys: Surveys, scenario: str, allowed: float) -> Judged:
    """RMS error of the angle that fares worst, over the Cramer-Rao bound on the same points: yes
    unless it is above ``allowed`` beyond chance."""
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
    return banded(spread, "1", len(squares), words, YES, high=allowed)


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
def largest(surveys: Surveys, *quantities: Quantity) -> pd.Series:
    """The largest of several quantities of a survey."""
    each = [quantity(surveys) for quantity in quantities]
    return pd.concat(each, axis=1).max(axis=1, skipna=False)


def critical_ks(samples: str) -> Quantity:
    """KS distance that normal samples stay under in 95 % of cases, so many as the metric counts:
    points of one view of a face share one trajectory error, so a view is a sample, no point is."""
    return lambda surveys: LILLIEFORS / np.sqrt(surveys.of("all", samples))


@of_surveys
def centred(surveys: Surveys, scenario: str) -> pd.Series:
    """Mean distance to the true planes in units of what trajectory errors alone make of it: the
    RMS over surveys of the mean under the true mounting."""
    honest = np.sqrt((surveys.of("truth", "mean_truth") ** 2).mean())
    return surveys.of(scenario, "mean_truth").abs() / honest


def over_floor(scenario: str) -> Quantity:
    """RMSE against true planes over that under the true mounting."""
    return lambda surveys: surveys.of(scenario, "rmse_truth") / surveys.of("truth", "rmse_truth")


def without_screening(scenario: str) -> Quantity:
    """Error with one wrong match, deg; endless where no solution was found."""
    return lambda surveys: _spoiled(surveys, scenario + WRONG)


def _spoiled(surveys: Surveys, name: str) -> pd.Series:
    failed = surveys.failed(name) & ~surveys.failed("all" + WRONG)
    try:
        error = surveys.error(name)
    except TooLittle:
        error = pd.Series(np.nan, failed.index)
    return error.mask(failed, np.inf)


# What is true of a survey or not, as `always` asks: 1, 0, or missing where it was not measured


@of_surveys
def at_most(surveys: Surveys, scenario: str, name: str, limit: float) -> pd.Series:
    """A metric is so small."""
    return _true(surveys.of(scenario, name) <= limit, surveys.of(scenario, name))


def completes(scenario: str) -> Quantity:
    """The scenario gives a result."""
    return lambda surveys: (~surveys.failed(scenario)).astype(float)


@of_surveys
def not_deceived(surveys: Surveys, scenario: str) -> pd.Series:
    """The histogram does not look normal while the boresight error exceeds its own 95 % region."""
    normal = surveys.of(scenario, "ks_reference") < critical_ks("views")(surveys)
    nees = surveys.of(scenario, "nees")
    beyond = len(ANGLES) * nees > stats.chi2.ppf(CONFIDENCE, len(ANGLES))
    return _true(~(normal & beyond), nees)


@of_surveys
def within_specification(surveys: Surveys, scenario: str) -> pd.Series:
    """All three angles within the attitude accuracy of the GNSS/INS."""
    limits = [ATTITUDE_ACCURACY[angle].value for angle in ANGLES]
    return _all_within(_errors(surveys, scenario), limits)


def lever_arm_found(surveys: Surveys) -> pd.Series:
    """Scenario D finds the forward and right parts of the lever arm better than half of its prior
    sigma; the down part is not asked."""
    errors = [surveys.of(LEVER_ARM, f"error_{axis}") for axis in AXES[:2]]
    return _all_within(errors, [PRIOR_SIGMA / 2] * 2)


@of_surveys
def unharmed(surveys: Surveys, scenario: str, screened: bool) -> pd.Series:
    """One wrong match adds less to the error than it typically is without."""
    clean = surveys.error(scenario)
    added = _spoiled(surveys, scenario + (SCREENED if screened else WRONG)) - clean
    return _true(added < np.sqrt((clean**2).mean()), added)


def _all_within(errors: list[pd.Series], limits: list[float]) -> pd.Series:
    inside = [e.abs() <= limit for e, limit in zip(errors, limits, strict=True)]
    return _true(pd.concat(inside, axis=1).all(axis=1), errors[0])


def _true(mask: pd.Series, measured: pd.Series) -> pd.Series:
    return mask.astype(float).where(measured.notna())
