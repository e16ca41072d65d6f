"""`mounting.toml`: how the scanner sits in the body, and what scanner and GNSS/INS are.

[nominal]
rotation = [[0, 0, 1], [0, -1, 0], [1, 0, 0]]  # l to b: rows are body forward, right, down
lever_arm_m = [0.10, -0.02, 0.15]              # GNSS/INS to laser, b-frame

[scanner]                                      # optional; VLP-16 Hi-Res without
name = "VLP-16 Hi-Res"
range_sigma_m = 0.02
angle_sigma_deg = 0.01
range_offset_sigma_m = 0.03
beam_elevations_deg = [-10.0, ...]
kind = "rings"                                 # "line" (a plane is swept) or "any": without rings

[navigation]                                   # optional; APX-15 UAV without
name = "APX-15 UAV"
position_sigma_m = [0.02, 0.02, 0.04]          # east, north, up; or one number
attitude_sigma_deg = [0.025, 0.025, 0.08]      # roll, pitch, heading
correlation_time_s = 30.0

Common scanners are known by name (`scanners`).
"""

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from paperrepro.errors import BadInput
from paperrepro.flight import scanners
from paperrepro.frames import require_rotation
from paperrepro.survey import Mounting, Navigation, Scanner

#: A rotation typed with few digits is brought to the nearest exact one, up to this misfit.
ROUNDED = 2e-3
KNOWN = {
    "nominal": {"rotation", "lever_arm_m"},
    "scanner": {"name", "range_sigma_m", "angle_sigma_deg", "range_offset_sigma_m",
                "beam_elevations_deg", "kind"},
    "navigation": {"name", "position_sigma_m", "attitude_sigma_deg", "correlation_time_s"},
}  # fmt: skip


@dataclass(frozen=True)
class MountingFile:
    """What `mounting.toml` says. ``beams_given``: it names the beams, by table or by a scanner's
    name, so that data which do not fit are wrong; else the data may tell another known scanner.
    ``kind`` of scanner, of `scanners.KINDS`, and whether the file or a name says so:
    ``kind_given``. ``notes``: what was assumed."""

    mounting: Mounting
    scanner: Scanner
    navigation: Navigation
    beams_given: bool
    notes: tuple[str, ...]
    kind: str = "rings"
    kind_given: bool = True

    def of_kind(self, kind: str) -> "MountingFile":
        """With a scanner without rings."""
        name = self.scanner.name
        name = f"scanner of kind {kind}" if name == scanners.DEFAULT else name
        scanner = replace(self.scanner, name=name, beam_elevations=np.empty(0))
        return replace(self, scanner=scanner, kind=kind)


def read_mounting(path: Path, kind: str | None = None) -> MountingFile:
    """Read and check the file; a ``kind`` overrides what it says of the scanner. Raises `BadInput`
    that names file, entry and remedy."""
    path, notes = Path(path), []
    tables = _load(path)
    nominal = tables.get("nominal")
    if not isinstance(nominal, dict):
        raise BadInput(
            f"{path}: expected a table [nominal] with rotation and lever_arm_m, found "
            f"{', '.join(tables) or 'nothing'}; add it"
        )
    mounting = Mounting(
        _rotation(nominal, f"{path} [nominal] rotation", notes),
        _numbers(nominal, "lever_arm_m", 3, f"{path} [nominal]"),
    )
    table, where = tables.get("scanner", {}), f"{path} [scanner]"
    if kind is not None:
        kept = table.keys() - ({"kind"} if kind == "rings" else {"kind", "beam_elevations_deg"})
        table = {"kind": kind} | {key: table[key] for key in kept}
    kind = _kind(table, where)
    scanner, beams_given = _scanner(table, kind or "rings", where, notes)
    navigation = _navigation(tables.get("navigation", {}), f"{path} [navigation]", notes)
    notes += _unknown(tables, path)
    return MountingFile(mounting, scanner, navigation, beams_given, tuple(notes), kind or "rings",
                        kind is not None)  # fmt: skip


def _load(path: Path) -> dict:
    if not path.is_file():
        raise BadInput(f"{path}: no such file; give the mounting of this scanner (mounting.toml)")
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:
        why = str(error).splitlines()[0]
        raise BadInput(f"{path}: expected TOML text, {why}; correct the file") from error
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror}); mend that") from error
    for name in KNOWN:
        if name in tables and not isinstance(tables[name], dict):
            raise BadInput(
                f"{path}: expected a table [{name}], got {short(tables[name])}; see README"
            )
    return tables


