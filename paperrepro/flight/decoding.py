"""Records of a file to rays: one clock, one frame, a pose for each, and back to the laser."""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from paperrepro.errors import BadInput, EmptyStrip, OutsideTrajectory
from paperrepro.flight import flight_lines, ray_test, sbet
from paperrepro.flight.geodesy import Grid, LocalFrame
from paperrepro.flight.hypotheses import StripSample
from paperrepro.flight.las import Records
from paperrepro.flight.sbet import Clock
from paperrepro.flight.table import PointPoses
from paperrepro.survey import Mounting, Strip, Trajectory

#: Times further outside of the trajectory than this, s, are no times of this flight; so few of a
#: file's points may have one, as a share.
STRAY, STRAY_SHARE = 10.0, 0.01
#: So few points of a file may have a ring that is no beam, as a share.
UNKNOWN_SHARE = 0.001
#: Steps that times are rounded to, s.
TIME_STEPS = (1.0, 0.1, 0.01, 0.001)


@dataclass(frozen=True)
class Decoder:
    """How records become rays. ``mounting``: the nominal one; ``poses``: a trajectory, or columns
    of each record; ``clocks`` by file, to the trajectory's time; ``shift`` (3,) m added to all
    points; ``beam_of_ring``: number of the beam for a recorded ring, None where there are no rings;
    ``time_shift`` s."""

    frame: LocalFrame
    mounting: Mounting
    poses: Trajectory | PointPoses
    clocks: Mapping[Path, Clock]
    beam_of_ring: np.ndarray | None
    time_shift: float = 0.0
    shift: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def decode(self, file, records: Records) -> "Decoded":
        """`Decoded` of the records. Raises `OutsideTrajectory`, `BadInput`."""
        time = self.clocks[file.path](records.time) + self.time_shift
        with np.errstate(invalid="ignore"):
            p_m = local_points(file.grid, records.xyz, self.frame) + self.shift
        timed = np.ones(len(time), bool)
        if isinstance(self.poses, Trajectory):
            timed = is_flight_time(time, self.poses.time)
            whole = np.zeros((len(time), 6))
            if timed.all():
                whole = self.poses.at(time, str(file.path))
            elif timed.any():
                whole[timed] = self.poses.at(time[timed], str(file.path))
        else:
            whole = self.poses.of(records.columns, file.grid)
        if not np.isfinite(p_m).all():  # where its map does not reach
            p_m = np.where(np.isfinite(p_m), p_m, 1e9)
        azimuth, elevation, rho = ray_test.laser_rays(whole, p_m, self.mounting)
        if self.beam_of_ring is None:
            beam = np.zeros(len(time), np.uint8)
            return Decoded(time, whole, beam, azimuth, elevation, rho, timed)
        known = records.ring < len(self.beam_of_ring)
        beam = np.where(
            known, self.beam_of_ring[np.where(known, records.ring, 0)], ray_test.UNKNOWN_RING
        )
        return Decoded(time, whole, beam.astype(np.uint8), azimuth, elevation, rho, timed)


@dataclass(frozen=True)
class Decoded:
    """Rays of N records; ``timed``: with a pose; ``ring``: beam or `UNKNOWN_RING`."""

    time: np.ndarray
    pose: np.ndarray
    ring: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray
    rho: np.ndarray
    timed: np.ndarray

    @property
    def lost(self) -> dict[str, np.ndarray]:
        """Records (N,) bool that are no rays, by why, each under the first that holds."""
        no_return = self.timed & (self.rho < ray_test.NEAREST)
        far = self.timed & (self.rho > ray_test.FARTHEST)
        unknown = self.timed & ~no_return & ~far & (self.ring == ray_test.UNKNOWN_RING)
        return {
            "have a time outside of the flight": ~self.timed,
            "lie at the sensor, pulses without a return": no_return,
            "lie kilometres away from the sensor": far,
            "have a ring that is no beam": unknown,
        }


