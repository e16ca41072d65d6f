"""Records of a file to rays: one clock, one frame, a pose for each, and back to the laser.

Do strips and trajectory lie at one place? If not: what would bring them together?
"""

from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from paperrepro.errors import BadInput, EmptyStrip, OutsideTrajectory
from paperrepro.flight import flight_lines, ray_test, sbet
from paperrepro.flight.geodesy import Grid, LocalFrame
from paperrepro.flight.las import Records
from paperrepro.flight.sbet import Poses
from paperrepro.flight.table import PointPoses
from paperrepro.survey import Mounting, Strip, Trajectory

UP = np.array([0.0, 0.0, 1.0])
#: Marks a recorded ring that is no beam.
UNKNOWN_RING = 255


@dataclass(frozen=True)
class Decoder:
    """How records become rays. ``mounting``: the nominal one; ``poses``: a trajectory, or columns
    of each record; ``clocks`` by file, s added to its times; ``time_shift`` s and ``height_shift``
    m added to all; ``beam_of_ring``: number of the beam for a recorded ring."""

    frame: LocalFrame
    mounting: Mounting
    poses: Trajectory | PointPoses
    clocks: Mapping[Path, float]
    time_shift: float
    height_shift: float
    beam_of_ring: np.ndarray

    def locate(self, file, records: Records) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Time (N,) s, points (N, 3) m and poses (N, 6), m-frame. Raises `OutsideTrajectory`."""
        time = records.time + (self.clocks[file.path] + self.time_shift)
        p_m = local_points(file.grid, records.xyz, self.frame) + self.height_shift * UP
        if isinstance(self.poses, Trajectory):
            return time, p_m, self.poses.at(time, str(file.path))
        return time, p_m, self.poses.of(records.columns, file.grid)

    def beams(self, file, ring: np.ndarray) -> np.ndarray:
        """(N,) uint8 number of the beam, or `UNKNOWN_RING`."""
        known = ring < len(self.beam_of_ring)
        return np.where(known, self.beam_of_ring[np.where(known, ring, 0)], np.uint8(UNKNOWN_RING))


def local_points(grid: Grid, xyz: np.ndarray, frame: LocalFrame) -> np.ndarray:
    """(N, 3) m, m-frame, of coordinates on the map."""
    return frame.from_geodetic(*grid.to_geodetic(xyz))


def trajectories(poses: Poses, frame: LocalFrame, grid: Grid) -> dict[str, Trajectory]:
    """The trajectory in the m-frame, times from the start of the GPS week: under the empty name as
    an SBET's heading is meant, else under what it may mean."""
    headings = {
        "": 0.0,
        "clockwise from grid north": grid.convergence(poses.latitude, poses.longitude),
    }
    if np.abs(poses.wander).max() > 1e-6:
        headings["against the wander frame, whose angle is taken off"] = -poses.wander
    position = frame.from_geodetic(poses.latitude, poses.longitude, poses.height)
    time = poses.time + sbet.week_start(poses.time)
    out = {}
    for word, more in headings.items():
        attitude = poses.attitude.copy()
        attitude[:, 2] += more
        attitude = frame.attitude_from_level(poses.latitude, poses.longitude, attitude)
        out[word] = Trajectory(time, position, attitude)
    return out


def sample_of(
    files: list, frame: LocalFrame, poses: Poses, flown: str
) -> tuple[dict[Path, float], ray_test.Sample]:
    """Points of all files, one clock for all. Raises `BadInput` where times, rings or places show
    that the files do not belong together."""
    clocks, parts = {}, []
    for file in files:
        records = _sampled(file)
        require_near(str(file.path), file.grid, records.xyz, poses, flown)
        clocks[file.path] = sbet.offset_to(poses.time, records.time)
        p_m = local_points(file.grid, records.xyz, frame)
        parts.append((records.time + clocks[file.path], p_m, records.ring))
    columns = map(np.concatenate, zip(*parts, strict=True))
    return clocks, ray_test.Sample(*columns, max(file.scale for file in files), frame.height)


def fits_of_poses(
    files: list, frame: LocalFrame, candidates: Mapping[Hashable, PointPoses], mounting: Mounting
) -> dict[Hashable, ray_test.Fit]:
    """How the rays fit where each point carries its pose, for each way to read its attitude."""
    records = [_sampled(file, timed=False) for file in files]
    points = [local_points(f.grid, r.xyz, frame) for f, r in zip(files, records, strict=True)]
    columns = [np.concatenate([getattr(r, name) for r in records]) for name in ("time", "ring")]
    sample = ray_test.Sample(
        columns[0], np.concatenate(points), columns[1], max(file.scale for file in files)
    )
    fits = {}
    for word, poses in candidates.items():
        pose = [poses.of(r.columns, f.grid) for f, r in zip(files, records, strict=True)]
        fits[word] = ray_test.fit(np.concatenate(pose), sample, mounting)
    return fits


def _sampled(file, timed: bool = True) -> Records:
    """A sample of a file's records; its clock must run and its rings differ."""
    chunks = list(file.sample())
    parts = [file.decoded(chunk) for chunk in chunks if len(chunk)]
    if not parts:
        raise EmptyStrip(f"{file.path}: every point is withheld or noise; leave the strip out")
    columns = {
        name: np.concatenate([np.asarray(part.columns[name]) for part in parts])
        for name in file.columns
    }
    time, ring, xyz = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("time", "ring", "xyz")
    )
    if timed and (not np.isfinite(time).all() or np.ptp(time) == 0):
        raise BadInput(
            f"{file.path}: expected a GPS time per point, gps_time is {time[0]:g} for all; export "
            "the strip with its times"
        )
    if np.ptp(ring) == 0:
        raise BadInput(
            f"{file.path}: expected the ring of each point, it is {ring[0]} for all; name the "
            "dimension that holds it with --ring-dimension"
        )
    return Records(time, ring, xyz, columns)