def short(value) -> str:
    """A value for a message, cut where it is long."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _plain_numbers(value) -> bool:
    """Numbers, or lists of them, of any depth that is sane; no words or truths."""
    if isinstance(value, list):
        return all(isinstance(v, list) is isinstance(value[0], list) and _plain_numbers(v)
                   for v in value)  # fmt: skip
    return type(value) in (int, float) and abs(value) < 1e300


def numbers_in(value) -> np.ndarray:
    """What a file holds as numbers, or lists of them; empty where they are none."""
    try:
        return np.array(value, float) if _plain_numbers(value) else np.empty(0)
    except (TypeError, ValueError, OverflowError):
        return np.empty(0)


def _numbers(table: dict, key: str, count: int, where: str) -> np.ndarray:
    values = table.get(key)
    numbers = numbers_in(values)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise BadInput(
            f"{where}: expected {key} of {count} finite numbers, got {short(values)}; give it"
        )
    return numbers


def _rotation(nominal: dict, where: str, notes: list[str]) -> np.ndarray:
    given = numbers_in(nominal.get("rotation"))
    given = given.reshape(3, 3) if given.shape == (9,) else given
    if given.shape != (3, 3) or not np.isfinite(given).all():
        return require_rotation(given, where)
    left, stretch, right = np.linalg.svd(given)
    if np.linalg.det(given) < 0 or np.abs(stretch - 1).max() > ROUNDED:
        return require_rotation(given, where)
    if np.abs(stretch - 1).max() > 1e-9:
        notes.append(
            f"{where}: rows miss orthonormality by {np.abs(stretch - 1).max():.1e}; "
            "the nearest exact rotation is used"
        )
    return left @ right


def _positive(table: dict, key: str, default: float, where: str) -> float:
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < np.inf:
        raise BadInput(f"{where}: expected {key} as a number above 0, got {short(value)}; give it")
    return float(value)


def _kind(table: dict, where: str) -> str | None:
    """As the table says or its name or beams tell; None where nothing does."""
    kind, beams = table.get("kind"), "beam_elevations_deg" in table
    if kind is None:
        return "rings" if beams else scanners.kind_named(str(table.get("name", "")))
    if kind not in scanners.KINDS:
        raise BadInput(
            f"{where}: expected kind as one of {', '.join(scanners.KINDS)}, got {short(kind)}; "
            "name one"
        )
    if kind != "rings" and beams:
        raise BadInput(
            f"{where}: a scanner of kind {kind!r} has no rings; leave beam_elevations_deg out, or "
            "the kind"
        )
    return kind


def _scanner(table: dict, kind: str, where: str, notes: list[str]) -> tuple[Scanner, bool]:
    without = f"scanner of kind {kind}"
    name = str(table.get("name", scanners.DEFAULT if kind == "rings" else without))
    beams = scanners.beams_named(name)
    given = "name" in table and not scanners.has_own_table(name)
    if kind != "rings":
        beams, given = np.empty(0), True
    if "beam_elevations_deg" in table:
        values, given = table["beam_elevations_deg"], True
        count = len(values) if isinstance(values, list) else 0
        beams = _numbers(table, "beam_elevations_deg", max(count, 2), where)
        if np.abs(beams).max() > 90 or (np.diff(np.sort(beams)) <= 0).any():
            raise BadInput(
                f"{where}: expected beam_elevations_deg within 90 deg and no two alike, got "
                f"{beams.min():g} to {beams.max():g}; give the maker's table in degrees"
            )
    if beams is None:
        beams, given = scanners.BEAMS_DEG[scanners.DEFAULT], False
        notes.append(
            f"{where}: the beams of {name!r} are not known here; they are taken from the points, "
            "unless these fit a known scanner; give beam_elevations_deg"
        )
    known = scanners.scanner_of(name, beams)
    angle, offset = np.degrees(known.angle_sigma), known.range_offset_sigma
    scanner = replace(
        known,
        range_sigma=_positive(table, "range_sigma_m", known.range_sigma, where),
        angle_sigma=np.radians(_positive(table, "angle_sigma_deg", angle, where)),
        range_offset_sigma=_positive(table, "range_offset_sigma_m", offset, where),
    )
    return scanner, given


def _navigation(table: dict, where: str, notes: list[str]) -> Navigation:
    default = apx15()
    if not table:
        notes.append(f"{where}: not given; {default.name} by its data sheet is assumed")
    return Navigation(
        str(table.get("name", default.name)),
        _sigmas(table, "position_sigma_m", default.position_sigma, where),
        np.radians(_sigmas(table, "attitude_sigma_deg", np.degrees(default.attitude_sigma), where)),
        _positive(table, "correlation_time_s", default.correlation_time, where),
    )


def _sigmas(table: dict, key: str, default: np.ndarray, where: str) -> np.ndarray:
    """Three sigmas; one number stands for all three."""
    if isinstance(table.get(key), int | float):
        table = {key: [table[key]] * 3}
    sigmas = _numbers({key: default.tolist(), **table}, key, 3, where)
    if (sigmas < 0).any():
        raise BadInput(f"{where}: expected {key} not below 0, got {sigmas.tolist()}; correct it")
    return sigmas


def _unknown(tables: dict, path: Path) -> list[str]:
    """A word on each entry that nothing reads."""
    return [
        f"{path} [{name}] {key}: not known, not used; known are {', '.join(sorted(known))}"
        for name, known in KNOWN.items()
        for key in tables.get(name, {})
        if key not in known
    ]


def apx15() -> Navigation:
    """The APX-15 UAV, post-processed, by its data sheet: 2-5 cm, 0.025 deg, 0.08 deg."""
    return Navigation(
        "APX-15 UAV", np.array([0.02, 0.02, 0.04]), np.radians([0.025, 0.025, 0.08]), 30.0
    )
