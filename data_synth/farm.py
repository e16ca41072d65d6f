"""The farm: ground, buildings, sheds, trees, a fence and a wire, drawn anew for every seed.

Building sites, three rows of five unless the layout says otherwise, lie on a grid wide enough that
houses of any azimuth stay apart; four of five hold gable houses, the others sheds that are not
gable. Small sheds and trees are then placed by rejection. m-frame, metres; the ground's mean height
is 0.
"""

from dataclasses import dataclass
from itertools import cycle, pairwise

import numpy as np

from data_synth.buildings import (
    GableHouse,
    Plot,
    add_chimney,
    add_dormer,
    add_flat_shed,
    add_gable_house,
    add_hip_shed,
    add_mono_pitch_shed,
    dormer_fits,
)
from data_synth.scene import ObjectClass, Scene, SceneBuilder
from data_synth.terrain import Ground, add_features, add_ground, draw_ground
from data_synth.vegetation import add_tree, draw_tree

#: From site to site, m.
SITE_SPACING = (36.0, 38.0)
#: Sites for one shed, and trees by site.
SITES_PER_SHED, TREES_PER_SITE = 5, 8 / 3
#: Whatever its azimuth, a shed on a site stays within a square of this side, m.
SITE_SHED_EXTENT = 18.0
#: Fence and wire run either side of the middle row, m from it, so far beyond the outermost site.
FENCE_Y, WIRE_Y, FENCE_BEYOND, WIRE_BEYOND = 19.0, -19.0, -12.0, 18.0


