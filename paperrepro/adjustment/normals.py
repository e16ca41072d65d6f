"""Normal equations of the point-on-plane condition, a block per plane.

The condition of one laser point is ``f(x, pi, l) = n . p(x, l) - d = 0``, Eq. (3) and (4), with
the unknowns ``x`` (boresight and range offsets), the plane ``pi = (n, d)`` and nine observations
``l``. It is one equation with many observations, so ``B Q B'`` is a number. Each point is
linearised at its adjusted observations: for given ``x`` and ``pi`` the residuals ``v`` that bring
it onto the plane at least cost are found first (Skaloud and Lichti 2006, section 3).

Blocks are summed plane by plane, so the result does not depend on the number of threads.
"""

from dataclasses import dataclass

import numba
import numpy as np

from paperrepro.adjustment.gauss_newton import SETTLED
from paperrepro.adjustment.sightlines import Sightlines, axes, ray, settle
from paperrepro.frames import boresight_matrix
from paperrepro.georeference import boresight_derivatives
from paperrepro.kernels import over_threads
from paperrepro.survey import Mounting, Navigation, Rays, Scanner


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
class Blocks:
    """Normal equations before any elimination, a block per plane.

    ``N`` (G, u + 4, u + 4) and ``t`` (G, u + 4): the unknowns first, then n and d; ``chi2`` (G,)
    weighted squared residuals, ``count`` (G,) conditions. ``N dx + t = 0`` at the solution step.
    """

    N: np.ndarray
    t: np.ndarray
    chi2: np.ndarray
    count: np.ndarray

    def __add__(self, other: "Blocks") -> "Blocks":
        return Blocks(
            self.N + other.N, self.t + other.t, self.chi2 + other.chi2, self.count + other.count
        )


def point_blocks(
    rays: Rays | Sightlines,
    ranges: np.ndarray,
    origin: np.ndarray,
    planes: np.ndarray,
    unknowns: Unknowns,
    x: np.ndarray,
    variances: np.ndarray,
    settled: float = SETTLED,
) -> Blocks:
    """Blocks of Eq. (4) for points ``ranges[g, 0]:ranges[g, 1]`` on plane ``g``.

    ``planes`` (G, 4) holds (n, d) with d reckoned from ``origin`` (G, 3), ``variances`` (9,);
    ``settled`` m as `sightlines.settle` has it.
    """
    n_planes, size = len(planes), unknowns.size + 4
    N, t, chi2 = np.zeros((n_planes, size, size)), np.zeros((n_planes, size)), np.zeros(n_planes)
    R_l_b, dR_l_b, *mounted = unknowns.kernel_arguments(x)
    turned = R_l_b, axes(R_l_b, dR_l_b), *mounted
    arguments = *Sightlines.of(rays).columns(), ranges, origin, planes, *turned, variances, settled
    over_threads(_point_blocks, n_planes, *arguments, N, t, chi2, least=1)
    lower = np.tril_indices(size, -1)
    N[:, lower[0], lower[1]] = N[:, lower[1], lower[0]]
    return Blocks(N, t, chi2, ranges[:, 1] - ranges[:, 0])


@numba.njit(cache=True, nogil=True)
def _point_blocks(
    first, last, position, turns, rho, ring, ranges, origin, planes, R_l_b, turn_axes, lever,
    offsets, ring_column, variances, settled, N, t, chi2,
):  # fmt: skip
    """Fill ``N``, ``t`` and ``chi2`` of planes ``first`` to ``last``."""
    v, b, row = np.empty(9), np.empty(9), np.empty(8)
    per_ring = ring_column.max() >= 0
    for g in range(first, last):
        sums = np.zeros((len(ring_column) if per_ring else 1, 8, 9))
        plane, near = planes[g], origin[g]
        for i in range(ranges[g, 0], ranges[g, 1]):
            there, then = ray(position, turns, i)
            w, s = settle(
                there, then, rho[i], plane, near, R_l_b, turn_axes, lever, offsets[ring[i]],
                variances, settled, v, b, row,
            )  # fmt: skip
            _add_products(row, w, 1.0 / s, sums, ring[i] if per_ring else 0)
            chi2[g] += w * w / s
        for k in range(len(sums)):
            _add_sums(sums[k], ring_column[k], N[g], t[g])


@numba.njit(cache=True)
def _add_products(row, w, weight, sums, ring):
    """Add a condition to the ``sums`` (rings, 8, 9) of its ring: products of ``row`` and, last,
    with w."""
    for k in range(8):
        scaled = weight * row[k]
        for m in range(k, 8):
            sums[ring, k, m] += scaled * row[m]
        sums[ring, k, 8] += scaled * w


@numba.njit(cache=True)
def _add_sums(sums, column, N, t):
    """Add a ring's ``sums`` to N (upper triangle) and t; its offset is at ``column``, or held."""
    where = np.array((0, 1, 2, column, len(t) - 4, len(t) - 3, len(t) - 2, len(t) - 1))
    for k in range(8):
        for m in range(k, 8):
            if where[k] >= 0 and where[m] >= 0:
                N[where[k], where[m]] += sums[k, m]
        if where[k] >= 0:
            t[where[k]] += sums[k, 8]
