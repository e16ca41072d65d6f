"""The ledger: the paper's testable sentences, and ours, judged from the rows of a study.

No verdict is typed: `judges` says how surveys make a setting's, `verdicts` how settings make one.
A claim is declared once: its name, its place in the paper, whose it is, how it is judged, or why no
survey of this simulation can, and what it says in our words. The paper does not say how many points
of a face enter; its printed sigmas are those of few (`rows.FEW`), by which its claims are judged.
Where all points (`rows.MANY`) turn a verdict, that is said.
"""

from collections.abc import Iterator

import pandas as pd

from paperrepro.paper import findings, judges
from paperrepro.paper import published as paper
from paperrepro.paper.judges import (
    about,
    always,
    coverage,
    error,
    left,
    less,
    metric,
    ratio,
    reduced,
    within,
)
from paperrepro.paper.numbers import SYMBOLS
from paperrepro.paper.verdicts import (
    CALLED,
    COLUMNS,
    FOLLOWS,
    OURS,
    SAYS,
    Claim,
    Judge,
    Reading,
    each,
    in_settings,
    one,
    over_noise,
    printed,
    reasoned,
    under_kinds,
)
from paperrepro.study.rows import (
    ADJUSTED,
    AS_MANY,
    BY_FOUR,
    CENTROIDS,
    ERRORS,
    FEW,
    FOUND,
    LISTED_PAIRS,
    MANY,
    ONE_DIRECTION,
    PER_PAIR,
    REFINED,
    SEGMENTATION,
    SPECIFIED,
    TRUTH,
    mistaken_name,
)  # fmt: skip
from paperrepro.study.statistics import SIGMA, Evidence

#: The scenarios that the paper proposes, and its [11] with them.
PROPOSED = ("A", "B", "C")
ALL = ("SL", *PROPOSED)

#: Claims of the short table: the paper's main promises; and ours, with which stands the worst.
HEADLINES = (
    "no-campaign", "rmse-reduction", "rmse-below-SL", "table5-SL", "table5-proposed",
    "correct-under-noise", "sigma-honest", "offset-refined", "refinement-error",
)  # fmt: skip
OUR_HEADLINES = ("ours-coverage-D", "ours-error-D")

#: "About 300 points/m²" is met within this, a ratio of printed sigmas within that factor.
ABOUT_DENSITY, ABOUT_RATIO = 50.0, 1.5
#: A mean further from zero than so many honest sigmas is a systematic error.
CENTRED_SIGMAS = 1.96
#: Errors over the Cramer-Rao bound that are still near it.
NEAR_BOUND = 1.15
#: What is "highly reliable": so few of the matched views are no roof face.
UNRELIABLE = 0.01
#: A first step that ends so near the last, in sigma, is the solution.
ONE_STEP = 0.01
#: Of the 3D error under the true mounting D's trajectory leaves so much, in the median and at most;
#: 95 % intervals of its corrections hold the truth so often at observed times, and in gaps.
MEDIAN_LEFT, MOST_LEFT = 0.6, 0.8
COVERED = {"observed": {"low": 0.90, "high": 0.99}, "gaps": {"low": 0.88}}
#: Noise scales that are "highly noised".
HIGH_NOISE = 2.0


RMSE, RMSE_TRUTH, MEAN = "rmse_reference", "rmse_truth", "mae_reference"
OFFSET, OFFSET_MAX = "offset_mean_reference", "offset_max_reference"


# fmt: off


