"""The simulated farm and its flight: everything that knows the truth.

``survey, truth = simulate(make_config(preset="mount", profile="quick", seed=1))``
"""

from data_synth.flight import FlightPlan, PlannedLine, covering
from data_synth.presets import PRESETS, PROFILES, SimulationConfig, make_config
from data_synth.scene import ObjectClass, RoofFace, Scene
from data_synth.simulation import Truth, simulate

__all__ = [
    "PRESETS",
    "PROFILES",
    "FlightPlan",
    "ObjectClass",
    "PlannedLine",
    "RoofFace",
    "Scene",
    "SimulationConfig",
    "Truth",
    "covering",
    "make_config",
    "simulate",
]
