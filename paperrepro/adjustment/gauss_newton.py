"""When a Gauss-Newton iteration ends, and how far it settles the observations meanwhile."""

from dataclasses import dataclass

import numpy as np

MAX_ITERATIONS = 50
#: Largest correction, rad and m, at which the iterations end.
TOLERANCE = 1e-9
#: Change of a misclosure, m, at which a point's adjusted observations are final: each step gains
#: some five digits, so what is left is rounding. While the unknowns still move, by more than
#: `NEARLY` rad or m, `SETTLING` does: what it leaves out moves them by less than 1e-9.
SETTLED, SETTLING, NEARLY = 1e-10, 1e-4, 1e-6


@dataclass
class Iterations:
    """How many were ``made``, to what change of misclosure, m, the next settles observations, and
    the largest correction, ``change`` rad or m, of the last."""

    made: int = 0
    settled: float = SETTLING
    change: float = np.inf
    converged: bool = False

    def take(self, *corrections: np.ndarray) -> None:
        """Note the corrections of one iteration."""
        self.made += 1
        self.change = max(float(np.abs(values).max()) for values in corrections)
        self.converged = self.change < TOLERANCE and self.settled == SETTLED
        if self.change < NEARLY:
            self.settled = SETTLED

    @property
    def too_many(self) -> bool:
        return self.made >= MAX_ITERATIONS and not self.converged
