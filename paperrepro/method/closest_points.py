"""The boresight from points on local planes of others, from as far off as ten degrees.

Point-to-plane ICP (Chen and Medioni 1992) between everything that sees a place from elsewhere: not
only strips, also sectors of one strip's beams, which see it from metres apart. Each keeps its own
local planes, since a boresight error leaves the surface thin within a narrow sector and makes it
decimetres thick within the fan. Where two views meet, the distance of a point of one from the
nearest local plane of the other is linear in the boresight. Pairs within a strip and between strips
have a scale of their own, robust against what is no plane: else the many within a strip, which any
roll fits, would outvote those between strips.

No patch has an edge here, so nothing hinges on where one lies.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from paperrepro._compiled import one_blas_thread
from paperrepro.errors import NoConvergence, TooFewPlanes
from paperrepro.method.georeference import georeference
from paperrepro.method.planes import neighbourhood
from paperrepro.survey import Mounting, Rays, Survey

#: Width of a sector of beams, deg.
SECTOR_DEG = 3.5
#: Points of a view that local planes are made of, and that are looked up in others, in all; the
#: views that each is looked up in; neighbours of a local plane.
POINTS_OF_VIEW, LOOKED_UP, OTHERS, NEIGHBOURS = 4000, 16_000, 6, 11
#: How far the like of a point may lie, in ranges, step by step: a boresight error of ten degrees
#: moves points by a sixth of their range.
REACHES = (0.17, 0.12, 0.08, 0.05, 0.035, 0.025, 0.018, 0.012)
#: A local plane is at most so rough, in ranges, and its normal may differ from its like's by so
#: much, deg, while views are farther apart than `NEAR` ranges and after.
ROUGHEST, NEAR, TURNED_DEG = 0.005, 0.03, (25.0, 15.0)
#: Pairs without which nothing is told of the boresight.
LEAST_PAIRS = 50
#: Least scale of distances, m; what the start is good to, rad, which holds what no pair tells.
LEAST_SCALE_M, START_SIGMA = 0.01, np.deg2rad(10.0)
#: Neighbouring pairs repeat one another: what a pair weighs.
INDEPENDENT = 0.05
#: Change at which a reach is done, and the last; steps at most of each.
DONE, SETTLED, STEPS, LAST_STEPS = np.deg2rad(0.02), np.deg2rad(0.005), 4, 12
_STEP = 1e-4  # of a numeric derivative, rad


@dataclass(frozen=True)
class _View:
    """What a sector of beams of one strip sees: points (N, 3) m, derivatives (N, 3, 3) with respect
    to the boresight, normals (N, 3), and ``tree`` of those ``planar`` (K,)."""

    p_m: np.ndarray
    J: np.ndarray
    normal: np.ndarray
    planar: np.ndarray
    tree: cKDTree | None

    @classmethod
    def under(cls, rays: Rays, mounting: Mounting, boresight: np.ndarray) -> "_View":
        def placed(x):
            return georeference(rays, mounting.with_calibration(x))

        p_m = placed(boresight)
        J = [(placed(boresight + _STEP * axis) - p_m) / _STEP for axis in np.eye(3)]
        scale = float(np.median(rays.rho))
        around = neighbourhood(p_m, NEIGHBOURS, 0.1 * scale)
        enough = (around.index >= 0).sum(axis=1) >= NEIGHBOURS // 2
        planar = np.flatnonzero(enough & (around.residual <= ROUGHEST * scale))
        tree = cKDTree(p_m[planar]) if len(planar) else None
        return cls(p_m, np.stack(J, axis=2), around.normal, planar, tree)


@dataclass(frozen=True)
class _Pairs:
    """Distances (P,) m of points from local planes of other views, their derivatives (P, 3), and
    whether the two views are of different ``strips`` (P,)."""

    distance: np.ndarray
    J: np.ndarray
    strips: np.ndarray

    def step(self) -> np.ndarray:
        """Correction (3,) rad of the boresight, by reweighting with the loss of Geman and
        McClure."""
        dx = np.zeros(3)
        for _ in range(5):
            left = self.distance + self.J @ dx
            scale = np.ones(len(left))
            for kind in (True, False):
                of = self.strips == kind
                if of.any():
                    scale[of] = max(1.4826 * np.median(np.abs(left[of])), LEAST_SCALE_M)
            weight = INDEPENDENT / (1 + (left / scale) ** 2) ** 2 / scale**2
            N = self.J.T @ (weight[:, None] * self.J) + np.eye(3) / START_SIGMA**2
            dx = -np.linalg.solve(N, self.J.T @ (weight * self.distance))
        return dx


@one_blas_thread
def boresight_by_closest_points(survey: Survey, rays: dict[str, Rays], seed: int = 0) -> np.ndarray:
    """The boresight under which what is seen from different places agrees.

    Parameters
    ----------
    survey : Survey
        Its mounting is the start.
    rays : dict of Rays
        By strip, some hundred thousand at most.
    seed : int
        Of the points that are looked at.

    Returns
    -------
    (3,) array, rad
        Right to some hundredths of a degree where the flight tells it; a direction that no pair
        tells stays at the start.

    Raises
    ------
    TooFewPlanes
        Where strips share no local planes.
    NoConvergence

    References
    ----------
    Chen and Medioni 1992; sections of a strip as in Glira et al. 2015.
    """
    rng = np.random.default_rng(seed)
    sectors = list(_sectors(survey, rays, rng))
    strip = np.array([number for number, _ in sectors])
    scale = float(np.median(np.concatenate([of.rho for _, of in sectors])))
    others = [_others(a, strip, rng) for a in range(len(sectors))]
    x = survey.mounting.boresight
    for reach in REACHES:
        last = reach == REACHES[-1]
        for _ in range(LAST_STEPS if last else STEPS):
            views = [_View.under(of, survey.mounting, x) for _, of in sectors]
            dx = _pairs(views, others, strip, reach, scale).step()
            x = x + dx
            if np.abs(dx).max() < (SETTLED if last else DONE):
                break
    if np.abs(dx).max() > DONE:
        raise NoConvergence(
            f"the strips did not settle on one another, last change "
            f"{np.rad2deg(np.abs(dx).max()):.3f} deg; look at the mounting's rotation and the "
            "trajectory, or give strips with more overlap"
        )
    return x


def _sectors(survey: Survey, rays: dict[str, Rays], rng: np.random.Generator):
    """Number of the strip and its rays in random order, by sector of beams."""
    elevations = map(survey.elevation, survey.strips)
    edges = [(of_strip.min(), of_strip.max()) for of_strip in elevations]
    low, high = np.degrees([np.min(edges), np.max(edges)])
    count = max(1, round((high - low) / SECTOR_DEG))
    for number, of_strip in enumerate(rays.values()):
        sector = (np.degrees(of_strip.elevation) - low) / max(high - low, 1e-9) * count
        of_ray = np.minimum(sector.astype(int), count - 1)
        for k in range(count):
            index = np.flatnonzero(of_ray == k)
            if len(index) > NEIGHBOURS:
                most = min(len(index), POINTS_OF_VIEW)
                yield number, of_strip.take(rng.choice(index, most, replace=False))


def _pairs(
    views: list[_View], others: list[np.ndarray], strip: np.ndarray, reach: float, scale: float
) -> _Pairs:
    """Each view looks some of its points up in ``others``."""
    looked_up = max(40, LOOKED_UP // len(views))
    least = np.cos(np.radians(TURNED_DEG[int(reach <= NEAR)]))
    distance, J, strips = [], [], []
    for a, one in enumerate(views):
        if one.tree is None:
            continue
        for b in others[a]:
            other = views[b]
            if other.tree is None:
                continue
            i = one.planar[:looked_up]
            off, nearest = other.tree.query(one.p_m[i], distance_upper_bound=reach * scale)
            i, j = i[np.isfinite(off)], other.planar[nearest[np.isfinite(off)]]
            alike = np.abs(np.einsum("na,na->n", one.normal[i], other.normal[j])) > least
            i, j = i[alike], j[alike]
            n = other.normal[j]
            distance.append(np.einsum("na,na->n", n, one.p_m[i] - other.p_m[j]))
            J.append(np.einsum("na,nak->nk", n, one.J[i] - other.J[j]))
            strips.append(np.full(len(i), strip[a] != strip[b]))
    pairs = _Pairs(*(np.concatenate(x) if x else np.empty(0) for x in (distance, J, strips)))
    if not len(pairs.strips) or pairs.strips.sum() < LEAST_PAIRS:
        raise TooFewPlanes(
            f"expected places that two strips show as planes, at least {LEAST_PAIRS}, found "
            f"{int(pairs.strips.sum())}; give strips that overlap, over ground, roofs or walls, or "
            "start from a mounting closer to the truth"
        )
    return pairs


def _others(a: int, strip: np.ndarray, rng) -> np.ndarray:
    """Views in which view ``a`` is looked up: as many of its own strip as of others."""
    own = np.flatnonzero((strip == strip[a]) & (np.arange(len(strip)) != a))
    foreign = np.flatnonzero(strip != strip[a])
    return np.concatenate([rng.permutation(own)[:OTHERS], rng.permutation(foreign)[:OTHERS]])
