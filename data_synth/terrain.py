"""The ground: rolling, or with banks, ditches and dams as nature and farmers leave them.

Banks, ditches and dams have planar slopes of 20-35 degrees, some metres wide; on the grid of the
ground their edges are rounded by a metre. m-frame, metres; the ground's mean height is 0.
"""

from dataclasses import dataclass, replace

import numpy as np

from data_synth.buildings import Plot
from data_synth.scene import ObjectClass, SceneBuilder

#: Half extents of the ground, m, and its largest slope.
GROUND_EXTENT = (200.0, 150.0)
MAX_SLOPE = 0.04
#: Grid of rolling ground, and of ground with features, which ends so far within the ground, m.
COARSE_STEP, FINE_STEP, FINE_MARGIN = 4.0, 1.0, (64.0, 74.0)
#: Features tried and placed at most, and how far within the ground their middles lie, m.
N_TRIES, N_FEATURES, FEATURE_MARGIN = 400, 14, (85.0, 88.0)
#: Slopes of the gentle side of a bank, and of the ends of all, rad.
GENTLE, END = np.radians(7.0), np.radians(25.0)


@dataclass(frozen=True)
class Slopes:
    """A bank, ditch or dam on ``plot``: sides that rise inwards from its rim at ``left``, ``right``
    (t) and ``end`` (s), tangents, up to ``height`` m; a ditch has a negative one, and falls."""

    plot: Plot
    left: float
    right: float
    end: float
    height: float

    def rise(self, x, y) -> np.ndarray:
        """Over the ground without it, m, of the shape of ``x`` and ``y``."""
        east, north = np.asarray(x) - self.plot.x, np.asarray(y) - self.plot.y
        (s_e, s_n), (t_e, t_n) = self.plot.axes
        s, t = s_e * east + s_n * north, t_e * east + t_n * north
        inward = np.minimum(
            self.left * (0.5 * self.plot.width + t), self.right * (0.5 * self.plot.width - t)
        )
        inward = np.minimum(inward, self.end * (0.5 * self.plot.length - np.abs(s)))
        return np.sign(self.height) * np.clip(inward, 0.0, abs(self.height))


@dataclass(frozen=True)
class Ground:
    """Rolling ground: waves of ``wave`` (W, 2) rad/m, ``amplitude`` (W,) m, ``phase`` (W,) rad, and
    ``features`` on it."""

    wave: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray
    features: tuple[Slopes, ...] = ()

    def height(self, x, y) -> np.ndarray:
        """m, of the shape of ``x`` and ``y``."""
        argument = np.multiply.outer(x, self.wave[:, 0]) + np.multiply.outer(y, self.wave[:, 1])
        height = np.sin(argument + self.phase) @ self.amplitude
        for feature in self.features:
            height = height + feature.rise(x, y)
        return height


def draw_ground(rng: np.random.Generator, relief: float = 1.0) -> Ground:
    """Waves of 90-280 m whose slopes together stay below `MAX_SLOPE`, times ``relief``."""
    count = 5
    length, azimuth = rng.uniform(90.0, 280.0, count), rng.uniform(0.0, np.pi, count)
    wave = (2 * np.pi / length)[:, None] * np.column_stack([np.sin(azimuth), np.cos(azimuth)])
    slope = rng.uniform(0.4, 1.0, count)
    slope *= MAX_SLOPE / slope.sum()
    amplitude = relief * (slope * length / (2 * np.pi))
    return Ground(wave, amplitude, rng.uniform(0.0, 2 * np.pi, count))


def add_features(
    ground: Ground, taken: list[Plot], rng: np.random.Generator, extent=GROUND_EXTENT
) -> Ground:
    """The ground of half extents ``extent`` (2,) m with banks, ditches and dams in turn, wherever
    they are clear of ``taken`` and of one another."""
    features: list[Slopes] = []
    for _ in range(N_TRIES):
        draw = (draw_dam, draw_ditch, draw_bank)[len(features) % 3]
        x, y = rng.uniform(-1.0, 1.0, 2) * np.subtract(extent, FEATURE_MARGIN)
        one = draw(float(x), float(y), rng)
        others = [*taken, *(feature.plot for feature in features)]
        if all(one.plot.clear_of(other, 1.0) for other in others):
            features.append(one)
        if len(features) == N_FEATURES:
            break
    return replace(ground, features=tuple(features))


def draw_dam(x: float, y: float, rng: np.random.Generator) -> Slopes:
    """A dam of any azimuth: a level crest between two slopes."""
    return _draw(x, y, rng.uniform(1.5, 3.0), rng.uniform(1.0, 3.0), rng)


def draw_ditch(x: float, y: float, rng: np.random.Generator) -> Slopes:
    """The same into the ground."""
    return _draw(x, y, -rng.uniform(1.0, 2.0), rng.uniform(0.5, 1.5), rng)


def draw_bank(x: float, y: float, rng: np.random.Generator) -> Slopes:
    """A step of the ground: steep on one side, on the other it runs out."""
    height, steep, gentle = rng.uniform(1.0, 2.0), np.tan(_steep(rng)), np.tan(GENTLE)
    width = height / steep + height / gentle
    plot = Plot(x, y, rng.uniform(0.0, 2 * np.pi), rng.uniform(12.0, 25.0), width)
    return Slopes(plot, steep, gentle, np.tan(END), height)


def _draw(x, y, height: float, level: float, rng: np.random.Generator) -> Slopes:
    left, right = np.tan(_steep(rng)), np.tan(_steep(rng))
    width = abs(height) * (1.0 / left + 1.0 / right) + level
    plot = Plot(x, y, rng.uniform(0.0, np.pi), rng.uniform(12.0, 30.0), width)
    return Slopes(plot, left, right, np.tan(END), height)


def _steep(rng: np.random.Generator) -> float:
    return np.radians(rng.uniform(20.0, 35.0))


def add_ground(builder: SceneBuilder, ground: Ground, extent=GROUND_EXTENT) -> None:
    """A grid of triangles of half extents ``extent`` (2,) m, finer where there are features."""
    lines = (
        _grid_lines(half, half - margin, bool(ground.features))
        for half, margin in zip(extent, FINE_MARGIN, strict=True)
    )
    X, Y = np.meshgrid(*lines, indexing="ij")
    vertices = np.column_stack([X.ravel(), Y.ravel(), ground.height(X, Y).ravel()])
    index = np.arange(X.size).reshape(X.shape)
    a, b = index[:-1, :-1].ravel(), index[1:, :-1].ravel()
    c, d = index[1:, 1:].ravel(), index[:-1, 1:].ravel()
    triangles = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    builder.mesh(vertices, triangles, ObjectClass.GROUND)


def _grid_lines(extent: float, middle: float, fine: bool) -> np.ndarray:
    """Coordinates of a grid's lines along one axis, m, closer in the ``middle`` if ``fine``."""
    coarse = np.arange(-extent, extent + COARSE_STEP, COARSE_STEP)
    if not fine:
        return coarse
    inner = np.arange(-middle, middle + 0.5 * FINE_STEP, FINE_STEP)
    return np.concatenate([coarse[coarse < -middle], inner, coarse[coarse > middle]])
