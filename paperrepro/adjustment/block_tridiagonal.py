"""Symmetric block-tridiagonal systems: solution, determinant and the blocks of the inverse.

The normal equations of a trajectory's nodes couple neighbours only. Forward elimination with blocks
``S_k = D_k - E_{k-1}' S_{k-1}^-1 E_{k-1}`` costs time in proportion to the flight; LAPACK does it
on the band, whose Cholesky factor holds that of each ``S_k``. The inverse's diagonal blocks follow
backwards (Erisman and Tinney 1975).
"""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.linalg import cholesky_banded


@dataclass(frozen=True)
class Factor:
    """Factor of a matrix of K x K blocks (b, b).

    ``inverse_S`` (K, b, b) the inverses of the eliminated diagonal blocks, ``gain`` (K - 1, b, b)
    ``S_k^-1 E_k``, ``log_det`` the logarithm of the determinant.
    """

    inverse_S: np.ndarray
    gain: np.ndarray
    log_det: float

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Solution (K, b, m) for right sides (K, b, m)."""
        out = np.ascontiguousarray(right, dtype=float).copy()
        _forward(self.gain, out)
        out = self.inverse_S @ out
        _backward(self.gain, out)
        return out

    def inverse_diagonal(self) -> np.ndarray:
        """Diagonal blocks (K, b, b) of the inverse."""
        out = self.inverse_S.copy()
        for k in range(len(out) - 2, -1, -1):
            out[k] += self.gain[k] @ out[k + 1] @ self.gain[k].T
        return out


def factorise(D: np.ndarray, E: np.ndarray) -> Factor:
    """Factor the symmetric positive definite matrix with diagonal blocks ``D`` (K, b, b) and blocks
    ``E`` (K - 1, b, b) above them; `numpy.linalg.LinAlgError` where it is not."""
    band = cholesky_banded(_lower_band(D, E), lower=True, overwrite_ab=True, check_finite=False)
    L = np.zeros_like(D)
    for row, column in zip(*np.tril_indices(D.shape[1]), strict=True):
        L[:, row, column] = band[row - column, column :: D.shape[1]]
    inverse_L = np.linalg.inv(L)
    inverse_S = inverse_L.transpose(0, 2, 1) @ inverse_L
    return Factor(inverse_S, inverse_S[:-1] @ E, 2 * float(np.log(band[0]).sum()))


def _lower_band(D: np.ndarray, E: np.ndarray) -> np.ndarray:
    """(2 b, K b): entry (i, j) of the matrix at [i - j, j], as LAPACK has it."""
    size = D.shape[1]
    band = np.zeros((2 * size, len(D), size))
    for row in range(size):
        for column in range(size):
            if row >= column:
                band[row - column, :, column] = D[:, row, column]
            band[size + row - column, :-1, column] = E[:, column, row]
    return band.reshape(2 * size, -1)


@numba.njit(cache=True)
def _forward(gain, out):
    """``out_k -= gain_{k-1}' out_{k-1}``, in place."""
    for k in range(1, len(out)):
        for j in range(out.shape[1]):
            for i in range(out.shape[1]):
                for m in range(out.shape[2]):
                    out[k, i, m] -= gain[k - 1, j, i] * out[k - 1, j, m]


@numba.njit(cache=True)
def _backward(gain, out):
    """``out_k -= gain_k out_{k+1}``, in place."""
    for k in range(len(out) - 2, -1, -1):
        for i in range(out.shape[1]):
            for j in range(out.shape[1]):
                for m in range(out.shape[2]):
                    out[k, i, m] -= gain[k, i, j] * out[k + 1, j, m]
