"""Which matched faces do not lie on the plane they were matched to.

Graduated non-convexity with a truncated least-squares loss (Yang et al. 2020): the adjustment with
free planes is repeated with a weight per face, first with a loss so wide that every face counts,
then narrowing until a face counts fully or not at all. A wrong match misses its plane by
decimetres to metres, a right one by the noise of its trajectory.
"""

from dataclasses import dataclass

import numpy as np

from paperrepro.adjustment.centroids import centroid_variances, virtual_jacobians
from paperrepro.adjustment.faces import FaceStates, face_states
from paperrepro.adjustment.gauss_helmert import Pseudo, solve_free
from paperrepro.adjustment.matched import MatchedFaces, Rejection
from paperrepro.adjustment.normals import (
    Blocks,
    Unknowns,
    observation_variances,
    point_blocks,
)
from paperrepro.survey import Survey

#: A face is right as long as it misses its plane by no more than so many standard deviations.
LIMIT_SIGMAS = 4.0
#: Points of a face that are looked at: evenly spaced, enough for its place and tilt.
POINTS_PER_FACE = 80
STAGES = 40
_LEAST_WEIGHT = 1e-9


@dataclass(frozen=True)
class Screening:
    """``kept`` (F,) bool of the faces, the ``rejected`` ones, and the ``boresight`` (3,) rad on
    which the kept ones agree: near that of any scenario, so a good place to start from."""

    kept: np.ndarray
    boresight: np.ndarray
    rejected: tuple[Rejection, ...]


def screen(survey: Survey, matched: MatchedFaces) -> Screening:
    """Find the faces of ``matched`` that do not belong to their planes."""
    thin = matched.thinned(POINTS_PER_FACE)
    unknowns = Unknowns.layout(survey.mounting, survey.scanner.n_rings, "none")
    variances = observation_variances(survey.navigation, survey.scanner)
    x = unknowns.start()
    states = face_states(thin.rays, thin.plane_ranges, unknowns, x)
    problem = _Problem(thin, unknowns, variances, states.centroid)
    planes = states.plane.copy()
    planes[:, 3] -= np.einsum("ga,ga->g", planes[:, :3], problem.origin)
    weight, control = np.ones(len(thin.ranges)), None
    for _ in range(STAGES):
        x, planes = problem.solve(x, planes, weight)
        misfit, limit = problem.misfits(x, planes)
        ratio = np.square(misfit / limit)
        if control is None:
            control = 1 / max(2 * ratio.max() - 1, 1e-12)
        if ratio.max() <= 1 or control > 1e3:
            break
        weight = _weights(ratio, control)
        control *= 1.6
    kept = misfit <= limit
    return Screening(kept, x[:3], problem.rejections(x, kept, misfit, limit))


def _weights(ratio: np.ndarray, control: float) -> np.ndarray:
    """Weights of the truncated loss at squared misfits ``ratio``, in units of the limit."""
    between = np.sqrt(control * (control + 1) / np.maximum(ratio, 1e-12)) - control
    weight = np.where(ratio >= (control + 1) / control, 0.0, between)
    return np.clip(np.where(ratio <= control / (control + 1), 1.0, weight), _LEAST_WEIGHT, 1.0)


@dataclass(frozen=True)
class _Problem:
    """Free planes and a boresight on thinned faces, with a weight per face."""

    matched: MatchedFaces
    unknowns: Unknowns
    variances: np.ndarray
    origin: np.ndarray

    def solve(self, x, planes, weight) -> tuple[np.ndarray, np.ndarray]:
        pseudo = Pseudo(np.zeros(self.unknowns.size), np.zeros(self.unknowns.size))
        solution = solve_free(lambda *at: self._blocks(*at, weight), x, planes, pseudo)
        return solution.x, solution.planes

    def _blocks(self, x, planes, weight) -> Blocks:
        matched, group = self.matched, self.matched.plane
        face = point_blocks(
            matched.rays, matched.ranges, self.origin[group], planes[group],
            self.unknowns, x, self.variances,
        )  # fmt: skip
        shape = len(planes), *face.t.shape[1:]
        N, t, chi2 = np.zeros((*shape, shape[1])), np.zeros(shape), np.zeros(len(planes))
        np.add.at(N, group, face.N * weight[:, None, None])
        np.add.at(t, group, face.t * weight[:, None])
        np.add.at(chi2, group, face.chi2 * weight)
        return Blocks(N, t, chi2, np.bincount(group, face.count).astype(int))

    def misfits(self, x, planes) -> tuple[np.ndarray, np.ndarray]:
        """Root mean square misfit of each face and its limit, both (F,) m."""
        matched = self.matched
        states = face_states(matched.rays, matched.ranges, self.unknowns, x)
        plane = planes[matched.plane]
        off = np.einsum("fa,fa->f", states.centroid - self.origin[matched.plane], plane[:, :3])
        off -= plane[:, 3]
        own = states.spread(plane[:, :3])
        J_l = virtual_jacobians(states.centroid, matched.mean_poses(), self.unknowns, x)
        sigma2 = centroid_variances(plane[:, :3], J_l, np.ones(len(off)), self.variances)
        return np.sqrt(off**2 + own), LIMIT_SIGMAS * np.sqrt(sigma2)

    def rejections(self, x, kept, misfit, limit) -> tuple[Rejection, ...]:
        matched = self.matched
        states: FaceStates = face_states(matched.rays, matched.ranges, self.unknowns, x)
        return tuple(
            Rejection(
                matched.strips[f],
                int(matched.plane[f]),
                states.centroid[f],
                float(misfit[f]),
                float(limit[f]),
            )
            for f in np.flatnonzero(~kept)
        )
