"""Cells, and the thinned cloud on which planes are grown."""

from dataclasses import dataclass

import numpy as np

from paperrepro.boxes import cells


def _keys(p_m: np.ndarray, cell_m: float) -> np.ndarray:
    """One integer (N,) per point, equal within a cell of ``cell_m``."""
    key, *others = cells(p_m, cell_m)
    for along in others:
        key = key * (along.max() + 1) + along
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
    total = np.add.reduceat(p_m[order], start[:-1], axis=0)
    return Thinned(total / np.diff(start)[:, None], order, start)
