"""Every table and figure: what it shows, what the paper has there, which notebook makes it.

Captions are sentences whose numbers are read from rows:
``{0[fig07/SL/rmse_reference_calibration]:cm}`` is the value of artefact "fig07", scenario "SL" and
that metric, in centimetres; "@table4" behind it asks for another preset than the run's own.
"""

import re
from dataclasses import dataclass

import pandas as pd

from paperrepro.paper.numbers import Quantity
from paperrepro.paper.published import (
    OFFSET_AFTER_CALIBRATION,
    OFFSET_AFTER_REFINEMENT,
    RMSE_LEFT_BY_SL,
    RMSE_REDUCTION,
    TABLE1,
    TABLE5,
)
from paperrepro.study.rows import SurveyKey


@dataclass(frozen=True)
class Artefact:
    """A table or picture: ``name`` of its files, what ours ``shows``, and what the ``paper`` has
    at that place (empty for what only we show). ``notebook`` makes it (empty: `make bench`)."""

    name: str
    title: str
    notebook: str
    shows: str
    paper: str = ""

    @property
    def place(self) -> str:
        """Where the paper has it, "Table 4" or "Fig. 7"; empty for what only we show."""
        found = re.fullmatch(r"(table|fig)(\d+)(_\w+)?", self.name)
        return f"{_KINDS[found[1]]} {int(found[2])}" if found else ""


_KINDS = {"table": "Table", "fig": "Fig."}
_FARM, _EQUATION, _ROOFS = "01_simulated_farm", "02_lidar_equation", "03_roof_extraction"
_MATCHING, _CALIBRATION = "04_matching", "05_calibration"
_REFINEMENT, _ACCURACY = "06_refinement", "07_accuracy"
_SWEEP, _CLAIMS, _APPLICATIONS = "08_noise_sweep", "09_claims", "10_applications"
_OWN, _STRIPS = "11_own_flight", "12_strip_adjustment"
_REDUCED = f"{100 * RMSE_REDUCTION['C'].value:.0f}\u00a0%"

