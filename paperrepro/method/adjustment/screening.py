"""Which matched faces do not lie on the plane they were matched to.

First a boresight that wrong matches cannot bend: three angles from all pairs of faces that should
share a plane, each face's plane fitted to its own points alone, by graduated non-convexity with a
truncated least-squares loss (Yang et al. 2020). A common plane would be no witness: a single face
apart from the others tilts it until it fits. Then, under that boresight, the faces of a plane that
agree with each other most are kept. A wrong match misses by decimetres to metres, a right one by
the noise of its trajectory.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from paperrepro._compiled import one_blas_thread
from paperrepro.method.adjustment.conditions import (
    FaceStates,
    PreparedRays,
    Unknowns,
    centroid_variances,
    face_states,
    last_value,
    observation_variances,
    virtual_jacobians,
)
from paperrepro.method.tie_planes import Rejection, TiePlanes
from paperrepro.survey import Survey

#: Two faces agree as long as they miss each other by no more than so many standard deviations.
LIMIT_SIGMAS = 4.0
#: What segmentation leaves of chimneys and edges on a face is no wrong match, m.
LEAST_LIMIT = 0.05
#: Points of a face that are looked at: evenly spaced, enough for its place and tilt.
POINTS_PER_FACE = 80
#: The loss narrows by this factor per stage, until it is as good as truncated.
GROWTH, TRUNCATED = 1.6, 1e3


@dataclass(frozen=True)
class Screening:
    """``kept`` (F,) bool of the faces, the ``rejected`` ones, and the ``boresight`` (3,) rad on
    which the kept ones agree: near that of any scenario, so a good place to start from."""

    kept: np.ndarray
    boresight: np.ndarray
    rejected: tuple[Rejection, ...]


@one_blas_thread
def screen(survey: Survey, tie_planes: TiePlanes) -> Screening:
    """Find the faces of ``tie_planes`` that do not belong to their planes."""
    pairs = _Pairs.of(survey, tie_planes.thinned(POINTS_PER_FACE))
    x, control = survey.mounting.boresight, None
    weight = np.ones(len(pairs.one))
    while True:
        for _ in range(2):
            x = pairs.step(x, weight)
        w, _, limits = pairs.look(x)
        ratio = np.square(w / limits)
        if control is None:
            control = 1 / max(2 * ratio.max() - 1, 1e-12)
        if ratio.max() <= 1 or control > TRUNCATED:
            break
        weight = _weights(ratio, control)
        control *= GROWTH
    kept, rejected = pairs.consensus(x)
    return Screening(kept, x, rejected)


def _weights(ratio: np.ndarray, control: float) -> np.ndarray:
    """Weights of the truncated loss at squared misclosures ``ratio``, in units of the limit."""
    between = np.sqrt(control * (control + 1) / np.maximum(ratio, 1e-12)) - control
    weight = np.where(ratio >= (control + 1) / control, 0.0, between)
    return np.where(ratio <= control / (control + 1), 1.0, np.clip(weight, 0.0, 1.0))


@dataclass(frozen=True)
class _Pairs:
    """All ordered pairs of faces of a plane: centroid of ``other`` (P,) on the plane of ``one``.

    ``states`` gives the faces under a boresight, ``look`` the pairs.
    """

    tie_planes: TiePlanes
    unknowns: Unknowns
    variances: np.ndarray
    one: np.ndarray
    other: np.ndarray
    poses: np.ndarray = field(init=False)
    states: Callable[[np.ndarray], FaceStates] = field(init=False)
    look: Callable[[np.ndarray], tuple] = field(init=False)

    def __post_init__(self):
        rays, ranges = PreparedRays.of(self.tie_planes.rays), self.tie_planes.ranges
        states = last_value(lambda x: face_states(rays, ranges, self.unknowns, x))
        object.__setattr__(self, "poses", self.tie_planes.mean_poses())
        object.__setattr__(self, "states", states)
        object.__setattr__(self, "look", last_value(self._look))

    @classmethod
    def of(cls, survey: Survey, tie_planes: TiePlanes) -> "_Pairs":
        together = tie_planes.plane[:, None] == tie_planes.plane
        one, other = np.nonzero(together & ~np.eye(len(together), dtype=bool))
        unknowns = Unknowns.layout(survey.mounting, survey.scanner.n_rings, "none")
        variances = observation_variances(survey.navigation, survey.scanner)
        return cls(tie_planes, unknowns, variances, one, other)

    def _look(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distances (P,) m of centroids from planes, their derivatives (P, 3), their limits."""
        s = self.states(x)
        plane, J = s.plane[self.one], s.J_plane[self.one]
        c, J_c = s.centroid[self.other], s.J_centroid[self.other]
        w = np.einsum("pa,pa->p", c, plane[:, :3]) - plane[:, 3]
        turned = np.einsum("pa,pak->pk", c, J[:, :3]) - J[:, 3]
        A = turned + np.einsum("pa,pak->pk", plane[:, :3], J_c)
        return w, A, self._limits(s, x)

    def step(self, x: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """One weighted Gauss-Newton step; directions that nothing determines stay."""
        w, A, limits = self.look(x)
        weight = weight / np.square(limits)
        N, t = A.T @ (weight[:, None] * A), A.T @ (weight * w)
        return x - np.linalg.pinv(N, rcond=1e-10, hermitian=True) @ t

    def _limits(self, s: FaceStates, x: np.ndarray) -> np.ndarray:
        """(P,) m, from the noise of both faces' trajectories and of one point."""
        J_l = virtual_jacobians(s.centroid, self.poses, self.unknowns, x)
        sigma2 = centroid_variances(s.plane[:, :3], J_l, np.ones(len(J_l)), self.variances)
        sigma = np.sqrt(sigma2[self.one] + sigma2[self.other])
        return np.maximum(LIMIT_SIGMAS * sigma, LEAST_LIMIT)

    def consensus(self, x: np.ndarray) -> tuple[np.ndarray, tuple[Rejection, ...]]:
        """Of each plane, the faces that agree with the one that agrees with most."""
        s, F = self.states(x), len(self.tie_planes.ranges)
        w, _, limits = self.look(x)
        n, c = s.plane[self.one, :3], s.scatter[self.other]
        spread = np.einsum("pa,pab,pb->p", n, c, n) / s.count[self.other]
        misfit, limit = np.zeros((F, F)), np.full((F, F), -np.inf)
        misfit[self.one, self.other] = np.sqrt(w**2 + spread)
        limit[self.one, self.other] = limits
        agrees = (misfit <= limit) & (misfit <= limit).T
        np.fill_diagonal(agrees, True)
        kept, rejected = np.zeros(F, dtype=bool), []
        for g in range(self.tie_planes.n_planes):
            faces = np.flatnonzero(self.tie_planes.plane == g)
            middle = faces[_middle(agrees[np.ix_(faces, faces)], misfit[np.ix_(faces, faces)])]
            kept[faces] = agrees[middle, faces]
            for f in faces[~kept[faces]]:
                of = float(misfit[middle, f]), float(limit[middle, f])
                rejected.append(Rejection(self.tie_planes.strips[f], g, s.centroid[f], *of))
        return kept, tuple(rejected)


def _middle(agrees: np.ndarray, misfit: np.ndarray) -> int:
    """The face with which most agree; among equals the one nearest to those."""
    near = (misfit * agrees).sum(axis=1) / misfit.max(initial=1.0) / len(misfit)
    return int(np.argmax(agrees.sum(axis=1) - near / (1 + near.max())))
