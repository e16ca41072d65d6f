"""A simulated survey as its operator has it: strips as LAZ, an SBET, and the truth beside them.

Written without the method's reading of such files and without its LiDAR equation: the coordinates
come from the caster's own `aim`, under the nominal mounting and the *measured* trajectory, as an
operator's software makes them; PROJ takes them from the farm's topocentric frame to the map.
"""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import laspy
import numpy as np
import pyproj
from scipy.spatial.transform import Rotation

from data_synth.evaluation import trajectory_error
from data_synth.raycast import aim
from data_synth.simulation import Truth
from paperrepro.errors import BadInput
from paperrepro.frames import T_NED_ENU
from paperrepro.survey import Navigation, Scanner, Strip, Survey

#: The paper's site, 25 45' 16" S, 49 23' 39" W, and a height there.
LATITUDE_DEG, LONGITUDE_DEG, HEIGHT_M = -25.754444, -49.394167, 900.0
#: GPS week of the flight, in November 2018; its seconds are the trajectory's.
GPS_WEEK = 2028
WEEK, ADJUSTED = 604800.0, 1e9
#: Points written at a time.
CHUNK = 1_000_000
WGS84 = "+a=6378137 +rf=298.257223563"


@dataclass(frozen=True)
class Site:
    """Where the farm's origin lies: ``latitude_deg``, ``longitude_deg``, ellipsoidal ``height`` m,
    WGS 84, mapped in ``zone`` of UTM (its own, unless given). Raises `BadInput`."""

    latitude_deg: float = LATITUDE_DEG
    longitude_deg: float = LONGITUDE_DEG
    height: float = HEIGHT_M
    zone: int | None = None

    def __post_init__(self):
        if not (abs(self.latitude_deg) <= 84 and abs(self.longitude_deg) <= 180):
            raise BadInput(
                f"site: expected a latitude within 84 and a longitude within 180 degrees, got "
                f"{self.latitude_deg}, {self.longitude_deg}; give degrees, south and west negative"
            )
        if not abs(self.height) <= 10_000:
            raise BadInput(
                f"site: expected a height within 10000 m, got {self.height}; give metres above the "
                "ellipsoid"
            )
        if self.zone is not None and not 1 <= self.zone <= 60:
            raise BadInput(f"zone: expected one of UTM's, 1 to 60, got {self.zone}; give one")

    @property
    def epsg(self) -> int:
        """Of WGS 84 / UTM, north or south."""
        own = min(60, int((self.longitude_deg + 180.0) // 6.0) + 1)
        return (32600 if self.latitude_deg >= 0 else 32700) + (self.zone or own)

    @cached_property
    def _to_lonlat(self) -> pyproj.Transformer:
        return pyproj.Transformer.from_pipeline(
            f"+proj=pipeline +step +inv +proj=topocentric {WGS84} +lat_0={self.latitude_deg!r} "
            f"+lon_0={self.longitude_deg!r} +h_0={self.height!r} +step +inv +proj=cart {WGS84}"
        )

    def geodetic(self, p_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Longitude, latitude rad and ellipsoidal height m of points (N, 3) m, m-frame."""
        return self._to_lonlat.transform(*p_m.T, radians=True)

    def mapped(self, p_m: np.ndarray) -> np.ndarray:
        """UTM easting, northing and ellipsoidal height (N, 3) m."""
        longitude, latitude, height = self.geodetic(p_m)
        utm = pyproj.Proj(self.epsg)
        return np.column_stack([*utm(longitude, latitude, radians=True), height])


def sbet_records(survey: Survey, site: Site) -> np.ndarray:
    """(M, 17) records of the measured trajectory; accelerations and rates are zero, and the
    wander angle is, so that the velocities are north, east, down."""
    path = survey.trajectory
    longitude, latitude, height = site.geodetic(path.position)
    table = np.zeros((len(path.time), 17))
    table[:, 0], table[:, 1], table[:, 2], table[:, 3] = path.time, latitude, longitude, height
    velocity = np.gradient(path.position, path.time, axis=0)
    table[:, 4:7] = velocity @ T_NED_ENU.T
    table[:, 7:10] = _level_attitude(path.attitude, latitude, longitude, site)
    return table


def accuracy_records(navigation: Navigation) -> np.ndarray:
    """(T, 10) records of an SMRMSG, of what the smoother knows of its errors; velocities zero."""
    time, factors = navigation.profile
    east, north, up = (navigation.position_sigma * factors[:, :3]).T
    minutes = 60 * np.degrees(navigation.attitude_sigma * factors[:, 3:])
    return np.column_stack([time, north, east, up, np.zeros((len(time), 3)), minutes])


def _level_attitude(attitude, latitude, longitude, site: Site) -> np.ndarray:
    """Attitudes against the level and true north of each pose, of attitudes in the m-frame."""
    R_b_m = Rotation.from_matrix(T_NED_ENU) * Rotation.from_euler("ZYX", attitude[:, ::-1])
    lat_0, lon_0 = np.radians([site.latitude_deg, site.longitude_deg])
    R_b_ned = _ned_to_earth(latitude, longitude).inv() * (_enu_to_earth(lat_0, lon_0) * R_b_m)
    return R_b_ned.as_euler("ZYX")[:, ::-1]


def _enu_to_earth(latitude, longitude) -> Rotation:
    turns = np.column_stack(np.broadcast_arrays(longitude + np.pi / 2, np.pi / 2 - latitude))
    return Rotation.from_euler("ZX", turns)


def _ned_to_earth(latitude, longitude) -> Rotation:
    return _enu_to_earth(latitude, longitude) * Rotation.from_matrix(T_NED_ENU)


def nominal_points(survey: Survey, strip: Strip) -> np.ndarray:
    """(N, 3) m, m-frame: what the operator's software makes of a strip before any calibration."""
    pose = survey.trajectory.at(strip.time, strip.name)
    beams = survey.scanner.beam_elevations
    elevation = beams[strip.ring] if strip.elevation is None else strip.elevation
    nominal = survey.mounting.with_calibration(np.zeros(3))
    origin, direction = aim(pose, strip.azimuth, elevation, nominal)
    return origin + np.asarray(strip.rho)[:, None] * direction


def write_strip(path: Path, survey: Survey, strip: Strip, site: Site, scale: float = 1e-4) -> None:
    """One strip as LAS 1.4, compressed where ``path`` ends so: coordinates under the nominal
    mounting to ``scale`` m, adjusted standard GPS time, ring in ``user_data``, WGS 84 / UTM."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, scale)
    header.offsets = np.round(site.mapped(np.zeros((1, 3)))[0])
    header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    header.add_crs(pyproj.CRS.from_epsg(site.epsg))
    with laspy.open(path, mode="w", header=header) as writer:
        for start in range(0, len(strip), CHUNK):
            part = strip.take(slice(start, start + CHUNK))
            points = laspy.ScaleAwarePointRecord.zeros(len(part), header=header)
            points.x, points.y, points.z = site.mapped(nominal_points(survey, part)).T
            points.gps_time = part.time + (GPS_WEEK * WEEK - ADJUSTED)
            points.user_data = part.ring
            points.return_number[:], points.number_of_returns[:] = 1, 1
            writer.write_points(points)


def mounting_text(survey: Survey) -> str:
    """`mounting.toml`: the nominal mounting and the specifications, without the boresight."""
    mounting, scanner, navigation = survey.mounting, survey.scanner, survey.navigation
    rows = ", ".join(_list(row) for row in mounting.R_nominal)
    return f"""# Nominal mounting: rows are body forward, right, down; columns the laser's axes.
[nominal]
rotation = [{rows}]
lever_arm_m = {_list(mounting.lever_arm)}

[scanner]
name = "{scanner.name}"
{_beams(scanner)}
range_sigma_m = {scanner.range_sigma!r}
angle_sigma_deg = {_round(np.degrees(scanner.angle_sigma))!r}
range_offset_sigma_m = {scanner.range_offset_sigma!r}

[navigation]
name = "{navigation.name}"
position_sigma_m = {_list(navigation.position_sigma)}
attitude_sigma_deg = {_list(np.degrees(navigation.attitude_sigma))}
correlation_time_s = {navigation.correlation_time!r}
"""


def _beams(scanner: Scanner) -> str:
    """What the scanner's beams are, or of which kind it is without rings."""
    if len(scanner.beam_elevations) > 1:
        return f"beam_elevations_deg = {_list(np.degrees(scanner.beam_elevations))}"
    return f'kind = "{"line" if len(scanner.beam_elevations) else "any"}"'


def truth_text(survey: Survey, truth: Truth, site: Site) -> str:
    """`truth.json`: what the calibration should find, roof planes in the farm's frame, and what
    else was off."""
    names = ("omega", "phi", "kappa")
    degrees = np.degrees(truth.boresight).tolist()
    errors = truth.scanner_errors
    rms = np.sqrt((trajectory_error(survey, truth) ** 2).mean(axis=0))
    content = {
        "boresight_deg": dict(zip(names, degrees, strict=True)),
        "range_offsets_m": np.asarray(truth.range_offsets).tolist(),
        "lever_arm_m": np.asarray(truth.lever_arm).tolist(),
        "clock_delay_s": errors.clock_delay,
        "beam_elevation_offsets_deg": np.degrees(errors.elevation_offsets).tolist(),
        "beam_azimuth_offsets_deg": np.degrees(errors.azimuth_offsets).tolist(),
        "range_scale_ppm": 1e6 * errors.range_scale,
        "trajectory_rms": {
            "position_m": rms[:3].tolist(),
            "attitude_deg": np.degrees(rms[3:]).tolist(),
        },
        "origin": {
            "latitude_deg": site.latitude_deg,
            "longitude_deg": site.longitude_deg,
            "height_m": site.height,
        },
        "planes": [_plane(face) for face in truth.faces],
    }
    return json.dumps(content, indent=1) + "\n"


def _plane(face) -> dict:
    return {
        "normal": np.asarray(face.normal).tolist(),
        "d_m": float(face.d),
        "centroid_m": np.asarray(face.centroid).tolist(),
        "corners_m": np.asarray(face.corners).tolist(),
    }


def _round(value) -> float:
    """Twelve digits: enough, and free of the noise of a conversion."""
    return float(f"{value:.12g}")


def _list(values) -> str:
    return "[" + ", ".join(repr(_round(value)) for value in values) + "]"


def write_survey(
    folder: Path, survey: Survey, truth: Truth, site: Site | None = None, scale: float = 1e-4
) -> None:
    """``F1.laz`` and so on, ``mission.sbet``, ``mounting.toml`` and ``truth.json`` in ``folder``,
    and ``mission.smrmsg`` where the trajectory's errors are known over time; ``scale`` m as
    `write_strip`."""
    site = site or Site()
    if not 1e-7 <= scale <= 0.1:
        raise BadInput(f"scale: expected 1e-7 to 0.1 m, got {scale:g}; give the LAZ's resolution")
    for strip in survey.strips:
        write_strip(folder / f"{strip.name}.laz", survey, strip, site, scale)
    sbet_records(survey, site).astype("<f8").tofile(folder / "mission.sbet")
    if survey.navigation.profile is not None:
        accuracy_records(survey.navigation).astype("<f8").tofile(folder / "mission.smrmsg")
    (folder / "mounting.toml").write_text(mounting_text(survey), encoding="utf-8")
    (folder / "truth.json").write_text(truth_text(survey, truth, site), encoding="utf-8")
