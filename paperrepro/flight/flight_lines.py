"""Files to flight lines: what is flown one way, without a break, is a strip.

A file may hold several lines, a line may lie in several files (tiles, parts, copies). A pulse
counts once: what stands in two files, or twice in one, would feign independent observations.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import count, pairwise

import numpy as np

from paperrepro.survey import Strip, Trajectory

#: A pause in the points that ends a line, s; turns end it too, beyond so much heading or course.
PAUSE, TURN = 5.0, np.radians(45.0)
#: Slower than this, m/s, the course says nothing.
SLOW = 1.0
#: Times nearer than this, s, with the same ring, are one pulse.
SAME_TIME = 5e-7
#: Points nearer to each other than this, m, are one echo.
SAME_RANGE = 1e-3
#: Points looked at together.
CHUNK = 1_000_000
#: A line shorter than this, s, or with a smaller share of the file's points, is part of a turn.
SHORTEST, SMALLEST = 3.0, 0.02


def split(strip: Strip, poses_of: Callable[[np.ndarray], np.ndarray]) -> tuple[list[Strip], int]:
    """Flight lines of ``strip``, whose points lie in order of time, and how many points of turns
    are left out. ``poses_of`` gives the poses (K, 6) of the points at indices (K,) into the strip.
    One line keeps the strip's name, several add ``.1``, ``.2``. They share the strip's memory.
    """
    seconds = _seconds(strip.time)
    edges = _edges(strip.time, seconds, poses_of(seconds))
    if len(edges) == 2:
        return [strip], 0
    parts = [slice(*ends) for ends in pairwise(edges)]
    kept = [part for part in parts if _is_line(strip.time[part], len(strip))]
    kept = kept or [max(parts, key=lambda part: part.stop - part.start)]
    names = [f"{strip.name}.{k + 1}" for k in range(len(kept))] if len(kept) > 1 else [strip.name]
    lines = [replace(strip.take(part), name=name) for name, part in zip(names, kept, strict=True)]
    return lines, len(strip) - sum(map(len, lines))


def _is_line(time: np.ndarray, count: int) -> bool:
    return time[-1] - time[0] >= SHORTEST and len(time) >= SMALLEST * count


def _seconds(time: np.ndarray) -> np.ndarray:
    """Index of the first point of each second."""
    first, before = [], -1.0
    for start in range(0, len(time), CHUNK):
        second = np.floor(time[start : start + CHUNK] - time[0])
        first.append(start + np.flatnonzero(np.diff(second, prepend=before) > 0))
        before = second[-1]
    return np.concatenate(first)


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
    """Whether heading or course at second ``k`` differ from those with which the line began."""
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


def joined(strips: list[Strip]) -> tuple[list[Strip], list[str]]:
    """Strips whose times overlap as one, under the first one's name, each pulse once; and notes.

    A scanner is at one place at a time: such strips are parts, tiles or copies of one line.
    """
    order = sorted(range(len(strips)), key=lambda k: strips[k].time[0])
    groups, last = [], -np.inf
    for k in order:
        if strips[k].time[0] > last:
            groups.append([])
        groups[-1].append(k)
        last = max(last, strips[k].time[-1])
    out, notes = {}, []
    for group in (sorted(group) for group in groups):
        parts = [strips[k] for k in group]
        if len(parts) == 1 and not _holds_repeats(parts[0].time):
            out[group[0]] = parts[0]
            continue
        whole = _concatenated(parts) if len(parts) > 1 else parts[0]
        once = _first_of_pulse(whole, np.repeat(range(len(parts)), [len(p) for p in parts]))
        out[group[0]] = whole.take(once) if len(once) < len(whole) else whole
        repeats = len(whole) - len(once)
        share = f"{repeats} of {len(whole)} points ({100 * repeats / len(whole):.2g} %)"
        names = ", ".join(part.name for part in parts)
        if len(parts) > 1:
            notes.append(
                f"{names}: flown at the same time, so parts or copies of one flight line, which is "
                f"named {parts[0].name}; {share} stand in more than one and are taken once"
            )
        elif repeats:
            notes.append(f"{names}: {share} stand in it twice and are taken once")
    return [out[k] for k in sorted(out)], notes


def _concatenated(parts: list[Strip]) -> Strip:
    """One strip of all points, in order of time."""
    columns = {
        name: np.concatenate([part.columns[name] for part in parts]) for name in parts[0].columns
    }
    return Strip(parts[0].name, **columns)


def _holds_repeats(time: np.ndarray) -> bool:
    """Whether two of ascending times (N,) are of one pulse."""
    parts = (time[start : start + CHUNK + 1] for start in range(0, len(time), CHUNK))
    return any((np.diff(part) < SAME_TIME).any() for part in parts)


def _first_of_pulse(strip: Strip, part: np.ndarray) -> np.ndarray:
    """Indices, in order of time, without repeats: the pulses that another ``part`` (N,) holds too,
    and the echoes that one part holds twice."""
    order = np.lexsort((strip.rho, part, strip.time, strip.ring))
    time, ring, rho = strip.time[order], strip.ring[order], strip.rho[order]
    same = (np.diff(time) < SAME_TIME) & (np.diff(ring) == 0)
    pulse = np.cumsum(np.r_[True, ~same])
    first = np.flatnonzero(np.r_[True, ~same])  # of each pulse, the first part that holds it
    lowest = np.minimum.reduceat(part[order], first)
    kept = part[order] == lowest[pulse - 1]
    aside = np.abs(np.diff(strip.azimuth[order])) * rho[1:]
    twice = same & (np.diff(part[order]) == 0) & (np.abs(np.diff(rho)) + aside < SAME_RANGE)
    kept[1:] &= ~twice
    index = order[kept]
    return index[np.argsort(strip.time[index], kind="stable")]


def with_unique_names(strips: list[Strip]) -> list[Strip]:
    """Strips under names of which no two are alike: a number is added where they are."""
    out, taken = [], {strip.name for strip in strips}
    for strip in strips:
        if any(strip.name == other.name for other in out):
            name = next(n for k in count(2) if (n := f"{strip.name} ({k})") not in taken)
            taken.add(name)
            strip = replace(strip, name=name)
        out.append(strip)
    return out


def whole_seconds(time: np.ndarray) -> bool:
    """Whether times (N,) are no finer than seconds."""
    return bool((time == np.round(time)).all())


def finer_times(time: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Times (N,) s from whole ones and the place along the line, for one line.

    ``position`` (N, 3) m. The places of the seconds' middles are joined by straight lines, so the
    time grows with the way; before the first and after the last at the line's mean speed.
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
