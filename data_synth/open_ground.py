"""Scenes without a gable roof: a yard with cars, walls, containers and heaps, and fields.

What is planar there is small, upright or natural. m-frame, metres.
"""

from dataclasses import replace

import numpy as np

from data_synth.buildings import Plot
from data_synth.farm import FENCE_Y, WIRE_Y, Layout, add_fence, add_trees, add_wire, lane
from data_synth.scene import ObjectClass, Scene, SceneBuilder
from data_synth.terrain import Ground, add_features, add_ground, draw_ground

#: Half extents of the part where anything stands, m: the farm's.
EXTENT = Layout().extent
#: Rows of the car park, north m, cars a row, their spacing, m, and share of places taken.
CAR_ROWS, PLACES, PLACE_WIDTH, TAKEN = (-20.0, -9.0, 9.0, 20.0), 24, 2.7, 0.7
#: The car park's ground, kept free of all else.
CAR_PARK = Plot(0.0, 0.0, np.pi / 2, PLACES * PLACE_WIDTH + 6.0, 50.0)
N_WALLS, N_CONTAINERS, N_HEAPS, N_TREES = 6, 10, 8, 12
#: A shipping container of twenty feet: length, width, height, m.
CONTAINER = (6.06, 2.44, 2.59)


def build_yard(
    rng: np.random.Generator,
    relief: float = 1.0,
    natural: np.random.Generator | None = None,
) -> Scene:
    """A car park, and round it walls, containers, heaps and trees by rejection; ``relief`` and
    ``natural`` as `data_synth.farm.build_farm`."""
    builder, plots = SceneBuilder(), [CAR_PARK]
    ground = draw_ground(rng, relief)
    walls = [_place(plots, (rng.uniform(8, 20), 0.3), rng) for _ in range(N_WALLS)]
    containers = [_place(plots, CONTAINER[:2], rng) for _ in range(N_CONTAINERS)]
    heaps = [_place(plots, 2 * (rng.uniform(6.0, 13.0),), rng) for _ in range(N_HEAPS)]
    if natural is not None:
        ground = add_features(ground, plots, natural)
        plots += [feature.plot for feature in ground.features]
    add_ground(builder, ground)
    for plot in walls:
        _add_block(builder, _on(ground, plot), (-1.0, rng.uniform(2.0, 3.0)), ObjectClass.WALL)
    for plot in containers:
        top = CONTAINER[2] * rng.choice([1, 1, 2])
        _add_block(builder, _on(ground, plot), (-0.5, top), ObjectClass.CONTAINER)
    for plot in heaps:
        _add_heap(builder, _on(ground, plot), np.radians(rng.uniform(28.0, 37.0)))
    for y in CAR_ROWS:
        for place in np.flatnonzero(rng.uniform(size=PLACES) < TAKEN):
            x = PLACE_WIDTH * (place - 0.5 * (PLACES - 1)) + rng.uniform(-0.2, 0.2)
            facing = rng.choice([0.0, np.pi]) + rng.normal(0.0, 0.03)
            size = rng.uniform(3.9, 4.8), rng.uniform(1.7, 1.9)
            add_car(builder, _on(ground, Plot(x, y + rng.uniform(-0.4, 0.4), facing, *size)))
    add_trees(builder, plots, [], ground, EXTENT, N_TREES, rng)
    return builder.build()


def build_fields(
    rng: np.random.Generator,
    relief: float = 1.0,
    natural: np.random.Generator | None = None,
) -> Scene:
    """Ground, trees, a fence and a wire: with ``natural`` terrain its slopes are all there is."""
    builder, ground = SceneBuilder(), draw_ground(rng, relief)
    if natural is not None:
        ground = add_features(ground, [], natural)
    add_ground(builder, ground)
    add_fence(builder, ground, FENCE_Y, 60.0)
    add_wire(builder, ground, WIRE_Y, 90.0)
    lanes = [lane(FENCE_Y, 60.0), lane(WIRE_Y, 90.0)]
    add_trees(builder, lanes, [], ground, EXTENT, N_TREES, rng)
    return builder.build()


def add_car(builder: SceneBuilder, plot: Plot) -> None:
    """Body and cabin."""
    _add_block(builder, plot, (0.2, 0.85), ObjectClass.CAR)
    cabin = Plot(plot.x, plot.y, plot.azimuth, 0.55 * plot.length, 0.9 * plot.width, plot.base)
    _add_block(builder, cabin, (0.85, 1.45), ObjectClass.CAR, 0.75)


def _add_heap(builder: SceneBuilder, plot: Plot, slope: float) -> None:
    """Eight planar sides at the angle of repose, its top cut off."""
    radius = 0.5 * plot.length
    turn = 2 * np.pi / 8 * np.arange(8)
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    drop = 0.5  # below the ground at the middle, so that no side stands free
    outer, inner = radius + drop / np.tan(slope), 0.25 * radius
    height = (radius - inner) * np.tan(slope)
    base, top = (
        plot.place(np.column_stack([size * circle, np.full(8, z)]))
        for size, z in ((outer, -drop), (inner, height))
    )
    builder.prism(base, top, ObjectClass.HEAP)


def _add_block(builder: SceneBuilder, plot: Plot, z, kind: ObjectClass, upper: float = 1.0) -> None:
    """A box from ``z[0]`` to ``z[1]`` m above the plot's base, its lid ``upper`` times its size."""
    corner = 0.5 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (plot.length, plot.width)
    base, top = (
        plot.place(np.column_stack([size * corner, np.full(4, level)]))
        for size, level in ((1.0, z[0]), (upper, z[1]))
    )
    builder.prism(base, top, kind)


def _place(plots: list[Plot], size, rng: np.random.Generator) -> Plot:
    """A plot of ``size`` (2,) m and any azimuth, clear of ``plots``, which it joins."""
    while True:
        x, y = rng.uniform(-1.0, 1.0, 2) * EXTENT
        plot = Plot(float(x), float(y), rng.uniform(0.0, np.pi), *map(float, size))
        if all(plot.clear_of(other, 1.0) for other in plots):
            plots.append(plot)
            return plot


def _on(ground: Ground, plot: Plot) -> Plot:
    """The same at the ground's height."""
    return replace(plot, base=float(ground.height(plot.x, plot.y)))
