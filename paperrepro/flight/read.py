"""An operator's files to a `Survey` in one local topocentric frame.

    flight = read_flight(["F1.laz", ...], "mission.sbet", "mounting.toml")
    flight.survey, flight.frame, flight.notes

Ranges and angles are no part of a LAS file: they come from the coordinates, taken back through the
pose and the nominal mounting with which they were computed. Elevations are then the beam table's.
Nothing is believed that a file's header says of its data: place, extent and resolution are taken
from a sample of the points.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from paperrepro._progress import Remaining
from paperrepro.errors import BadInput, RaysDoNotFit
from paperrepro.flight import consistency, decoding, flight_lines, ray_test
from paperrepro.flight.consistency import Names
from paperrepro.flight.decoding import Decoder
from paperrepro.flight.geodesy import LocalFrame
from paperrepro.flight.hypotheses import Evidence
from paperrepro.flight.las import Records, StripFile, open_strip
from paperrepro.flight.mounting import MountingFile, read_mounting
from paperrepro.flight.sbet import Clock, read_accuracy
from paperrepro.flight.table import (
    PULSES,
    READINGS,
    SUFFIXES,
    PointPoses,
    PoseColumns,
    TableFile,
    open_table,
    pose_columns,
    read_points,
)
from paperrepro.flight.trajectory_file import TrajectoryFile
from paperrepro.method.coarse_to_fine import Progress, silent
from paperrepro.method.control import ControlPoints
from paperrepro.survey import Scanner, Strip, Survey, Trajectory


@dataclass(frozen=True)
class Flight:
    """A flight read from files.

    Attributes
    ----------
    survey : Survey
        Strips, trajectory, nominal mounting and specifications, in the m-frame of ``frame``.
    frame : LocalFrame
        Where the m-frame lies: latitude, longitude (rad) and ellipsoidal height (m) of its origin.
    notes : tuple of str
        Each assumption, correction and omission, a sentence.
    files : tuple of StripFile or TableFile
        The strips as they lie on disk.
    decoder : Decoder
        How their points became rays.
    trajectory : str
        The file of the trajectory, for messages.
    trajectory_file : TrajectoryFile or None
        The same, to be read again; None where points carry their poses.
    """

    survey: Survey
    frame: LocalFrame
    notes: tuple[str, ...]
    files: tuple[StripFile | TableFile, ...]
    decoder: Decoder
    trajectory: str
    trajectory_file: TrajectoryFile | None = None

    def __repr__(self) -> str:
        points = sum(map(len, self.survey.strips))
        names = ", ".join(strip.name for strip in self.survey.strips)
        latitude, longitude = np.degrees([self.frame.latitude, self.frame.longitude])
        return (
            f"Flight: {len(self.survey.strips)} strips ({names}), {points} points, "
            f"{self.survey.scanner.name}, at {latitude:.5f}°, {longitude:.5f}°, "
            f"{len(self.notes)} notes"
        )


def read_flight(
    strips: Sequence[str | Path],
    trajectory: str | Path | None,
    mounting: str | Path,
    *,
    accuracy: str | Path | None = None,
    crs: str | None = None,
    ring_dimension: str = "user_data",
    columns: str | None = None,
    scanner: str | None = None,
    frame: LocalFrame | None = None,
    progress: Progress = silent,
) -> Flight:
    """Read the files of a flight.

    Parameters
    ----------
    strips : sequence of path
        LAS, LAZ (with GPS time) or CSV.
    trajectory : path or None
        An SBET, or text with a pose a line. Without one each point must carry its pose.
    mounting : path
        `mounting.toml`: nominal rotation (l to b) and lever arm (m, b-frame), scanner, GNSS/INS.
    accuracy : path, optional
        An SMRMSG, whose standard deviations replace those of the mounting file.
    crs : str, optional
        Reference system of the strips, such as ``EPSG:32722``, in place of their headers'.
    ring_dimension : str
        Where the ring of a point stands, if the scanner has any.
    columns : str, optional
        Names of the trajectory's columns, with commas between, where it is text without a head
        line.
    scanner : str, optional
        Its kind, ``rings``, ``line`` or ``any``, in place of what the mounting file says.
    frame : LocalFrame, optional
        Where to estimate; by default at the middle of the strips, at their lowest point.
    progress : callable, optional
        Told how far the reading is.

    Returns
    -------
    Flight
        Every assumption and correction is in its ``notes``.

    Raises
    ------
    BadInput
        Or one of its kin (`EmptyStrip`, `OutsideTrajectory`, `NotFinite`, `NotARotation`): names
        file, place and remedy.
    """
    require_apart(strips)
    given = read_mounting(mounting, scanner)
    files = [_opened(Path(path), crs, ring_dimension) for path in strips]
    _require_one_datum(files)
    timed = trajectory is not None
    records = [decoding.sampled(file, timed) for file in files]
    frame = frame or _frame_of(files, records)
    navigation = given.navigation
    named = Names(str(files[0].path), str(trajectory or files[0].path), str(mounting))
    flown = None if trajectory is None else TrajectoryFile(Path(trajectory), files[0].grid, columns)
    decoder, scanner, notes = _decoder(files, records, frame, given, named, flown)
    done = Remaining("reading", sum(file.count for file in files), progress)
    read, more = _read_all(files, decoder, done)
    path = decoder.poses
    path = path if isinstance(path, Trajectory) else flight_lines.joined_trajectory(read)
    if accuracy is not None:
        navigation = read_accuracy(accuracy, navigation, path.time)
    survey = Survey(tuple(read), path, given.mounting, scanner, navigation)
    of_files = [note for file in files for note in file.notes]
    notes = (*given.notes, *of_files, *notes, *more)
    return Flight(survey, frame, notes, tuple(files), decoder, named.trajectory, flown)


def read_control(path: str | Path | None, flight: Flight) -> ControlPoints | None:
    """Points surveyed on the ground.

    Parameters
    ----------
    path : path or None
        CSV with columns name, x, y, z, sigma: coordinates in the reference system of the strips,
        heights as theirs, and the standard deviation of the height, m.
    flight : Flight

    Returns
    -------
    ControlPoints
        In the m-frame of the flight; None without a path.

    Raises
    ------
    BadInput
        Names file, column and row.
    """
    if path is None:
        return None
    names, xyz, sigma = read_points(path)
    p_m = decoding.local_points(flight.files[0].grid, xyz, flight.frame)
    if not np.isfinite(p_m).all():
        lost = names[int(np.flatnonzero(~np.isfinite(p_m).all(axis=1))[0])]
        raise BadInput(
            f"{path}: point {lost} lies outside of {flight.files[0].grid.name}; give coordinates "
            "in the strips' reference system"
        )
    return ControlPoints(tuple(names), p_m + flight.decoder.shift, sigma)


def _opened(path: Path, crs: str | None, ring_dimension: str) -> StripFile | TableFile:
    table = path.suffix.lower() in SUFFIXES
    return (open_table if table else open_strip)(path, crs, ring_dimension)


def require_apart(strips: Sequence[str | Path], out: str | Path | None = None) -> None:
    """Raise `BadInput` where two ``strips`` have one name, and where writing them into folder
    ``out`` would overwrite one."""
    paths = [Path(path) for path in strips]
    names = [path.stem for path in paths]
    for path in paths:
        if names.count(path.stem) > 1:
            raise BadInput(f"{path}: given twice, or two files have this name; rename one of them")
        target = out and Path(out) / path.name
        if target and target.exists() and path.exists() and path.samefile(target):
            raise BadInput(f"{path}: would be overwritten; choose another folder than {out}")


def _require_one_datum(files: list) -> None:
    if not files:
        raise BadInput("strips: expected at least one file; give them as LAS, LAZ or CSV")
    first = files[0]
    for file in files:
        if file.grid.crs.geodetic_crs != first.grid.crs.geodetic_crs:
            raise BadInput(
                f"{file.path}: its datum is {file.grid.crs.geodetic_crs.name}, that of "
                f"{first.path} is {first.grid.crs.geodetic_crs.name}; bring them to one"
            )


def _frame_of(files: list, records: list[Records]) -> LocalFrame:
    """At the middle of the points."""
    places = [file.grid.to_geodetic(r.xyz) for file, r in zip(files, records, strict=True)]
    places = np.concatenate(places, axis=1)
    places = places[:, np.isfinite(places).all(axis=0)]
    return LocalFrame.around(*places, files[0].grid.shape)


def _decoder(
    files: list, records: list[Records], frame: LocalFrame, given: MountingFile, named: Names,
    flown: TrajectoryFile | None,
) -> tuple[Decoder, Scanner, list[str]]:  # fmt: skip
    """Of the kind of scanner given, or of that which files without rings tell."""
    more = () if flown is None else (flown,)
    decoder_of = _decoder_of_poses if flown is None else _decoder_of_flown
    told = any(np.ptp(r.ring) for r in records)
    if given.kind == "rings" and (given.kind_given or told):
        decoding.require_rings(files, records)
        return decoder_of(files, records, frame, given, named, *more)
    records = [replace(r, ring=np.zeros_like(r.ring)) for r in records]
    if given.kind_given:
        return decoder_of(files, records, frame, given, named, *more)
    words = f"{named.strip}: holds no rings and {named.mounting} names no scanner"
    try:
        found = decoder_of(files, records, frame, given.of_kind("line"), named, *more)
        note = f"{words}; the rays lie in one plane or cone, as of a line scanner"
    except RaysDoNotFit:
        found = decoder_of(files, records, frame, given.of_kind("any"), named, *more)
        note = f"{words}; the rays go anywhere, and are taken as they are"
    return *found[:2], [note, *found[2]]


def _decoder_of_flown(
    files: list, records: list[Records], frame: LocalFrame, given: MountingFile, named: Names,
    trajectory: TrajectoryFile,
) -> tuple[Decoder, Scanner, list[str]]:  # fmt: skip
    poses = trajectory.poses()
    clocks = decoding.clocks_of(files, records, poses.time)
    flown = poses.time + poses.week
    samples = tuple(
        decoding.strip_sample(file, r, clocks[file.path], flown)
        for file, r in zip(files, records, strict=True)
    )
    evidence = Evidence(samples, poses, given.mounting, frame, np.zeros(3), given.kind != "any")
    consistency.require_near(evidence, named.trajectory)
    if given.kind == "line" and evidence.is_covered:
        evidence = replace(evidence, mounting=ray_test.about_mirror(*evidence.rays, given.mounting))
    found, notes = consistency.consistent_evidence(evidence, given, named)
    scanner, beams, more = consistency.scanner_of(found.fit, given, named)
    time_shift = float(np.round(found.samples[0].time[0] - samples[0].time[0]))
    decoder = Decoder(frame, given.mounting, found.poses.in_frame(frame), clocks, beams,
                      time_shift, found.shift)  # fmt: skip
    return decoder, scanner, [*notes, *more, *consistency.coarse_coordinates(samples)]


def _decoder_of_poses(
    files: list, records: list[Records], frame: LocalFrame, given: MountingFile, named: Names
) -> tuple[Decoder, Scanner, list[str]]:
    columns = {_pose_columns_of(file): file for file in files}
    if len(columns) > 1:
        raise BadInput(
            f"{list(columns.values())[-1].path}: its pose columns are named otherwise than those "
            f"of {files[0].path}; name them alike"
        )
    columns = next(iter(columns))
    candidates = {
        (unit, word): PointPoses(columns, frame, word, unit)
        for unit, word in product(columns.units, READINGS)
    }
    beams = given.kind != "any"
    fits = decoding.fits_of_poses(files, records, frame, candidates, given.mounting, beams)
    unit = min(fits, key=lambda one: fits[one].scatter)[0]
    fits = {word: fits[unit, word] for word in READINGS}
    word, notes = consistency.consistent_attitude(fits, named)
    scanner, beams, more = consistency.scanner_of(fits[word], given, named)
    clocks = {file.path: Clock() for file in files}
    decoder = Decoder(frame, given.mounting, candidates[unit, word], clocks, beams)
    return decoder, scanner, notes + more


def _pose_columns_of(file) -> PoseColumns:
    columns = pose_columns(file.columns)
    if columns is None:
        raise BadInput(
            f"{file.path}: expected a trajectory, or a pose for each point in columns sensor x, y, "
            "z (or latitude, longitude, elevation), roll, pitch, heading; give --trajectory"
        )
    return columns


def _read_all(files: list, decoder: Decoder, done: Remaining) -> tuple[list[Strip], list[str]]:
    """All files as strips, one for each flight line, and notes."""
    strips, notes = [], []
    for file in files:
        strip, left_out = decoding.read_strip(decoder, file, done)
        lines, turns = flight_lines.split(strip, decoding.poses_at(decoder, strip))
        coarse = strip.pose is not None and flight_lines.whole_seconds(strip.time)
        if isinstance(file, TableFile) and file.time is None:
            notes.append(
                f"{file.path}: no time in it; rows are counted as pulses, {PULSES:.0f} a second, "
                "which scenario D must not be given"
            )
        strips += [decoding.with_finer_times(line) if coarse else line for line in lines]
        notes += left_out
        if len(lines) > 1 or turns:
            notes.append(
                f"{file.path}: holds {len(lines)} passes, each a strip of its own; {turns} "
                "points of turns between them are left out"
            )
        if coarse:
            notes.append(
                f"{file.path}: its times are whole seconds; finer ones are taken from the sensor's "
                "place along the line"
            )
    timed = not any(isinstance(file, TableFile) and file.time is None for file in files)
    strips, more = flight_lines.joined(strips) if timed else (strips, [])
    return flight_lines.with_unique_names(strips), notes + more
