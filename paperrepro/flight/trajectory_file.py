"""The trajectory's file, an SBET or a text table, as records of an SBET; and it as adjusted.

Text is what post-processors export: POSPac (a preamble, names between commas, a line of units,
values between blanks), Inertial Explorer (a header, names, units, values), or any table whose head
line names time, place and attitude. Where there is no head line the columns are named by the
caller. Latitude and longitude (in degrees, radians, or whole degrees, minutes and seconds) go
before map coordinates, which are those of the strips' reference system. Units stand in a name
(``roll_rad``), behind it (``Roll (deg)``) or in a line of their own; else the size of the angles
tells them. What is read wrong all the same, the rays tell, as of an SBET (`consistency`).
Inertial Explorer's profiles are the user's own: names, order and units are read, not expected.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from paperrepro.errors import BadInput
from paperrepro.flight.geodesy import Grid, LocalFrame
from paperrepro.flight.sbet import (
    SBET_COLUMNS,
    Poses,
    continuous,
    poses_of,
    read_records,
    read_sbet,
    week_start,
)
from paperrepro.flight.table import ANGLE_SUFFIXES, DEGREE, PoseColumns, plain, pose_columns
from paperrepro.method.adjustment.result import TrajectoryErrors

#: Files of an adjusted trajectory.
ADJUSTED = {"sbet": "trajectory.sbet", "accuracy": "trajectory.smrmsg"}
#: No adjustment moves a trajectory by more, m.
LARGEST_CHANGE = 10.0
#: Lines in which the head of a table is sought.
HEAD = 200
TIMES = (
    "time", "gpstime", "sow", "tow", "gpssow", "gpstow", "secondsofweek", "gpsseconds", "timesec",
)  # fmt: skip
#: What a comment begins with.
COMMENT = "#%;*!/"
#: Ends of the names of two columns that follow degrees, where these are whole.
SIXTIETHS = " minutes", " seconds"
UNITS = {"deg", "degs", "degree", "degrees", "rad", "rads", "radian", "radians"}


@dataclass(frozen=True)
class TrajectoryFile:
    """An SBET, or text; ``grid`` of map coordinates in it, ``columns``: names, with commas between,
    where it has no head line."""

    path: Path
    grid: Grid | None = None
    columns: str | None = None

    def records(self) -> np.ndarray:
        """(M, 17) as an SBET has them; of text, velocities, wander, accelerations and rates zero.
        Raises `BadInput` that names file, line and remedy."""
        head = _head(self.path)
        if head is None:
            return read_records(self.path, SBET_COLUMNS, "SBET")
        return _Text.of(self, head).records()

    def poses(self) -> Poses:
        """Raises as `records` and `sbet.poses_of`."""
        return poses_of(self.records(), self.path)


def write_adjusted(
    file: TrajectoryFile, frame: LocalFrame, errors: TrajectoryErrors, folder: Path
) -> dict[str, str]:
    """Write the trajectory of ``file`` as adjusted into ``folder``, an SBET: position and attitude
    with what ``errors`` adds in the m-frame of ``frame``, its times earlier by the laser's delay,
    all else as it is; and an SMRMSG of the sigma. Velocities are not adjusted and their sigma are
    zeros. Gives the names of both files."""
    table = file.records()
    time = continuous(table[:, 0], file.path)
    added, sigma = errors.at(time + week_start(time) - errors.delay)
    place, level = table[:, 1:4].T, table[:, 7:10]
    attitude = frame.attitude_from_level(*place[:2], level) + added[:, 3:]
    turned = frame.attitude_to_level(*place[:2], attitude) - level
    table[:, 7:10] += np.angle(np.exp(1j * turned))
    table[:, 1:4] = np.column_stack(frame.to_geodetic(frame.from_geodetic(*place) + added[:, :3]))
    table[:, 0] -= errors.delay
    table.tofile(folder / ADJUSTED["sbet"])
    east, north, down = sigma[:, :3].T
    minutes = 60 * np.degrees(sigma[:, 3:])
    nothing = np.zeros((len(table), 3))
    columns = [table[:, 0], north, east, down, nothing, minutes]
    np.column_stack(columns).tofile(folder / ADJUSTED["accuracy"])
    return dict(ADJUSTED)


def adjustment(
    file: TrajectoryFile, adjusted: Path, frame: LocalFrame
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Poses (N, 6) as `write_adjusted` left them, of times (N,) s and poses by ``file``. Raises
    `BadInput` where the two are not of one flight, and `OutsideTrajectory`."""
    path = file.path
    before, after = (poses.in_frame(frame) for poses in (file.poses(), read_sbet(adjusted)))

    def correct(time: np.ndarray, pose: np.ndarray) -> np.ndarray:
        covered = np.clip(time, after.time[0], after.time[-1])  # the laser's delay at its ends
        change = after.at(covered, str(adjusted)) - before.at(time, str(path))
        change[:, 3:] = np.angle(np.exp(1j * change[:, 3:]))
        largest = float(np.abs(change[:, :3]).max(initial=0.0))
        if largest > LARGEST_CHANGE:
            raise BadInput(
                f"{adjusted}: lies {largest:.1f} m from {path}: it is of another flight; give the "
                "trajectory that was calibrated, or --mounting-only"
            )
        return pose + change

    return correct


