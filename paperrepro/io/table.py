"""A text table of points with poses (CSV): the paper's record.

Columns by name, in any order: x, y, z on the map; latitude, longitude, elevation (ellipsoidal
height of the sensor); roll, pitch, heading. The ring from ``ring`` (or the ring dimension named),
or from ``vertical_angle`` in degrees, or radians if its name or its size say so. ``gps_time`` or
``time`` where there is one.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from paperrepro.errors import BadInput, EmptyStrip
from paperrepro.io.geodesy import Grid
from paperrepro.io.las import CHUNK, SAMPLE, Records

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
    ring: str
    time: str | None
    count: int
    low: np.ndarray
    high: np.ndarray
    columns: tuple[str, ...]
    scale: float = 1e-3

    def chunks(self, size: int = CHUNK) -> Iterator[pd.DataFrame]:
        """All rows in order."""
        yield from _chunks(self.path, size)

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
        ring = chunk[self.ring].to_numpy(float)
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
    count, low, high, names = 0, np.full(3, np.inf), np.full(3, -np.inf), ()
    for chunk in _chunks(path, CHUNK):
        names = tuple(chunk.columns)
        _require_columns(names, path)
        if chunk.empty:
            break
        _require_numbers(chunk, path)
        xyz = chunk[["x", "y", "z"]].to_numpy(float)
        low, high = np.minimum(low, xyz.min(axis=0)), np.maximum(high, xyz.max(axis=0))
        count += len(chunk)
    if not count:
        raise EmptyStrip(f"{path}: expected points, the table holds none; leave it out")
    ring = next((n for n in (ring_dimension, *RINGS, *ANGLES) if n in names), None)
    if ring is None:
        raise BadInput(
            f"{path}: expected a column ring or vertical_angle, it has {', '.join(names)}; "
            "add one, or name it with --ring-dimension"
        )
    time = next((name for name in TIMES if name in names), None)
    return TableFile(path, Grid(crs, "--crs"), ring, time, count, low, high, names)


def _chunks(path: Path, size: int) -> Iterator[pd.DataFrame]:
    try:
        for chunk in pd.read_csv(path, chunksize=size, skipinitialspace=True):
            chunk.columns = [str(name).strip().lower().replace(" ", "_") for name in chunk.columns]
            yield chunk
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: expected a table with a head line, {error}; export it") from error


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
