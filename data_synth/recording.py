"""One flight line through the scanner: pulses, rays, noise, a strip."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from data_synth.flight import FlightLine
from data_synth.motion import Motion
from data_synth.raycast import BATCH, Raycaster, aim
from data_synth.scene import ObjectClass, Scene
from data_synth.sensors import (
    MAX_RANGE,
    MIN_RANGE,
    Model,
    Pulses,
    ScannerErrors,
    fire,
    range_noise_factor,
)
from paperrepro.errors import BadInput
from paperrepro.survey import Mounting, Scanner, Strip

#: Share of the returns that come from dust in the air before the target.
DUST_SHARE = 1e-4


@dataclass(frozen=True)
class PulseNoise:
    """Per pulse: ``range`` m and ``azimuth`` rad, added to what is recorded; ``elevation`` rad, by
    which the beam really leaves its nominal angle; ``dust`` 0-1, the share of the way to the target
    after which dust answers, or 1."""

    range: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray
    dust: np.ndarray


def draw_pulse_noise(count: int, scanner: Scanner, rng: np.random.Generator) -> PulseNoise:
    """White noise by the specification, and dust."""
    dust = np.ones(count)
    hit = rng.uniform(size=count) < DUST_SHARE
    dust[hit] = rng.uniform(0.1, 0.95, hit.sum())
    return PulseNoise(
        scanner.range_sigma * rng.standard_normal(count),
        scanner.angle_sigma * rng.standard_normal(count),
        scanner.angle_sigma * rng.standard_normal(count),
        dust,
    )


@dataclass(frozen=True)
class Recorder:
    """Scanner, a ``model``, in its true ``mounting`` on its true ``motion`` over a ``scene``, with
    its ``errors``; ``reflectivity`` (T,) of the scene's triangles where range noise needs it."""

    caster: Raycaster
    scene: Scene
    motion: Motion
    model: Model
    mounting: Mounting
    noisy: bool
    errors: ScannerErrors = field(default_factory=ScannerErrors)
    reflectivity: np.ndarray | None = None

    @cached_property
    def scanner(self) -> Scanner:
        """By its data sheet."""
        return self.model.specification

    def record(
        self, line: FlightLine, thinning: int, rng: np.random.Generator
    ) -> tuple[Strip, np.ndarray, np.ndarray]:
        """The `Strip` of a line, the gable face each point lies on (N,) int32, -1 for none, and its
        `ObjectClass` (N,) uint8. Pulses without an answer within 100 m leave no point. Raises
        `BadInput` where no pulse has one."""
        pulses = fire(line.start_time, line.end_time - line.start_time, thinning, self.model)
        count = len(pulses)
        silent = PulseNoise(np.zeros(count), np.zeros(count), np.zeros(count), np.ones(count))
        noise = draw_pulse_noise(count, self.scanner, rng) if self.noisy else silent
        distance, triangle, growth = self._measure(pulses, noise.elevation)
        distance *= noise.dust
        with np.errstate(invalid="ignore"):
            kept = (distance >= MIN_RANGE) & (distance <= MAX_RANGE)
        if not kept.any():
            raise BadInput(
                f"line {line.name}: no pulse meets anything within {MAX_RANGE:g} m; plan it over "
                "the site and lower"
            )
        face, kind = self._identify(triangle, noise.dust < 1)
        distance *= 1.0 + self.errors.range_scale
        offset = self.mounting.offsets(self.scanner.n_rings)[pulses.ring]
        rho = distance - offset + noise.range * growth
        azimuth, time = pulses.azimuth + noise.azimuth, pulses.time + self.errors.clock_delay
        strip = Strip(line.name, *(c[kept] for c in (time, pulses.ring, azimuth, rho)))
        if not len(self.scanner.beam_elevations):
            strip = replace(strip, elevation=pulses.elevation[kept])
        return strip, face[kept], kind[kept]

    def _measure(self, pulses: Pulses, elevation_noise):
        """True distance (N,) m and triangle (N,) of every pulse, and the growth (N,) of its range
        noise, in batches."""
        count = len(pulses)
        distance, triangle = np.empty(count), np.empty(count, dtype=np.int32)
        growth, errors = np.ones(count), self.errors
        for start in range(0, count, BATCH):
            part = slice(start, start + BATCH)
            pose, ring = self.motion.at(pulses.time[part]), pulses.ring[part]
            elevation = pulses.elevation[part] + elevation_noise[part]
            elevation += errors.elevation_offsets[ring]
            azimuth = pulses.azimuth[part] + errors.azimuth_offsets[ring]
            origin, direction = aim(pose, azimuth, elevation, self.mounting)
            distance[part], triangle[part] = self.caster.cast(origin, direction)
            if errors.noise_growth:
                growth[part] = self._growth(direction, distance[part], triangle[part])
        return distance, triangle, growth

    def _growth(self, direction, distance, triangle) -> np.ndarray:
        """Of the range noise; meaningless where nothing is met."""
        cosine = np.abs(np.einsum("ij,ij->i", self.scene.planes[triangle, :3], direction))
        reflectivity, power = self.reflectivity[triangle], self.errors.noise_growth
        return range_noise_factor(reflectivity, cosine, distance, power)

    def _identify(self, triangle: np.ndarray, dust: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        face, kind = self.scene.triangle_face[triangle], self.scene.triangle_class[triangle]
        face[dust], kind[dust] = -1, ObjectClass.DUST
        return face, kind