def _head(path: Path) -> list[str] | None:
    """The first lines of a text, or None where the file is none."""
    if not path.is_file():
        return None
    with path.open("rb") as file:
        raw = file.read(1 << 16)
    text = raw.decode("utf-8-sig", "replace")
    odd = sum(not (c.isprintable() or c.isspace()) or c == "\ufffd" for c in text)
    if not raw or odd > 0.01 * len(text):
        return None
    return text.splitlines()[:HEAD]


def _split(line: str, separator: str | None) -> list[str]:
    return [part.strip() for part in line.strip().split(separator)]


def _separator(line: str) -> str | None:
    """Between values; None for blanks."""
    return next((mark for mark in ("\t", ";", ",") if mark in line), None)


def _is_values(line: str) -> bool:
    """Whether a line holds numbers, as many as a pose has, and nothing else that matters."""
    parts = _split(line, _separator(line))
    numbers = [re.fullmatch(r"[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?", part) for part in parts]
    return len(parts) >= 7 and sum(map(bool, numbers)) >= 7


@dataclass(frozen=True)
class _Text:
    """A text's ``file``, the line ``first`` at which its values begin, what stands between them,
    whether decimals have a comma, and the columns' names."""

    file: TrajectoryFile
    first: int
    separator: str | None
    comma: bool
    names: tuple[str, ...]

    @classmethod
    def of(cls, file: TrajectoryFile, head: list[str]) -> "_Text":
        path = file.path
        first = next((k for k, line in enumerate(head) if _is_values(line)), None)
        if first is None and any(map(_IN_ONE_FIELD.search, head)):
            raise BadInput(
                f"{path}: degrees, minutes and seconds stand in one field; export decimal degrees, "
                "or the three with blanks between them"
            )
        if first is None:
            raise BadInput(
                f"{path}: expected an SBET or lines of numbers, none of the first {len(head)} "
                "lines holds a pose (time, place, attitude); give the trajectory as SBET or text"
            )
        separator = _separator(head[first])
        count = len(_split(head[first], separator))
        named = _split(file.columns, ",") if file.columns else _named(head[:first], count)
        names = _with_sixtieths(named or [], count)
        if len(names) != count:
            named = f"{len(names)} are named" if names else "no line above names them"
            raise BadInput(
                f"{path}, line {first + 1}: {count} columns, {named}; name all with --columns, as "
                "time,lat,lon,height,roll,pitch,heading, or export the table with its head line"
            )
        comma = separator != "," and any("," in part for part in _split(head[first], separator))
        return cls(file, first, separator, comma, tuple(names))

    def records(self) -> np.ndarray:
        found = pose_columns(self.names, of_points=False)
        times = {plain(name): name for name in reversed(self.names)}
        time = next((times[name] for name in TIMES if name in times), None)
        if found is None or time is None:
            raise BadInput(
                f"{self.file.path}, line {self.first + 1}: expected columns time, latitude, "
                "longitude, height (or x, y, z) and roll, pitch, heading, got "
                f"{', '.join(self.names)}; name them with --columns"
            )
        sixtieths = [k + end for k in found.position for end in SIXTIETHS if k + end in self.names]
        values = self._values([time, *found.position, *found.attitude, *sixtieths])
        if sixtieths:
            parts = values[:, 7:].reshape(-1, 2, 2) @ [1 / 60, 1 / 3600]
            values[:, 1:3] += np.copysign(parts, values[:, 1:3])
        attitude = values[:, 4:7] * self._unit(found, values)
        if found.geodetic:
            latitude, longitude = (values[:, 1:3] * self._unit_of_place(found, values)).T
            height = values[:, 3]
        elif self.file.grid is None:
            raise BadInput(f"{self.file.path}: map coordinates need the strips; give latitude")
        else:
            latitude, longitude, height = self.file.grid.to_geodetic(values[:, 1:4])
        table = np.zeros((len(values), SBET_COLUMNS))
        table[:, :4] = np.column_stack([values[:, 0], latitude, longitude, height])
        table[:, 7:10] = attitude
        return table

    def _values(self, names: list[str]) -> np.ndarray:
        """(M, n) numbers of the columns. Raises `BadInput` for a line that holds none."""
        index = [self.names.index(name) for name in names]
        whole = [k for k, name in zip(index, names, strict=True) if name + SIXTIETHS[0] in names]
        try:
            table = pd.read_csv(
                self.file.path, sep=self.separator or r"\s+", header=None, usecols=index,
                skiprows=self.first, skip_blank_lines=False, decimal="," if self.comma else ".",
                encoding_errors="replace", low_memory=False, dtype=dict.fromkeys(whole, str),
            )  # fmt: skip
        except (ValueError, OSError) as error:  # pandas' own errors are ValueErrors
            why = str(error).splitlines()[0]
            raise BadInput(f"{self.file.path}: expected a table, {why}; export it") from error
        values = table[index].apply(pd.to_numeric, errors="coerce").to_numpy(float)
        for k in whole:  # of -0 degrees the sign would be lost
            west = table[k].astype(str).str.startswith("-")
            values[west, index.index(k)] = np.copysign(values[west, index.index(k)], -1.0)
        bad = ~np.isfinite(values).all(axis=1)
        empty = table.isna().all(axis=1) | table.iloc[:, 0].astype(str).str[0].isin(list(COMMENT))
        values, bad, line = values[~empty], bad[~empty], np.flatnonzero(~empty) + self.first + 1
        last = len(bad) - int(np.argmin(bad[::-1]))  # what follows the last pose is a closing word
        wrong = np.flatnonzero(bad[:last])
        if len(wrong):
            raise BadInput(
                f"{self.file.path}, line {line[wrong[0]]}: expected numbers for "
                f"{', '.join(names)}; correct or drop the line"
            )
        return values[:last]

    def _unit(self, found: PoseColumns, values: np.ndarray) -> float:
        """Of the attitude, rad: as named, else as the heading's size has it, else as the place."""
        if len(found.units) == 1:
            return found.units[0]
        if np.abs(values[:, 6]).max() > 2 * np.pi + 1e-3:
            return DEGREE
        return self._unit_of_place(found, values) if found.geodetic else 1.0

    @staticmethod
    def _unit_of_place(found: PoseColumns, values: np.ndarray) -> float:
        """Of latitude and longitude, rad."""
        ends = [u for end, u in ANGLE_SUFFIXES.items() if plain(found.position[0]).endswith(end)]
        if ends:
            return ends[0]
        largest = np.abs(values[:, 1:3]).max(axis=0)
        return DEGREE if (largest > [np.pi / 2, np.pi]).any() else 1.0


