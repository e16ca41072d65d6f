"""``calibration.json``: what a calibration found, in numbers that another program can read, and
back to a mounting, if the numbers can be one and belong to this scanner."""

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from paperrepro import __version__
from paperrepro._files import write_text
from paperrepro.errors import BadInput
from paperrepro.flight.calibrate import OwnFlight
from paperrepro.flight.mounting import numbers_in, short
from paperrepro.frames import ANGLES, AXIS_WORDS
from paperrepro.method.accuracy import PairDistances, rmse
from paperrepro.method.adjustment.model_checks import Check
from paperrepro.method.adjustment.observability import Observability
from paperrepro.method.adjustment.quality import Reliability
from paperrepro.method.adjustment.trajectory_equations import Beams
from paperrepro.method.control import CheckedHeights
from paperrepro.survey import Mounting, Scanner

NAME = "calibration.json"
#: Nothing of a calibration is larger.
LARGEST = {
    "beams_deg": 5.0,
    "boresight_deg": 15.0,
    "range_offsets_m": 1.0,
    "lever_arm_m": 10.0,
    "sigma_deg": 5.0,
}
#: An adjusted lever arm is this near to the nominal one, m.
LEVER_ARM_MOVES = 1.0
#: Nominal rotations and lever arms, and beams (deg), that are the same.
SAME, SAME_BEAM_DEG = 1e-6, 0.5
REMEDY = "give the calibration.json of a calibration of this scanner and mounting"


def write(own: OwnFlight, path: Path, **origin) -> None:
    """Write `document` to ``path``; ``origin`` is added as it is."""
    text = json.dumps(document(own) | origin, indent=2, ensure_ascii=False, allow_nan=False)
    write_text(path, text + "\n")


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
        "sigma_range_offsets_m": None if sigma is None else sigma[: len(offsets)].tolist(),
        "lever_arm_m": np.asarray(result.calibrated.lever_arm, float).tolist(),
        "nominal": {
            "rotation": own.survey.mounting.R_nominal.tolist(),
            "lever_arm_m": np.asarray(own.survey.mounting.lever_arm, float).tolist(),
        },
        "scanner": {
            "name": own.survey.scanner.name,
            "beam_elevations_deg": np.degrees(own.survey.scanner.beam_elevations).tolist(),
        },
        "sigma0": result.sigma0,
        "n_planes": result.n_planes,
        "n_points": result.n_points,
        "n_rejected": len(own.rejected),
        "rmse_before_m": result.rmse_before,
        "rmse_after_m": result.rmse_after,
        "iterations": result.iterations,
        "observability": _observability(result.observability),
        "reliability": None if result.reliability is None else _reliability(result.reliability),
        "noise_factors": result.components,
        "strip_pairs": [_pair(pair) for pair in own.distances],
        "rejected": [_rejected(face) for face in own.rejected],
        "clock": None if result.clock is None else vars(result.clock).copy(),
        "trajectory": None,
        "beams": None if result.beams is None else _beams(result.beams),
        "checks": [_check(check) for check in own.checks],
        "checkpoints": None if own.checkpoints is None else _checkpoints(own.checkpoints),
        "remarks": list(own.remarks),
    }


def _beams(beams: Beams) -> dict:
    names = ("elevation_deg", "azimuth_deg")
    values = dict(zip(names, np.degrees(beams.errors).T.tolist(), strict=True))
    sigma = zip(names, np.degrees(beams.sigma).T.tolist(), strict=True)
    return values | {f"sigma_{name}": column for name, column in sigma}


def _by_angle(values_rad: np.ndarray) -> dict[str, float]:
    return dict(zip(ANGLES, np.degrees(values_rad[:3]).tolist(), strict=True))


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


def _reliability(found: Reliability) -> dict:
    """Of each view, in the order of the tie planes: what could hide in it, and what that does."""
    columns = zip(found.strip, found.plane, found.redundancy, found.detectable, found.turns,
                  found.bias, found.standardised, strict=True)  # fmt: skip
    views = [
        {
            "strip": strip, "plane": int(plane), "redundancy": float(redundancy),
            "detectable_m": float(detectable), "turns_deg": _by_angle(turns),
            "bias_m": float(bias), "standardised": float(standardised),
        }
        for strip, plane, redundancy, detectable, turns, bias, standardised in columns
    ]  # fmt: skip
    return {
        "views": views,
        "least_redundancy": float(found.redundancy.min()),
        "largest_detectable_m": float(found.detectable.max()),
        "largest_turns_deg": _by_angle(np.abs(found.turns).max(axis=0)),
    }


