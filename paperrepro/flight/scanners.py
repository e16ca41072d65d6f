"""Scanners known by name: their beams, or that they have no rings.

Elevations are in degrees and ascending. Sources:

- VLP-16, Puck Hi-Res: Velodyne manual 63-9243. HDL-32E: 63-9113. VLP-32C: Velodyne's own table,
  `velodyne_pointcloud/params/VeloView-VLP-32C.yaml` of kaarta/velodyne at d462a4d.
- Pandar40P, QT, XT-32 and XT32M: `pandarGeneral_internal.cc`, `pandarQT.h` and `pandarXT.h` of
  HesaiTechnology/HesaiLidar_General_ROS at 03de405 and 6e47b52. Each unit has a table of its own
  near this one, so that elevations that differ are taken from the points.
- Livox Mid-360: User Manual v1.0 (2023), page 20; HAP: User Manual (2022), page 6.

Units of Ouster and the HDL-64E have no table in common: theirs belongs into `mounting.toml`, or is
taken from the points.
"""

import numpy as np

from paperrepro.survey import Scanner

DEFAULT = "VLP-16 Hi-Res"
#: Beams that keep an elevation each; one that sweeps a plane or cone; one that goes anywhere.
KINDS = ("rings", "line", "any")
BEAMS_DEG = {
    "VLP-16 Hi-Res": np.linspace(-10.0, 10.0, 16),
    "VLP-16": np.linspace(-15.0, 15.0, 16),
    "HDL-32E": -92.0 / 3.0 + 4.0 / 3.0 * np.arange(32),
    "VLP-32C": np.array([
        -25.0, -15.639, -11.31, -8.843, -7.254, -6.148, -5.333, -4.667, -4.0, -3.667, -3.333, -3.0,
        -2.667, -2.333, -2.0, -1.667, -1.333, -1.0, -0.667, -0.333, 0.0, 0.333, 0.667, 1.0, 1.333,
        1.667, 2.333, 3.333, 4.667, 7.0, 10.333, 15.0,
    ]),
    "Pandar40P": np.array([
        -25.0, -19.0, *np.arange(-14.0, -5.0), -5.67, -5.33, -5.0, -4.67, -4.33, -4.0, -3.67,
        -3.33, -3.0, -2.67, -2.33, -2.0, -1.66, -1.33, -1.0, -0.67, -0.33, 0.0, 0.33, 0.67, 1.0,
        1.33, 1.67, 2.0, 3.0, 5.0, 8.0, 11.0, 15.0,
    ]),
    "PandarQT": np.array([
        -52.121, -49.785, -47.577, -45.477, -43.465, -41.528, -39.653, -37.831, -36.055, -34.320,
        -32.619, -30.950, -29.308, -27.690, -26.094, -24.517, -22.964, -21.420, -19.889, -18.372,
        -16.865, -15.368, -13.880, -12.399, -10.925, -9.457, -7.994, -6.535, -5.079, -3.626,
        -2.175, -0.725, 0.725, 2.175, 3.626, 5.079, 6.534, 7.993, 9.456, 10.923, 12.397, 13.877,
        15.365, 16.861, 18.368, 19.885, 21.415, 22.959, 24.524, 26.101, 27.697, 29.315, 30.957,
        32.627, 34.328, 36.064, 37.840, 39.662, 41.537, 43.475, 45.487, 47.587, 49.795, 52.133,
    ]),
    "PandarXT-32": np.arange(-16.0, 16.0),
    "PandarXT-32M2X": 1.3 * np.arange(-16.0, 16.0),
}  # fmt: skip
#: Those whose units have tables of their own.
OWN_TABLES = ("Pandar40P", "PandarQT", "PandarXT-32", "PandarXT-32M2X")
#: Kinds of scanners without rings; a spinning axis of RIEGL's is that of the mirror.
WITHOUT_RINGS = {
    **dict.fromkeys(("RIEGL VUX-1", "VUX-1UAV", "VUX-1LR", "VUX-1HA", "RIEGL miniVUX-1UAV",
                     "miniVUX-2UAV", "miniVUX-3UAV"), "line"),
    **dict.fromkeys(("Livox Avia", "Livox Mid-360", "Livox HAP", "DJI Zenmuse L1",
                     "DJI Zenmuse L2", "RoboSense RS-LiDAR-M1"), "any"),
}  # fmt: skip
#: One sigma by the manual, where it is another than by default: range, m, and angle, deg.
NOISE = {"Livox Mid-360": (0.02, 0.15), "Livox HAP": (0.02, 0.1)}
#: Left out of names, and other ways to write them, both reduced by `_plain`.
MAKERS = ("velodyne", "hesai", "riegl", "livox", "djizenmuse", "dji", "zenmuse", "robosense")
ALIASES = {"vlp16puckhires": "vlp16hires", "puckhires": "vlp16hires", "pucklite": "vlp16",
           "puck": "vlp16", "vlp16puck": "vlp16", "vlp16pucklite": "vlp16", "hdl32": "hdl32e",
           "ultrapuck": "vlp32c", "p40p": "pandar40p", "qt64": "pandarqt", "pandarqt64": "pandarqt",
           "xt32": "pandarxt32", "pandarxt": "pandarxt32", "xt32m": "pandarxt32m2x",
           "xt32m2x": "pandarxt32m2x", "xtm2x": "pandarxt32m2x", "m1": "rslidarm1",
           "rsm1": "rslidarm1"}  # fmt: skip

#: Range and angle noise, and how well a beam's zero is known, one sigma: m, deg, m.
RANGE_SIGMA, ANGLE_SIGMA_DEG, RANGE_OFFSET_SIGMA = 0.02, 0.01, 0.03


def _plain(name: str) -> str:
    plain = "".join(c for c in name.lower() if c.isalnum())
    maker = next((maker for maker in MAKERS if plain.startswith(maker)), "")
    plain = plain.removeprefix(maker)
    return ALIASES.get(plain, plain)


def _named(table, name: str):
    """The name in ``table`` that ``name`` is a way to write, or None."""
    return next((known for known in table if _plain(known) == _plain(name)), None)


def beams_named(name: str) -> np.ndarray | None:
    """Elevations (rings,) deg of a scanner by its name, or None where it is not known."""
    return BEAMS_DEG.get(_named(BEAMS_DEG, name))


def has_own_table(name: str) -> bool:
    """Whether the units of this name have elevations of their own, near the table."""
    return _named(OWN_TABLES, name) is not None


def kind_named(name: str) -> str | None:
    """One of `KINDS` of a scanner by its name, or None where it is not known."""
    if beams_named(name) is not None:
        return "rings"
    return WITHOUT_RINGS.get(_named(WITHOUT_RINGS, name))


def scanner_of(name: str, beams_deg: np.ndarray) -> Scanner:
    """A `Scanner` with its noise by the manual, or the default one."""
    elevations = np.sort(np.radians(beams_deg))
    range_sigma, angle_deg = NOISE.get(_named(NOISE, name), (RANGE_SIGMA, ANGLE_SIGMA_DEG))
    return Scanner(name, elevations, range_sigma, float(np.radians(angle_deg)), RANGE_OFFSET_SIGMA)
