"""A text table of points with poses (CSV): the paper's record.

Each row is a point with its pose, as in the paper's record. Columns are known by name, in any
order and without prefixes such as ``Sensor``: x, y, z on the map; latitude, longitude, elevation
(ellipsoidal height of the sensor); roll, pitch, heading; the ring from ``ring`` (or the ring
dimension named) or from ``vertical_angle``, one for all where there is none; ``gps_time`` or
``time`` where there is one. Angles
are in the unit that a name's suffix tells (``Rads``); where none does, the rays tell it, and
always what the heading counts from (`READINGS`).
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from paperrepro.errors import BadInput, EmptyStrip
from paperrepro.flight.geodesy import Grid, LocalFrame
from paperrepro.flight.las import CHUNK, SAMPLE, Records

SUFFIXES = (".csv", ".txt")
RINGS = ("ring", "laser_id", "laserid", "user_data", "beam", "channel")
ANGLES = ("vertical_angle", "vertical_angle_deg", "verticalangle", "vertical", "vertical_angle_rad")
TIMES = ("gps_time", "gpstime", "time")
#: Without a time, rows are taken as pulses of the paper's scanner, 1/s.
PULSES = 300_000.0


@dataclass(frozen=True)
class TableFile:
    """A table whose head was checked; as `las.StripFile`."""

    path: Path
    grid: Grid
    ring: str | None
    time: str | None
    count: int
    columns: tuple[str, ...]
    notes: tuple[str, ...] = ()
    hindrance: str = "only LAS and LAZ can be written; give the strip as one"

    def chunks(
        self, size: int = CHUNK, done: Callable[[int], None] | None = None
    ) -> Iterator[pd.DataFrame]:
        """All rows in order; ``done`` is told how many were dealt with."""
        for chunk in _chunks(self.path, size):
            yield chunk
            if done:
                done(len(chunk))

    def sample(self) -> Iterator[pd.DataFrame]:
        """Some `SAMPLE` rows, evenly spread."""
        every = max(1, self.count // SAMPLE)
        for chunk in self.chunks():
            yield chunk[chunk.index % every == 0]

    @staticmethod
    def usable(chunk: pd.DataFrame) -> pd.DataFrame:
        """All rows: a table marks none as noise."""
        return chunk

    def decoded(self, chunk: pd.DataFrame) -> Records:
        """The columns that matter of ``chunk``."""
        ring = np.zeros(len(chunk)) if self.ring is None else chunk[self.ring].to_numpy(float)
        if self.ring in ANGLES:  # hundredths of a degree from straight down name a beam
            in_radians = self.ring.endswith("rad") or np.abs(ring).max() < 0.8
            ring = np.round(100 * (90 + (np.degrees(ring) if in_radians else ring)))
        time = chunk.index.to_numpy() / PULSES if self.time is None else chunk[self.time].to_numpy()
        xyz = chunk[["x", "y", "z"]].to_numpy(float)
        return Records(time.astype(float), ring.astype(np.int64), xyz, chunk)


def open_table(path: Path, crs: str | None, ring_dimension: str = "user_data") -> TableFile:
    """Check a table's columns and numbers. Raises `BadInput`, `EmptyStrip`."""
    path = Path(path)
    if not path.is_file():
        raise BadInput(f"{path}: no such file; give the strips as LAS, LAZ or CSV")
    if crs is None:
        raise BadInput(f"{path}: a table names no reference system; name it with --crs")
    count, names = 0, ()
    for chunk in _chunks(path, CHUNK):
        names = tuple(chunk.columns)
        _require_columns(names, path)
        if chunk.empty:
            break
        _require_numbers(chunk, path)
        count += len(chunk)
    if not count:
        raise EmptyStrip(f"{path}: expected points, the table holds none; leave it out")
    ring = next((n for n in (ring_dimension, *RINGS, *ANGLES) if n in names), None)
    time = next((name for name in TIMES if name in names), None)
    return TableFile(path, Grid(crs, "--crs"), ring, time, count, names)


