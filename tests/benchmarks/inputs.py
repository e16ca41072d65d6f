"""What the stages are fed with: one simulated survey in several densities."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from data_synth import simulate
from data_synth.presets import SimulationConfig
from paperrepro.method.coarse_to_fine import Candidates, PlaneSurvey, find_candidates, find_roofs
from paperrepro.method.georeference import georeference
from paperrepro.method.ground import progressive_morphological_filter
from paperrepro.method.outliers import statistical_outliers
from paperrepro.survey import Rays, Survey

#: One in so many firing sequences: the paper's density, a quarter and a sixteenth of it.
EVERY = (1, 4, 16)


@dataclass(frozen=True)
class Density(SimulationConfig):
    """The default survey with one in ``every`` firing sequences."""

    every: int = 16

    @property
    def thinning(self) -> int:
        return self.every


@dataclass(frozen=True)
class Inputs:
    """A ``survey`` and what each stage gets of it, made when it is asked for."""

    every: int
    survey: Survey

    @classmethod
    def of(cls, every: int) -> "Inputs":
        return cls(every, simulate(Density(every=every))[0])

    @cached_property
    def rays(self) -> Rays:
        """Of the first strip."""
        return self.survey.rays(self.survey.strips[0])

    @cached_property
    def cloud(self) -> np.ndarray:
        """(N, 3) m, the first strip under the nominal mounting."""
        return georeference(self.rays, self.survey.mounting)

    @cached_property
    def clean(self) -> np.ndarray:
        """Without outliers."""
        return self.cloud[statistical_outliers(self.cloud)]

    @cached_property
    def objects(self) -> np.ndarray:
        """Without ground: what may lie on a roof."""
        return self.clean[~progressive_morphological_filter(self.clean)]

    @cached_property
    def candidates(self) -> Candidates:
        """Of all strips."""
        return find_candidates(self.survey)

    @cached_property
    def found(self) -> PlaneSurvey:
        """Roofs of all strips, matched."""
        return find_roofs(self.survey, self.candidates)
