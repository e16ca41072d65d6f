"""What only the truth can tell of a method's output: labels, false matches, recall, true planes.

Takes plain arrays, so that nothing here depends on the method.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data_synth.simulation import Truth
from paperrepro.survey import Survey


@dataclass(frozen=True)
class ViewTruth:
    """Truth of V faces as seen: ``label`` (V,) of the gable face that most points of a view lie on,
    -1 for anything else, and ``purity`` (V,), their share."""

    label: np.ndarray
    purity: np.ndarray


def judge_views(survey: Survey, truth: Truth, views: Sequence[tuple[str, np.ndarray]]) -> ViewTruth:
    """``views`` are (strip, indices into the strip)."""
    of_strip = {
        strip.name: labels for strip, labels in zip(survey.strips, truth.labels, strict=True)
    }
    label, purity = [], []
    for strip, index in views:
        values, counts = np.unique(of_strip[strip][index], return_counts=True)
        label.append(values[counts.argmax()])
        purity.append(counts.max() / counts.sum())
    return ViewTruth(np.array(label, int), np.array(purity))


def false_pairs(views: ViewTruth, pairs: np.ndarray) -> np.ndarray:
    """Those of ``pairs`` (P, 2), indices of views, that do not show one and the same gable face."""
    one, other = views.label[pairs[:, 0]], views.label[pairs[:, 1]]
    return pairs[(one != other) | (one < 0)]


def true_planes(truth: Truth, label: np.ndarray) -> np.ndarray:
    """Planes (G, 4) as (n, d) of the faces ``label`` (G,), NaN rows for -1."""
    planes = {face.id: [*face.normal, face.d] for face in truth.faces}
    return np.array([planes.get(int(number), [np.nan] * 4) for number in label]).reshape(-1, 4)
