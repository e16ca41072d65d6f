"""What a calibration reports."""

from dataclasses import dataclass, replace

import numpy as np

from paperrepro.method.adjustment.observability import Observability
from paperrepro.method.adjustment.quality import Reliability
from paperrepro.method.adjustment.trajectory_equations import Clock, LeverArm
from paperrepro.method.tie_planes import Rejection
from paperrepro.survey import Mounting, Rays


@dataclass(frozen=True)
class TrajectoryErrors:
    """What scenario D finds of the trajectory's error: at nodes ``time`` (K,) s the ``correction``
    (K, 6) to be added to the reported pose, m and rad, ``constant`` (6,) of it all the time, the
    ``sigma`` (K, 6) of the part that changes; before the data, these had ``prior_sigma`` (6,) and
    ``constant_sigma`` (6,)."""

    time: np.ndarray
    correction: np.ndarray
    sigma: np.ndarray
    constant: np.ndarray
    prior_sigma: np.ndarray
    constant_sigma: np.ndarray

    def apply(self, rays: Rays) -> Rays:
        """The rays with corrected poses; beyond the nodes the nearest correction holds."""
        shift = [np.interp(rays.time, self.time, column) for column in self.correction.T]
        return replace(rays, pose=rays.pose + np.column_stack(shift))


@dataclass(frozen=True)
class CalibrationResult:
    """Boresight (3,) rad and range offsets (rings,) m or None, with what is needed to judge them.

    ``covariance`` (u, u) a posteriori, of the boresight (rad) and then the offsets (m);
    ``planes`` (G, 4) as (n, d) in the m-frame with ``covariance_planes`` (G, 4, 4); ``sigma0`` and
    ``dof``; RMS of each plane's points about their common plane before and after, (G,) m;
    ``rejected`` faces, left out as wrong matches. Of scenario D alone: the ``trajectory``'s errors,
    the factors on the specified sigma where variance ``components`` were estimated, the
    ``lever_arm`` and the ``clock`` where they were, and the ``reliability`` of each view.
    """

    scenario: str
    mounting: Mounting
    boresight: np.ndarray
    range_offsets: np.ndarray | None
    covariance: np.ndarray
    planes: np.ndarray
    covariance_planes: np.ndarray
    sigma0: float
    dof: int
    iterations: int
    converged: bool
    n_points: int
    n_conditions: int
    rms_before: np.ndarray
    rms_after: np.ndarray
    points_per_plane: np.ndarray
    observability: Observability
    rejected: tuple[Rejection, ...] = ()
    trajectory: TrajectoryErrors | None = None
    components: dict[str, float] | None = None
    lever_arm: LeverArm | None = None
    clock: Clock | None = None
    reliability: Reliability | None = None

    @property
    def calibrated(self) -> Mounting:
        """The mounting with all that was estimated of it."""
        mounting = self.mounting.with_calibration(self.boresight, self.range_offsets)
        if self.lever_arm is None:
            return mounting
        return replace(mounting, lever_arm=self.lever_arm.value)

    @property
    def n_planes(self) -> int:
        return len(self.planes)

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations (3,) rad of the boresight."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def sigma_offsets(self) -> np.ndarray | None:
        """Standard deviations of the estimated range offsets, m."""
        return None if self.range_offsets is None else np.sqrt(np.diag(self.covariance)[3:])

    @property
    def correlation(self) -> np.ndarray:
        """(u, u)."""
        sigma = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(sigma, sigma)

    @property
    def rmse_before(self) -> float:
        return _pooled(self.rms_before, self.points_per_plane)

    @property
    def rmse_after(self) -> float:
        return _pooled(self.rms_after, self.points_per_plane)


def _pooled(rms: np.ndarray, count: np.ndarray) -> float:
    return float(np.sqrt(np.average(np.square(rms), weights=count)))
