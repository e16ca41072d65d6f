"""Beam tables of common scanners by name, and the specifications taken where a file names none.

Elevations in degrees, ascending, from the makers' manuals: Velodyne VLP-16 63-9243 (VLP-16 and
Puck Hi-Res), HDL-32E 63-9113, VLP-32C 63-9325; Hesai and Ouster units differ from one to the next,
so their tables belong into `mounting.toml`.
"""

import numpy as np

from paperrepro.survey import Navigation, Scanner

DEFAULT = "VLP-16 Hi-Res"
BEAMS_DEG = {
    "VLP-16 Hi-Res": np.linspace(-10.0, 10.0, 16),
    "VLP-16": np.linspace(-15.0, 15.0, 16),
    "HDL-32E": -92.0 / 3.0 + 4.0 / 3.0 * np.arange(32),
}
#: Other ways to write the names, reduced by `_plain`.
ALIASES = {"vlp16puckhires": "vlp16hires", "puckhires": "vlp16hires", "pucklite": "vlp16",
           "puck": "vlp16", "vlp16puck": "vlp16", "vlp16pucklite": "vlp16", "hdl32": "hdl32e",
           "velodynehdl32e": "hdl32e", "velodynevlp16": "vlp16",
           "velodynevlp16hires": "vlp16hires"}  # fmt: skip

#: Range and angle noise, and how well a beam's zero is known, one sigma: m, rad, m.
RANGE_SIGMA, ANGLE_SIGMA, RANGE_OFFSET_SIGMA = 0.02, float(np.radians(0.01)), 0.03


def _plain(name: str) -> str:
    plain = "".join(c for c in name.lower() if c.isalnum())
    return ALIASES.get(plain, plain)


def beams_named(name: str) -> np.ndarray | None:
    """Elevations (rings,) deg of a scanner by its name, or None where it is not known."""
    return next(
        (beams for known, beams in BEAMS_DEG.items() if _plain(known) == _plain(name)), None
    )


def scanner_of(name: str, beams_deg: np.ndarray) -> Scanner:
    """A `Scanner` with the default noise."""
    elevations = np.sort(np.radians(beams_deg))
    return Scanner(name, elevations, RANGE_SIGMA, ANGLE_SIGMA, RANGE_OFFSET_SIGMA)


def apx15() -> Navigation:
    """The APX-15 UAV, post-processed, by its data sheet: 2-5 cm, 0.025 deg, 0.08 deg."""
    return Navigation(
        "APX-15 UAV", np.array([0.02, 0.02, 0.04]), np.radians([0.025, 0.025, 0.08]), 30.0
    )
