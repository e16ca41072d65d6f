"""What the rows of a study say, survey by survey, and how sure that is.

Everything is compared over seeds: a survey is one independent sample, its thousands of points are
not. Intervals are bootstrapped over surveys, or exact for shares of surveys.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pandas as pd
from scipy import stats

from paperrepro.frames import ANGLES
from paperrepro.method.accuracy import rmse
from paperrepro.method.adjustment.calibrate import SCENARIO_NAMES
from paperrepro.study.rows import ADJUSTED, ARTEFACT, BOUND, COLUMNS, FAILED, FEW, SPECIFIED

#: Fewer surveys of a setting than this support no verdict, nor do fewer that gave a result.
LEAST_SEEDS, LEAST_RESULTS = 20, 15
#: Confidence of all intervals of one claim together.
CONFIDENCE = 0.95
#: Half the width of such an interval, in sigma.
TWO_SIDED = float(stats.norm.ppf(0.5 + CONFIDENCE / 2))
#: Before a metric's name: its formal sigma.
SIGMA = "sigma of "
_RESAMPLES = 4000
#: Of values (..., seeds, ...), over the seeds' axis: called with ``axis``.
Statistic = Callable[..., np.ndarray]


class TooLittle(Exception):
    """The rows do not hold what a rule needs; the text says what is missing."""


@dataclass(frozen=True)
class Interval:
    """A measured value and what it could as well be."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, order=True)
class Setting:
    """What the surveys that are compared have in common."""

    preset: str
    noise_scale: float
    profile: str

    def __str__(self) -> str:
        return f"{self.name} × {self.noise_scale:g}"

    @property
    def name(self) -> str:
        """Without the noise."""
        return self.preset if self.profile == "quick" else f"{self.preset} ({self.profile})"


class Surveys:
    """The surveys of one setting; each quantity a series by seed.

    ``confidence`` is that of an interval, so chosen that all settings of a claim hold together.
    """

    def __init__(self, setting: Setting, values: pd.DataFrame, confidence: float):
        self.setting = setting
        self.confidence = confidence
        self._values = values

    def __len__(self) -> int:
        return len(self._values)

    def of(self, scenario: str, metric: str) -> pd.Series:
        """One metric. Raises `TooLittle` where no row has it."""
        if (scenario, metric) not in self._values:
            raise TooLittle(f"no row of {metric} for {scenario}, {self.setting}")
        return self._values[scenario, metric]

    def error(self, scenario: str) -> pd.Series:
        """Size of the boresight error over all three angles, deg."""
        return np.sqrt(sum(self.of(scenario, f"error_{angle}") ** 2 for angle in ANGLES))

    def left(self, scenario: str, metric: str) -> pd.Series:
        """Share of a metric before calibration that a scenario leaves."""
        return self.of(scenario, metric) / self.of("before", metric)

    def failed(self, scenario: str) -> pd.Series:
        """Whether a scenario could not be calibrated, of the surveys that were measured."""
        marks = [(scenario, FAILED), ("all", FAILED)]
        seen = [self._values[mark].notna() for mark in marks if mark in self._values]
        return sum(seen, pd.Series(False, self._values.index)).astype(bool)

    def enough(self, *series: pd.Series) -> list[pd.Series]:
        """The surveys that have every one of ``series``, without the others. Raises `TooLittle`
        under `LEAST_RESULTS`."""
        kept = pd.concat(series, axis=1, keys=range(len(series))).dropna()
        if len(kept) < LEAST_RESULTS:
            raise TooLittle(
                f"{len(kept)} of {len(self)} surveys of {self.setting} have a value, at least "
                f"{LEAST_RESULTS} are needed"
            )
        return [kept[number] for number in kept]

    def mean(self, series: pd.Series) -> Interval:
        return bootstrap(series.to_numpy(), self.confidence)

    def resampled(self, values: np.ndarray, statistic: Statistic) -> Interval:
        """``statistic`` of ``values`` (seeds, ...) with its bootstrap interval."""
        return bootstrap(values, self.confidence, statistic)

    def share(self, mask: pd.Series) -> Interval:
        return binomial(int(mask.sum()), len(mask), self.confidence)

    def mean_share(self, shares: pd.Series) -> Interval:
        """Mean of a share of each survey, bootstrapped by survey; where all are equal, which a
        bootstrap takes for certain, as so many whole surveys."""
        if shares.nunique() > 1:
            return self.mean(shares)
        return binomial(round(shares.sum()), len(shares), self.confidence)


