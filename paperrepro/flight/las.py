"""LAS and LAZ strips, read in chunks, with a word on whatever a calibration cannot use."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import laspy
import lazrs
import numpy as np

from paperrepro.errors import BadInput, EmptyStrip
from paperrepro.flight.geodesy import Grid

#: Points at a time: bounds the transient memory to about 200 MB.
CHUNK = 1_000_000
#: ASPRS classes that are no target: low and high noise.
NOISE = (7, 18)
#: Points that a sample of a strip holds, about.
SAMPLE = 20_000
READ_ERRORS = (laspy.LaspyException, lazrs.LazrsError, ValueError, EOFError, OSError, IndexError,
               MemoryError, OverflowError)  # fmt: skip


@dataclass(frozen=True)
class StripFile:
    """A strip on disk whose header was checked: ``grid`` of its coordinates, ``count`` points,
    ``scale`` m (its coarsest), ``low`` and ``high`` (3,) corners of its coordinates,
    names of all ``columns``."""

    path: Path
    grid: Grid
    ring_dimension: str
    count: int
    scale: float
    low: np.ndarray
    high: np.ndarray
    columns: tuple[str, ...]

    def chunks(self, size: int = CHUNK) -> Iterator[laspy.ScaleAwarePointRecord]:
        """All records in order. Raises `BadInput` where the file ends too early."""
        seen = 0
        with opened(self.path) as reader:
            while seen < self.count:
                chunk = _read(reader, min(size, self.count - seen), self.path, seen)
                seen += len(chunk)
                yield chunk

    def sample(self) -> Iterator[laspy.ScaleAwarePointRecord]:
        """Some `SAMPLE` usable records, evenly spread; reads the whole file. Raises as `chunks`."""
        every, start = max(1, self.count // SAMPLE), 0
        for chunk in self.chunks():
            part = chunk[np.arange(-start % every, len(chunk), every)]
            start += len(chunk)
            yield self.usable(part)

    @staticmethod
    def usable(chunk) -> laspy.ScaleAwarePointRecord:
        """The records that are neither withheld nor noise nor a repeat of the one before.

        In dual-return mode a scanner may report one echo twice, as strongest and as last.
        """
        kept = ~np.isin(np.asarray(chunk.classification), NOISE)
        if "withheld" in chunk.point_format.dimension_names:
            kept &= np.asarray(chunk.withheld) == 0
        columns = (chunk.X, chunk.Y, chunk.Z, chunk.gps_time)
        same = np.all([column[1:] == column[:-1] for column in map(np.asarray, columns)], axis=0)
        kept[1:] &= ~same
        return chunk[kept]

    def decoded(self, chunk) -> "Records":
        """The columns that matter of ``chunk``. Raises `BadInput` for a ring that is no number."""
        ring = np.asarray(chunk[self.ring_dimension])
        whole = ring.astype(np.int64)
        if len(ring) and ((whole != ring).any() or whole.min() < 0 or whole.max() > 65535):
            raise BadInput(
                f"{self.path}: expected whole numbers from 0 as rings in {self.ring_dimension!r}, "
                "found others; name the right dimension with --ring-dimension"
            )
        xyz = np.column_stack([chunk.x, chunk.y, chunk.z])
        return Records(np.asarray(chunk.gps_time), whole, xyz, chunk)


@dataclass(frozen=True)
class Records:
    """Points as a file has them: ``time`` (N,) s, ``ring`` (N,), ``xyz`` (N, 3) on the map, and all
    ``columns`` by name."""

    time: np.ndarray
    ring: np.ndarray
    xyz: np.ndarray
    columns: Mapping


def open_strip(path: Path, crs: str | None = None, ring_dimension: str = "user_data") -> StripFile:
    """Check a strip's header. ``crs`` overrides the header's.

    Raises `BadInput`, `EmptyStrip`: no such file, another kind of file, no GPS time, no ring
    dimension, no reference system, no points.
    """
    path = Path(path)
    with opened(path) as reader:
        header = reader.header
    names = set(header.point_format.dimension_names)
    if header.point_count == 0:
        raise EmptyStrip(f"{path}: expected points, the file holds none; leave it out")
    if "gps_time" not in names:
        raise BadInput(
            f"{path}: expected a GPS time per point, point format {header.point_format.id} has "
            "none; export the strip with GPS time (point format 1, 3 or 6 and above)"
        )
    if ring_dimension not in names:
        raise BadInput(
            f"{path}: expected the ring in dimension {ring_dimension!r}, it has "
            f"{', '.join(sorted(names))}; name the right one with --ring-dimension"
        )
    grid = Grid(_crs_of(header, path) if crs is None else crs, "--crs" if crs else str(path))
    return StripFile(
        path,
        grid,
        ring_dimension,
        int(header.point_count),
        float(header.scales.max()),
        np.array(header.mins),
        np.array(header.maxs),
        tuple(header.point_format.dimension_names),
    )


def opened(path: Path) -> laspy.LasReader:
    """A reader of the file, or `BadInput`."""
    path = Path(path)
    if not path.is_file():
        raise BadInput(f"{path}: no such file; give the strips as LAS or LAZ")
    with path.open("rb") as file:
        if file.read(4) != b"LASF":
            kind = "it looks like an SBET: were strip and trajectory swapped?"
            other = "it is of another kind: give a LAS or LAZ file"
            sbet = path.stat().st_size % 136 == 0 and path.stat().st_size > 0
            raise BadInput(f"{path}: expected a LAS/LAZ strip, {kind if sbet else other}")
    try:
        reader = laspy.open(path)
        begin = reader.header.offset_to_point_data
        if path.stat().st_size < begin:
            raise laspy.LaspyException(f"points begin at byte {begin}, the file ends before")
        return reader
    except READ_ERRORS as error:
        raise BadInput(
            f"{path}: its LAS header cannot be read ({_first_line(error)}); the file is cut off or "
            "damaged: export or copy it again"
        ) from error


def _read(reader, count: int, path: Path, start: int):
    try:
        chunk = reader.read_points(count)
    except READ_ERRORS as error:
        raise _cut_off(path, start, reader.header.point_count, error) from error
    if len(chunk) < count:
        raise _cut_off(path, start + len(chunk), reader.header.point_count, "no more data")
    return chunk


def _cut_off(path: Path, start: int, count: int, error) -> BadInput:
    return BadInput(
        f"{path}: its points cannot be read from number {start} of {count} on "
        f"({_first_line(error)}); the file is cut off or damaged: export or copy it again"
    )


def _first_line(error) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def _crs_of(header, path: Path):
    try:
        crs = header.parse_crs()
    except Exception as error:  # PROJ and laspy raise many kinds on a damaged record
        raise BadInput(
            f"{path}: its reference system cannot be read ({_first_line(error)}); "
            "name it with --crs, such as --crs EPSG:32722"
        ) from error
    if crs is None:
        raise BadInput(
            f"{path}: expected a reference system in the header, there is none; "
            "name it with --crs, such as --crs EPSG:32722"
        )
    return crs
