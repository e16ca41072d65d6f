"""A file cut into passes: what is flown one way, without a break, is a strip."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from paperrepro.survey import Strip, Trajectory

#: A pause in the points that ends a pass, s; turns end it too, beyond so much heading or course.
PAUSE, TURN = 5.0, np.radians(45.0)
#: Slower than this, m/s, the course says nothing.
SLOW = 1.0
#: A pass shorter than this, s, or with a smaller share of the file's points, is part of a turn.
SHORTEST, SMALLEST = 3.0, 0.02


def split(strip: Strip, poses_of: Callable[[np.ndarray], np.ndarray]) -> tuple[list[Strip], int]:
    """Passes of ``strip``, points in order of time, and how many points of turns are left out.

    ``poses_of`` gives the poses (K, 6) of the points at indices (K,) into the strip. One pass keeps
    the strip's name, several add ``.1``, ``.2``.
    """
    time = np.asarray(strip.time)
    order = None if (np.diff(time) >= 0).all() else np.argsort(time, kind="stable")
    if order is not None:
        strip = strip.take(order)
    seconds = _seconds(strip.time)
    edges = _edges(strip.time, seconds, poses_of(seconds if order is None else order[seconds]))
    if len(edges) == 2:
        return [strip], 0
    parts = [slice(*ends) for ends in pairwise(edges)]
    kept = [part for part in parts if _is_pass(strip.time[part], len(strip))]
    kept = kept or [max(parts, key=lambda part: part.stop - part.start)]
    names = [f"{strip.name}.{k + 1}" for k in range(len(kept))] if len(kept) > 1 else [strip.name]
    passes = [replace(strip.take(part), name=name) for name, part in zip(names, kept, strict=True)]
    return passes, len(strip) - sum(map(len, passes))


def _is_pass(time: np.ndarray, count: int) -> bool:
    return time[-1] - time[0] >= SHORTEST and len(time) >= SMALLEST * count


def _seconds(time: np.ndarray) -> np.ndarray:
    """Index of the first point of each second."""
    second = np.floor(time - time[0]).astype(np.int64)
    return np.flatnonzero(np.r_[True, np.diff(second) > 0])


def _edges(time: np.ndarray, seconds: np.ndarray, pose: np.ndarray) -> list[int]:
    """Where passes begin, and the end: indices into points in time. ``pose`` at ``seconds``."""
    heading, position = np.unwrap(_direction(pose[:, 5])), pose[:, :2]
    edges, begin = [0], 0
    for k in range(1, len(seconds)):
        paused = time[seconds[k]] - time[seconds[k] - 1] > PAUSE
        if paused or _turned(heading, position, time[seconds], begin, k):
            edges.append(int(seconds[k]))
            begin = k
    return [*edges, len(time)]


def _direction(angle: np.ndarray) -> np.ndarray:
    return np.arctan2(np.sin(angle), np.cos(angle))


def _turned(heading, position, time, begin: int, k: int) -> bool:
    """Whether heading or course at second ``k`` differ from those with which the pass began."""
    few = slice(begin, min(begin + 3, k))
    if abs(heading[k] - np.median(heading[few])) > TURN:
        return True
    if k - begin < 2:
        return False
    out, now = position[begin + 1] - position[begin], position[k] - position[k - 1]
    spent = time[begin + 1] - time[begin], time[k] - time[k - 1]
    if np.hypot(*out) < SLOW * spent[0] or np.hypot(*now) < SLOW * spent[1]:
        return False
    return abs(_direction(np.arctan2(*now) - np.arctan2(*out))) > TURN


def whole_seconds(time: np.ndarray) -> bool:
    """Whether times (N,) are no finer than seconds."""
    return bool((time == np.round(time)).all())


def finer_times(time: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Times (N,) s from whole ones and the place along the line, for one pass.

    ``position`` (N, 3) m. The places of the seconds' middles are joined by straight lines, so the
    time grows with the way; before the first and after the last at the pass's mean speed.
    """
    level = position - position.mean(axis=0)
    along = level @ np.linalg.svd(level[:: max(1, len(level) // 5000)], full_matrices=False)[2][0]
    seconds, number = np.unique(time, return_inverse=True)
    place = np.bincount(number, along) / np.bincount(number)
    if place[-1] < place[0]:
        along, place = -along, -place
    place = np.maximum.accumulate(place)
    speed = max((place[-1] - place[0]) / max(seconds[-1] - seconds[0], 1.0), 1e-3)
    inside = np.interp(along, place, seconds + 0.5)
    return inside + (along - np.clip(along, place[0], place[-1])) / speed


def joined_trajectory(strips: list[Strip], step: float = 0.02) -> Trajectory:
    """A trajectory from strips with a pose per point, at most one pose every ``step`` s."""
    time = np.concatenate([strip.time for strip in strips])
    pose = np.concatenate([strip.pose for strip in strips])
    slot = np.floor((time - time.min()) / step).astype(np.int64)
    _, chosen = np.unique(slot, return_index=True)
    chosen = chosen[np.argsort(time[chosen])]
    chosen = chosen[np.r_[True, np.diff(time[chosen]) > 0]]
    return Trajectory(time[chosen], pose[chosen, :3], pose[chosen, 3:])
