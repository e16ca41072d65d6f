"""Refinement of the boresight by the point-to-plane model, Eq. (6)-(9).

Each point of a face in one strip is projected at right angles on its matched plane in another; the
boresight that makes the projections shortest is sought, everything else held. The target plane is
fitted to its own strip's points and moves with the boresight like the points do.
"""

from dataclasses import replace

import numpy as np

from paperrepro.adjustment.matched import MatchedFaces
from paperrepro.adjustment.result import CalibrationResult
from paperrepro.adjustment.scenarios import Scenario, calibrate
from paperrepro.survey import Mounting, Survey

POINT_TO_PLANE = Scenario("refinement", "none", free_planes=False, points=True, centroids=False)


def orthogonal_projection(p_m: np.ndarray, plane: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Foot points (N, 3) of ``p_m`` (N, 3) on ``plane`` (4,) as (n, d), and signed lengths (N,), m.

    Eq. (7): ``s = d - n . p``, ``p_T = p + s n``.
    """
    s = plane[3] - p_m @ plane[:3]
    return p_m + s[:, None] * plane[:3], s


def refine(survey: Survey, matched: MatchedFaces, calibrated: Mounting) -> CalibrationResult:
    """Boresight that minimises Eq. (9), from ``calibrated`` as start; range offsets stay as they
    are.

    ``matched`` holds the faces extracted and matched under ``calibrated``; the first face of a pair
    gives the points, the second the target plane. Raises as `scenarios.calibrate` does,
    `TooFewPlanes` for fewer than four planes (section 2.2.5).
    """
    onto_target = replace(matched, pairs=matched.pairs[:, ::-1])
    return calibrate(replace(survey, mounting=calibrated), onto_target, POINT_TO_PLANE)