def _rmse() -> Iterator[Claim]:
    limit = paper.RMSE_REDUCTION["C"]
    yield Claim("no-campaign", "Abstract, section 2.2.3", SAYS,
        in_settings(each(PROPOSED, lambda r, x: less(error(r[x]), error("before"), "deg"))),
        "the calibration needs no campaign of its own: without control on the ground it lowers the "
        "boresight's error")
    yield Claim("rmse-reduction", "Fig. 7, section 3.2.3", SAYS,
        in_settings(lambda r: {f"{x}{end}": judges.gains(r[x] + end, RMSE, limit.value)
                               for end in ("", REFINED) for x in ("B", "C")}),
        "the RMSE against the reference falls by more than the stated share", limit)
    yield Claim("rmse-reduction-truth", "Fig. 7, section 3.2.3", FOLLOWS,
        in_settings(each(("B", "C"), lambda r, x: judges.gains(r[x], RMSE_TRUTH, limit.value))),
        "the RMSE against the true planes, without the reference's own error, falls so far", limit)
    yield Claim("budget-printed", "Table 4, Fig. 7", FOLLOWS, printed(findings.error_budget),
        "boresights as large as Table 4's explain so large a fall of the RMSE", limit)
    yield Claim("budget-table4", "Table 4, Fig. 7", FOLLOWS,
        in_settings(one(lambda r: within(reduced("truth", RMSE_TRUTH), "share", low=limit.value)),
                    "table4"),
        "with Table 4's boresight, even the true mounting lowers the RMSE so far", limit)
    yield Claim("rmse-below-SL", "Abstract, Fig. 7", SAYS,
        in_settings(each(("B", "C"), lambda r, x: judges.lower(r[x], r["SL"], RMSE))),
        "the RMSE is below that of [11]")
    yield Claim("rmse-truth-below-SL", "Fig. 7", FOLLOWS,
        in_settings(each(("B", "C"), lambda r, x: judges.lower(r[x], r["SL"], RMSE_TRUTH))),
        "the RMSE against the true planes is below that of [11]")
    yield Claim("rmse-below-A", "Fig. 6, section 3.2.2", SAYS,
        in_settings(each(("B", "C"), lambda r, x: judges.lower(r[x], r["A"], RMSE))),
        "B and C improve the roofs more than A does: a lower RMSE")
    yield Claim("rmse-B-like-C", "Fig. 6, section 3.2.2", SAYS,
        in_settings(one(lambda r: judges.no_worse(
            metric(r["B"], RMSE), metric(r["C"], RMSE), "m", either=True))),
        "B and C perform alike: their RMSE differ by less than a tenth")
    yield Claim("rmse-C-below-B", "sections 3.2.3 and 5", SAYS,
        in_settings(one(lambda r: judges.lower(r["C"], r["B"], RMSE, margin=0.0))),
        "with the condition of [11] beside the new constraint, C, the RMSE is slightly lower than"
        " B's")
    yield Claim("SL-alone", "section 5", SAYS,
        in_settings(one(lambda r: within(judges.over_floor(r["SL"]), "1", low=1 + judges.MARGIN))),
        "[11] alone does not do for UAV data: its RMSE against the true planes stays a tenth and "
        "more above the one that the true mounting leaves")
    yield Claim("constraint-brings-most", "section 3.2.3", SAYS,
        in_settings(lambda r: {
            "[11] alone": within(judges.gain_over(r["SL"], r["B"], RMSE), "share", high=0.5),
            "centroids alone": within(judges.gain_over(CENTROIDS, r["B"], RMSE), "share", low=0.5)},
            "mount"),
        "most of the gain comes from the centroid constraint: of what B gains, [11] alone gains "
        "less than half; read, too, as centroids alone more than half")


