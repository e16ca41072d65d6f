"""An operator's files to a `Survey` in one local topocentric frame.

    flight = read_flight(["F1.laz", ...], "mission.sbet", "mounting.toml")
    flight.survey, flight.frame, flight.notes

Ranges and angles are no part of a LAS file: they come from the coordinates, taken back through the
pose and the nominal mounting with which they were computed. Elevations are then the beam table's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from paperrepro.errors import BadInput
from paperrepro.io import clock, rays
from paperrepro.io.geodesy import LocalFrame
from paperrepro.io.las import StripFile, coordinates, open_strip, usable
from paperrepro.io.mounting import MountingFile, read_mounting
from paperrepro.io.sbet import Poses, read_accuracy, read_sbet
from paperrepro.survey import Scanner, Strip, Survey, Trajectory

#: Marks a recorded ring that is no beam.
UNKNOWN_RING = 255
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Flight:
    """A survey from files. ``frame``: where its m-frame lies; ``notes``: each assumption and
    correction, a sentence; ``files`` as read; ``reading``: how points became rays; ``clocks`` by
    file, s added to its times; ``beam_of_ring`` (256,): number of the beam for a recorded ring."""

    survey: Survey
    frame: LocalFrame
    notes: tuple[str, ...]
    files: tuple[StripFile, ...]
    reading: rays.Reading
    clocks: dict[Path, float]
    beam_of_ring: np.ndarray

    def located(self, file: StripFile, chunk) -> tuple[np.ndarray, np.ndarray]:
        """Time (N,) s of the trajectory's clock, and points (N, 3) m, m-frame, of records."""
        time = np.asarray(chunk.gps_time) + self.clocks[file.path] + self.reading.time_shift
        return time, _local(file, chunk, self.frame) + self.reading.height_shift * UP


def read_flight(
    strips: Sequence[Path],
    trajectory: Path | None = None,
    mounting: Path | None = None,
    *,
    frame: LocalFrame | None = None,
    accuracy: Path | None = None,
    crs: str | None = None,
    ring_dimension: str = "user_data",
) -> Flight:
    """Read strips (LAS, LAZ), an SBET and `mounting.toml`; ``accuracy`` is an SMRMSG.

    Raises `BadInput` or one of its kin, which names file, place and remedy.
    """
    given = read_mounting(mounting)
    files = [open_strip(path, crs, ring_dimension) for path in strips]
    navigation = given.navigation if accuracy is None else read_accuracy(accuracy, given.navigation)
    poses = read_sbet(trajectory)
    frame = frame or _frame_of(files)
    local = local_trajectory(poses, frame)
    clocks, sample = _sample(files, frame, poses)
    reading, notes = _settle(sample, local, given, trajectory)
    scanner, beam_of_ring = _scanner(reading, given)
    parts = [_read(file, frame, reading, clocks[file.path], beam_of_ring) for file in files]
    survey = Survey(tuple(parts), reading.trajectory, given.mounting, scanner, navigation)
    return Flight(
        survey, frame, given.notes + tuple(notes), tuple(files),
        reading, clocks, beam_of_ring,
    )  # fmt: skip


def _frame_of(files: list[StripFile]) -> LocalFrame:
    """At the middle of all strips, at their lowest point."""
    corners = [file.grid.to_geodetic(np.array([file.low, file.high])) for file in files]
    low, high = np.min(corners, axis=(0, 2)), np.max(corners, axis=(0, 2))
    middle = 0.5 * (low + high)
    return LocalFrame(float(middle[0]), float(middle[1]), float(low[2]), *files[0].grid.shape)


def local_trajectory(poses: Poses, frame: LocalFrame) -> Trajectory:
    """Poses in the m-frame, times from the start of the GPS week."""
    position = frame.from_geodetic(poses.latitude, poses.longitude, poses.height)
    attitude = frame.attitude_from_level(poses.latitude, poses.longitude, poses.attitude)
    return Trajectory(poses.time + clock.week_start(poses.time), position, attitude)


def _sample(files, frame: LocalFrame, poses: Poses) -> tuple[dict[Path, float], rays.Sample]:
    clocks, parts = {}, []
    for file in files:
        chunks = file.sample()
        time = np.concatenate([np.asarray(chunk.gps_time) for chunk in chunks])
        clocks[file.path] = clock.offset_to(poses.time, time)
        p_m = np.concatenate([_local(file, chunk, frame) for chunk in chunks])
        ring = np.concatenate([file.rings(chunk) for chunk in chunks])
        parts.append((time + clocks[file.path], p_m, ring))
    return clocks, rays.Sample(
        *map(np.concatenate, zip(*parts, strict=True)), max(file.scale for file in files)
    )


def _local(file: StripFile, chunk, frame: LocalFrame) -> np.ndarray:
    return frame.from_geodetic(*file.grid.to_geodetic(coordinates(chunk)))


def _settle(sample, trajectory: Trajectory, given: MountingFile, path: Path):
    reading = rays.try_reading(sample, trajectory, given.mounting)
    if reading is None:
        trajectory.at(sample.time, str(path))  # raises, with the times
    pose = reading.poses(sample.time, str(path))
    limit = rays.expected_scatter(sample, given.mounting, pose)
    rays.require_some_fit(reading, limit, str(path))
    return reading, []


def _scanner(reading: rays.Reading, given: MountingFile) -> tuple[Scanner, np.ndarray]:
    number = rays.beam_numbers(reading.fit, given.scanner.beam_elevations)
    if number is None:
        raise BadInput("beams")
    table = np.full(256, UNKNOWN_RING, np.uint8)
    table[reading.fit.rings.astype(int)] = number
    return given.scanner, table


def _read(file: StripFile, frame, reading: rays.Reading, clock_offset, beam_of_ring) -> Strip:
    """All usable points of a file as one strip."""
    parts = []
    for chunk in file.chunks():
        chunk = chunk[usable(chunk)]
        time = np.asarray(chunk.gps_time) + clock_offset + reading.time_shift
        p_m = _local(file, chunk, frame) + reading.height_shift * UP
        pose = reading.trajectory.at(time, str(file.path))
        azimuth, _, rho = rays.laser_rays(pose, p_m, reading.mounting)
        parts.append((time, beam_of_ring[file.rings(chunk)], azimuth, rho.astype(np.float32)))
    return Strip(file.path.stem, *map(np.concatenate, zip(*parts, strict=True)))
