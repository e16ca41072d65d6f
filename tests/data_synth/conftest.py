"""One noisy and one exact survey, shared by all tests here."""

import pytest

from data_synth import make_config, simulate


@pytest.fixture(scope="session")
def noisy():
    """Survey and truth of the default configuration."""
    return simulate(make_config())


@pytest.fixture(scope="session")
def exact():
    """The same farm and flight without any noise; range offsets and boresight stay."""
    return simulate(make_config(noise_scale=0.0, sensor_noise=False, reference_noise=False))
