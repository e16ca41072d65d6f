"""What a calibration reports."""

from dataclasses import dataclass, replace

import numpy as np

from paperrepro.errors import BadInput
from paperrepro.frames import ANGLES, AXIS_WORDS
from paperrepro.method.adjustment.observability import Observability
from paperrepro.method.adjustment.quality import Reliability
from paperrepro.method.adjustment.trajectory_equations import Beams, Clock, LeverArm
from paperrepro.method.georeference import georeference
from paperrepro.method.tie_planes import Rejection, TiePlanes
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


@dataclass(frozen=True, repr=False)
class CalibrationResult:
    """Boresight (3,) rad and range offsets (rings,) m or None, with what is needed to judge them.

    ``covariance`` (u, u) a posteriori, of the boresight (rad) and then the offsets (m);
    ``planes`` (G, 4) as (n, d) in the m-frame with ``covariance_planes`` (G, 4, 4); ``sigma0`` and
    ``dof``; RMS of each plane's points about their common plane before and after, (G,) m;
    ``rejected`` faces, left out as wrong matches, and the ``kept`` ones, (F,) bool of those given,
    None: all; ``first_step`` (3,) rad, the boresight after the first iteration, but for D. Of
    scenario D alone: the ``trajectory``'s errors, the factors on the specified sigma where variance
    ``components`` were estimated, the ``lever_arm``, the ``clock`` and the ``beams`` where they
    were, and the ``reliability`` of each view.
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
    n_points: int
    n_conditions: int
    rms_before: np.ndarray
    rms_after: np.ndarray
    points_per_plane: np.ndarray
    observability: Observability
    rejected: tuple[Rejection, ...] = ()
    kept: np.ndarray | None = None
    trajectory: TrajectoryErrors | None = None
    components: dict[str, float] | None = None
    first_step: np.ndarray | None = None
    lever_arm: LeverArm | None = None
    clock: Clock | None = None
    beams: Beams | None = None
    reliability: Reliability | None = None

    @property
    def calibrated(self) -> Mounting:
        """The mounting with all that was estimated of it."""
        found = {}
        if self.lever_arm is not None:
            found["lever_arm"] = self.lever_arm.value
        if self.beams is not None:
            found["beam_offsets"] = self.beams.errors
        mounting = self.mounting.with_calibration(self.boresight, self.range_offsets)
        return replace(mounting, **found)

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

    def adjusted(self, tie_planes: TiePlanes) -> TiePlanes:
        """Of the ``tie_planes`` given to the adjustment, those that it kept."""
        return tie_planes if self.kept is None else tie_planes.subset(self.kept)

    def residuals(self, tie_planes: TiePlanes) -> np.ndarray:
        """Signed distances (N,), m, of the points from their planes, as adjusted: under the
        estimated mounting and, of scenario D, with the trajectory's errors removed.

        Parameters
        ----------
        tie_planes : TiePlanes
            Those that went into the adjustment; of one with ``rejected`` faces, those kept.

        Raises
        ------
        BadInput
            Where they are others.
        """
        if tie_planes.n_planes != self.n_planes or len(tie_planes.rays) != self.n_points:
            raise BadInput(
                f"residuals: expected the {self.n_planes} planes and {self.n_points} points of "
                f"this adjustment, got {tie_planes.n_planes} and {len(tie_planes.rays)}; leave out "
                "the rejected faces with TiePlanes.subset"
            )
        rays = tie_planes.rays
        rays = rays if self.trajectory is None else self.trajectory.apply(rays)
        plane = self.planes[tie_planes.plane_of_point]
        p_m = georeference(rays, self.calibrated)
        return np.einsum("na,na->n", p_m, plane[:, :3]) - plane[:, 3]  # n . p - d, Eq. (4)

    def residuals_of_views(self, tie_planes: TiePlanes) -> np.ndarray:
        """Mean residual (F,), m, of each view, a face as one strip shows it; see `residuals`."""
        sums = np.add.reduceat(self.residuals(tie_planes), tie_planes.ranges[:, 0])
        return sums / np.diff(tie_planes.ranges, axis=1)[:, 0]

    def summary(self) -> str:
        """Lines for a reader: the angles with their sigma, the fit, what is weak."""
        angles = [
            f"  {name:5s} {np.degrees(value):+9.4f}° ± {np.degrees(sigma):.4f}°  ({axis})"
            for name, value, sigma, axis in zip(
                ANGLES, self.boresight, self.sigma, AXIS_WORDS, strict=True
            )
        ]
        fit = (
            f"  {self.n_planes} planes, {self.n_points} points, sigma0 {self.sigma0:.2f}, RMSE "
            f"{100 * self.rmse_before:.1f} cm before, {100 * self.rmse_after:.1f} cm after"
        )
        return "\n".join([f"scenario {self.scenario}", *angles, fit, f"  {self.observability}"])

    def __repr__(self) -> str:
        angles = ", ".join(
            f"{name} {np.degrees(value):.4f} ± {np.degrees(sigma):.4f}°"
            for name, value, sigma in zip(ANGLES, self.boresight, self.sigma, strict=True)
        )
        weak = ", ".join(self.observability.undetermined) or "nothing"
        return (
            f"CalibrationResult({self.scenario}: {angles}; {self.n_planes} planes, "
            f"{self.n_points} points, sigma0 {self.sigma0:.2f}, not determined: {weak})"
        )

    def _repr_html_(self) -> str:
        return f"<pre>{self.summary()}</pre>"

    @property
    def rmse_before(self) -> float:
        return _pooled(self.rms_before, self.points_per_plane)

    @property
    def rmse_after(self) -> float:
        return _pooled(self.rms_after, self.points_per_plane)


def _pooled(rms: np.ndarray, count: np.ndarray) -> float:
    return float(np.sqrt(np.average(np.square(rms), weights=count)))
