"""Do strips and trajectory lie at one place? If not: what would bring them together?"""

from collections.abc import Iterator

import numpy as np

from paperrepro.errors import BadInput
from paperrepro.io.geodesy import Grid, LocalFrame
from paperrepro.io.sbet import Poses

#: Points lie within this of the trajectory, m, in plan and in height.
NEAR, STEEP = 2000.0, 1000.0
FOOT = 0.3048


def require_near(name: str, grid: Grid, xyz: np.ndarray, poses: Poses, flown: str) -> None:
    """Raise `BadInput` where points (N, 3) of the map lie far from the trajectory's poses."""
    middle = np.median(xyz, axis=0)
    plan, height = _apart(grid, middle, poses.latitude, poses.longitude, poses.height)
    if plan <= NEAR and abs(height) <= STEEP:
        return
    far = f"{plan / 1000:.1f} km in plan and {abs(height):.0f} m in height"
    for where, what in _explanations(name, flown, grid, middle, poses):
        raise BadInput(f"{where}: lies {far} away from the other file: {what}")
    raise BadInput(
        f"{name}: lies {far} from {flown}; give the trajectory of this flight and the reference "
        f"system of the strips (now {grid.name}; --crs overrides it)"
    )


def _apart(grid: Grid, middle, latitude, longitude, height) -> tuple[float, float]:
    """Distance in plan, and height of the trajectory above the points, m, at its nearest pose."""
    try:
        at = grid.to_geodetic(np.asarray(middle, float)[None])
    except BadInput:
        return np.inf, np.inf
    if not np.isfinite(at).all():
        return np.inf, np.inf
    frame = LocalFrame(*(float(value[0]) for value in at), *grid.shape)
    few = slice(None, None, max(1, len(latitude) // 2000))
    local = frame.from_geodetic(latitude[few], longitude[few], height[few])
    plan = np.hypot(local[:, 0], local[:, 1])
    nearest = int(plan.argmin())
    return float(plan[nearest]), float(local[nearest, 2])


def _explanations(name, flown, grid: Grid, middle, poses: Poses) -> Iterator[tuple[str, str]]:
    latitude, longitude, height = poses.latitude, poses.longitude, poses.height
    turned = {
        "its latitude and longitude are interchanged; write latitude first": (longitude, latitude),
        "its latitude has the wrong sign; south is negative": (-latitude, longitude),
        "its longitude has the wrong sign; west is negative": (latitude, -longitude),
        "both of its signs are wrong; south and west are negative": (-latitude, -longitude),
    }
    for what, (lat, lon) in turned.items():
        if np.abs(lat).max() <= np.pi / 2 and _near(grid, middle, lat, lon, height):
            yield flown, what
    for scale, part in (
        ([FOOT] * 3, "points"),
        ([1, 1, FOOT], "heights"),
        ([FOOT, FOOT, 1], "x, y"),
    ):
        if _near(grid, middle * scale, latitude, longitude, height):
            yield name, f"its {part} are in feet; export it in metres, or with the right --crs"
    for zones in range(-59, 60) if grid.crs.is_projected else ():
        if zones and _near(grid, middle, latitude, longitude - np.radians(6.0 * zones), height):
            yield (
                name,
                (
                    f"its zone is {abs(zones)} {'east' if zones > 0 else 'west'} of that of "
                    f"{grid.name}; name the right one with --crs"
                ),
            )


def _near(grid: Grid, middle, latitude, longitude, height) -> bool:
    plan, above = _apart(grid, middle, latitude, longitude, height)
    return plan <= NEAR and abs(above) <= STEEP
