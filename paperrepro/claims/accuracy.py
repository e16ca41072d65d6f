"""What the paper claims of the RMSE, and of the share of the errors that is left."""

from paperrepro.claims.claim import Claim, called, valued
from paperrepro.claims.honesty import (
    over_floor,
)
from paperrepro.claims.judges import (
    MARGIN,
    Beside,
    above,
    below,
    left,
    less,
    metric,
    near,
    reduced,
    similar,
)
from paperrepro.claims.printed import error_budget, shares_agree
from paperrepro.claims.verdicts import over_settings
from paperrepro.published import (
    RMSE_LEFT_BY_SL,
    RMSE_REDUCTION,
    SYSTEMATIC_CORRECTED,
    TABLE5,
)
from paperrepro.study import REFINED

#: Values printed as "about so many percent" are met within this.
ABOUT = 0.1
RMSE, RMSE_TRUTH = "rmse_reference", "rmse_truth"

#: What even the true mounting would reach, to be read beside a method's share.
GAINED = {"the true mounting gains": reduced("truth", RMSE)}


def _left_at_best(measure: str) -> Beside:
    return {"the true mounting leaves": left("truth", measure)}


def _rmse(name: str) -> list[Claim]:
    """Share of the RMSE that B or C removes, calibrated and refined."""
    limit, refined = RMSE_REDUCTION[name], name + REFINED
    return [
        valued(
            f"rmse-reduction-{name}",
            f"{name} lowers the RMSE against the reference by more than the stated share",
            limit, over_settings(above(reduced(name, RMSE), limit.value, "share", GAINED)),
            headline=True,
        ),
        valued(
            f"rmse-reduction-{name}-refined",
            f"{name} and refinement lower the RMSE by more than the stated share",
            limit, over_settings(above(reduced(refined, RMSE), limit.value, "share", GAINED)),
        ),
        Claim(
            f"rmse-{name}-below-SL", f"RMSE of {name} below that of [11]", "Fig. 7",
            over_settings(less(metric(name, RMSE), metric("SL", RMSE), "m")),
            kind="ordering", headline=True,
        ),
        Claim(
            f"rmse-truth-{name}-below-SL",
            f"RMSE of {name} below that of [11], against the true planes", "Fig. 7",
            over_settings(less(metric(name, RMSE_TRUTH), metric("SL", RMSE_TRUTH), "m")),
            kind="ordering",
        ),
        Claim(
            f"rmse-{name}-below-A", f"RMSE of {name} below that of A", "Fig. 6",
            over_settings(less(metric(name, RMSE), metric("A", RMSE), "m")), kind="ordering",
        ),
    ]  # fmt: skip


BUDGET = [
    valued(
        "budget-printed", "boresights as large as Table 4's explain so large a fall of the RMSE",
        RMSE_REDUCTION["C"], error_budget, place="Table 4, Fig. 7", headline=True,
    ),
    valued(
        "budget-table4", "with Table 4's boresight, even the true mounting lowers the RMSE so far",
        RMSE_REDUCTION["C"],
        over_settings(
            above(reduced("truth", RMSE_TRUTH), RMSE_REDUCTION["C"].value, "share"), "table4"
        ),
        place="Table 4, Fig. 7",
    ),
]  # fmt: skip

ORDER = [
    *_rmse("B"),
    *_rmse("C"),
    Claim(
        "rmse-C-below-B", "the RMSE of C, both constraints together, is slightly below B's",
        "Fig. 7", over_settings(less(metric("C", RMSE), metric("B", RMSE), "m")), kind="ordering",
    ),
    Claim(
        "rmse-B-like-C", "B and C perform alike", "Fig. 6",
        over_settings(similar(metric("B", RMSE), metric("C", RMSE), "m")),
    ),
    Claim(
        "SL-alone", "[11] alone does not do for UAV data: its RMSE stays above the noise floor",
        "section 5", over_settings(above(over_floor("SL"), 1 + MARGIN, "1")), headline=True,
    ),
    Claim(
        "constraint-brings-most", "most of the gain comes from the centroid constraint: [11] "
        "alone gains less than half of what B does", "section 3.2.3",
        over_settings(
            below(
                lambda s: (s.of("before", RMSE) - s.of("SL", RMSE))
                / (s.of("before", RMSE) - s.of("B", RMSE)).mean(), 0.5, "share",
            ), "mount",
        ),
    ),
]  # fmt: skip

SHARES = [
    valued(
        "rmse-left-SL", "[11] leaves less than the stated share of the RMSE", RMSE_LEFT_BY_SL,
        over_settings(
            below(left("SL", RMSE), RMSE_LEFT_BY_SL.value, "share", _left_at_best(RMSE))
        ),
    ),
    *(
        valued(
            f"table5-{reading}-{name}",
            f"{called(name)} leaves about the stated share of the error, read as {words}",
            TABLE5[key],
            over_settings(
                near(
                    left(name, measure), TABLE5[key].value, ABOUT, "share", _left_at_best(measure)
                )
            ),
            headline=reading == "rmse",
        )
        for name, key in {"SL": "SL", "B": "proposed"}.items()
        for reading, measure, words in (
            ("rmse", RMSE, "RMSE"), ("mean", "mae_reference", "mean absolute distance")
        )
    ),
    valued(
        "share-contradiction", "Fig. 8 and Table 5 agree on the share that [11] leaves",
        TABLE5["SL"], shares_agree, place="Fig. 8, Table 5", headline=True,
    ),
    valued(
        "share-readings", "RMSE and mean distance are different enough for both to be true",
        TABLE5["SL"],
        over_settings(
            above(
                lambda s: s.left("SL", "mae_reference") - s.left("SL", RMSE),
                TABLE5["SL"].value - RMSE_LEFT_BY_SL.value, "share",
            )
        ),
        place="Fig. 8, Table 5",
    ),
    valued(
        "systematic-corrected", "the centroid constraint corrects about the stated share of the "
        "systematic error, read as the boresight's", SYSTEMATIC_CORRECTED,
        over_settings(
            near(
                lambda s: 1 - s.error("B") / s.error("before"), SYSTEMATIC_CORRECTED.value,
                ABOUT, "share",
            )
        ),
    ),
]  # fmt: skip

CLAIMS = [*BUDGET, *ORDER, *SHARES]