def read_points(path: str | Path) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names, coordinates (K, 3) and standard deviations (K,) m of surveyed points: a table with
    columns name, x, y, z, sigma. Raises `BadInput`."""
    path = Path(path)
    if not path.is_file():
        raise BadInput(f"{path}: no such file; give points as a table of name, x, y, z, sigma")
    parts = list(_chunks(path, CHUNK))
    table = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()
    columns = ["name", "x", "y", "z", "sigma"]
    missing = [name for name in columns if name not in table]
    if missing or table.empty:
        what = f"{', '.join(missing)} missing" if missing else "no row in it"
        raise BadInput(f"{path}: expected columns {', '.join(columns)} in the head line and a row "
                       f"for each point, {what}; write them")  # fmt: skip
    names = [str(name).strip() for name in table["name"]]
    for name in names:
        if names.count(name) > 1 or not name:
            raise BadInput(f"{path}: name {name!r}: expected one for each point; rename it")
    numbers = table[columns[1:]]
    _require_numbers(numbers, path)
    numbers = numbers.to_numpy(float)
    if not (numbers[:, 3] > 0).all():
        worst = int(np.argmin(numbers[:, 3]))
        raise BadInput(f"{path}: sigma of {names[worst]}: expected metres above 0, got "
                       f"{numbers[worst, 3]:g}; give its standard deviation")  # fmt: skip
    return names, numbers[:, :3], numbers[:, 3]


def _chunks(path: Path, size: int) -> Iterator[pd.DataFrame]:
    try:
        for chunk in pd.read_csv(path, chunksize=size, skipinitialspace=True):
            chunk.columns = [str(name).strip().lower().replace(" ", "_") for name in chunk.columns]
            yield chunk
    except (ValueError, OSError) as error:  # pandas' own errors are ValueErrors
        why = (str(error).split("\n") or [type(error).__name__])[0]
        raise BadInput(f"{path}: expected a table with a head line, {why}; export it") from error


def _require_columns(names: tuple[str, ...], path: Path) -> None:
    missing = [name for name in "xyz" if name not in names]
    if missing:
        raise BadInput(
            f"{path}: expected columns x, y, z in the head line, {', '.join(missing)} missing of "
            f"{', '.join(names)}; name them so"
        )


def _require_numbers(chunk: pd.DataFrame, path: Path) -> None:
    for name in chunk.columns:
        values = pd.to_numeric(chunk[name], errors="coerce").to_numpy(float)
        if not np.isfinite(values).all():
            row = int(chunk.index[np.flatnonzero(~np.isfinite(values))[0]])
            raise BadInput(f"{path}: column {name}, row {row + 1}: expected a number; correct it")


PREFIXES = ("sensor", "scanner", "platform", "imu", "ins", "pose", "beamorigin")
DEGREE = np.pi / 180
ANGLE_SUFFIXES = {"rads": 1.0, "rad": 1.0, "radians": 1.0, "degs": DEGREE, "deg": DEGREE,
            "degrees": DEGREE}  # fmt: skip
ON_THE_MAP = (("x", "easting", "east"), ("y", "northing", "north"), ("z", "height", "h", "up"))
GEODETIC = (
    ("latitude", "lat"),
    ("longitude", "lon", "lng"),
    ("elevation", "height", "altitude", "ellipsoidalheight", "ellipsoidheight", "hell", "h"),
)
ATTITUDE = (("roll",), ("pitch",), ("heading", "yaw"))
#: How an attitude may be written, in words and as signs of heading and pitch, its start rad, and
#: whether it refers to the map's grid north. The first is an SBET's.
READINGS = {
    "": (1.0, 0.0, 1.0, False),
    "clockwise from grid north": (1.0, 0.0, 1.0, True),
    "counter-clockwise from east, the pitch as nose down": (-1.0, np.pi / 2, -1.0, False),
    "counter-clockwise from the grid's east, the pitch as nose down": (-1, np.pi / 2, -1.0, True),
    "clockwise from north, the pitch as nose down": (1.0, 0.0, -1.0, False),
    "clockwise from grid north, the pitch as nose down": (1.0, 0.0, -1.0, True),
}


@dataclass(frozen=True)
class PoseColumns:
    """Names of the columns: ``position`` (3), on the map or ``geodetic``, and ``attitude`` (3);
    ``units``, in rad, that the attitude may be in: one where the names tell, else both."""

    position: tuple[str, str, str]
    geodetic: bool
    attitude: tuple[str, str, str]
    units: tuple[float, ...]

    def read(self, record, grid: Grid):
        """Latitude, longitude rad, height m (N,) and attitude (N, 3) as written."""
        values = np.column_stack([np.asarray(record[name], float) for name in self.position])
        attitude = np.column_stack([np.asarray(record[name], float) for name in self.attitude])
        if not self.geodetic:
            return (*grid.to_geodetic(values), attitude)
        latitude, longitude, height = values.T
        degrees = max(np.abs(latitude).max() / (np.pi / 2), np.abs(longitude).max() / np.pi) > 1
        unit = DEGREE if degrees else 1.0
        return latitude * unit, longitude * unit, height, attitude


def pose_columns(names: Iterable[str], of_points: bool = True) -> PoseColumns | None:
    """The columns that hold poses, or None where they are not all there; ``of_points``, whose own
    coordinates x, y, z are, or of a trajectory."""
    known = {plain(name): name for name in names}
    attitude = _all_of(known, ATTITUDE)
    for kind in (ON_THE_MAP, GEODETIC) if of_points else (GEODETIC, ON_THE_MAP):
        position = _all_of(known, kind, prefixed=of_points and kind is ON_THE_MAP)
        if position and attitude:
            named = [u for end, u in ANGLE_SUFFIXES.items() if plain(attitude[0]).endswith(end)]
            units = (named[0],) if named else (1.0, DEGREE)
            return PoseColumns(position, kind is GEODETIC, attitude, units)
    return None


def plain(name: str) -> str:
    """A name's letters and digits, small."""
    return "".join(c for c in name.lower() if c.isalnum())


