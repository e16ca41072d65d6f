"""Ground and non-ground by the progressive morphological filter, PMF (reference 40: Zhang 2003)."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from paperrepro.errors import BadInput
from paperrepro.method.cells import cells


@dataclass(frozen=True)
class GroundParameters:
    """Table 2: cell 1 m, base 2 cells, slope 5 %, greatest threshold 10 m.

    ``windows`` is "exponential", w_k = 2 b^k + 1 (Table 2), or "linear", w_k = 2 k b + 1 (the
    paper's text). ``largest_window_m`` must exceed the narrower side of the widest building.
    ``threshold_m`` is the height that separates object from ground at the smallest window: more
    than ground can be smeared by three degrees of boresight over the beams' fan (0.55 m at 30 m),
    less than the eaves of a shed.
    """

    cell_m: float = 1.0
    base_cells: int = 2
    windows: str = "exponential"
    largest_window_m: float = 33.0
    slope: float = 0.05
    threshold_m: float = 1.0
    largest_threshold_m: float = 10.0


def window_sizes(params: GroundParameters) -> list[int]:
    """Window edges in cells, odd and increasing, up to the largest window."""
    b, largest = params.base_cells, params.largest_window_m / params.cell_m
    sequences = {"linear": lambda k: 2 * k * b + 1, "exponential": lambda k: 2 * b**k + 1}
    if params.windows not in sequences or (params.windows == "exponential" and b < 2) or b < 1:
        raise BadInput(
            f"PMF windows: expected 'linear' with base >= 1 or 'exponential' with base >= 2, got "
            f"{params.windows!r} with base {b}; choose one of the two"
        )
    sizes = []
    while (size := sequences[params.windows](len(sizes) + 1)) <= largest:
        sizes.append(size)
    return sizes


def height_thresholds(sizes: list[int], params: GroundParameters) -> list[float]:
    """Height difference, m, above which a point is no ground, for each window. Zhang's Eq. (7)."""
    rise = params.slope * params.cell_m * np.diff([1, *sizes])
    rise[:1] = 0.0  # the first window has the initial threshold alone
    return np.minimum(rise + params.threshold_m, params.largest_threshold_m).tolist()


def progressive_morphological_filter(
    p_m: np.ndarray, params: GroundParameters | None = None
) -> np.ndarray:
    """Mask (N,) of the ground points among p_m (N, 3), m, z up.

    The lowest points of the cells make a surface, opened by growing windows; a point that rises
    above the opened surface by more than the window's threshold is no ground.
    """
    params = params or GroundParameters()
    ground = np.ones(len(p_m), dtype=bool)
    if len(p_m) == 0:
        return ground
    surface, column = _lowest(p_m, params.cell_m)
    sizes = window_sizes(params)
    for size, threshold in zip(sizes, height_thresholds(sizes, params), strict=True):
        surface = _open(surface, size)
        ground &= p_m[:, 2] - surface.ravel()[column] <= threshold
    return ground


def _lowest(p_m: np.ndarray, cell_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Lowest height per cell, (rows, columns), +inf where no point fell, and each point's cell."""
    across, along = cells(p_m[:, :2], cell_m)
    shape = int(across.max()) + 1, int(along.max()) + 1
    column = across * shape[1] + along
    lowest = np.full(shape[0] * shape[1], np.inf)
    np.minimum.at(lowest, column, p_m[:, 2])
    return lowest.reshape(shape), column


def _open(surface: np.ndarray, size: int) -> np.ndarray:
    """Erosion, then dilation, by a square window; empty cells and the outside take no part.

    So a building cut by the swath's edge is as narrow as the part that was seen. (A window without
    any point erodes to +inf, and reaches no occupied cell when dilated.)
    """
    eroded = ndimage.minimum_filter(surface, size, mode="constant", cval=np.inf)
    opened = ndimage.maximum_filter(eroded, size, mode="constant", cval=-np.inf)
    return np.where(np.isinf(surface), np.inf, opened)
