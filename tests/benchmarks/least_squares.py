"""SL, A, B and C once more: the same conditions, given to ``scipy.optimize.least_squares``.

A point's part of the cost is the least that brings it onto its plane, so its residual is
``w / sqrt(s)`` at the adjusted observations; written in NumPy, derivatives by SciPy's differences.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from scipy.sparse import csr_matrix

from paperrepro.method.adjustment.scenarios import SCENARIOS
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Survey
from tests.benchmarks.peers import attitudes
from tests.paperrepro.method.adjustment.dense import Problem, turn


@dataclass(frozen=True)
class Conditions:
    """Rows of Eq. (4), each a point ``row`` (K,) on plane ``of_row`` (K,), and of Eq. (5), each a
    face ``face`` (L,) on plane ``of_face`` (L,) with standard deviation ``sigma`` (L,) m."""

    row: np.ndarray
    of_row: np.ndarray
    face: np.ndarray
    of_face: np.ndarray
    sigma: np.ndarray


def solve(survey: Survey, tie_planes: TiePlanes, name: str, at: np.ndarray) -> OptimizeResult:
    """Adjust by SciPy, from the survey's mounting. The weights of centroids are those at ``at``
    (u,), the solution: the estimators hold a condition's variance while they differentiate."""
    scenario = SCENARIOS[name]
    problem = Problem.of(survey, tie_planes, scenario.range_offsets)
    start = np.r_[survey.mounting.boresight, np.zeros(problem.size - 3)]
    tight = {"xtol": 1e-11, "ftol": 1e-13, "gtol": None, "max_nfev": 40}
    if not scenario.free_planes:
        conditions = _of_pairs(problem, scenario, at)
        return least_squares(lambda x: _residuals(problem, conditions, x, _pair_planes(problem, x)),
                             start, **tight)  # fmt: skip
    conditions = _of_planes(problem, scenario, at)
    first = _fitted(problem.points(start), tie_planes.plane_ranges)
    origin = _centroids(problem.points(start), tie_planes.plane_ranges)
    axes = np.argsort(-np.abs(first[:, :3]), axis=1)  # of the normal, the greatest component first
    n = np.take_along_axis(first[:, :3], axes, axis=1)
    free = np.column_stack([n[:, 1:] / n[:, :1], np.zeros(len(n))])

    def cost(unknowns):
        planes = _planes_of(unknowns[problem.size :].reshape(-1, 3), origin, axes)
        return _residuals(problem, conditions, unknowns[: problem.size], planes)

    sparsity = _sparsity(problem, conditions, problem.size + free.size)
    unknowns = np.r_[start, free.ravel()]
    return least_squares(cost, unknowns, jac_sparsity=sparsity, x_scale="jac", **tight)


