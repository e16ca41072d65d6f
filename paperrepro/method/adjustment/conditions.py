"""Conditions of the adjustments and their normal equations: points and centroids on planes.

**Points**, Eq. (3) and (4): ``f(x, pi, l) = n . p(x, l) - d = 0``, with the unknowns ``x``
(boresight and range offsets), the plane ``pi = (n, d)`` and nine observations ``l``. It is one
equation with many observations, so ``B Q B'`` is a number. Each point is linearised at its adjusted
observations: for given ``x`` and ``pi`` the residuals ``v`` that bring it onto the plane at least
cost are found first (Skaloud and Lichti 2006, section 3). Sums are taken plane by plane, so the
result does not depend on the number of threads.

**Centroids**, Eq. (5): the centroid of a face lies on the face's plane in other strips. It is taken
as one virtual laser point. Its range and angles are averages, so their variances fall with the
number of points; its pose is shared by all of them, so the variance of the GNSS/INS does not. Where
the plane is taken from a reference strip, that strip's own pose error moves it, and adds.

A **reference plane** is no constant: it moves with the boresight as its points do. Its normal is
the eigenvector of least eigenvalue of the scatter ``S(x)``; the derivative of an eigenvector is
``sum_m u_m (u_m . dS n) / (lambda_0 - lambda_m)``.

No unknown changes an observed angle, so its sine and cosine are computed once (`PreparedRays`).
Derivatives are taken backwards in `kernels`: the plane's normal is brought to the body and to the
laser, where a derivative is one scalar product. The forward form, which the tests compare with, is
`georeference.point_jacobians`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from paperrepro._compiled import over_threads
from paperrepro.frames import attitude_matrix, boresight_matrix
from paperrepro.method.adjustment.kernels import (
    fill_turns,
    sum_faces,
    sum_points,
)
from paperrepro.method.georeference import boresight_derivatives, point_jacobians
from paperrepro.survey import Mounting, Navigation, Rays, Scanner

MAX_ITERATIONS = 50
#: Largest correction, rad and m, at which the iterations end.
TOLERANCE = 1e-9
#: Change of a misclosure, m, at which a point's adjusted observations are final: each step gains
#: some five digits, so what is left is rounding. While the unknowns still move, by more than
#: `NEARLY` rad or m, `ROUGH` does: what it leaves out moves them by less than 1e-9.
FINAL, ROUGH, NEARLY = 1e-10, 1e-4, 1e-6


@dataclass
class Iterations:
    """How many were ``made``, to what change of misclosure, m, the next settles observations, and
    the largest correction, ``change`` rad or m, of the last."""

    made: int = 0
    final_m: float = ROUGH
    change: float = np.inf
    converged: bool = False

    def take(self, *corrections: np.ndarray) -> None:
        """Note the corrections of one iteration."""
        self.made += 1
        self.change = max(float(np.abs(values).max()) for values in corrections)
        self.converged = self.change < TOLERANCE and self.final_m == FINAL
        if self.change < NEARLY:
            self.final_m = FINAL

    @property
    def too_many(self) -> bool:
        return self.made >= MAX_ITERATIONS and not self.converged


@dataclass(frozen=True)
class PreparedRays:
    """``position`` (N, 3) m m-frame, ``turns`` (N, 10) sine and cosine of roll, pitch, heading,
    azimuth, elevation, ``rho`` (N,) m measured range, ``ring`` (N,)."""

    position: np.ndarray
    turns: np.ndarray
    rho: np.ndarray
    ring: np.ndarray

    @classmethod
    def of(cls, rays: "Rays | PreparedRays") -> "PreparedRays":
        """Of rays; what is prepared already is handed back."""
        if isinstance(rays, PreparedRays):
            return rays
        turns = np.empty((len(rays), 10))
        over_threads(fill_turns, len(rays), rays.pose, rays.azimuth, rays.elevation, turns)
        return cls(np.ascontiguousarray(rays.pose[:, :3]), turns, rays.rho, rays.ring)

    def columns(self) -> tuple:
        """As the kernels take them."""
        return self.position, self.turns, self.rho, self.ring


def axes(R_l_b: np.ndarray, dR_l_b: np.ndarray) -> np.ndarray:
    """Axes (3, 3), a row each, about which omega, phi, kappa turn the laser in the body frame:
    ``dR_l_b[k] @ r = axes[k] x (R_l_b @ r)``."""
    skew = dR_l_b @ R_l_b.T
    return np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)


@dataclass(frozen=True)
class Unknowns:
    """Layout of ``x``: omega, phi, kappa, then range offsets.

    ``ring_column`` (rings,) is the column of a ring's offset in ``x``, or -1 where it is held at
    ``mounting``'s value.
    """

    mounting: Mounting
    ring_column: np.ndarray

    @classmethod
    def layout(cls, mounting: Mounting, n_rings: int, range_offsets: str) -> "Unknowns":
        """``range_offsets`` is ``none``, ``common`` (one for all) or ``per_ring``."""
        columns = {
            "none": np.full(n_rings, -1),
            "common": np.full(n_rings, 3),
            "per_ring": 3 + np.arange(n_rings),
        }
        return cls(mounting, columns[range_offsets].astype(np.int64))

    @property
    def size(self) -> int:
        return max(3, int(self.ring_column.max()) + 1)

    @property
    def n_rings(self) -> int:
        return len(self.ring_column)

    def start(self) -> np.ndarray:
        """Boresight of the mounting and zero offsets, (size,)."""
        return np.concatenate([self.mounting.boresight, np.zeros(self.size - 3)])

    def offsets(self, x: np.ndarray) -> np.ndarray:
        """Range offset of each ring, (rings,) m."""
        free = self.ring_column >= 0
        return np.where(free, x[self.ring_column], self.mounting.offsets(self.n_rings))

    def rotation(self, x: np.ndarray) -> np.ndarray:
        """``R_l_b`` (3, 3) under ``x``."""
        return boresight_matrix(x[:3], self.mounting.R_nominal)

    def kernel_arguments(self, x: np.ndarray) -> tuple:
        """What the kernels below take between the rays and their own arrays."""
        return (
            self.rotation(x),
            boresight_derivatives(x[:3], self.mounting.R_nominal),
            np.asarray(self.mounting.lever_arm, float),
            self.offsets(x),
            self.ring_column,
        )


def observation_variances(navigation: Navigation, scanner: Scanner) -> np.ndarray:
    """Variances (9,) of the observations of one laser point, in their order of `OBSERVATIONS`."""
    laser = [scanner.range_sigma, scanner.angle_sigma, scanner.angle_sigma]
    return np.square(np.concatenate([navigation.position_sigma, navigation.attitude_sigma, laser]))


@dataclass(frozen=True)
class PlaneNormals:
    """Normal equations before any elimination, a block per plane.

    ``N`` (G, u + 4, u + 4) and ``t`` (G, u + 4): the unknowns first, then n and d; ``chi2`` (G,)
    weighted squared residuals, ``count`` (G,) conditions. ``N dx + t = 0`` at the solution step.
    """

    N: np.ndarray
    t: np.ndarray
    chi2: np.ndarray
    count: np.ndarray

    def __add__(self, other: "PlaneNormals") -> "PlaneNormals":
        return PlaneNormals(
            self.N + other.N, self.t + other.t, self.chi2 + other.chi2, self.count + other.count
        )


def point_blocks(
    rays: Rays | PreparedRays,
    ranges: np.ndarray,
    origin: np.ndarray,
    planes: np.ndarray,
    unknowns: Unknowns,
    x: np.ndarray,
    variances: np.ndarray,
    final_m: float = FINAL,
) -> PlaneNormals:
    """Normal equations of Eq. (4) for points ``ranges[g, 0]:ranges[g, 1]`` on plane ``g``.

    ``planes`` (G, 4) holds (n, d) with d reckoned from ``origin`` (G, 3), ``variances`` (9,);
    ``final_m`` m as `kernels.adjust_observations` has it.
    """
    n_planes, size = len(planes), unknowns.size + 4
    N, t, chi2 = np.zeros((n_planes, size, size)), np.zeros((n_planes, size)), np.zeros(n_planes)
    R_l_b, dR_l_b, *mounted = unknowns.kernel_arguments(x)
    turned = R_l_b, axes(R_l_b, dR_l_b), *mounted
    arguments = (
        *PreparedRays.of(rays).columns(),
        ranges,
        origin,
        planes,
        *turned,
        variances,
        final_m,
    )
    over_threads(sum_points, n_planes, *arguments, N, t, chi2, least=1)
    lower = np.tril_indices(size, -1)
    N[:, lower[0], lower[1]] = N[:, lower[1], lower[0]]
    return PlaneNormals(N, t, chi2, ranges[:, 1] - ranges[:, 0])


@dataclass(frozen=True)
class FaceStates:
    """Faces under given unknowns, F of them: ``count`` (F,), ``centroid`` (F, 3) m, ``J_centroid``
    (F, 3, u); ``plane`` (F, 4) as (n, d) with d reckoned from the m-frame's origin, ``J_plane``
    (F, 4, u), NaN where the points do not define a plane; ``rms`` (F,) m of the points about the
    plane, ``width`` (F,) m RMS along the lesser of its two directions; ``scatter`` (F, 3, 3) m²
    about the centroid, summed over the points."""

    count: np.ndarray
    centroid: np.ndarray
    J_centroid: np.ndarray
    plane: np.ndarray
    J_plane: np.ndarray
    rms: np.ndarray
    width: np.ndarray
    scatter: np.ndarray


def last_value(function: Callable) -> Callable:
    """``function(x)`` of a float array, not computed anew for the values of the call before."""
    kept = lru_cache(maxsize=1)(lambda x: function(np.frombuffer(x)))
    return lambda x: kept(np.asarray(x, float).tobytes())


def face_states(
    rays: Rays | PreparedRays, ranges: np.ndarray, unknowns: Unknowns, x: np.ndarray
) -> FaceStates:
    """`FaceStates` of faces whose points are ``ranges[f, 0]:ranges[f, 1]``."""
    n_faces, size = len(ranges), unknowns.size
    centroid, J = np.zeros((n_faces, 3)), np.zeros((n_faces, 3, size))
    scatter, cross = np.zeros((n_faces, 3, 3)), np.zeros((n_faces, 3, 3, size))
    R_l_b, dR_l_b, *mounted = unknowns.kernel_arguments(x)
    turned = R_l_b, axes(R_l_b, dR_l_b), *mounted
    over_threads(
        sum_faces, n_faces, *PreparedRays.of(rays).columns(), ranges, *turned, centroid, J,
        scatter, cross, least=1,
    )  # fmt: skip
    count = ranges[:, 1] - ranges[:, 0]
    plane, J_plane = _plane_of_scatter(centroid, J, scatter, cross)
    values = np.maximum(np.linalg.eigvalsh(scatter), 0)
    rms, width = np.sqrt(values[:, :2] / count[:, None]).T
    return FaceStates(count, centroid, J, plane, J_plane, rms, width, scatter)


def _plane_of_scatter(centroid, J_centroid, scatter, cross):
    """PCA plane (F, 4) and its derivatives (F, 4, u)."""
    values, vectors = np.linalg.eigh(scatter)
    n = vectors[:, :, 0] * np.where(vectors[:, 2:, 0] < 0, -1.0, 1.0)
    dS_n = np.einsum("fabk,fb->fak", cross, n) + np.einsum("fbak,fb->fak", cross, n)
    gap = values[:, :1] - values[:, 1:]  # (F, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.einsum("fam,fak->fmk", vectors[:, :, 1:], dS_n) / gap[:, :, None]
    J_n = np.einsum("fam,fmk->fak", vectors[:, :, 1:], along)
    d = np.einsum("fa,fa->f", n, centroid)
    J_d = np.einsum("fak,fa->fk", J_n, centroid) + np.einsum("fa,fak->fk", n, J_centroid)
    return np.column_stack([n, d]), np.concatenate([J_n, J_d[:, None]], axis=1)


N_POSE = 6


def virtual_jacobians(
    centroids: np.ndarray, poses: np.ndarray, unknowns: Unknowns, x: np.ndarray
) -> np.ndarray:
    """Derivatives (F, 3, 9) of ``centroids`` (F, 3), each a ray from its mean pose (F, 6)."""
    R_l_b, dR_l_b, lever, _, _ = unknowns.kernel_arguments(x)
    R_b_m = attitude_matrix(*poses[:, 3:].T)
    arm = np.einsum("fij,fi->fj", R_b_m, centroids - poses[:, :3])
    r_l = (arm - lever) @ R_l_b
    rho = np.linalg.norm(r_l, axis=1)
    angles = np.arctan2(r_l[:, 1], r_l[:, 0]), np.arcsin(r_l[:, 2] / rho)
    obs = np.column_stack([poses, rho, *angles])
    return point_jacobians(obs, R_l_b, dR_l_b, lever, 0.0)[2]


def centroid_variances(
    normals: np.ndarray, J_l: np.ndarray, count: np.ndarray, variances: np.ndarray
) -> np.ndarray:
    """``B Q B'`` (K,) of Eq. (5) for ``normals`` (K, 3), virtual rays ``J_l`` (K, 3, 9) of
    ``count`` points.
    """
    shared = np.where(np.arange(9) < N_POSE, 1.0, 1.0 / count[:, None])
    b = np.einsum("ka,kam->km", normals, J_l)
    return (np.square(b) * variances * shared).sum(axis=1)


def centroid_blocks(
    face: np.ndarray,
    group: np.ndarray,
    states: FaceStates,
    origin: np.ndarray,
    planes: np.ndarray,
    s: np.ndarray,
) -> PlaneNormals:
    """Normal equations of Eq. (5): centroid of ``face`` (K,) on plane ``group`` (K,), ``s`` (K,).

    ``planes`` (G, 4) holds (n, d) with d from ``origin`` (G, 3).
    """
    relative = states.centroid[face] - origin[group]
    n, d = planes[group, :3], planes[group, 3]
    row = np.concatenate(
        [np.einsum("ka,kau->ku", n, states.J_centroid[face]), relative, -np.ones((len(face), 1))],
        axis=1,
    )
    w = np.einsum("ka,ka->k", n, relative) - d  # Eq. (5)
    size = row.shape[1]
    N, t = np.zeros((len(planes), size, size)), np.zeros((len(planes), size))
    chi2, count = np.zeros(len(planes)), np.zeros(len(planes), int)
    np.add.at(N, group, row[:, :, None] * row[:, None, :] / s[:, None, None])
    np.add.at(t, group, row * (w / s)[:, None])
    np.add.at(chi2, group, w * w / s)
    np.add.at(count, group, 1)
    return PlaneNormals(N, t, chi2, count)
