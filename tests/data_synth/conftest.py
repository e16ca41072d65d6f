"""One noisy and one exact survey, shared by all tests here."""

import pytest

from data_synth import PROFILES, make_config, simulate


@pytest.fixture(scope="session")
def noisy():
    """Survey and truth of the default configuration."""
    return simulate(make_config())


@pytest.fixture(scope="session")
def exact():
    """The same farm and flight without any noise; range offsets and boresight stay."""
    return simulate(make_config(noise_scale=0.0, sensor_noise=False, reference_noise=False))


@pytest.fixture(scope="session")
def thin():
    """A function: the survey and truth of a configuration with few pulses and no noise, unless
    asked for."""
    silent = {"noise_scale": 0.0, "sensor_noise": False, "reference_noise": False}

    def simulated(**parameters):
        with pytest.MonkeyPatch.context() as patch:
            patch.setitem(PROFILES, "thin", 160)
            return simulate(make_config(profile="thin", **(silent | parameters)))

    return simulated


@pytest.fixture(scope="session")
def plain(thin):
    """`thin` with nothing off."""
    return thin()
