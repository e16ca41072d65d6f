"""What is left of the errors of a MEMS INS/GNSS after filter and smoother.

The errors of a strapdown INS are linear in small errors: gyros, accelerometers and GNSS are
disturbed along the true motion, an error-state Kalman filter estimates what they did, and the
Rauch-Tung-Striebel smoother runs back. The filter knows all processes as they are, so what is left
is what its own covariance says. Earth rate, transport rate and the antenna's lever arm are left
out: over minutes and metres they are small against the noise.

State (18,): position and velocity m, m/s and attitude psi rad, all m-frame; gyro bias rad/s and
accelerometer bias m/s², b-frame; correlated error of GNSS m. The INS takes R_b_m for
(I + [psi]x) R_b_m. Sources: Groves, Principles of GNSS, Inertial and Multisensor Integrated
Navigation Systems, 2nd ed., ch. 14; Rauch, Tung, Striebel, AIAA Journal 3 (1965).
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from data_synth.motion import wrap
from paperrepro.frames import T_NED_ENU
from paperrepro.survey import Trajectory

#: An IMU of the APX-15's class: angle random walk 0.15 deg/sqrt(h), velocity random walk
#: 0.03 m/s/sqrt(h), bias instability 3 deg/h and 0.2 mg with the correlation time below, s.
ANGLE_WALK, VELOCITY_WALK = np.radians(0.15) / 60.0, 0.03 / 60.0
GYRO_BIAS, ACCELEROMETER_BIAS, BIAS_TIME = np.radians(3.0) / 3600.0, 0.2e-3 * 9.80665, 300.0
#: GNSS once a second: white error and an equal one with minutes of correlation, east, north, up m.
GNSS_STEP, GNSS_SIGMA, GNSS_TIME = 1.0, np.array([0.01, 0.01, 0.02]), 180.0
#: Steps of the filter, s; GNSS_STEP is a multiple.
STEP = 0.05
#: What the alignment before take-off leaves: position m, velocity m/s, roll, pitch, heading rad.
START_SIGMA = np.array([0.1] * 3 + [0.1] * 3 + list(np.radians([0.5, 0.5, 2.0])))
GRAVITY = np.array([0.0, 0.0, -9.80665])
N_STATES = 18
POSITION, VELOCITY, ATTITUDE, GYRO, ACCELEROMETER, GNSS = (
    slice(first, first + 3) for first in range(0, N_STATES, 3)
)


@dataclass(frozen=True)
class ErrorModel:
    """x[k+1] = transition[k] x[k] + w, w ~ N(0, noise[k]): ``transition`` and ``noise``
    (K, 18, 18); ``start_sigma`` (18,); GNSS observes every ``every``-th state."""

    transition: np.ndarray
    noise: np.ndarray
    start_sigma: np.ndarray
    every: int

    @property
    def observed(self) -> np.ndarray:
        """(3, 18): GNSS minus INS, to the sign, sees the position's error and its own."""
        H = np.zeros((3, N_STATES))
        H[:, POSITION] = H[:, GNSS] = np.eye(3)
        return H


def error_model(position: np.ndarray, R_b_m: np.ndarray) -> ErrorModel:
    """Of a true motion: ``position`` (K, 3) m and ``R_b_m`` (K, 3, 3), every `STEP` s."""
    velocity = np.gradient(position, STEP, axis=0)
    force = np.diff(velocity, axis=0) / STEP - GRAVITY  # mean specific force of each step
    count = len(force)
    rate = np.zeros((count, N_STATES, N_STATES))
    rate[:, POSITION, VELOCITY] = np.eye(3)
    rate[:, VELOCITY, ATTITUDE] = -_skew(force)
    rate[:, VELOCITY, ACCELEROMETER] = R_b_m[:-1]
    rate[:, ATTITUDE, GYRO] = R_b_m[:-1]
    for part, time in ((GYRO, BIAS_TIME), (ACCELEROMETER, BIAS_TIME), (GNSS, GNSS_TIME)):
        rate[:, part, part] = -np.eye(3) / time
    turned = STEP * rate
    transition = np.eye(N_STATES) + turned + 0.5 * turned @ turned
    density = np.zeros(N_STATES)
    density[VELOCITY], density[ATTITUDE] = VELOCITY_WALK**2, ANGLE_WALK**2
    density[GYRO] = 2 * GYRO_BIAS**2 / BIAS_TIME
    density[ACCELEROMETER] = 2 * ACCELEROMETER_BIAS**2 / BIAS_TIME
    density[GNSS] = 2 * GNSS_SIGMA**2 / GNSS_TIME
    white = STEP * np.diag(density)
    noise = 0.5 * (white + transition @ white @ transition.transpose(0, 2, 1))
    lasting = [np.full(3, GYRO_BIAS), np.full(3, ACCELEROMETER_BIAS), GNSS_SIGMA]
    start_sigma = np.concatenate([START_SIGMA, *lasting])
    return ErrorModel(transition, noise, start_sigma, round(GNSS_STEP / STEP))