def _centroids(p: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """Mean points (G, 3) of rows ``ranges`` (G, 2), which follow each other."""
    return np.add.reduceat(p, ranges[:, 0]) / np.diff(ranges, axis=1)


def _planes_of(parameters, origin, axes) -> np.ndarray:
    """Planes (G, 4), from two ratios of the normal's components and the distance from origin."""
    n = np.ones((len(parameters), 3))
    np.put_along_axis(n, axes[:, 1:], parameters[:, :2], axis=1)
    n /= np.linalg.norm(n, axis=1)[:, None]
    return np.column_stack([n, np.einsum("ga,ga->g", n, origin) + parameters[:, 2]])


def _fitted(p: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """Planes (G, 4) by PCA of points in rows ``ranges`` (G, 2), which follow each other."""
    centre = _centroids(p, ranges)
    q = p - np.repeat(centre, np.diff(ranges, axis=1)[:, 0], axis=0)
    scatter = np.add.reduceat(q[:, :, None] * q[:, None], ranges[:, 0])
    n = np.linalg.eigh(scatter)[1][:, :, 0]
    n = n * np.where(n[:, 2:] < 0, -1, 1)
    return np.column_stack([n, np.einsum("ga,ga->g", n, centre)])


def _pair_planes(problem: Problem, x) -> np.ndarray:
    """Plane (P, 4) of each pair's reference face under ``x``."""
    return _fitted(problem.points(x), problem.tie_planes.ranges)[problem.tie_planes.pairs[:, 0]]


def _of_planes(problem: Problem, scenario, at) -> Conditions:
    tie_planes, rows = problem.tie_planes, np.arange(len(problem.obs))
    faces = np.arange(len(tie_planes.ranges) * scenario.centroids)
    of_face = tie_planes.plane[faces]
    planes = _fitted(problem.points(at), tie_planes.plane_ranges)
    sigma = _centroid_sigma(problem, at, planes[of_face], faces)
    return Conditions(rows, problem.plane, faces, of_face, sigma)


def _of_pairs(problem: Problem, scenario, at) -> Conditions:
    reference, search = problem.tie_planes.pairs.T
    lengths = np.diff(problem.tie_planes.ranges, axis=1)[search, 0] * scenario.has_points
    first = problem.tie_planes.ranges[search, 0]
    row = np.repeat(first - np.r_[0, np.cumsum(lengths)[:-1]], lengths) + np.arange(lengths.sum())
    planes = _pair_planes(problem, at)
    sigma = np.hypot(*(_centroid_sigma(problem, at, planes, f) for f in (search, reference)))
    return Conditions(row, np.repeat(np.arange(len(search)), lengths), search,
                      np.arange(len(search)), sigma)  # fmt: skip


def _centroid_sigma(problem: Problem, x, planes, faces) -> np.ndarray:
    """(L,) m of centroids of ``faces`` (L,) across ``planes`` (L, 4)."""
    if not len(faces):
        return np.zeros(0)
    by_ray, (_, sigma) = problem.virtual_derivatives(x), problem.virtual_rays(x)
    across = np.einsum("la,lam->lm", planes[:, :3], by_ray[faces])
    return np.linalg.norm(across * sigma[faces], axis=1)


def _residuals(problem: Problem, conditions: Conditions, x, planes) -> np.ndarray:
    """All conditions, each in units of its standard deviation."""
    parts = [x[3:] / problem.offset_sigma]
    if len(conditions.row):
        parts.append(_on_planes(problem, x, conditions.row, planes[conditions.of_row]))
    if len(conditions.face):
        each = planes[conditions.of_face]
        centroid = _centroids(problem.points(x), problem.tie_planes.ranges)
        w = np.einsum("la,la->l", each[:, :3], centroid[conditions.face]) - each[:, 3]
        parts.append(w / conditions.sigma)
    return np.concatenate(parts)


def _on_planes(problem: Problem, x, row, plane) -> np.ndarray:
    """Residuals (K,) of points ``row`` on ``plane`` (K, 4) at the adjusted observations."""
    v = np.zeros((len(row), 9))
    for _ in range(4):
        obs = problem.obs[row] + v
        p = problem.points(x, obs, row)
        b = _by_observation(problem, x, obs, row, p, plane[:, :3])
        w = np.einsum("na,na->n", p, plane[:, :3]) - plane[:, 3] - (b * v).sum(axis=1)
        s = (np.square(b) * np.square(problem.sigma)).sum(axis=1)
        v = -b * np.square(problem.sigma) * (w / s)[:, None]
    return w / np.sqrt(s)


def _by_observation(problem: Problem, x, obs, row, p, normal) -> np.ndarray:
    """``n . dp/dl`` (K, 9): cross products with the axes about which each angle turns."""
    R_b_m = attitudes(obs[:, 3:6])
    omega, phi, kappa = x[:3]
    R_l_b = turn(2, kappa) @ turn(1, phi) @ turn(0, omega) @ problem.survey.mounting.R_nominal
    arm, level = p - obs[:, :3], np.zeros_like(p)
    level[:, 0], level[:, 1] = np.cos(obs[:, 5]), -np.sin(obs[:, 5])
    ray = arm - R_b_m @ problem.survey.mounting.lever_arm
    spin = R_b_m @ R_l_b[:, 2]
    length = np.linalg.norm(ray, axis=1)
    upward = (length[:, None] * spin - np.sin(obs[:, 8])[:, None] * ray) / np.cos(obs[:, 8])[
        :, None
    ]
    turned = (
        np.cross(R_b_m[:, :, 0], arm), np.cross(level, arm), np.cross([0.0, 0.0, -1.0], arm),
        ray / length[:, None], np.cross(spin, ray), upward,
    )  # fmt: skip
    return np.column_stack([normal, *(np.einsum("na,na->n", normal, t) for t in turned)])


def _sparsity(problem: Problem, conditions: Conditions, size: int) -> csr_matrix:
    """Which unknowns each condition holds."""
    of_plane = np.r_[conditions.of_row, conditions.of_face]
    shared = np.broadcast_to(np.arange(problem.size), (len(of_plane), problem.size))
    own = problem.size + 3 * of_plane[:, None] + np.arange(3)
    column = np.hstack([shared, own])
    row = problem.size - 3 + np.repeat(np.arange(len(column)), column.shape[1])
    offsets = np.arange(3, problem.size)
    row, column = np.r_[offsets - 3, row], np.r_[offsets, column.ravel()]
    return csr_matrix((np.ones(len(row)), (row, column)), shape=(row.max() + 1, size))
