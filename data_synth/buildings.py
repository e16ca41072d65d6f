"""Buildings: gable houses with overhang, chimney and dormer, and sheds that are not gable.

Shapes are made in the building's own coordinates (s along the ridge, t across, z up) and set down
in the m-frame by `Plot`. Metres and radians.
"""

from dataclasses import dataclass

import numpy as np

from data_synth.scene import ObjectClass, SceneBuilder

#: How far walls reach below the ground at the building's centre, so that no slope uncovers them, m.
FOUNDATION = 3.0


@dataclass(frozen=True)
class Plot:
    """A rectangle on the ground: centre (x, y) m, ``azimuth`` rad of its s-axis clockwise from
    north, ``length`` along s and ``width`` along t, m, ``base`` the ground's height, m."""

    x: float
    y: float
    azimuth: float
    length: float
    width: float
    base: float = 0.0

    @property
    def axes(self) -> np.ndarray:
        """(2, 2), rows s and t in east, north."""
        s = np.array([np.sin(self.azimuth), np.cos(self.azimuth)])
        return np.array([s, [s[1], -s[0]]])

    def place(self, stz) -> np.ndarray:
        """(K, 3) of s, t, height above base to the m-frame."""
        stz = np.asarray(stz, dtype=float)
        xy = stz[:, :2] @ self.axes + (self.x, self.y)
        return np.column_stack([xy, stz[:, 2] + self.base])

    def corners(self) -> np.ndarray:
        """(4, 2) east, north."""
        s, t = 0.5 * self.length, 0.5 * self.width
        return self.place([(-s, -t, 0), (s, -t, 0), (s, t, 0), (-s, t, 0)])[:, :2]

    def distance(self, xy) -> np.ndarray:
        """Distance (K,) m of points (K, 2) from the rectangle, 0 inside."""
        st = np.abs((np.atleast_2d(xy) - (self.x, self.y)) @ self.axes.T)
        out = np.maximum(st - (0.5 * self.length, 0.5 * self.width), 0.0)
        return np.hypot(out[:, 0], out[:, 1])

    def clear_of(self, other: "Plot", margin: float) -> bool:
        """True if an axis of either separates the two by at least ``margin`` m."""
        mine, theirs = self.corners(), other.corners()
        for axis in np.vstack([self.axes, other.axes]):
            a, b = mine @ axis, theirs @ axis
            if a.min() > b.max() + margin or b.min() > a.max() + margin:
                return True
        return False


@dataclass(frozen=True)
class GableHouse:
    """``plot`` is the ground plan of the walls; ``eaves`` m the walls' height; ``pitch`` rad;
    ``overhang`` m on all sides."""

    plot: Plot
    eaves: float
    pitch: float
    overhang: float

    @property
    def ridge(self) -> float:
        """Height of the ridge above base, m."""
        return self.eaves + 0.5 * self.plot.width * np.tan(self.pitch)

    def roof_height(self, t: float) -> float:
        """Height above base of the roof at distance ``t`` from the ridge, m."""
        return self.ridge - abs(t) * np.tan(self.pitch)


def add_gable_house(builder: SceneBuilder, house: GableHouse, number: int) -> None:
    """Two roof faces and four walls."""
    s, t = 0.5 * house.plot.length, 0.5 * house.plot.width
    so, to = s + house.overhang, t + house.overhang
    low = house.roof_height(to)
    outline = [(-t, -FOUNDATION), (t, -FOUNDATION), (t, house.eaves)]
    outline += [(0, house.ridge), (-t, house.eaves)]
    for side in (1.0, -1.0):
        face = _sheet((-so, so), (0, house.ridge), (side * to, low))
        builder.gable_face(number, house.plot.place(face))
        wall = _sheet((-s, s), (side * t, -FOUNDATION), (side * t, house.eaves))
        builder.polygon(house.plot.place(wall), ObjectClass.WALL)
        gable = [(side * s, across, z) for across, z in outline]
        builder.polygon(house.plot.place(gable), ObjectClass.WALL)


