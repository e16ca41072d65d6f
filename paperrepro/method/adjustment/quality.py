"""How good an adjustment can be: reliability after Baarda (1968), and the Cramer-Rao bound.

The gross error looked for is a bias of one view: all its points moved along the plane's normal, as
a wrong match, a chimney, snow on the roof or a jump of the trajectory would move them. In scenario
D's conditions such a bias is minus the view's own plane distance, so its normal equations are rows
that exist already.

The Cramer-Rao bound says what no unbiased estimate from the same points can undercut. It is
computed where the truth is known: at the true mounting, under the process that the trajectory's
error really follows, with nodes so close that nothing happens between them. White noise of the
poses is left out, so the true bound is a little higher and the comparison a little strict.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from paperrepro._compiled import one_blas_thread
from paperrepro.method.adjustment.trajectory_equations import GaussMarkov
from paperrepro.method.adjustment.trajectory_solver import (
    Noise,
    Solution,
    TrajectoryModel,
    eliminate,
)
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Mounting, Survey

#: A bias counts as detectable where a test at this level finds it with this power (Baarda 1968).
LEVEL, POWER = 0.001, 0.80
#: Standardised bias that such a test detects, 4.13.
NON_CENTRALITY = float(stats.norm.ppf(1 - LEVEL / 2) + stats.norm.ppf(POWER))


@dataclass(frozen=True)
class Reliability:
    """Of each view, in the order of the matched faces: its ``strip`` and ``plane`` (F,);
    ``redundancy`` (F,) between 0 and 1, the share of its information on a bias that is left once
    all unknowns have taken theirs; ``detectable`` (F,) m, the minimal detectable bias; ``turns``
    (F, 3) rad, what an undetected bias of that size does to the boresight; ``bias`` (F,) m, the
    estimate, positive along the normal, and ``standardised`` (F,), the same in its own sigma (the
    statistic of data snooping)."""

    strip: tuple[str, ...]
    plane: np.ndarray
    redundancy: np.ndarray
    detectable: np.ndarray
    turns: np.ndarray
    bias: np.ndarray
    standardised: np.ndarray

    def of_planes(self) -> np.ndarray:
        """(G,) m: of each plane, the bias that can hide in the view where it hides best."""
        worst = np.zeros(int(self.plane.max()) + 1)
        np.maximum.at(worst, self.plane, self.detectable)
        return worst


def reliability(
    model: TrajectoryModel, noise: Noise, solution: Solution, of_surface: np.ndarray
) -> Reliability:
    """`Reliability` of the views at the ``solution``, whose surface errors have variances
    ``of_surface`` (F, 3).

    A bias has the column of the view's own surface offset, so all that is asked of it is known: of
    the information ``1 / Q`` on that offset the prior's is ``p``, and a bias beside it is left with
    ``p (1 - p Q)``, and with a score of ``p`` times the offset found.
    """
    state, strips, scale = solution.state, model.tie_planes.strips, model.to_plane[:, 2, 0]
    p = noise.surface_weight / scale**2
    own = np.zeros(len(strips))
    for window, data in zip(model.windows, solution.data.windows, strict=True):
        offsets = len(data.t) - 3 * len(window.faces) + 3 * np.arange(len(window.faces)) + 2
        own[window.faces] = data.N[offsets, offsets]
    own *= p / (own + p)
    information = np.maximum(p * (1 - p * scale**2 * of_surface[:, 0]), 1e-12 * own)
    detectable, score = NON_CENTRALITY / np.sqrt(information), p * scale * state.surface[:, 0]
    turns, of_angles = np.zeros((len(strips), 3)), solution.step.columns(3)
    for window, step, where in zip(
        model.windows, solution.step.steps, solution.step.where, strict=True
    ):
        with_views = -step.views[:, :-1] @ of_angles[where]
        turns[window.faces] = -with_views[::3] * (p * scale)[window.faces][:, None]
    turns *= detectable[:, None]
    return Reliability(
        strip=strips,
        plane=model.tie_planes.plane,
        redundancy=information / own,
        detectable=detectable,
        turns=turns,
        bias=score / information,
        standardised=score / np.sqrt(information),
    )


#: Seconds between nodes: half of scenario D's change the bound by less than 0.2 %.
SPACING = 0.05


@dataclass(frozen=True)
class TrueNoise:
    """What really disturbs a survey: the ``process`` of the trajectory's error and the spread
    ``range_offset_sigma`` m of the beams' offsets. The laser is as its scanner's specification."""

    process: GaussMarkov
    range_offset_sigma: float


@one_blas_thread
def cramer_rao_bound(
    survey: Survey,
    tie_planes: TiePlanes,
    truth: Mounting,
    noise: TrueNoise,
    spacing: float = SPACING,
) -> np.ndarray:
    """Least covariance (3, 3) rad² of the boresight, given the points of ``tie_planes``.

    The range offsets' spread is prior knowledge here, as in the adjustment.
    """
    scanner = replace(survey.scanner, range_offset_sigma=max(noise.range_offset_sigma, 1e-6))
    model = TrajectoryModel.prepare(
        replace(survey, mounting=truth, scanner=scanner), tie_planes, "per_ring", spacing
    )
    x = model.unknowns.start()
    x[3:] = truth.offsets(scanner.n_rings)
    state = model.start(x)
    flat = Noise((noise.process,), np.zeros(6), 0.0)
    return eliminate(model.normals(state, flat), model, flat, state).columns(3)[:3]
