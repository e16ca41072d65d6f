"""Whether the data contradict the model under which a calibration's sigma hold.

A residual that no unknown explains is taken for noise, and a noise that is not as told moves sigma
in silence. Each check compares one number with what it is under the model, and says what to do.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from paperrepro.method.adjustment.observability import AXIS_WORDS
from paperrepro.method.adjustment.result import CalibrationResult
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
#: Seconds between which the trajectory's error may step, and the largest change in this time in
#: units of their RMS: of Gauss-Markov processes it was 3 to 5.5, of steps 8 to 18.
STEP_TIME, STEPS = 0.5, 6.5
#: A component counts where the data leave less than this share of its sigma; so many moments do.
SEEN, LEAST_MOMENTS = 0.6, 50
#: RMS of the beams' errors in the scanner's angle_sigma; range offsets in their prior sigma.
BEAMS, OFFSETS = 1.3, 5.0
#: Difference between D and SL in D's sigma: SL's own errors are about twice as large.
SCENARIOS = 5.0
#: Least points of a view whose residuals count.
LEAST_POINTS = 10


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
    result: CalibrationResult, survey: Survey, sl: np.ndarray | None = None
) -> tuple[Check, ...]:
    """All checks of scenario D's ``result`` that apply.

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
        *_steps(result),
        *_components(result),
        *_beams(result, survey),
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
            f"The laser's times are {1e3 * abs(delay):.2f} ± {1e3 * sigma:.2f} ms "
            f"{'late' if delay < 0 else 'early'} against the trajectory's: the boresight is "
            "adjusted for it; correct the strips' times.",
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


def _steps(result: CalibrationResult) -> Iterator[Check]:
    """The largest change of the trajectory's error within half a second, among its like."""
    found = result.trajectory
    later = np.searchsorted(found.time, found.time + STEP_TIME - 1e-6)
    later[later == len(found.time)] = 0
    pairs = np.flatnonzero(np.abs(found.time[later] - found.time - STEP_TIME) < 1e-3)
    change = np.abs(found.correction[later[pairs]] - found.correction[pairs])
    seen = found.sigma[pairs] < SEEN * found.prior_sigma
    values = [
        moments.max() / np.sqrt(np.square(moments).mean())
        for moments in (column[where] for column, where in zip(change.T, seen.T, strict=True))
        if len(moments) > LEAST_MOMENTS and moments.max() > 0
    ]
    if values:
        value = float(max(values))
        yield Check(
            "steps", value, 0.0, STEPS,
            f"The trajectory's error changes within half a second by {value:.1f} times the RMS of "
            "such changes: it steps. Look for lost satellites or other fixes in its processing.",
        )  # fmt: skip


def _components(result: CalibrationResult) -> Iterator[Check]:
    found = result.components or {}
    for name in (key[:-5] for key in found if key.endswith("_fast")):
        words = name.replace("_", " and ")
        yield Check(
            f"fast_{name}", found[f"{name}_fast"], 0.0, FAST,
            f"Errors of {words} that last about a second have {found[f'{name}_fast']:.2f} of the "
            "specified sigma: look for vibration that the GNSS/INS does not report, or faces that "
            "are no planes.",
        )  # fmt: skip
        yield Check(
            f"specified_{name}", found[name], BELOW, np.inf,
            f"The trajectory's {words} is taken for {1 / found[name]:.1f} times better than "
            "specified, as this flight shows it: sigma rests on that, and on what may be constant.",
        )  # fmt: skip


def _beams(result: CalibrationResult, survey: Survey) -> Iterator[Check]:
    rms = 0.0 if result.beams is None else result.beams.rms
    yield Check(
        "beams", float(np.degrees(rms)), 0.0, float(np.degrees(BEAMS * survey.scanner.angle_sigma)),
        f"Elevations and azimuths of the beams are off by {np.degrees(rms):.3f}° RMS: the "
        "boresight is adjusted for it; give the scanner's own beam table.",
    )  # fmt: skip


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
