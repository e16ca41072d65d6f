"""Surfaces that are no planes: heights over the scene's planes, and where a ray meets them.

A height lies along the normal of the plane and belongs to the place on it, so every strip and the
reference see one and the same surface. Rays are followed from above the highest to below the lowest
height, so that a tile hides what is behind it; which triangle a ray meets stays the plane's affair,
so a height never hides or uncovers another triangle. m-frame, metres.
"""

from dataclasses import dataclass

import numba
import numpy as np

from paperrepro._compiled import over_threads

#: Steps along a ray at most: a ray that grazes takes longer ones.
MOST_STEPS = 200
#: Steps that narrow a crossing's bracket at most, and how close to the surface is on it, m.
REFINEMENTS, CLOSE = 40, 1e-6


@dataclass(frozen=True)
class HeightMap:
    """Heights on a grid over a plane: ``heights`` (U, V) float32 m at ``origin`` (3,) m plus
    multiples of ``step`` m along the unit vectors ``u`` and ``v`` (3,); beyond its rim it repeats
    if ``periodic``, else its rim goes on."""

    heights: np.ndarray
    origin: np.ndarray
    u: np.ndarray
    v: np.ndarray
    step: float
    periodic: bool = False

    def at(self, p_m: np.ndarray) -> np.ndarray:
        """Heights (N,) m at points (N, 3) m, bilinear."""
        out = np.empty(len(p_m))
        frame = np.concatenate([self.origin, self.u, self.v])
        _look_up(np.ascontiguousarray(p_m), self.heights, frame, self.step, self.periodic, out)
        return out


@dataclass(frozen=True)
class Relief:
    """``maps`` of a scene and, per triangle, which of them lies on it, (T,) int32 or -1."""

    maps: tuple[HeightMap, ...]
    triangle_map: np.ndarray

    def displace(self, origin, direction, planes, distance, triangle) -> None:
        """Correct ``distance`` (N,) m of rays that met ``triangle`` (N,), in place.

        ``origin`` (N, 3) m, ``direction`` (N, 3) unit, ``planes`` (T, 4), all m-frame.
        """
        of_ray = np.where(triangle >= 0, self.triangle_map[triangle], -1)
        order = np.argsort(of_ray, kind="stable")
        bounds = np.searchsorted(of_ray[order], np.arange(len(self.maps) + 1))
        for number, one in enumerate(self.maps):
            rays = order[bounds[number] : bounds[number + 1]]
            if len(rays):
                grid = one.heights, np.concatenate([one.origin, one.u, one.v]), one.step
                limits = float(one.heights.min()), float(one.heights.max()), one.periodic
                given = rays, origin, direction, planes, triangle, *grid, *limits, distance
                over_threads(_march, len(rays), *given)


@numba.njit(cache=True, nogil=True)
def _height(x, y, z, heights, frame, step, periodic):
    """Bilinear height at a point."""
    a, b = 0.0, 0.0
    for j, c in enumerate((x, y, z)):
        a += (c - frame[j]) * frame[3 + j]
        b += (c - frame[j]) * frame[6 + j]
    a, b = a / step, b / step
    rows, columns = heights.shape
    if not periodic:
        a, b = min(max(a, 0.0), rows - 1.0), min(max(b, 0.0), columns - 1.0)
    i, k = int(np.floor(a)), int(np.floor(b))
    a, b = a - i, b - k
    if periodic:
        i, k = i % rows, k % columns
        above, right = (i + 1 if i + 1 < rows else 0), (k + 1 if k + 1 < columns else 0)
    else:
        above, right = min(i + 1, rows - 1), min(k + 1, columns - 1)
    low = (1.0 - b) * heights[i, k] + b * heights[i, right]
    high = (1.0 - b) * heights[above, k] + b * heights[above, right]
    return (1.0 - a) * low + a * high


@numba.njit(cache=True, nogil=True)
def _look_up(p_m, heights, frame, step, periodic, out):
    for i in range(len(p_m)):
        out[i] = _height(p_m[i, 0], p_m[i, 1], p_m[i, 2], heights, frame, step, periodic)


@numba.njit(cache=True, nogil=True)
def _march(
    first, last, rays, origin, direction, planes, triangle,
    heights, frame, step, lowest, highest, periodic, distance,
):  # fmt: skip
    """The first crossing of each ray with the surface: a bracket by steps of the grid, which secant
    and halving in turn make narrow."""
    for number in range(first, last):
        i = rays[number]
        k, hit = triangle[i], distance[i]
        x, y, z = origin[i]
        dx, dy, dz = direction[i]
        fall = -(planes[k, 0] * dx + planes[k, 1] * dy + planes[k, 2] * dz)
        if fall <= 0.0:  # the plane's back, which is smooth
            continue
        sine = np.sqrt(max(1.0 - fall * fall, 1e-12))
        length = (highest - lowest) / fall
        count = min(max(int(np.ceil(length * sine / step)), 1), MOST_STEPS)
        near = far = hit - highest / fall
        over_near, over_far = highest - lowest, 0.0  # of the ray over the surface
        for n in range(count + 1):
            far = hit - highest / fall + n * length / count
            surface = _height(
                x + far * dx, y + far * dy, z + far * dz, heights, frame, step, periodic
            )
            over_far = fall * (hit - far) - surface
            if over_far <= 0.0:
                break
            near, over_near = far, over_far
        for n in range(REFINEMENTS):
            if over_near <= over_far:
                break
            share = over_near / (over_near - over_far) if n % 2 == 0 else 0.5
            middle = near + share * (far - near)
            surface = _height(
                x + middle * dx, y + middle * dy, z + middle * dz, heights, frame, step, periodic
            )
            over = fall * (hit - middle) - surface
            if over <= 0.0:
                far, over_far = middle, over
            else:
                near, over_near = middle, over
            if abs(over) < CLOSE:
                far = middle
                break
        distance[i] = far
