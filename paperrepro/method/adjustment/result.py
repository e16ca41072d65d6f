"""What a calibration reports."""

from dataclasses import dataclass, replace

import numpy as np

from paperrepro.errors import BadInput
from paperrepro.frames import ANGLES, AXIS_WORDS
from paperrepro.method.adjustment.observability import Observability
from paperrepro.method.adjustment.quality import Reliability
from paperrepro.method.adjustment.trajectory_equations import (
    Beams,
    Clock,
    GaussMarkov,
    LeverArm,
)
from paperrepro.method.georeference import georeference
from paperrepro.method.tie_planes import Rejection, TiePlanes
from paperrepro.survey import Mounting, Rays, Trajectory

#: Times at which the trajectory's error is reckoned at once.
BLOCK = 65536


@dataclass(frozen=True)
class TrajectoryErrors:
    """What scenario D finds of the trajectory's error: what must be added to the reported pose,
    m and rad.

    At nodes ``time`` (K,) s the ``error`` (K, P, 6) of each of the ``processes``; ``covariance``
    (P, K, P, 6), at [s, k, p], of process p with process p + s at the same node, and ``beside``
    (P, K - 1, P, 6) at the next; ``constant`` (6,) all the time, with ``constant_sigma`` (6,)
    before the data. Points have the poses of ``delay`` s later, where the laser's clock was an
    unknown: those of the trajectory ``reported``.
    """

    time: np.ndarray
    error: np.ndarray
    covariance: np.ndarray
    beside: np.ndarray
    processes: tuple[GaussMarkov, ...]
    constant: np.ndarray
    constant_sigma: np.ndarray
    delay: float = 0.0
    reported: Trajectory | None = None

    @property
    def correction(self) -> np.ndarray:
        """(K, 6) at the nodes, all parts together."""
        return self.error.sum(axis=1) + self.constant

    @property
    def sigma(self) -> np.ndarray:
        """(K, 6) at the nodes, of the part that changes: a constant's goes with the boresight's."""
        return np.sqrt(np.maximum(self.covariance.sum(axis=(0, 2)), 0.0))

    @property
    def prior_sigma(self) -> np.ndarray:
        """(6,) of the part that changes, before the data."""
        return np.sqrt(sum(np.square(process.sigma) for process in self.processes))

    def at(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Correction and sigma, both (N, 6) m and rad, at ``time`` (N,) s of the laser.

        Between nodes the processes' conditional mean, whose sigma grows away from them; where no
        node is near, and beyond the last, what is known fades to zero.
        """
        time = np.asarray(time, float)
        parts = [self._at(time[first : first + BLOCK]) for first in range(0, len(time), BLOCK)]
        mean, variance = map(np.concatenate, zip(*parts, strict=True))
        return mean, np.sqrt(np.maximum(variance, 0.0))

    def _at(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        before = np.clip(np.searchsorted(self.time, time, "right") - 1, 0, len(self.time) - 2)
        first, last = self.time[before], self.time[before + 1]
        inside = np.clip(time, first, last)
        mean, variance = np.tile(self.constant, (len(time), 1)), np.zeros((len(time), 6))
        shares = []
        for p, process in enumerate(self.processes):
            tau, at_nodes = process.correlation_time, process.factor(self.time)
            to_first, to_last, gap, away = (
                np.exp(-np.abs(lag)[:, None] / tau)
                for lag in (inside - first, last - inside, last - first, time - inside)
            )
            known, factor = away / (1 - gap**2), process.factor(time)
            of_first = (1 - to_last**2) * to_first * known
            of_last = (1 - to_first**2) * to_last * known
            explained = away * (of_first * to_first + of_last * to_last)
            variance += np.square(process.sigma * factor) * (1 - explained)
            of_first, of_last = (
                share * factor / at_nodes[node]
                for share, node in ((of_first, before), (of_last, before + 1))
            )
            mean += of_first * self.error[before, p] + of_last * self.error[before + 1, p]
            shares.append((of_first, of_last))
        for p, (of_first, of_last) in enumerate(shares):
            for s in range(len(shares)):
                other_first, other_last = shares[(p + s) % len(shares)]
                variance += of_first * other_first * self.covariance[s, before, p]
                variance += of_last * other_last * self.covariance[s, before + 1, p]
                variance += 2 * of_first * other_last * self.beside[s, before, p]
        return mean, variance

    def poses(self, time: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Corrected poses (N, 6) of points at ``time`` (N,) s with reported poses ``pose`` (N, 6),
        the laser's delay removed."""
        if self.reported is not None:
            times = self.reported.time
            later = self.reported.at(np.clip(time + self.delay, times[0], times[-1]))
            later[:, 5] += 2 * np.pi * np.round((pose[:, 5] - later[:, 5]) / (2 * np.pi))
            pose = later
        return pose + self.at(time)[0]

    def apply(self, rays: Rays) -> Rays:
        """The rays with corrected poses."""
        return replace(rays, pose=self.poses(rays.time, rays.pose))


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