#: Every table and figure, first those of the paper in its order, then ours in the notebooks' order.
ARTEFACTS = (
    Artefact("table1", "Overlap and direction of strip pairs", _FARM,
             "Overlap planned over flat ground, and achieved in cells that both strips hit.",
             f"Overlaps of {len(TABLE1)} pairs of strips; an input, which the plan must meet."),
    Artefact("table2", "Parameters of the segmentation", _ROOFS,
             "Values of the last (fine) and the first (coarse) pass, and how each print is read.",
             "Parameters of ground filter, RANSAC and roof fitting; inputs."),
    Artefact("table3", "Unknowns and conditions of the scenarios", _CALIBRATION,
             "Number of unknowns, conditions and iterations of each adjustment, D (ours) too.",
             "A: boresight angles; B: and a range offset for each beam; C: and all planes."),
    Artefact("table4", "Boresight angles", _CALIBRATION,
             "Estimates beside the known truth of preset `mount`, a degree off, and of `table4`, "
             "whose truth is what the paper prints for A; D (ours) among them; the error also in "
             "formal σ.",
             "Angles with σ of A, B and C for another, unknown mounting: only patterns compare, "
             "and that A comes near its own print in preset `table4` is no agreement."),
    Artefact("table5", "Share of the error that is left", _ACCURACY,
             "Mean distance from the reference's planes, as a share of that before calibration: of "
             "the survey shown, and mean and range of nine in ten surveys of a sixteenth of its "
             "pulses; last D (ours), by its mounting and with its trajectory.",
             f"[11] leaves about {100 * TABLE5['SL'].value:.0f}\u00a0%, the proposed method about "
             f"{100 * TABLE5['proposed'].value:.0f}\u00a0% of the errors."),
    Artefact("fig01", "The site and its flight lines", _FARM,
             "Plan of the simulated farm: houses, sheds and trees under the eight flight lines.",
             "Map of the real site, a farming area, with the lines F1-F8."),
    Artefact("fig02", "Cloud of adjusted strips", _REFINEMENT,
             "Heights of one strip and of three, adjusted, without outliers.",
             "Clouds of one strip, and of three adjusted strips."),
    Artefact("fig02_section", "A slice through one strip", _FARM,
             "Section across a strip, each point coloured by what the pulse hit.",
             "Cloud of one strip."),
    Artefact("fig03", "The framework", _FARM,
             "The steps from strips to accuracy, with the notebook that shows each.",
             "The same framework, in seven steps."),
    Artefact("fig04", "The virtual point of a gable roof", _MATCHING,
             "A measured gable in perspective and from above, with both centroids, ridge and "
             "virtual point.",
             "Sketch of how a virtual point follows from two centroids and the ridge."),
    Artefact("fig05", "Projection on the target plane", _REFINEMENT,
             "Section of a roof face: measured points of one strip and their orthogonal "
             "projections on the plane of another.",
             "Sketch of the orthogonal projection of Eq. 6 and 7."),
    Artefact("fig06", "A roof in profile", _REFINEMENT,
             "Section of a roof before calibration, by strip, and after A, B, C refined and D "
             "(ours), by its mounting and with its trajectory; the airborne reference as a line.",
             "B and C follow the reference more closely than A."),
    Artefact("fig07", "RMSE before and after", _ACCURACY,
             "Bars of the RMSE of point-to-plane distances before calibration and after each "
             "method, at the end D (ours), by its mounting and with its trajectory; dashed what "
             "the true mounting leaves under the trajectory as reported; lines beside bars span "
             "nine in ten surveys of a sixteenth of the pulses.",
             f"B and C reduce the RMSE by more than {_REDUCED}, and below that of [11]."),
    Artefact("fig08", "Distribution of the distances", _ACCURACY,
             "Histograms of the point-to-plane distances before and after [11], B, C and D (ours), "
             "by its mounting and with its trajectory, each with the normal curve of the same mean "
             "and σ; KS is the largest difference of their cumulative shares. The bar over a panel "
             "spans the means of nine in ten surveys of a sixteenth of the pulses.",
             f"B and C almost normal, a sign of no systematic error; [11] leaves less than "
             f"{100 * RMSE_LEFT_BY_SL.value:.0f}\u00a0% of the RMSE."),
    Artefact("fig09", "The cloud before and after", _REFINEMENT,
             "The site from the south-east, and a slice through it, before calibration and after "
             "scenario C and refinement, points coloured by strip.",
             "Before, a noisy cloud; after refinement most of the misalignment is gone."),
    Artefact("fig10", "A forest and a building", _APPLICATIONS,
             "A transect through a stand of trees and a house at its edge, before and after "
             "calibration from the houses' roofs, by C and by D (ours); a second simulated site. "
             "Before, each strip puts a stem elsewhere, so more of them fall into the transect.",
             "Clouds for a forest inventory and for 3D modelling."),
    Artefact("fig11", "Vertical offsets at the virtual points", _ACCURACY,
             "Absolute height difference from the reference of every virtual point, at each step; "
             "D (ours), by its mounting and with its trajectory, has no refinement. Bars are "
             "means, numbers the largest; lines beside them span the means of nine in ten surveys "
             "of a sixteenth of the pulses.",
             f"Below {100 * OFFSET_AFTER_CALIBRATION.value:.0f} cm after calibration, below "
             f"{100 * OFFSET_AFTER_REFINEMENT.value:.0f} cm after refinement, less than [11]."),
    Artefact("trajectory_error", "Error of the trajectory", _FARM,
             "Six curves of the trajectory's error over the mission, within grey bands of σ; "
             "coloured bars are the times of the strips F1 to F8."),
    Artefact("density", "Density across a strip", _FARM,
             "Points per square metre over the distance from the track, by strip."),
    Artefact("reference", "The airborne reference", _FARM,
             "Plan of the reference's heights, and along its white line one roof in the reference "
             "and in a strip."),
    Artefact("small_angle", "What the small-angle form neglects", _EQUATION,
             "Displacement over the boresight angle, for three ranges."),
    Artefact("error_budget", "Error budget at 30 m", _EQUATION,
             "How far each source of error moves a point, on a logarithmic scale."),
    Artefact("thick_roof", "A wrong boresight thickens roofs", _EQUATION,
             "Section of a roof under the nominal and the true mounting, coloured by beam."),
    Artefact("filters", "Outliers and ground", _ROOFS,
             "Plan of a strip, and a section between its dashed lines: ground, candidates for "
             "roofs, and outliers."),
    Artefact("faces", "Faces and gables found", _ROOFS,
             "Plan of the faces found in a strip, with ridges and virtual points."),
    Artefact("extraction_sensitivity", "What Table 2's values cost", _ROOFS,
             "Faces and planes found when one parameter of the last pass is changed."),
    Artefact("normal_errors", "Error of the roofs' normals", _ROOFS,
             "Error of each face's normal over the number of its points."),
    Artefact("passes", "Passes from a boresight of zero", _MATCHING,
             "Boresight after each pass of finding and matching, and its largest error."),
    Artefact("pair_distances", "How near matched gables are", _MATCHING,
             "Distance and inclination of matched gables in the first and the last pass."),
    Artefact("match_matrix", "Who matched whom", _MATCHING,
             "Matrix of the faces that two strips share, false ones below the diagonal."),
    Artefact("tie_planes", "Tie planes", _MATCHING,
             "Plan of the matched roof faces, coloured by the number of strips that see them."),
    Artefact("boresight_errors", "Errors of the boresight with their bars", _CALIBRATION,
             "Error of each angle by scenario with bars of one and two formal σ."),
    Artefact("sigma_against_points", "What a formal sigma measures", _CALIBRATION,
             "Formal σ, RMS error, NEES and coverage over the points of a face that enter, over "
             "many surveys; dashed the σ that the paper prints."),
    Artefact("range_offsets", "Range offsets", _CALIBRATION,
             "Estimated and true offset of each beam, as estimated and without their mean."),
    Artefact("correlation", "Correlations of scenario C", _CALIBRATION,
             "Correlation matrix of boresight angles and range offsets."),
    Artefact("refinement_errors", "What refinement changes", _REFINEMENT,
             "Error of each angle before and after refinement, by scenario."),
    Artefact("moved_profile", "A roof under a wrong boresight", _REFINEMENT,
             "Section of a roof by strip, refined and with half a degree added to each angle."),
    Artefact("rmse", "Point-to-plane distances in full", _ACCURACY,
             "RMSE and mean distance of every step, against reference and true planes."),
    Artefact("noise_errors", "Errors, sigmas and coverage against noise", _SWEEP,
             "Mean boresight error, formal σ and coverage of 95\u00a0% intervals of each scenario, "
             "over the noise of the trajectory, with intervals over many surveys."),
    Artefact("noise_offsets", "Vertical offsets against noise", _SWEEP,
             "Mean vertical offset at the virtual points from the reference and from the true "
             "planes, over the noise of the trajectory."),
    Artefact("noise_beaten", "Surveys in which [11] is beaten", _SWEEP,
             "Share of surveys in which A, B, C and D (ours) find the boresight better than [11], "
             "over the noise of the trajectory; a half is chance."),
    Artefact("promises", "What sigmas promise and hold", _SWEEP,
             "RMS error, formal σ, Cramér-Rao bound, coverage of 95\u00a0% intervals and mean "
             "squared standardised error by angle, over many surveys; D also with a wrong prior."),
    Artefact("errors_against_sigmas", "Errors against sigmas", _SWEEP,
             "Error of the boresight over its formal σ, a point for each survey, a colour for "
             "each scenario; above the line σ is too small. [11], B and C from three points a "
             "face, A from centroids alone: the reading whose σ are of the size that the paper "
             "prints."),
    Artefact("error_kinds", "Errors of other kinds", _SWEEP,
             "Coverage of 95\u00a0% intervals and RMS error of the boresight by kind of errors, "
             "over many surveys; D as told the specification, and under the noise that it finds; "
             "[11], B and C from all points of a face, A from centroids alone."),
    Artefact("verdicts", "Verdicts counted", _CLAIMS,
             "Number of claims by verdict, the paper's and ours."),
    Artefact("ordering", "Which method is better", _CLAIMS,
             "Mean boresight error of each scenario over many surveys, with its interval."),
    Artefact("benchmarks", "Time of each stage", "",
             "Seconds over the number of points, on logarithmic scales: our stages, dashed the "
             "peers that do the same work; dotted a microsecond a point. Medians by `make bench`, "
             "with the machine named in benchmarks.csv."),
    Artefact("own_flight_pairs", "An operator's folder, calibrated", _OWN,
             "Distances between the strips of a simulated operator's folder, by pair of strips, "
             "before and after the calibration by D (ours)."),
    Artefact("strip_differences", "Differences between strips", _STRIPS,
             "Two pairs of strips seen from above: how far the one lies over the other, before the "
             "calibration, with D's mounting, and with its trajectory (ours), in cells of a metre; "
             "mind the different scales. The RMS is that of single points, noise of the laser "
             "included."),
)  # fmt: skip


