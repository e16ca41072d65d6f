"""The normal equations of scenario D by windows of time, each eliminated by itself.

A window is a stretch of nodes that no view of a face crosses. Its first node separates it from the
window before; given both separators its other nodes, a block-tridiagonal system, know of no other
window. They are eliminated first, then the window's surface errors, three unknowns a view, and what
is left couples separators, the planes that the window sees, boresight, offsets and constants.
"""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.linalg import cho_factor, cho_solve

from paperrepro.method.adjustment.trajectory_equations import (
    N_COMPONENTS,
    CellBlocks,
    Cells,
    Factor,
    Nodes,
    factorise,
)

#: Shorter windows are joined: each costs a separator among the unknowns that are left at the end.
LEAST_NODES = 32


@dataclass(frozen=True)
class Window:
    """``nodes`` first and one past the last, of which the first is the separator; ``cells``,
    ``faces`` and ``planes`` (indices) in it, and ``plane`` (faces,) of each face, among these."""

    nodes: tuple[int, int]
    cells: np.ndarray
    faces: np.ndarray
    planes: np.ndarray
    plane: np.ndarray


def windows(
    cells: Cells, nodes: Nodes, plane: np.ndarray, least: int = LEAST_NODES
) -> tuple[Window, ...]:
    """Cut where no face is seen before and after, ``least`` nodes apart; ``plane`` (F,) of each."""
    count = len(nodes.time)
    crossed = np.zeros(count + 1, int)  # by how many faces the step to node k is spanned
    n_faces = len(plane)
    first, last = np.full(n_faces, count), np.full(n_faces, -1)
    np.minimum.at(first, cells.face, cells.node)
    np.maximum.at(last, cells.face, cells.node + 1)
    np.add.at(crossed, first + 1, 1)
    np.add.at(crossed, last + 1, -1)
    free = np.flatnonzero(np.cumsum(crossed)[1:count] == 0) + 1
    starts = [0]
    for k in free:
        if k - starts[-1] >= least and count - k >= 2:
            starts.append(int(k))
    of_cell = np.searchsorted(starts, cells.node, side="right") - 1
    out = []
    for w, begin in enumerate(starts):
        chosen = np.flatnonzero(of_cell == w)
        faces = np.unique(cells.face[chosen])
        planes, local = np.unique(plane[faces], return_inverse=True)
        end = starts[w + 1] if w + 1 < len(starts) else count
        out.append(Window((begin, end), chosen, faces, planes, local))
    return tuple(out)


@dataclass(frozen=True)
class WindowNormals:
    """Of a window's conditions alone: ``N`` (m, m) and ``t`` (m,) of its y (x, constants, planes
    and surface errors, in this order), ``N_t`` (K, 6, m) and ``t_t`` (K, 6) with its nodes, whose
    blocks are ``D`` (K, 6, 6) and, above them, ``E`` (K - 1, 6, 6)."""

    N: np.ndarray
    t: np.ndarray
    N_t: np.ndarray
    t_t: np.ndarray
    D: np.ndarray
    E: np.ndarray

    def scaled(self, factor: float) -> "WindowNormals":
        """With all weights multiplied by ``factor``."""
        return WindowNormals(*(factor * part for part in vars(self).values()))


