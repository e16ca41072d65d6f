"""The Gauss-Helmert solver: A x + B v + w = 0 with planes eliminated.

Two kinds of plane. *Free* planes are unknowns with the constraint ``n . n = 1``; each is eliminated
by the Schur complement of its bordered 5x5 block. *Reference* planes are functions ``pi(x)`` of the
unknowns (`conditions.face_states`); the chain rule folds their block into that of ``x``.

The condition blocks come from a callable, so point and centroid conditions mix freely.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from paperrepro.errors import RankDefect, TooFewPlanes
from paperrepro.method.adjustment.conditions import (
    MAX_ITERATIONS,
    TOLERANCE,
    Iterations,
    PlaneNormals,
)
from paperrepro.method.adjustment.observability import (
    Observability,
    no_convergence,
    require_determined,
)


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations of ``x`` alone: ``S dx + t = 0``."""

    S: np.ndarray
    t: np.ndarray


@dataclass(frozen=True)
class Solution:
    """What the iterations end with.

    ``x`` (u,), and ``first``, what it was after the first of the ``iterations``; ``planes`` (G, 4)
    with d from the group's origin, ``Q`` (u, u) cofactors of ``x``,
    ``Q_planes`` (G, 4, 4) cofactors of free planes, else None, ``S_data`` (u, u) the information of
    the conditions alone, ``chi2`` and ``dof`` of all conditions and pseudo-observations.
    """

    x: np.ndarray
    planes: np.ndarray
    Q: np.ndarray
    Q_planes: np.ndarray | None
    S_data: np.ndarray
    chi2: float
    dof: int
    iterations: int
    first: np.ndarray


@dataclass(frozen=True)
class PriorObservations:
    """Prior observations ``x = mean`` with ``weight`` (u,), zero where there is none."""

    mean: np.ndarray
    weight: np.ndarray

    def normals(self, x: np.ndarray) -> NormalEquations:
        return NormalEquations(np.diag(self.weight), self.weight * (x - self.mean))

    def chi2(self, x: np.ndarray) -> float:
        return float(self.weight @ np.square(x - self.mean))


def solve_free(
    blocks: Callable[[np.ndarray, np.ndarray, float], PlaneNormals],
    x: np.ndarray,
    planes: np.ndarray,
    pseudo: PriorObservations,
) -> Solution:
    """Adjust ``x`` (u,) together with unit-norm ``planes`` (G, 4); ``blocks(x, planes, final_m)``.

    Raises `NoConvergence`, `RankDefect`.
    """
    iterations, first = Iterations(), x
    while not iterations.converged:
        condition = blocks(x, planes, iterations.final_m)
        inverse = _bordered_inverse(condition, planes)
        data = _schur(condition, inverse, planes)
        dx = _correction(data, pseudo, x)
        d_planes = _back_substitute(condition, inverse, planes, dx)
        x, planes = x + dx, planes + d_planes
        first = first if iterations.made else x
        iterations.take(dx, d_planes)
        if iterations.too_many:
            raise _no_convergence(data, pseudo, dx)
    Q = np.linalg.inv(data.S + pseudo.normals(x).S)
    Q_planes = _plane_cofactors(condition, inverse, Q)
    taken = iterations.made, first
    return _solution(x, planes, Q, Q_planes, data.S, condition, pseudo, *taken, 3 * len(planes))


def solve_reference(
    blocks: Callable[[np.ndarray, np.ndarray, float], PlaneNormals],
    plane_states: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    x: np.ndarray,
    pseudo: PriorObservations,
) -> Solution:
    """Adjust ``x`` (u,) on planes that are functions of it.

    ``plane_states(x)`` gives planes (G, 4) and their derivatives (G, 4, u).
    Raises `NoConvergence`, `RankDefect`.
    """
    iterations, first = Iterations(), x
    while not iterations.converged:
        planes, J = plane_states(x)
        condition = blocks(x, planes, iterations.final_m)
        data = _fold(condition, J)
        dx = _correction(data, pseudo, x)
        x = x + dx
        first = first if iterations.made else x
        iterations.take(dx)
        if iterations.too_many:
            raise _no_convergence(data, pseudo, dx)
    Q = np.linalg.inv(data.S + pseudo.normals(x).S)
    return _solution(x, planes, Q, None, data.S, condition, pseudo, iterations.made, first, 0)


def _solution(
    x, planes, Q, Q_planes, S_data, condition, pseudo, iterations, first, n_plane_unknowns
) -> Solution:
    chi2 = float(condition.chi2.sum()) + pseudo.chi2(x)
    dof = int(condition.count.sum()) + np.count_nonzero(pseudo.weight) - len(x) - n_plane_unknowns
    if dof < 1:
        raise TooFewPlanes(
            f"expected more conditions than unknowns, got {condition.count.sum()} conditions and "
            f"{dof} degrees of freedom; match more faces"
        )
    return Solution(x, planes, Q, Q_planes, S_data, chi2, dof, iterations, first)


