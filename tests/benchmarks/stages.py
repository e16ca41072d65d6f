"""The stages, each timed beside its peers on the same input."""

from collections.abc import Iterator

import numpy as np

from data_synth import simulate
from paperrepro.method.adjustment.scenarios import SCENARIOS, calibrate, refine
from paperrepro.method.georeference import georeference
from paperrepro.method.ground import progressive_morphological_filter
from paperrepro.method.matching import MatchParameters, match
from paperrepro.method.outliers import statistical_outliers
from paperrepro.method.planes import grow_regions, neighbourhood
from paperrepro.method.roofs import RoofParameters, extract
from tests.benchmarks import flight_time, least_squares, peers
from tests.benchmarks.clock import Row, row, timed
from tests.benchmarks.inputs import Density, Inputs


def simulation(every: int) -> Row:
    """The whole survey, noise and all."""
    (ours,) = timed(lambda: simulate(Density(every=every)))
    return row("simulate", every, sum(map(len, ours.result[0].strips)), ours)


def georeferencing(inputs: Inputs) -> Iterator[Row]:
    """Eq. (1) of one strip, beside a copy of its input and output, and NumPy."""
    rays, mounting = inputs.rays, inputs.survey.mounting
    p_m = georeference(rays, mounting)
    ours, copied, plain = timed(
        lambda: georeference(rays, mounting),
        lambda: peers.copy(*peers.columns(rays), p_m),
        lambda: peers.lidar_equation(rays, mounting),
    )
    given = "georeference", inputs.every, len(rays), ours
    yield row(*given, "memory copy", copied)
    away = float(np.abs(plain.result - ours.result).max())
    yield row(*given, "NumPy", plain, "greatest difference, m", away)


def outlier_removal(inputs: Inputs) -> Row:
    """Beside Open3D with the same neighbours and threshold."""
    cloud = peers.as_cloud(inputs.cloud)
    ours, theirs = timed(
        lambda: statistical_outliers(inputs.cloud),
        lambda: peers.outliers(cloud, len(inputs.cloud)),
    )
    alike = peers.jaccard(~ours.result, ~theirs.result)
    given = "outliers", inputs.every, len(inputs.cloud), ours
    return row(*given, "Open3D", theirs, "Jaccard of the removed", alike)


def ground_filter(inputs: Inputs) -> Row:
    """Beside a copy of the points."""
    ground = progressive_morphological_filter(inputs.clean)
    ours, copied = timed(
        lambda: progressive_morphological_filter(inputs.clean),
        lambda: peers.copy(inputs.clean, ground),
    )
    return row("ground", inputs.every, len(inputs.clean), ours, "memory copy", copied)


def plane_growing(inputs: Inputs) -> Row:
    """Normals and region growing on all that the ground filter leaves, not thinned, beside normals
    and planar patches by Open3D."""
    params = RoofParameters().growing
    group = np.zeros(len(inputs.objects), dtype=int)

    def grown():
        around = neighbourhood(inputs.objects, params.neighbours, params.max_gap_m)
        return grow_regions(around, group, params)

    cloud = peers.as_cloud(inputs.objects)
    ours, theirs = timed(grown, lambda: peers.planes(cloud))
    given = "normals and growing", inputs.every, len(inputs.objects), ours
    return row(*given, "Open3D", theirs)


def roofs(inputs: Inputs) -> Iterator[Row]:
    """The chain from the points of one strip that may lie on a roof, and the matching of all."""
    params = RoofParameters()
    (ours,) = timed(lambda: extract(inputs.objects, params, np.random.default_rng(0)))
    yield row("roofs", inputs.every, len(inputs.objects), ours)
    found = inputs.found
    (ours,) = timed(lambda: match(found.surfaces, MatchParameters.fine()))
    yield row("matching", inputs.every, len(found.tie_planes.rays), ours)


def adjustments(inputs: Inputs, with_peers: bool) -> Iterator[Row]:
    """SL, A, B, C and the refinement on all roof points; beside SciPy where it has the time."""
    survey, tie_planes = inputs.survey, inputs.found.tie_planes
    for name in SCENARIOS:
        result = calibrate(survey, tie_planes, name)
        offsets = () if result.range_offsets is None else result.range_offsets
        x = np.r_[result.boresight, offsets]
        calls = [
            lambda name=name: calibrate(survey, tie_planes, name),
            lambda name=name, x=x: least_squares.solve(survey, tie_planes, name, x),
        ]
        ours, *theirs = timed(*calls[: 1 + with_peers])
        peer = ()
        if with_peers:
            away = float(np.abs(theirs[0].result.x[:3] - result.boresight).max())
            peer = "SciPy", theirs[0], "greatest difference, rad", away
        yield row(name, inputs.every, len(tie_planes.rays), ours, *peer)
    mounting = survey.mounting.with_calibration(result.boresight, result.range_offsets)
    (ours,) = timed(lambda: refine(survey, tie_planes, mounting))
    yield row("refinement", inputs.every, len(tie_planes.rays), ours)


def longer_flights(inputs: Inputs) -> Iterator[Row]:
    """Scenario D on the same flight once, twice and four times over."""
    near = calibrate(inputs.survey, inputs.found.tie_planes, "SL").boresight
    for times in (1, 2, 4):
        longer = flight_time.repeated(inputs.survey, inputs.found.tie_planes, times)
        (ours,) = timed(lambda longer=longer: flight_time.solve(*longer, near))
        yield row(f"D, {times} x", inputs.every, len(longer[1].rays), ours)