def read_strip(decoder: Decoder, file) -> Strip:
    """All usable points of a file, in its order. Range is float32 (4 um at 100 m): 21 bytes a
    point. Raises `BadInput`, `OutsideTrajectory`."""
    parts, unknown = [], 0
    for chunk in file.chunks():
        records = file.decoded(file.usable(chunk))
        if not len(records.time):
            continue
        time, p_m, pose = decoder.locate(file, records)
        ring = decoder.beams(file, records.ring)
        azimuth, _, rho = ray_test.laser_rays(pose, p_m, decoder.mounting)
        kept = ring != UNKNOWN_RING
        unknown += len(kept) - int(kept.sum())
        columns = [time, ring, azimuth, rho.astype(np.float32)]
        columns += [pose] if isinstance(decoder.poses, PointPoses) else []
        parts.append([column[kept] for column in columns])
    strip = Strip(file.path.stem, *map(np.concatenate, zip(*parts, strict=True)))
    if unknown > 0.001 * len(strip):
        raise BadInput(
            f"{file.path}: {unknown} points have rings that no other strip's sample shows; name "
            "the right dimension with --ring-dimension"
        )
    return strip.check()


def poses_at(decoder: Decoder, strip: Strip) -> Callable[[np.ndarray], np.ndarray]:
    """Poses (K, 6) of the strip's points at indices (K,)."""
    if strip.pose is not None:
        return lambda index: strip.pose[index]
    return lambda index: decoder.poses.at(strip.time[index], strip.name)


def with_finer_times(strip: Strip) -> Strip:
    """The strip, one pass, with times from the sensor's place along the line; in their order.
    Raises `OutsideTrajectory` where it has no poses to tell them."""
    if strip.pose is None:
        raise OutsideTrajectory(
            f"{strip.name}: its times are whole seconds, too coarse to find a pose in the "
            "trajectory; export the strip with full GPS times"
        )
    time = flight_lines.finer_times(strip.time, strip.pose[:, :3])
    order = np.argsort(time, kind="stable")
    return replace(strip, time=time).take(order)


#: Points lie within this of the trajectory, m, in plan and in height.
NEAR, STEEP = 2000.0, 1000.0
FOOT = 0.3048


def require_near(name: str, grid: Grid, xyz: np.ndarray, poses: Poses, flown: str) -> None:
    """Raise `BadInput` where points (N, 3) of the map lie far from the trajectory's poses."""
    middle = np.median(xyz, axis=0)
    plan, height = _apart(grid, middle, poses.latitude, poses.longitude, poses.height)
    if plan <= NEAR and abs(height) <= STEEP:
        return
    far = f"{plan / 1000:.1f} km in plan and {abs(height):.0f} m in height"
    for where, what in _explanations(name, flown, grid, middle, poses):
        raise BadInput(f"{where}: lies {far} away from the other file: {what}")
    raise BadInput(
        f"{name}: lies {far} from {flown}; give the trajectory of this flight and the reference "
        f"system of the strips (now {grid.name}; --crs overrides it)"
    )


def _apart(grid: Grid, middle, latitude, longitude, height) -> tuple[float, float]:
    """Distance in plan, and height of the trajectory above the points, m, at its nearest pose."""
    try:
        at = grid.to_geodetic(np.asarray(middle, float)[None])
    except BadInput:
        return np.inf, np.inf
    if not np.isfinite(at).all():
        return np.inf, np.inf
    frame = LocalFrame(*(float(value[0]) for value in at), *grid.shape)
    few = slice(None, None, max(1, len(latitude) // 2000))
    local = frame.from_geodetic(latitude[few], longitude[few], height[few])
    plan = np.hypot(local[:, 0], local[:, 1])
    nearest = int(plan.argmin())
    return float(plan[nearest]), float(local[nearest, 2])


def _explanations(name, flown, grid: Grid, middle, poses: Poses) -> Iterator[tuple[str, str]]:
    latitude, longitude, height = poses.latitude, poses.longitude, poses.height
    turned = {
        "its latitude and longitude are interchanged; write latitude first": (longitude, latitude),
        "its latitude has the wrong sign; south is negative": (-latitude, longitude),
        "its longitude has the wrong sign; west is negative": (latitude, -longitude),
        "both of its signs are wrong; south and west are negative": (-latitude, -longitude),
    }
    for what, (lat, lon) in turned.items():
        if np.abs(lat).max() <= np.pi / 2 and _near(grid, middle, lat, lon, height):
            yield flown, what
    for scale, part in (
        ([FOOT] * 3, "points"),
        ([1, 1, FOOT], "heights"),
        ([FOOT, FOOT, 1], "x, y"),
    ):
        if _near(grid, middle * scale, latitude, longitude, height):
            yield name, f"its {part} are in feet; export it in metres, or with the right --crs"
    for zones in range(-59, 60) if grid.crs.is_projected else ():
        if zones and _near(grid, middle, latitude, longitude - np.radians(6.0 * zones), height):
            yield (
                name,
                (
                    f"its zone is {abs(zones)} {'east' if zones > 0 else 'west'} of that of "
                    f"{grid.name}; name the right one with --crs"
                ),
            )


def _near(grid: Grid, middle, latitude, longitude, height) -> bool:
    plan, above = _apart(grid, middle, latitude, longitude, height)
    return plan <= NEAR and abs(above) <= STEEP
