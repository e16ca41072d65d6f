"""Surveys that several tests look at; kept by the package's own cache between them."""

import pytest

from data_synth import make_config, simulate
from data_synth.evaluation import judge_views
from paperrepro._cache import cached
from paperrepro.method.coarse_to_fine import find_candidates, find_roofs


class Flown:
    """A simulated survey with its roofs found and matched, and what the truth says of them."""

    def __init__(self, **config):
        self.survey, self.truth = cached(simulate, make_config(**config))
        self.points = cached(find_candidates, self.survey)
        self.found = cached(find_roofs, self.survey, self.points)
        self.views = judge_views(self.survey, self.truth, self.found.views)


@pytest.fixture(scope="session")
def flown():
    """Default noise, preset mount."""
    return Flown()


@pytest.fixture(scope="session")
def flown_table4():
    """Default noise, preset table4."""
    return Flown(preset="table4")