def draw_errors(model: ErrorModel, count: int, rng: np.random.Generator):
    """Errors (K + 1, 18, count) of ``count`` missions over one motion, and the observations
    (K + 1, 3, count) that GNSS makes of them."""
    steps = len(model.transition)
    x = np.empty((steps + 1, N_STATES, count))
    x[0] = model.start_sigma[:, None] * rng.normal(size=(N_STATES, count))
    root = np.linalg.cholesky(model.noise + 1e-24 * np.eye(N_STATES))
    drive = root @ rng.normal(size=(steps, N_STATES, count))
    for k in range(steps):
        x[k + 1] = model.transition[k] @ x[k] + drive[k]
    return x, model.observed @ x + GNSS_SIGMA[:, None] * rng.normal(size=(steps + 1, 3, count))


def smooth(model: ErrorModel, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed estimates (K + 1, 18, count) of the errors and their covariances (K + 1, 18, 18),
    from ``z`` (K + 1, 3, count): the Kalman filter forwards, the smoother backwards."""
    F, H, steps = model.transition, model.observed, len(model.transition)
    predicted, filtered = np.empty((2, steps + 1, N_STATES, z.shape[2]))
    P_predicted, P_filtered = np.empty((2, steps + 1, N_STATES, N_STATES))
    x, P = np.zeros((N_STATES, z.shape[2])), np.diag(model.start_sigma**2)
    for k in range(steps + 1):
        if k > 0:
            x, P = F[k - 1] @ x, F[k - 1] @ P @ F[k - 1].T + model.noise[k - 1]
        predicted[k], P_predicted[k] = x, P
        if k % model.every == 0:
            S = H @ P @ H.T + np.diag(GNSS_SIGMA**2)
            gain = np.linalg.solve(S, H @ P).T
            x, P = x + gain @ (z[k] - H @ x), P - gain @ S @ gain.T
            P = 0.5 * (P + P.T)
        filtered[k], P_filtered[k] = x, P
    for k in range(steps - 1, -1, -1):
        gain = _solve_scaled(P_predicted[k + 1], F[k] @ P_filtered[k]).T
        filtered[k] += gain @ (filtered[k + 1] - predicted[k + 1])
        P_filtered[k] += gain @ (P_filtered[k + 1] - P_predicted[k + 1]) @ gain.T
    return filtered, P_filtered


def smoother_error(
    truth: Trajectory, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the smoother's trajectory is off by, and what it knows of that.

    Parameters
    ----------
    truth : M true poses, m-frame, at a constant step of which `STEP` is a multiple.

    Returns
    -------
    (M, 6) : east, north, up m; roll, pitch, heading rad. Between two steps of the filter a cubic.
    (K,) s : times of the filter's steps.
    (K, 6) : standard deviations of the error at these, near level.
    """
    stride = round(STEP / float(np.median(np.diff(truth.time))))
    time, attitude = truth.time[::stride], truth.attitude[::stride]
    T = Rotation.from_matrix(T_NED_ENU)
    R_b_m = T * Rotation.from_euler("ZYX", attitude[:, ::-1])
    model = error_model(truth.position[::stride], R_b_m.as_matrix())
    x, z = draw_errors(model, 1, rng)
    estimate, covariance = smooth(model, z)
    left = (x - estimate)[:, :, 0]
    turned = T * Rotation.from_rotvec(left[:, ATTITUDE]) * R_b_m
    turn = wrap(turned.as_euler("ZYX")[:, ::-1] - attitude)
    error = CubicSpline(time, np.column_stack([left[:, POSITION], turn]))
    return error(np.minimum(truth.time, time[-1])), time, _sigma(covariance, attitude[:, 2])


def _sigma(covariance: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """(K, 6) of covariances (K, 18, 18): a turn about east or north is one of roll and pitch."""
    to_body = np.zeros((len(heading), 3, 3))
    to_body[:, 0, :2] = np.column_stack([np.sin(heading), np.cos(heading)])
    to_body[:, 1, :2] = np.column_stack([np.cos(heading), -np.sin(heading)])
    to_body[:, 2, 2] = -1.0
    turned = to_body @ covariance[:, ATTITUDE, ATTITUDE] @ to_body.transpose(0, 2, 1)
    blocks = covariance[:, POSITION, POSITION], turned
    return np.sqrt(np.hstack([np.diagonal(block, axis1=1, axis2=2) for block in blocks]))


def _skew(v: np.ndarray) -> np.ndarray:
    """(K, 3, 3), so that _skew(v) @ u = v x u."""
    out = np.zeros((len(v), 3, 3))
    out[:, 2, 1], out[:, 0, 2], out[:, 1, 0] = v.T
    return out - out.transpose(0, 2, 1)


def _solve_scaled(P: np.ndarray, B: np.ndarray) -> np.ndarray:
    """P⁻¹ B of a covariance whose states differ by ten powers of ten: solved in sigmas."""
    scale = 1.0 / np.sqrt(np.diag(P))
    return scale[:, None] * np.linalg.solve(P * np.outer(scale, scale), scale[:, None] * B)
