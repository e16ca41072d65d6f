"""How far faces bend away from planes, found before scenario D and taken off the ranges.

Roofs sag, gutters and ridges stand off, ground is curved, by centimetres. Every strip sees the same
bend, so it is no noise of a view; but a fan that moves over it sees one part after the other, and
scenario D, which knows that errors of the trajectory last, would take that for one.

While a few points of a face are measured, any error of trajectory or boresight moves them as a
rigid plane: by an offset and two tilts. These are left free for each group of successive points, a
range offset of each ring for all faces, and what is left shows the bend alone. It is a polynomial
in the plane, whose coefficients are observed as zero to a standard deviation that the faces
themselves tell (`sigma_of_group`): where all are planes, nothing is taken off.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.legendre import legvander2d

from paperrepro.method.adjustment.trajectory_components import SURFACE, sigma_of_group
from paperrepro.method.georeference import georeference
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Mounting, Scanner

#: Total degree of the polynomials: 2 a sag, 4 a sag between two walls with eaves that hang over.
DEGREE = 4
#: Points of a face that are looked at; successive ones that share an offset and two tilts.
POINTS, GROUP = 400, 24
#: Coordinates beyond so many half-lengths of an even face are held there.
REACH = 1.5
#: By how much bends must raise twice the logarithm of the likelihood to be taken off.
EVIDENCE = 10.0
#: Standard deviation, m, of the bends under which range offsets are told from them.
EXPECTED = 0.01

_POWERS = np.array([[i, j] for i in range(DEGREE + 1) for j in range(DEGREE + 1)])
_BENT = (_POWERS.sum(axis=1) >= 2) & (_POWERS.sum(axis=1) <= DEGREE)


@dataclass(frozen=True)
class _Plane:
    """``middle`` (3,) m, ``axes`` (3, 3) rows, the normal last, and ``half`` (2,) m lengths."""

    middle: np.ndarray
    axes: np.ndarray
    half: np.ndarray

    @classmethod
    def through(cls, p_m: np.ndarray) -> "_Plane":
        middle = p_m.mean(axis=0)
        scatter = (p_m - middle).T @ (p_m - middle) / len(p_m)
        variances, axes = np.linalg.eigh(scatter)
        return cls(middle, axes.T[::-1], np.sqrt(3 * np.maximum(variances[:0:-1], 1e-6)))

    def seen(self, p_m: np.ndarray, sensor: np.ndarray) -> tuple[np.ndarray, ...]:
        """In-plane coordinates (N, 2) from -1 to 1, distances (N,) m, and by how much (N,) these
        grow with range."""
        at = (p_m - self.middle) @ self.axes.T
        sight = (p_m - sensor) @ self.axes[2] / np.linalg.norm(p_m - sensor, axis=1)
        return np.clip(at[:, :2] / self.half, -REACH, REACH), at[:, 2], sight


def _bends(at: np.ndarray) -> np.ndarray:
    """(N, M) polynomials at in-plane coordinates (N, 2)."""
    return legvander2d(at[:, 0], at[:, 1], [DEGREE, DEGREE])[:, _BENT]


def without_bends(
    tie_planes: TiePlanes, scanner: Scanner, mounting: Mounting
) -> tuple[TiePlanes, float]:
    """The tie planes with ranges to even faces, and how far these bend.

    Parameters
    ----------
    tie_planes : TiePlanes
        Planes through control points stay as they are.
    scanner : Scanner
        Its ``range_sigma`` and ``range_offset_sigma`` are what is known before.
    mounting : Mounting
        Right to some hundredths of a degree.

    Returns
    -------
    TiePlanes
    float, m
        Standard deviation of a coefficient; 0 where the faces show no bend.

    References
    ----------
    Patterson and Thompson 1971, for the standard deviation.
    """
    few = tie_planes.thinned(POINTS)
    p_m, n_bends = georeference(few.rays, mounting), int(_BENT.sum())
    planes = [_Plane.through(p_m[first:last]) for first, last in few.plane_ranges]
    N, t = _normals(few, p_m, planes, scanner)
    prior = np.diag(np.full(n_bends, EXPECTED**-2.0))
    N_x, N_o, t_x = N[:, :n_bends, :n_bends], N[:, :n_bends, n_bends:], t[:, :n_bends]
    solved = np.linalg.solve(N_x + prior, np.concatenate([N_o, t_x[:, :, None]], axis=2))
    reduced = np.concatenate([N[:, n_bends:, n_bends:], t[:, n_bends:, None]], axis=2)
    reduced = (reduced - N_o.transpose(0, 2, 1) @ solved).sum(axis=0)
    known = np.diag(np.full(len(reduced), scanner.range_offset_sigma**-2.0))
    offsets = np.linalg.solve(reduced[:, :-1] + known, reduced[:, -1])
    information, axes = np.linalg.eigh(N_x)
    seen = np.einsum("gab,ga->gb", axes, t_x - N_o @ offsets)
    squares = np.square(few.unevenness(mounting, scanner))
    uneven = np.sqrt(np.bincount(few.plane, squares) / np.bincount(few.plane))[:, None]
    information, seen = np.maximum(information, 0.0) * uneven**2, seen * uneven
    sigma, evidence = sigma_of_group(information.ravel(), np.square(seen).ravel(), SURFACE)
    if evidence < EVIDENCE:
        return tie_planes, 0.0
    bends = np.einsum("gab,gb->ga", axes, uneven * seen / (information + sigma**-2.0))
    rays, rho = tie_planes.rays, tie_planes.rays.rho.copy()
    p_m, controlled = georeference(rays, mounting), tie_planes.controlled
    for g, (first, last) in enumerate(tie_planes.plane_ranges):
        if not controlled[g]:
            at, _, sight = planes[g].seen(p_m[first:last], rays.pose[first:last, :3])
            rho[first:last] -= _bends(at) @ bends[g] / sight
    return replace(tie_planes, rays=replace(rays, rho=rho)), sigma


def _normals(
    tie_planes: TiePlanes, p_m: np.ndarray, planes: list[_Plane], scanner: Scanner
) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations ``N`` (G, M + rings, M + rings) and ``t`` of bends and range offsets, plane
    by plane, of points ``p_m`` (N, 3) m."""
    rays, n_bends = tie_planes.rays, int(_BENT.sum())
    size = n_bends + scanner.n_rings
    N, t = np.zeros((len(planes), size, size)), np.zeros((len(planes), size))
    for g, (plane, (first, last)) in enumerate(zip(planes, tie_planes.plane_ranges, strict=True)):
        rows = slice(first, last)
        at, distance, sight = plane.seen(p_m[rows], rays.pose[rows, :3])
        offsets = np.zeros((last - first, scanner.n_rings))
        offsets[np.arange(last - first), rays.ring[rows]] = sight
        left, groups = np.column_stack([_bends(at), offsets, distance]), 0
        for group in _groups(tie_planes.ranges[tie_planes.plane == g] - first, rays.time[rows]):
            rigid = np.linalg.qr(np.column_stack([np.ones(len(group)), at[group]]))[0]
            left[group] -= rigid @ (rigid.T @ left[group])
            groups += 1
        A, w = left[:, :-1], left[:, -1]
        own = A[:, :n_bends] @ np.linalg.lstsq(A[:, :n_bends], w, rcond=None)[0]
        freedom = max(len(w) - n_bends - 3 * groups, 1)
        variance = max(np.square(w - own).sum() / freedom, (scanner.range_sigma / 2) ** 2)
        N[g], t[g] = A.T @ A / variance, A.T @ w / variance
    return N, t


def _groups(ranges: np.ndarray, time: np.ndarray) -> Iterator[np.ndarray]:
    """Indices of successive points of the faces in rows ``ranges`` (F, 2)."""
    for first, last in ranges:
        order = first + np.argsort(time[first:last], kind="stable")
        yield from np.array_split(order, max(1, len(order) // GROUP))
