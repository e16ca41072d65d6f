"""Findings that follow from the paper's printed numbers alone, without any survey."""

import itertools

import numpy as np
from scipy import stats

from paperrepro.claims.evidence import CONFIDENCE, Evidence
from paperrepro.claims.verdicts import Finding, fixed, shown
from paperrepro.published import (
    ATTITUDE_ACCURACY,
    HEIGHT,
    RANGE_ACCURACY,
    RMSE_LEFT_BY_SL,
    RMSE_REDUCTION,
    TABLE4,
    TABLE5,
)
from paperrepro.tables import ANGLES

SYMBOLS = {"omega": "Δω", "phi": "Δφ", "kappa": "Δκ"}
SCENARIOS = ("A", "B", "C")


def error_budget(evidence: Evidence) -> Finding:
    """The largest reduction of the RMSE that Table 4's boresights allow: a point at the flying
    height moves by d, and what stays is the range noise, so 1 - s / sqrt(s² + d²) at most."""
    turned = {name: _size([TABLE4[name, angle].value for angle in ANGLES]) for name in SCENARIOS}
    name = max(turned, key=turned.get)
    moved = HEIGHT.value * np.deg2rad(turned[name])
    most = 1 - RANGE_ACCURACY.value / np.hypot(RANGE_ACCURACY.value, moved)
    words = (
        f"scenario {name}'s {shown(turned[name], 'deg')} moves a point "
        f"{HEIGHT.value:g} m away by {shown(moved, 'm')}, the range noise is "
        f"{shown(RANGE_ACCURACY.value, 'm')}: at most {shown(most, 'share')} can be gained"
    )
    return fixed(most, "1", most > RMSE_REDUCTION[name].value, words)


def table4_agreement(evidence: Evidence) -> Finding:
    """The largest difference between two scenarios' angles, in their combined sigma; the limit is
    that of all comparisons together."""
    lines = []
    for (one, other), angle in itertools.product(itertools.combinations(SCENARIOS, 2), ANGLES):
        a, b = TABLE4[one, angle], TABLE4[other, angle]
        difference, sigma = abs(a.value - b.value), np.hypot(a.sigma, b.sigma)
        words = f"{SYMBOLS[angle]} of {one} and {other} by {difference / sigma:.1f} σ"
        detail = f" ({shown(difference, 'deg')}, σ {shown(sigma, 'deg')})"
        lines.append((difference / sigma, words, detail))
    lines.sort(reverse=True)
    alone = stats.norm.ppf(0.5 + CONFIDENCE / 2)
    together = stats.norm.ppf(1 - (1 - CONFIDENCE) / 2 / len(lines))
    apart = [words + detail for size, words, detail in lines if size > alone]
    words = (
        f"apart: {', '.join(apart) or 'none'}; limit {together:.2f} σ "
        f"for the largest of {len(lines)}"
    )
    return fixed(lines[0][0], "1", lines[0][0] <= together, words)


def table4_sigma(evidence: Evidence) -> Finding:
    """The largest formal sigma of Table 4 in units of the attitude accuracy of its axis."""
    share = {key: value.sigma / ATTITUDE_ACCURACY[key[1]].value for key, value in TABLE4.items()}
    name, angle = max(share, key=share.get)
    words = (
        f"largest share: {SYMBOLS[angle]} of {name}, {shown(TABLE4[name, angle].sigma, 'deg')} "
        f"of {shown(ATTITUDE_ACCURACY[angle].value, 'deg')}; whether errors are that small is "
        "another claim"
    )
    return fixed(share[name, angle], "1", share[name, angle] <= 1, words)


def shares_agree(evidence: Evidence) -> Finding:
    """Whether the share that [11] leaves is the same in Fig. 8 and Table 5."""
    ratio = TABLE5["SL"].value / RMSE_LEFT_BY_SL.value
    words = (
        f"{TABLE5['SL'].place} leaves {shown(TABLE5['SL'].value, 'share')}, "
        f"{RMSE_LEFT_BY_SL.place} less than {shown(RMSE_LEFT_BY_SL.value, 'share')}: "
        f"{ratio:.1f} times as much"
    )
    return fixed(ratio, "1", ratio <= 1, words)


def _size(angles) -> float:
    return float(np.sqrt(np.sum(np.square(angles))))
