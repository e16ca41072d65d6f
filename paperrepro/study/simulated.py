"""Simulated surveys, what the method finds in them, and what of that is true.

The one room that knows both simulator and method: what is measured of a survey are tidy rows, which
the sweeps and the ledger of claims read.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property

import numpy as np

from data_synth import SimulationConfig, Truth, make_config, simulate
from data_synth.evaluation import ViewTruth, judge_views, true_planes
from data_synth.navigation import ATTITUDE_SIGMA, CORRELATION_TIME, POSITION_SIGMA
from paperrepro._cache import cached
from paperrepro.errors import BadInput, PaperReproError
from paperrepro.frames import ANGLES, boresight_matrix
from paperrepro.method import refine_all
from paperrepro.method.accuracy import (
    Distribution,
    ReferencePlanes,
    point_to_plane,
    reference_planes,
    reference_roofs,
    rmse,
    vertical_offsets,
    virtual_points,
)
from paperrepro.method.adjustment.calibrate import PAPER_SCENARIOS, SCENARIO_NAMES, calibrate
from paperrepro.method.adjustment.model_checks import model_checks
from paperrepro.method.adjustment.quality import TrueNoise, cramer_rao_bound
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.adjustment.trajectory_equations import AXES, GaussMarkov
from paperrepro.method.adjustment.trajectory_errors import few_planes, find_noise
from paperrepro.method.coarse_to_fine import (
    Candidates,
    PlaneSurvey,
    find_candidates,
    find_planes,
    find_roofs,
)
from paperrepro.method.georeference import georeference
from paperrepro.study.gross_error import with_wrong_match
from paperrepro.study.rows import (
    ARTEFACT,
    BOUND,
    ERRORS,
    FAILED,
    FOUND,
    LEVER_ARM,
    REFINED,
    SCREENED,
    SPECIFIED,
    WRONG,
    SurveyKey,
    mistaken_name,
)
from paperrepro.survey import Mounting, Rays, Survey

#: Density falls from the track outwards; this quantile of the square metres is near the track.
CREST = 0.9
#: By how much the lever arm is wrong that scenario D is told and asked for, m, b-frame.
WRONG_LEVER_ARM = np.array([0.03, -0.03, 0.03])
#: Factors by which scenario D is told a wrong specification of the GNSS/INS.
MISTAKEN = (0.5, 2.0)


@dataclass(frozen=True)
class SimulatedSurvey:
    """A simulated survey with its truth, and its roofs, found when they are first asked for.

    Parameters
    ----------
    config : SimulationConfig
        What is flown, with what errors.
    kept : bool
        Whether simulation and roofs are kept in the cache folder.
    errors : str
        Name of their kind, `ERRORS`.
    """

    config: SimulationConfig
    kept: bool = False
    errors: str = SPECIFIED

    @classmethod
    def of(cls, key: SurveyKey) -> "SimulatedSurvey":
        """The survey that rows of ``key`` speak of. Raises `BadInput`."""
        return cls(config_of(key), errors=key.errors)

    @property
    def key(self) -> SurveyKey:
        """What rows of this survey are named by."""
        c = self.config
        return SurveyKey(c.preset, c.profile, c.noise_scale, c.seed, self.errors)

    @property
    def survey(self) -> Survey:
        """What the operator has."""
        return self._simulated[0]

    @property
    def truth(self) -> Truth:
        """What nobody has: poses, mounting, faces, and the face of each point."""
        return self._simulated[1]

    @cached_property
    def points(self) -> Candidates:
        """Points that may lie on a roof."""
        return self._stage(find_candidates, self.survey)

    @cached_property
    def found(self) -> PlaneSurvey:
        """Roofs of all strips, matched; where there is no building, planes of any kind."""
        if self.truth.faces:
            return self._stage(find_roofs, self.survey, self.points)
        return self._stage(find_planes, self.survey)

    @cached_property
    def views(self) -> ViewTruth:
        """The true face of each matched one."""
        return judge_views(self.survey, self.truth, self.found.views)

    @property
    def true_planes(self) -> np.ndarray:
        """(G, 4) n and d, m-frame, m, of each tie plane; NaN where it is no gable face."""
        tie_planes = self.found.tie_planes
        first = np.searchsorted(tie_planes.plane, np.arange(tie_planes.n_planes))
        return true_planes(self.truth, self.views.label[first])

    @property
    def noise(self) -> TrueNoise | None:
        """What disturbs the survey, as the Cramer-Rao bound needs it; None where it is of another
        kind than specified."""
        if self.errors != SPECIFIED:
            return None
        sigma = self.config.noise_scale * np.concatenate([POSITION_SIGMA, ATTITUDE_SIGMA])
        process = GaussMarkov(sigma, np.full(6, CORRELATION_TIME))
        return TrueNoise(process, self.config.range_offset_sigma_m)

    @cached_property
    def _simulated(self) -> tuple[Survey, Truth]:
        return self._stage(simulate, self.config)

    def _stage(self, function: Callable, *arguments):
        return cached(function, *arguments) if self.kept else function(*arguments)


@dataclass(frozen=True)
class Measured:
    """What is measured of a survey beside the calibration by all scenarios.

    Parameters
    ----------
    refined : bool
        The refinement of the paper's scenarios.
    wrong : bool
        Their answer to a wrong match.
    accuracy : bool
        Distances and vertical offsets of all points under every mounting.
    lever_arm : bool
        The lever arm by scenario D.
    mistaken : tuple of float
        Factors by which the specification is wrong that scenario D is told, variance components
        being estimated.
    found : bool
        Scenario D under the noise that it finds in the data, as `calibrate_flight` runs it, and the
        checks of its model that do not pass.
    """

    refined: bool = True
    wrong: bool = True
    accuracy: bool = True
    lever_arm: bool = True
    mistaken: tuple[float, ...] = ()
    found: bool = False


def config_of(key: SurveyKey) -> SimulationConfig:
    """What is simulated for ``key``. Raises `BadInput`."""
    if key.errors not in ERRORS:
        raise BadInput(f"errors {key.errors!r}: expected one of {', '.join(ERRORS)}; name one")
    chosen = asdict(key)
    return make_config(**ERRORS[chosen.pop("errors")], **chosen)


#: Boresight and sigma alone.
ANGLES_ONLY = Measured(refined=False, wrong=False, accuracy=False, lever_arm=False)


def planned(
    seeds: int, coverage_seeds: int, noise_scales: Sequence[float], presets: Sequence[str],
    profile: str, errors: Sequence[str] = (SPECIFIED,),
) -> dict[SurveyKey, Measured]:  # fmt: skip
    """Surveys of a study and what is measured of each: everything of the first ``seeds``; of the
    further ones up to ``coverage_seeds``, of the first preset alone, boresight and sigma. At the
    specified noise scenario D is then told a wrong specification, too. Of ``errors`` of another
    kind than specified, boresight and sigma alone. At the specified noise of the first preset D is
    also run as `calibrate_flight` runs it.

    Raises `BadInput` where there is no survey, or one that cannot be simulated.
    """
    if max(seeds, coverage_seeds) < 1:
        raise BadInput(f"seeds: expected at least 1, got {seeds}; give a number of surveys")
    surveys = {}
    for seed in range(1, max(seeds, coverage_seeds) + 1):
        for preset in presets if seed <= seeds else presets[:1]:
            for noise_scale in noise_scales:
                what = Measured() if seed <= seeds else ANGLES_ONLY
                if preset == presets[0] and noise_scale == 1 and coverage_seeds:
                    what = replace(what, mistaken=MISTAKEN)
                for kind in errors:
                    key = SurveyKey(preset, profile, noise_scale, seed, kind)
                    config_of(key)  # refuses, before anything runs
                    of_kind = what if kind == SPECIFIED else ANGLES_ONLY
                    found = preset == presets[0] and noise_scale == 1
                    surveys[key] = replace(of_kind, found=found)
    return surveys


def measure(
    flown: SimulatedSurvey,
    scenarios: Sequence[str] = SCENARIO_NAMES,
    what: Measured = Measured(),
) -> list[dict]:
    """Rows of one survey: calibrated by every scenario from its own segmentation and matching.

    Parameters
    ----------
    flown : SimulatedSurvey
        The survey.
    scenarios : sequence of str
        Estimators: SL, A, B, C, D. One that does not succeed is a row of metric ``failed``.
    what : Measured
        What else is measured.

    Returns
    -------
    list of dict
        Tidy rows, columns `paperrepro.study.rows.COLUMNS`; angles in degrees, lengths in metres.

    Raises
    ------
    PaperReproError
        Where no roofs can be found or matched.
    """
    survey, tie_planes = flown.survey, flown.found.tie_planes
    rows = _Rows(flown.key, flown.truth.boresight)
    _add_survey(rows, flown)
    if flown.truth.faces:
        _add_matching(rows, flown)
    rows.add_errors("before", survey.mounting.boresight - rows.boresight)
    results = {name: rows.calibrated(name, survey, tie_planes, name) for name in scenarios}
    results = {name: result for name, result in results.items() if result}
    mountings = {"before": survey.mounting, "truth": flown.truth.mounting}
    mountings |= {name: result.calibrated for name, result in results.items()}
    if what.refined:
        mountings |= _add_refined(rows, flown, results)
    for factor in what.mistaken:
        _add_mistaken(rows, flown, factor)
    if what.found:
        _add_found(rows, flown, results.get("SL"))
    if flown.noise is not None:
        bound = cramer_rao_bound(survey, tie_planes, flown.truth.mounting, flown.noise)
        for angle, sigma in zip(ANGLES, np.rad2deg(np.sqrt(np.diag(bound))), strict=True):
            rows.add(BOUND, f"bound_{angle}", sigma, "deg")
    if what.lever_arm:
        _add_lever_arm(rows, flown)
    if what.wrong:
        _add_wrong_match(rows, flown, scenarios)
    if what.accuracy:
        _add_accuracy(rows, flown, mountings)
    return rows.made


@dataclass
class _Rows:
    """Rows in the making, of a survey whose true ``boresight`` (3,) rad is known."""

    key: SurveyKey
    boresight: np.ndarray
    made: list[dict] = field(default_factory=list)

    def add(self, scenario: str, metric: str, value: float, unit="1", sigma=np.nan) -> None:
        self.made.append(self.key.row(ARTEFACT, scenario, metric, unit, value, sigma))

    def add_errors(self, name: str, error: np.ndarray, sigma=(np.nan,) * 3) -> None:
        """Of the angles, (3,) rad."""
        for angle, *pair in zip(ANGLES, np.rad2deg(error), np.rad2deg(sigma), strict=True):
            self.add(name, f"error_{angle}", pair[0], "deg", pair[1])

    def attempt(self, name: str, function: Callable, *args, **options):
        """What ``function`` gives and a row of its time, or None and a row that it failed."""
        start = time.process_time()
        try:
            result = function(*args, **options)
        except PaperReproError:
            self.add(name, FAILED, 1)
            return None
        self.add(name, "seconds", time.process_time() - start, "s")
        return result

    def add_result(self, name: str, result: CalibrationResult) -> CalibrationResult:
        """Errors with their sigma; the squared standardised error per angle."""
        error = result.boresight - self.boresight
        self.add_errors(name, error, result.sigma)
        self.add(name, "nees", error @ np.linalg.solve(result.covariance[:3, :3], error) / 3)
        self.add(name, "sigma0", result.sigma0)
        self.add(name, "iterations", result.iterations)
        return result

    def calibrated(self, name: str, *args, **options) -> CalibrationResult | None:
        """Rows of `calibrate` with these arguments."""
        result = self.attempt(name, calibrate, *args, **options)
        return self.add_result(name, result) if result else None


def _add_survey(rows: _Rows, flown: SimulatedSurvey) -> None:
    """Density of a strip with all its pulses, mean and below the track; displacement of its
    points, on average, where the true boresight is put in by the small-angle form I + [w]x instead
    of the rotation."""
    survey, mounting = flown.survey, flown.truth.mounting
    w, rays = mounting.boresight, survey.rays(survey.strips[0])
    places = np.floor(georeference(rays, mounting)[:, :2])  # cells of 1 m by 1 m
    counts = flown.config.thinning * np.unique(places, axis=0, return_counts=True)[1]
    skew = np.cross(np.eye(3), w)
    wrong_by = boresight_matrix(w, np.eye(3)) - np.eye(3) - skew
    r_b = _in_laser_frame(rays) @ mounting.R_nominal.T
    shift = np.linalg.norm(r_b @ wrong_by.T, axis=1).mean()
    rows.add("all", "density", counts.mean(), "1/m2")
    rows.add("all", "density_below", np.quantile(counts, CREST), "1/m2")
    rows.add("all", "small_angle_shift", shift, "m")


def _in_laser_frame(rays: Rays) -> np.ndarray:
    """(N, 3) m, l-frame, of the measured ranges."""
    flat, up = rays.rho * np.cos(rays.elevation), rays.rho * np.sin(rays.elevation)
    return np.column_stack(
        [flat * np.cos(rays.azimuth), flat * np.sin(rays.azimuth), up]
    )  # Eq. (2)


def _add_matching(rows: _Rows, flown: SimulatedSurvey) -> None:
    tie_planes, label = flown.found.tie_planes, flown.views.label
    one, other = label[tie_planes.pairs].T
    rows.add("all", "planes", tie_planes.n_planes)
    rows.add("all", "pairs", len(one))
    rows.add("all", "views", len(label))
    rows.add("all", "points", len(tie_planes.rays))
    rows.add("all", "false_pairs", ((one != other) | (one < 0)).sum())
    rows.add("all", "rejected", len(flown.found.rejected))


def _add_refined(rows: _Rows, flown: SimulatedSurvey, results) -> dict[str, Mounting]:
    """The paper's scenarios after their refinement; their mountings by name."""
    mountings = {}
    for name in (name for name in results if name in PAPER_SCENARIOS):
        result, ours = results[name], name + REFINED
        again = rows.attempt(ours, refine_all, flown.survey, flown.points, {name: result})
        if again is not None:
            rows.add_result(ours, again[name])
            mountings[ours] = result.calibrated.with_calibration(
                again[name].boresight, result.range_offsets
            )
    return mountings


