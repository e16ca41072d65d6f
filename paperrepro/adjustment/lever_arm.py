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
#: Clocks of laser and GNSS/INS agree to this before the flight, s: some are off by a record.
CLOCK_SIGMA = 0.01
#: An axis counts as determined where the flight leaves no more than this share of the prior sigma.
DETERMINED = 0.5
AXES = ("forward", "right", "down")


@dataclass(frozen=True)
class TrajectoryUnknowns(Unknowns):
    """`Unknowns` with more at the end of ``x``: corrections of the ``lever`` arm, m, b-frame, and
    the delay of the laser's ``clock``, s, where they are unknown."""

    lever: bool = False
    clock: bool = False

    @property
    def size(self) -> int:
        return self.kept + 3 * self.lever + self.clock

    @property
    def kept(self) -> int:
        """Boresight and offsets."""
        return super().size

    @property
    def lever_at(self) -> slice:
        """Where the lever arm is in ``x``."""
        return slice(self.kept, self.kept + 3 * self.lever)

    def clock_delay(self, x: np.ndarray) -> float:
        """s, by which the poses must be taken later."""
        return float(x[-1]) if self.clock else 0.0

    def pseudo_weight(self, range_offset_sigma: float) -> np.ndarray:
        """(size,) what is known of the unknowns before the flight."""
        weight = np.zeros(self.size)
        weight[3 : self.kept] = range_offset_sigma**-2.0
        weight[self.lever_at] = PRIOR_SIGMA**-2.0
        if self.clock:
            weight[-1] = CLOCK_SIGMA**-2.0
        return weight

    def kernel_arguments(self, x: np.ndarray) -> tuple:
        R, dR, lever, offsets, ring_column = super().kernel_arguments(x)
        if self.lever:
            lever = lever + x[self.lever_at]
        return R, dR, lever, offsets, ring_column


@dataclass(frozen=True)
class Clock:
    """``delay`` s by which poses must be taken later than the points' times say, its ``sigma``."""

    delay: float
    sigma: float


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
        """From its three of ``x`` and their ``covariance``."""
        return cls(np.asarray(mounting.lever_arm, float) + x, x, np.sqrt(np.diag(covariance)))

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
