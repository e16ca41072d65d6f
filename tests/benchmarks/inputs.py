"""What the stages are fed with: one simulated survey in several densities."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from data_synth.presets import SimulationConfig
from paperrepro.method.georeference import georeference
from paperrepro.method.ground import progressive_morphological_filter
from paperrepro.method.outliers import statistical_outliers
from paperrepro.study.simulated import SimulatedSurvey
from paperrepro.survey import Rays

#: One in so many firing sequences: the paper's density, a quarter and a sixteenth of it.
EVERY = (1, 4, 16)


@dataclass(frozen=True)
class Density(SimulationConfig):
    """The default survey with one in ``every`` firing sequences."""

    every: int = 16

    @property
    def thinning(self) -> int:
        return self.every


class Inputs(SimulatedSurvey):
    """A survey and what each stage gets of it, made when it is asked for."""

    @classmethod
    def of(cls, every: int) -> "Inputs":
        return cls(Density(every=every))

    @property
    def every(self) -> int:
        return self.config.every

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