def _pair(pair: PairDistances) -> dict:
    return {
        "first": pair.first,
        "second": pair.second,
        "overlap": pair.overlap,
        "n_points": len(pair.before),
        "rms_before_m": rmse(pair.before),
        "rms_after_m": rmse(pair.after),
        "rms_adjusted_m": None if pair.adjusted is None else rmse(pair.adjusted),
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


def _check(check: Check) -> dict:
    limits = {"low": check.low, "high": None if np.isinf(check.high) else check.high}
    sentence = None if check.passed else check.sentence
    passed = {"passed": check.passed, "sentence": sentence}
    return {"name": check.name, "value": check.value} | limits | passed


def _checkpoints(checked: CheckedHeights) -> dict:
    """Cloud minus point, m, before, after the mounting, and after the trajectory; null where a
    point is off the strips or on uneven ground."""
    found = {cloud: checked.accuracy(cloud) for cloud in checked.offsets}
    points = [
        {"name": name, "sigma_m": float(checked.points.sigma[k])}
        | {
            f"{cloud}_m": float(offset[k]) if np.isfinite(offset[k]) else None
            for cloud, offset in checked.offsets.items()
        }
        for k, name in enumerate(checked.points.names)
    ]
    return {
        cloud: one and {"n": one.n, "mean_m": one.mean, "rmse_m": one.rmse, "at_95_m": one.at_95}
        for cloud, one in found.items()
    } | {"off_strips": list(checked.off), "uneven": list(checked.uneven), "points": points}


@dataclass(frozen=True)
class Calibration:
    """A file's ``mounting``, the adjusted ``trajectory`` that it names, and ``notes`` on what it
    says of itself, a sentence each."""

    mounting: Mounting
    trajectory: Path | None = None
    notes: tuple[str, ...] = ()


def read_calibration(path: Path, nominal: Mounting, scanner: Scanner | None = None) -> Calibration:
    """``nominal`` with the boresight of the file, its range offsets, one for each beam of
    ``scanner``, and its lever arm where it names them.

    Raises `BadInput` for numbers that no calibration has, another version, and a calibration of
    another mounting or, where it is given, another scanner.
    """
    path = Path(path)
    content = _load(path)
    _require_version(content.get("paperrepro"), path)
    boresight = _by_name(content, "boresight_deg", path)
    if content.get("sigma_deg") is not None and (_by_name(content, "sigma_deg", path) <= 0).any():
        raise BadInput(f"{path}: sigma_deg: expected numbers above 0; {REMEDY}")
    offsets = content.get("range_offsets_m")
    if offsets is not None:
        offsets = _numbers(content, "range_offsets_m", scanner and scanner.n_rings, path)
    beams = _read_beams(content, scanner and scanner.n_rings, path)
    mounting = nominal.with_calibration(np.radians(boresight), offsets)
    mounting = replace(mounting, beam_offsets=beams)
    if content.get("lever_arm_m") is not None:
        lever_arm = _numbers(content, "lever_arm_m", 3, path)
        moved = float(np.linalg.norm(lever_arm - nominal.lever_arm))
        if moved > LEVER_ARM_MOVES:
            raise BadInput(
                f"{path}: lever_arm_m lies {moved:.2f} m from that of the mounting: it is of "
                f"another one; {REMEDY}"
            )
        mounting = replace(mounting, lever_arm=lever_arm)
    _require_same(content, nominal, scanner, path)
    notes = []
    seen = content.get("observability")
    unseen = seen.get("undetermined") if isinstance(seen, dict) else None
    if isinstance(unseen, list) and unseen:
        angles = ", ".join(map(str, unseen))
        notes.append(f"{path}: says of itself that its flight did not determine {angles}")
    named = _optional(content, "trajectory", "sbet")
    if not isinstance(named, str | None):
        raise BadInput(f"{path}: trajectory: expected the name of an SBET, got {short(named)}; "
                       f"{REMEDY}")  # fmt: skip
    return Calibration(mounting, path.parent / Path(named).name if named else None, tuple(notes))


def _load(path: Path) -> dict:
    if not path.is_file():
        raise BadInput(f"{path}: no such file; {REMEDY}")
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:
        why = str(error).splitlines()[0]
        raise BadInput(f"{path}: expected JSON, {why}; {REMEDY}") from error
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror}); mend that") from error
    if not isinstance(content, dict):
        raise BadInput(f"{path}: expected a JSON object; {REMEDY}")
    return content


