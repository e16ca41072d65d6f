"""What real roofs and grounds have on top of their planes: tiles, sheets, sag, gutters, moss.

Each face of a gable roof gets a height map of which the plane is the least-squares plane, so truth
planes stay what they are. Shapes are functions of s along the ridge and t down the slope from it,
m. Magnitudes are those of building practice: roof tiles of 0.33 m courses with noses of 2-3 cm,
fibre cement sheets of profile 6 (177 mm by 51 mm), sag of span/200 or so, gutters of 12 cm.
"""

from collections.abc import Callable

import numpy as np
from scipy.ndimage import gaussian_filter

from data_synth.relief import HeightMap, Relief
from data_synth.scene import ObjectClass, RoofFace, Scene

#: Grid of a roof's map, m; sheets have six steps a wave.
ROOF_STEP = 0.03
#: The ground's map is a square of so many steps of so many metres, which repeats.
GROUND_SIZE, GROUND_STEP = 512, 0.125
#: Correlation lengths of the ground's roughness, m, of equal variance: clods and tufts, furrows.
GROUND_LENGTHS = (0.15, 0.6)
#: Classes that the ground's roughness lies on.
GROUND_CLASSES = (ObjectClass.GROUND,)


def tiles(s: np.ndarray, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Courses whose noses lie on the next one, each tile a wave."""
    course, width = rng.uniform(0.31, 0.36), rng.uniform(0.20, 0.30)
    saw = (t / course + rng.uniform()) % 1.0
    return saw + 0.4 * np.cos(2 * np.pi * (s / width + rng.uniform()))


def corrugated(s: np.ndarray, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Sheets whose waves run down the slope."""
    return np.cos(2 * np.pi * (s / 0.177 + rng.uniform())) + 0.0 * t


def sagging(s: np.ndarray, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The whole face between its rims, and the battens between rafters 2-4 m apart."""
    face = np.sin(np.pi * (s - s.min()) / np.ptp(s)) * np.sin(np.pi * t / t.max())
    rafters = np.cos(2 * np.pi * (s / rng.uniform(2.0, 4.0) + rng.uniform()))
    return -face + 0.2 * rafters * np.sin(np.pi * t / t.max())


def gutters(s: np.ndarray, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A gutter along the eaves, in the middle lower than the roof, and a cap on the ridge."""
    width = rng.uniform(0.10, 0.15)
    return 0.4 * (t < 0.15) - 1.0 * (t > t.max() - width) + 0.0 * s


def mossy(s: np.ndarray, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Cushions of some decimetres on a quarter of the face."""
    return np.maximum(_smooth_noise((s.size, t.size), 0.2 / ROOF_STEP, rng, "nearest") - 0.7, 0.0)


#: Shape of each kind and root mean square of its height over a face, m.
KINDS: dict[str, tuple[Callable, float]] = {
    "tiles": (tiles, 0.009),
    "corrugated": (corrugated, 0.018),
    "sagging": (sagging, 0.015),
    "gutters": (gutters, 0.010),
    "mossy": (mossy, 0.006),
}
COVERINGS, WEAR = ("tiles", "corrugated"), ("sagging", "gutters", "mossy")
#: What can be chosen: planes, one kind for all, or per building a covering with some of all wear.
ROOF_SURFACES = ("plane", *KINDS, "mixed")


#: Reflectivity at the laser's wavelength, 0-1, of what varies little, and the range that roofs and
#: walls are drawn from, building by building.
REFLECTIVITY = {ObjectClass.GROUND: 0.45, ObjectClass.LEAF: 0.5, ObjectClass.TRUNK: 0.35}
BUILDING_REFLECTIVITY = (0.1, 0.7)


def draw_reflectivity(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """(T,) of the triangles: one for a gable roof's covering, one for all else of a class."""
    by_class = rng.uniform(*BUILDING_REFLECTIVITY, len(ObjectClass))
    for kind, value in REFLECTIVITY.items():
        by_class[kind] = value
    out = by_class[scene.triangle_class]
    building = np.array([face.building for face in scene.faces], dtype=int)
    covering = rng.uniform(*BUILDING_REFLECTIVITY, building.max(initial=0) + 1)
    on_roof = scene.triangle_face >= 0
    out[on_roof] = covering[building[scene.triangle_face[on_roof]]]
    return out


def draw_relief(
    scene: Scene,
    roof_surface: str,
    roof_surface_scale: float,
    ground_roughness_m: float,
    rng: np.random.Generator,
) -> Relief | None:
    """The surfaces of a scene, or None if all are planes.

    Parameters
    ----------
    roof_surface : one of `ROOF_SURFACES`.
    roof_surface_scale : factor on the heights.
    ground_roughness_m : root mean square of the ground's, m.
    """
    roof_rng, ground_rng = rng.spawn(2)
    roofs = []
    if roof_surface != "plane" and roof_surface_scale > 0:
        covering = roof_rng.choice(COVERINGS, size=len(scene.faces))
        for face in scene.faces:
            single = {roof_surface: 1.0}
            kinds = single if roof_surface in KINDS else _mix(covering[face.building], roof_rng)
            roofs.append(roof_map(face, kinds, roof_surface_scale, roof_rng))
    ground = [ground_map(ground_roughness_m, ground_rng)] if ground_roughness_m > 0 else []
    if not roofs + ground:
        return None
    triangle_map = scene.triangle_face.copy() if roofs else np.full_like(scene.triangle_face, -1)
    if ground:
        triangle_map[np.isin(scene.triangle_class, GROUND_CLASSES)] = len(roofs)
    return Relief((*roofs, *ground), triangle_map)


def _mix(covering: str, rng: np.random.Generator) -> dict[str, float]:
    """Factors on the kinds' sizes."""
    return {str(covering): rng.uniform(0.7, 1.3), **{kind: rng.uniform(0.3, 1.5) for kind in WEAR}}


def roof_map(face: RoofFace, kinds: dict, scale: float, rng: np.random.Generator) -> HeightMap:
    """Heights over a gable face: ``kinds`` gives factors on the sizes in `KINDS`."""
    along, down = face.corners[1] - face.corners[0], face.corners[3] - face.corners[0]
    length, depth = np.linalg.norm(along), np.linalg.norm(down)
    s, t = (ROOF_STEP * np.arange(int(extent / ROOF_STEP) + 2) for extent in (length, depth))
    heights = np.zeros((s.size, t.size))
    for kind, factor in kinds.items():
        shape, rms = KINDS[kind]
        part = _without_plane(shape(s[:, None], t[None, :], rng))
        heights += factor * rms / np.sqrt((part**2).mean()) * part
    heights = (scale * heights).astype(np.float32)
    return HeightMap(heights, face.corners[0], along / length, down / depth, ROOF_STEP)


def ground_map(rms: float, rng: np.random.Generator) -> HeightMap:
    """Roughness of the ground, which repeats every 64 m."""
    shape = (GROUND_SIZE, GROUND_SIZE)
    parts = [_smooth_noise(shape, length / GROUND_STEP, rng, "wrap") for length in GROUND_LENGTHS]
    heights = np.sum(parts, axis=0)
    heights *= rms / heights.std()
    east, north, _ = np.eye(3)
    heights = (heights - heights.mean()).astype(np.float32)
    return HeightMap(heights, np.zeros(3), east, north, GROUND_STEP, True)


def _smooth_noise(shape, length: float, rng: np.random.Generator, mode: str) -> np.ndarray:
    """Gaussian noise of unit variance with a correlation of ``length`` cells."""
    noise = gaussian_filter(rng.standard_normal(shape), length, mode=mode)
    return noise / noise.std()


def _without_plane(heights: np.ndarray) -> np.ndarray:
    """Residuals of the least-squares plane; rows and columns of the grid are orthogonal."""
    heights = heights - heights.mean()
    for axis in (0, 1):
        slope = np.arange(heights.shape[axis]) - 0.5 * (heights.shape[axis] - 1)
        slope = slope[:, None] if axis == 0 else slope[None, :]
        full = np.broadcast_to(slope, heights.shape)
        heights = heights - (heights * slope).sum() / (full**2).sum() * slope
    return heights
