"""Gable roofs of one strip: the chain of section 2.2.2, with the parameters of Table 2.

candidates: statistical outlier removal -> progressive morphological filter (non-ground)
extract:    thin -> objects -> RANSAC -> region growing -> PCA planes -> faces -> gables
"""

from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from paperrepro.boxes import cells
from paperrepro.segmentation.faces import AssignmentParameters, Face, assign
from paperrepro.segmentation.gables import Gable, GableParameters, find_gables
from paperrepro.segmentation.ground import GroundParameters, progressive_morphological_filter
from paperrepro.segmentation.outliers import OutlierParameters, statistical_outliers
from paperrepro.segmentation.planes import (
    GrowingParameters,
    Neighbourhood,
    grow_regions,
    neighbourhood,
)
from paperrepro.segmentation.ransac import RansacParameters, ransac_planes
from paperrepro.segmentation.voxels import Thinned, thin


@dataclass(frozen=True)
class RoofParameters:
    """Parameters of the chain; each part says where it departs from Table 2, and why.

    ``cell_m`` thins the cloud on which planes are grown: at 0.5 m the 40 points that Table 2 asks
    of a segment are about 9 m² of roof.
    """

    cell_m: float = 0.5
    outliers: OutlierParameters = field(default_factory=OutlierParameters)
    ground: GroundParameters = field(default_factory=GroundParameters)
    ransac: RansacParameters = field(default_factory=RansacParameters)
    growing: GrowingParameters = field(default_factory=GrowingParameters)
    assignment: AssignmentParameters = field(default_factory=AssignmentParameters)
    gable: GableParameters = field(default_factory=GableParameters)

    @classmethod
    def fine(cls) -> "RoofParameters":
        """For points under a boresight that is right to about 0.2 degrees: Table 2."""
        return cls()

    @classmethod
    def coarse(cls) -> "RoofParameters":
        """For the central beams (within 3.5 deg) under a boresight wrong by up to 3 degrees.

        At 30 m these beams meet the roof up to 1.8 m ahead and behind; 3 degrees in pitch move
        them apart by 9 cm either way, 18 cm at the 60 m of the swath's edge. Hence tolerances of
        25 cm, and 8 degrees between local normals that come from such points. 3 degrees in roll
        tilt the ridge by as much and so turn the slope directions of a roof of 15 degrees by
        3 / tan 15 = 11 degrees, each its own way.
        """
        return cls(
            ransac=RansacParameters(tolerance_m=0.25, normal_deg=30.0),
            growing=GrowingParameters(angle_deg=8.0, residual_m=0.25),
            assignment=AssignmentParameters(ceiling_m=0.30),
            gable=GableParameters(azimuth_deg=30.0, ridge_slope_deg=8.0),
        )


@dataclass(frozen=True)
class Roofs:
    """What was found in one strip: ``faces``, and ``gables`` that name faces by their number.
    Faces' points index the array handed to `extract`."""

    faces: tuple[Face, ...]
    gables: tuple[Gable, ...]


def candidates(p_m: np.ndarray, params: RoofParameters | None = None) -> np.ndarray:
    """Indices (K,) of the points that can lie on a roof: no outliers, no ground.

    p_m : (N, 3) array, m, m-frame (z up), one strip, whatever the boresight.
    """
    params = params or RoofParameters.fine()
    kept = np.flatnonzero(statistical_outliers(p_m, params.outliers.k, params.outliers.alpha))
    return kept[~progressive_morphological_filter(p_m[kept], params.ground)]


def extract(p_m: np.ndarray, params: RoofParameters, rng: np.random.Generator) -> Roofs:
    """The gable roofs among candidate points p_m (K, 3), m, m-frame."""
    thinned = thin(p_m, params.cell_m)
    if len(thinned) < params.growing.size[0]:
        return Roofs((), ())
    around = neighbourhood(thinned.p_m, params.growing.neighbours, params.growing.max_gap_m)
    group = _consensus_sets(thinned, around, params, rng)
    segments = _segments(grow_regions(around, group, params.growing), params)
    faces = assign(p_m, thinned, segments, params.cell_m, params.assignment)
    faces = [face for face in faces if _is_sloped(face, params)]
    return _of_gables(faces, find_gables(p_m, faces, params.gable))


def objects(p_m: np.ndarray, cell_m: float) -> list[np.ndarray]:
    """Index arrays of the objects among points (V, 3): islands of cells, seen from above."""
    east, north = cells(p_m[:, :2], cell_m)
    occupied = np.zeros((east.max() + 1, north.max() + 1), dtype=bool)
    occupied[east, north] = True
    island, _ = ndimage.label(occupied, structure=np.ones((3, 3)))
    number = island[east, north]
    order = np.argsort(number, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(number[order])) + 1)


def _consensus_sets(
    thinned: Thinned, around: Neighbourhood, params: RoofParameters, rng
) -> np.ndarray:
    """Number (V,) of the RANSAC plane that each thinned point belongs to, -1 for none."""
    group, number = np.full(len(thinned), -1), 0
    for members in objects(thinned.p_m, 2 * params.cell_m):
        if len(members) < params.growing.size[0]:
            continue
        for consensus in ransac_planes(thinned.p_m, around, members, params.ransac, rng):
            group[consensus] = number
            number += 1
    return group


def _segments(label: np.ndarray, params: RoofParameters) -> list[np.ndarray]:
    """Index arrays of the segments of an admissible size."""
    smallest, largest = params.growing.size
    count = np.bincount(label[label >= 0])
    wanted = np.flatnonzero((count >= smallest) & (count <= largest))
    return [np.flatnonzero(label == number) for number in wanted]


def _is_sloped(face: Face, params: RoofParameters) -> bool:
    low, high = np.radians(params.ransac.slope_deg)
    return bool(low <= face.slope <= high)


def _of_gables(faces: list[Face], gables: list[Gable]) -> Roofs:
    """Only the faces that make a gable, renumbered."""
    kept = sorted({number for gable in gables for number in (gable.left, gable.right)})
    new = {old: number for number, old in enumerate(kept)}
    return Roofs(
        tuple(faces[old] for old in kept),
        tuple(Gable(new[g.left], new[g.right], g.virtual_point, g.ridge, g.extent) for g in gables),
    )
