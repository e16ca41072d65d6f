"""Every value of the paper once: with unit, place and kind.

``kind`` says how a value may be compared: ``input`` (met exactly), ``pattern`` (the truth behind it
differs from ours; only its pattern is comparable), ``ordering`` and ``inequality``.
"""

from dataclasses import dataclass

INPUT, PATTERN, ORDERING, INEQUALITY = "input", "pattern", "ordering", "inequality"


@dataclass(frozen=True)
class Published:
    """A published number with its standard deviation where one is printed."""

    value: float
    unit: str
    place: str
    kind: str
    sigma: float | None = None


#: Boresight angles and their formal standard deviations.
TABLE4 = {
    ("A", "omega"): Published(0.0187, "deg", "Table 4", PATTERN, 0.0049),
    ("A", "phi"): Published(-0.0155, "deg", "Table 4", PATTERN, 0.0037),
    ("A", "kappa"): Published(0.0008, "deg", "Table 4", PATTERN, 0.0165),
    ("B", "omega"): Published(0.0285, "deg", "Table 4", PATTERN, 0.0082),
    ("B", "phi"): Published(0.0108, "deg", "Table 4", PATTERN, 0.0099),
    ("B", "kappa"): Published(0.0135, "deg", "Table 4", PATTERN, 0.0038),
    ("C", "omega"): Published(-0.0012, "deg", "Table 4", PATTERN, 0.0061),
    ("C", "phi"): Published(0.0507, "deg", "Table 4", PATTERN, 0.0205),
    ("C", "kappa"): Published(0.0446, "deg", "Table 4", PATTERN, 0.0177),
}

#: Overlap of strip pairs in percent, and the directions flown.
TABLE1 = {
    ("F1", "F2"): (100, "North-South"),
    ("F2", "F3"): (70, "North-South"),
    ("F3", "F4"): (50, "North-South"),
    ("F2", "F4"): (20, "North-North"),
    ("F1", "F5"): (70, "North-North"),
    ("F5", "F6"): (50, "North-South"),
    ("F1", "F6"): (20, "North-South"),
    ("F7", "F8"): (100, "West-East"),
}

#: Parameters of the segmentation by their names in `RoofParameters`; ".0", ".1" end a range.
TABLE2 = {
    "ground.cell_m": Published(1.0, "m", "Table 2", INPUT),
    "ground.base_cells": Published(2, "1", "Table 2", INPUT),
    "ground.slope": Published(0.05, "1", "Table 2", INPUT),
    "ground.largest_threshold_m": Published(10.0, "m", "Table 2", INPUT),
    "ransac.min_inliers": Published(15, "1", "Table 2", INPUT),
    "ransac.tolerance_m": Published(0.10, "m", "Table 2", INPUT),
    "ransac.max_sets": Published(10, "1", "Table 2", INPUT),
    "ransac.slope_deg.0": Published(10.0, "deg", "Table 2", INPUT),
    "ransac.slope_deg.1": Published(80.0, "deg", "Table 2", INPUT),
    "growing.size.0": Published(40, "1", "Table 2", INPUT),
    "growing.size.1": Published(500, "1", "Table 2", INPUT),
    "growing.angle_deg": Published(1.0, "deg", "Table 2", INPUT),
    "growing.max_gap_m": Published(4.0, "m", "Table 2", INPUT),
}

#: Share of the point-to-plane error before calibration that a method leaves, Table 5.
TABLE5 = {
    "SL": Published(0.80, "1", "Table 5", ORDERING),
    "proposed": Published(0.20, "1", "Table 5", ORDERING),
}

#: Least reduction of the RMSE by B and C, and the share that [11] leaves at most, section 3.2.3.
RMSE_REDUCTION = {
    "B": Published(0.90, "1", "Fig. 7", INEQUALITY),
    "C": Published(0.90, "1", "Fig. 7", INEQUALITY),
}
RMSE_LEFT_BY_SL = Published(0.12, "1", "Fig. 8", INEQUALITY)

#: Bounds on the absolute vertical offset at the virtual points.
OFFSET_AFTER_CALIBRATION = Published(0.40, "m", "Fig. 11", INEQUALITY)
OFFSET_AFTER_REFINEMENT = Published(0.30, "m", "Fig. 11", INEQUALITY)

#: The survey as described, and what its sensors promise.
HEIGHT = Published(30.0, "m", "section 2.1", INPUT)
DENSITY = Published(300.0, "1/m2", "section 2.1", INPUT)
RANGE_ACCURACY = Published(0.03, "m", "section 2.1", INPUT)
ATTITUDE_ACCURACY = {
    "omega": Published(0.025, "deg", "section 2.1", INPUT),
    "phi": Published(0.025, "deg", "section 2.1", INPUT),
    "kappa": Published(0.08, "deg", "section 2.1", INPUT),
}

#: Share of the systematic errors that the centroid constraint is said to correct, section 5.
SYSTEMATIC_CORRECTED = Published(0.80, "1", "section 5", ORDERING)
