"""Strips under another mounting, and with an adjusted trajectory: every point moved by Eq. (1),
every other dimension untouched.

A point is taken back to the laser under the nominal mounting, as when it was read, with its own
elevation and not the beam table's. So the nominal mounting gives the file's own coordinates back,
to the last digit. Points that are no rays of this flight (pulses without a return, times that the
trajectory does not cover) stay where they are.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import laspy
import numpy as np

from paperrepro import __version__
from paperrepro._files import written_whole
from paperrepro._progress import Remaining
from paperrepro.errors import BadInput
from paperrepro.flight import ray_test
from paperrepro.flight.calibration_file import read_calibration
from paperrepro.flight.las import FILE_ERRORS, SOFTWARE, StripFile, first_line, opened
from paperrepro.flight.mounting import read_mounting
from paperrepro.flight.read import Flight, read_control, read_flight, require_apart
from paperrepro.flight.trajectory_file import adjustment
from paperrepro.method.coarse_to_fine import Progress, silent
from paperrepro.method.control import CheckedHeights, Correct, check_heights, clouds_of
from paperrepro.method.georeference import georeference
from paperrepro.survey import Mounting, Rays

#: Records of cloud-optimised point clouds: their index would not fit the points once moved.
COPC = "copc"


@dataclass(frozen=True)
class Applied:
    """What `apply_calibration` wrote: paths of the ``strips``, the number of ``points`` in them,
    ``notes`` of the reading, a sentence each, and heights over ``checkpoints``, if any."""

    strips: tuple[Path, ...]
    points: int
    notes: tuple[str, ...]
    checkpoints: CheckedHeights | None = None

    @property
    def heights(self) -> list[str]:
        """Lines on the heights over checkpoints."""
        return self.checkpoints.lines() if self.checkpoints else []


def apply_calibration(
    strips: Sequence[str | Path],
    trajectory: str | Path | None,
    mounting: str | Path,
    calibration: str | Path,
    out: str | Path,
    *,
    crs: str | None = None,
    ring_dimension: str = "user_data",
    columns: str | None = None,
    scanner: str | None = None,
    mounting_only: bool = False,
    checkpoints: str | Path | None = None,
    progress: Progress = silent,
) -> Applied:
    """Write strips anew under a calibration: all of them, or none.

    Parameters
    ----------
    strips : sequence of path
        LAS or LAZ.
    trajectory : path or None
        The SBET, or text, with which their coordinates were computed.
    mounting : path
        `mounting.toml`, the nominal one.
    calibration : path
        `calibration.json`: boresight (deg), and range offsets and lever arm (m) where it has them.
    out : path
        Folder to write into, under the files' own names.
    crs, ring_dimension, columns, scanner
        As for `read_flight`.
    mounting_only : bool
        Poses stay as reported, though the calibration has an adjusted trajectory.
    checkpoints : path, optional
        CSV of points surveyed on the ground, `read_control`, over which heights are compared.
    progress : callable, optional
        Told how far reading and writing are.

    Returns
    -------
    Applied
        Paths, number of points, notes, heights over the checkpoints.

    Raises
    ------
    BadInput
        What `read_flight` and `read_calibration` raise; a folder that holds the originals or cannot
        be written; a file that cannot be.
    """
    given = read_mounting(mounting, scanner)
    early = read_calibration(calibration, given.mounting)
    require_apart(strips, out)
    flight = read_flight(
        strips, trajectory, mounting, crs=crs, ring_dimension=ring_dimension, columns=columns,
        scanner=scanner, progress=progress,
    )  # fmt: skip
    survey, points = flight.survey, read_control(checkpoints, flight)
    calibrated = read_calibration(calibration, survey.mounting, survey.scanner)
    correct = None
    if calibrated.trajectory and trajectory is not None and not mounting_only:
        correct = adjustment(flight.trajectory_file, calibrated.trajectory, flight.frame)
    written = write_strips(flight, calibrated.mounting, out, correct, progress)
    count = sum(file.count for file in flight.files)
    notes = (*early.notes, *flight.notes, *_copc_notes(flight))
    checked = None
    if points is not None:
        clouds = clouds_of(survey.mounting, calibrated.mounting, correct)
        checked = check_heights(survey, points, clouds)
    return Applied(tuple(written), count, notes, checked)


def _copc_notes(flight: Flight) -> list[str]:
    notes = []
    for file in flight.files:
        with opened(file.path) as reader:
            if _without_copc(reader.header.vlrs) != list(reader.header.vlrs):
                notes.append(f"{file.path}: is written without its COPC index, as common LAS")
    return notes


def require_writable(flight: Flight, out: str | Path) -> None:
    """Raise `BadInput`, before any work, where the flight's files cannot be written into ``out``:
    tables, files whose coordinates cannot move, originals that would be overwritten."""
    for file in flight.files:
        if file.hindrance:
            raise BadInput(f"{file.path}: {file.hindrance}")
    require_apart([file.path for file in flight.files], out)


def write_strips(
    flight: Flight, mounting: Mounting, out: str | Path, correct: Correct | None = None,
    progress: Progress = silent,
) -> list[Path]:  # fmt: skip
    """Write the flight's files anew into folder ``out``, under ``mounting``: all of them, or none.

    ``correct`` as `Correct`, by default poses stay as reported. The names stay; range offsets go by
    beam of `Scanner.beam_elevations`. ``progress`` is told how far the writing is. Raises as
    `require_writable`, and `BadInput` where ``out`` cannot be written.
    """
    out = Path(out)
    require_writable(flight, out)
    done = Remaining("writing", sum(file.count for file in flight.files), progress)
    with written_whole(out) as folder:
        for file in flight.files:
            _write_file(flight, file, mounting, folder / file.path.name, correct, done)
    return [out / file.path.name for file in flight.files]


def _write_file(
    flight: Flight, file: StripFile, mounting: Mounting, target: Path, correct: Correct | None,
    done: Remaining,
) -> None:  # fmt: skip
    try:
        with opened(file.path) as reader:
            evlrs = _without_copc(reader.evlrs or [])
            header = _header_to_write(reader.header)
            with laspy.open(target, mode="w", header=header) as writer:
                for chunk in file.chunks(done=done):
                    _move(flight, file, chunk, mounting, correct)
                    writer.write_points(chunk)
                if evlrs:
                    writer.write_evlrs(laspy.vlrs.vlrlist.VLRList(evlrs))
    except BadInput:
        raise
    except OverflowError as error:
        raise BadInput(
            f"{file.path}: points moved by the calibration do not fit the 32 bits of its "
            "coordinates; export it with an offset near the points"
        ) from error
    except (*FILE_ERRORS, NotImplementedError) as error:
        if isinstance(error, OSError):
            raise  # of the folder, which knows what to say
        raise BadInput(
            f"{file.path}: cannot be written again ({first_line(error)}); export it anew"
        ) from error


def _header_to_write(header: laspy.LasHeader) -> laspy.LasHeader:
    """The header marked as ours, without a COPC index; LAS 1.0, which none writes, as 1.2."""
    header.vlrs = laspy.vlrs.vlrlist.VLRList(_without_copc(header.vlrs))
    header.evlrs = None
    header.generating_software = f"{SOFTWARE} {__version__}"
    if header.version.minor < 1:
        header.version = laspy.header.Version(1, 2)
    return header


def _without_copc(records) -> list:
    return [record for record in records if record.user_id.strip("\0 ").lower() != COPC]


def _move(
    flight: Flight, file: StripFile, chunk, mounting: Mounting, correct: Correct | None
) -> None:
    xyz = np.column_stack([chunk.x, chunk.y, chunk.z])
    moved, p_m = moved_points(flight, file, chunk, mounting, correct)
    xyz[moved] = file.grid.from_geodetic(*flight.frame.to_geodetic(p_m[moved]))
    chunk.x, chunk.y, chunk.z = xyz.T


def moved_points(
    flight: Flight, file: StripFile, chunk, mounting: Mounting, correct: Correct | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Which records of ``chunk`` are rays, (N,) bool, and where these go, (N, 3) m, m-frame of the
    flight (heights as in the file)."""
    decoder = flight.decoder
    rays = decoder.decode(file, file.decoded(chunk))
    pose = rays.pose
    if correct is not None:
        pose = pose.copy()
        pose[rays.timed] = correct(rays.time[rays.timed], pose[rays.timed])
    seen = Rays(pose, rays.ring, rays.azimuth, rays.elevation, rays.rho)
    p_m = georeference(seen, _for_all_rings(mounting, flight.survey.scanner.n_rings))
    return rays.timed & ray_test.is_return(rays.rho), p_m - decoder.shift


def _for_all_rings(mounting: Mounting, n_rings: int) -> Mounting:
    """With offsets of zero for rings that are no beam."""
    more = ray_test.UNKNOWN_RING + 1 - n_rings
    ranges, beams = mounting.offsets(n_rings)[:n_rings], mounting.beam_offsets
    return replace(
        mounting,
        range_offsets=np.pad(ranges, (0, more)),
        beam_offsets=None if beams is None else np.pad(beams, ((0, more), (0, 0))),
    )
