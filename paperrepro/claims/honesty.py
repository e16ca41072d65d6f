"""Judges of what a method says of itself: sigmas, histograms, wrong matches."""

import numpy as np
import pandas as pd
from scipy import stats

from paperrepro.adjustment.lever_arm import AXES, PRIOR_SIGMA
from paperrepro.claims.evidence import CONFIDENCE, SIGMA, TWO_SIDED, Surveys, TooLittle
from paperrepro.claims.judges import Quantity
from paperrepro.claims.verdicts import NO, YES, Judge, Judged, shown, span
from paperrepro.published import ATTITUDE_ACCURACY
from paperrepro.study import LEVER_ARM, SCREENED, WRONG
from paperrepro.study_rows import BOUND
from paperrepro.tables import ANGLES

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
