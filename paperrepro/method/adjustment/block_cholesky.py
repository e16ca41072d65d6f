"""Cholesky factor of normal equations that are a sum of small dense parts, each at its place.

Multifrontal with nested dissection (Duff & Reid 1983; George 1973): the parts are halved again and
again, and what no part outside a half knows is eliminated in it. The inverse is found where two
unknowns share a part (Takahashi et al. 1973).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular


@dataclass(frozen=True)
class Front:
    """Unknowns ``own`` (o,) eliminated here, by their lower factor ``L`` (o, o), and ``rest`` (r,)
    that they leave, by ``G`` (o, r), the factor's inverse times what couples both."""

    own: np.ndarray
    rest: np.ndarray
    L: np.ndarray
    G: np.ndarray
    children: tuple["Front | int", ...]


@dataclass(frozen=True)
class BlockCholesky:
    """``fronts``, each after its children; ``places`` (r,) of each part in the n unknowns;
    ``scale`` (n,) to a diagonal of ones; ``log_det`` of the matrix."""

    fronts: tuple[Front, ...]
    places: tuple[np.ndarray, ...]
    scale: np.ndarray
    log_det: float

    @classmethod
    def of(
        cls, parts: list[np.ndarray], places: list[np.ndarray], n: int, order: np.ndarray
    ) -> "BlockCholesky":
        """Of the positive definite sum of ``parts`` (r, r), each at its ``places`` (r,) among the
        ``n`` unknowns; their ``order`` is that of `dissected`. `numpy.linalg.LinAlgError` where it
        is not."""
        diagonal, first, last = np.zeros(n), np.full(n, len(parts)), np.full(n, -1)
        for number, part in enumerate(order):
            where = places[part]
            diagonal[where] += np.diag(parts[part])
            first[where] = np.minimum(first[where], number)
            last[where] = number
        scale, fronts = 1 / np.sqrt(diagonal), []

        def front(begin: int, end: int) -> tuple["Front | int", np.ndarray, np.ndarray]:
            if end - begin == 1:
                number = int(order[begin])
                where = places[number]
                children = (number,)
                below = [(where, parts[number] * np.outer(*2 * [scale[where]]))]
            else:
                middle = (begin + end) // 2
                made = front(begin, middle), front(middle, end)
                children, below = tuple(m[0] for m in made), [m[1:] for m in made]
            known = np.unique(np.concatenate([where for where, _ in below]))
            done = (first[known] >= begin) & (last[known] < end)
            known, o = np.concatenate([known[done], known[~done]]), int(done.sum())
            sorter = np.argsort(known)
            F = np.zeros((len(known), len(known)))
            for where, part in below:
                at = sorter[np.searchsorted(known, where, sorter=sorter)]
                F[np.ix_(at, at)] += part
            L = np.linalg.cholesky(F[:o, :o])
            G = solve_triangular(L, F[:o, o:], lower=True) if o else F[:o, o:]
            out = Front(known[:o], known[o:], L, G, children)
            fronts.append(out)
            return out, known[o:], F[o:, o:] - G.T @ G

        front(0, len(parts))
        log_det = 2 * sum(float(np.log(np.diag(f.L)).sum()) for f in fronts)
        log_det -= 2 * float(np.log(scale).sum())
        return cls(tuple(fronts), tuple(places), scale, log_det)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Inverse times ``right`` (n, m)."""
        out = self.scale[:, None] * right
        for f in self.fronts:
            if len(f.own):
                out[f.own] = solve_triangular(f.L, out[f.own], lower=True)
                out[f.rest] -= f.G.T @ out[f.own]
        for f in reversed(self.fronts):
            if len(f.own):
                out[f.own] -= f.G @ out[f.rest]
                out[f.own] = solve_triangular(f.L, out[f.own], lower=True, trans=1)
        return self.scale[:, None] * out

    def inverse_blocks(self) -> list[np.ndarray]:
        """Of the inverse, what (r, r) each part sees at its places."""
        out = list(self.places)

        def descend(f: Front, Q: np.ndarray) -> None:
            o, known = len(f.own), np.concatenate([f.own, f.rest])
            full = np.empty((len(known), len(known)))
            full[o:, o:] = Q
            if o:
                lower = solve_triangular(f.L, np.eye(o), lower=True)
                gain = lower.T @ f.G
                full[:o, o:] = -gain @ Q
                full[o:, :o] = full[:o, o:].T
                full[:o, :o] = lower.T @ lower - full[:o, o:] @ gain.T
            sorter = np.argsort(known)
            for child in f.children:
                where = child.rest if isinstance(child, Front) else self.places[child]
                at = sorter[np.searchsorted(known, where, sorter=sorter)]
                block = full[np.ix_(at, at)]
                if isinstance(child, Front):
                    descend(child, block)
                else:
                    out[child] = block * np.outer(self.scale[where], self.scale[where])

        descend(self.fronts[-1], np.empty((0, 0)))
        return out


def dissected(places: list[np.ndarray], coordinates: np.ndarray) -> np.ndarray:
    """Order (P,) of parts such that its halves, and theirs again, share few unknowns: each is cut
    across the one of the ``coordinates`` (P, c) where the fewest ``places`` are in both."""

    def halved(members: np.ndarray) -> np.ndarray:
        if len(members) < 3:
            return members
        best = min((_halves(members, places, along) for along in coordinates.T), key=lambda h: h[0])
        return np.concatenate([halved(half) for half in best[1]])

    return halved(np.arange(len(places)))


def _halves(members, places, along) -> tuple[int, list[np.ndarray]]:
    members = members[np.argsort(along[members], kind="stable")]
    halves = np.split(members, [len(members) // 2])
    seen = [np.unique(np.concatenate([places[part] for part in half])) for half in halves]
    return len(np.intersect1d(*seen, assume_unique=True)), halves
