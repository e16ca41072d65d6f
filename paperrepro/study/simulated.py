"""Simulated surveys, what the method finds in them, and what of that is true.

The one room that knows both simulator and method: what is measured of a survey are tidy rows, which
the sweeps and the ledger of claims read.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property

import numpy as np

from data_synth import SimulationConfig, Truth, make_config, simulate
from data_synth.evaluation import ViewTruth, judge_views, trajectory_error, true_planes
from data_synth.navigation import ATTITUDE_SIGMA, CORRELATION_TIME, POSITION_SIGMA
from paperrepro._cache import cached
from paperrepro.errors import BadInput
from paperrepro.frames import ANGLES, BODY_AXES, boresight_matrix
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
from paperrepro.method.adjustment.calibrate import SCENARIO_NAMES, calibrate
from paperrepro.method.adjustment.model_checks import model_checks
from paperrepro.method.adjustment.quality import TrueNoise, cramer_rao_bound
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.adjustment.trajectory_equations import GaussMarkov
from paperrepro.method.adjustment.trajectory_errors import NODE_SPACING, find_noise
from paperrepro.method.coarse_to_fine import (
    Candidates,
    PlaneSurvey,
    RoofSearch,
    find_candidates,
    find_planes,
    find_roofs,
    planes_under,
)
from paperrepro.method.georeference import georeference
from paperrepro.study.rows import (
    ADJUSTED,
    BETWEEN,
    BOUND,
    CENTROIDS,
    ERRORS,
    FEW,
    FOUND,
    LEVER_ARM,
    MANY,
    SEGMENTATION,
    SPECIFIED,
    TRUTH,
    WITHOUT_OFFSETS,
    SurveyKey,
    mistaken_name,
)
from paperrepro.study.variants import (
    SurveyRows,
    add_few_planes,
    add_first_steps,
    add_refined,
    add_wrong_match,
)
from paperrepro.survey import Mounting, Rays, Survey

#: Density falls from the track outwards; this quantile of the square metres is near the track.
CREST = 0.9
#: By how much the lever arm is wrong that scenario D is told and asked for, m, b-frame.
WRONG_LEVER_ARM = np.array([0.03, -0.03, 0.03])
#: What every survey is calibrated by; and what of it is refined.
ESTIMATORS = tuple(
    dict.fromkeys([*SCENARIO_NAMES, *FEW.values(), *MANY.values(), CENTROIDS, WITHOUT_OFFSETS])
)
TO_REFINE = tuple(each for reading in (FEW, MANY) for x, each in reading.items() if x != "SL")
#: Of all points and poses one in so many is measured against the truth.
EVERY = 10
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
    """What is measured of a survey beside the calibration by `ESTIMATORS`.

    Parameters
    ----------
    refined : bool
        The refinement of the paper's scenarios, in its variants, and what it needs of planes.
    wrong : bool
        Their answer to a wrong match, the first step towards their solution, and to few planes.
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
    variants : bool
        All of `ESTIMATORS`, else those that the figures name and those that claims are judged by.
    between : bool
        The estimators with the numbers of points a face that lie `BETWEEN`.
    """

    refined: bool = True
    wrong: bool = True
    accuracy: bool = True
    lever_arm: bool = True
    mistaken: tuple[float, ...] = ()
    found: bool = False
    variants: bool = True
    between: bool = False


def config_of(key: SurveyKey) -> SimulationConfig:
    """What is simulated for ``key``. Raises `BadInput`."""
    if key.errors not in ERRORS:
        raise BadInput(f"errors {key.errors!r}: expected one of {', '.join(ERRORS)}; name one")
    chosen = asdict(key)
    return make_config(**ERRORS[chosen.pop("errors")], **chosen)


#: Boresight and sigma alone.
ANGLES_ONLY = Measured(refined=False, wrong=False, accuracy=False, lever_arm=False)
#: Of a survey at full density, which costs ten times as much.
OF_DENSE = Measured(wrong=False, lever_arm=False, variants=False)


def planned(
    seeds: int, coverage_seeds: int, noise_scales: Sequence[float], presets: Sequence[str],
    profile: str, errors: Sequence[str] = (SPECIFIED,),
) -> dict[SurveyKey, Measured]:  # fmt: skip
    """Surveys of a study and what is measured of each: everything of the first ``seeds``; of the
    further ones up to ``coverage_seeds``, of the first preset alone, boresight and sigma. At the
    specified noise scenario D is then told a wrong specification, too. Of ``errors`` of another
    kind than specified, boresight and sigma alone. At the specified noise of the first preset D is
    also run as `calibrate_flight` runs it, and sigma is looked at against points a face. At full
    density less is measured, `OF_DENSE`.

    Raises `BadInput` where there is no survey, or one that cannot be simulated.
    """
    if max(seeds, coverage_seeds) < 1:
        raise BadInput(f"seeds: expected at least 1, got {seeds}; give a number of surveys")
    surveys = {}
    for seed in range(1, max(seeds, coverage_seeds) + 1):
        for preset in presets if seed <= seeds else presets[:1]:
            for noise_scale in noise_scales:
                for kind in errors:
                    key = SurveyKey(preset, profile, noise_scale, seed, kind)
                    config_of(key)  # refuses, before anything runs
                    at_home = preset == presets[0] and noise_scale == 1
                    surveys[key] = _of(key, seed <= seeds, at_home, at_home and coverage_seeds > 0)
    return surveys


def _of(key: SurveyKey, whole: bool, at_home: bool, mistaken: bool) -> Measured:
    """What is measured of a survey; ``at_home``: it has the noise that claims ask about first."""
    if key.profile != "quick":
        return OF_DENSE if whole else replace(ANGLES_ONLY, variants=False)
    if key.errors != SPECIFIED:
        return replace(ANGLES_ONLY, variants=False, found=at_home)
    what = replace(Measured() if whole else ANGLES_ONLY, found=at_home, between=at_home)
    return replace(what, mistaken=MISTAKEN) if mistaken else what


def measure(
    flown: SimulatedSurvey,
    what: Measured = Measured(),
) -> list[dict]:
    """Rows of one survey: calibrated by every estimator from its own segmentation and matching.

    Parameters
    ----------
    flown : SimulatedSurvey
        The survey.
    what : Measured
        What is measured beside the calibration by `ESTIMATORS`. One that does not succeed is a row
        of metric ``failed``.

    Returns
    -------
    list of dict
        Tidy rows, columns `paperrepro.study.rows.COLUMNS`; angles in degrees, lengths in metres.

    Raises
    ------
    PaperReproError
        Where no roofs can be found or matched.
    """
    survey, start = flown.survey, time.process_time()
    tie_planes = flown.found.tie_planes
    rows = SurveyRows(flown.key, flown.truth.boresight)
    if not flown.kept:  # else they may have been found before
        rows.add(SEGMENTATION, "seconds", time.process_time() - start, "s")
    _add_survey(rows, flown)
    if flown.truth.faces:
        _add_matching(rows, flown)
    rows.add_errors("before", survey.mounting.boresight - rows.boresight)
    plain = (*SCENARIO_NAMES, *FEW.values())
    estimators = ESTIMATORS if what.variants else tuple(dict.fromkeys(plain))
    estimators += BETWEEN * what.between
    results = {name: rows.calibrated(name, survey, tie_planes, name) for name in estimators}
    results = {name: result for name, result in results.items() if result}
    mountings = {"before": survey.mounting, "truth": flown.truth.mounting}
    mountings |= {name: result.calibrated for name, result in results.items()}
    if what.refined:
        names = TO_REFINE if what.variants else [FEW[x] for x in "ABC"]
        mountings |= add_refined(rows, flown, results, names)
    for factor in what.mistaken:
        _add_mistaken(rows, flown, factor)
    if what.found:
        _add_found(rows, flown)
    if flown.noise is not None:
        bound = cramer_rao_bound(survey, tie_planes, flown.truth.mounting, flown.noise)
        for angle, sigma in zip(ANGLES, np.rad2deg(np.sqrt(np.diag(bound))), strict=True):
            rows.add(BOUND, f"bound_{angle}", sigma, "deg")
    if what.lever_arm:
        _add_lever_arm(rows, flown)
    if what.wrong:
        add_wrong_match(rows, flown)
        add_first_steps(rows, flown)
        add_few_planes(rows, flown)
    if what.accuracy:
        _add_accuracy(rows, flown, mountings, results.get("D"))
    return rows.made


def _add_survey(rows: SurveyRows, flown: SimulatedSurvey) -> None:
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


def _add_matching(rows: SurveyRows, flown: SimulatedSurvey) -> None:
    tie_planes, label = flown.found.tie_planes, flown.views.label
    one, other = label[tie_planes.pairs].T
    rows.add("all", "planes", tie_planes.n_planes)
    rows.add("all", "pairs", len(one))
    rows.add("all", "views", len(label))
    rows.add("all", "points", len(tie_planes.rays))
    rows.add("all", "false_pairs", ((one != other) | (one < 0)).sum())
    rows.add("all", "rejected", len(flown.found.rejected))
    rows.add("all", "false_views", (label < 0).sum())
    # the first pass, under the mounting to start from
    first = planes_under(flown.survey, flown.points, flown.survey.mounting, RoofSearch().coarse())
    label = judge_views(flown.survey, flown.truth, first.views).label
    one, other = label[first.tie_planes.pairs].T
    rows.add("before", "pairs", len(first.pairs))
    rows.add("before", "false_pairs", ((one != other) | (one < 0)).sum())
    rows.add("before", "rejected", len(first.rejected))


def _add_found(rows: SurveyRows, flown: SimulatedSurvey) -> None:
    """Scenario D as `calibrate_flight` runs it, and what contradicts its model."""
    survey = flown.survey
    result = rows.attempt(FOUND, _under_found_noise, survey, flown.found)
    if result:
        rows.add_result(FOUND, result)
        checks = model_checks(result, survey, flown.found.boresights[-1])
        for check in checks:
            rows.add(FOUND, f"check_{check.name}", not check.passed)
        rows.add(FOUND, "contradicted", not all(check.passed for check in checks))
        _add_adjusted(rows, flown, result)


def _add_adjusted(rows: SurveyRows, flown: SimulatedSurvey, result: CalibrationResult) -> None:
    """3D RMS error of all points under the true mounting and the trajectory as reported, under D's
    mounting, and under its trajectory, too; and how often the correction of the trajectory lies
    within its 95 % interval, where points were adjusted and in gaps."""
    survey, truth, errors = flown.survey, flown.truth, result.trajectory
    squares = {TRUTH: [], FOUND: [], ADJUSTED: []}
    for strip in survey.strips:
        rays = survey.rays(strip, np.arange(0, len(strip), EVERY))
        pose = truth.trajectory.at(rays.time - truth.scanner_errors.clock_delay)
        p_m = georeference(replace(rays, pose=pose), truth.mounting)
        adjusted = errors.apply(rays)
        for name, sight, mounting in (
            (TRUTH, rays, truth.mounting), (FOUND, rays, result.calibrated),
            (ADJUSTED, adjusted, result.calibrated),
        ):  # fmt: skip
            off = georeference(sight, mounting) - p_m
            squares[name].append(np.square(off).sum(axis=1))
    for name, of_strips in squares.items():
        rows.add(name, "rms_3d", np.sqrt(np.concatenate(of_strips).mean()), "m")
    time = survey.trajectory.time[::EVERY]
    correction, sigma = errors.at(time - errors.delay)
    missed = correction + trajectory_error(survey, truth)[::EVERY]
    covered = np.abs(missed) < 1.96 * sigma
    after = np.clip(np.searchsorted(errors.time, time), 1, len(errors.time) - 1)
    away = np.minimum(np.abs(errors.time[after] - time), np.abs(time - errors.time[after - 1]))
    seen = away <= NODE_SPACING
    for where, times in (("observed", seen), ("gaps", ~seen)):
        if times.any():
            rows.add(ADJUSTED, f"covered_{where}", covered[times].mean())


def _under_found_noise(survey: Survey, found: PlaneSurvey) -> CalibrationResult:
    noise = find_noise(survey, found.tie_planes, found.agreed)
    return calibrate(survey, found.tie_planes, "D", found=noise)


def _add_mistaken(rows: SurveyRows, flown: SimulatedSurvey, factor: float) -> None:
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


def _add_lever_arm(rows: SurveyRows, flown: SimulatedSurvey) -> None:
    """Scenario D told a lever arm that is wrong, and asked for it."""
    mounting = flown.survey.mounting
    told = replace(mounting, lever_arm=mounting.lever_arm + WRONG_LEVER_ARM)
    survey = replace(flown.survey, mounting=told)
    result = rows.calibrated(LEVER_ARM, survey, flown.found.tie_planes, "D", lever_arm=True)
    if result:
        error = result.lever_arm.value - flown.truth.mounting.lever_arm
        for axis, *pair in zip(BODY_AXES, error, result.lever_arm.sigma, strict=True):
            rows.add(LEVER_ARM, f"error_{axis}", pair[0], "m", pair[1])


def _add_accuracy(
    rows: SurveyRows, flown: SimulatedSurvey, mountings: dict[str, Mounting],
    of_d: CalibrationResult | None,
) -> None:  # fmt: skip
    """RMSE, distributions and vertical offsets of every mounting, by truth and by the reference;
    and of D's with its trajectory."""
    found = flown.found
    reference = reference_planes(found, reference_roofs(flown.survey.reference))
    references = {"truth": ReferencePlanes(flown.true_planes), "reference": reference}
    cases = [(name, mounting, found) for name, mounting in mountings.items()]
    if of_d is not None:
        rays = of_d.trajectory.apply(found.tie_planes.rays)
        adjusted = replace(found, tie_planes=replace(found.tie_planes, rays=rays))
        cases.append((ADJUSTED, of_d.calibrated, adjusted))
    for name, mounting, seen in cases:
        corners = virtual_points(seen, mounting)
        for against, reference in references.items():
            distances = point_to_plane(seen.tie_planes, mounting, reference)
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
    yield "skewness", "1", shape.skewness
    yield "kurtosis", "1", shape.kurtosis
    yield "ks", "1", shape.ks
    yield "offset_mean", "m", offsets.mean()
    yield "offset_max", "m", offsets.max()