def _shares() -> Iterator[Claim]:
    sl, best = paper.RMSE_LEFT_BY_SL.value, {"the true mounting leaves": left("truth", RMSE)}
    yield Claim("rmse-left-SL", "Fig. 8, section 3.2.3", SAYS,
        in_settings(lambda r: {
            "reduced to": within(left(r["SL"], RMSE), "share", best, high=sl),
            "reduced by": within(reduced(r["SL"], RMSE), "share", high=sl)}),
        "[11] reduces the RMSE to less than the stated share; read, too, as by less than it",
        paper.RMSE_LEFT_BY_SL)
    for x, key in {"SL": "SL", "B": "proposed"}.items():
        share = paper.TABLE5[key]
        yield Claim(f"table5-{key}", "Table 5", SAYS,
            in_settings(lambda r, x=x, share=share: {
                words: about(left(r[x], measure), share.value,
                              {"the true mounting leaves": left("truth", measure)})
                for words, measure in {"mean distance": MEAN, "RMSE": RMSE}.items()}),
            f"{CALLED.get(x, x)} leaves about the stated share of the error", share)
    yield Claim("share-contradiction", "Fig. 8, Table 5", FOLLOWS, printed(findings.shares_agree),
        "Fig. 8, read as reduced to it, and Table 5 agree on what [11] leaves", paper.TABLE5["SL"])
    yield Claim("share-readings", "Fig. 8, Table 5", FOLLOWS,
        in_settings(one(lambda r: within(
            lambda s: s.left(r["SL"], MEAN) - s.left(r["SL"], RMSE), "share",
            low=paper.TABLE5["SL"].value - sl))),
        "read as reduced to it, both are true since RMSE and mean distance are so different",
        paper.TABLE5["SL"])
    corrected = paper.SYSTEMATIC_CORRECTED
    yield Claim("systematic-corrected", "section 5", SAYS,
        in_settings(lambda r: {
            "at least": within(judges.corrected(r["B"]), "share", low=corrected.value),
            "about": about(judges.corrected(r["B"]), corrected.value)}),
        "the centroid constraint corrects the stated share of the systematic errors, read as the "
        "boresight's: at least so much, or about so much", corrected)
    yield Claim("removes-most", "section 4, Fig. 9", SAYS,
        in_settings(each(PROPOSED,
                         lambda r, x: within(judges.corrected(r[x]), "share", low=0.5))),
        "most of the boresight's error is removed: more than half")
    yield Claim("remainder", "section 5", SAYS,
        over_noise(one(lambda r: judges.vanishes(r["B"], RMSE_TRUTH))),
        "what B leaves comes from the platform and the GNSS/INS: most of its mean square distance "
        "to the true planes vanishes with the trajectory's error")


def _histograms_and_offsets() -> Iterator[Claim]:
    yield Claim("normal", "Fig. 8, section 3.2.3", SAYS,
        in_settings(each(("B", "C"), lambda r, x: judges.normal(r[x]))),
        "point-to-plane distances are almost normal: nearer to a normal distribution than to a "
        "uniform one, by the greatest difference of cumulative shares")
    yield Claim("normal-means-eliminated", "section 3.2.3", SAYS,
        in_settings(each(("B", "C"),
                         lambda r, x: always(judges.not_deceived(r[x], judges.NEAR_NORMAL)))),
        "an almost normal histogram means that systematic errors are gone: where it is one, the "
        "boresight's error lies in its own 95 % region")
    yield Claim("centred", "Fig. 8", FOLLOWS,
        in_settings(each(("B", "C"), lambda r, x: within(
            judges.centred(r[x]), "1", {"true mounting": judges.centred("truth")},
            high=CENTRED_SIGMAS))),
        "point-to-plane distances are centred on zero, in units of what trajectory errors alone "
        "move their mean")
    for id, end, limit in (("offset-calibrated", "", paper.OFFSET_AFTER_CALIBRATION),
                           ("offset-refined", REFINED, paper.OFFSET_AFTER_REFINEMENT)):
        step = "refinement" if end else "calibration"
        yield Claim(id, "Fig. 11, section 4.2", SAYS,
            in_settings(one(lambda r, end=end, limit=limit: _largest_offset(r, end, limit))),
            f"vertical offsets at the virtual points are below the stated bound after {step} by A, "
            "B and C", limit)
    yield Claim("offset-refinement", "Fig. 11", FOLLOWS,
        in_settings(each(PROPOSED, lambda r, x: judges.lower(r[x] + REFINED, r[x], OFFSET))),
        "refinement lowers the vertical offsets")
    yield Claim("offset-below-SL", "Fig. 11, section 4.2", SAYS,
        in_settings(each(PROPOSED, lambda r, x: judges.lower(r[x] + REFINED, r["SL"], OFFSET))),
        "vertical offsets after refinement are below those of [11]")


