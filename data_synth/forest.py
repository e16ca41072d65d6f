"""The forest: a stand of tall trees with gable houses on two sides, drawn anew for every seed.

Ground and houses are the farm's. The houses stand where several strips see them, so that a flight
over the stand can be calibrated from its own roofs. m-frame, metres.
"""

import numpy as np

from data_synth.buildings import Plot
from data_synth.farm import draw_house, furnish, with_overhang
from data_synth.scene import Scene, SceneBuilder
from data_synth.terrain import Ground, add_features, add_ground, draw_ground
from data_synth.vegetation import Tree, add_tree

#: Half extents of the stand, m: 0.5 ha, and its trees, 400 per ha.
STAND_EXTENT = (28.0, 45.0)
N_TREES = 200
#: Least distances between stems, and from a stem to a roof, m.
STEM_SPACING, ROOF_SPACING = 3.0, 3.0
#: Middles of the houses' sites at the edge of the stand, m.
SITES = tuple((x, y) for x in (-46.0, 46.0) for y in (-38.0, 0.0, 38.0))


def build_forest(
    rng: np.random.Generator,
    relief: float = 1.0,
    natural: np.random.Generator | None = None,
) -> Scene:
    """The whole scene; ``relief`` and ``natural`` as `data_synth.farm.build_farm`."""
    builder = SceneBuilder()
    ground = draw_ground(rng, relief)
    houses = [draw_house(np.array(site), ground, rng) for site in SITES]
    if natural is not None:
        stand = Plot(0.0, 0.0, 0.0, 2 * STAND_EXTENT[1], 2 * STAND_EXTENT[0])
        ground = add_features(ground, [stand, *map(with_overhang, houses)], natural)
    add_ground(builder, ground)
    for number, house in enumerate(houses):
        furnish(builder, house, number, rng)
    plots = [with_overhang(house) for house in houses]
    for tree in draw_stand(plots, ground, rng):
        add_tree(builder, tree, rng)
    return builder.build()


def draw_stand(plots, ground: Ground, rng: np.random.Generator) -> list[Tree]:
    """`N_TREES` trees, clear of one another and of ``plots``, by rejection: the stand has room for
    twice as many, so it ends."""
    stems, trees = np.empty((0, 2)), []
    while len(trees) < N_TREES:
        xy = rng.uniform(-1.0, 1.0, 2) * STAND_EXTENT
        clear = all(plot.distance(xy)[0] > ROOF_SPACING for plot in plots)
        if clear and (np.hypot(*(stems - xy).T) > STEM_SPACING).all():
            stems = np.vstack([stems, xy])
            trees.append(draw_forest_tree(*xy, float(ground.height(*xy)), rng))
    return trees


def draw_forest_tree(x: float, y: float, base: float, rng: np.random.Generator) -> Tree:
    """A tree as they grow in a stand: 8-18 m tall, its crown narrow and high up."""
    height, radius = rng.uniform(8.0, 18.0), rng.uniform(1.4, 2.6)
    return Tree(x, y, base, height, radius, height * rng.uniform(0.35, 0.55))
