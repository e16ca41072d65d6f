"""Sine and cosine of angles that differ little from one ray to the next.

Attitude, and the scanner's azimuth within a firing sequence, turn by far less than a degree from
ray to ray. The sine and cosine of the ray before, turned by a short series, cost less than new ones
and are as exact.
"""

import numba
import numpy as np

#: Turns up to here, rad, go by the series of `turned`: the first term left out is 1e-18.
SERIES = 0.02
#: Rows of what is known of a ray's angles. NumPy's integers: for each plain one, a literal, numba
#: would compile `sines_near` anew.
ROLL, PITCH, HEADING, AZIMUTH, ELEVATION = np.arange(5)


@numba.njit(cache=True)
def turned(sine, cosine, by):
    """Sine and cosine of an angle enlarged by ``by``, rad."""
    if abs(by) > SERIES:
        s, c = np.sin(by), np.cos(by)
    else:
        q = by * by
        s = by * (1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0)))
        c = 1.0 - q / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0))
    return sine * c + cosine * s, cosine * c - sine * s


@numba.njit(cache=True)
def sines_near(angle, known, k):
    """Sine and cosine of ``angle``, rad, from those of one before, row ``k`` of ``known`` (K, 3):
    angle, sine, cosine. The row is renewed where it is too far away, and to begin with holds
    NaN."""
    by = angle - known[k, 0]
    if abs(by) <= SERIES:
        return turned(known[k, 1], known[k, 2], by)
    known[k, 0], known[k, 1], known[k, 2] = angle, np.sin(angle), np.cos(angle)
    return known[k, 1], known[k, 2]
