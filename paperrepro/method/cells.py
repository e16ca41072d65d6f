"""Cells: the thinned cloud on which planes are grown, and points in boxes.

Coordinates are taken column by column: along the short side of (N, 3) NumPy takes twenty times as
long.
"""

from dataclasses import dataclass

import numpy as np


def _keys(p_m: np.ndarray, cell_m: float) -> np.ndarray:
    """One integer (N,) per point, equal within a cell of ``cell_m``."""
    key, *others = cells(p_m, cell_m)
    for along in others:
        key *= along.max() + 1
        key += along
    return key


@dataclass(frozen=True)
class Thinned:
    """A cloud reduced to the mean point of every occupied voxel.

    ``p_m`` (V, 3) m, the means; ``order`` (N,) sorts the full cloud by voxel and ``start`` (V + 1,)
    says where each voxel begins in it.
    """

    p_m: np.ndarray
    order: np.ndarray
    start: np.ndarray

    def __len__(self) -> int:
        return len(self.p_m)

    def members(self, voxels: np.ndarray) -> np.ndarray:
        """Indices into the full cloud of all points in ``voxels`` (K,)."""
        first, count = self.start[voxels], np.diff(self.start)[voxels]
        before = np.concatenate([[0], np.cumsum(count)[:-1]]) if len(count) else count
        return self.order[np.repeat(first - before, count) + np.arange(count.sum())]


def thin(p_m: np.ndarray, cell_m: float) -> Thinned:
    """`Thinned` of points (N, 3) m with cubic voxels of edge ``cell_m``."""
    if len(p_m) == 0:
        return Thinned(np.empty((0, 3)), np.empty(0, dtype=int), np.zeros(1, dtype=int))
    key = _keys(p_m, cell_m)
    order = np.argsort(key, kind="stable")
    change = np.flatnonzero(np.diff(key[order])) + 1
    start = np.concatenate([[0], change, [len(p_m)]])
    means = np.empty((len(start) - 1, 3))
    for column, x in zip(means.T, p_m.T, strict=True):
        column[:] = np.add.reduceat(x[order], start[:-1]) / np.diff(start)
    return Thinned(means, order, start)


def extent(p_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest coordinates (D,) of points (N >= 1, D)."""
    return np.array([x.min() for x in p_m.T]), np.array([x.max() for x in p_m.T])


def inside(p_m: np.ndarray, low, high) -> np.ndarray:
    """Mask (N,) of the points (N, D) from corner ``low`` (D,) to ``high`` (D,), or of a cube
    between two numbers; its faces belong to it."""
    mask = np.ones(len(p_m), dtype=bool)
    corners = (np.broadcast_to(corner, p_m.shape[1]) for corner in (low, high))
    for x, least, greatest in zip(p_m.T, *corners, strict=True):
        mask &= (x >= least) & (x <= greatest)
    return mask


def cells(p_m: np.ndarray, edge_m: float) -> np.ndarray:
    """Number (D, N) of each point's cell of ``edge_m`` along every axis, from 0."""
    number = np.empty(p_m.shape[::-1], np.int64)
    for along, x in zip(number, p_m.T, strict=True):
        along[:] = np.floor((x - x.min()) / edge_m)
    return number
