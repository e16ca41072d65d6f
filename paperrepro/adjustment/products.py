"""Sums of products of rows of A, from which normal equations are made.

Where each ring has its offset, a row meets one of them at a time: products with it are kept by
ring, so that a row is as short as it is without offsets.
"""

import numba


@numba.njit(cache=True)
def add_products(row, w, weight, sums):
    """Add a condition to the ``sums`` (r, r + 1): products of its ``row`` (r,) and, last, with w;
    upper triangle alone."""
    for k in range(len(row)):
        scaled = weight * row[k]
        for m in range(k, len(row)):
            sums[k, m] += scaled * row[m]
        sums[k, len(row)] += scaled * w


@numba.njit(cache=True)
def add_offset(row, by_offset, w, weight, of_ring, ring):
    """Add a condition's products with its derivative by the offset of its ``ring`` to ``of_ring``
    (rings, r + 2): with ``row``, with itself and, last, with w."""
    scaled = weight * by_offset
    for k in range(len(row)):
        of_ring[ring, k] += scaled * row[k]
    of_ring[ring, len(row)] += scaled * by_offset
    of_ring[ring, len(row) + 1] += scaled * w


@numba.njit(cache=True)
def add_sums(sums, of_ring, where, ring_column, N, t):
    """Add the sums to N (upper triangle) and t: ``where`` (r,) an entry of a row is there, and
    ``ring_column`` (rings,) the offset of a ring, -1 where it is held."""
    size = len(sums)
    for k in range(size):
        for m in range(k, size):
            N[min(where[k], where[m]), max(where[k], where[m])] += sums[k, m]
        t[where[k]] += sums[k, size]
    for r in range(len(ring_column)):
        column = ring_column[r]
        if column >= 0:
            for k in range(size):
                N[min(column, where[k]), max(column, where[k])] += of_ring[r, k]
            N[column, column] += of_ring[r, size]
            t[column] += of_ring[r, size + 1]
