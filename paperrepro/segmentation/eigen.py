"""The least eigenvalue of a 3 x 3 symmetric matrix, for loops over millions of them."""

import numba
import numpy as np

#: Sweeps of Jacobi's rotations; five reach rounding, since each squares what is left.
SWEEPS = 8
#: Axes. NumPy's integers: for plain ones, literals, numba would compile `_rotate` three times.
X, Y, Z = np.arange(3)


@numba.njit(cache=True)
def least_eigenpair(S):
    """Least eigenvalue and its unit vector (x, y, z), z >= 0, of ``S`` (3, 3), which is spoilt."""
    V = np.zeros((3, 3))
    V[0, 0] = V[1, 1] = V[2, 2] = 1.0
    for _ in range(SWEEPS):
        apart = abs(S[0, 1]) + abs(S[0, 2]) + abs(S[1, 2])
        if apart <= 1e-17 * (abs(S[0, 0]) + abs(S[1, 1]) + abs(S[2, 2])):
            break
        _rotate(S, V, X, Y)
        _rotate(S, V, X, Z)
        _rotate(S, V, Y, Z)
    k = 0
    for m in range(1, 3):
        if S[m, m] < S[k, k]:
            k = m
    sign = -1.0 if V[2, k] < 0 else 1.0
    return S[k, k], (sign * V[0, k], sign * V[1, k], sign * V[2, k])


@numba.njit(cache=True)
def _rotate(S, V, p, q):
    """Turn ``S`` in the plane of p and q so that S[p, q] vanishes, and ``V`` with it."""
    if S[p, q] == 0.0:
        return
    theta = (S[q, q] - S[p, p]) / (2.0 * S[p, q])
    t = (1.0 if theta >= 0 else -1.0) / (abs(theta) + np.sqrt(theta * theta + 1.0))
    c = 1.0 / np.sqrt(t * t + 1.0)
    s = t * c
    for k in range(3):
        S[k, p], S[k, q] = c * S[k, p] - s * S[k, q], s * S[k, p] + c * S[k, q]
    for k in range(3):
        S[p, k], S[q, k] = c * S[p, k] - s * S[q, k], s * S[p, k] + c * S[q, k]
    for k in range(3):
        V[k, p], V[k, q] = c * V[k, p] - s * V[k, q], s * V[k, p] + c * V[k, q]
