"""From a configuration to a survey and its truth.

Streams of random numbers: scene, flight, navigation, sensor (one per strip), range offsets and
reference each have a child of the seed, so a change of one leaves the others as they are.
"""

from dataclasses import dataclass

import numpy as np

from data_synth import reference
from data_synth.farm import build_farm
from data_synth.flight import FlightLine, flight_plan, fly
from data_synth.forest import build_forest
from data_synth.motion import Motion
from data_synth.navigation import apx15, disturb
from data_synth.presets import SimulationConfig
from data_synth.raycast import Raycaster
from data_synth.recording import Recorder
from data_synth.scene import RoofFace, Scene
from data_synth.sensors import N_RINGS, vlp16_hires
from paperrepro.survey import Mounting, Survey, Trajectory

#: From the GNSS/INS to the laser, b-frame, m; surveyed on the ground, so known.
LEVER_ARM = np.array([0.10, -0.02, 0.15])
#: What builds each of `presets.SCENES`.
BUILDERS = {"farm": build_farm, "forest": build_forest}
STREAMS = ("scene", "flight", "navigation", "sensor", "offsets", "reference")


@dataclass(frozen=True)
class Truth:
    """What a real survey never tells.

    ``boresight`` (3,) rad; ``range_offsets`` (16,) m, to be added to the measured ranges;
    ``lever_arm`` (3,) m b-frame; ``trajectory`` without error, and ``motion``, the function of time
    it samples; ``faces`` of the gable roofs; per strip ``labels`` (N,) int32, the face hit or -1,
    and ``classes`` (N,) uint8 of `ObjectClass`; the ``scene`` and the ``lines`` as planned.
    """

    boresight: np.ndarray
    range_offsets: np.ndarray
    lever_arm: np.ndarray
    trajectory: Trajectory
    motion: Motion
    faces: tuple[RoofFace, ...]
    labels: tuple[np.ndarray, ...]
    classes: tuple[np.ndarray, ...]
    scene: Scene
    lines: tuple[FlightLine, ...]

    @property
    def mounting(self) -> Mounting:
        """The true `Mounting`."""
        return Mounting(
            lever_arm=self.lever_arm, boresight=self.boresight, range_offsets=self.range_offsets
        )


def simulate(config: SimulationConfig | None = None) -> tuple[Survey, Truth]:
    """Fly over the scene: what the operator gets, and the truth. A seed gives the same bits."""
    config = SimulationConfig() if config is None else config
    seeds = dict(zip(STREAMS, np.random.SeedSequence(config.seed).spawn(len(STREAMS)), strict=True))
    rng = {name: np.random.default_rng(seed) for name, seed in seeds.items() if name != "sensor"}
    scene, lines = BUILDERS[config.scene](rng["scene"]), flight_plan()
    motion, caster = fly(lines, rng["flight"]), Raycaster(scene)
    known = Mounting(lever_arm=LEVER_ARM)
    offsets = config.range_offset_sigma_m * rng["offsets"].normal(size=N_RINGS)
    true = known.with_calibration(config.boresight, offsets)
    recorder = Recorder(caster, scene, motion, vlp16_hires(), true, config.sensor_noise)
    strips, labels, classes = _record_all(recorder, lines, config.thinning, seeds["sensor"])
    trajectory = motion.record()
    reported = disturb(trajectory, config.noise_scale, rng["navigation"])
    cloud = reference.scan(caster, config.reference_noise, rng["reference"])
    navigation = apx15(config.noise_scale)
    survey = Survey(strips, reported, known, recorder.scanner, navigation, cloud)
    truth = Truth(
        boresight=true.boresight,
        range_offsets=offsets,
        lever_arm=LEVER_ARM,
        trajectory=trajectory,
        motion=motion,
        faces=scene.faces,
        labels=labels,
        classes=classes,
        scene=scene,
        lines=lines,
    )
    return survey, truth


def _record_all(recorder: Recorder, lines, thinning: int, seed: np.random.SeedSequence):
    """Strips, labels and classes of all lines, each line with its own random stream."""
    records = [
        recorder.record(line, thinning, np.random.default_rng(child))
        for line, child in zip(lines, seed.spawn(len(lines)), strict=True)
    ]
    return zip(*records, strict=True)