def _add_found(rows: _Rows, flown: SimulatedSurvey, sl: CalibrationResult | None) -> None:
    """Scenario D as `calibrate_flight` runs it, and what contradicts its model."""
    survey = flown.survey
    result = rows.attempt(FOUND, _under_found_noise, survey, flown.found)
    if result:
        rows.add_result(FOUND, result)
        kept = result.adjusted(flown.found.tie_planes)
        checks = model_checks(result, survey, kept, sl and sl.boresight)
        for check in checks:
            rows.add(FOUND, f"check_{check.name}", not check.passed)
        rows.add(FOUND, "contradicted", not all(check.passed for check in checks))


def _under_found_noise(survey: Survey, found: PlaneSurvey) -> CalibrationResult:
    few = few_planes(found.tie_planes, survey.mounting)
    noise = find_noise(survey, few, found.agreed)
    return calibrate(survey, found.tie_planes, "D", found=noise)


def _add_mistaken(rows: _Rows, flown: SimulatedSurvey, factor: float) -> None:
    """Scenario D told a GNSS/INS specification that is wrong by ``factor``."""
    told, name = flown.survey.navigation, mistaken_name(factor)
    told = replace(
        told,
        position_sigma=factor * told.position_sigma,
        attitude_sigma=factor * told.attitude_sigma,
    )
    survey = replace(flown.survey, navigation=told)
    result = rows.attempt(name, _under_found_noise, survey, flown.found)
    if result:
        rows.add_result(name, result)
    for group, value in result.components.items() if result else ():
        rows.add(name, f"component_{group}", value)


