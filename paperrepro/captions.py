"""What our tables and figures show, in sentences whose numbers are read from rows.

``{0[fig07/SL/rmse_reference_calibration]:cm}`` is the value of artefact "fig07", scenario "SL" and
that metric, in centimetres; "@table4" behind it asks for another preset than the run's own.
"""

import re
from dataclasses import dataclass

import pandas as pd

from paperrepro.quantities import Quantity
from paperrepro.tables import Run

CAPTIONS = {
    "table3": "Every adjustment uses the same {0[matching/last pass/planes]} planes from "
    "{0[matching/last pass/views]} views. SL stands for [11] alone, which the paper's text takes "
    "for C, while its figures show the two apart.",
    "table4": "The common part of all range offsets, a height that the roofs do not fix, is wrong "
    "by {0[table4/B/range_offset_common_error]:cm} in B, "
    "{0[table4/C/range_offset_common_error]:cm} in C and "
    "{0[table4/D/range_offset_common_error]:cm} in D; their differences between beams are right "
    "to {0[table4/B/range_offset_relative_rms]:mm}, {0[table4/C/range_offset_relative_rms]:mm} "
    "and {0[table4/D/range_offset_relative_rms]:mm}.",
    "table5": "[11] leaves {0[table5/SL/mean_left_reference_calibration]:%} of the mean distance, "
    "A {0[table5/A/mean_left_reference_calibration]:%}, "
    "B {0[table5/B/mean_left_reference_calibration]:%}, "
    "C {0[table5/C/mean_left_reference_calibration]:%}; the true mounting leaves "
    "{0[table5/truth/mean_left_reference]:%}. Against true planes, free of the reference's error, "
    "[11] leaves {0[table5/SL/mean_left_truth_calibration]:%}, "
    "B {0[table5/B/mean_left_truth_calibration]:%} and "
    "C {0[table5/C/mean_left_truth_calibration]:%}.",
    "fig01": "A strip of this run has {0[survey/truth/density]:1/m2} on average.",
    "fig04": "{0[matching/last pass/virtual_points]} virtual points are found in the eight strips.",
    "fig06": "Refined, the angles are wrong by {0[refinement/A/error_refined]:deg} in A, "
    "{0[refinement/B/error_refined]:deg} in B and {0[refinement/C/error_refined]:deg} in C "
    "(all three together).",
    "fig07": "RMSE against the airborne reference: {0[fig07/before/rmse_reference]:cm} before, "
    "then {0[fig07/SL/rmse_reference_calibration]:cm} for [11], "
    "{0[fig07/A/rmse_reference_calibration]:cm} for A, "
    "{0[fig07/B/rmse_reference_calibration]:cm} for B and "
    "{0[fig07/C/rmse_reference_calibration]:cm} for C, that is "
    "{0[fig07/SL/rmse_left_reference_calibration]:%}, "
    "{0[fig07/A/rmse_left_reference_calibration]:%}, "
    "{0[fig07/B/rmse_left_reference_calibration]:%} and "
    "{0[fig07/C/rmse_left_reference_calibration]:%} of it; D, ours, leaves "
    "{0[fig07/D/rmse_reference_calibration]:cm}. The true mounting leaves "
    "{0[fig07/truth/rmse_reference]:cm}, or {0[fig07/truth/rmse_left_reference]:%}.",
    "fig08": "Mean and standard deviation: [11] {0[fig08/SL/mean]:cm} and {0[fig08/SL/sigma]:cm}, "
    "B {0[fig08/B/mean]:cm} and {0[fig08/B/sigma]:cm}, C {0[fig08/C/mean]:cm} and "
    "{0[fig08/C/sigma]:cm}, D {0[fig08/D/mean]:cm} and {0[fig08/D/sigma]:cm}. "
    "The largest gap to a normal distribution function is "
    "{0[fig08/SL/ks]:%}, {0[fig08/B/ks]:%}, {0[fig08/C/ks]:%} and {0[fig08/D/ks]:%}.",
    "fig09": "The RMSE of the roof points from the true planes falls from "
    "{0[fig07/before/rmse_truth]:cm} to {0[fig07/C/rmse_truth_refinement]:cm}.",
    "fig10": "Ground heights below the crowns spread by {0[fig10/before/ground_spread]:cm} before, "
    "by {0[fig10/C/ground_spread]:cm} after C and {0[fig10/D/ground_spread]:cm} after D (ours), "
    "within a square metre; the true mounting leaves {0[fig10/truth/ground_spread]:cm}.",
    "fig11": "Largest offset: {0[fig11/before/max]:cm} before; calibrated "
    "{0[fig11/SL/max_calibration]:cm} ([11]), {0[fig11/A/max_calibration]:cm} (A), "
    "{0[fig11/B/max_calibration]:cm} (B), {0[fig11/C/max_calibration]:cm} (C), "
    "{0[fig11/D/max_calibration]:cm} (D, ours); refined "
    "{0[fig11/SL/max_refinement]:cm}, {0[fig11/A/max_refinement]:cm}, "
    "{0[fig11/B/max_refinement]:cm}, {0[fig11/C/max_refinement]:cm}.",
    "trajectory_error": "RMS of this flight: {0[trajectory/truth/rms_east]:cm} east, "
    "{0[trajectory/truth/rms_north]:cm} north, {0[trajectory/truth/rms_up]:cm} up; "
    "{0[trajectory/truth/rms_roll]:deg} roll, {0[trajectory/truth/rms_pitch]:deg} pitch, "
    "{0[trajectory/truth/rms_heading]:deg} heading.",
    "small_angle": "An angle of 2° displaces a point 30 m away by "
    "{0[equation//small_angle_2deg_30m]:cm}.",
    "thick_roof": "The beams of one face spread by {0[equation/nominal/beam_spread]:cm} under the "
    "nominal mounting, by {0[equation/true/beam_spread]:cm} under the true one.",
    "extraction_sensitivity": "As used, {0[extraction/last pass/recall]:%} of the faces that can "
    "be expected are found, and {0[extraction/last pass/false_views]} that are no gable face.",
    "normal_errors": "Normals are wrong by {0[extraction/last pass/normal_error_median]:deg} in "
    "the median, by {0[extraction/last pass/normal_error_max]:deg} at most.",
    "match_matrix": "{0[matching/last pass/false_pairs]} of {0[matching/last pass/pairs]} pairs "
    "are false.",
    "refinement_errors": "Total error of the angles before and after refinement: "
    "{0[refinement/SL/error_calibrated]:deg} and {0[refinement/SL/error_refined]:deg} (SL), "
    "{0[refinement/A/error_calibrated]:deg} and {0[refinement/A/error_refined]:deg} (A), "
    "{0[refinement/B/error_calibrated]:deg} and {0[refinement/B/error_refined]:deg} (B), "
    "{0[refinement/C/error_calibrated]:deg} and {0[refinement/C/error_refined]:deg} (C).",
    "rmse": "With Table 4's magnitudes of the boresight the RMSE is "
    "{0[fig07/before/rmse_reference@table4]:cm} before, and the true mounting leaves "
    "{0[fig07/truth/rmse_reference@table4]:cm}; the difference is all that there is to gain.",
}


