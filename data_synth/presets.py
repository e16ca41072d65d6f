"""What can be chosen: the configuration of a simulated survey, by preset and profile."""

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, fields
from numbers import Integral
from pathlib import Path

import numpy as np

from data_synth.farm import Layout
from data_synth.flight import TABLE_1, FlightPlan, covering, plan_of, read_numbers
from data_synth.navigation import NAVIGATION
from data_synth.sensors import SCANNERS
from data_synth.surfaces import ROOF_SURFACES
from paperrepro.errors import BadInput

#: True boresight omega, phi, kappa in degrees. ``mount``: mounted by hand. ``table4``: scenario A's
#: row of Table 4.
PRESETS = {"mount": (1.1, -0.8, 1.3), "table4": (0.0187, -0.0155, 0.0008)}

#: One of how many firing sequences is kept: the same geometry and beams at every profile.
PROFILES = {"quick": 16, "paper": 1}

#: What is flown over: the paper's kind of site, a stand of trees with houses at its edge, a yard of
#: cars, walls, containers and heaps, or fields without any building.
SCENES = ("farm", "forest", "yard", "fields")
#: Rolling ground, or the same with banks, ditches and dams.
TERRAINS = ("rolling", "natural")

#: Rows and columns of the farm's building sites.
SITES = (3, 5)
#: No larger village fits into memory.
MOST_SITES = 10_000

#: Amounts and factors, which have no sign.
NOT_NEGATIVE = (
    "noise_scale", "range_offset_sigma_m", "unseen_vibration_deg", "lever_arm_sigma_m",
    "beam_elevation_sigma_deg", "beam_azimuth_sigma_deg", "range_noise_growth",
    "roof_surface_scale", "ground_roughness_m", "ground_relief", "gust_scale", "vibration_scale",
)  # fmt: skip
#: The trajectory reaches so far beyond the lines, s; a scale of a tenth is no longer one, ppm.
MOST_CLOCK_DELAY, MOST_RANGE_SCALE = 1.0, 1e5


#: Types of what a command line can set.
_PLAIN = (int, float, str)