def _sigmas() -> Iterator[Claim]:
    yield Claim("sigma-expected", "section 3.2.1, Table 4", SAYS, printed(findings.table4_sigma),
        "the sigmas of the boresight are within what the hardware promises")
    yield Claim("sigma-honest", "section 3.2.1, Table 4", FOLLOWS,
        in_settings(each(ALL, lambda r, x: coverage(r[x]))),
        "these sigmas are errors to be expected, to a third: 95 % intervals hold the truth in 86 % "
        "of cases at least")
    yield Claim("sigma-standardised", "section 3.2.1, Table 4", FOLLOWS,
        in_settings(each(ALL, lambda r, x: judges.standardised(r[x]))),
        "errors are no larger than the sigmas say, to a third")
    yield Claim("table4-agreement", "Table 4", FOLLOWS, printed(findings.table4_agreement),
        "A, B and C estimate one boresight, within their sigmas")
    sigma = {key: value.sigma for key, value in paper.TABLE4.items()}
    yield Claim("table4-pattern", "Table 4", FOLLOWS,
        in_settings(lambda r: {
            f"{SYMBOLS[angle]} of {x} over A": within(
                ratio(*(metric(r[y], f"{SIGMA}error_{angle}") for y in (x, "A"))),
                "1", low=sigma[x, angle] / sigma["A", angle] / ABOUT_RATIO,
                high=sigma[x, angle] / sigma["A", angle] * ABOUT_RATIO)
            for x, angle in (("B", "kappa"), ("C", "phi"))}),
        "the sigmas differ between A, B and C as in Table 4: a fourth for yaw in B, five times for "
        "pitch in C")
    yield Claim("unit-normal", "sections 1 and 2.2.3", SAYS, reasoned(
        "the unit length of a normal only says which four numbers describe a plane; boresight and "
        "covariance are the same under any other such choice, so no survey can show it"),
        "the unit length of the normals in [11] limits the propagation of errors")


def _boresight() -> Iterator[Claim]:
    yield Claim("SL-inconsistent", "section 2.2.3", SAYS,
        in_settings(one(lambda r: within(metric(r["SL"], "nees"), "1", low=1.0))),
        "[11] cannot guarantee a consistent estimate from noised clouds: its errors are larger than"
        " its sigmas say")
    yield Claim("SL-follows-noise", "section 3.2.3", SAYS,
        over_noise(one(lambda r: judges.grows(r["SL"], True))),
        "[11] depends on the trajectory's data: its boresight's error grows with the noise")
    yield Claim("error-below-SL", "Abstract", FOLLOWS,
        in_settings(each(PROPOSED, lambda r, x: less(error(r[x]), error(r["SL"]), "deg"))),
        "the boresight is found better than by [11]")
    yield Claim("correct-under-noise", "sections 1 and 4", SAYS,
        in_settings(each(PROPOSED, lambda r, x: always(judges.within_specification(r[x]))),
                    noise=HIGH_NOISE),
        "the angles are guaranteed correct even with a highly noised trajectory, twice the data "
        "sheet's and more: all within the attitude accuracy")
    yield Claim("noise-below-SL", "sections 2.2.3 and 3.2.3", SAYS,
        over_noise(each(PROPOSED, lambda r, x: judges.slower(r[x], r["SL"]))),
        "the boresight depends less on the trajectory's noise than that of [11]")
    yield Claim("noise-only-in-extraction", "section 4", SAYS,
        over_noise(each(PROPOSED, lambda r, x: judges.grows(r[x], False))),
        "noise affects the plane extraction only: the boresight's error does not grow with it")
    yield Claim("better-sensors", "section 4", SAYS,
        over_noise(each(PROPOSED, lambda r, x: judges.grows(r[x], True))),
        "better sensors give better results: the boresight's error grows with the noise")
    yield Claim("vibration", "section 4.1", SAYS,
        in_settings(one(lambda r: less(error(r["C"]), error(r["SL"]), "deg")), errors="vibration"),
        "errors caused by vibration are attenuated: under vibration that the GNSS/INS does not "
        "see, the boresight of C is better than that of [11]")
    yield Claim("refinement-error", "sections 3.2.3, 4.2 and 5", SAYS,
        in_settings(each(PROPOSED, lambda r, x: less(error(r[x] + REFINED), error(r[x]), "deg"))),
        "the refinement improves the boresight")
    yield Claim("refinement-rmse", "sections 3.2.2 and 5", FOLLOWS,
        in_settings(each(PROPOSED, lambda r, x: judges.lower(r[x] + REFINED, r[x], RMSE))),
        "the refinement lowers the RMSE")
    yield Claim("four-planes", "section 2.2.5", SAYS,
        in_settings(one(lambda r: judges.no_worse(
            error(r["C"] + BY_FOUR), error(r["C"]), "deg"))),
        "four matched planes do for the refinement: by any four, C's boresight gets no worse")
    yield Claim("many-orientations", "section 2.2.3", SAYS,
        in_settings(one(lambda r: less(error(AS_MANY), error(ONE_DIRECTION), "deg"))),
        "planes of many orientations are needed: [11] finds the boresight better by them than by "
        "as many of one direction")
    yield Claim("natural-planes", "section 4", SAYS,
        in_settings(one(lambda r: always(judges.within_specification(r["C"]))), errors="natural"),
        "planes of natural terrain, here banks, ditches and dams, give all angles of C within the "
        "attitude accuracy, which roofs do not always either")
    yield Claim("urban", "section 4", SAYS, reasoned(
        "houses of a simulated site stand apart, and no street hides satellites from the GNSS/INS"),
        "the calibration can be arranged in urban areas")
    yield Claim("lever-arm", "section 4", SAYS, reasoned(
        "the paper says so and does not do it; A, B and C as it prints them hold the lever arm; "
        "what D finds of it is a claim of ours"),
        "lever arm and boresight can be estimated together")


