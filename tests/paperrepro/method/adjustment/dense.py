"""The textbook adjustments, written out: one big matrix each, no elimination, no shortcut.

Nothing here calls the solver, its kernels or its derivatives. Points come from a complex-valued
Eq. (1) and (2), so that ``imag f(x + ih) / h`` is a derivative without a difference.
"""

from dataclasses import dataclass

import numpy as np

from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Survey

TINY = 1e-30
T_NED_ENU = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])


def turn(axis, angle):
    """Right-handed rotations (..., 3, 3) about coordinate ``axis``; complex angles allowed."""
    angle = np.asarray(angle)
    R = np.zeros((*angle.shape, 3, 3), angle.dtype)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[..., axis, axis] = 1
    R[..., i, i] = R[..., j, j] = np.cos(angle)
    R[..., i, j], R[..., j, i] = -np.sin(angle), np.sin(angle)
    return R


def points(boresight, offset, obs, mounting):
    """Points (N, 3) of observations (N, 9) and each point's range offset (N,). Eq. (1), Eq. (2)."""
    roll, pitch, heading, rho, azimuth, elevation = obs[:, 3:].T
    r_l = (rho + offset) * np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    omega, phi, kappa = boresight
    R_l_b = turn(2, kappa) @ turn(1, phi) @ turn(0, omega) @ mounting.R_nominal
    R_b_m = T_NED_ENU @ turn(2, heading) @ turn(1, pitch) @ turn(0, roll)
    r_b = (R_l_b @ r_l).T + mounting.lever_arm
    return obs[:, :3] + np.einsum("nab,nb->na", R_b_m, r_b)


def derivative(function, at):
    """Derivative (N, len(at)) of a vector function by complex steps."""
    steps = 1j * TINY * np.eye(len(at))
    return np.column_stack([function(at + step).imag / TINY for step in steps])


@dataclass
class Problem:
    """Everything an adjustment starts from, as plain arrays.

    ``obs`` (N, 9), ``sigma`` (9,), ``column`` (N,) each point's column of x for its range offset or
    -1, ``size`` of x, ``offset_sigma`` m, ``face`` (N,) and ``plane`` (N,) of each point.
    """

    survey: Survey
    tie_planes: TiePlanes
    obs: np.ndarray
    sigma: np.ndarray
    column: np.ndarray
    size: int
    offset_sigma: float
    face: np.ndarray
    plane: np.ndarray

    @classmethod
    def of(cls, survey: Survey, tie_planes: TiePlanes, range_offsets: str) -> "Problem":
        rays = tie_planes.rays
        obs = np.column_stack([rays.pose, rays.rho, rays.azimuth, rays.elevation])
        scanner, navigation = survey.scanner, survey.navigation
        laser = [scanner.range_sigma, scanner.angle_sigma, scanner.angle_sigma]
        sigma = np.concatenate([navigation.position_sigma, navigation.attitude_sigma, laser])
        ring = np.asarray(rays.ring, int)
        column, size = {
            "none": (np.full(len(ring), -1), 3),
            "common": (np.full(len(ring), 3), 4),
            "per_ring": (3 + ring, 3 + scanner.n_rings),
        }[range_offsets]
        face = np.repeat(
            np.arange(len(tie_planes.ranges)), np.diff(tie_planes.ranges, axis=1).ravel()
        )
        return cls(
            survey, tie_planes, obs, sigma, column, size, scanner.range_offset_sigma,
            face, np.asarray(tie_planes.plane)[face],
        )  # fmt: skip

    def points(self, x, obs=None, rows=slice(None)):
        """Points (N, 3) under ``x``, all or those of ``rows``, of other observations if given."""
        column = self.column[rows]
        offset = np.where(column >= 0, x[column], 0)
        obs = self.obs[rows] if obs is None else obs
        return points(x[:3], offset, obs, self.survey.mounting)

    def centroids(self, x):
        """Centroids (F, 3) of the faces."""
        p = self.points(x)
        return np.array([p[self.face == f].mean(axis=0) for f in range(self.face.max() + 1)])

    def by_observation(self, x, obs, rows=slice(None)):
        """Derivatives (N, 3, 9) of the points, by complex steps."""
        steps = 1j * TINY * np.eye(9)
        return np.stack([self.points(x, obs + step, rows).imag / TINY for step in steps], axis=2)

    def virtual_rays(self, x):
        """Each face's centroid as the end of one ray: observations and their sigma (F, 9)."""
        rows, sigmas = [], []
        R_l_b = turn(2, x[2]) @ turn(1, x[1]) @ turn(0, x[0]) @ self.survey.mounting.R_nominal
        for f, c_m in enumerate(self.centroids(x)):
            pose = self.obs[self.face == f, :6].mean(axis=0)
            roll, pitch, heading = pose[3:]
            R_b_m = T_NED_ENU @ turn(2, heading) @ turn(1, pitch) @ turn(0, roll)
            r_l = R_l_b.T @ (R_b_m.T @ (c_m - pose[:3]) - self.survey.mounting.lever_arm)
            rho = np.linalg.norm(r_l)
            azimuth, elevation = np.arctan2(r_l[1], r_l[0]), np.arcsin(r_l[2] / rho)
            rows.append([*pose, rho, azimuth, elevation])
            share = np.where(np.arange(9) < 6, 1, 1 / np.sqrt((self.face == f).sum()))
            sigmas.append(self.sigma * share)
        return np.array(rows), np.array(sigmas)

    def virtual_derivatives(self, x):
        """Derivatives (F, 3, 9) of the centroids by their virtual rays' observations."""
        rays, _ = self.virtual_rays(x)
        mounting = self.survey.mounting
        steps = 1j * TINY * np.eye(9)
        moved = [points(x[:3], np.zeros(len(rays)), rays + step, mounting) for step in steps]
        return np.stack([p.imag / TINY for p in moved], axis=2)


