"""Strips under another mounting: every point moved by Eq. (1), every other dimension untouched.

A point is taken back to the laser under the nominal mounting, as when it was read, with its own
elevation and not the beam table's. So the nominal mounting gives the file's own coordinates back,
to the last digit.
"""

from pathlib import Path

import laspy
import numpy as np

from paperrepro._files import written_whole
from paperrepro.errors import BadInput
from paperrepro.flight import ray_test
from paperrepro.flight.decoding import UNKNOWN_RING, UP
from paperrepro.flight.las import StripFile, opened
from paperrepro.flight.read import Flight
from paperrepro.method.georeference import georeference
from paperrepro.survey import Mounting, Rays


def adjust_strips(flight: Flight, mounting: Mounting, out: Path) -> list[Path]:
    """Write the flight's files anew into folder ``out``, under ``mounting``: all of them, or none.

    The names stay; range offsets go by beam of `Scanner.beam_elevations`. Raises `BadInput` where
    ``out`` is the folder of the originals.
    """
    out = Path(out)
    for file in flight.files:
        if not isinstance(file, StripFile):
            raise BadInput(f"{file.path}: only LAS and LAZ can be written; give the strip as one")
        if (out / file.path.name).exists() and file.path.samefile(out / file.path.name):
            raise BadInput(f"{file.path}: would be overwritten; choose another folder than {out}")
    with written_whole(out) as folder:
        for file in flight.files:
            _adjust_file(flight, file, mounting, folder / file.path.name)
    return [out / file.path.name for file in flight.files]


def _adjust_file(flight: Flight, file: StripFile, mounting: Mounting, target: Path) -> None:
    with opened(file.path) as reader:
        header, evlrs = reader.header, reader.evlrs
        with laspy.open(target, mode="w", header=header) as writer:
            for chunk in file.chunks():
                moved = adjusted_points(flight, file, chunk, mounting)
                chunk.x, chunk.y, chunk.z = file.grid.from_geodetic(
                    *flight.frame.to_geodetic(moved)
                ).T
                writer.write_points(chunk)
            if evlrs:
                writer.write_evlrs(evlrs)


def adjusted_points(flight: Flight, file: StripFile, chunk, mounting: Mounting) -> np.ndarray:
    """(N, 3) m, m-frame of the flight (heights as in the file) of all records of ``chunk``."""
    decoder, records = flight.decoder, file.decoded(chunk)
    _, p_m, pose = decoder.locate(file, records)
    azimuth, elevation, rho = ray_test.laser_rays(pose, p_m, decoder.mounting)
    ring = decoder.beams(file, records.ring)
    n_rings = flight.survey.scanner.n_rings
    offsets = np.zeros(UNKNOWN_RING + 1)
    offsets[:n_rings] = mounting.offsets(n_rings)[:n_rings]
    seen = Rays(pose, ring, azimuth, elevation, rho)
    moved = georeference(seen, mounting.with_calibration(mounting.boresight, offsets))
    return moved - decoder.height_shift * UP
