"""What no ray can tell, tested on how well the strips agree: a turn about the spin axis.

A wrong sign of roll leaves every ray of a scanner that spins about the body's forward axis on its
beam, and the file's coordinates as they are. But the boresight then turns in a body that leans the
wrong way, so after calibration the strips miss each other by the boresight times the roll.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from paperrepro.errors import BadInput, PaperReproError
from paperrepro.flight import ray_test
from paperrepro.flight.hypotheses import ATTITUDES, Hypothesis
from paperrepro.method.adjustment import scenarios
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.method.georeference import georeference
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Survey

#: Twice the logarithm of a likelihood ratio from which a hypothesis is taken for right, each view
#: beyond the first of its plane an independent sample; under the right reading a wrong one makes it
#: negative.
EVIDENCE = 9.0
#: Points of a view that are looked at together: the noise of ranges averages out, the roll stays.
TOGETHER = 25
#: Elevations that scatter by more than this, rad, are no plane's: the beams go anywhere.
ANYWHERE = np.radians(2.0)
#: Noise further above its specification than this is no noise: a factor, and sigma0.
PLAUSIBLE_FACTOR, PLAUSIBLE_SIGMA0 = 3.0, 2.0


@dataclass(frozen=True)
class _Poses:
    """What a hypothesis on the attitude changes: ``attitude`` (N, 3) rad of the rays."""

    attitude: np.ndarray

    def with_attitude(self, attitude: np.ndarray) -> "_Poses":
        return _Poses(attitude)


def require_agreement(survey: Survey, tie_planes: TiePlanes, trajectory: str) -> None:
    """Raise `BadInput` where ``tie_planes`` lie together far better under a mistake of the
    ``trajectory`` that the rays do not show."""
    plain = _disagreement(survey, tie_planes)
    if plain is None:
        return
    found = [(_disagreement(survey, turned), h) for h, turned in _unseen(survey, tie_planes)]
    found = [(rms, hypothesis) for rms, hypothesis in found if rms is not None]
    if not found:
        return
    rms, hypothesis = min(found, key=lambda one: one[0])
    beyond = len(tie_planes.ranges) - tie_planes.n_planes - 3
    if 2 * beyond * np.log(plain / rms) > EVIDENCE:
        raise BadInput(
            f"{trajectory}: {hypothesis.what}: so the strips would agree to {100 * rms:.1f} cm, as "
            f"given they do to {100 * plain:.1f} cm, though the rays fit either way; "
            f"{hypothesis.remedy}"
        )


def _unseen(survey: Survey, tie_planes: TiePlanes) -> Iterator[tuple[Hypothesis, TiePlanes]]:
    """Hypotheses under which the rays still fit, and the tie planes under each."""
    rays, mounting = tie_planes.rays, survey.mounting
    p_m = georeference(rays, mounting)
    elevation = ray_test.laser_rays(rays.pose, p_m, mounting)[1]
    anywhere = not len(survey.scanner.beam_elevations) and np.std(elevation) > ANYWHERE
    for hypothesis in ATTITUDES:
        attitude = hypothesis.change(_Poses(rays.pose[:, 3:])).attitude
        pose = np.column_stack([rays.pose[:, :3], attitude])
        azimuth, turned, rho = ray_test.laser_rays(pose, p_m, mounting)
        if anywhere or np.median(np.abs(turned - elevation)) <= ray_test.FITS:
            own = turned if anywhere else rays.elevation
            changed = replace(rays, pose=pose, azimuth=azimuth, elevation=own, rho=rho)
            yield hypothesis, replace(tie_planes, rays=changed)


def _disagreement(survey: Survey, tie_planes: TiePlanes) -> float | None:
    """RMS m of the tie planes' points about their planes under the best boresight, the range noise
    averaged over `TOGETHER` points of a view; None if there is no boresight."""
    try:
        result = scenarios.calibrate(survey, tie_planes, "SL without offsets")
    except (PaperReproError, np.linalg.LinAlgError):
        return None
    first = [np.arange(a, b, TOGETHER) for a, b in tie_planes.ranges]
    edges = np.concatenate(first)
    counts = np.diff(np.r_[edges, len(tie_planes.rays)])
    means = np.add.reduceat(result.residuals(tie_planes), edges) / counts
    return float(np.sqrt(np.average(np.square(means), weights=counts)))


def implausible(result: CalibrationResult) -> list[str]:
    """A remark on noise that is too large to be noise: a systematic error hides in it."""
    warning = (
        "a systematic error may hide in it, and the boresight may be off by more than its sigma: "
        "check signs and units of the trajectory, the mounting and the time system"
    )
    factors = result.components or {}
    large = [
        f"{name.replace('_', ', ')} {factors[name]:.1f} times"
        for name in ("range", "horizontal", "height", "roll_pitch", "heading")
        if factors.get(name, 1.0) > PLAUSIBLE_FACTOR
    ]
    if large:
        return [f"Noise came out far above its specification ({', '.join(large)}): {warning}."]
    if result.scenario == "D" and result.sigma0 > PLAUSIBLE_SIGMA0:
        return [f"The misfits are {result.sigma0:.1f} times what the noise explains: {warning}."]
    return []
