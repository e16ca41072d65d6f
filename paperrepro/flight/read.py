"""An operator's files to a `Survey` in one local topocentric frame.

    flight = read_flight(["F1.laz", ...], "mission.sbet", "mounting.toml")
    flight.survey, flight.frame, flight.notes

Ranges and angles are no part of a LAS file: they come from the coordinates, taken back through the
pose and the nominal mounting with which they were computed. Elevations are then the beam table's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from paperrepro.errors import BadInput
from paperrepro.flight import consistency, decoding, flight_lines
from paperrepro.flight.decoding import Decoder
from paperrepro.flight.geodesy import LocalFrame
from paperrepro.flight.las import StripFile, open_strip
from paperrepro.flight.mounting import MountingFile, read_mounting
from paperrepro.flight.sbet import read_accuracy, read_sbet
from paperrepro.flight.table import (
    PULSES,
    READINGS,
    SUFFIXES,
    PointPoses,
    PoseColumns,
    TableFile,
    open_table,
    pose_columns,
)
from paperrepro.survey import Scanner, Strip, Survey, Trajectory


@dataclass(frozen=True)
class Flight:
    """A survey from files. ``frame``: where its m-frame lies; ``notes``: each assumption and
    correction, a sentence; ``files`` as read; ``decoder``: how their points became rays."""

    survey: Survey
    frame: LocalFrame
    notes: tuple[str, ...]
    files: tuple[StripFile | TableFile, ...]
    decoder: Decoder


def read_flight(
    strips: Sequence[Path],
    trajectory: Path | None,
    mounting: Path,
    *,
    accuracy: Path | None = None,
    crs: str | None = None,
    ring_dimension: str = "user_data",
    frame: LocalFrame | None = None,
) -> Flight:
    """Read strips (LAS, LAZ, CSV), an SBET and `mounting.toml`; ``accuracy`` is an SMRMSG.

    Without a ``trajectory`` each point must carry its pose. ``crs`` overrides the strips' own,
    ``frame`` is where to estimate, by default at the middle of the strips. Raises `BadInput` or one
    of its kin, which names file, place and remedy.
    """
    given = read_mounting(mounting)
    files = [_opened(Path(path), crs, ring_dimension) for path in strips]
    _require_together(files)
    frame = frame or _frame_of(files)
    navigation = given.navigation if accuracy is None else read_accuracy(accuracy, given.navigation)
    if trajectory is None:
        decoder, scanner, notes = _decoder_of_poses(files, frame, given, mounting)
    else:
        decoder, scanner, notes = _decoder_of_flown(files, frame, given, trajectory, mounting)
    read, more = _read_all(files, decoder)
    path = decoder.poses
    path = path if isinstance(path, Trajectory) else flight_lines.joined_trajectory(read)
    survey = Survey(tuple(read), path, given.mounting, scanner, navigation)
    return Flight(survey, frame, (*given.notes, *notes, *more), tuple(files), decoder)


def _opened(path: Path, crs: str | None, ring_dimension: str) -> StripFile | TableFile:
    table = path.suffix.lower() in SUFFIXES
    return (open_table if table else open_strip)(path, crs, ring_dimension)


def _require_together(files: list) -> None:
    """One datum, and a name of its own for each strip."""
    if not files:
        raise BadInput("strips: expected at least one file; give them as LAS, LAZ or CSV")
    first, names = files[0], set()
    for file in files:
        if file.grid.crs.geodetic_crs != first.grid.crs.geodetic_crs:
            raise BadInput(
                f"{file.path}: its datum is {file.grid.crs.geodetic_crs.name}, that of "
                f"{first.path} is {first.grid.crs.geodetic_crs.name}; bring them to one"
            )
        if file.path.stem in names:
            raise BadInput(
                f"{file.path}: a second strip named {file.path.stem}; rename it or give it once"
            )
        names.add(file.path.stem)


def _frame_of(files: list) -> LocalFrame:
    """At the middle of all strips, at their lowest point."""
    corners = [file.grid.to_geodetic(np.array([file.low, file.high])) for file in files]
    low, high = np.min(corners, axis=(0, 2)), np.max(corners, axis=(0, 2))
    if not np.isfinite([low, high]).all():
        raise BadInput(
            f"{files[0].path}: its coordinates lie outside of {files[0].grid.name}; name the right "
            "reference system with --crs"
        )
    middle = 0.5 * (low + high)
    return LocalFrame(float(middle[0]), float(middle[1]), float(low[2]), *files[0].grid.shape)


def _decoder_of_flown(
    files: list, frame: LocalFrame, given: MountingFile, trajectory: Path, mounting: Path
) -> tuple[Decoder, Scanner, list[str]]:
    poses = read_sbet(trajectory)
    names = consistency.Files(str(files[0].path), str(trajectory), str(mounting))
    clocks, sample = decoding.sample_of(files, frame, poses, str(trajectory))
    candidates = decoding.trajectories(poses, frame, files[0].grid)
    reading, notes = consistency.settle(sample, candidates, given, names)
    scanner, beams, more = consistency.scanner_of(reading, given, names)
    decoder = Decoder(
        frame, given.mounting, reading.trajectory, clocks, reading.time_shift,
        reading.height_shift, beams,
    )  # fmt: skip
    return decoder, scanner, notes + more


def _decoder_of_poses(
    files: list, frame: LocalFrame, given: MountingFile, mounting: Path
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
    names = consistency.Files(str(files[0].path), str(files[0].path), str(mounting))
    fits = decoding.fits_of_poses(files, frame, candidates, given.mounting)
    unit = min(fits, key=lambda one: fits[one].scatter)[0]
    fits = {word: fits[unit, word] for word in READINGS}
    word, reading, notes = consistency.settle_poses(fits, given, names)
    scanner, beams, more = consistency.scanner_of(reading, given, names)
    clocks = {file.path: 0.0 for file in files}
    decoder = Decoder(frame, given.mounting, candidates[unit, word], clocks, 0.0, 0.0, beams)
    return decoder, scanner, notes + more


def _pose_columns_of(file) -> PoseColumns:
    columns = pose_columns(file.columns)
    if columns is None:
        raise BadInput(
            f"{file.path}: expected a trajectory, or a pose for each point in columns sensor x, y, "
            "z (or latitude, longitude, elevation), roll, pitch, heading; give --trajectory"
        )
    return columns


def _read_all(files: list, decoder: Decoder) -> tuple[list[Strip], list[str]]:
    """All files as strips, one for each pass, and notes."""
    strips, notes = [], []
    for file in files:
        strip = decoding.read_strip(decoder, file)
        poses_of = decoding.poses_at(decoder, strip)
        parts, left_out = flight_lines.split(strip, poses_of)
        coarse = flight_lines.whole_seconds(strip.time)
        if isinstance(file, TableFile) and file.time is None:
            notes.append(
                f"{file.path}: no time in it; rows are counted as pulses, {PULSES:.0f} a second, "
                "which scenario D must not be given"
            )
        strips += [decoding.with_finer_times(part) if coarse else part for part in parts]
        if len(parts) > 1 or left_out:
            notes.append(
                f"{file.path}: holds {len(parts)} passes, each a strip of its own; {left_out} "
                "points of turns between them are left out"
            )
        if coarse and strip.pose is not None:
            notes.append(
                f"{file.path}: its times are whole seconds; finer ones are taken from the sensor's "
                "place along the line"
            )
    return strips, notes
