"""The error of the post-processed GNSS/INS, an Applanix APX-15 UAV, as one of several processes.

`NAVIGATION` names them. All but two have the specification's variances at any moment, taken over
surveys, so that the specification is honest and only the shape in time is another; ``smoother`` has
the magnitudes that an IMU of this class gives (`data_synth.inertial`), which are smaller, and says
so as post-processors do, by standard deviations over time; ``outage`` exceeds the specification
while GNSS is lost. Six components: east, north, up m; roll, pitch, heading rad.
"""

import numpy as np
from scipy.signal import lfilter

from data_synth.inertial import smoother_error
from data_synth.motion import wrap
from paperrepro.survey import Navigation, Trajectory

POSITION_SIGMA = np.array([0.02, 0.02, 0.04])  # east, north, up
ATTITUDE_SIGMA = np.radians([0.025, 0.025, 0.08])  # roll, pitch, heading
CORRELATION_TIME = 30.0
#: White part of the records, beyond the specification's sigmas.
WHITE_SIGMA = np.array([0.0015] * 3 + list(np.radians([0.002, 0.002, 0.004])))

#: ``constant``: share of the variance that lasts for the mission.
CONSTANT_SHARE = 0.9
#: ``slow``: correlation times of the components, s.
SLOW_TIMES = np.array([60.0, 60.0, 60.0, 10.0, 10.0, 300.0])
#: ``two-scale``: correlation times, s, and their shares of the variance.
TWO_SCALES = ((300.0, 0.8), (1.0, 0.2))
#: ``steps``: mean time between two, s.
STEP_INTERVAL = 60.0
#: ``outage``: how long GNSS is lost, s, and the sigma of the error in its middle, in the
#: specification's sigmas.
OUTAGE_TIME, OUTAGE_FACTOR = 60.0, 5.0


def apx15(noise_scale: float = 1.0) -> Navigation:
    """The specification, its sigmas times ``noise_scale``."""
    return Navigation(
        "APX-15 UAV", noise_scale * POSITION_SIGMA, noise_scale * ATTITUDE_SIGMA, CORRELATION_TIME
    )


def gauss_markov(count: int, step: float, correlation_time, rng) -> np.ndarray:
    """Six stationary first-order Gauss-Markov processes of unit variance, (count, 6), exact at
    any ``step``; ``correlation_time`` s, one or six."""
    decay = np.exp(-step / np.asarray(correlation_time))
    drive = rng.normal(size=(count, 6))
    drive[1:] *= np.sqrt(1.0 - decay**2)
    if decay.ndim == 0:
        return lfilter([1.0], [1.0, -decay], drive, axis=0)
    return np.column_stack([lfilter([1.0], [1.0, -decay[j]], drive[:, j]) for j in range(6)])


def specified(count: int, step: float, rng) -> np.ndarray:
    """What the specification says: every component has its `CORRELATION_TIME`."""
    return gauss_markov(count, step, CORRELATION_TIME, rng)


def constant(count: int, step: float, rng) -> np.ndarray:
    """Constants of the mission, such as a heading that is off, beside a small rest."""
    lasting = np.sqrt(CONSTANT_SHARE) * rng.normal(size=6)
    return lasting + np.sqrt(1.0 - CONSTANT_SHARE) * specified(count, step, rng)


def slow(count: int, step: float, rng) -> np.ndarray:
    """Each component with a correlation time of its own, `SLOW_TIMES`."""
    return gauss_markov(count, step, SLOW_TIMES, rng)


def two_scale(count: int, step: float, rng) -> np.ndarray:
    """Most of the variance lasts for minutes, the rest for a second."""
    parts = [np.sqrt(share) * gauss_markov(count, step, tau, rng) for tau, share in TWO_SCALES]
    return np.sum(parts, axis=0)


def steps(count: int, step: float, rng) -> np.ndarray:
    """Constant between random moments, at which all components jump to new values."""
    jumps = rng.uniform(size=count) < -np.expm1(-step / STEP_INTERVAL)
    level = np.cumsum(jumps)
    return rng.normal(size=(level[-1] + 1, 6))[level]


def outage(count: int, step: float, rng) -> np.ndarray:
    """The specified process, and in one interval anywhere in the mission an error that grows and
    shrinks as the smoother bridges the gap. Exceeds the specification by nature."""
    error = specified(count, step, rng)
    length = min(count, round(OUTAGE_TIME / step))
    first = rng.integers(count - length + 1)
    bump = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(length) / length)
    error[first : first + length] += OUTAGE_FACTOR * bump[:, None] * rng.normal(size=6)
    return error


#: Processes of unit variance by name.
PROCESSES = {
    "gauss-markov": specified,
    "constant": constant,
    "slow": slow,
    "two-scale": two_scale,
    "steps": steps,
    "outage": outage,
}
#: All that can be chosen.
NAVIGATION = (*PROCESSES, "smoother")


def disturb(
    truth: Trajectory, noise_scale: float, rng: np.random.Generator, kind: str = "gauss-markov"
) -> tuple[Trajectory, Navigation]:
    """The trajectory as the GNSS/INS reports it, and what it says of its errors; scaled, so a seed
    keeps the shape of its error.

    Parameters
    ----------
    truth : the true poses, m-frame, at a constant step.
    noise_scale : factor on the whole error.
    kind : one of `NAVIGATION`.
    """
    told = apx15(noise_scale)
    if kind == "smoother":
        error, *known = smoother_error(truth, rng)
        if noise_scale > 0:
            told = told.with_profile(known[0], noise_scale * known[1])
    else:
        step = float(np.median(np.diff(truth.time)))
        sigma = np.concatenate([POSITION_SIGMA, ATTITUDE_SIGMA])
        error = sigma * PROCESSES[kind](len(truth.time), step, rng)
        error += WHITE_SIGMA * rng.normal(size=error.shape)
    error = noise_scale * error
    attitude = truth.attitude + error[:, 3:]
    attitude[:, 2] = wrap(attitude[:, 2])
    return Trajectory(truth.time, truth.position + error[:, :3], attitude), told
