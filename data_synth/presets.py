"""What can be chosen: the configuration of a simulated survey, by preset and profile."""

from dataclasses import dataclass
from numbers import Integral

import numpy as np

from paperrepro.errors import BadInput

#: True boresight omega, phi, kappa in degrees. ``mount``: mounted by hand. ``table4``: scenario A's
#: row of Table 4.
PRESETS = {"mount": (1.1, -0.8, 1.3), "table4": (0.0187, -0.0155, 0.0008)}

#: One of how many firing sequences is kept: the same geometry and beams at every profile.
PROFILES = {"quick": 16, "paper": 1}

#: What is flown over: the paper's kind of site, or a stand of trees with houses at its edge.
SCENES = ("farm", "forest")


@dataclass(frozen=True)
class SimulationConfig:
    """A simulated survey in plain scalars.

    ``noise_scale`` multiplies the GNSS/INS error only; ``sensor_noise`` switches range noise, angle
    noise and dust; ``range_offset_sigma_m`` is the spread of the beams' true range offsets;
    ``boresight_deg`` overrides the preset's; ``scene`` is one of `SCENES`. Raises
    `BadInput` where a value cannot be used.
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

    def __post_init__(self):
        _require_choice("preset", self.preset, PRESETS)
        _require_choice("profile", self.profile, PROFILES)
        _require_choice("scene", self.scene, SCENES)
        _require_whole("seed", self.seed)
        _require_not_negative("noise_scale", self.noise_scale)
        _require_not_negative("range_offset_sigma_m", self.range_offset_sigma_m)
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


def _require_angles(angles) -> None:
    if len(angles) != 3 or not np.isfinite(angles).all():
        raise BadInput(
            f"boresight_deg: expected three finite angles, got {angles!r}; "
            "give omega, phi, kappa in degrees"
        )
