"""The stages, each timed beside its peers on the same input."""

from collections.abc import Iterator

import numpy as np

from data_synth import simulate
from paperrepro.adjustment.refinement import refine
from paperrepro.adjustment.scenarios import SCENARIOS, calibrate
from paperrepro.georeference import georeference
from paperrepro.matching import MatchParameters, match
from paperrepro.segmentation.ground import progressive_morphological_filter
from paperrepro.segmentation.outliers import statistical_outliers
from paperrepro.segmentation.planes import grow_regions, neighbourhood
from paperrepro.segmentation.roofs import RoofParameters, extract
from tests.benchmarks import flight_time, least_squares, peers
from tests.benchmarks.clock import Row, row, timed
from tests.benchmarks.inputs import Density, Inputs


def simulation(every: int) -> Row:
    """The whole survey, noise and all."""
    ours = timed(simulate, Density(every=every))
    return row("simulate", every, sum(map(len, ours.result[0].strips)), ours)


def georeferencing(inputs: Inputs) -> Iterator[Row]:
    """Eq. (1) of one strip, beside a copy of its input and output, and NumPy."""
    rays, mounting = inputs.rays, inputs.survey.mounting
    ours = timed(georeference, rays, mounting)
    copied = timed(peers.copy, *peers.columns(rays), ours.result)
    given = "georeference", inputs.every, len(rays), ours
    yield row(*given, peer="memory copy", peer_seconds=copied.seconds)
    plain = timed(peers.lidar_equation, rays, mounting)
    away = float(np.abs(plain.result - ours.result).max())
    yield row(*given, peer="NumPy", peer_seconds=plain.seconds, measure="greatest difference, m",
              agreement=away)  # fmt: skip


def outlier_removal(inputs: Inputs) -> Row:
    """Beside Open3D with the same neighbours and threshold."""
    ours = timed(statistical_outliers, inputs.cloud)
    cloud = peers.as_cloud(inputs.cloud)
    theirs = timed(peers.outliers, cloud, len(inputs.cloud))
    alike = peers.jaccard(~ours.result, ~theirs.result)
    given = "outliers", inputs.every, len(inputs.cloud), ours
    return row(*given, peer="Open3D", peer_seconds=theirs.seconds,
               measure="Jaccard of the removed", agreement=alike)  # fmt: skip


def ground_filter(inputs: Inputs) -> Row:
    """Beside a copy of the points."""
    ours = timed(progressive_morphological_filter, inputs.clean)
    copied = timed(peers.copy, inputs.clean, ours.result)
    return row("ground", inputs.every, len(inputs.clean), ours, peer="memory copy",
               peer_seconds=copied.seconds)  # fmt: skip


def plane_growing(inputs: Inputs) -> Row:
    """Normals and region growing on all that the ground filter leaves, not thinned, beside normals
    and planar patches by Open3D."""
    params = RoofParameters.fine().growing
    group = np.zeros(len(inputs.objects), dtype=int)

    def grown():
        around = neighbourhood(inputs.objects, params.neighbours, params.max_gap_m)
        return grow_regions(around, group, params)

    ours, cloud = timed(grown), peers.as_cloud(inputs.objects)
    theirs = timed(peers.planes, cloud)
    return row("normals and growing", inputs.every, len(inputs.objects), ours, peer="Open3D",
               peer_seconds=theirs.seconds)  # fmt: skip


def roofs(inputs: Inputs) -> Iterator[Row]:
    """The chain from the points of one strip that may lie on a roof, and the matching of all."""
    ours = timed(lambda: extract(inputs.objects, RoofParameters.fine(), np.random.default_rng(0)))
    yield row("roofs", inputs.every, len(inputs.objects), ours)
    found = inputs.found
    ours = timed(match, found.roofs, MatchParameters.fine())
    yield row("matching", inputs.every, len(found.matched.rays), ours)


def adjustments(inputs: Inputs, with_peers: bool) -> Iterator[Row]:
    """SL, A, B, C and the refinement on all roof points; beside SciPy where it has the time."""
    survey, matched = inputs.survey, inputs.found.matched
    for name in SCENARIOS:
        ours = timed(calibrate, survey, matched, name)
        peer = {}
        if with_peers:
            result = ours.result
            offsets = () if result.range_offsets is None else result.range_offsets
            x = np.r_[result.boresight, offsets]
            theirs = timed(least_squares.solve, survey, matched, name, x)
            away = float(np.abs(theirs.result.x[:3] - result.boresight).max())
            peer = {"peer": "SciPy", "peer_seconds": theirs.seconds, "agreement": away,
                    "measure": "greatest difference, rad"}  # fmt: skip
        yield row(name, inputs.every, len(matched.rays), ours, **peer)
    mounting = survey.mounting.with_calibration(ours.result.boresight, ours.result.range_offsets)
    ours = timed(refine, survey, matched, mounting)
    yield row("refinement", inputs.every, len(matched.rays), ours)


def longer_flights(inputs: Inputs) -> Iterator[Row]:
    """Scenario D on the same flight once, twice and four times over."""
    near = calibrate(inputs.survey, inputs.found.matched, "SL").boresight
    for times in (1, 2, 4):
        survey, matched = flight_time.repeated(inputs.survey, inputs.found.matched, times)
        ours = timed(flight_time.solve, survey, matched, near)
        yield row(f"D, {times} x", inputs.every, len(matched.rays), ours)
