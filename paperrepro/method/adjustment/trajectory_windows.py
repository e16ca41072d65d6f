"""The normal equations of scenario D by windows of time, each eliminated by itself.

A window is a stretch of nodes that no view of a face crosses. Its first node separates it from the
window before; given both separators its other nodes, a block-tridiagonal system, know of no other
window. They are eliminated first, then the window's surface errors, three unknowns a view, and what
is left couples separators, the planes that the window sees, boresight, offsets and constants.
"""

from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from scipy.linalg import block_diag

from paperrepro.method.adjustment.block_cholesky import dissected
from paperrepro.method.adjustment.trajectory_equations import (
    N_COMPONENTS,
    OF_D,
    CellBlocks,
    Cells,
    Nodes,
)

#: Shorter windows are joined: each costs a separator among the unknowns that are left at the end.
LEAST_NODES = 32


@dataclass(frozen=True)
class Window:
    """``nodes`` first and one past the last, of which the first is the separator; ``cells``,
    ``faces`` and ``planes`` (indices) in it; ``by_plane`` (3 F, 3 G) and ``by_surface`` (3 F, 3 F)
    how planes and surface errors move the views' planes."""

    nodes: tuple[int, int]
    cells: np.ndarray
    faces: np.ndarray
    planes: np.ndarray
    by_plane: np.ndarray
    by_surface: np.ndarray


def windows(
    cells: Cells, nodes: Nodes, plane: np.ndarray, to_plane: np.ndarray, least: int = LEAST_NODES
) -> tuple[Window, ...]:
    """Cut where no face is seen before and after, ``least`` nodes apart; ``plane`` (F,) of each and
    ``to_plane`` (F, 3, 3) as `TrajectoryModel` has it."""
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
    in_order, out = np.argsort(of_cell, kind="stable"), []
    by_window = np.split(in_order, np.searchsorted(of_cell[in_order], np.arange(1, len(starts))))
    for w, (begin, chosen) in enumerate(zip(starts, by_window, strict=True)):
        faces = np.unique(cells.face[chosen])
        planes, local = np.unique(plane[faces], return_inverse=True)
        end = starts[w + 1] if w + 1 < len(starts) else count
        by_plane = np.kron(local[:, None] == np.arange(len(planes)), np.eye(3))
        by_surface = block_diag(*to_plane[faces])
        out.append(Window((begin, end), chosen, faces, planes, by_plane, by_surface))
    return tuple(out)


def places_left(windows: tuple[Window, ...], u: int, n_planes: int, b: int) -> list[np.ndarray]:
    """Where, among y and then separators of ``b`` unknowns, is (r,) what each window leaves, in the
    order of `WindowStep`."""
    Y = u + 3 * n_planes + N_COMPONENTS
    own, ends = np.r_[:u, Y - N_COMPONENTS : Y], Y + np.arange(2 * b)
    return [
        np.concatenate([ends + b * k, own, (u + 3 * w.planes[:, None] + np.arange(3)).ravel()])
        for k, w in enumerate(windows)
    ]


def dissection(windows: tuple[Window, ...], origin: np.ndarray) -> np.ndarray:
    """Order (W,) of ``windows``, whose planes have origins (G, 3), as `dissected` makes it."""
    middle = np.array([origin[w.planes, :2].mean(axis=0) for w in windows])
    time = np.arange(len(windows))
    return dissected(
        places_left(windows, 0, len(origin), N_COMPONENTS), np.column_stack([time, middle])
    )


