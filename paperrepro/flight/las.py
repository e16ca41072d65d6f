"""LAS and LAZ strips, read in chunks, without belief in their headers.

What a header says of the number of points, records and bytes is compared with the file: a count
that an interrupted writer left behind is mended with a note, what cannot be is refused.
"""

import logging
import struct
from collections.abc import Callable, Iterator, Mapping
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
#: Points that a sample of a strip holds, about; of a strip with more pieces than this, each of so
#: many points as a LAZ file is compressed by, it is the first of each, else it is spread evenly.
SAMPLE, PIECES, PIECE = 20_000, 40, 50_000
#: Written into the header of strips under a calibration, and found there again.
SOFTWARE = "paperrepro"
#: Bytes of a header of LAS 1.0 to 1.2, and of a record's head: VLR, EVLR.
HEADER, VLR, EVLR = 227, 54, 60
FILE_ERRORS = (laspy.LaspyException, lazrs.LazrsError, ValueError, EOFError, OSError, IndexError,
               MemoryError, OverflowError, struct.error, UnicodeError)  # fmt: skip
# its warnings are ours to give, in one line
logging.getLogger("laspy").setLevel(logging.CRITICAL)


@dataclass(frozen=True)
class StripFile:
    """A strip on disk whose header was checked: ``grid`` of its coordinates, ``count`` points,
    ``scale`` of its coordinates (3,), names of all ``columns``, ``notes`` on what the header gets
    wrong, and whether it can be written again: ``hindrance``, words, if not."""

    path: Path
    grid: Grid
    ring_dimension: str
    count: int
    scales: np.ndarray
    columns: tuple[str, ...]
    notes: tuple[str, ...] = ()
    hindrance: str = ""

    def chunks(
        self, size: int = CHUNK, done: Callable[[int], None] | None = None
    ) -> Iterator[laspy.ScaleAwarePointRecord]:
        """All records in order; ``done`` is told how many were dealt with. Raises `BadInput` where
        the file ends too early."""
        seen = 0
        with opened(self.path) as reader:
            while seen < self.count:
                chunk = _read(reader, min(size, self.count - seen), self.path, seen)
                seen += len(chunk)
                yield chunk
                if done:
                    done(len(chunk))

    def sample(self) -> Iterator[laspy.ScaleAwarePointRecord]:
        """Some `SAMPLE` usable records of all of the strip. As `chunks`."""
        starts = range(0, self.count, PIECE)
        if len(starts) > PIECES:
            with opened(self.path, laspy.LazBackend.Lazrs) as reader:
                for start in starts:
                    size = min(SAMPLE // len(starts) + 1, self.count - start)
                    yield self.usable(_read(reader, size, self.path, start))
            return
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
        count, notes = reader.header.point_count, tuple(reader.notes)
    names = set(header.point_format.dimension_names)
    if count == 0:
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
    software = header.generating_software  # bytes, where they are no ASCII
    if isinstance(software, str) and software.startswith(SOFTWARE):
        notes += (
            f"{path}: was written under a calibration, as its header says ({software.strip()}); a "
            "second one adds to that",
        )
    return StripFile(
        path, grid, ring_dimension, int(count), np.array(header.scales),
        tuple(header.point_format.dimension_names), notes, _hindrance(header),
    )  # fmt: skip


def _hindrance(header: laspy.LasHeader) -> str:
    """Why points that move by metres could not be written; empty if they can."""
    reach = np.abs([header.mins - header.offsets, header.maxs - header.offsets]) / header.scales
    if np.isfinite(reach).all() and (reach + 20.0 / header.scales > 2**31 - 1).any():
        return (
            "its coordinates fill the 32 bits of its header's scale, so that points cannot be "
            "moved; export it with an offset near the points, or a coarser scale"
        )
    return ""


def opened(path: Path, backend: laspy.LazBackend | None = None) -> "Reader":
    """A reader of the file, whose points ``backend`` decompresses, or `BadInput`."""
    path = Path(path)
    if not path.is_file():
        raise BadInput(f"{path}: no such file; give the strips as LAS or LAZ")
    try:
        with path.open("rb") as file:
            signature = file.read(4)
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror}); mend that") from error
    if signature != b"LASF":
        kind = "it looks like an SBET: were strip and trajectory swapped?"
        other = "it is of another kind: give a LAS or LAZ file"
        sbet = path.stat().st_size % 136 == 0 and path.stat().st_size > 0
        raise BadInput(f"{path}: expected a LAS/LAZ strip, {kind if sbet else other}")
    try:
        return Reader(path, backend)
    except FILE_ERRORS as error:
        raise BadInput(
            f"{path}: its LAS header cannot be read ({first_line(error)}); the file is cut off or "
            "damaged: export or copy it again"
        ) from error


class Reader(laspy.LasReader):
    """A reader whose header counts the points that the file holds; ``notes`` where it did not."""

    def __init__(self, path: Path, backend: laspy.LazBackend | None = None):
        head = _checked_head(path)
        super().__init__(path.open("rb"), laz_backend=backend)
        self.notes: list[str] = []
        counted = self.header.point_count
        held = _held(self.header, head, path)
        if held > counted:
            self.header.point_count = held
            self.notes.append(
                f"{path}: its header counts {counted} points, the file holds {held}, as an "
                "interrupted writer leaves it; all are read"
            )


