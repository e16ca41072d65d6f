"""Statistical outlier removal, SOR (reference 39 of the paper: Rusu et al. 2008)."""

from dataclasses import dataclass

import numpy as np

from paperrepro.segmentation.neighbours import mean_neighbour_distance


@dataclass(frozen=True)
class OutlierParameters:
    """``k`` neighbours; a point goes when its mean distance to them exceeds mu + ``alpha`` sigma.

    The paper prints neither number. Sigma is here the trend of density, not noise: it comes out
    near mu / 2. A face grazed at 80 degrees at the swath's edge has, by range and incidence,
    sqrt(4 / cos 80) = 5 times the spacing of nadir, which is 6 to 8 sigma; dust and birds stand
    metres from anything. So alpha = 10 keeps such a face and drops what is alone in the air.
    """

    k: int = 16
    alpha: float = 10.0


def statistical_outliers(p_m: np.ndarray, k: int = 16, alpha: float = 10.0) -> np.ndarray:
    """Mask (N,) of the points to keep.

    p_m : (N, 3) array, m, any Cartesian frame. ``k`` neighbours, the point itself not counted;
    kept where the mean distance to them is at most mu + ``alpha`` sigma over all points. A cloud
    of k points or fewer has no statistics and is kept whole.
    """
    if len(p_m) <= k:
        return np.ones(len(p_m), dtype=bool)
    mean_distance = mean_neighbour_distance(p_m, k)
    return mean_distance <= mean_distance.mean() + alpha * mean_distance.std()