def _method() -> Iterator[Claim]:
    yield Claim("unknowns", "section 3.2.2", SAYS,
        in_settings(lambda r: {
            "B, a constant": always(judges.unknowns_follow(r["B"], 0)),
            "C, three for each plane": always(judges.unknowns_follow(r["C"], 3))}),
        "the number of unknowns grows with the matches in C and does not in B")
    yield Claim("planes-not-needed", "sections 4.1 and 5", SAYS,
        in_settings(lambda r: {
            "boresight": judges.no_worse(error(r["B"]), error(r["C"]), "deg"),
            "RMSE": judges.no_worse(metric(r["B"], RMSE), metric(r["C"], RMSE), "m")}),
        "planes need not be estimated: B is no worse than C, by a tenth at most")
    yield Claim("planes-not-needed-time", "section 4.1", SAYS,
        in_settings(one(lambda r: judges.lower(r["B"], r["C"], "seconds", "s"))),
        "B, without planes as unknowns, takes less time than C")
    yield Claim("closed-form", "section 4", SAYS,
        in_settings(each(PROPOSED, lambda r, x: always(
            judges.at_most(metric(r[x], "first_step_in_sigma"), ONE_STEP)))),
        "the solution is of closed form: the first step ends within a hundredth of a sigma of the "
        "last (who was first is not tested)")
    yield Claim("false-before", "section 3.2.1", SAYS,
        in_settings(one(lambda r: judges.mostly(judges.any_false))),
        "before calibration the matching makes false matches, which a hand must remove: ours, "
        "stricter than the printed one, makes one in most surveys")
    yield Claim("matching-automatic", "section 3.2.2", SAYS,
        in_settings(one(lambda r: always(judges.at_most(metric("all", "false_pairs"), 0)))),
        "matching is automatic once the strips are calibrated: no false match is left")
    yield Claim("planes-reliable", "section 3.1", SAYS,
        in_settings(one(lambda r: within(
            ratio(metric("all", "false_views"), metric("all", "views")), "share",
            high=UNRELIABLE))),
        "the extracted planes are highly reliable: of the matched views, one in a hundred at most"
        " is no roof face")
    yield Claim("constraint-reliable", "sections 2.2.3 and 4.1", SAYS,
        in_settings(each(PROPOSED, lambda r, x: judges.mostly_less(
            judges.without_screening(r[x]), judges.without_screening(r["SL"])))),
        "the constraint makes the estimate reliable: with one wrong match, unscreened, the "
        "boresight is better than by [11]; what finds no solution is worse")
    yield Claim("segmentation-slow", "section 5", SAYS,
        in_settings(one(lambda r: less(
            judges.largest(*(metric(r[x], "seconds") for x in PROPOSED)),
            metric(SEGMENTATION, "seconds"), "s"))),
        "the segmentation takes the time: more than the slowest adjustment")
    yield Claim("density", "section 2.1", SAYS,
        in_settings(lambda r: {"below the track": _density("density_below"),
                               "over the swath": _density("density")}),
        "a strip holds about so many points per area", paper.DENSITY)
    yield Claim("small-angle", "Eq. (1)", FOLLOWS,
        in_settings(one(lambda r: within(
            metric("all", "small_angle_shift"), "m", high=paper.RANGE_ACCURACY.value / 3))),
        "the small-angle form does for the boresight: it moves points by less than a third of the "
        "stated range accuracy")
    yield Claim("outliers", "section 4", SAYS, reasoned(
        "the simulated scanner makes no echoes of its own from highly reflective objects"),
        "statistical outlier removal eliminates false objects made by reflections")
    yield Claim("stability", "section 4.1", SAYS, reasoned(
        "no quantity is printed by which the platform's stability could be read off the "
        "constraint"),
        "the constraint tells how stable the platform is")
    yield Claim("stable-platform", "section 5", SAYS, reasoned(
        "the simulated GNSS/INS errs independently of how the platform moves"),
        "a more stable platform reduces systematic errors immensely")
    yield Claim("planarity", "section 4", SAYS, reasoned(
        "it is said of the method's idea; every condition of it needs a plane"),
        "planarity is not central to the method")
    yield Claim("others", "section 1", SAYS, reasoned(
        "other methods than [11] are not made here"),
        "methods that take single points or lines are slower, those without a trajectory fast but "
        "less accurate")
    yield Claim("applications", "section 4, Fig. 10", SAYS, reasoned(
        "no figure of it is stated; notebook 10 shows what a stand's ground and a house have"),
        "clouds of a forest and of a house have a high positional accuracy")