@dataclass(frozen=True)
class Values:
    """The values of one run, to be had by "artefact/scenario/metric" or ".../metric@preset"."""

    quantities: dict[str, Quantity]
    run: Run

    @classmethod
    def of(cls, rows: pd.DataFrame, run: Run) -> "Values":
        own = rows[
            (rows.profile == run.profile)
            & (rows.noise_scale == run.noise_scale)
            & (rows.seed == run.seed)
        ].fillna({"scenario": "", "unit": "1"})
        keys = own.artefact + "/" + own.scenario + "/" + own.metric + "@" + own.preset
        quantities = map(Quantity, own.value, own.unit.astype(str))
        return cls(dict(zip(keys, quantities, strict=True)), run)

    def __getitem__(self, key: str) -> Quantity:
        return self.quantities[self._full(key)]

    def __contains__(self, key: str) -> bool:
        return self._full(key) in self.quantities

    def _full(self, key: str) -> str:
        return key if "@" in key else f"{key}@{self.run.preset}"


def caption(name: str, values: Values) -> str:
    """Our sentence on artefact ``name``, empty where the picture needs none; one that lacks values
    says which."""
    sentence = CAPTIONS.get(name, "")
    keys = dict.fromkeys(re.findall(r"\{0\[(.+?)\]", sentence))
    missing = [key for key in keys if key not in values]
    if missing:
        return f"Values of this run are missing in rows.csv: {', '.join(missing)}."
    return sentence.format(values)