def is_flight_time(time: np.ndarray, flown: np.ndarray) -> np.ndarray:
    """(N,) bool: not far outside of the trajectory's times ``flown`` (M,) s."""
    return (time > flown[0] - STRAY) & (time < flown[-1] + STRAY)


def local_points(grid: Grid, xyz: np.ndarray, frame: LocalFrame) -> np.ndarray:
    """(N, 3) m, m-frame, of coordinates on the map."""
    return frame.from_geodetic(*grid.to_geodetic(xyz))


def sampled(file, timed: bool = True) -> Records:
    """A sample of a file's records; its clock must run. Raises `BadInput`, `EmptyStrip`."""
    parts = [file.decoded(chunk) for chunk in file.sample() if len(chunk)]
    if not parts:
        raise EmptyStrip(f"{file.path}: every point is withheld or noise; leave the strip out")
    columns = {
        name: np.concatenate([np.asarray(part.columns[name]) for part in parts])
        for name in file.columns
    }
    time, ring, xyz = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("time", "ring", "xyz")
    )
    finite = time[np.isfinite(time)]
    if timed and (len(finite) < (1 - STRAY_SHARE) * len(time) or np.ptp(finite) == 0):
        raise BadInput(
            f"{file.path}: expected a GPS time per point, gps_time is {time[0]:g} for all; export "
            "the strip with its times"
        )
    return Records(time, ring, xyz, columns)


def require_rings(files: list, records: list[Records]) -> None:
    """Raise `BadInput` for a file whose points have one ring only."""
    for file, found in zip(files, records, strict=True):
        if np.ptp(found.ring) == 0:
            raise BadInput(
                f"{file.path}: expected the ring of each point, it is {found.ring[0]} for all; "
                "name the dimension that holds it with --ring-dimension, or say that the scanner "
                "has no rings: --scanner line or any, or kind in [scanner] of the mounting"
            )


def strip_sample(file, records: Records, clock: Clock, flown: np.ndarray) -> StripSample:
    """A file's sample for the tests, without the few times that are none of this flight."""
    time = clock(records.time)
    timed = is_flight_time(time, flown)
    if (~timed).mean() > STRAY_SHARE:  # then all is wrong, not some
        timed = np.isfinite(time)
    return StripSample(
        str(file.path), file.grid, time[timed], records.ring[timed], records.xyz[timed],
        _scale(file, records), time_step(records.time),
    )  # fmt: skip


def _scale(file, records: Records) -> float:
    """How fine a file's coordinates are, m."""
    latitude = float(np.median(file.grid.to_geodetic(records.xyz)[0]))
    return file.grid.metres(np.array([_step(column) for column in records.xyz.T]), latitude)


def _step(values: np.ndarray) -> float:
    """What values are multiples of: the least difference of many."""
    steps = np.diff(np.unique(values))
    return float(steps.min()) if len(steps) else 0.0


def time_step(time: np.ndarray) -> float:
    """What times (N,) s are multiples of, where it is one of `TIME_STEPS` or the resolution of
    single precision; else 0."""
    time = time[np.abs(time) < 1e12]
    single = time.astype(np.float32)
    if len(time) and (single == time).all():
        return float(np.spacing(np.abs(single).max()))
    for step in TIME_STEPS:
        if np.abs(time / step - np.round(time / step)).max(initial=0.0) < 1e-6 / step:
            return step
    return 0.0


def fits_of_poses(
    files: list,
    records: list[Records],
    frame: LocalFrame,
    candidates: Mapping[Hashable, PointPoses],
    mounting: Mounting,
    beams: bool = True,
) -> dict[Hashable, ray_test.Fit]:
    """How the rays fit where each point carries its pose, for each way to read its attitude."""
    both = list(zip(files, records, strict=True))
    points = np.concatenate([local_points(f.grid, r.xyz, frame) for f, r in both])
    rings = np.concatenate([r.ring for r in records])
    sample = ray_test.Sample(points, rings, max(_scale(f, r) for f, r in both), beams)
    fits = {}
    for word, poses in candidates.items():
        pose = [poses.of(r.columns, f.grid) for f, r in both]
        fits[word] = ray_test.fit(np.concatenate(pose), sample, mounting)
    return fits