def window_normals(
    window: Window, blocks: CellBlocks, cells: Cells, to_plane: np.ndarray, roughness: float
) -> WindowNormals:
    """Sum the ``blocks`` of a window's cells, once an offset of each cell of information
    ``roughness`` 1 / m² has been eliminated; ``to_plane`` (F, 3, 3) as `TrajectoryModel` has it."""
    begin, end = window.nodes
    n_nodes, n_faces, n_planes = end - begin, len(window.faces), len(window.planes)
    u = blocks.t.shape[1] - 15
    size = u + 3 * n_faces
    N, t = np.zeros((size, size)), np.zeros(size)
    N_t, t_t = np.zeros((n_nodes, N_COMPONENTS, size)), np.zeros((n_nodes, N_COMPONENTS))
    D, E = np.zeros((n_nodes, 6, 6)), np.zeros((n_nodes - 1, 6, 6))
    view = np.searchsorted(window.faces, cells.face[window.cells])
    _add_cells(
        blocks.N, blocks.t, window.cells, view, cells.node[window.cells] - begin, roughness,
        N, t, N_t, t_t, D, E,
    )  # fmt: skip
    N += np.triu(N, 1).T
    D += np.triu(D, 1).transpose(0, 2, 1)
    # a plane moves all of its views, a surface error one; a constant moves all nodes alike
    L = np.zeros((size, u + 3 * n_planes + 3 * n_faces))
    L[:u, :u] = np.eye(u)
    for f in range(n_faces):
        own = slice(u + 3 * f, u + 3 * f + 3)
        L[own, u + 3 * window.plane[f] : u + 3 * window.plane[f] + 3] = np.eye(3)
        at = u + 3 * n_planes + 3 * f
        L[own, at : at + 3] = to_plane[window.faces[f]]
    by_constant = D.copy()
    by_constant[:-1] += E
    by_constant[1:] += E.transpose(0, 2, 1)
    N_t, t = N_t @ L, L.T @ t
    beside = N_t.sum(axis=0)  # constants with the rest
    N = np.block([[L.T @ N @ L, beside.T], [beside, by_constant.sum(axis=0)]])
    t = np.concatenate([t, t_t.sum(axis=0)])
    order = np.r_[:u, len(L.T) : len(t), u : len(L.T)]
    N_t = np.concatenate([N_t, by_constant], axis=2)
    return WindowNormals(N[np.ix_(order, order)], t[order], N_t[:, :, order], t_t, D, E)


@numba.njit(cache=True)
def _add_cells(N, t, chosen, view, node, roughness, N_yy, t_y, N_ty, t_t, D, E):
    """Add the ``chosen`` cells' ``N`` and ``t`` to the normal equations of unknowns and views,
    ``N_yy`` and ``t_y``, of the nodes, ``D``, ``E`` and ``t_t``, and between them, ``N_ty``; to the
    upper triangles of ``N_yy`` and ``D`` alone."""
    size = N.shape[1]
    n_x, d = size - 15, size - 13
    n_y = n_x + 3
    y, column, M = np.arange(n_y), np.empty(size), np.empty((size, size))
    for i in range(len(chosen)):
        c, first = chosen[i], node[i]
        for k in range(size):
            column[k] = N[c, min(k, d), max(k, d)]
        total = column[d] + roughness
        for k in range(size):
            for m in range(k, size):
                M[k, m] = N[c, k, m] - column[k] * column[m] / total
        for k in range(3):
            y[n_x + k] = n_x + 3 * view[i] + k
        left = t[c, d] / total
        for k in range(n_y):
            t_y[y[k]] += t[c, k] - column[k] * left
            for m in range(k, n_y):
                N_yy[y[k], y[m]] += M[k, m]
        for after in range(2):
            of_node = n_y + 6 * after
            for m in range(6):
                t_t[first + after, m] += t[c, of_node + m] - column[of_node + m] * left
                for k in range(n_y):
                    N_ty[first + after, m, y[k]] += M[k, of_node + m]
                for k in range(m + 1):
                    D[first + after, k, m] += M[of_node + k, of_node + m]
        for k in range(6):
            for m in range(6):
                E[first, k, m] += M[n_y + k, n_y + 6 + m]


@dataclass(frozen=True)
class NodePrior:
    """Information of a window's nodes: ``diagonal`` (K, b), ``beside`` (K - 1, b), ``next`` (b,)
    beside the next window's separator, zeros where there is none; ``gradient`` (K, b) of the prior
    at the errors. ``surface`` (1 / m²) information of each surface error, ``surface_gradient``
    (F, 3)."""

    diagonal: np.ndarray
    beside: np.ndarray
    next: np.ndarray
    gradient: np.ndarray
    surface: float
    surface_gradient: np.ndarray