@dataclass(frozen=True)
class SimulationConfig:
    """A simulated survey in plain scalars. By default only what the specifications say is off.

    Parameters
    ----------
    seed : whole number; every kind of error has its own stream of random numbers.
    preset, profile, scene, terrain : of `PRESETS`, `PROFILES`, `SCENES`, `TERRAINS`.
    noise_scale : factor on the GNSS/INS error, of whatever kind.
    sensor_noise : range noise, angle noise and dust, or none.
    range_offset_sigma_m : spread of the beams' true range offsets.
    boresight_deg : omega, phi, kappa in place of the preset's.
    reference_noise : of the airborne reference cloud, or none.
    navigation : kind of the GNSS/INS error, of `data_synth.navigation.NAVIGATION`.
    unseen_vibration_deg : root mean square of a vibration (15-60 Hz) of roll, pitch and heading,
        with 3-6 cm a degree in position, that the trajectory does not report.
    clock_delay_s : by which the laser's time stamps are later than the trajectory's clock; under
        one second.
    lever_arm_sigma_m : of the error, by axis, of the lever arm that the operator is told.
    beam_elevation_sigma_deg, beam_azimuth_sigma_deg : spread of the beams about the scanner's
        table.
    range_scale_ppm : by which measured ranges are too long.
    range_noise_growth : how range noise grows with incidence and distance and on dark surfaces: 0
        not, 1 as the root of a falling echo, 2 as the echo
        (`data_synth.sensors.range_noise_factor`).
    roof_surface : of `data_synth.surfaces.ROOF_SURFACES`: planes, tiles, sheets, and so on.
    roof_surface_scale : factor on the heights of roofs over their planes.
    ground_roughness_m : root mean square of the ground's heights over its facets.
    ground_relief : factor on the heights of the rolling ground; 0 is level.
    site_rows, site_columns : of the farm's building sites, four of five of which hold a gable
        house; the reference covers 280 x 170 m, or all sites where these need more.
    gust_scale, vibration_scale : factors on the true motion's gusts, and on the vibration that the
        trajectory reports.
    scanner : of `data_synth.sensors.SCANNERS`.
    plan : flight plan, or a table of its lines, `data_synth.flight.plan_of`; Table 1's unless
        given.

    Raises
    ------
    BadInput : where a value cannot be used.
    """

    seed: int = 1
    preset: str = "mount"
    profile: str = "quick"
    noise_scale: float = 1.0
    sensor_noise: bool = True
    range_offset_sigma_m: float = 0.015
    boresight_deg: tuple[float, float, float] | None = None
    reference_noise: bool = True
    scene: str = "farm"
    navigation: str = "gauss-markov"
    unseen_vibration_deg: float = 0.0
    clock_delay_s: float = 0.0
    lever_arm_sigma_m: float = 0.0
    beam_elevation_sigma_deg: float = 0.0
    beam_azimuth_sigma_deg: float = 0.0
    range_scale_ppm: float = 0.0
    range_noise_growth: float = 0.0
    roof_surface: str = "plane"
    roof_surface_scale: float = 1.0
    ground_roughness_m: float = 0.0
    ground_relief: float = 1.0
    gust_scale: float = 1.0
    vibration_scale: float = 1.0
    terrain: str = "rolling"
    site_rows: int = SITES[0]
    site_columns: int = SITES[1]
    scanner: str = "VLP-16 Hi-Res"
    plan: FlightPlan = TABLE_1

    def __post_init__(self):
        _require_choice("preset", self.preset, PRESETS)
        _require_choice("profile", self.profile, PROFILES)
        _require_choice("scene", self.scene, SCENES)
        _require_choice("terrain", self.terrain, TERRAINS)
        _require_choice("navigation", self.navigation, NAVIGATION)
        _require_choice("roof_surface", self.roof_surface, ROOF_SURFACES)
        _require_choice("scanner", self.scanner, SCANNERS)
        if not isinstance(self.plan, FlightPlan):
            object.__setattr__(self, "plan", plan_of(self.plan))
        for name in ("seed", "site_rows", "site_columns"):
            _require_whole(name, getattr(self, name))
        for name in NOT_NEGATIVE:
            _require_not_negative(name, getattr(self, name))
        if min(self.site_rows, self.site_columns) < 1:
            raise BadInput(
                f"site_rows, site_columns: expected at least 1, got {self.site_rows}, "
                f"{self.site_columns}; give one or more, or the scene fields"
            )
        if self.site_rows * self.site_columns > MOST_SITES:
            raise BadInput(
                f"site_rows, site_columns: expected at most {MOST_SITES} sites, got "
                f"{self.site_rows} x {self.site_columns}; give fewer"
            )
        if self.scene != "farm" and (self.site_rows, self.site_columns) != SITES:
            raise BadInput("site_rows, site_columns: only the scene farm has them; leave them out")
        _require_within("clock_delay_s", self.clock_delay_s, MOST_CLOCK_DELAY)
        _require_within("range_scale_ppm", self.range_scale_ppm, MOST_RANGE_SCALE)
        if self.boresight_deg is not None:
            _require_angles(self.boresight_deg)
            angles = tuple(float(angle) for angle in self.boresight_deg)
            object.__setattr__(self, "boresight_deg", angles)

    @property
    def boresight(self) -> np.ndarray:
        """True omega, phi, kappa, (3,) rad."""
        chosen = PRESETS[self.preset] if self.boresight_deg is None else self.boresight_deg
        return np.radians(chosen)

    @property
    def thinning(self) -> int:
        """One of how many firing sequences is kept."""
        return PROFILES[self.profile]


def make_config(preset: str = "mount", profile: str = "quick", **other) -> SimulationConfig:
    """A `SimulationConfig`; ``other`` are its further fields by name."""
    return SimulationConfig(preset=preset, profile=profile, **other)


def parse_parameters(texts: Iterable[str]) -> dict:
    """Fields of `SimulationConfig` by name, from texts such as ``clock_delay_s=0.005``.

    Raises `BadInput`, with the names there are.
    """
    known = {one.name: one.default for one in fields(SimulationConfig)}
    values = {}
    for name, _, value in (text.partition("=") for text in texts):
        if type(known.get(name)) not in _PLAIN:
            names = ", ".join(n for n, default in known.items() if type(default) in _PLAIN)
            raise BadInput(f"{name}: expected NAME=VALUE with a name of {names}; name one of them")
        try:
            values[name] = type(known[name])(value)
        except ValueError:
            raise BadInput(
                f"{name}: expected a value such as {known[name]!r}, got {value!r}; give one"
            ) from None
    return values