class Evidence:
    """The rows of a study by setting, those of surveys with ``errors`` of one kind."""

    def __init__(self, rows: pd.DataFrame, errors: str = SPECIFIED):
        self._rows, self._errors = rows, errors
        self._others, self._surveys = {}, {}
        rows = rows[(rows.artefact == ARTEFACT) & (rows.errors == errors)]
        sigmas = rows.dropna(subset="sigma")
        sigmas = sigmas.assign(metric=SIGMA + sigmas.metric, value=sigmas.sigma)
        self._values = pd.concat([rows, sigmas]).pivot_table(
            index=["preset", "noise_scale", "profile", "seed"],
            columns=["scenario", "metric"], values="value", aggfunc="last",
        )  # fmt: skip

    def under(self, errors: str) -> "Evidence":
        """The same study's surveys with errors of another kind."""
        if errors == self._errors:
            return self
        if errors not in self._others:
            self._others[errors] = Evidence(self._rows, errors)
        return self._others[errors]

    def settings(self, preset: str | None = None) -> list[Setting]:
        """Settings with enough surveys: by preset, the paper's own noise first, then the least.

        Raises `TooLittle` where there is none.
        """
        size = self._values.groupby(level=[0, 1, 2]).size() if len(self._values) else pd.Series()
        size = size[[preset in (None, key[0]) for key in size.index]]
        known = [Setting(*key) for key in size[size >= LEAST_SEEDS].index]
        if not known:
            most = int(size.max()) if len(size) else 0
            of = f" of preset {preset}" if preset else ""
            raise TooLittle(f"at most {most} surveys{of} in a setting, {LEAST_SEEDS} are needed")
        dense = {s: s.profile != "quick" for s in known}
        return sorted(known, key=lambda s: (s.preset, dense[s], s.noise_scale != 1, s.noise_scale))

    def surveys(self, setting: Setting, judged_together: int = 1) -> "Surveys":
        """The surveys of one of so many settings that are judged together."""
        if setting not in self._surveys:
            key = (setting.preset, setting.noise_scale, setting.profile)
            self._surveys[setting] = self._values.loc[key].dropna(axis=1, how="all")
        confidence = 1 - (1 - CONFIDENCE) / judged_together
        return Surveys(setting, self._surveys[setting], confidence)