def read_strip(
    decoder: Decoder, file, done: Callable[[int], None] | None = None
) -> tuple[Strip, list[str]]:
    """All usable points of a file, in order of time, and notes on those that are left out; ``done``
    is told how many were read. Range is float32 (4 um at 100 m): 21 bytes a point, held once.
    Raises `BadInput`, `OutsideTrajectory`."""
    columns, lost, n, end = [], {}, 0, 0
    posed = isinstance(decoder.poses, PointPoses)
    for chunk in file.chunks(done=done):
        records = file.decoded(file.usable(chunk))
        if not len(records.time):
            continue
        rays = decoder.decode(file, records)
        kept, n = np.ones(len(rays.time), bool), n + len(rays.time)
        for why, which in rays.lost.items():
            kept &= ~which
            lost[why] = lost.get(why, 0) + int(which.sum())
        found = [rays.time, rays.ring, rays.azimuth, rays.rho.astype(np.float32)]
        found += [rays.pose] if posed else []
        found += [rays.elevation.astype(np.float32)] if decoder.beam_of_ring is None else []
        columns = columns or [np.empty((file.count, *f.shape[1:]), f.dtype) for f in found]
        rows = slice(end, end := end + int(kept.sum()))
        for column, values in zip(columns, found, strict=True):
            column[rows] = values[kept]
    stray, *_, unknown = lost.values()
    if stray > STRAY_SHARE * n:
        raise OutsideTrajectory(
            f"{file.path}: {stray} of {n} points have a time outside of the trajectory; give the "
            "trajectory of this flight, whole, or export the strip with its times"
        )
    if unknown > UNKNOWN_SHARE * n:
        raise BadInput(
            f"{file.path}: {unknown} points have rings that no other strip's sample shows; name "
            "the right dimension with --ring-dimension"
        )
    columns = [column[:end] for column in columns]
    names = ("time", "ring", "azimuth", "rho", *["pose"] * posed, "elevation")
    named = dict(zip(names, _by_time(columns), strict=False))
    strip = Strip(_name_of(file.path), **named)
    notes = [
        f"{file.path}: {count} of {n} points ({100 * count / n:.2g} %) {why}; they are left out"
        for why, count in lost.items()
        if count
    ]
    if not len(strip):
        raise EmptyStrip(f"{notes[0]}: nothing remains; leave the strip out")
    return strip.check(), notes


def _by_time(columns: list[np.ndarray]) -> list[np.ndarray]:
    """Columns of points in order of their times, the first one; empties the list, so that no two
    columns are held twice."""
    if not (columns[0][1:] < columns[0][:-1]).any():
        return columns
    order = np.argsort(columns[0], kind="stable")
    return [columns.pop(0)[order] for _ in range(len(columns))]


def _name_of(path: Path) -> str:
    """The strip's name, as text that can be written."""
    return path.stem.encode("utf-8", "replace").decode("utf-8")


def poses_at(decoder: Decoder, strip: Strip) -> Callable[[np.ndarray], np.ndarray]:
    """Poses (K, 6) of the strip's points at indices (K,)."""
    if strip.pose is not None:
        return lambda index: strip.pose[index]
    return lambda index: decoder.poses.at(strip.time[index], strip.name)


def with_finer_times(strip: Strip) -> Strip:
    """The strip, one flight line, with times from the sensor's place along it; in their order."""
    time = flight_lines.finer_times(strip.time, strip.pose[:, :3])
    order = np.argsort(time, kind="stable")
    return replace(strip, time=time).take(order)


def clocks_of(files: list, records: list[Records], flown: np.ndarray) -> dict[Path, Clock]:
    """A clock for each file, to a trajectory with times ``flown`` (M,) s as written."""
    return {
        file.path: sbet.clock_to(flown, record.time)
        for file, record in zip(files, records, strict=True)
    }