CAPTIONS = {
    "table3": "Every adjustment uses the same {0[matching/last pass/planes]} planes from "
    "{0[matching/last pass/views]} views. SL stands for [11] alone, which the paper's text takes "
    "for C, while its figures show the two apart. The redundancy is that of conditions over "
    "unknowns: a plane counts three, its normal being of length 1; range offsets and, in D, the "
    "trajectory count none, since each comes with an observation of its own (zero, or the process "
    "that ties it to the next).",
    "table4": "The common part of all range offsets, a height that the roofs do not fix, is wrong "
    "by {0[table4/B/range_offset_common_error]:cm} in B, "
    "{0[table4/C/range_offset_common_error]:cm} in C and "
    "{0[table4/D/range_offset_common_error]:cm} in D; their differences between beams are right "
    "to {0[table4/B/range_offset_relative_rms]:mm}, {0[table4/C/range_offset_relative_rms]:mm} "
    "and {0[table4/D/range_offset_relative_rms]:mm}.",
    "table5": "[11] leaves {0[table5/SL/mean_left_reference_calibration]:%} of the mean distance, "
    "A {0[table5/A/mean_left_reference_calibration]:%}, "
    "B {0[table5/B/mean_left_reference_calibration]:%}, "
    "C {0[table5/C/mean_left_reference_calibration]:%}; D, ours, "
    "{0[table5/D/mean_left_reference_calibration]:%}, with its trajectory "
    "{0[table5/D trajectory adjusted/mean_left_reference_calibration]:%}; the true mounting leaves "
    "{0[table5/truth/mean_left_reference]:%}. Against true planes, free of the reference's error, "
    "[11] leaves {0[table5/SL/mean_left_truth_calibration]:%}, "
    "B {0[table5/B/mean_left_truth_calibration]:%}, "
    "C {0[table5/C/mean_left_truth_calibration]:%} and D with its trajectory "
    "{0[table5/D trajectory adjusted/mean_left_truth_calibration]:%}.",
    "fig01": "A strip of this run has {0[survey/truth/density]:1/m2} on average.",
    "fig04": "{0[matching/last pass/virtual_points]} virtual points are found in the eight strips.",
    "fig06": "Refined, the angles are wrong by {0[refinement/A/error_refined]:deg} in A, "
    "{0[refinement/B/error_refined]:deg} in B and {0[refinement/C/error_refined]:deg} in C "
    "(root of the sum of the three squares).",
    "fig07": "RMSE against the airborne reference: {0[fig07/before/rmse_reference]:cm} before, "
    "then {0[fig07/SL/rmse_reference_calibration]:cm} for [11], "
    "{0[fig07/A/rmse_reference_calibration]:cm} for A, "
    "{0[fig07/B/rmse_reference_calibration]:cm} for B and "
    "{0[fig07/C/rmse_reference_calibration]:cm} for C, that is "
    "{0[fig07/SL/rmse_left_reference_calibration]:%}, "
    "{0[fig07/A/rmse_left_reference_calibration]:%}, "
    "{0[fig07/B/rmse_left_reference_calibration]:%} and "
    "{0[fig07/C/rmse_left_reference_calibration]:%} of it; D, ours, leaves "
    "{0[fig07/D/rmse_reference_calibration]:cm}, and with its trajectory "
    "{0[fig07/D trajectory adjusted/rmse_reference_calibration]:cm}. The true mounting leaves "
    "{0[fig07/truth/rmse_reference]:cm}, or {0[fig07/truth/rmse_left_reference]:%}. Against the "
    "true planes [11] leaves {0[fig07/SL/rmse_truth_calibration]:cm}, "
    "B {0[fig07/B/rmse_truth_calibration]:cm}, C {0[fig07/C/rmse_truth_calibration]:cm}, "
    "D {0[fig07/D/rmse_truth_calibration]:cm}, with its trajectory "
    "{0[fig07/D trajectory adjusted/rmse_truth_calibration]:cm}, and the true mounting "
    "{0[fig07/truth/rmse_truth]:cm}.",
    "fig08": "Mean and standard deviation: [11] {0[fig08/SL/mean]:cm} and {0[fig08/SL/sigma]:cm}, "
    "B {0[fig08/B/mean]:cm} and {0[fig08/B/sigma]:cm}, C {0[fig08/C/mean]:cm} and "
    "{0[fig08/C/sigma]:cm}, D {0[fig08/D/mean]:cm} and {0[fig08/D/sigma]:cm}, with its "
    "trajectory {0[fig08/D trajectory adjusted/mean]:cm} and "
    "{0[fig08/D trajectory adjusted/sigma]:cm}; a mean is the error in height of reference, "
    "trajectory and range offsets. The largest gap to a normal distribution function is "
    "{0[fig08/SL/ks]:%}, {0[fig08/B/ks]:%}, {0[fig08/C/ks]:%} and {0[fig08/D/ks]:%}.",
    "fig09": "The RMSE of the roof points from the true planes falls from "
    "{0[fig07/before/rmse_truth]:cm} to {0[fig07/C/rmse_truth_refinement]:cm} (by Fig. 7's C, "
    "three points a face).",
    "fig10": "Ground heights below the crowns spread by {0[fig10/before/ground_spread]:cm} before, "
    "by {0[fig10/C/ground_spread]:cm} after C and {0[fig10/D/ground_spread]:cm} after D (ours), "
    "within a square metre; the true mounting leaves {0[fig10/truth/ground_spread]:cm}.",
    "fig11": "Largest offset: {0[fig11/before/max]:cm} before; calibrated "
    "{0[fig11/SL/max_calibration]:cm} ([11]), {0[fig11/A/max_calibration]:cm} (A), "
    "{0[fig11/B/max_calibration]:cm} (B), {0[fig11/C/max_calibration]:cm} (C), "
    "{0[fig11/D/max_calibration]:cm} (D, ours), "
    "{0[fig11/D trajectory adjusted/max_calibration]:cm} (D, trajectory adjusted); refined "
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
    run: SurveyKey

    @classmethod
    def of(cls, rows: pd.DataFrame, run: SurveyKey) -> "Values":
        own = cls.own(rows, run).fillna({"scenario": "", "unit": "1"})
        keys = own.artefact + "/" + own.scenario + "/" + own.metric + "@" + own.preset
        quantities = map(Quantity, own.value, own.unit.astype(str))
        return cls(dict(zip(keys, quantities, strict=True)), run)

    @staticmethod
    def own(rows: pd.DataFrame, run: SurveyKey) -> pd.DataFrame:
        """Those of ``rows`` that are of the run's profile, noise and seed."""
        same = (rows.profile == run.profile) & (rows.noise_scale == run.noise_scale)
        return rows[same & (rows.seed == run.seed)]

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