#: What a file of a site may hold, beside lines: tables and their keys, by default these values.
SITE_TABLES = {
    "site": {"rows": SITES[0], "columns": SITES[1]},
    "covering": {"overlap": 0.5, "height_m": TABLE_1.height, "speed_m_s": TABLE_1.speed},
    "scanner": {},
}


def read_site(path: str | Path) -> dict:
    """Fields of `SimulationConfig` from a TOML file: site, flight plan, scanner; each may be
    missing. Raises `BadInput` that names file, key and remedy.

    ::

        [site]                # building sites of the farm
        rows = 25
        columns = 25

        [scanner]
        name = "VLP-16"       # of data_synth.sensors.SCANNERS

        [covering]            # lines to and fro over the whole site, and two across
        overlap = 0.5
        height_m = 30.0
        speed_m_s = 5.0

        [[line]]              # or each line by itself, `data_synth.flight.plan_of`
        offset_m = -20.0
        heading_deg = 90
        length_m = 200.0
        height_m = 40.0
        speed_m_s = 6.0
    """
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
        return _site_of(content)
    except FileNotFoundError:
        raise BadInput(f"{path}: no such file; give a site and its flight plan (TOML)") from None
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from None
    except (ValueError, RecursionError) as error:
        why = str(error).splitlines()[0]
        raise BadInput(f"{path}: expected TOML text, {why}; correct the file") from error


def _site_of(content: dict) -> dict:
    if unknown := set(content) - {*SITE_TABLES, "line"}:
        raise BadInput(
            f"{', '.join(sorted(unknown))}: not known; name {', '.join(SITE_TABLES)} or [[line]], "
            "or leave it out"
        )
    if "covering" in content and "line" in content:
        raise BadInput("covering and line: expected one of both; leave the other out")
    rows, columns = read_numbers(content.get("site", {}), SITE_TABLES["site"], "[site]")
    scanner = content.get("scanner", {})
    read_numbers(scanner, SITE_TABLES["scanner"], "[scanner]", "name")
    found = {"site_rows": _whole(rows), "site_columns": _whole(columns)}
    found |= {"scanner": str(scanner["name"])} if "name" in scanner else {}
    SimulationConfig(**found)  # refuses what cannot be
    if "covering" in content:
        extent = Layout(found["site_rows"], found["site_columns"]).extent
        how = read_numbers(content["covering"], SITE_TABLES["covering"], "[covering]")
        found["plan"] = covering(*extent, *how)
    elif "line" in content:
        lines = content["line"]
        if not isinstance(lines, list):
            raise BadInput("line: expected a table [[line]] for each; write double brackets")
        found["plan"] = plan_of(lines)
    return found


def _whole(number: float) -> int | float:
    return int(number) if number.is_integer() else number


def _require_choice(what: str, value, choices) -> None:
    if value not in choices:
        names = ", ".join(choices)
        raise BadInput(f"{what}: expected one of {names}, got {value!r}; choose one of them")


def _require_whole(what: str, value) -> None:
    if not isinstance(value, Integral) or value < 0:
        raise BadInput(f"{what}: expected a whole number >= 0, got {value!r}; give zero or more")


def _require_not_negative(what: str, value) -> None:
    if not (np.isfinite(value) and value >= 0):
        raise BadInput(f"{what}: expected a number >= 0, got {value!r}; give zero or more")


def _require_within(what: str, value, most: float) -> None:
    if not (np.isfinite(value) and abs(value) < most):
        raise BadInput(f"{what}: expected a number within {most:g}, got {value!r}; give less")


def _require_angles(angles) -> None:
    if len(angles) != 3 or not np.isfinite(angles).all():
        raise BadInput(
            f"boresight_deg: expected three finite angles, got {angles!r}; "
            "give omega, phi, kappa in degrees"
        )
