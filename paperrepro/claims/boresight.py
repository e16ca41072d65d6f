"""What the paper claims of the boresight and of the method, and what stands beside it of ours."""

from paperrepro.claims.claim import Claim, called, ours, valued
from paperrepro.claims.honesty import (
    coverage,
    lever_arm_found,
    near_bound,
    standardised,
    unharmed,
    within_specification,
    without_screening,
)
from paperrepro.claims.judges import (
    always,
    at_most,
    below,
    error,
    grows,
    less,
    metric,
    mostly_less,
    near,
    no_worse,
    steeper,
)
from paperrepro.claims.printed import table4_agreement, table4_sigma
from paperrepro.claims.verdicts import never, over_noise, over_settings
from paperrepro.published import DENSITY, RANGE_ACCURACY
from paperrepro.study import REFINED, mistaken_name

PROPOSED = ("A", "B", "C")
ALL = ("SL", *PROPOSED)
RMSE = "rmse_reference"
#: "About 300 points/m²" is met within this.
ABOUT_DENSITY = 50.0

PRECISION = [
    Claim(
        "table4-agreement", "A, B and C estimate one boresight, within their sigmas", "Table 4",
        table4_agreement, kind="pattern", headline=True,
    ),
    Claim(
        "table4-sigma", "the printed sigmas lie within what the GNSS/INS promises",
        "section 3.2.1", table4_sigma, kind="pattern",
    ),
    *(
        Claim(
            f"coverage-{name}", f"the sigmas of {called(name)} are honest: 95 % intervals hold "
            "the truth", "section 3.2.1", over_settings(coverage(name)), kind="pattern",
            headline=name != "C",
        )
        for name in ALL
    ),
    *(
        Claim(
            f"standardised-{name}", f"errors of {called(name)} are as large as their sigmas",
            "section 3.2.1", over_settings(standardised(name)), kind="pattern",
        )
        for name in ALL
    ),
]  # fmt: skip

ERRORS = [
    Claim(
        f"error-{name}-below-SL", f"{name} finds the boresight better than [11]", "Abstract",
        over_settings(less(error(name), error("SL"), "deg")), kind="ordering", headline=True,
    )
    for name in PROPOSED
]  # fmt: skip

NOISE = [
    claim
    for name in PROPOSED
    for claim in (
        Claim(
            f"noise-{name}-below-SL", f"{name} is less sensitive to trajectory noise than [11]",
            "section 2.2.3", over_noise(steeper(name, "SL")), headline=name == "B",
        ),
        Claim(
            f"correct-under-noise-{name}", f"{name} is correct even with a highly noised "
            "trajectory: all angles within the attitude accuracy", "section 4",
            over_settings(always(within_specification(name))),
        ),
        Claim(
            f"noise-only-in-extraction-{name}", "noise affects the plane extraction only: the "
            f"error of {name} does not grow with it", "section 4", over_noise(grows(name, False)),
        ),
        Claim(
            f"better-sensors-{name}", f"better sensors improve {name}", "section 4",
            over_noise(grows(name, True)),
        ),
    )
]  # fmt: skip

REFINEMENT = [
    claim
    for name in PROPOSED
    for claim in (
        Claim(
            f"refinement-error-{name}", f"refinement improves the boresight of {name}",
            "section 4.2", over_settings(less(error(name + REFINED), error(name), "deg")),
            kind="ordering", headline=name == "C",
        ),
        Claim(
            f"refinement-rmse-{name}", f"refinement lowers the RMSE of {name}", "section 4.2",
            over_settings(less(metric(name + REFINED, RMSE), metric(name, RMSE), "m")),
            kind="ordering",
        ),
    )
]  # fmt: skip

PLANES = [
    Claim(
        "planes-not-needed-error", "planes need not be estimated: B's boresight is no worse than "
        "C's", "section 4.1", over_settings(no_worse(error("B"), error("C"), "deg")),
        headline=True,
    ),
    Claim(
        "planes-not-needed-rmse", "planes need not be estimated: B's RMSE is no worse than C's",
        "section 4.1", over_settings(no_worse(metric("B", RMSE), metric("C", RMSE), "m")),
    ),
    Claim(
        "planes-not-needed-time", "B, without planes as unknowns, takes less time than C",
        "section 4.1", over_settings(less(metric("B", "seconds"), metric("C", "seconds"), "s")),
        kind="ordering",
    ),
]  # fmt: skip

MATCHING = [
    Claim(
        "matching-automatic", "matching is automatic once the strips are calibrated: no false "
        "match is left", "section 3.2.2",
        over_settings(always(at_most("all", "false_pairs", 0))), headline=True,
    ),
    Claim(
        "matching-unscreened", "nor does one have to be removed", "section 3.2.2",
        over_settings(always(at_most("all", "rejected", 0))),
    ),
    *(
        Claim(
            f"wrong-match-{name}-below-SL", f"with one wrong match and no screening, {name} is "
            "better than [11]: the constraint is the more reliable one", "section 2.2.3",
            over_settings(mostly_less(without_screening(name), without_screening("SL"))),
            kind="ordering",
        )
        for name in PROPOSED
    ),
]  # fmt: skip

