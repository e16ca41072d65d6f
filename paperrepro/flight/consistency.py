"""Do strips, trajectory, mounting and scanner belong together? Accepted, mended, or refused.

Two tests: the points lie near the trajectory, and the rays to them fit the beams (`ray_test`).
Where one fails, the hypotheses of one table are tried: each is a mistake that files are known to
hold, with the change that undoes it. A hypothesis that is a known convention, or one number that
the rays determine, is mended with a note: leap seconds, a heading against grid north or the wander
frame, heights above the geoid, a datum or epoch a few metres off. Every other one is refused, by an
error that names it. What no ray can tell, a turn about the spin axis, is tested by `agreement` on
the strips' agreement, with the same table.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from paperrepro.errors import BadInput, OutsideTrajectory, RaysDoNotFit
from paperrepro.flight import ray_test, scanners
from paperrepro.flight.hypotheses import (
    CLOCKS,
    GRID_NORTH,
    HEADINGS,
    TABLE,
    Evidence,
    Hypothesis,
    StripSample,
    zones,
)
from paperrepro.flight.mounting import MountingFile
from paperrepro.flight.ray_test import Fit
from paperrepro.survey import Scanner

#: Scatter that is taken, with a note: coordinates from another solution of the trajectory.
TOLERATED = float(np.radians(0.15))
#: Medians further than this from the table, rad, are the unit's own elevations.
SAME_BEAM = float(np.radians(0.005))
#: Medians of a beam in two strips are nearer than this, rad. Fewer rays of a file tell nothing.
BEAM_APART, LEAST_RAYS = float(np.radians(0.1)), 200
#: A scatter below this, rad, is not looked at further.
SCATTER_SEEN = float(np.radians(0.002))
#: A convergence of the meridians that matters, rad.
CONVERGENCE_SEEN = float(np.radians(0.01))
#: Coordinates coarser than this, m, and times coarser than this, s, widen the noise.
COARSE_STEP, COARSE_TIME = 0.015, 0.9e-3
#: Times coarser than this, s, are refused where no ray tells what they do to the poses.
COARSE_UNSEEN = 5e-3


@dataclass(frozen=True)
class Names:
    """For messages: the first ``strip``, the ``trajectory``, the ``mounting``."""

    strip: str
    trajectory: str
    mounting: str


# --- the two tests -------------------------------------------------------------------------------


def require_near(evidence: Evidence, trajectory: str) -> None:
    """Raise `BadInput` where points of a file lie far from the trajectory."""
    for sample in evidence.samples:
        one = replace(evidence, samples=(sample,))
        if one.is_near:
            continue
        plan, height = one.apart(sample)
        far = f"{plan / 1000:.1f} km in plan and {abs(height):.0f} m in height"
        for hypothesis in (*TABLE, *zones(one)):
            if hypothesis.change(one).is_near:
                where = trajectory if hypothesis.where == "trajectory" else sample.name
                raise BadInput(
                    f"{where}: {hypothesis.what}: so strip and trajectory would lie together, as "
                    f"given they are {far} apart; {hypothesis.remedy}"
                )
        raise BadInput(
            f"{sample.name}: lies {far} from {trajectory}; give the trajectory of this flight and "
            f"the reference system of the strips (now {sample.grid.name}; --crs overrides it)"
        )


def consistent_evidence(
    evidence: Evidence, given: MountingFile, names: Names
) -> tuple[Evidence, list[str]]:
    """``evidence`` as the rays read it, and a note on each correction.

    Raises `OutsideTrajectory`, `BadInput` with the mistake under which the rays would fit, of all
    files or of one alone.
    """
    found, notes = _consistent(evidence, given, names)
    for k in _others_than_all(found):
        own = replace(names, strip=found.samples[k].name)
        alone, more = _consistent(replace(evidence, samples=(evidence.samples[k],)), given, own)
        if alone.fit.good:
            raise BadInput(
                f"{own.strip}: its rays do not fit as those of the other strips do, but so: "
                f"{'; '.join(more) or 'by other beams, or without what was put right for them'}; "
                "export it as the others"
            )
        notes = [*notes, *more]
    return found, notes


def _others_than_all(found: Evidence) -> list[int]:
    """Files whose rays do not fit as those of all files do, the worst first: a median over all
    tells nothing of a few."""
    fits = {
        k: replace(found, samples=(sample,)).fit
        for k, sample in enumerate(found.samples)
        if len(sample.time) >= LEAST_RAYS
    }
    fits = {k: fit for k, fit in fits.items() if fit is not None}
    if found.fit is None or len(fits) < 2 or not found.beams:
        return []
    elevations = pd.DataFrame({k: pd.Series(f.elevations, f.rings) for k, f in fits.items()})
    apart = elevations.sub(elevations.median(axis=1), axis=0).abs().max()
    excess = {}
    for k, own in fits.items():
        scatter = max(own.limit, 2 * found.fit.scatter)
        excess[k] = max(own.scatter / scatter, apart[k] / max(BEAM_APART, 2 * scatter))
    return sorted((k for k in excess if excess[k] > 1), key=lambda k: -excess[k])


def _consistent(
    evidence: Evidence, given: MountingFile, names: Names
) -> tuple[Evidence, list[str]]:
    """As `consistent_evidence`, of all files together."""
    plain, beams = evidence.fit, evidence.beams
    coarse = _coarse_times(evidence)
    if coarse and not beams and max(s.time_step for s in evidence.samples) > COARSE_UNSEEN:
        _refuse_coarse(*coarse)
    if plain is not None and plain.good:
        return _with_best_heading(evidence)
    if plain is not None and not beams:
        _refuse_by_name(evidence, given, names)
        return evidence, []
    corrected = _mended(evidence)
    if corrected is not None:
        return corrected
    if coarse and not (plain and plain.scatter <= TOLERATED):
        _refuse_coarse(*coarse)
    if plain is None:
        _refuse_uncovered(evidence, names)
    _refuse_by_name(evidence, given, names)
    few = evidence.few().with_shift()
    if few.fit.good:
        evidence = replace(evidence, shift=few.shift)
        if evidence.fit.good:
            return evidence, [_shift_note(evidence)]
    _refuse_turned(evidence, names)
    degrees = f"{np.degrees(plain.scatter):.3f} deg, expected {np.degrees(plain.limit):.3f}"
    if plain.scatter <= TOLERATED:
        why = "the coordinates seem computed from another solution of the trajectory"
        if coarse:
            why = f"{coarse[1]}, which widens the noise: export full GPS times"
        return evidence, [f"{names.trajectory}: within a beam the elevations scatter by {degrees}; "
                          f"{why}"]  # fmt: skip
    raise RaysDoNotFit(
        f"{names.trajectory}: the rays to the points of {names.strip} and others do not fit: "
        f"within a beam the elevations scatter by {degrees}; {_causes(evidence)}give the "
        f"trajectory and the mounting with which the coordinates were computed{_kinds(given)}"
    )


def _with_best_heading(evidence: Evidence) -> tuple[Evidence, list[str]]:
    """Of rays that fit, under the heading they fit best; where they cannot tell, a note."""
    others = {h: h.change(evidence) for h in _headings(evidence)}
    fits = {h: other.fit for h, other in others.items() if other.fit is not None}
    best = _much_better(evidence.fit, fits)
    if best is not None:
        return others[best], [_note(best, others[best].fit)]
    notes = []
    poses = evidence.poses
    turn = evidence.samples[0].grid.convergence(poses.latitude[:1], poses.longitude[:1])[0]
    grid = fits.get(GRID_NORTH)
    if grid and abs(turn) > CONVERGENCE_SEEN and grid.good and grid.scatter < 1.5 * max(
        evidence.fit.scatter, SCATTER_SEEN
    ):  # fmt: skip
        notes.append(
            "the rays do not tell whether the heading counts from true or grid north; true north "
            f"is taken, grid north would change the yaw by {np.degrees(turn):+.3f} deg"
        )
    coarse = _coarse_times(evidence)
    notes += [f"{': '.join(coarse)}, which widens the noise"] if coarse else []
    return evidence, notes


def _headings(evidence: Evidence) -> tuple[Hypothesis, ...]:
    wanders = np.abs(evidence.poses.wander).max() > 1e-6
    return HEADINGS if wanders else HEADINGS[:1]


def _much_better(plain: Fit, others: Mapping) -> object | None:
    """The key of a fit that halves the plain one's scatter where this is no matter of resolution;
    else None."""
    best = min(others, key=lambda key: others[key].scatter, default=None)
    clear = best is not None and others[best].scatter < 0.5 * plain.scatter
    return best if clear and plain.scatter > SCATTER_SEEN else None


def _mended(evidence: Evidence) -> tuple[Evidence, list[str]] | None:
    """The evidence with fewest corrections under which the rays fit, and its notes; or None."""
    few, tried = evidence.few(), []
    for heading in (None, *_headings(evidence)):
        turned = heading.change(few) if heading else few
        for clock in (None, *CLOCKS):
            found = clock.change(turned) if clock else turned
            if found.is_covered:
                tried.append(([h for h in (heading, clock) if h], found))
    good = [(hypotheses, found) for hypotheses, found in tried if found.fit.good]
    if not good:
        good = [(hypotheses, found.with_height()) for hypotheses, found in tried]
        good = [(hypotheses, found) for hypotheses, found in good if found.fit.good]
    for hypotheses, found in sorted(good, key=lambda one: (len(one[0]), one[1].fit.scatter)):
        whole = evidence
        for hypothesis in hypotheses:
            whole = hypothesis.change(whole)
        if found.shift.any() and whole.is_covered:
            whole = whole.with_height()
        if whole.fit is not None and whole.fit.good:
            notes = [_note(hypothesis, whole.fit) for hypothesis in hypotheses]
            return whole, notes + _height_notes(whole)
    return None


def _height_notes(evidence: Evidence) -> list[str]:
    if not evidence.shift.any():
        return []
    return [
        f"{evidence.shift[2]:+.3f} m are added to the strips' heights, found from the rays: they "
        f"stand above the geoid, the trajectory's above the ellipsoid{_fits(evidence.fit)}"
    ]


def _note(hypothesis: Hypothesis, found: Fit) -> str:
    return hypothesis.what + _fits(found)


def _fits(found: Fit) -> str:
    return f"; the rays then fit to {np.degrees(found.scatter):.4f} deg"


def _shift_note(evidence: Evidence) -> str:
    east, north, up = evidence.shift
    return (
        f"{east:+.3f} m east, {north:+.3f} m north and {up:+.3f} m up are added to the strips, "
        "found from the rays: trajectory and strips stand in different datums or epochs"
        f"{_fits(evidence.fit)}"
    )


def _refuse_uncovered(evidence: Evidence, names: Names) -> None:
    first, last = evidence.poses.time[[0, -1]] + evidence.poses.week
    time = np.concatenate([s.time for s in evidence.samples])
    outside = (time < first) | (time > last)
    raise OutsideTrajectory(
        f"{names.strip}: {100 * outside.mean():.1f} % of the points sampled ({outside.sum()} of "
        f"{len(time)}) lie outside the trajectory, points {time.min():.1f}-{time.max():.1f} s, "
        f"{names.trajectory} {first:.1f}-{last:.1f} s of the GPS week; give the trajectory of this "
        "flight, whole"
    )


def _refuse_by_name(evidence: Evidence, given: MountingFile, names: Names) -> None:
    """Raise `BadInput` with the first hypothesis of the table under which the rays would fit."""
    few = evidence.few()
    for hypothesis in (h for h in TABLE if not h.mend):
        changed = hypothesis.change(few)
        if not changed.is_near:
            continue
        if not changed.fit.good and few.beams:
            changed = changed.with_height()
        if changed.fit.good:
            fits = f"fit the beams to {np.degrees(changed.fit.scatter):.3f} deg"
            fits = fits if few.beams else "lie in a cone"
            raise BadInput(
                f"{getattr(names, hypothesis.where)}: {hypothesis.what}: so the rays to the points "
                f"would {fits}, as given they do not; {hypothesis.remedy}"
            )
    if given.kind != "rings":
        return
    pose, sample = few.rays
    _, elevation, rho = ray_test.laser_rays(pose, sample.p_m, evidence.mounting)
    apart = np.abs(elevation[:, None] - given.scanner.beam_elevations).min(axis=1)
    scatter = 1.4826 * float(np.median(apart[ray_test.is_return(rho)]))
    if scatter <= ray_test.FITS:
        raise BadInput(
            f"{names.strip}: the ring dimension does not hold the ring: whatever it says, the rays "
            f"fit the beams to {np.degrees(scatter):.3f} deg; name the right one with "
            "--ring-dimension"
        )


def _refuse_turned(evidence: Evidence, names: Names) -> None:
    """Raise `BadInput` where the rays would fit under a boresight: calibrated already."""
    few = evidence.few()
    turn, found = ray_test.best_rotation(*few.rays, evidence.mounting)
    if found.good:
        angles = ", ".join(f"{value:+.3f}" for value in np.degrees(turn))
        raise BadInput(
            f"{names.strip}: its coordinates fit a boresight of {angles} deg (roll, pitch, yaw, as "
            f"far as rays tell) on {names.mounting}, not the nominal mounting: they seem corrected "
            "by a calibration already; give the strips as they were before it, or the mounting "
            "with which they were computed"
        )


def _refuse_coarse(name: str, words: str) -> None:
    raise BadInput(f"{name}: {words}, too coarse to find a pose; export full GPS times")


def _coarse_times(evidence: Evidence) -> tuple[str, str] | None:
    """The file with the coarsest times, and words on them; None where they are fine."""
    worst = max(evidence.samples, key=lambda s: s.time_step)
    step = worst.time_step
    if step < COARSE_TIME:
        return None
    return worst.name, (
        f"its times come in steps of {step:.4g} s, at most {1 / step:.3g} distinct times a second, "
        "as of rounding or of single precision"
    )


def _causes(evidence: Evidence) -> str:
    """What else is wrong with the points, for a refusal: a sentence part each."""
    pose, sample = evidence.rays
    _, _, rho = ray_test.laser_rays(pose, sample.p_m, evidence.mounting)
    lost = (rho < ray_test.NEAREST).mean()
    causes = []
    if lost > 0.01:
        causes.append(f"{100 * lost:.0f} % of the points lie at the sensor, pulses without return")
    if sample.scale > COARSE_STEP:
        causes.append(f"the coordinates come in steps of {sample.scale:.3g} m")
    return "".join(f"{cause}; " for cause in causes)


def _kinds(given: MountingFile) -> str:
    if given.kind == "any" or (given.beams_given and given.kind == "rings"):
        return ""
    return "; or say --scanner any, where no beam keeps an elevation"


def coarse_coordinates(samples: Sequence[StripSample]) -> list[str]:
    """A note on files whose coordinates are coarser than the noise of a laser."""
    return [
        f"{s.name}: its coordinates come in steps of {s.step:.3g} m, which widens the noise; "
        "mistakes as small as this are not seen in it"
        for s in samples
        if s.step > COARSE_STEP
    ]


def consistent_attitude(fits: Mapping[str, Fit], names: Names) -> tuple[str, list[str]]:
    """How the attitude of points with poses of their own is to be read, of ``fits`` by name, and
    notes. Raises `BadInput` where the rays fit under none."""
    word = min(fits, key=lambda name: fits[name].scatter)
    if fits[""].good and _much_better(fits[""], fits) is None:
        word = ""
    found = fits[word]
    if found.scatter > max(found.limit, TOLERATED):
        raise RaysDoNotFit(
            f"{names.strip}: the rays do not fit: within a beam the elevations scatter by "
            f"{np.degrees(found.scatter):.2f} deg, expected {np.degrees(found.limit):.2f}; give "
            f"the rotation and the lever arm with which the points were computed ({names.mounting})"
        )
    return word, [f"the heading is read as {word}{_fits(found)}"] if word else []


# --- the beams -----------------------------------------------------------------------------------


def scanner_of(
    found: Fit, given: MountingFile, names: Names
) -> tuple[Scanner, np.ndarray | None, list[str]]:
    """The scanner whose beams the rings are; the number of its beam for a recorded ring, else
    `UNKNOWN_RING`, or None without rings; and notes. Raises `BadInput` where the beams given are
    not those of the data."""
    if given.kind != "rings":
        unseen = {
            "line": "whether heights of strips and trajectory count from one surface",
            "any": "whether signs, clocks and heights of strips and trajectory belong together",
        }
        words = f"rays of such a scanner do not tell {unseen[given.kind]}"
        return given.scanner, None, [f"{names.mounting} [scanner] kind {given.kind}: {words}"]
    others = {} if given.beams_given else scanners.BEAMS_DEG
    known = [replace(given.scanner, name=name, beam_elevations=np.radians(beams))
             for name, beams in sorted(others.items(), key=lambda one: len(one[1]))]  # fmt: skip
    for scanner in (given.scanner, *known):
        number = ray_test.beam_numbers(found, scanner.beam_elevations)
        if number is not None:
            return _with_own_beams(found, scanner, number, given)
    deg = np.degrees(found.elevations)
    if given.beams_given or len(deg) >= ray_test.UNKNOWN_RING:
        beams = np.degrees(given.scanner.beam_elevations)
        raise BadInput(
            f"{names.mounting} [scanner]: the rings of the strips are not the beams of "
            f"{given.scanner.name}: {len(deg)} rings at {deg.min():.2f} to {deg.max():.2f} deg, "
            f"expected {len(beams)} beams at {beams[0]:.2f} to {beams[-1]:.2f} deg; name the "
            "scanner or its beam_elevations_deg"
        )
    order = np.argsort(found.elevations)
    scanner = replace(given.scanner, beam_elevations=found.elevations[order])
    note = (
        f"{names.mounting} [scanner]: no known beam table fits; the {len(order)} elevations are "
        f"taken from the points, {deg.min():.2f} to {deg.max():.2f} deg"
    )
    return scanner, _beam_of_ring(found.rings, np.argsort(order)), [note]


def _with_own_beams(found: Fit, scanner: Scanner, number: np.ndarray, given: MountingFile):
    notes = []
    if scanner.name != given.scanner.name:
        notes.append(f"the points show the beams of {scanner.name}, which is taken as the scanner")
    difference = np.abs(found.elevations - scanner.beam_elevations[number]).max()
    if difference > max(SAME_BEAM, 0.2 * found.scatter):
        beams = scanner.beam_elevations.copy()
        beams[number] = found.elevations
        scanner = replace(scanner, beam_elevations=beams)
        notes.append(
            f"beam elevations differ from the table of {scanner.name} by up to "
            f"{np.degrees(difference):.3f} deg; those of the points are used, the unit's own"
        )
    if not np.array_equal(number, found.rings):
        notes.append("rings are not numbered by ascending elevation; they are told by their rays")
    return scanner, _beam_of_ring(found.rings, number), notes


def _beam_of_ring(rings: np.ndarray, number: np.ndarray) -> np.ndarray:
    table = np.full(max(256, int(rings.max()) + 1), ray_test.UNKNOWN_RING, np.uint8)
    table[rings] = number
    return table
