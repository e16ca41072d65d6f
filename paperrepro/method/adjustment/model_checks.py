"""Whether the data contradict the model under which a calibration's sigma hold.

A residual that no unknown explains is taken for noise, and a noise that is not as told moves sigma
in silence. Each check compares one number with what it is under the model, and says what to do.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from paperrepro.method.adjustment.observability import AXIS_WORDS
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.georeference import georeference
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Survey

#: Residuals, in units of what the scanner's specification says, between which it may be believed.
RESIDUALS = (0.67, 1.5)
#: Delay of the clock, s and in sigma, from which on it is one.
CLOCK = (3e-4, 3.0)
#: Expected squares of a component of the trajectory's error over its prior variance.
PROCESS = (0.5, 2.0)
#: Errors that last a second, as a share of the specified sigma: more is vibration, or a filter's.
FAST = 0.3
#: Factors on the specified sigma below which a boresight's sigma rests on the estimate of them.
BELOW = 0.5
#: RMS of the beams' elevation errors in their own sigma, of which 16 beams without one exceed this
#: in one of twenty flights. Range offsets in their prior sigma.
BEAMS, OFFSETS = 1.3, 5.0
#: Difference between D and SL in D's sigma: SL's own errors are about twice as large.
SCENARIOS = 5.0
#: Least points of a beam on a face, and views of it, that make its mean count.
LEAST_POINTS, LEAST_VIEWS = 5, 4


@dataclass(frozen=True)
class Check:
    """``value`` of a check ``name``, allowed between ``low`` and ``high``; the ``sentence`` says
    what it means where it is not, and what to do."""

    name: str
    value: float
    low: float
    high: float
    sentence: str

    @property
    def passed(self) -> bool:
        """True where the model is not contradicted."""
        return bool(self.low <= self.value <= self.high)


def model_checks(
    result: CalibrationResult, survey: Survey, tie_planes: TiePlanes, sl: np.ndarray | None = None
) -> tuple[Check, ...]:
    """All checks of scenario D's ``result`` that apply; ``tie_planes`` are those it used.

    Parameters
    ----------
    result : of scenario D; of others it says nothing, and no check applies.
    survey : with the specifications as given.
    sl : (3,) rad, the boresight of scenario SL from the same tie planes, if known.
    """
    if result.trajectory is None:
        return ()
    return (
        _residuals(result),
        *_clock(result),
        *_process(result),
        *_components(result),
        *_beams(result, survey, tie_planes),
        *_offsets(result, survey),
        *_against_sl(result, sl),
    )


def _residuals(result: CalibrationResult) -> Check:
    laser = 1.0 if result.components is None else result.components["range"]
    value = result.sigma0 * laser
    return Check(
        "residuals", value, *RESIDUALS,
        f"Residuals are {value:.2f} times what the scanner's specification says: correct its "
        "range_sigma in mounting.toml, or look for rough faces, a wrong beam table or a clock.",
    )  # fmt: skip


def _clock(result: CalibrationResult) -> Iterator[Check]:
    if result.clock is not None:
        delay, sigma = result.clock.delay, result.clock.sigma
        yield Check(
            "clock", abs(delay), 0.0, max(CLOCK[0], CLOCK[1] * sigma),
            f"The laser's times are {1e3 * delay:+.2f} ms ± {1e3 * sigma:.2f} ms off the "
            "trajectory's: the boresight is adjusted for it; correct the strips' times.",
        )  # fmt: skip


def _process(result: CalibrationResult) -> Iterator[Check]:
    found, names = result.trajectory, ("east", "north", "up", *AXIS_WORDS[:2], "heading")
    changing = found.correction - found.constant
    expected = np.square(changing).mean(axis=0) + np.square(found.sigma).mean(axis=0)
    for name, value in zip(names, expected / np.square(found.prior_sigma), strict=True):
        yield Check(
            f"process_{name}", float(value), *PROCESS,
            f"The trajectory's error in {name} has {value:.1f} times the variance that the "
            "adjustment was told: give an accuracy file, or [navigation] as the flight had it.",
        )  # fmt: skip


def _components(result: CalibrationResult) -> Iterator[Check]:
    found = result.components or {}
    for name in (key[:-5] for key in found if key.endswith("_fast")):
        words = name.replace("_", " and ")
        yield Check(
            f"fast_{name}", found[f"{name}_fast"], 0.0, FAST,
            f"Errors of {words} that last about a second have {found[f'{name}_fast']:.2f} of the "
            "specified sigma: look for vibration that the GNSS/INS does not report.",
        )  # fmt: skip
        yield Check(
            f"specified_{name}", found[name], BELOW, np.inf,
            f"The trajectory's {words} is taken for {1 / found[name]:.1f} times better than "
            "specified, as this flight shows it: sigma rests on that, and on what may be constant.",
        )  # fmt: skip


def _beams(result: CalibrationResult, survey: Survey, tie_planes: TiePlanes) -> Iterator[Check]:
    """Elevation error of each beam from the means of its points on each face: what is left of them
    once the face's own points are on their plane."""
    rays = result.trajectory.apply(tie_planes.rays)
    step = 1e-5
    p = georeference(rays, result.calibrated)
    higher = georeference(replace(rays, elevation=rays.elevation + step), result.calibrated)
    view = np.repeat(np.arange(len(tie_planes.ranges)), np.diff(tie_planes.ranges, axis=1)[:, 0])
    plane = result.planes[tie_planes.plane[view]]
    w = np.einsum("na,na->n", p, plane[:, :3]) - plane[:, 3]
    slope = np.einsum("na,na->n", higher - p, plane[:, :3]) / step
    for rows in (slice(*of_view) for of_view in tie_planes.ranges):
        about = p[rows] - p[rows].mean(axis=0)
        A = np.column_stack([np.ones(len(about)), about @ _in_plane(plane[rows.start, :3])])
        both = np.column_stack([w[rows], slope[rows]])
        w[rows], slope[rows] = (both - A @ np.linalg.lstsq(A, both, rcond=None)[0]).T
    n_rings = survey.scanner.n_rings
    cell = view * n_rings + rays.ring
    count = np.bincount(cell, minlength=len(tie_planes.ranges) * n_rings)
    used = count >= LEAST_POINTS
    means, slopes = (
        np.bincount(cell, v, minlength=len(count))[used] / count[used] for v in (w, slope)
    )
    ring, weight = np.arange(len(count))[used] % n_rings, count[used] / np.var(w)
    information = np.bincount(ring, weight * slopes**2, minlength=n_rings)
    error = np.bincount(ring, weight * slopes * means, minlength=n_rings)
    seen = (np.bincount(ring, minlength=n_rings) >= LEAST_VIEWS) & (information > 0)
    if seen.any():
        error = error[seen] / information[seen]
        value = float(np.sqrt(np.mean(error**2 * information[seen])))
        yield Check(
            "beams", value, 0.0, BEAMS,
            f"The beams' elevations look wrong by {np.degrees(np.sqrt(np.mean(error**2))):.3f}° "
            f"RMS, {value:.1f} times their noise: give the scanner's own beam table.",
        )  # fmt: skip


def _in_plane(normal: np.ndarray) -> np.ndarray:
    """(3, 2): two directions square to ``normal``."""
    return np.linalg.svd(normal[None])[2][1:].T


def _offsets(result: CalibrationResult, survey: Survey) -> Iterator[Check]:
    if result.range_offsets is not None:
        value = float(np.abs(result.range_offsets).max() / survey.scanner.range_offset_sigma)
        yield Check(
            "range_offsets", value, 0.0, OFFSETS,
            f"A beam's range offset is {value:.0f} times what the scanner's zero is known to: it "
            "stands for something else; do not use the offsets, and look at lever arm and beams.",
        )  # fmt: skip


def _against_sl(result: CalibrationResult, sl: np.ndarray | None) -> Iterator[Check]:
    if sl is not None:
        for axis, one, other, sigma in zip(
            AXIS_WORDS, result.boresight, sl, result.sigma, strict=True
        ):
            value = float(abs(one - other) / sigma)
            yield Check(
                f"scenarios_{axis}", value, 0.0, SCENARIOS,
                f"D and SL differ in {axis} by {np.degrees(abs(one - other)):.3f}°, {value:.1f} "
                "sigma: what surfaces and trajectory did is not told apart; fly crossing lines.",
            )  # fmt: skip
