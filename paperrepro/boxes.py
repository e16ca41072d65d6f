"""Points in boxes and cells.

Column by column: along the short side of (N, 3) NumPy takes twenty times as long.
"""

import numpy as np


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
    return np.array([np.floor((x - x.min()) / edge_m) for x in p_m.T]).astype(np.int64)