@dataclass(frozen=True)
class _Head:
    """Of a header: ``offset`` to the points, ``length`` of a record, ``end`` of the points."""

    offset: int
    length: int
    end: int


def _checked_head(path: Path) -> _Head:
    """What the header says of places and numbers, against the file's size. Raises
    `laspy.LaspyException`."""
    size = path.stat().st_size
    with path.open("rb") as file:
        raw = file.read(375)
    if len(raw) < HEADER:
        raise laspy.LaspyException(f"it has {len(raw)} bytes")
    minor, length = raw[25], int.from_bytes(raw[105:107], "little")
    header, offset, n_vlrs = struct.unpack_from("<HII", raw, 94)
    scales, offsets = np.split(np.array(struct.unpack_from("<6d", raw, 131)), 2)
    if not (np.isfinite(offsets).all() and np.isfinite(scales).all() and (scales > 0).all()):
        raise laspy.LaspyException(
            f"scale {scales.tolist()} and offset {offsets.tolist()} make no coordinates"
        )
    if raw[24] != 1 or minor > 4:
        raise laspy.LaspyException(f"version {raw[24]}.{minor}, expected 1.0 to 1.4")
    if size < offset:
        raise laspy.LaspyException(f"points begin at byte {offset}, the file ends before")
    if header + n_vlrs * VLR > offset:
        raise laspy.LaspyException(f"{n_vlrs} records do not fit before byte {offset}")
    first, n_evlrs = struct.unpack_from("<QI", raw, 235) if minor == 4 else (0, 0)
    if n_evlrs:
        _check_evlrs(path, first, n_evlrs, size)
    end = first if n_evlrs and first >= offset else size
    return _Head(offset, length, end)


def _check_evlrs(path: Path, first: int, count: int, size: int) -> None:
    if first + count * EVLR > size:
        raise laspy.LaspyException(f"{count} extended records from byte {first} do not fit")
    with path.open("rb") as file:
        at = first
        for _ in range(count):
            file.seek(at)
            head = file.read(EVLR)
            at += EVLR + (int.from_bytes(head[20:28], "little") if len(head) == EVLR else size)
            if at > size:
                raise laspy.LaspyException("an extended record ends behind the file")


def _held(header: laspy.LasHeader, head: _Head, path: Path) -> int:
    """Points that the file holds, as far as more than the header counts can be told."""
    if not header.are_points_compressed:
        held, rest = divmod(head.end - head.offset, max(head.length, 1))
        return held if not rest or held <= header.point_count else header.point_count
    vlr = header.vlrs.get("LasZipVlr")
    if not vlr:
        raise laspy.LaspyException("compressed points without a LASzip record")
    size = int.from_bytes(vlr[0].record_data[12:16], "little")
    with path.open("rb") as file:
        file.seek(head.offset)
        chunks = lazrs.read_chunk_table(file, lazrs.LazVlr(vlr[0].record_data))
        if not chunks:
            return 0
        if size == 2**32 - 1:  # chunks of their own numbers
            return sum(number for number, _ in chunks)
        full = size * (len(chunks) - 1)
        if header.point_format.id < 6:  # the last chunk does not tell its number
            if header.point_count <= full:
                raise laspy.LaspyException(
                    f"its header counts {header.point_count} points, its chunks hold more than "
                    f"{full}"
                )
            return header.point_count
        file.seek(head.offset + 8 + sum(number for _, number in chunks[:-1]) + head.length)
        return full + int.from_bytes(file.read(4), "little")


def _read(reader, count: int, path: Path, start: int):
    try:
        if start != reader.points_read:
            reader.seek(start)
        chunk = reader.read_points(count)
    except BaseException as error:
        if isinstance(error, FILE_ERRORS) or type(error).__name__ == "PanicException":  # of Rust
            raise _cut_off(path, start, reader.header.point_count, error) from error
        raise
    if len(chunk) < count:
        raise _cut_off(path, start + len(chunk), reader.header.point_count, "no more data")
    return chunk


def _cut_off(path: Path, start: int, count: int, error) -> BadInput:
    return BadInput(
        f"{path}: its points cannot be read from number {start} of {count} on "
        f"({first_line(error)}); the file is cut off or damaged: export or copy it again"
    )


def first_line(error) -> str:
    """What a library says, as a part of a sentence."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def _crs_of(header, path: Path):
    try:
        crs = header.parse_crs()
    except Exception as error:  # PROJ and laspy raise many kinds on a damaged record
        raise BadInput(
            f"{path}: its reference system cannot be read ({first_line(error)}); "
            "name it with --crs, such as --crs EPSG:32722"
        ) from error
    if crs is None:
        raise BadInput(
            f"{path}: expected a reference system in the header, there is none; "
            "name it with --crs, such as --crs EPSG:32722"
        )
    return crs
