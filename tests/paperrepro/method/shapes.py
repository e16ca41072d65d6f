"""Hand-made clouds: roofs, crowns and ground whose truth a test knows by construction."""

import numpy as np


def patch(rng, count, width, length, sigma=0.0):
    """Points (count, 3) m on a level rectangle about the origin, with normal noise in height."""
    xy = rng.uniform(-0.5, 0.5, (count, 2)) * [width, length]
    return np.column_stack([xy, sigma * rng.standard_normal(count)])


def gable(
    rng, centre=(0.0, 0.0), azimuth_deg=0.0, pitch_deg=25.0, length=14.0, width=9.0,
    ridge=6.0, per_m2=20.0, sigma=0.0, span=(0.0, 1.0),
):  # fmt: skip
    """Points (N, 3) m of a gable roof and the side (N,) of each, 0 or 1.

    ``azimuth_deg`` of the ridge, clockwise from north; ``span`` is the part along the ridge that
    is seen.
    """
    count = int(per_m2 * length * width * (span[1] - span[0]))
    u = length * (rng.uniform(*span, count) - 0.5)
    v = width * rng.uniform(-0.5, 0.5, count)
    z = ridge - np.abs(v) * np.tan(np.radians(pitch_deg)) + sigma * rng.standard_normal(count)
    return np.column_stack([_turn(u, v, azimuth_deg) + centre, z]), (v > 0).astype(int)


def hip(rng, pitch_deg=25.0, length=14.0, width=9.0, ridge=6.0, per_m2=20.0):
    """Points (N, 3) m of a hip roof of four equal slopes about the origin, ridge to the north."""
    count = int(per_m2 * length * width)
    u = length * rng.uniform(-0.5, 0.5, count)
    v = width * rng.uniform(-0.5, 0.5, count)
    from_eaves = np.minimum(length / 2 - np.abs(u), width / 2 - np.abs(v))
    z = ridge - (width / 2 - from_eaves) * np.tan(np.radians(pitch_deg))
    return np.column_stack([_turn(u, v, 0.0), z])


def crown(rng, centre, radius=3.0, count=1500):
    """Points (count, 3) m through the volume of a tree's crown, denser outside."""
    direction = rng.standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return radius * np.sqrt(rng.uniform(0.2, 1.0, (count, 1))) * direction + centre


def ground(rng, half=40.0, per_m2=10.0, slope=0.0, sigma=0.02):
    """Points (N, 3) m of a plane that rises to the east by ``slope``."""
    count = int(4 * half**2 * per_m2)
    xy = rng.uniform(-half, half, (count, 2))
    return np.column_stack([xy, slope * xy[:, 0] + sigma * rng.standard_normal(count)])


def _turn(u, v, azimuth_deg):
    a = np.radians(azimuth_deg)
    return np.outer(u, [np.sin(a), np.cos(a)]) + np.outer(v, [np.cos(a), -np.sin(a)])
