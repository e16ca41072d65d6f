"""What an adjustment can find of its own gross errors: reliability after Baarda (1968).

The gross error looked for is a bias of one view: all its points moved along the plane's normal, as
a wrong match, a chimney, snow on the roof or a jump of the trajectory would move them. In scenario
D's conditions such a bias is minus the view's own plane distance, so its normal equations are rows
that exist already.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from paperrepro.adjustment.gauss_markov import N_COMPONENTS
from paperrepro.adjustment.trajectory_normals import CellBlocks, Cells
from paperrepro.adjustment.trajectory_solver import State, Step

#: A bias counts as detectable where a test at this level finds it with this power (Baarda 1968).
LEVEL, POWER = 0.001, 0.80
#: Standardised bias that such a test detects, 4.13.
NON_CENTRALITY = float(stats.norm.ppf(1 - LEVEL / 2) + stats.norm.ppf(POWER))
#: Views whose biases are looked at together: bounds the memory of the right sides.
CHUNK = 64


@dataclass(frozen=True)
class Reliability:
    """Of each view, in the order of the matched faces: its ``strip`` and ``plane`` (F,);
    ``redundancy`` (F,) between 0 and 1, the share of its information on a bias that is left once
    all unknowns have taken theirs; ``detectable`` (F,) m, the minimal detectable bias; ``turns``
    (F, 3) rad, what an undetected bias of that size does to the boresight; ``bias`` (F,) m, the
    estimate, positive along the normal, and ``standardised`` (F,), the same in its own sigma (the
    statistic of data snooping)."""

    strip: tuple[str, ...]
    plane: np.ndarray
    redundancy: np.ndarray
    detectable: np.ndarray
    turns: np.ndarray
    bias: np.ndarray
    standardised: np.ndarray

    def of_planes(self) -> np.ndarray:
        """(G,) m: of each plane, the bias that can hide in the view where it hides best."""
        worst = np.zeros(int(self.plane.max()) + 1)
        np.maximum.at(worst, self.plane, self.detectable)
        return worst


def reliability(
    blocks: CellBlocks, cells: Cells, state: State, step: Step, strips: tuple[str, ...]
) -> Reliability:
    """`Reliability` of the views at the solution ``state``, from the ``step`` that ended there."""
    rows = _BiasRows.of(blocks, cells, state, len(strips))
    S_inverse = np.linalg.inv(step.S)
    hidden, turns = np.empty(len(strips)), np.empty((len(strips), 3))
    for first in range(0, len(strips), CHUNK):
        part = slice(first, min(first + CHUNK, len(strips)))
        c_t = rows.nodes(part, len(state.error))
        coupling = step.coupling.reshape(-1, len(step.S))
        right = rows.y[:, part] - coupling.T @ c_t.reshape(len(coupling), -1)
        dy = S_inverse @ right
        hidden[part] = np.einsum("kcf,kcf->f", c_t, step.factor.solve(c_t))
        hidden[part] += (right * dy).sum(axis=0)
        turns[part] = -dy[:3].T
    information = np.maximum(rows.own - hidden, 1e-12 * rows.own)
    detectable = NON_CENTRALITY / np.sqrt(information)
    return Reliability(
        strip=strips,
        plane=rows.plane,
        redundancy=information / rows.own,
        detectable=detectable,
        turns=turns * detectable[:, None],
        bias=rows.misclosure / information,
        standardised=rows.misclosure / np.sqrt(information),
    )


@dataclass(frozen=True)
class _BiasRows:
    """Rows of the normal equations of each view's bias: with itself, ``own`` (F,); with unknowns
    and planes, ``y`` (Y, F); with the nodes, by cell, ``t`` (C, 12). ``misclosure`` (F,) weighted,
    ``plane`` (F,), and the ``cells``."""

    own: np.ndarray
    y: np.ndarray
    t: np.ndarray
    misclosure: np.ndarray
    plane: np.ndarray
    cells: Cells

    @classmethod
    def of(cls, blocks: CellBlocks, cells: Cells, state: State, n_faces: int) -> "_BiasRows":
        u = len(state.x)
        before = -blocks.N[:, : u + 3, u + 2]  # a bias is minus the distance d, of this view alone
        after = -blocks.N[:, u + 2, u + 3 :]
        own, misclosure = np.zeros(n_faces), np.zeros(n_faces)
        np.add.at(own, cells.face, -before[:, u + 2])
        np.add.at(misclosure, cells.face, -blocks.t[:, u + 2])
        y = np.zeros((u + 3 * len(state.planes), n_faces))
        np.add.at(y, (slice(0, u), cells.face), before[:, :u].T)
        for k in range(3):
            np.add.at(y, (u + 3 * cells.plane + k, cells.face), before[:, u + k])
        plane = np.zeros(n_faces, int)
        plane[cells.face] = cells.plane
        return cls(own, y, after, misclosure, plane, cells)

    def nodes(self, part: slice, n_nodes: int) -> np.ndarray:
        """(K, 6, views of ``part``): rows with the nodes."""
        out = np.zeros((n_nodes, N_COMPONENTS, part.stop - part.start))
        chosen = np.flatnonzero((self.cells.face >= part.start) & (self.cells.face < part.stop))
        face, node = self.cells.face[chosen] - part.start, self.cells.node[chosen]
        for k in range(N_COMPONENTS):
            np.add.at(out, (node, k, face), self.t[chosen, k])
            np.add.at(out, (node + 1, k, face), self.t[chosen, N_COMPONENTS + k])
        return out