@dataclass
class Adjusted:
    """Unknowns ``x`` (u,), their cofactors ``Q`` (u, u), ``sigma0``, ``dof``; planes (G, 4) in the
    m-frame with cofactors (G, 4, 4) where they are unknowns."""

    x: np.ndarray
    Q: np.ndarray
    sigma0: float
    dof: int
    planes: np.ndarray | None = None
    Q_planes: np.ndarray | None = None


def best_plane(p_m):
    """Least-squares plane (4,) as (n, d) of points (N, 3), by singular value decomposition."""
    centre = p_m.mean(axis=0)
    n = np.linalg.svd(p_m - centre)[2][2]
    n = n if n[2] > 0 else -n
    return np.append(n, n @ centre)


def adjust_free(problem: Problem, centroids: bool) -> Adjusted:
    """Gauss-Helmert with every observation, unknown and constraint in one system (Pope's form).

    Unknowns: x and all planes. Conditions: each point on its plane; each centroid on its plane
    where ``centroids``; each range offset observed as zero. Unit normals by Lagrange multipliers.
    """
    x = np.append(problem.survey.mounting.boresight, np.zeros(problem.size - 3))
    start = problem.points(x)
    planes = np.array(
        [best_plane(start[problem.plane == g]) for g in range(problem.plane.max() + 1)]
    )
    system = _FreeSystem(problem, centroids, len(planes))
    unknowns, v = np.concatenate([x, planes.ravel()]), np.zeros(len(system.sigma))
    for _ in range(40):
        A, B, f = system.linearised(unknowns, v)
        correction, v, inverse = _step(system, A, B, f - B @ v, unknowns)
        unknowns = unknowns + correction
        if np.abs(correction).max() < 1e-13:
            break
    u, n_planes = problem.size, len(planes)
    dof = len(A) - len(unknowns) + n_planes
    Q = inverse[: len(unknowns), : len(unknowns)]
    Q_planes = [Q[u + 4 * g : u + 4 * g + 4, u + 4 * g : u + 4 * g + 4] for g in range(n_planes)]
    sigma0 = np.sqrt(np.square(v / system.sigma).sum() / dof)
    planes = unknowns[u:].reshape(-1, 4)
    return Adjusted(unknowns[:u], Q[:u, :u], sigma0, dof, planes, np.array(Q_planes))


