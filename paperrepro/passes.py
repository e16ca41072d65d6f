"""Find planes, adjust, find again: passes until the boresight no longer changes.

A boresight error of a degree makes a roof 18 cm thick within one strip and sets opposite strips a
metre apart. Planes are found by wide thresholds first, and by narrow ones once that is mended.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from paperrepro.adjustment import scenarios
from paperrepro.adjustment.matched import MatchedFaces
from paperrepro.adjustment.screening import screen
from paperrepro.errors import NoConvergence
from paperrepro.survey import Mounting, Survey

#: What tells an onlooker how far the work is: it is given a sentence for each step.
Progress = Callable[[str], None]


def silent(words: str) -> None:
    """Tell nobody."""


def settle(
    survey: Survey,
    find: Callable[[Mounting, Any], Any],
    steps: Sequence[Any],
    max_passes: int,
    settled_deg: float | Callable[[Any, np.ndarray], np.ndarray],
    progress: Progress = silent,
) -> Any:
    """What ``find(mounting, step)`` finds under the boresight on which the passes settle.

    One pass for each of ``steps``, the last one repeated until the boresight changes by less than
    ``settled_deg``, a number or a function of what was found and the boresight. What is found is a
    dataclass that has the faces ``matched`` and takes the ``boresights`` (passes + 1, 3) rad, as
    the passes went. Raises `NoConvergence`, and what the adjustment raises.
    """
    mounting, boresights = survey.mounting, [survey.mounting.boresight]
    for number in range(max_passes):
        last = number >= len(steps) - 1
        found = find(mounting, steps[-1] if last else steps[number])
        boresights.append(_boresight(replace(survey, mounting=mounting), found.matched))
        change = np.rad2deg(np.abs(boresights[-1] - boresights[-2]))
        words = f"{found.matched.n_planes} planes, change {change.max():.3f}°"
        progress(f"pass {number + 1}: {words}")
        limit = settled_deg(found, boresights[-1]) if callable(settled_deg) else settled_deg
        if last and (change < limit).all():
            return replace(found, boresights=np.array(boresights))
        mounting = mounting.with_calibration(boresights[-1])
    raise NoConvergence(
        f"the planes did not settle in {max_passes} passes, last change {change.max():.3f} deg "
        f"(limit {np.max(limit):.3f} deg); look for wrong matches, or start closer to the mounting"
    )


def _boresight(survey: Survey, matched: MatchedFaces) -> np.ndarray:
    """(3,) rad by SL, without the faces that miss their plane; where coarse planes keep SL from
    converging, that on which the faces agree."""
    screening = screen(survey, matched)
    matched = matched.subset(screening.kept) if screening.rejected else matched
    try:
        return scenarios.calibrate(survey, matched, "SL", screening.boresight).boresight
    except NoConvergence:
        return screening.boresight
