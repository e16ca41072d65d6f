"""Rigorous calibration of UAV LiDAR: the method, and nothing that knows the truth.

Reproduces Oliveira Junior and Santos, "Rigorous Calibration of UAV-Based LiDAR Systems with
Refinement of the Boresight Angles Using a Point-to-Plane Approach", Sensors 2019.

    import paperrepro as pr

    survey = pr.read_flight(["F1.laz", "F2.laz"], "mission.sbet", "mounting.toml").survey
    pr.calibrate_survey(survey, "D")

The names of `API` are what a user needs; they are imported when first asked for. What lies deeper
is found in the rooms: ``pr.method.outliers.statistical_outliers``.
"""

import importlib

__version__ = "0.2.0"

#: Public names and the modules that they come from. `_cache` reads it, to see through this door.
API = {
    "Survey": "paperrepro.survey",
    "Strip": "paperrepro.survey",
    "Trajectory": "paperrepro.survey",
    "Mounting": "paperrepro.survey",
    "Scanner": "paperrepro.survey",
    "Navigation": "paperrepro.survey",
    "georeference": "paperrepro.method.georeference",
    "find_roofs": "paperrepro.method.coarse_to_fine",
    "find_planes": "paperrepro.method.coarse_to_fine",
    "calibrate": "paperrepro.method.adjustment.calibrate",
    "refine": "paperrepro.method.adjustment.scenarios",
    "calibrate_survey": "paperrepro.method",
    "point_to_plane": "paperrepro.method.accuracy",
    "vertical_offsets": "paperrepro.method.accuracy",
    "read_flight": "paperrepro.flight.read",
    "calibrate_flight": "paperrepro.flight.calibrate",
    "apply_calibration": "paperrepro.flight.write",
    "run_study": "paperrepro.study.workers",
    "run_sweep": "paperrepro.study.workers",
    "reproduce": "paperrepro.paper.reproduce",
    "cached": "paperrepro._cache",
}
_ROOMS = ("errors", "figures", "flight", "frames", "method", "paper", "study", "survey")


def __getattr__(name: str):
    if name in API:
        return getattr(importlib.import_module(API[name]), name)
    if name in _ROOMS:
        return importlib.import_module(f"paperrepro.{name}")
    raise AttributeError(f"paperrepro has no {name!r}; it offers {', '.join(API)}")


def _modules_of(room: str):
    """``__getattr__`` of a room: its modules are imported when first asked for."""

    def module(name: str):
        try:
            return importlib.import_module(f"{room}.{name}")
        except ModuleNotFoundError as error:
            if error.name != f"{room}.{name}":
                raise
            raise AttributeError(f"{room} has no {name!r}") from None

    return module


def __dir__() -> list[str]:
    return [*API, "__version__"]
