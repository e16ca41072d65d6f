"""Symmetric block-tridiagonal systems: solution, determinant and the blocks of the inverse.

The normal equations of a trajectory's nodes couple neighbours only. Forward elimination with blocks
``S_k = D_k - E_{k-1}' S_{k-1}^-1 E_{k-1}`` costs time in proportion to the flight; the inverse's
diagonal blocks follow backwards (Erisman and Tinney 1975).
"""

from dataclasses import dataclass

import numba
import numpy as np


@dataclass(frozen=True)
class Factor:
    """Factor of the matrix with diagonal blocks (K, b, b) and blocks ``E`` (K - 1, b, b) above
    them.

    ``inverse_S`` (K, b, b) the inverses of the eliminated diagonal blocks, ``log_det`` the
    logarithm of the determinant.
    """

    inverse_S: np.ndarray
    E: np.ndarray
    log_det: float

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solution (K, b, m) for right sides (K, b, m)."""
        return _solve(self.inverse_S, self.E, np.ascontiguousarray(right))

    def inverse_diagonal(self) -> np.ndarray:
        """Diagonal blocks (K, b, b) of the inverse."""
        return _inverse_diagonal(self.inverse_S, self.E)


def factorise(D: np.ndarray, E: np.ndarray) -> Factor:
    """Factor a symmetric positive definite matrix; `numpy.linalg.LinAlgError` where it is not."""
    inverse_S, log_det = _eliminate(np.ascontiguousarray(D), np.ascontiguousarray(E))
    return Factor(inverse_S, np.ascontiguousarray(E), log_det)


@numba.njit(cache=True)
def _eliminate(D, E):
    inverse_S, log_det = np.empty_like(D), 0.0
    S = D[0].copy()
    for k in range(len(D)):
        if k > 0:
            S = D[k] - E[k - 1].T @ inverse_S[k - 1] @ E[k - 1]
        log_det += 2 * np.log(np.diag(np.linalg.cholesky(S))).sum()  # raises where it cannot be
        inverse = np.linalg.inv(S)
        inverse_S[k] = (inverse + inverse.T) / 2
    return inverse_S, log_det


@numba.njit(cache=True)
def _solve(inverse_S, E, right):
    out = right.copy()
    for k in range(1, len(out)):
        out[k] -= E[k - 1].T @ (inverse_S[k - 1] @ out[k - 1])
    last = len(out) - 1
    out[last] = inverse_S[last] @ out[last]
    for k in range(last - 1, -1, -1):
        out[k] = inverse_S[k] @ (out[k] - E[k] @ out[k + 1])
    return out


@numba.njit(cache=True)
def _inverse_diagonal(inverse_S, E):
    out = inverse_S.copy()
    for k in range(len(out) - 2, -1, -1):
        gain = inverse_S[k] @ E[k]
        out[k] = inverse_S[k] + gain @ out[k + 1] @ gain.T
    return out