def _all_of(known: dict[str, str], wanted, prefixed: bool = False) -> tuple[str, ...] | None:
    """The column of each of ``wanted``, bare or ``prefixed`` (the points' own x, y, z are bare)."""
    starts = PREFIXES if prefixed else ("", *PREFIXES)
    ends = ("", *ANGLE_SUFFIXES)
    found = [
        next(
            (known[s + n + e] for n in names for s in starts for e in ends if s + n + e in known),
            None,
        )
        for names in wanted
    ]
    return tuple(found) if all(found) else None


@dataclass(frozen=True)
class PointPoses:
    """Poses of points in the m-frame of ``frame``, their attitude read as ``reading`` of
    `READINGS` in ``unit`` rad."""

    columns: PoseColumns
    frame: LocalFrame
    reading: str = ""
    unit: float = 1.0

    def of(self, record, grid: Grid) -> np.ndarray:
        """(N, 6) of the records. Raises `BadInput` for NaN."""
        latitude, longitude, height, written = self.columns.read(record, grid)
        if not np.isfinite(written).all() or not np.isfinite(latitude + longitude + height).all():
            raise BadInput("poses hold NaN or infinity; drop such points")
        turn, start, nose, of_grid = READINGS[self.reading]
        written = written * self.unit
        heading = start + turn * written[:, 2]
        if of_grid:
            heading = heading + grid.convergence(latitude, longitude)
        attitude = np.column_stack([written[:, 0], nose * written[:, 1], heading])
        return np.column_stack(
            [
                self.frame.from_geodetic(latitude, longitude, height),
                self.frame.attitude_from_level(latitude, longitude, attitude),
            ]
        )