def median_survey(rows: pd.DataFrame, scenario: str, metric: str, preset: str = "mount") -> int:
    """Seed of the quick survey at the specified noise whose ``metric`` of ``scenario`` is the
    median: what a figure of a single survey shows. Raises `TooLittle` where no row has it."""
    at = (rows.errors == SPECIFIED) & (rows.noise_scale == 1) & (rows.profile == "quick")
    of = (rows.preset == preset) & (rows.scenario == scenario) & (rows.metric == metric)
    found = rows[at & of].drop_duplicates("seed").sort_values(["value", "seed"])
    if found.empty:
        raise TooLittle(f"no row of {metric} for {scenario}, {preset} × 1")
    return int(found.seed.iloc[(len(found) - 1) // 2])


def nine_in_ten(
    rows: pd.DataFrame, metric: str, preset: str, noise_scale: float, ending: str = ""
) -> dict[str, tuple[float, float]]:
    """What nine in ten quick surveys of a setting span in a metric, by estimator as the paper calls
    it, with few points a face; ``ending`` of the scenarios' names."""
    rows = rows[(rows.errors == SPECIFIED) & (rows.preset == preset) & (rows.profile == "quick")]
    rows = rows[(rows.metric == metric) & (rows.noise_scale == noise_scale)]
    if rows.empty:
        return {}
    called = {f"{name}{ending}": x for x, name in FEW.items()} | {
        name: name for name in ("before", "D", ADJUSTED)
    }
    spans = rows.groupby("scenario").value.quantile([0.05, 0.95]).unstack()
    return {called[name]: tuple(span) for name, *span in spans.itertuples() if name in called}


def bootstrap(
    values: np.ndarray,
    confidence: float = CONFIDENCE,
    statistic: Statistic = np.mean,
) -> Interval:
    """``statistic`` of ``values`` (seeds, ...), their mean by default, and its percentile interval
    over resampled seeds."""
    draws = _draws(len(values))
    outside = (1 - confidence) / 2
    low, high = np.quantile(statistic(values[draws], axis=1), [outside, 1 - outside])
    return Interval(float(statistic(values, axis=0)), float(low), float(high))


@lru_cache
def _draws(size: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, size, (_RESAMPLES, size))


def binomial(hits: int, tries: int, confidence: float = CONFIDENCE) -> Interval:
    """A share and its exact (Clopper-Pearson) interval."""
    span = stats.binomtest(hits, tries).proportion_ci(confidence)
    return Interval(hits / tries, float(span.low), float(span.high))


_SETTING = ["preset", "profile", "noise_scale"]


def promises(
    rows: pd.DataFrame, scenarios: tuple[str, ...], errors: str = SPECIFIED
) -> pd.DataFrame:
    """A line for each setting, scenario and angle of the ``rows`` of a study.

    Columns: preset, profile, noise_scale, scenario, angle; ``surveys``; ``rms_deg`` of the error;
    ``sigma_deg``, the RMS of the formal sigma; ``bound_deg``, that of the Cramer-Rao bound on the
    same points, and ``over_bound``, the error's RMS over it; ``coverage`` of the 95 % intervals;
    ``nees``, the mean squared error in the unit of the full covariance of all three angles, over
    their number.
    """
    rows = rows[(rows.artefact == ARTEFACT) & (rows.errors == errors)]
    nees = _of_metric(rows, "nees").groupby([*_SETTING, "scenario"]).value.mean()
    lines = []
    for angle in ANGLES:
        errors = _of_metric(rows, f"error_{angle}").dropna(subset="sigma")
        bound = _of_metric(rows[rows.scenario == BOUND], f"bound_{angle}")
        bound = bound.set_index([*_SETTING, "seed"]).value.rename("bound")
        errors = errors.join(bound, on=[*_SETTING, "seed"])
        for key, group in errors.groupby([*_SETTING, "scenario"]):
            if key[-1] in scenarios:
                lines.append([*key, angle, *_promise(group), nees.get(key, np.nan)])
    names = ["surveys", "rms_deg", "sigma_deg", "bound_deg", "over_bound", "coverage", "nees"]
    table = pd.DataFrame(lines, columns=[*_SETTING, "scenario", "angle", *names])
    table["scenario"] = pd.Categorical(table.scenario, scenarios, ordered=True)
    return table.sort_values([*_SETTING, "scenario"], kind="stable", ignore_index=True)


def promises_by_kind(rows: pd.DataFrame, scenarios: tuple[str, ...]) -> pd.DataFrame:
    """`promises` for each kind of errors in ``rows``, in column ``errors``, over the three angles:
    RMS of the error in all of them, mean coverage."""
    parts = []
    for kind in rows.errors.unique():
        table = promises(rows, scenarios, kind).assign(errors=kind, squared=lambda t: t.rms_deg**2)
        keys = ["errors", *_SETTING, "scenario"]
        grouped = table.groupby(keys, observed=True, sort=False)
        one = grouped.agg(
            surveys=("surveys", "min"), squared=("squared", "sum"), coverage=("coverage", "mean"),
            least_coverage=("coverage", "min"), nees=("nees", "first"),
        )  # fmt: skip
        one["rms_deg"] = np.sqrt(one.pop("squared"))
        parts.append(one.reset_index())
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


def against_points(
    rows: pd.DataFrame, points: Mapping[str, Sequence[tuple[str, float | None]]]
) -> pd.DataFrame:
    """What sigma, error and honesty are for each number of points a face, at the specified noise.

    ``points`` of each estimator: the names of its variants with their points a face, None for all,
    which stands at their mean number. Columns scenario, points, surveys; over the three angles the
    RMS of the error, ``rms_deg``, and of the formal sigma, ``sigma_deg``; ``coverage`` and
    ``nees``, each with its bootstrap interval by survey, ``_low`` and ``_high``.
    """
    try:
        evidence = Evidence(rows)
        surveys = evidence.surveys(evidence.settings("mount")[0])
        all_points = (surveys.of("all", "points") / surveys.of("all", "views")).mean()
    except TooLittle:
        return pd.DataFrame()
    lines = []
    for scenario, variants in points.items():
        for name, number in variants:
            try:
                lines.append([scenario, number if number is not None else all_points,
                              *_honesty(surveys, name)])  # fmt: skip
            except TooLittle:
                continue
    spans = [f"{name}{end}" for name in ("coverage", "nees") for end in ("", "_low", "_high")]
    return pd.DataFrame(
        lines, columns=["scenario", "points", "surveys", "rms_deg", "sigma_deg", *spans]
    )


def _honesty(surveys: Surveys, name: str) -> list[float]:
    series = [surveys.of(name, f"{of}error_{a}") for of in ("", SIGMA) for a in ANGLES]
    *known, nees = surveys.enough(*series, surveys.of(name, "nees"))
    error, sigma = np.split(np.column_stack(known), 2, axis=1)
    held = surveys.mean_share(pd.Series((np.abs(error) <= TWO_SIDED * sigma).mean(axis=1)))
    sizes = [np.sqrt((values**2).sum(axis=1).mean()) for values in (error, sigma)]
    mean = surveys.mean(nees)
    return [len(nees), *sizes, held.value, held.low, held.high, mean.value, mean.low, mean.high]


def _of_metric(rows: pd.DataFrame, metric: str) -> pd.DataFrame:
    return rows[rows.metric == metric]


def _promise(group: pd.DataFrame) -> list[float]:
    known = group.dropna(subset="bound")
    bound = rmse(known.bound)
    held = group.value.abs() <= TWO_SIDED * group.sigma
    over = rmse(known.value) / bound if len(known) else np.nan
    return [len(group), rmse(group.value), rmse(group.sigma), bound, over, held.mean()]


#: What the surveys that are averaged have in common beside the noise; and what a sweep varies more.
SETTING = ["preset", "profile"]
TRUTH = "truth"
OFFSETS = {"offset_reference": "offset_mean_reference", "offset_truth": "offset_mean_truth"}
_MEASURED = ["error_deg", "sigma_deg", "held", *OFFSETS, "beats_sl"]


def survey_table(rows: pd.DataFrame, reading: Mapping[str, str] | None = None) -> pd.DataFrame:
    """One line for each survey and scenario: setting, noise_scale, seed, scenario, by ``reading``
    that of a variant;

    error_deg and sigma_deg, the boresight error and its formal sigma over all three angles; held,
    the share of the angles whose 95 % interval holds the truth; offset_reference and offset_truth,
    the mean absolute vertical offset at the virtual points (m); beats_sl, 1 where the error is
    smaller than that of SL, [11], in the same survey, else 0.
    """
    reading = {name: name for name in (*SCENARIO_NAMES, TRUTH)} | dict(reading or {})
    called = {name: x for x, name in reading.items()}
    rows = rows[(rows.artefact == ARTEFACT) & rows.scenario.isin(called)]
    rows = rows.assign(scenario=rows.scenario.map(called))
    setting = SETTING + [name for name in rows if name not in COLUMNS]
    parts = [
        _of_setting(part).assign(**dict(zip(setting, key, strict=True)))
        for key, part in rows.groupby(setting)
    ]
    names = [*setting, "noise_scale", "seed", "scenario", *_MEASURED]
    return pd.concat(parts, ignore_index=True)[names] if parts else pd.DataFrame(columns=names)


def _of_setting(rows: pd.DataFrame) -> pd.DataFrame:
    keys = ["noise_scale", "seed", "scenario"]
    values = rows.pivot_table(index=keys, columns="metric", values="value")
    angles = rows[rows.metric.isin([f"error_{a}" for a in ANGLES]) & (rows.scenario != TRUTH)]
    squares = angles.assign(error_deg=angles.value**2, sigma_deg=angles.sigma**2).groupby(keys)
    sizes = np.sqrt(squares[["error_deg", "sigma_deg"]].sum(min_count=len(ANGLES)))
    table = sizes.reindex(values.index)
    for name, metric in OFFSETS.items():
        table[name] = values.get(metric, np.nan)
    angles = angles.dropna(subset="sigma")
    held = angles.assign(value=angles.value.abs() <= TWO_SIDED * angles.sigma)
    table["held"] = held.groupby(keys).value.mean()
    others = table.error_deg.unstack().reindex(columns=SCENARIO_NAMES)
    of_sl = others.pop("SL")
    beats = others.lt(of_sl, axis=0).where(others.notna().mul(of_sl.notna(), axis=0))
    table["beats_sl"] = beats.stack().astype(float)
    return table.reset_index()


def curve_table(
    surveys: pd.DataFrame, columns: dict[str, Callable[[np.ndarray], Interval]]
) -> pd.DataFrame:
    """Over the seeds of each setting, noise and scenario: setting, noise_scale, scenario, quantity,
    surveys, value, low, high. ``columns`` of a `survey_table` with what makes an interval of one,
    `of_mean` or `of_share`."""
    lines = []
    names = [name for name in surveys if name not in _MEASURED and name != "seed"]
    for key, part in surveys.groupby(names):
        for column, interval in columns.items():
            values = part[column].dropna().to_numpy()
            if len(values):
                span = interval(values)
                lines.append([*key, column, len(values), span.value, span.low, span.high])
    return pd.DataFrame(lines, columns=[*names, "quantity", "surveys", "value", "low", "high"])


def of_mean(values: np.ndarray) -> Interval:
    """Mean with its 95 % bootstrap interval over surveys; of one survey no interval is known."""
    return bootstrap(values) if len(values) > 1 else Interval(float(values[0]), np.nan, np.nan)


def of_share(values: np.ndarray) -> Interval:
    """Mean share with the exact 95 % interval of as many whole surveys: the three angles of one
    survey are one sample."""
    span = binomial(round(values.sum()), len(values))
    return Interval(float(values.mean()), span.low, span.high)