def _bordered_inverse(condition: PlaneNormals, planes: np.ndarray) -> np.ndarray:
    """Inverses (G, 5, 5) of each plane's block, bordered by ``2 n . dn = 1 - n . n``."""
    border = np.zeros((len(planes), 5, 5))
    border[:, :4, :4] = condition.N[:, -4:, -4:]
    border[:, :3, 4] = border[:, 4, :3] = 2 * planes[:, :3]
    try:
        return np.linalg.inv(border)
    except np.linalg.LinAlgError:
        raise RankDefect(
            "a plane's own equations are singular: expected its points to spread in two "
            "directions; leave out faces that are lines"
        ) from None


def _constraint_right_side(condition: PlaneNormals, planes: np.ndarray) -> np.ndarray:
    """(G, 5): the planes' t, then the misclosure of the unit norm."""
    norm = np.square(planes[:, :3]).sum(axis=1) - 1.0
    return np.column_stack([condition.t[:, -4:], norm])


def _schur(condition: PlaneNormals, inverse: np.ndarray, planes: np.ndarray) -> NormalEquations:
    """Normal equations of ``x`` after elimination of every plane."""
    N_xp = condition.N[:, :-4, -4:]
    gain = N_xp @ inverse[:, :4]  # (G, u, 5)
    S = (condition.N[:, :-4, :-4] - gain[:, :, :4] @ N_xp.transpose(0, 2, 1)).sum(axis=0)
    eliminated = np.einsum("gup,gp->u", gain, _constraint_right_side(condition, planes))
    return NormalEquations((S + S.T) / 2, condition.t[:, :-4].sum(axis=0) - eliminated)


def _back_substitute(
    condition: PlaneNormals, inverse: np.ndarray, planes: np.ndarray, dx: np.ndarray
) -> np.ndarray:
    """Corrections (G, 4) of the planes."""
    right = _constraint_right_side(condition, planes)
    right[:, :4] += np.einsum("gpu,u->gp", condition.N[:, -4:, :-4], dx)
    return -np.einsum("gpq,gq->gp", inverse[:, :4], right)


def _plane_cofactors(condition: PlaneNormals, inverse: np.ndarray, Q: np.ndarray) -> np.ndarray:
    gain = inverse[:, :4, :4] @ condition.N[:, -4:, :-4]  # (G, 4, u)
    return inverse[:, :4, :4] + gain @ Q @ gain.transpose(0, 2, 1)


def _fold(condition: PlaneNormals, J: np.ndarray) -> NormalEquations:
    """Chain rule: planes are functions of ``x`` with derivatives ``J`` (G, 4, u)."""
    N_xx, N_xp, N_pp = condition.N[:, :-4, :-4], condition.N[:, :-4, -4:], condition.N[:, -4:, -4:]
    cross = N_xp @ J
    J_T = J.transpose(0, 2, 1)
    S = (N_xx + cross + cross.transpose(0, 2, 1) + J_T @ N_pp @ J).sum(axis=0)
    t = condition.t[:, :-4] + np.einsum("gpu,gp->gu", J, condition.t[:, -4:])
    return NormalEquations((S + S.T) / 2, t.sum(axis=0))


def _correction(data: NormalEquations, pseudo: PriorObservations, x: np.ndarray) -> np.ndarray:
    """Step ``dx`` (u,); raises `RankDefect`."""
    if not np.isfinite(data.S).all():
        raise RankDefect(
            "the normal equations hold NaN: expected faces whose points spread in two directions; "
            "leave out faces that are lines or single points"
        )
    require_determined(Observability.of(data.S, pseudo.weight))
    prior = pseudo.normals(x)
    return -_solve(data.S + prior.S, data.t + prior.t)


def _solve(S: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Solve after scaling to unit diagonal; raises `RankDefect`."""
    diagonal = np.sqrt(np.abs(np.diag(S)))
    if (diagonal == 0).any():
        column = int(np.argmin(diagonal))
        raise RankDefect(
            f"unknown {column} appears in no condition; expected planes seen by every estimated "
            "ring: hold its range offset, or give it a pseudo-observation"
        )
    scaled = S / np.outer(diagonal, diagonal)
    if np.linalg.cond(scaled) > 1e13:
        raise RankDefect(
            f"normal equations of condition {np.linalg.cond(scaled):.1e}: expected planes of "
            "several slopes and azimuths, seen from crossing lines; add strips or planes, or "
            "estimate fewer unknowns"
        )
    return np.linalg.solve(scaled, t / diagonal) / diagonal


def _no_convergence(data: NormalEquations, pseudo: PriorObservations, dx: np.ndarray) -> Exception:
    seen = Observability.of(data.S, pseudo.weight)
    return no_convergence(seen, MAX_ITERATIONS, np.abs(dx).max(), TOLERANCE)
