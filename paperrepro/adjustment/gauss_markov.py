"""First-order Gauss-Markov process on nodes in time: the prior of a trajectory's error.

Between nodes dt apart the error keeps ``exp(-dt / tau)`` of itself and gains the rest at random, so
that its variance stays ``sigma**2``. The process knows nothing of strips: across a turn it forgets
as much as the turn is long. Interpolated linearly between nodes.
"""

from dataclasses import dataclass

import numpy as np

#: East, north, up, roll, pitch, heading.
N_COMPONENTS = 6
#: A trajectory called free of error still gets these, m and rad: they keep the prior finite.
LEAST_SIGMA = np.array([1e-6] * 3 + [1e-8] * 3)


@dataclass(frozen=True)
class GaussMarkov:
    """Stationary ``sigma`` (6,) m and rad of each component, ``correlation_time`` (6,) s."""

    sigma: np.ndarray
    correlation_time: np.ndarray

    def information(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Information of the errors at nodes ``time`` (K,) s ascending.

        Diagonals (K, 6), the values next to them (K - 1, 6), and the logarithm of the determinant.
        """
        variance = np.square(np.maximum(self.sigma, LEAST_SIGMA))
        kept = np.exp(-np.diff(time)[:, None] / self.correlation_time)
        gained = variance * -np.expm1(-2 * np.diff(time)[:, None] / self.correlation_time)
        diagonal = np.zeros((len(time), N_COMPONENTS))
        diagonal[0] = 1 / variance
        diagonal[1:] += 1 / gained
        diagonal[:-1] += np.square(kept) / gained
        return diagonal, -kept / gained, float(-np.log(variance).sum() - np.log(gained).sum())


@dataclass(frozen=True)
class Nodes:
    """Nodes ``time`` (K,) s, ascending, on a grid of ``spacing`` s and only where points are."""

    time: np.ndarray
    spacing: float

    @classmethod
    def covering(cls, time: np.ndarray, spacing: float) -> "Nodes":
        """The grid's nodes around every one of ``time`` (N,) s."""
        cell = np.unique(np.floor(time / spacing))
        return cls(np.union1d(cell, cell + 1) * spacing, spacing)

    def locate(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """For each of ``time`` (N,): the node before it, and the share (N,) of the next one."""
        before = np.searchsorted(self.time, time, side="right") - 1
        before = np.clip(before, 0, len(self.time) - 2)
        return before, np.clip((time - self.time[before]) / self.spacing, 0.0, 1.0)