def _add_lever_arm(rows: _Rows, flown: SimulatedSurvey) -> None:
    """Scenario D told a lever arm that is wrong, and asked for it."""
    mounting = flown.survey.mounting
    told = replace(mounting, lever_arm=mounting.lever_arm + WRONG_LEVER_ARM)
    survey = replace(flown.survey, mounting=told)
    result = rows.calibrated(LEVER_ARM, survey, flown.found.tie_planes, "D", lever_arm=True)
    if result:
        error = result.lever_arm.value - flown.truth.mounting.lever_arm
        for axis, *pair in zip(AXES, error, result.lever_arm.sigma, strict=True):
            rows.add(LEVER_ARM, f"error_{axis}", pair[0], "m", pair[1])


def _add_wrong_match(rows: _Rows, flown: SimulatedSurvey, scenarios: Sequence[str]) -> None:
    """Errors with one wrong match: taken as it is, and screened."""
    found = flown.found
    tie_planes = rows.attempt("all" + WRONG, with_wrong_match, found.tie_planes, found.mounting)
    for name in scenarios if tie_planes is not None else ():
        for ending, robust in {WRONG: False, SCREENED: True}.items():
            if name in PAPER_SCENARIOS:
                rows.calibrated(name + ending, flown.survey, tie_planes, name, robust)