METHOD = [
    valued(
        "density-below", "a strip holds about so many points per area, below the track", DENSITY,
        over_settings(near(metric("all", "density_below"), DENSITY.value, ABOUT_DENSITY, "1/m2")),
    ),
    valued(
        "density-mean", "a strip holds about so many points per area, over its whole swath",
        DENSITY,
        over_settings(near(metric("all", "density"), DENSITY.value, ABOUT_DENSITY, "1/m2")),
    ),
    Claim(
        "small-angle", "the small-angle form does for the boresight: it moves points by less than "
        "a third of the range noise", "Eq. (1)",
        over_settings(below(metric("all", "small_angle_shift"), RANGE_ACCURACY.value / 3, "m")),
    ),
    Claim(
        "closed-form", "the solution is of closed form, the first of its kind: B needs one step "
        "(who was first is not tested)", "section 4",
        over_settings(always(at_most("B", "iterations", 1))), headline=True,
    ),
    Claim(
        "lever-arm", "lever arm and boresight can be estimated together (the paper leaves it to "
        "later work): D finds both horizontal parts to half of what a tape gives", "section 4",
        over_settings(always(lever_arm_found)),
    ),
    Claim(
        "natural-planes", "planes of natural terrain do instead of roofs", "section 4",
        never("the simulated farm offers roofs only; level ground cannot show a turn in yaw"),
    ),
    Claim(
        "vibration", "errors caused by vibration of the platform are attenuated", "section 4.1",
        never(
            "vibration is part of the simulated motion and the GNSS/INS sees it: no error comes "
            "from it alone"
        ),
    ),
]  # fmt: skip

OURS = [
    ours(
        "ours-coverage-D", "D, trajectory errors estimated as a Gauss-Markov process, has honest "
        "sigmas: 95 % intervals hold the truth", "beside section 3.2.1",
        over_settings(coverage("D")), headline=True,
    ),
    ours(
        "ours-standardised-D", "errors of D are as large as their sigmas", "beside section 3.2.1",
        over_settings(standardised("D")),
    ),
    ours(
        "ours-bound-D", "no unbiased estimate from the same points could be much better than D: "
        "errors within 15 % of the Cramer-Rao bound", "beside section 3.2.1",
        over_settings(near_bound("D", 1.15)),
    ),
    *(
        claim
        for factor in (2.0, 0.5)
        for claim in (
            ours(
                f"ours-wrong-prior-{factor:g}-coverage", "with the GNSS/INS specification wrong by "
                f"a factor of {factor:g} and variance components estimated, D's 95 % intervals "
                "hold the truth", "beside section 3.2.1",
                over_settings(coverage(mistaken_name(factor)), preset="mount"),
            ),
            ours(
                f"ours-wrong-prior-{factor:g}-standardised", "and its errors are as large as its "
                f"sigmas (factor {factor:g})", "beside section 3.2.1",
                over_settings(standardised(mistaken_name(factor)), preset="mount"),
            ),
        )
    ),
    *(
        ours(
            f"ours-error-D-below-{name}", f"D finds the boresight better than {called(name)}",
            "beside the Abstract", over_settings(less(error("D"), error(name), "deg")),
            headline=name == "SL",
        )
        for name in ALL
    ),
    ours(
        "ours-A-more-honest", "the centroid constraint's merit is honest sigmas: errors of A are "
        "fewer of its sigmas than those of [11]", "beside section 3.2.1",
        over_settings(mostly_less(metric("A", "nees"), metric("SL", "nees"))), headline=True,
    ),
    *(
        ours(
            f"ours-wrong-match-{name}", f"one wrong match does no harm to {called(name)}",
            "beside section 2.2.4", over_settings(always(unharmed(name, screened=False))),
        )
        for name in ALL
    ),
    *(
        ours(
            f"ours-screened-{name}", f"one wrong match does no harm to {called(name)} after "
            "screening", "beside section 2.2.4",
            over_settings(always(unharmed(name, screened=True))), headline=name == "B",
        )
        for name in ALL
    ),
    *(
        ours(
            f"ours-completes-{name}", f"{called(name)} gives a result in every survey",
            "beside section 3.2.1",
            over_settings(always(lambda s, name=name: (~s.failed(name)).astype(float))),
        )
        for name in (*ALL, "D")
    ),
]  # fmt: skip

CLAIMS = [*PRECISION, *ERRORS, *NOISE, *REFINEMENT, *PLANES, *MATCHING, *METHOD, *OURS]
