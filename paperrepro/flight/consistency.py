"""What the rays say of a flight's files: accepted, put right with a word, or refused.

Put right, where the remedy is one number or a known convention and the rays then fit: heights above
the geoid, leap seconds, a heading against grid north or against the wander frame. Everything else
is refused, and the error names the mistake under which the rays would fit (`mistakes`).

Mistakes that the rays can name: under which of them would the points fit the beams?
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from paperrepro.errors import BadInput, OutsideTrajectory
from paperrepro.flight import mounting, ray_test
from paperrepro.flight.decoding import FOOT, UNKNOWN_RING
from paperrepro.flight.mounting import MountingFile
from paperrepro.flight.ray_test import Fit, Reading, Sample
from paperrepro.survey import Mounting, Scanner, Trajectory

#: UTC is behind GPS time by so much: since 2017, 2015, 2012, 2009, 2006.
LEAP_SECONDS = (18.0, 17.0, 16.0, 15.0, 14.0)
#: Scatter that is taken, with a word: coordinates from another solution of the trajectory.
TOLERATED = float(np.radians(0.15))
#: Medians further than this from the table, rad, are the unit's own elevations.
SAME_BEAM = float(np.radians(0.005))
#: A scatter below this, rad, is not looked at further.
SCATTER_SEEN = float(np.radians(0.002))


@dataclass(frozen=True)
class Files:
    """Names for messages: the first ``strip``, the ``trajectory``, the ``mounting``."""

    strip: str
    trajectory: str
    mounting: str


def settle(
    sample: Sample, trajectories: Mapping[str, Trajectory], given: MountingFile, files: Files
) -> tuple[Reading, list[str]]:
    """How the points are to be read, and a word on each correction.

    ``trajectories``: under the empty name as its format has it, else under what its heading may
    mean. Raises `OutsideTrajectory`, `BadInput`.
    """
    plain = ray_test.try_reading(sample, trajectories[""], given.mounting)
    if plain is not None and plain.fit.good:
        others = {word: ray_test.try_reading(sample, path, given.mounting)
                  for word, path in trajectories.items() if word}  # fmt: skip
        word = _much_better(plain.fit, {name: reading.fit for name, reading in others.items()})
        return (others[word], _notes(word, others[word])) if word else (plain, [])
    corrected = _corrected(sample, trajectories, given)
    if corrected is not None:
        return corrected
    if plain is None:
        _refuse_uncovered(sample, trajectories[""], files)
    pose, part = ray_test.poses_of(sample, trajectories[""])
    refuse(pose, part, given, files)
    if plain.fit.scatter <= TOLERATED:
        return plain, [_tolerated(plain, files)]
    raise BadInput(
        f"{files.trajectory}: the rays to the points of {files.strip} and others do not fit: "
        f"within a beam the elevations scatter by {np.degrees(plain.fit.scatter):.2f} deg, "
        f"expected {np.degrees(plain.fit.limit):.2f}; give the trajectory and the mounting with "
        "which the coordinates were computed"
    )


def settle_poses(
    fits: Mapping[str, Fit], given: MountingFile, files: Files
) -> tuple[str, Reading, list[str]]:
    """How the attitude of points with poses of their own is to be read, of ``fits`` by name.

    Raises `BadInput` where the rays fit under none.
    """
    word = min(fits, key=lambda name: fits[name].scatter)
    if fits[""].good and not _much_better(fits[""], fits):
        word = ""
    found = fits[word]
    if found.scatter > max(found.limit, TOLERATED):
        raise BadInput(
            f"{files.strip}: the rays do not fit: within a beam the elevations scatter by "
            f"{np.degrees(found.scatter):.2f} deg, expected {np.degrees(found.limit):.2f}; give "
            f"the rotation and the lever arm with which the points were computed ({files.mounting})"
        )
    reading = Reading(None, given.mounting, 0.0, 0.0, found)
    return word, reading, _notes(word, reading)


def _much_better(plain: Fit, others: Mapping[str, Fit]) -> str:
    """The name of a fit that halves the plain one's scatter where this is no matter of resolution;
    else the empty name."""
    best = min(others, key=lambda name: others[name].scatter)
    clear = plain.scatter > SCATTER_SEEN and others[best].scatter < 0.5 * plain.scatter
    return best if clear else ""


def _tolerated(reading: Reading, files: Files) -> str:
    return (
        f"{files.trajectory}: within a beam the elevations scatter by "
        f"{np.degrees(reading.fit.scatter):.3f} deg, expected {np.degrees(reading.fit.limit):.3f}; "
        "the coordinates seem computed from another solution of the trajectory"
    )


def _corrected(sample: Sample, trajectories, given: MountingFile):
    """The reading with fewest corrections that fits, and its notes; or None."""
    shifts = (0.0, *LEAP_SECONDS, *(-s for s in LEAP_SECONDS))
    tried = [
        (word, ray_test.try_reading(sample, path, given.mounting, shift))
        for (word, path), shift in product(trajectories.items(), shifts)
    ]
    tried = [(word, reading) for word, reading in tried if reading is not None]
    good = [(word, reading) for word, reading in tried if reading.fit.good]
    if not good:
        few = sample.few()
        raised = [(word, reading, ray_test.with_height(reading, few)) for word, reading in tried]
        good = [
            (word, ray_test.with_height(reading, sample))
            for word, reading, tentative in raised
            if tentative.fit.good
        ]
        good = [(word, reading) for word, reading in good if reading.fit.good]
    if not good:
        return None
    word, best = min(good, key=lambda one: (bool(one[0]) + bool(one[1].time_shift),
                                            one[1].fit.scatter))  # fmt: skip
    return best, _notes(word, best)


def _notes(word: str, reading: Reading) -> list[str]:
    fits = f"; the rays then fit to {np.degrees(reading.fit.scatter):.4f} deg"
    notes = []
    if word:
        notes.append(f"the heading is read as {word}{fits}")
    if reading.time_shift:
        notes.append(
            f"{reading.time_shift:+.0f} s are added to the strips' times: one of the files counts "
            f"UTC, without the leap seconds of GPS time{fits}"
        )
    if reading.height_shift:
        notes.append(
            f"{reading.height_shift:+.3f} m are added to the strips' heights, found from the rays: "
            f"they stand above the geoid, the trajectory's above the ellipsoid{fits}"
        )
    return notes


def _refuse_uncovered(sample: Sample, trajectory: Trajectory, files: Files) -> None:
    first, last = trajectory.time[0], trajectory.time[-1]
    outside = ((sample.time < first) | (sample.time > last)).mean()
    raise OutsideTrajectory(
        f"{files.strip}: {100 * outside:.0f} % of the points lie outside the trajectory, points "
        f"{sample.time.min():.1f}-{sample.time.max():.1f} s, {files.trajectory} "
        f"{first:.1f}-{last:.1f} s of the GPS week; give the trajectory of this flight, whole"
    )


def scanner_of(
    reading: Reading, given: MountingFile, files: Files
) -> tuple[Scanner, np.ndarray, list[str]]:
    """The scanner whose beams the rings are; the number of its beam for a recorded ring, else
    `UNKNOWN_RING`; and notes. Raises `BadInput` where the beams given are not those of the data."""
    for scanner in _scanners(given):
        number = ray_test.beam_numbers(reading.fit, scanner.beam_elevations)
        if number is not None:
            return _with_own_beams(reading, scanner, number, given)
    if given.beams_given:
        found, beams = np.degrees(reading.fit.elevations), given.scanner.beam_elevations
        raise BadInput(
            f"{files.mounting} [scanner]: the rings of the strips are not the beams of "
            f"{given.scanner.name}: {len(found)} rings at {found.min():.2f} to {found.max():.2f} "
            f"deg, expected {len(beams)} beams at {np.degrees(beams[0]):.2f} to "
            f"{np.degrees(beams[-1]):.2f} deg; name the scanner or its beam_elevations_deg"
        )
    order = np.argsort(reading.fit.elevations)
    scanner = replace(given.scanner, beam_elevations=reading.fit.elevations[order])
    note = (
        f"{files.mounting} [scanner]: no known beam table fits; the {len(order)} elevations are "
        f"taken from the points, {np.degrees(scanner.beam_elevations[0]):.2f} to "
        f"{np.degrees(scanner.beam_elevations[-1]):.2f} deg"
    )
    return scanner, _table(reading.fit.rings, np.argsort(order)), [note]


def _scanners(given: MountingFile) -> list[Scanner]:
    """The one given; and, where only assumed, the others that are known."""
    others = [] if given.beams_given else mounting.BEAMS_DEG.items()
    return [
        given.scanner,
        *(
            replace(given.scanner, name=name, beam_elevations=np.radians(beams))
            for name, beams in others
        ),
    ]


def _with_own_beams(reading: Reading, scanner: Scanner, number: np.ndarray, given: MountingFile):
    notes = []
    if scanner.name != given.scanner.name:
        notes.append(f"the points show the beams of {scanner.name}, which is taken as the scanner")
    difference = np.abs(reading.fit.elevations - scanner.beam_elevations[number]).max()
    if difference > max(SAME_BEAM, 0.2 * reading.fit.scatter):
        beams = scanner.beam_elevations.copy()
        beams[number] = reading.fit.elevations
        scanner = replace(scanner, beam_elevations=beams)
        notes.append(
            f"beam elevations differ from the table of {scanner.name} by up to "
            f"{np.degrees(difference):.3f} deg; those of the points are used, the unit's own"
        )
    if not np.array_equal(number, reading.fit.rings):
        notes.append("rings are not numbered by ascending elevation; they are told by their rays")
    return scanner, _table(reading.fit.rings, number), notes


def _table(rings: np.ndarray, number: np.ndarray) -> np.ndarray:
    table = np.full(max(256, int(rings.max()) + 1), UNKNOWN_RING, np.uint8)
    table[rings] = number
    return table


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
        found = ray_test.fit(turned[0], sample, turned[1])
        if not found.good:
            found = ray_test.best_height(turned[0], sample, turned[1])[1]
        if found.good:
            yield mistake.where, mistake.what, mistake.remedy, found.scatter
    metres = FOOT * (sample.p_m[:, 2] + sample.base) - sample.base
    found = ray_test.fit(
        pose, replace(sample, p_m=np.column_stack([sample.p_m[:, :2], metres])), given.mounting
    )
    if found.good:
        yield "strip", "its heights are in feet", "export them in metres", found.scatter
    beams = given.scanner.beam_elevations
    scatter = _scatter_without_rings(pose, sample, given.mounting, beams)
    if scatter <= ray_test.FITS:
        what = "the ring dimension does not hold the ring"
        yield "strip", what, "name the right one with --ring-dimension", scatter


def _scatter_without_rings(pose, sample: Sample, mounting: Mounting, beams) -> float:
    """Scatter rad of the elevations about the nearest beam, whatever the rings say."""
    _, elevation, _ = ray_test.laser_rays(pose, sample.p_m, mounting)
    nearest = np.abs(elevation[:, None] - beams).min(axis=1)
    return float(1.4826 * np.median(nearest))