def _ours() -> Iterator[Claim]:
    sigmas, match = "beside section 3.2.1", "beside section 2.2.4"
    yield Claim("ours-coverage-D", sigmas, OURS, in_settings(one(lambda r: coverage("D"))),
        "D, trajectory errors estimated as a Gauss-Markov process, has honest sigmas where they "
        "are of that process, to a third: 95 % intervals hold the truth in 86 % at least")
    yield Claim("ours-standardised-D", sigmas, OURS,
        in_settings(one(lambda r: judges.standardised("D"))),
        "errors of D are no larger than its sigmas say, to a third")
    kinds = tuple(kind for kind in ERRORS if kind != SPECIFIED)
    yield Claim("ours-coverage-kinds", sigmas, OURS, under_kinds(coverage(FOUND), kinds),
        "D as calibrate runs it, told the data sheet (of a smoother its own sigmas), has sigmas "
        "that are not too small, to a third, under errors of kinds that it was not told")
    yield Claim("ours-wrong-prior", sigmas, OURS,
        in_settings(lambda r: {f"× {k:g}": coverage(mistaken_name(k)) for k in (2.0, 0.5)}, "mount",
                    noise=1.0),
        "with the GNSS/INS specification wrong by a factor of two and variance components "
        "estimated, D's 95 % intervals hold the truth, wide as they may be")
    yield Claim("ours-bound-D", sigmas, OURS,
        in_settings(one(lambda r: judges.near_bound("D", NEAR_BOUND))), "no unbiased estimate from "
        "the same points could be much better than D: errors within 15 % of the Cramer-Rao bound")
    yield Claim("ours-error-D", "beside the Abstract", OURS,
        in_settings(each(ALL, lambda r, x: less(error("D"), error(r[x]), "deg"))),
        "D finds the boresight better than [11], A, B and C")
    yield Claim("ours-few-honest", sigmas, OURS,
        in_settings(each(("SL", "B", "C"), lambda r, x: judges.mostly_less(
            metric(FEW[x], "nees"), metric(MANY[x], "nees")))),
        "a formal sigma measures how many conditions were posed: with few points a face errors are "
        "fewer sigmas than with all")
    yield Claim("ours-not-the-constraint", sigmas, OURS,
        in_settings(one(lambda r: judges.no_worse(
            metric(FEW["SL"], "nees"), metric(FEW["A"], "nees"), "1"))),
        "it is not the centroid constraint that does it: [11] with as few points errs by no more "
        "of its sigmas than A")
    yield Claim("ours-listed-pairs", "beside Table 1", OURS,
        in_settings(one(lambda r: judges.mostly_less(
            metric(LISTED_PAIRS, "nees"), metric("A", "nees")))),
        "with the strip pairs of Table 1 alone, A's errors are fewer of its sigmas than with all")
    yield Claim("ours-per-pair", "beside section 2.2.5", OURS,
        in_settings(one(lambda r: less(
            error(FEW["C"] + REFINED), error(FEW["C"] + PER_PAIR), "deg"))),
        "the joint refinement of all pairs of strips is better than the mean of each pair's own")
    yield Claim("ours-screened", match, OURS,
        in_settings(each(ALL, lambda r, x: always(judges.unharmed(FEW[x])))),
        "one wrong match does no harm after screening")
    yield Claim("ours-lever-arm", "beside section 4", OURS,
        in_settings(one(lambda r: always(judges.lever_arm_found))),
        "D finds both horizontal parts of the lever arm to half of what a tape gives")
    kept, now = (ratio(metric(x, "rms_3d"), metric(TRUTH, "rms_3d")) for x in (FOUND, ADJUSTED))
    yield Claim("ours-trajectory", "beside section 5", OURS,
        in_settings(lambda r: {
            "median": judges.median(now, MEDIAN_LEFT, "1", {"by D's mounting alone": kept}),
            "each": always(judges.at_most(now, MOST_LEFT))}, "mount", noise=1.0),
        "of the 3D error that no mounting removes, the trajectory's, D removes a part: mounting and"
        " trajectory of D leave at most 0.6 times that of the true mounting under the trajectory as"
        " reported in the median, and 0.8 times in each survey")
    covered = {w: metric(ADJUSTED, f"covered_{w}") for w in ("observed", "gaps")}
    yield Claim("ours-corrections", sigmas, OURS,
        in_settings(lambda r: {
            w: within(covered[w], "share", **COVERED[w]) for w in covered}, "mount", noise=1.0),
        "the sigmas of D's corrections of the trajectory hold: their 95 % intervals hold the truth "
        "at 90 to 99 % of observed times, and at 88 % at least in gaps")
    yield Claim("ours-completes", sigmas, OURS,
        in_settings(each((*ALL, "D"), lambda r, x: always(judges.completes(r.get(x, x))))),
        "every estimator gives a result in every survey")


