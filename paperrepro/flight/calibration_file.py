"""``calibration.json``: what a calibration found, in numbers that another program can read.

`calibration.json` back to a mounting.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from paperrepro import __version__
from paperrepro.errors import BadInput
from paperrepro.flight.calibrate import OwnFlight
from paperrepro.method.accuracy import PairDistances, rmse
from paperrepro.method.adjustment.observability import AXIS_WORDS, Observability
from paperrepro.method.adjustment.result import CalibrationResult
from paperrepro.survey import Mounting

NAME = "calibration.json"
ANGLES = ("omega", "phi", "kappa")


def write(own: OwnFlight, path: Path, **origin) -> None:
    """Write `document` to ``path``; ``origin`` is added as it is."""
    text = json.dumps(document(own) | origin, indent=2, ensure_ascii=False, allow_nan=False)
    Path(path).write_text(text + "\n", encoding="utf-8", newline="\n")


def document(own: OwnFlight) -> dict:
    """Angles and their sigma in degrees, the rest in metres; plain numbers, lists and words."""
    result, to_deg = own.result, np.degrees(1.0)
    offsets, sigma = result.range_offsets, result.sigma_offsets
    return {
        "paperrepro": __version__,
        "scenario": result.scenario,
        "planes": own.planes,
        "boresight_deg": _by_angle(result.boresight),
        "sigma_deg": _by_angle(result.sigma),
        "covariance_deg2": (result.covariance[:3, :3] * to_deg**2).tolist(),
        "range_offsets_m": None if offsets is None else offsets.tolist(),
        "sigma_range_offsets_m": None if sigma is None else _own_offsets(sigma, offsets),
        "lever_arm_m": np.asarray(result.calibrated.lever_arm, float).tolist(),
        "sigma0": result.sigma0,
        "n_planes": result.n_planes,
        "n_points": result.n_points,
        "n_rejected": len(own.rejected),
        "rmse_before_m": result.rmse_before,
        "rmse_after_m": result.rmse_after,
        "iterations": result.iterations,
        "observability": _observability(result.observability),
        "noise_factors": result.components,
        "strip_pairs": [_pair(pair) for pair in own.distances],
        "rejected": [_rejected(face) for face in own.rejected],
        "remarks": list(own.remarks),
    }


def _by_angle(values_rad: np.ndarray) -> dict[str, float]:
    return dict(zip(ANGLES, np.degrees(values_rad[:3]).tolist(), strict=True))


def _own_offsets(sigma: np.ndarray, offsets: np.ndarray) -> list[float]:
    return sigma[: len(offsets)].tolist()


def _observability(seen: Observability) -> dict:
    lasting = seen.lasting_sigma
    return {
        "rank": seen.rank,
        "condition": seen.condition,
        "weakest_direction": seen.weakest_word,
        "weakest": dict(zip(AXIS_WORDS, np.asarray(seen.weakest).tolist(), strict=True)),
        "undetermined": list(seen.undetermined),
        "lasting_sigma_deg": None if lasting is None else _by_angle(lasting),
        "range_offsets_determined": seen.offsets_determined,
        "words": str(seen),
    }


def _pair(pair: PairDistances) -> dict:
    return {
        "first": pair.first,
        "second": pair.second,
        "overlap": pair.overlap,
        "n_points": len(pair.before),
        "rms_before_m": rmse(pair.before),
        "rms_after_m": rmse(pair.after),
        "median_before_m": float(np.median(np.abs(pair.before))),
        "median_after_m": float(np.median(np.abs(pair.after))),
    }


def _rejected(face) -> dict:
    return {
        "strip": face.strip,
        "plane": int(face.plane),
        "centroid_m": np.asarray(face.centroid, float).tolist(),
        "misfit_m": face.misfit_m,
        "limit_m": face.limit_m,
    }


def summary(result: CalibrationResult) -> list[str]:
    """Lines for a terminal: the angles with their sigma, the fit, what is weak."""
    angles = [
        f"  {name:5s} {np.degrees(value):+9.4f}° ± {np.degrees(sigma):.4f}°  ({axis})"
        for name, value, sigma, axis in zip(
            ANGLES, result.boresight, result.sigma, AXIS_WORDS, strict=True
        )
    ]
    fit = (
        f"  {result.n_planes} planes, {result.n_points} points, sigma0 {result.sigma0:.2f}, "
        f"RMSE {100 * result.rmse_before:.1f} cm before, {100 * result.rmse_after:.1f} cm after"
    )
    return [f"scenario {result.scenario}", *angles, fit, f"  {result.observability}"]


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