def _step(system, A, B, w, unknowns):
    """Solve ``A d + B v + w = 0``, ``C d + c = 0`` for least ``v' Q^-1 v``."""
    C, c = system.constraints(unknowns)
    Q = np.diag(np.square(system.sigma))
    weight = np.linalg.inv(B @ Q @ B.T)
    zero = np.zeros((len(C), len(C)))
    inverse = np.linalg.inv(np.block([[A.T @ weight @ A, C.T], [C, zero]]))
    correction = -(inverse @ np.concatenate([A.T @ weight @ w, c]))[: len(unknowns)]
    v = -Q @ B.T @ weight @ (A @ correction + w)
    return correction, v, inverse


class _FreeSystem:
    """Conditions, matrices A and B, and constraints of `adjust_free`."""

    def __init__(self, problem, centroids, n_planes):
        self.problem, self.centroids, self.n_planes = problem, centroids, n_planes
        self.n_points, self.n_pseudo = len(problem.obs), problem.size - 3
        self.n_faces = problem.face.max() + 1 if centroids else 0
        start = np.append(problem.survey.mounting.boresight, np.zeros(problem.size - 3))
        virtual = problem.virtual_rays(start)[1][: self.n_faces]
        pseudo = np.full(self.n_pseudo, problem.offset_sigma)
        points = np.tile(problem.sigma, self.n_points)
        self.sigma = np.concatenate([points, virtual.ravel(), pseudo])

    def conditions(self, unknowns, v):
        """All conditions (c,): adjusted points, then centroids, then pseudo-observations."""
        problem, u = self.problem, self.problem.size
        x, planes = unknowns[:u], unknowns[u:].reshape(-1, 4)
        obs = problem.obs + v[: 9 * self.n_points].reshape(-1, 9)
        n, d = planes[problem.plane, :3], planes[problem.plane, 3]
        on_plane = (n * problem.points(x, obs)).sum(axis=1) - d
        parts = [on_plane]
        if self.centroids:
            n, d = planes[problem.tie_planes.plane, :3], planes[problem.tie_planes.plane, 3]
            parts.append((n * problem.centroids(x)).sum(axis=1) - d)
        pseudo = x[3:] - (v[len(v) - self.n_pseudo :] if self.n_pseudo else 0)
        return np.concatenate([*parts, pseudo])

    def linearised(self, unknowns, v):
        """A, B, and the conditions with B v of the virtual rays added, so linear in those."""
        problem, u = self.problem, self.problem.size
        x, planes = unknowns[:u], unknowns[u:].reshape(-1, 4)
        A = derivative(lambda at: self.conditions(at, v), unknowns)
        B = np.zeros((len(A), len(v)))
        obs = problem.obs + v[: 9 * self.n_points].reshape(-1, 9)
        J_l = problem.by_observation(x, obs)
        for i in range(self.n_points):
            B[i, 9 * i : 9 * i + 9] = planes[problem.plane[i], :3] @ J_l[i]
        J_c = problem.virtual_derivatives(x)
        for f in range(self.n_faces):
            row, first = self.n_points + f, 9 * (self.n_points + f)
            B[row, first : first + 9] = planes[problem.tie_planes.plane[f], :3] @ J_c[f]
        for k in range(self.n_pseudo):
            B[len(B) - self.n_pseudo + k, len(v) - self.n_pseudo + k] = -1
        value = self.conditions(unknowns, v)
        virtual = slice(self.n_points, self.n_points + self.n_faces)
        value[virtual] += B[virtual] @ v
        return A, B, value

    def constraints(self, unknowns):
        """Unit normals: C (G, unknowns) and misclosures (G,)."""
        u = self.problem.size
        normals = unknowns[u:].reshape(-1, 4)[:, :3]
        C = np.zeros((self.n_planes, len(unknowns)))
        for g, n in enumerate(normals):
            C[g, u + 4 * g : u + 4 * g + 3] = 2 * n
        return C, (normals**2).sum(axis=1) - 1