# fmt: on


def _density(name: str) -> Judge:
    return about(metric("all", name), paper.DENSITY.value, None, ABOUT_DENSITY, "1/m2")


def _largest_offset(reading: Reading, ending: str, limit: paper.Published) -> Judge:
    worst = judges.largest(*(metric(reading[x] + ending, OFFSET_MAX) for x in PROPOSED))
    others = {"before": "before", "with [11]": reading["SL"], "with the true mounting": "truth"}
    beside = {words: metric(name, OFFSET_MAX) for words, name in others.items()}
    return within(worst, "m", beside, high=limit.value)


CLAIMS: tuple[Claim, ...] = (
    *_rmse(), *_shares(), *_histograms_and_offsets(), *_sigmas(), *_boresight(), *_method(),
    *_ours(),
)  # fmt: skip


# The ledger


def ledger(rows: pd.DataFrame) -> pd.DataFrame:
    """Judge every claim.

    Parameters
    ----------
    rows : DataFrame
        Tidy rows of a study, with the columns of `paperrepro.study.rows.COLUMNS`.

    Returns
    -------
    DataFrame
        A line for each of `CLAIMS`, in their order, with the columns `COLUMNS`; ``measured``,
        ``low`` and ``high`` in ``unit`` are those of the first setting.
    """
    evidence = Evidence(rows)
    return pd.DataFrame([claim.line(evidence) for claim in CLAIMS], columns=list(COLUMNS))
