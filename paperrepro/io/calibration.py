"""`calibration.json` back to a mounting."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from paperrepro.errors import BadInput
from paperrepro.survey import Mounting

ANGLES = ("omega", "phi", "kappa")


def read_calibration(path: Path, nominal: Mounting, n_rings: int) -> Mounting:
    """``nominal`` with the boresight of the file, its range offsets, one for each of ``n_rings``
    beams, and its lever arm where it names them. Raises `BadInput`."""
    path = Path(path)
    content = _load(path)
    degrees = content.get("boresight_deg")
    if not isinstance(degrees, dict) or any(name not in degrees for name in ANGLES):
        raise BadInput(
            f"{path}: expected boresight_deg with omega, phi and kappa, got {degrees!r}; give the "
            "calibration.json of a calibration"
        )
    boresight = _finite([degrees[name] for name in ANGLES], 3, f"{path}: boresight_deg")
    offsets = content.get("range_offsets_m")
    if offsets is not None:
        offsets = _finite(offsets, n_rings, f"{path}: range_offsets_m")
    mounting = nominal.with_calibration(np.radians(boresight), offsets)
    if content.get("lever_arm_m") is not None:
        lever_arm = _finite(content["lever_arm_m"], 3, f"{path}: lever_arm_m")
        mounting = replace(mounting, lever_arm=lever_arm)
    return mounting


def _load(path: Path) -> dict:
    if not path.is_file():
        raise BadInput(f"{path}: no such file; give the calibration.json of a calibration")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise BadInput(f"{path}: expected JSON, {error}; give a calibration.json") from error
    if not isinstance(content, dict):
        raise BadInput(f"{path}: expected a JSON object; give the calibration.json")
    return content


def _finite(values, count: int, where: str) -> np.ndarray:
    try:
        numbers = np.array(values, float)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise BadInput(f"{where}: expected {count} finite numbers, got {values!r}; calibrate again")
    return numbers
