"""Surveys that several tests look at; kept by the package's own cache between them."""

import pytest

from data_synth import make_config
from paperrepro.study.simulated import SimulatedSurvey


@pytest.fixture(scope="session")
def flown():
    """Default noise, preset mount."""
    return SimulatedSurvey(make_config(), kept=True)


@pytest.fixture(scope="session")
def flown_table4():
    """Default noise, preset table4."""
    return SimulatedSurvey(make_config("table4"), kept=True)
