"""The lever arm as an unknown of scenario D, and whether a flight determines it.

Opposite headings separate its forward and right parts from everything but the trajectory's own
position error, which averages out over the strips. Its down part moves all strips alike, and the
planes are unknown too: only the tilts of the body in gusts and turns tell it from them. Without
such tilts it keeps what it was before the flight.
"""

from dataclasses import dataclass

import numpy as np

from paperrepro.adjustment.normals import Unknowns
from paperrepro.survey import Mounting

#: How well a lever arm is known before the flight, m: measured by tape between housings.
PRIOR_SIGMA = 0.05
#: An axis counts as determined where the flight leaves no more than this share of the prior sigma.
DETERMINED = 0.5
AXES = ("forward", "right", "down")


@dataclass(frozen=True)
class LeverArmUnknowns(Unknowns):
    """`Unknowns` with three more at the end of ``x``: corrections of the lever arm, m, b-frame."""

    @property
    def size(self) -> int:
        return super().size + 3

    def kernel_arguments(self, x: np.ndarray) -> tuple:
        R, dR, lever, offsets, ring_column = super().kernel_arguments(x)
        return R, dR, lever + x[-3:], offsets, ring_column


@dataclass(frozen=True)
class LeverArm:
    """``value`` (3,) m b-frame as adjusted, the ``correction`` (3,) to what was given, and
    ``sigma`` (3,) m; ``prior_sigma`` m before the flight."""

    value: np.ndarray
    correction: np.ndarray
    sigma: np.ndarray
    prior_sigma: float = PRIOR_SIGMA

    @classmethod
    def of(cls, mounting: Mounting, x: np.ndarray, covariance: np.ndarray) -> "LeverArm":
        """From the last three of ``x`` and of its ``covariance``."""
        sigma = np.sqrt(np.diag(covariance)[-3:])
        return cls(np.asarray(mounting.lever_arm, float) + x[-3:], x[-3:], sigma)

    @property
    def determined(self) -> np.ndarray:
        """(3,) bool: the flight, not the value given before it, decides."""
        return self.sigma <= DETERMINED * self.prior_sigma

    def __str__(self) -> str:
        return "lever arm: " + ", ".join(self._words(axis) for axis in range(3))

    def _words(self, axis: int) -> str:
        words = f"{AXES[axis]} {self.value[axis]:+.3f} m (sigma {self.sigma[axis]:.3f} m"
        if not self.determined[axis]:
            words += f"; not determined by this flight, given to {self.prior_sigma:.3f} m before it"
        return words + ")"
