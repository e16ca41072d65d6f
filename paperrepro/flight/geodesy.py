"""From a map's coordinates and an SBET's latitudes to one local topocentric frame, and back.

The m-frame is east-north-up at one origin on the ellipsoid's normal. Away from the origin, north
and the vertical turn with the meridians and with the earth's curvature: by 0.3 mrad of heading and
0.16 mrad of tilt at 1 km and 60 degrees of latitude. So an attitude, which is given against the
local level and true north at its own pose, is turned into the m-frame, never copied.

Radians and metres. PROJ does the geodesy; the datum is the strips' own (``Grid.crs``).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pyproj
from pyproj.exceptions import CRSError, ProjError

from paperrepro._compiled import over_threads
from paperrepro.errors import BadInput
from paperrepro.frames import attitude_matrix


@dataclass(frozen=True)
class LocalFrame:
    """East-north-up at ``latitude``, ``longitude`` rad, ellipsoidal ``height`` m, on an ellipsoid
    of semi-major axis ``a`` m and inverse flattening ``rf`` (by default WGS 84's)."""

    latitude: float
    longitude: float
    height: float
    a: float = 6378137.0
    rf: float = 298.257223563

    @classmethod
    def around(cls, latitude, longitude, height, shape: tuple[float, float]) -> "LocalFrame":
        """At the middle of places (N,) rad, rad, m, at their lowest, on an ellipsoid of ``shape``.
        Longitudes are averaged over the date line; one place in two hundred may be a stray."""
        turn = np.angle(np.exp(1j * (longitude - longitude[0])))
        low, high = np.quantile([latitude, turn, height], [0.005, 0.995], axis=1)
        middle = 0.5 * (low + high)
        return cls(float(middle[0]), float(longitude[0] + middle[1]), float(low[2]), *shape)

    @cached_property
    def _pipeline(self) -> pyproj.Transformer:
        shape = f"+a={self.a!r} +rf={self.rf!r}"
        longitude, latitude = np.degrees(self.longitude), np.degrees(self.latitude)
        return pyproj.Transformer.from_pipeline(
            f"+proj=pipeline +step +proj=cart {shape} +step +proj=topocentric {shape} "
            f"+lon_0={longitude:.17g} +lat_0={latitude:.17g} +h_0={self.height:.17g}"
        )

    def from_geodetic(self, latitude, longitude, height) -> np.ndarray:
        """Points (N, 3) m, m-frame, of geodetic coordinates (N,) rad, rad, m."""
        places = longitude, latitude, height
        return np.column_stack(_transformed(self._pipeline, *places, radians=True))

    def to_geodetic(self, p_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Latitude, longitude rad and ellipsoidal height m, (N,) each, of points (N, 3)."""
        longitude, latitude, height = _transformed(
            self._pipeline, *np.asarray(p_m, float).T, radians=True, direction="INVERSE"
        )
        return latitude, longitude, height

    def attitude_from_level(self, latitude, longitude, attitude) -> np.ndarray:
        """Attitudes (N, 3) rad against the m-frame, of attitudes against the local level and true
        north at ``latitude``, ``longitude`` (N,) rad. Roll, pitch, heading both."""
        return _turned(self._from_level(latitude, longitude), attitude)

    def attitude_to_level(self, latitude, longitude, attitude) -> np.ndarray:
        """The inverse of `attitude_from_level`."""
        return _turned(np.swapaxes(self._from_level(latitude, longitude), -1, -2), attitude)

    def _from_level(self, latitude, longitude) -> np.ndarray:
        """(N, 3, 3), local level at the pose to m."""
        here = _level_axes(self.latitude, self.longitude)
        return here @ np.swapaxes(_level_axes(np.asarray(latitude), np.asarray(longitude)), -1, -2)


def _transformed(transformer: pyproj.Transformer, *columns, **how) -> np.ndarray:
    """Coordinates, a row each, of ``columns`` (N,) or numbers; over the threads, which PROJ lets
    run."""
    columns = np.broadcast_arrays(*columns)
    out = np.empty((len(columns), *columns[0].shape))
    rows, given = out.reshape(len(columns), -1), [np.ravel(column) for column in columns]

    def transform(first: int, last: int) -> None:
        part = (column[first:last] for column in given)
        rows[:, first:last] = transformer.transform(*part, **how)

    over_threads(transform, rows.shape[1])
    return out


def _turned(turn: np.ndarray, attitude) -> np.ndarray:
    """Attitudes (N, 3) rad against other axes."""
    R = turn @ attitude_matrix(*np.asarray(attitude, float).T)
    roll = np.arctan2(-R[:, 2, 1], -R[:, 2, 2])
    pitch = np.arctan2(R[:, 2, 0], np.hypot(R[:, 2, 1], R[:, 2, 2]))
    return np.column_stack([roll, pitch, np.arctan2(R[:, 0, 0], R[:, 1, 0])])


def _level_axes(latitude, longitude) -> np.ndarray:
    """Earth-fixed east, north and up at places (...,) rad, the rows of (..., 3, 3)."""
    sp, cp = np.sin(latitude), np.cos(latitude)
    sl, cl = np.sin(longitude), np.cos(longitude)
    rows = [[-sl, cl, np.zeros_like(sl)], [-sp * cl, -sp * sl, cp], [cp * cl, cp * sl, sp]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


class Grid:
    """A map's coordinates against geodetic ones of the same datum.

    ``crs`` as pyproj takes it; of a compound one the horizontal part counts, and the height's unit.
    Heights are taken as ellipsoidal; `consistency` finds out where they are not. Raises `BadInput`.
    """

    def __init__(self, crs, what: str = "crs"):
        try:
            given = pyproj.CRS.from_user_input(crs)
        except CRSError as error:
            raise BadInput(
                f"{what}: expected a coordinate reference system, got {crs!r}; "
                "give one such as EPSG:32722"
            ) from error
        given = given.source_crs if given.is_bound else given
        self.crs = _horizontal(given)
        if not (self.crs.is_projected or self.crs.is_geographic):
            raise BadInput(
                f"{what}: expected a projected or geographic reference system, got "
                f"{given.name!r}; give one such as EPSG:32722"
            )
        self.name, self.what = given.name, what
        self.height_unit = _height_unit(given, self.crs)
        ellipsoid = self.crs.ellipsoid
        self.shape = ellipsoid.semi_major_metre, ellipsoid.inverse_flattening
        try:
            self._transform = pyproj.Transformer.from_crs(
                self.crs, self.crs.geodetic_crs.to_2d(), always_xy=True
            )
        except ProjError as error:
            raise BadInput(
                f"{what}: PROJ has no way from {given.name} to latitude and longitude "
                f"({str(error).splitlines()[0]}); give a system such as EPSG:32722"
            ) from error

    def to_geodetic(self, xyz: np.ndarray):
        """Latitude, longitude rad and height m, (N,) each, of coordinates (N, 3); infinite where
        they lie outside the system. Raises `BadInput` where most of them do."""
        lon, lat = _transformed(self._transform, xyz[:, 0], xyz[:, 1])
        outside = ~((np.abs(lat) <= 90.0) & (np.abs(lon) <= 540.0))
        if outside.mean() > 0.5:
            where = ", ".join(f"{value:.1f}" for value in xyz[np.flatnonzero(outside)[0], :2])
            degrees = "degrees of latitude and longitude" if self.crs.is_geographic else "its map"
            raise BadInput(
                f"{self.what}: coordinates such as {where} lie outside of {self.name}, expected "
                f"{degrees}; name the right reference system with --crs"
            )
        lat, lon = (np.where(outside, np.inf, np.radians(value)) for value in (lat, lon))
        return lat, lon, self.height_unit * xyz[:, 2]

    def metres(self, step: np.ndarray, latitude: float = 0.0) -> float:
        """The largest of steps (3,) of the coordinates, m."""
        if self.crs.is_geographic:
            level = self.shape[0] * np.radians(step[:2]) * [np.cos(latitude), 1.0]
        else:
            level = step[:2] * self.crs.axis_info[0].unit_conversion_factor
        return float(max(*level, step[2] * self.height_unit))

    def from_geodetic(self, latitude, longitude, height) -> np.ndarray:
        """Coordinates (N, 3) of geodetic ones; the inverse of `to_geodetic`."""
        x, y = _transformed(
            self._transform, np.degrees(longitude), np.degrees(latitude), direction="INVERSE"
        )
        return np.column_stack([x, y, np.asarray(height) / self.height_unit])

    def convergence(self, latitude, longitude) -> np.ndarray:
        """Grid north clockwise from true north, (N,) rad: a true heading is the grid's plus it."""
        if self.crs.is_geographic:
            return np.zeros(np.shape(latitude))
        factors = pyproj.Proj(self.crs).get_factors(longitude, latitude, radians=True)
        return np.radians(factors.meridian_convergence)


def _horizontal(crs: pyproj.CRS) -> pyproj.CRS:
    return (crs.sub_crs_list[0] if crs.is_compound else crs).to_2d()


def _height_unit(crs: pyproj.CRS, horizontal: pyproj.CRS) -> float:
    """Metres of a unit of height; where none is named, that of the map's axes."""
    upward = [axis for axis in crs.axis_info if axis.direction == "up"]
    if upward:
        return upward[0].unit_conversion_factor
    return 1.0 if horizontal.is_geographic else horizontal.axis_info[0].unit_conversion_factor
