"""The Cramer-Rao bound: what no unbiased estimate from the same points can undercut.

Computed where the truth is known: at the true mounting, under the process that the trajectory's
error really follows, with nodes so close that nothing happens between them. White noise of the
poses is left out, so the true bound is a little higher and the comparison a little strict.
"""

from dataclasses import dataclass, replace

import numpy as np

from paperrepro.adjustment.gauss_markov import GaussMarkov
from paperrepro.adjustment.matched import MatchedFaces
from paperrepro.adjustment.trajectory_solver import Noise, TrajectoryModel, eliminate
from paperrepro.survey import Mounting, Survey

#: Seconds between nodes: half of scenario D's change the bound by less than 0.2 %.
SPACING = 0.05


@dataclass(frozen=True)
class TrueNoise:
    """What really disturbs a survey: the ``process`` of the trajectory's error and the spread
    ``range_offset_sigma`` m of the beams' offsets. The laser is as its scanner's specification."""

    process: GaussMarkov
    range_offset_sigma: float


def cramer_rao_bound(
    survey: Survey,
    matched: MatchedFaces,
    truth: Mounting,
    noise: TrueNoise,
    spacing: float = SPACING,
) -> np.ndarray:
    """Least covariance (3, 3) rad² of the boresight, given the points of ``matched``.

    The range offsets' spread is prior knowledge here, as in the adjustment.
    """
    scanner = replace(survey.scanner, range_offset_sigma=max(noise.range_offset_sigma, 1e-6))
    model = TrajectoryModel.prepare(
        replace(survey, mounting=truth, scanner=scanner), matched, "per_ring", spacing
    )
    x = model.unknowns.start()
    x[3:] = truth.offsets(scanner.n_rings)
    state = model.start(x)
    flat = Noise((noise.process,), np.zeros(6), 0.0)
    return eliminate(model.normals(state, flat), model, flat, state).Q[:3, :3]
