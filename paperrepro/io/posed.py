"""A pose per point, in columns of its own, where there is no trajectory file.

The paper's record is such a one: x, y, z, intensity, range, vertical and horizontal angle,
latitude, longitude, elevation, roll, pitch, heading. Columns are known by their names, without
prefixes such as ``Sensor``; units by a suffix such as ``Rads``. What the
heading counts from, the rays tell (`READINGS`), and the unit where no suffix does.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from paperrepro.errors import BadInput
from paperrepro.io.geodesy import Grid, LocalFrame

PREFIXES = ("sensor", "scanner", "platform", "imu", "ins", "pose")
DEGREE = np.pi / 180
SUFFIXES = {"rads": 1.0, "rad": 1.0, "radians": 1.0, "degs": DEGREE, "deg": DEGREE,
            "degrees": DEGREE}  # fmt: skip
ON_THE_MAP = (("x",), ("y",), ("z",))
GEODETIC = (
    ("latitude", "lat"),
    ("longitude", "lon", "lng"),
    ("elevation", "height", "altitude", "ellipsoidalheight", "h"),
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


def pose_columns(names: Iterable[str]) -> PoseColumns | None:
    """The columns that hold poses, or None where they are not all there."""
    plain = {_plain(name): name for name in names}
    attitude = _all_of(plain, ATTITUDE)
    for kind in (ON_THE_MAP, GEODETIC):
        position = _all_of(plain, kind, prefixed=kind is ON_THE_MAP)
        if position and attitude:
            named = [u for end, u in SUFFIXES.items() if _plain(attitude[0]).endswith(end)]
            units = (named[0],) if named else (1.0, DEGREE)
            return PoseColumns(position, kind is GEODETIC, attitude, units)
    return None


def _plain(name: str) -> str:
    return "".join(c for c in name.lower() if c.isalnum())


def _all_of(plain: dict[str, str], wanted, prefixed: bool = False) -> tuple[str, ...] | None:
    """The column of each of ``wanted``, bare or ``prefixed`` (the points' own x, y, z are bare)."""
    starts = PREFIXES if prefixed else ("", *PREFIXES)
    ends = ("", *SUFFIXES)
    found = [
        next(
            (plain[s + n + e] for n in names for s in starts for e in ends if s + n + e in plain),
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
