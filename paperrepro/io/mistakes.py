"""Mistakes that the rays can name: under which of them would the points fit the beams?"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from paperrepro.errors import BadInput
from paperrepro.io import rays
from paperrepro.io.mounting import MountingFile
from paperrepro.io.place import FOOT
from paperrepro.io.rays import Sample
from paperrepro.survey import Mounting

ROLL, PITCH, HEADING = 3, 4, 5


@dataclass(frozen=True)
class Mistake:
    """``change`` makes poses (N, 6) and a mounting what they would be without the mistake;
    ``where``: trajectory or mounting; ``what`` is wrong; the ``remedy``."""

    where: str
    what: str
    remedy: str
    change: Callable[[np.ndarray, Mounting], tuple[np.ndarray, Mounting]]


def _pose(column: int, change) -> Callable:
    def changed(pose, mounting):
        pose = pose.copy()
        pose[:, column] = change(pose[:, column])
        return pose, mounting

    return changed


def _swapped(pose, mounting):
    return pose[:, [0, 1, 2, PITCH, ROLL, HEADING]], mounting


def _degrees(pose, mounting):
    return np.column_stack([pose[:, :3], np.radians(pose[:, 3:])]), mounting


def _lever(sign) -> Callable:
    return lambda pose, mounting: (
        pose,
        replace(mounting, lever_arm=np.asarray(mounting.lever_arm) * sign),
    )


def _transposed(pose, mounting):
    return pose, replace(mounting, R_nominal=mounting.R_nominal.T)


MISTAKES = (
    Mistake(
        "trajectory",
        "the heading is counted counter-clockwise from east (ENU)",
        "give it clockwise from north",
        _pose(HEADING, lambda angle: np.pi / 2 - angle),
    ),
    Mistake(
        "trajectory",
        "the heading is counted counter-clockwise from north",
        "give it clockwise from north",
        _pose(HEADING, np.negative),
    ),
    Mistake(
        "trajectory",
        "the heading is counted clockwise from south",
        "add 180 degrees to it",
        _pose(HEADING, lambda angle: angle + np.pi),
    ),
    Mistake(
        "trajectory",
        "the heading is in degrees",
        "give radians",
        _pose(HEADING, np.radians),
    ),
    Mistake("trajectory", "the attitude is in degrees", "give radians", _degrees),
    Mistake(
        "trajectory",
        "the pitch is counted nose down",
        "turn its sign: nose up is positive",
        _pose(PITCH, np.negative),
    ),
    Mistake("trajectory", "roll and pitch are interchanged", "interchange them", _swapped),
    Mistake(
        "mounting",
        "the rotation is transposed (b to l)",
        "give l to b: rows are body forward, right, down",
        _transposed,
    ),
    Mistake(
        "mounting",
        "the lever arm points from the laser to the GNSS/INS",
        "turn its signs",
        _lever(np.array([-1.0, -1.0, -1.0])),
    ),
    Mistake(
        "mounting",
        "the lever arm stands in forward, left, up",
        "give it forward, right, down",
        _lever(np.array([1.0, -1.0, -1.0])),
    ),
)


def refuse(pose: np.ndarray, sample: Sample, given: MountingFile, files) -> None:
    """Raise `BadInput` that names the mistake under which the rays would fit, if one is found."""
    for where, what, remedy, scatter in _explanations(pose, sample, given):
        raise BadInput(
            f"{getattr(files, where)}: {what}: so the rays to the points would fit the beams to "
            f"{np.degrees(scatter):.3f} deg, as given they do not; {remedy}"
        )


def _explanations(pose, sample: Sample, given: MountingFile) -> Iterator[tuple]:
    few = slice(None, None, max(1, len(pose) // 4000))
    pose, sample = pose[few], sample.take(few)
    for mistake in MISTAKES:
        turned = mistake.change(pose, given.mounting)
        found = rays.fit(turned[0], sample, turned[1])
        if not found.good:
            found = rays.best_height(turned[0], sample, turned[1])[1]
        if found.good:
            yield mistake.where, mistake.what, mistake.remedy, found.scatter
    metres = FOOT * (sample.p_m[:, 2] + sample.base) - sample.base
    found = rays.fit(
        pose, replace(sample, p_m=np.column_stack([sample.p_m[:, :2], metres])), given.mounting
    )
    if found.good:
        yield "strip", "its heights are in feet", "export them in metres", found.scatter
    beams = given.scanner.beam_elevations
    scatter = _scatter_without_rings(pose, sample, given.mounting, beams)
    if scatter <= rays.FITS:
        what = "the ring dimension does not hold the ring"
        yield "strip", what, "name the right one with --ring-dimension", scatter


def _scatter_without_rings(pose, sample: Sample, mounting: Mounting, beams) -> float:
    """Scatter rad of the elevations about the nearest beam, whatever the rings say."""
    _, elevation, _ = rays.laser_rays(pose, sample.p_m, mounting)
    nearest = np.abs(elevation[:, None] - beams).min(axis=1)
    return float(1.4826 * np.median(nearest))