def _require_version(version, path: Path) -> None:
    """None, or one whose file this version understands."""
    if version is None:
        return
    written = re.match(r"(\d{1,6})\.(\d{1,6})", version) if isinstance(version, str) else None
    ours = re.match(r"(\d+)\.(\d+)", __version__)
    if written is None or tuple(map(int, written.groups())) > tuple(map(int, ours.groups())):
        raise BadInput(
            f"{path}: expected a file of paperrepro up to {__version__}, got {short(version)}; "
            "calibrate with this version, or apply with the newer one"
        )


def _read_beams(content: dict, n_rings: int | None, path: Path) -> np.ndarray | None:
    """(rings, 2) rad, where the file names them."""
    named = content.get("beams")
    if named is None:
        return None
    columns = [_optional(content, "beams", f"{name}_deg") for name in ("elevation", "azimuth")]
    columns = [_numbers({"beams_deg": column}, "beams_deg", n_rings, path) for column in columns]
    if len(columns[0]) != len(columns[1]):
        raise BadInput(f"{path}: beams: expected as many elevations as azimuths; {REMEDY}")
    return np.radians(np.column_stack(columns))


def _by_name(content: dict, key: str, path: Path) -> np.ndarray:
    """(3,) of an entry by angle."""
    named = content.get(key)
    if not isinstance(named, dict) or any(name not in named for name in ANGLES):
        raise BadInput(
            f"{path}: expected {key} with omega, phi and kappa, got {short(named)}; {REMEDY}"
        )
    return _numbers({key: [named[name] for name in ANGLES]}, key, 3, path)


def _numbers(content: dict, key: str, count: int | None, path: Path) -> np.ndarray:
    """So many numbers, within reason."""
    values = content[key]
    numbers = numbers_in(values)
    right = numbers.size == count if count else numbers.size > 0
    if not right or numbers.ndim != 1 or not np.isfinite(numbers).all():
        raise BadInput(
            f"{path}: {key}: expected {count or 'some'} finite numbers, got {short(values)}; "
            f"{REMEDY}"
        )
    if np.abs(numbers).max() > LARGEST[key]:
        raise BadInput(
            f"{path}: {key}: expected numbers up to {LARGEST[key]:g}, got "
            f"{numbers[np.abs(numbers).argmax()]:g}; {REMEDY}"
        )
    return numbers


def _require_same(content: dict, nominal: Mounting, scanner: Scanner | None, path: Path) -> None:
    """Mounting and scanner of the calibration, where it names them, are those of the strips."""
    for name, expected in (("rotation", nominal.R_nominal), ("lever_arm_m", nominal.lever_arm)):
        found = _optional(content, "nominal", name)
        if found is not None and not _alike(found, expected, SAME):
            raise BadInput(
                f"{path}: nominal {name} is not that of the mounting given: it was calibrated with "
                f"another one; {REMEDY}"
            )
    found = _optional(content, "scanner", "beam_elevations_deg")
    if scanner is None or found is None:
        return
    if not _alike(found, np.degrees(scanner.beam_elevations), SAME_BEAM_DEG):
        raise BadInput(
            f"{path}: its scanner ({short(content['scanner'].get('name'))}) has other beams than "
            f"that of the strips ({scanner.name}); {REMEDY}"
        )


def _optional(content: dict, table: str, key: str):
    found = content.get(table)
    return found.get(key) if isinstance(found, dict) else None


def _alike(found, expected, tolerance: float) -> bool:
    found = numbers_in(found)
    return found.shape == np.shape(expected) and bool((np.abs(found - expected) <= tolerance).all())
