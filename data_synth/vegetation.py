"""Trees whose crowns let pulses through: random leaf triangles in an ellipsoid, and a trunk."""

from dataclasses import dataclass

import numpy as np

from data_synth.scene import ObjectClass, SceneBuilder

#: Leaf area over the crown's ground area. With leaves at random angles half of it faces a pulse,
#: so about exp(-1.3) of the pulses straight down pass.
LEAF_AREA_INDEX = 2.6
#: Side of a leaf triangle (a twig with its leaves, rather), m.
LEAF_SIDE = 0.35


@dataclass(frozen=True)
class Tree:
    """``x``, ``y`` of the trunk and ``base`` of the ground, m-frame; ``height`` of the top above
    ground, ``radius`` of the crown and ``stem`` height below the crown, m."""

    x: float
    y: float
    base: float
    height: float
    radius: float
    stem: float


def draw_tree(x: float, y: float, base: float, rng: np.random.Generator) -> Tree:
    """A tree of ordinary proportions."""
    radius = rng.uniform(1.6, 3.2)
    stem = rng.uniform(1.2, 2.4)
    return Tree(x, y, base, stem + radius * rng.uniform(1.6, 2.6), radius, stem)


def add_tree(builder: SceneBuilder, tree: Tree, rng: np.random.Generator) -> None:
    """Trunk to the crown's middle, and leaves."""
    middle = np.array([tree.x, tree.y, tree.base + 0.5 * (tree.stem + tree.height)])
    ring = np.linspace(0.0, 2 * np.pi, 6, endpoint=False)
    thickness = 0.06 * tree.radius
    circle = np.column_stack([np.cos(ring), np.sin(ring)])
    base, top = (
        np.column_stack([(tree.x, tree.y) + scale * thickness * circle, np.full(6, z)])
        for scale, z in ((1.0, tree.base - 0.5), (0.5, middle[2]))
    )
    builder.prism(base, top, ObjectClass.TRUNK)
    semi_axes = np.array([tree.radius, tree.radius, 0.5 * (tree.height - tree.stem)])
    corners = _leaves(middle, semi_axes, rng)
    triangles = np.arange(3 * len(corners)).reshape(-1, 3)
    builder.mesh(corners.reshape(-1, 3), triangles, ObjectClass.LEAF)


def _leaves(middle: np.ndarray, semi_axes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Triangles (L, 3, 3) of random place and attitude inside an ellipsoid."""
    area = 0.25 * np.sqrt(3.0) * LEAF_SIDE**2
    count = round(LEAF_AREA_INDEX * np.pi * semi_axes[0] * semi_axes[1] / area)
    inside = _unit_vectors(count, rng) * np.cbrt(rng.uniform(size=(count, 1)))
    first = _unit_vectors(count, rng)
    second = np.cross(first, _unit_vectors(count, rng))
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    angle = 2 * np.pi / 3 * np.arange(3)
    spread = LEAF_SIDE / np.sqrt(3.0)
    corner = first[:, None] * np.cos(angle)[:, None] + second[:, None] * np.sin(angle)[:, None]
    return middle + (inside * semi_axes)[:, None] + spread * corner


def _unit_vectors(count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3), uniform on the sphere."""
    v = rng.normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)