@dataclass(frozen=True)
class Layout:
    """``rows`` x ``columns`` of building sites about the origin."""

    rows: int = 3
    columns: int = 5

    @property
    def reach(self) -> np.ndarray:
        """(2,) half extents of the sites' middles, m."""
        return 0.5 * np.array(SITE_SPACING) * (self.columns - 1, self.rows - 1)

    @property
    def sites(self) -> list[tuple[float, float]]:
        """Middles, east and north m, column by column."""
        x, y = (
            spacing * np.arange(count) - reach
            for spacing, count, reach in zip(
                SITE_SPACING, (self.columns, self.rows), self.reach, strict=True
            )
        )
        return [(a, b) for a in x for b in y]

    @property
    def n_gable(self) -> int:
        """Houses; the other sites hold sheds."""
        count = self.rows * self.columns
        return count - count // SITES_PER_SHED

    @property
    def middle(self) -> float:
        """North of the middle row, m."""
        return SITE_SPACING[1] * (self.rows // 2) - self.reach[1]

    @property
    def extent(self) -> np.ndarray:
        """(2,) half extents of the part where anything stands, m."""
        return np.add(self.reach, (28.0, 24.0))

    @property
    def ground_extent(self) -> np.ndarray:
        """(2,) half extents of the ground, m."""
        return np.add(self.reach, (128.0, 112.0))

    def half_length(self, beyond: float) -> float:
        """Of a fence or wire, m."""
        return max(self.reach[0] + beyond, 30.0)


def build_farm(
    rng: np.random.Generator,
    relief: float = 1.0,
    natural: np.random.Generator | None = None,
    layout: Layout | None = None,
) -> Scene:
    """The whole scene; ``relief`` as `draw_ground`, and features of the ground drawn from
    ``natural``, if any."""
    layout = layout or Layout()
    builder = SceneBuilder()
    ground = draw_ground(rng, relief)
    fence_y, wire_y = layout.middle + FENCE_Y, layout.middle + WIRE_Y
    fence, wire = (layout.half_length(beyond) for beyond in (FENCE_BEYOND, WIRE_BEYOND))
    plots = [lane(fence_y, fence), lane(wire_y, wire)]
    sites = rng.permutation(layout.sites)
    n_gable = layout.n_gable
    houses = [draw_house(site, ground, rng) for site in sites[:n_gable]]
    if natural is not None:
        taken = [with_overhang(house) for house in houses]
        taken += [Plot(x, y, 0.0, SITE_SHED_EXTENT, SITE_SHED_EXTENT) for x, y in sites[n_gable:]]
        ground = add_features(ground, taken, natural, layout.ground_extent)
        plots += [feature.plot for feature in ground.features]
    add_ground(builder, ground, layout.ground_extent)
    for number, house in enumerate(houses):
        furnish(builder, house, number, rng)
    plots += [with_overhang(house) for house in houses]
    plots += _add_site_sheds(builder, sites[n_gable:], ground, rng)
    plots += _add_near_sheds(builder, houses, plots, ground, rng)
    add_fence(builder, ground, fence_y, fence)
    add_wire(builder, ground, wire_y, wire)
    n_trees = round(TREES_PER_SITE * len(sites))
    add_trees(builder, plots, houses, ground, layout.extent, n_trees, rng)
    return builder.build()


def lane(y: float, half_length: float) -> Plot:
    """The strip of ground kept free for fence or wire."""
    return Plot(0.0, y, np.pi / 2, 2 * half_length, 0.6)


def draw_house(site, ground: Ground, rng: np.random.Generator) -> GableHouse:
    """A house of any azimuth near ``site`` (2,) m."""
    x, y = site + rng.uniform(-3.5, 3.5, 2)
    length = rng.uniform(8.0, 24.0)
    width = min(rng.uniform(6.0, 12.0), 0.9 * length)
    plot = Plot(x, y, rng.uniform(0.0, np.pi), length, width, float(ground.height(x, y)))
    pitch = np.radians(rng.uniform(15.0, 35.0))
    return GableHouse(plot, rng.uniform(3.0, 5.0), pitch, rng.uniform(0.3, 0.6))


def with_overhang(house: GableHouse) -> Plot:
    """What the roof covers."""
    p, wider = house.plot, 2 * house.overhang
    return Plot(p.x, p.y, p.azimuth, p.length + wider, p.width + wider, p.base)


def furnish(builder: SceneBuilder, house: GableHouse, number: int, rng) -> None:
    """House, mostly a chimney, sometimes a dormer."""
    add_gable_house(builder, house, number)
    length, width = house.plot.length, house.plot.width
    side = rng.choice([-1.0, 1.0])
    s, t = rng.uniform(0.2, 0.4) * length, rng.uniform(0.08, 0.3) * width
    size = rng.uniform(0.5, 0.8)
    if rng.uniform() < 0.75:
        add_chimney(builder, house, s, side * t, size)
    s = rng.uniform(-0.3, 0.0) * length
    if dormer_fits(house) and rng.uniform() < 0.5:
        add_dormer(builder, house, s, side)


def _add_site_sheds(builder: SceneBuilder, sites, ground: Ground, rng) -> list[Plot]:
    """Flat, mono-pitch and hip roofs in turn, as large as houses."""
    sizes, plots = ((14.0, 10.0), (13.0, 7.0), (11.0, 9.0)), []
    for (x, y), (length, width) in zip(sites, cycle(sizes), strict=False):
        base = float(ground.height(x, y))
        plots.append(Plot(x, y, rng.uniform(0.0, np.pi), length, width, base))
    for number, plot in enumerate(plots):
        if number % 3 == 0:
            add_flat_shed(builder, plot, 4.0)
        elif number % 3 == 1:
            add_mono_pitch_shed(builder, plot, 3.0, np.radians(rng.uniform(8.0, 15.0)))
        else:
            add_hip_shed(builder, plot, 3.5, np.radians(rng.uniform(20.0, 30.0)))
    return plots


def _add_near_sheds(builder: SceneBuilder, houses, taken: list[Plot], ground, rng) -> list[Plot]:
    """Four small sheds 1-4 m from a gable house: mono-pitch, flat, pyramid, mono-pitch."""
    plots = []
    for size in ((5.0, 3.5), (6.0, 4.0), (4.5, 4.5), (4.0, 3.0)):
        plots.append(_find_near_plot(size, houses, taken + plots, ground, rng))
    add_mono_pitch_shed(builder, plots[0], 2.3, np.radians(rng.uniform(10.0, 20.0)))
    add_flat_shed(builder, plots[1], 2.6)
    add_hip_shed(builder, plots[2], 2.4, np.radians(rng.uniform(20.0, 35.0)))
    add_mono_pitch_shed(builder, plots[3], 2.2, np.radians(rng.uniform(10.0, 20.0)))
    return plots


def _find_near_plot(size, houses, taken: list[Plot], ground: Ground, rng) -> Plot:
    """Draw until the shed is clear of all that stands; houses leave ample room, so it ends."""
    while True:
        home = with_overhang(houses[rng.integers(len(houses))])
        x, y = _near_point(home, rng.uniform(1.0, 4.0) + 0.5 * max(size), rng)
        plot = Plot(x, y, home.azimuth + rng.normal(0.0, 0.1), *size, float(ground.height(x, y)))
        if all(plot.clear_of(other, 0.7) for other in taken):
            return plot


def _near_point(plot: Plot, distance: float, rng) -> tuple[float, float]:
    """A point ``distance`` m outside a random side of ``plot``."""
    s, t = 0.5 * plot.length, 0.5 * plot.width
    side = rng.choice([-1.0, 1.0])
    if rng.uniform() < 0.5:
        st = (side * (s + distance), rng.uniform(-t, t))
    else:
        st = (rng.uniform(-s, s), side * (t + distance))
    x, y, _ = plot.place([(*st, 0.0)])[0]
    return float(x), float(y)


def add_trees(
    builder: SceneBuilder, plots: list[Plot], houses, ground: Ground, extent, count: int, rng
) -> None:
    """``count`` trees within ``extent`` (2,) m, one a house so close that its crown reaches over
    the roof."""
    stems = np.empty((0, 2))
    while len(stems) < count:
        if len(stems) < len(houses):
            home = with_overhang(houses[rng.integers(len(houses))])
            xy = np.array(_near_point(home, rng.uniform(1.2, 3.0), rng))
        else:
            xy = rng.uniform(-1.0, 1.0, 2) * extent
        clear = all(plot.distance(xy)[0] > 1.0 for plot in plots)
        if clear and (np.hypot(*(stems - xy).T) > 3.5).all():
            stems = np.vstack([stems, xy])
            add_tree(builder, draw_tree(*xy, float(ground.height(*xy)), rng), rng)


def add_fence(builder: SceneBuilder, ground: Ground, y: float, half_length: float) -> None:
    """Posts every 3 m and three rails."""
    x = np.arange(-half_length, half_length + 0.1, 3.0)
    z = ground.height(x, np.full_like(x, y))
    for k in range(len(x)):
        _add_box(builder, (x[k], y), 0.12, (z[k] - 0.3, z[k] + 1.3), ObjectClass.FENCE)
    for k in range(len(x) - 1):
        for rise in (0.4, 0.8, 1.2):
            ends = np.array([(x[j], y, z[j] + rise) for j in (k, k + 1)])
            _add_bar(builder, ends, 0.06, ObjectClass.FENCE)


def add_wire(builder: SceneBuilder, ground: Ground, y: float, half_length: float) -> None:
    """Poles and a sagging conductor, 4 cm thick so that a laser meets it now and then."""
    span, height = 30.0, 8.0
    x = np.arange(-half_length, half_length + 0.1, span)
    z = ground.height(x, np.full_like(x, y))
    for k in range(len(x)):
        _add_box(builder, (x[k], y), 0.25, (z[k] - 0.3, z[k] + height), ObjectClass.WIRE)
    u = np.linspace(0.0, 1.0, 13)
    for k in range(len(x) - 1):
        sag = z[k] + height + (z[k + 1] - z[k]) * u - 4 * 0.7 * u * (1 - u)
        path = np.column_stack([x[k] + span * u, np.full_like(u, y), sag])
        for ends in pairwise(path):
            _add_bar(builder, np.array(ends), 0.02, ObjectClass.WIRE)


def _add_box(builder: SceneBuilder, xy, side: float, z, kind: ObjectClass) -> None:
    half = 0.5 * side * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    base, top = (np.column_stack([half + xy, np.full(4, level)]) for level in z)
    builder.prism(base, top, kind)


def _add_bar(builder: SceneBuilder, ends: np.ndarray, radius: float, kind: ObjectClass) -> None:
    """A three-sided bar between two points (2, 3), for bars that run east."""
    ring = 2 * np.pi / 3 * np.arange(3)
    section = radius * np.column_stack([np.zeros(3), np.cos(ring), np.sin(ring)])
    builder.prism(ends[0] + section, ends[1] + section, kind)