def adjust_reference(problem: Problem, with_points: bool, with_centroids: bool) -> Adjusted:
    """Brute-force weighted least squares on planes of reference faces, by central differences.

    Each iteration holds the observations' residuals and the weights, differentiates the conditions
    as functions of x (reference planes are fitted anew for every x) and solves.
    """
    system = _PairSystem(problem, with_points, with_centroids)
    x = np.append(problem.survey.mounting.boresight, np.zeros(problem.size - 3))
    prior = np.append(np.zeros(3), np.full(problem.size - 3, problem.offset_sigma**-2.0))
    for _ in range(40):
        v, w, s = system.misclosures(x)
        J = _differences(lambda at, v=v: system.conditions(at, v), x)
        normal = J.T @ (J / s[:, None]) + np.diag(prior)
        correction = -np.linalg.solve(normal, J.T @ (w / s) + prior * x)
        x = x + correction
        if np.abs(correction).max() < 1e-12:
            break
    dof = len(w) + np.count_nonzero(prior) - len(x)
    sigma0 = np.sqrt(((w**2 / s).sum() + prior @ x**2) / dof)
    return Adjusted(x, np.linalg.inv(normal), sigma0, dof)


def _differences(function, x, step=1e-6):
    """Central differences of a vector function: error below 1e-8 of the derivative."""
    steps = step * np.eye(len(x))
    return np.column_stack([(function(x + h) - function(x - h)) / (2 * step) for h in steps])


class _PairSystem:
    """Conditions of `adjust_reference`: points, then centroids, of each pair's search face."""

    def __init__(self, problem, with_points, with_centroids):
        self.problem, self.with_centroids = problem, with_centroids
        self.reference, self.search = problem.tie_planes.pairs.T
        rows = [np.flatnonzero(problem.face == f) for f in self.search] if with_points else []
        self.rows = np.concatenate(rows) if rows else np.zeros(0, int)
        self.pair = np.repeat(np.arange(len(rows)), [len(r) for r in rows]).astype(int)

    def planes(self, x):
        """(P, 4), each pair's reference plane under ``x``."""
        p, face = self.problem.points(x), self.problem.face
        fitted = {f: best_plane(p[face == f]) for f in np.unique(self.reference)}
        return np.array([fitted[f] for f in self.reference])

    def conditions(self, x, v):
        """Conditions with the residuals ``v`` of the points' observations held."""
        planes, obs = self.planes(x), self.problem.obs[self.rows] + v
        p, each = self.problem.points(x, obs, self.rows), planes[self.pair]
        value = (each[:, :3] * p).sum(axis=1) - each[:, 3]
        if not self.with_centroids:
            return value
        centroids = self.problem.centroids(x)[self.search]
        return np.append(value, (planes[:, :3] * centroids).sum(axis=1) - planes[:, 3])

    def misclosures(self, x):
        """Least residuals (K, 9) that bring the points on the planes; ``w`` and variances there."""
        planes, sigma = self.planes(x), self.problem.sigma
        v = np.zeros((len(self.rows), 9))
        for _ in range(10):
            obs = self.problem.obs[self.rows] + v
            J_l = self.problem.by_observation(x, obs, self.rows)
            b = np.einsum("na,nam->nm", planes[self.pair, :3], J_l)
            w = self.conditions(x, v)
            w[: len(v)] -= (b * v).sum(axis=1)
            s = (b**2 * sigma**2).sum(axis=1)
            v = -(sigma**2) * b * (w[: len(v)] / s)[:, None]
        return v, w, np.append(s, self._centroid_variances(x, planes))

    def _centroid_variances(self, x, planes):
        """(P,): that of the search face's centroid and that of the reference face's, added."""
        if not self.with_centroids:
            return []
        J, (_, sigma) = self.problem.virtual_derivatives(x), self.problem.virtual_rays(x)
        total = 0.0
        for face in (self.reference, self.search):
            b = np.einsum("pa,pam->pm", planes[:, :3], J[face])
            total = total + np.square(b * sigma[face]).sum(axis=1)
        return total