#: Such as 51°12'33.4" and 51:12:33.4; a time of day stands in few lines.
_IN_ONE_FIELD = re.compile(r"\d\s*[°:d]\s*\d+\s*['′:m]\s*\d+.*\d\s*[°:d]\s*\d+\s*['′:m]\s*\d+")


def _with_sixtieths(names: list[str], count: int) -> list[str]:
    """Names of all ``count`` columns where latitude and longitude have minutes and seconds behind
    them that are not named, else as they are."""
    if len(names) + 4 != count:
        return names
    angles = [plain(name).startswith(("lat", "lon")) for name in names]
    return [n + end for n, angle in zip(names, angles, strict=True)
            for end in ("", *SIXTIETHS)[: 3 if angle else 1]]  # fmt: skip


def _named(above: list[str], count: int) -> list[str] | None:
    """Names of ``count`` columns from the lines above the values: the last that names an attitude,
    with units that the line below has; None where there is none."""
    for k in reversed(range(len(above))):
        words = above[k].lstrip(COMMENT + " ")
        if not all(word in words.lower() for word in ("roll", "pitch")):
            continue
        for separator in dict.fromkeys((_separator(words), None)):
            names = [_with_unit(name) for name in _split(words, separator) if name]
            if len(_with_sixtieths(names, count)) == count:
                below = [_units(line) for line in above[k + 1 :]]
                units = next((u for u in below if len(u) == len(names)), [""] * len(names))
                return [name + (unit if unit in UNITS else "") for name, unit in
                        zip(names, units, strict=True)]  # fmt: skip
    return None


def _units(line: str) -> list[str]:
    """A line of units, bare."""
    return [part.strip("()[] ").lower() for part in _split(line, _separator(line))]


def _with_unit(name: str) -> str:
    """``Roll (deg)`` as ``rolldeg``; a unit that is no angle's is dropped."""
    found = re.search(r"[(\[]\s*([^)\]]*?)\s*[)\]]", name)
    bare = re.sub(r"[(\[].*?[)\]]", "", name).strip()
    return bare + (found[1].lower() if found and found[1].lower() in UNITS else "")