def add_chimney(builder: SceneBuilder, house: GableHouse, s: float, t: float, size: float) -> None:
    """A square stack through the roof at (s, t), 0.8 m above the ridge."""
    base, top = (
        house.plot.place(_rectangle(s, t, size, size, z))
        for z in (house.roof_height(t) - 1.0, house.ridge + 0.8)
    )
    builder.prism(base, top, ObjectClass.CHIMNEY)


def dormer_fits(house: GableHouse) -> bool:
    """True if a dormer's ridge stays below that of the house."""
    return _dormer_front(house)[1] + 1.9 < house.ridge and house.plot.length > 9.0


def add_dormer(builder: SceneBuilder, house: GableHouse, s: float, side: float) -> None:
    """A small gable, ridge across the house's, on one face; its back ends inside the house."""
    front, sill = _dormer_front(house)
    eaves, ridge, half = sill + 1.1, sill + 1.6, 1.0
    for flank in (half, -half):
        outer = s + flank
        for (s1, z1), (s2, z2) in (((s, ridge), (outer, eaves)), ((outer, sill), (outer, eaves))):
            sheet = [(s1, 0, z1), (s1, side * front, z1), (s2, side * front, z2), (s2, 0, z2)]
            builder.polygon(house.plot.place(sheet), ObjectClass.DORMER)
    face = [(s - half, sill), (s + half, sill), (s + half, eaves), (s, ridge), (s - half, eaves)]
    builder.polygon(house.plot.place([(a, side * front, z) for a, z in face]), ObjectClass.DORMER)


def _dormer_front(house: GableHouse) -> tuple[float, float]:
    """Distance of a dormer's front from the ridge, and the roof's height there."""
    front = 0.35 * house.plot.width
    return front, house.roof_height(front)


def add_flat_shed(builder: SceneBuilder, plot: Plot, height: float) -> None:
    """A box."""
    _add_shed(builder, plot, [height] * 4)


def add_mono_pitch_shed(builder: SceneBuilder, plot: Plot, height: float, pitch: float) -> None:
    """One plane that rises along t."""
    high = height + plot.width * np.tan(pitch)
    _add_shed(builder, plot, [height, height, high, high])


def add_hip_shed(builder: SceneBuilder, plot: Plot, height: float, pitch: float) -> None:
    """Four planes that rise to a short ridge, or to a point if the plan is square."""
    s, t = 0.5 * plot.length, 0.5 * plot.width
    top = height + t * np.tan(pitch)
    a, b, c, d = _rectangle(0, 0, plot.length, plot.width, height)
    left, right = (t - s, 0.0, top), (s - t, 0.0, top)
    _add_walls(builder, plot, [height] * 4)
    for corners in ((a, b, right, left), (c, d, left, right), (b, c, right), (d, a, left)):
        distinct = list(dict.fromkeys(corners))
        builder.polygon(plot.place(distinct), ObjectClass.SHED_ROOF)


def _sheet(s, upper, lower) -> list[tuple]:
    """Corners of a rectangle between ``s`` (2,) and two edges (t, z) that run along s."""
    return [(s[0], *upper), (s[1], *upper), (s[1], *lower), (s[0], *lower)]


def _rectangle(s: float, t: float, length: float, width: float, z) -> list[tuple]:
    """Corners about (s, t) at height(s) z."""
    a, b = 0.5 * length, 0.5 * width
    heights = np.broadcast_to(z, 4)
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return [(s + i * a, t + j * b, float(h)) for (i, j), h in zip(signs, heights, strict=True)]


def _add_walls(builder: SceneBuilder, plot: Plot, heights) -> None:
    base = plot.place(_rectangle(0, 0, plot.length, plot.width, -FOUNDATION))
    top = plot.place(_rectangle(0, 0, plot.length, plot.width, heights))
    for k in range(4):
        j = (k + 1) % 4
        builder.polygon([base[k], base[j], top[j], top[k]], ObjectClass.WALL)


def _add_shed(builder: SceneBuilder, plot: Plot, heights) -> None:
    _add_walls(builder, plot, heights)
    top = plot.place(_rectangle(0, 0, plot.length, plot.width, heights))
    builder.polygon(top, ObjectClass.SHED_ROOF)
