"""What the paper claims of histograms, of vertical offsets, and of doing without control."""

from paperrepro.claims.claim import STATEMENT, Claim, called, valued
from paperrepro.claims.honesty import centred, critical_ks, critical_ks_of_points, not_deceived
from paperrepro.claims.judges import (
    Beside,
    Quantity,
    always,
    below,
    error,
    largest,
    less,
    metric,
)
from paperrepro.claims.verdicts import over_settings
from paperrepro.published import OFFSET_AFTER_CALIBRATION, OFFSET_AFTER_REFINEMENT
from paperrepro.study import REFINED

#: A mean further from zero than so many honest sigmas is a systematic error.
CENTRED_SIGMAS = 1.96
OFFSET_MAX = "offset_max_reference"


def _shape(name: str) -> Beside:
    """What a KS distance is read with."""
    return {
        "skewness": metric(name, "skewness_reference"),
        "excess kurtosis": metric(name, "kurtosis_reference"),
        "limit if every point were a sample": critical_ks_of_points,
    }


HISTOGRAMS = [
    claim
    for name in ("SL", "B", "C")
    for claim in (
        Claim(
            f"normal-{name}", f"point-to-plane distances of {called(name)} are near normal",
            "Fig. 8", over_settings(
                below(metric(name, "ks_reference"), critical_ks, "1", _shape(name))
            ),
            kind="pattern", headline=name == "B",
        ),
        Claim(
            f"centred-{name}",
            f"point-to-plane distances of {called(name)} are centred on zero, in units of what "
            "trajectory errors alone move their mean", "Fig. 8",
            over_settings(
                below(centred(name), CENTRED_SIGMAS, "1", {"true mounting": centred("truth")})
            ), kind="pattern",
        ),
    )
] + [
    Claim(
        f"normal-means-eliminated-{name}", f"a near normal histogram of {name} means that the "
        "boresight's error is gone", "section 3.2.3", over_settings(always(not_deceived(name))),
        headline=name == "C",
    )
    for name in ("B", "C")
]  # fmt: skip


def _offset(scenario: str) -> Quantity:
    return metric(scenario, "offset_mean_reference")


_CALIBRATED = largest(*(metric(name, OFFSET_MAX) for name in "ABC"))
_OTHER_OFFSETS = {
    "before": metric("before", OFFSET_MAX), "with [11]": metric("SL", OFFSET_MAX),
    "with the true mounting": metric("truth", OFFSET_MAX),
}  # fmt: skip
_REFINED = largest(*(metric(name + REFINED, OFFSET_MAX) for name in "ABC"))
OFFSETS = [
    valued(
        "offset-calibrated", "vertical offsets at the virtual points are small after calibration "
        "by A, B and C", OFFSET_AFTER_CALIBRATION,
        over_settings(
            below(_CALIBRATED, OFFSET_AFTER_CALIBRATION.value, "m", _OTHER_OFFSETS)
        ), headline=True,
    ),
    valued(
        "offset-refined", "and smaller after refinement", OFFSET_AFTER_REFINEMENT,
        over_settings(below(_REFINED, OFFSET_AFTER_REFINEMENT.value, "m", _OTHER_OFFSETS)),
        headline=True,
    ),
    *(
        Claim(
            f"offset-{name}-refinement-helps", f"refinement lowers the vertical offsets of {name}",
            "Fig. 11",
            over_settings(less(_offset(name + REFINED), _offset(name), "m")),
            kind="ordering",
        )
        for name in "ABC"
    ),
    *(
        Claim(
            f"offset-{name}-below-SL", f"vertical offsets of {name}, refined, below [11]'s",
            "Fig. 11",
            over_settings(less(_offset(name + REFINED), _offset("SL"), "m")),
            kind="ordering",
        )
        for name in "ABC"
    ),
]  # fmt: skip

NO_CAMPAIGN = [
    Claim(
        f"no-campaign-{name}", f"{name} lowers the boresight's error without control on the "
        "ground", "section 2.2.3", over_settings(less(error(name), error("before"), "deg")),
        kind=STATEMENT,
    )
    for name in "ABC"
]  # fmt: skip

CLAIMS = [*HISTOGRAMS, *OFFSETS, *NO_CAMPAIGN]