@dataclass(frozen=True)
class WindowStep:
    """A window eliminated: ``S`` (r, r) and ``t`` (r,) that it leaves to r = separator, next
    separator, x, constants, planes; ``log_det``; and what leads back."""

    S: np.ndarray
    t: np.ndarray
    log_det: float
    factor: Factor
    nodes: np.ndarray
    views: np.ndarray
    views_inverse: np.ndarray

    def back(self, dr: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corrections (K - 1, b) of the nodes after the separator, and (F, 3), given ``dr``."""
        d_views = -self.views[:, :-1] @ dr - self.views[:, -1]
        d_nodes = -self.nodes @ np.concatenate([dr, d_views, [1.0]])
        return d_nodes, d_views.reshape(-1, 3)

    def covariance(self, Q: np.ndarray) -> tuple[np.ndarray, ...]:
        """Given ``Q`` (r, r): variances (K - 1, b) of the nodes after the separator; of each
        component its covariances (K, b) with the same one a node before, separator and next
        separator included; and variances (F, 3)."""
        B = self.views[:, :-1]
        BQ = B @ Q
        of_views = self.views_inverse + BQ @ B.T
        full = np.block([[Q, -BQ.T], [-BQ, of_views]])
        X = self.nodes[:, :, :-1]
        XQ = X @ full
        variance, neighbour = _inverse_blocks(self.factor.inverse_S, self.factor.gain)
        variance += (XQ * X).sum(axis=2)
        neighbour += (XQ[:-1] * X[1:]).sum(axis=2)
        b = np.arange(X.shape[1])
        ends = -XQ[0, b, b], -XQ[-1, b, len(b) + b]
        neighbour = np.concatenate([ends[:1], neighbour, ends[1:]])
        return variance, neighbour, np.diag(of_views).reshape(-1, 3)


@numba.njit(cache=True)
def _inverse_blocks(inverse_S, gain):
    """Diagonals (K, b) of the inverse's diagonal blocks and (K - 1, b) of those beside them."""
    K, b = inverse_S.shape[:2]
    diagonal, beside = np.empty((K, b)), np.empty((K - 1, b))
    block = inverse_S[K - 1].copy()
    diagonal[K - 1] = np.diag(block)
    for k in range(K - 2, -1, -1):
        product = gain[k] @ block
        beside[k] = -np.diag(product)
        block = inverse_S[k] + product @ gain[k].T
        diagonal[k] = np.diag(block)
    return diagonal, beside


def eliminate_window(data: WindowNormals, prior: NodePrior) -> WindowStep:
    """Nodes after the separator first, then surface errors. `LinAlgError` where singular."""
    times = prior.diagonal.shape[1] // N_COMPONENTS  # each process moves the pose alike
    b, place = times * N_COMPONENTS, np.arange(times * N_COMPONENTS)
    D, E = np.tile(data.D, (1, times, times)), np.tile(data.E, (1, times, times))
    D[:, place, place] += prior.diagonal
    E[:, place, place] += prior.beside
    N_t = np.tile(data.N_t, (1, times, 1))
    t_t = np.tile(data.t_t, times) + prior.gradient
    size, n_views = data.N.shape[0], prior.surface_gradient.size
    right = np.zeros((len(D) - 1, b, 2 * b + size + 1))
    right[0, :, :b] = E[0].T
    right[-1, place, b + place] = prior.next
    right[:, :, 2 * b : -1] = N_t[1:]
    right[:, :, -1] = t_t[1:]
    factor = factorise(D[1:], E[1:])
    nodes = factor.solve(right)
    C = np.zeros((2 * b + size + 1, 2 * b + size + 1))
    C[:b, :b] = D[0]
    C[:b, 2 * b : -1], C[2 * b : -1, :b] = N_t[0], N_t[0].T
    C[:b, -1] = t_t[0]
    C[2 * b : -1, 2 * b : -1], C[2 * b : -1, -1] = data.N, data.t
    C -= right.reshape(-1, len(C)).T @ nodes.reshape(-1, len(C))
    r = 2 * b + size - n_views
    views, rest = slice(r, r + n_views), np.r_[:r, len(C) - 1]
    C[views, views] += prior.surface * np.eye(n_views)
    C[views, -1] += prior.surface_gradient.ravel()
    of_views = cho_factor(C[views, views], lower=True)
    back = cho_solve(of_views, C[views, rest])
    reduced = C[:r][:, rest] - C[:r, views] @ back
    log_det = factor.log_det + 2 * float(np.log(np.diag(of_views[0])).sum())
    inverse = cho_solve(of_views, np.eye(n_views))
    return WindowStep(reduced[:, :r], reduced[:, r], log_det, factor, nodes, back, inverse)