@dataclass(frozen=True)
class WindowNormals:
    """Of a window's conditions alone: ``N`` (m, m) and ``t`` (m,) of its y (x, constants and the
    views' planes, in this order), ``N_t`` (K, 6, m) and ``t_t`` (K, 6) with its nodes, whose blocks
    are ``D`` (K, 6, 6) and, above them, ``E`` (K - 1, 6, 6)."""

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
    window: Window, blocks: CellBlocks, cells: Cells, roughness: float
) -> WindowNormals:
    """Sum the ``blocks`` of a window's cells, once an offset of each cell of information
    ``roughness`` 1 / m² has been eliminated."""
    begin, end = window.nodes
    n_nodes, n_faces = end - begin, len(window.faces)
    u = blocks.t.shape[1] - 15
    size = u + N_COMPONENTS + 3 * n_faces
    N, t = np.zeros((size, size)), np.zeros(size)
    N_t, t_t = np.zeros((n_nodes, N_COMPONENTS, size)), np.zeros((n_nodes, N_COMPONENTS))
    D, E = np.zeros((n_nodes, 6, 6)), np.zeros((n_nodes - 1, 6, 6))
    view = np.searchsorted(window.faces, cells.face[window.cells])
    _add_cells(
        blocks.N, blocks.t, window.cells, view, cells.node[window.cells] - begin, roughness,
        N, t, N_t, t_t, D, E,
    )  # fmt: skip
    offsets = blocks.N[window.cells, OF_D, :u]
    weight = 1 / (blocks.N[window.cells, OF_D, u + OF_D] + roughness)
    N[:u, :u] = np.triu(blocks.N_x[window.faces].sum(axis=0) - (offsets.T * weight) @ offsets)
    D += np.triu(D, 1).transpose(0, 2, 1)
    # a constant moves all nodes alike
    constants = slice(u, u + N_COMPONENTS)
    N_t[:, :, constants] = D
    N_t[:-1, :, constants] += E
    N_t[1:, :, constants] += E.transpose(0, 2, 1)
    N += np.triu(N, 1).T
    N[constants] = N_t.sum(axis=0)
    N[:, constants] = N[constants].T
    t[constants] = t_t.sum(axis=0)
    return WindowNormals(N, t, N_t, t_t, D, E)


