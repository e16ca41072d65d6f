"""What follows from the paper's printed numbers alone, without any survey."""

import itertools

import numpy as np
from scipy import stats

from paperrepro.frames import ANGLES
from paperrepro.paper import published as paper
from paperrepro.paper.numbers import SYMBOLS, shown
from paperrepro.paper.verdicts import Finding, fixed
from paperrepro.study.statistics import CONFIDENCE

#: The paper's scenarios.
PROPOSED = ("A", "B", "C")


def error_budget() -> Finding:
    """The largest reduction of the RMSE that Table 4's boresights allow: a point at the flying
    height moves by d, and what stays is the range's accuracy, so 1 - s / sqrt(s² + d²) at most."""
    angles = {x: [paper.TABLE4[x, angle].value for angle in ANGLES] for x in PROPOSED}
    turned = {x: np.linalg.norm(each) for x, each in angles.items()}
    name = max(turned, key=turned.get)
    moved = paper.HEIGHT.value * np.deg2rad(turned[name])
    most = 1 - paper.RANGE_ACCURACY.value / np.hypot(paper.RANGE_ACCURACY.value, moved)
    words = (
        f"scenario {name}'s {shown(turned[name], 'deg')} moves a point "
        f"{paper.HEIGHT.value:g} m away by {shown(moved, 'm')}, the stated range accuracy is "
        f"{shown(paper.RANGE_ACCURACY.value, 'm')}: at most {shown(most, 'share')} can be gained"
    )
    return fixed(most, most > paper.RMSE_REDUCTION[name].value, words, "share")


def table4_agreement() -> Finding:
    """The largest difference between two scenarios' angles, in their combined sigma; the limit is
    that of all comparisons together."""
    lines = []
    for (one, other), angle in itertools.product(itertools.combinations(PROPOSED, 2), ANGLES):
        a, b = paper.TABLE4[one, angle], paper.TABLE4[other, angle]
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
    return fixed(lines[0][0], lines[0][0] <= together, words)


def table4_sigma() -> Finding:
    """The largest formal sigma of Table 4 in units of the attitude accuracy of its axis."""
    promised = {angle: value.value for angle, value in paper.ATTITUDE_ACCURACY.items()}
    share = {key: value.sigma / promised[key[1]] for key, value in paper.TABLE4.items()}
    name, angle = max(share, key=share.get)
    sigma = shown(paper.TABLE4[name, angle].sigma, "deg")
    words = (
        f"largest share: {SYMBOLS[angle]} of {name}, {sigma} of {shown(promised[angle], 'deg')}; "
        "whether errors are that small is another claim"
    )
    return fixed(share[name, angle], share[name, angle] <= 1, words)


def shares_agree() -> Finding:
    """Whether the share that [11] leaves is the same in Fig. 8 and Table 5."""
    one, other = paper.TABLE5["SL"], paper.RMSE_LEFT_BY_SL
    ratio = one.value / other.value
    words = (
        f"{one.place} leaves {shown(one.value, 'share')}, {other.place} less than "
        f"{shown(other.value, 'share')}: {ratio:.1f} times as much"
    )
    return fixed(ratio, ratio <= 1, words)
