"""The error of the post-processed GNSS/INS, an Applanix APX-15 UAV.

Each of the six components is a first-order Gauss-Markov process over the whole mission, plus a
small white part. Metres and radians.
"""

import numpy as np
from scipy.signal import lfilter

from data_synth.motion import wrap
from paperrepro.survey import Navigation, Trajectory

POSITION_SIGMA = np.array([0.02, 0.02, 0.04])  # east, north, up
ATTITUDE_SIGMA = np.radians([0.025, 0.025, 0.08])  # roll, pitch, heading
CORRELATION_TIME = 30.0
#: White part of the records, beyond the specification's sigmas.
WHITE_SIGMA = np.array([0.0015] * 3 + list(np.radians([0.002, 0.002, 0.004])))


def apx15(noise_scale: float = 1.0) -> Navigation:
    """The specification, its sigmas times ``noise_scale``."""
    return Navigation(
        "APX-15 UAV", noise_scale * POSITION_SIGMA, noise_scale * ATTITUDE_SIGMA, CORRELATION_TIME
    )


def gauss_markov(count: int, step: float, correlation_time: float, rng) -> np.ndarray:
    """Six stationary first-order Gauss-Markov processes of unit variance, (count, 6), exact at
    any ``step``."""
    decay = np.exp(-step / correlation_time)
    drive = rng.normal(size=(count, 6))
    drive[1:] *= np.sqrt(1.0 - decay**2)
    return lfilter([1.0], [1.0, -decay], drive, axis=0)


def disturb(truth: Trajectory, noise_scale: float, rng: np.random.Generator) -> Trajectory:
    """The trajectory as the GNSS/INS reports it; scaled, so a seed keeps the shape of its error."""
    step = float(np.median(np.diff(truth.time)))
    sigma = np.concatenate([POSITION_SIGMA, ATTITUDE_SIGMA])
    error = sigma * gauss_markov(len(truth.time), step, CORRELATION_TIME, rng)
    error += WHITE_SIGMA * rng.normal(size=error.shape)
    error *= noise_scale
    attitude = truth.attitude + error[:, 3:]
    attitude[:, 2] = wrap(attitude[:, 2])
    return Trajectory(truth.time, truth.position + error[:, :3], attitude)
