"""What only the truth can tell of a method's output: labels, false matches, recall, true planes.

Takes survey, truth and plain arrays, so that nothing here depends on the method.
"""

from collections.abc import Iterable, Sequence
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


def angles_between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Angles (G,) rad between unit vectors (G, 3)."""
    sine = np.linalg.norm(np.cross(one, other), axis=1)
    return np.arctan2(sine, np.einsum("ga,ga->g", one, other))


def faces_in_strip(
    p_m: np.ndarray, label: np.ndarray, truth: Truth, share: float = 0.5, cell_m: float = 1.0
) -> np.ndarray:
    """Ids of the gable faces that lie in a strip: it covers ``share`` of their plan area.

    p_m : (N, 3) m, true places of the strip's points; label : (N,) the face that each lies on. The
    area is counted in cells, so it depends neither on the density nor on the distance.
    """
    on_face = label >= 0
    cell = np.floor(p_m[on_face, :2] / cell_m).astype(np.int64)
    cell -= cell.min(axis=0, initial=0)
    shape = (max(f.id for f in truth.faces) + 1, *(cell.max(axis=0, initial=0) + 1))
    occupied = np.zeros(shape, dtype=bool)
    occupied[label[on_face], cell[:, 0], cell[:, 1]] = True
    covered = cell_m**2 * np.count_nonzero(occupied, axis=(1, 2))
    return np.array(
        [f.id for f in truth.faces if covered[f.id] >= share * f.area * f.normal[2]], dtype=int
    )


@dataclass(frozen=True)
class Recall:
    """Gable faces that could be found, ``expected`` ids, and those of them that were, ``found``."""

    expected: np.ndarray
    found: np.ndarray

    @property
    def share(self) -> float:
        """0-1."""
        return len(self.found) / len(self.expected)

    @property
    def missed(self) -> np.ndarray:
        """Ids."""
        return np.setdiff1d(self.expected, self.found)


def recall(
    truth: Truth,
    in_strips: Iterable[np.ndarray],
    found: np.ndarray,
    least_area: float = 20.0,
    least_strips: int = 1,
) -> Recall:
    """`Recall` of the faces of at least ``least_area`` m² that lie in ``least_strips`` or more.

    in_strips : ids of `faces_in_strip`, one array a strip; found : ids of the faces found.
    """
    ids, strips = np.unique(np.concatenate(list(in_strips)), return_counts=True)
    large = [face.id for face in truth.faces if face.area >= least_area]
    expected = np.intersect1d(ids[strips >= least_strips], large)
    return Recall(expected, np.intersect1d(expected, found))


def trajectory_error(survey: Survey, truth: Truth) -> np.ndarray:
    """(M, 6) m and rad: the reported pose minus the true one, east to heading."""
    turn = survey.trajectory.attitude - truth.trajectory.attitude
    turn = np.remainder(turn + np.pi, 2 * np.pi) - np.pi
    return np.column_stack([survey.trajectory.position - truth.trajectory.position, turn])


def overlap_of_points(p_m: np.ndarray, q_m: np.ndarray, cell_m: float = 2.0) -> float:
    """Share, 0-1, of the cells with points of p_m (N, 3) that hold points of q_m (M, 3) too."""
    cells = [np.floor(points[:, :2] / cell_m).astype(np.int64) for points in (p_m, q_m)]
    low, high = (
        bound([bound(cell, axis=0) for cell in cells], axis=0) for bound in (np.min, np.max)
    )
    ours, theirs = (np.zeros(high - low + 1, dtype=bool) for _ in cells)
    for occupied, cell in zip((ours, theirs), cells, strict=True):
        occupied[tuple((cell - low).T)] = True
    return np.count_nonzero(ours & theirs) / np.count_nonzero(ours)