def _add_accuracy(rows: _Rows, flown: SimulatedSurvey, mountings: dict[str, Mounting]) -> None:
    """RMSE, distributions and vertical offsets of every mounting, by truth and by the reference."""
    found = flown.found
    reference = reference_planes(found, reference_roofs(flown.survey.reference))
    references = {"truth": ReferencePlanes(flown.true_planes), "reference": reference}
    for name, mounting in mountings.items():
        corners = virtual_points(found, mounting)
        for against, reference in references.items():
            distances = point_to_plane(found.tie_planes, mounting, reference)
            offsets = vertical_offsets(corners, reference)
            for metric, unit, value in _accuracy(distances, offsets):
                rows.add(name, f"{metric}_{against}", value, unit)


def _accuracy(distances: np.ndarray, offsets: np.ndarray) -> Iterator[tuple[str, str, float]]:
    """Metric, unit and value of distances (N,) m and vertical offsets (K,) m."""
    shape = Distribution.of(distances)
    offsets = np.abs(offsets[np.isfinite(offsets)])
    yield "rmse", "m", rmse(distances)
    yield "mae", "m", np.abs(distances).mean()
    yield "mean", "m", shape.mean
    yield "nmad", "m", shape.nmad
    yield "skewness", "1", shape.skewness
    yield "kurtosis", "1", shape.kurtosis
    yield "ks", "1", shape.ks
    yield "offset_mean", "m", offsets.mean()
    yield "offset_max", "m", offsets.max()