@numba.njit(cache=True)
def _add_cells(N, t, chosen, view, node, roughness, N_yy, t_y, N_ty, t_t, D, E):
    """Add the ``chosen`` cells' ``N`` and ``t`` to the normal equations of unknowns and views,
    ``N_yy`` and ``t_y``, of the nodes, ``D``, ``E`` and ``t_t``, and between them, ``N_ty``; to the
    upper triangles of ``N_yy``, but for the unknowns among each other, and of ``D`` alone."""
    size = N.shape[2]
    n_x = size - N.shape[1]
    n_y = n_x + 3
    y, column, M, of_t = np.arange(n_y), np.empty(size), np.zeros(N.shape[1:]), np.zeros(size)
    for i in range(len(chosen)):
        c, first = chosen[i], node[i]
        for k in range(size):
            column[k] = N[c, OF_D, k]
        for k in range(OF_D):
            column[n_x + k] = N[c, k, n_x + OF_D]
        weight = 1 / (column[n_x + OF_D] + roughness)
        left = t[c, n_x + OF_D] * weight
        for k in range(size):
            of_t[k] += t[c, k] - column[k] * left
        for k in range(len(M)):
            scaled = column[n_x + k] * weight
            for m in range(n_x):
                M[k, m] += N[c, k, m] - scaled * column[m]
            for m in range(n_x + k, size):
                M[k, m] += N[c, k, m] - scaled * column[m]
        if i + 1 < len(chosen) and view[i + 1] == view[i] and node[i + 1] == first:
            continue  # moments of one view between two nodes have one place
        for k in range(3):
            y[n_x + k] = n_x + 6 + 3 * view[i] + k
        for k in range(n_y):
            t_y[y[k]] += of_t[k]
        for m in range(3):
            for k in range(n_x):
                N_yy[k, y[n_x + m]] += M[m, k]
            for k in range(m + 1):
                N_yy[y[n_x + k], y[n_x + m]] += M[k, n_x + m]
        for after in range(2):
            of_node = 3 + 6 * after
            for m in range(6):
                t_t[first + after, m] += of_t[n_x + of_node + m]
                for k in range(n_x):
                    N_ty[first + after, m, k] += M[of_node + m, k]
                for k in range(3):
                    N_ty[first + after, m, y[n_x + k]] += M[k, n_x + of_node + m]
                for k in range(m + 1):
                    D[first + after, k, m] += M[of_node + k, n_x + of_node + m]
        for k in range(6):
            for m in range(6):
                E[first, k, m] += M[3 + k, n_y + 6 + m]
        M[:], of_t[:] = 0.0, 0.0


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
    separator, x, constants, planes; ``log_det``; by how much that alone lowers the sum of squares,
    ``decrement``; and what leads back."""

    S: np.ndarray
    t: np.ndarray
    log_det: float
    decrement: float
    window: Window
    factor: "Factor"
    forward: np.ndarray
    views: np.ndarray
    views_inverse: np.ndarray

    @cached_property
    def nodes(self) -> np.ndarray:
        """(K - 1, b, r + 1): how much the nodes after the separator give way to separators, x,
        constants and views' planes, and their own share."""
        return self.factor.backward(self.forward)

    def back(self, dr: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corrections (K - 1, b) of the nodes after the separator, and (F, 3), given ``dr``."""
        w, d_views = self.window, -self.views[:, :-1] @ dr - self.views[:, -1]
        own = len(dr) - w.by_plane.shape[1]
        planes = w.by_plane @ dr[own:] + w.by_surface @ d_views
        d_nodes = -self.nodes @ np.concatenate([dr[:own], planes, [1.0]])
        return d_nodes, d_views.reshape(-1, 3)

    def squares(self, right: np.ndarray, of_views: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of right sides at the window's nodes (K, b, n), the separator first, and surface errors
        (3 F, n): their products (n, n) by the inverse of what is eliminated here, and what they
        leave (r, n) to the rest."""
        w, b = self.window, right.shape[1]
        moved = np.ascontiguousarray(right[1:])
        self.factor.forward(moved)
        flat, size = self.forward.reshape(-1, self.forward.shape[2]), self.forward.shape[2] - 1
        own, moved = size - len(w.by_surface), moved.reshape(-1, right.shape[2])
        left = -flat[:, :size].T @ moved
        left[:b] += right[0]
        of_views = of_views + w.by_surface.T @ left[own:]
        out = np.concatenate([left[:own], w.by_plane.T @ left[own:]])
        out -= self.views[:, :-1].T @ of_views
        return moved.T @ moved + of_views.T @ self.views_inverse @ of_views, out

    def covariance(self, Q: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, ...]:
        """Given ``Q`` (r, r): covariances (K - 1, b) of components of the nodes after the separator
        with those that ``other`` (b,) names at the same node; (K, b) at the next one, from the
        separator to the next separator; and variances (F, 3) of the surface errors."""
        w, B = self.window, self.views[:, :-1]
        own = len(Q) - w.by_plane.shape[1]
        BQ = B @ Q
        of_views = self.views_inverse + BQ @ B.T
        # the views' planes: those of all views, turned by their surface errors
        beside = w.by_plane @ Q[own:] - w.by_surface @ BQ
        mixed = w.by_plane @ BQ[:, own:].T @ w.by_surface.T
        planes = w.by_plane @ Q[own:, own:] @ w.by_plane.T - mixed - mixed.T
        planes += w.by_surface @ of_views @ w.by_surface.T
        full = np.block([[Q[:own, :own], beside[:, :own].T], [beside[:, :own], planes]])
        X = self.nodes[:, :, :-1]
        XQ = X @ full
        variance, neighbour = self.factor.inverse_blocks(other)
        variance += (XQ * X[:, other]).sum(axis=2)
        neighbour += (XQ[:-1] * X[1:, other]).sum(axis=2)
        b = np.arange(X.shape[1])
        ends = -XQ[0, other, b], -XQ[-1, b, len(b) + other]
        neighbour = np.concatenate([ends[:1], neighbour, ends[1:]])
        return variance, neighbour, np.diag(of_views).reshape(-1, 3)


def eliminate_window(window: Window, data: WindowNormals, prior: NodePrior) -> WindowStep:
    """Nodes after the separator first, then surface errors. `LinAlgError` where singular."""
    times = prior.diagonal.shape[1] // N_COMPONENTS  # each process moves the pose alike
    b, place = times * N_COMPONENTS, np.arange(times * N_COMPONENTS)
    D, E = np.tile(data.D, (1, times, times)), np.tile(data.E, (1, times, times))
    D[:, place, place] += prior.diagonal
    E[:, place, place] += prior.beside
    N_t = np.tile(data.N_t, (1, times, 1))
    t_t = np.tile(data.t_t, times) + prior.gradient
    size = 2 * b + len(data.t)
    forward = np.zeros((len(D) - 1, b, size + 1))
    forward[0, :, :b] = E[0].T
    forward[-1, place, b + place] = prior.next
    forward[:, :, 2 * b : -1] = N_t[1:]
    forward[:, :, -1] = t_t[1:]
    factor = Factor.of(D[1:], E[1:], forward)
    C = np.zeros((size + 1, size + 1))
    C[:b, :b] = D[0]
    C[:b, 2 * b : -1], C[2 * b : -1, :b] = N_t[0], N_t[0].T
    C[:b, -1] = t_t[0]
    C[2 * b : -1, 2 * b : -1], C[2 * b : -1, -1] = data.N, data.t
    flat = forward.reshape(-1, size + 1)
    C -= flat.T @ flat
    own = size - len(window.by_surface)
    views = slice(own, size)
    of_views = C[views, views]
    turned = window.by_surface.T @ np.column_stack(
        [C[views, :own], of_views @ window.by_plane, C[views, size]]
    )
    turned[:, -1] += prior.surface_gradient.ravel()
    surface = window.by_surface.T @ of_views @ window.by_surface
    surface[np.diag_indices_from(surface)] += prior.surface
    lower = np.linalg.cholesky(surface)
    inverse_lower = np.linalg.inv(lower)
    inverse = inverse_lower.T @ inverse_lower
    back = inverse @ turned
    P = window.by_plane
    of_planes = P.T @ np.column_stack([C[views, :own], of_views @ P, C[views, size]])
    above = np.column_stack([C[:own, :own], of_planes[:, :own].T, C[:own, size]])
    reduced = np.concatenate([above, of_planes]) - turned[:, :-1].T @ back
    log_det = factor.log_det + 2 * float(np.log(np.diag(lower)).sum())
    decrement = turned[:, -1] @ back[:, -1] - C[size, size]
    return WindowStep(
        reduced[:, :-1], reduced[:, -1], log_det, float(decrement), window, factor, forward, back,
        inverse,
    )  # fmt: skip


@dataclass(frozen=True)
class Factor:
    """Cholesky factor of a matrix of K x K blocks (b, b): ``L`` (K, b, b) on its diagonal, ``U``
    (K - 1, b, b) the transposed blocks below; ``log_det`` of the matrix."""

    L: np.ndarray
    U: np.ndarray
    log_det: float

    @classmethod
    def of(cls, D: np.ndarray, E: np.ndarray, right: np.ndarray) -> "Factor":
        """Of the symmetric positive definite matrix with diagonal blocks ``D`` (K, b, b) and blocks
        ``E`` (K - 1, b, b) above them; ``right`` (K, b, m) becomes the solution of its transposed
        upper half, in place. `numpy.linalg.LinAlgError` where it is not."""
        L, U = D.copy(), E.copy()
        log_det = _forward(L, U, right)
        if not np.isfinite(log_det):
            raise np.linalg.LinAlgError("errors of the trajectory: normal equations not positive")
        return cls(L, U, log_det)

    def forward(self, right: np.ndarray) -> None:
        """As `of` does to right sides (K, b, m)."""
        _forward_again(self.L, self.U, right)

    def backward(self, forward: np.ndarray) -> np.ndarray:
        """Solution (K, b, m) from what `of` left of the right sides."""
        out = forward.copy()
        _backward(self.L, self.U, out)
        return out

    def inverse_blocks(self, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of the inverse's diagonal blocks (K, b), and (K - 1, b) of those beside them, in each row
        the column that ``other`` (b,) names."""
        return _inverse_blocks(self.L, self.U, other)


@numba.njit(cache=True)
def _forward(D, E, right):
    """Cholesky factors in place of ``D``, and what stands above them in place of ``E``; ``right``
    by the transposed factor. The logarithm of the determinant, NaN where there is none."""
    K, b = right.shape[:2]
    log_det = 0.0
    for k in range(K):
        L, r = D[k], right[k]
        if k > 0:
            U, before = E[k - 1], right[k - 1]
            for i in range(b):
                for j in range(b):
                    for n in range(i + 1):
                        L[i, n] -= U[j, i] * U[j, n]
            _less(U, before, r)
        for i in range(b):
            for n in range(i + 1):
                total = L[i, n]
                for j in range(n):
                    total -= L[i, j] * L[n, j]
                if n < i:
                    L[i, n] = total / L[n, n]
                elif total > 0:
                    L[i, i] = np.sqrt(total)
                    log_det += np.log(total)
                else:
                    return np.nan
            L[i, i + 1 :] = 0.0
        _lower(L, r)
        if k + 1 < K:
            _lower(L, E[k])
    return log_det


@numba.njit(cache=True)
def _forward_again(L, U, right):
    """As `_forward` does to ``right``."""
    for k in range(len(right)):
        if k > 0:
            _less(U[k - 1], right[k - 1], right[k])
        _lower(L[k], right[k])


@numba.njit(cache=True)
def _less(U, before, r):
    """``r - U' before``, in place."""
    b, m = r.shape
    for i in range(b):
        for j in range(0, b, 6):  # blocks of six components: fewer loads and stores
            u0, u1, u2 = U[j, i], U[j + 1, i], U[j + 2, i]
            u3, u4, u5 = U[j + 3, i], U[j + 4, i], U[j + 5, i]
            for c in range(m):
                r[i, c] -= (
                    u0 * before[j, c] + u1 * before[j + 1, c] + u2 * before[j + 2, c]
                    + u3 * before[j + 3, c] + u4 * before[j + 4, c] + u5 * before[j + 5, c]
                )  # fmt: skip


@numba.njit(cache=True)
def _lower(L, r):
    """``L^-1 r``, in place."""
    for i in range(len(L)):
        for j in range(i):
            factor = L[i, j]
            for c in range(r.shape[1]):
                r[i, c] -= factor * r[j, c]
        factor = 1 / L[i, i]
        for c in range(r.shape[1]):
            r[i, c] *= factor


@numba.njit(cache=True)
def _backward(L, U, out):
    """``L_k'^-1 (out_k - U_k out_{k+1})``, in place."""
    K, b, m = out.shape
    for k in range(K - 1, -1, -1):
        for i in range(b - 1, -1, -1):
            if k + 1 < K:
                for j in range(b):
                    factor = U[k, i, j]
                    for c in range(m):
                        out[k, i, c] -= factor * out[k + 1, j, c]
            for j in range(i + 1, b):
                factor = L[k, j, i]
                for c in range(m):
                    out[k, i, c] -= factor * out[k, j, c]
            factor = 1 / L[k, i, i]
            for c in range(m):
                out[k, i, c] *= factor


@numba.njit(cache=True)
def _inverse_blocks(L, U, other):
    """As `Factor.inverse_blocks`."""
    K, b = L.shape[:2]
    diagonal, beside = np.empty((K, b)), np.empty((K - 1, b))
    block, upper = np.zeros((b, b)), np.empty((b, b))
    for k in range(K - 1, -1, -1):
        upper[:] = 0.0
        for i in range(b):
            upper[i, i] = 1.0
        _lower(L[k], upper)
        upper = np.ascontiguousarray(upper.T)  # L'^-1
        if k + 1 < K:
            gain = upper @ U[k]
            product = gain @ block
            for i in range(b):
                beside[k, i] = -product[i, other[i]]
            block = upper @ upper.T + product @ gain.T
        else:
            block = upper @ upper.T
        for i in range(b):
            diagonal[k, i] = block[i, other[i]]
    return diagonal, beside
