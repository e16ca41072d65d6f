"""From a configuration to a survey and its truth.

Streams of random numbers: every kind of error has a child of the seed, the sensor one per strip, so
a change of one leaves the others as they are. New ones are appended, and leave the old ones too.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from data_synth import reference
from data_synth.farm import Layout, build_farm
from data_synth.flight import FlightLine, flight_plan, fly
from data_synth.forest import build_forest
from data_synth.motion import Motion, draw_unseen_vibration
from data_synth.navigation import disturb
from data_synth.open_ground import build_fields, build_yard
from data_synth.presets import SimulationConfig
from data_synth.raycast import Raycaster
from data_synth.recording import Recorder
from data_synth.relief import Relief
from data_synth.scene import RoofFace, Scene
from data_synth.sensors import SCANNERS, ScannerErrors
from data_synth.surfaces import draw_reflectivity, draw_relief
from paperrepro.survey import Mounting, Survey, Trajectory

#: From the GNSS/INS to the laser, b-frame, m; surveyed on the ground, so known.
LEVER_ARM = np.array([0.10, -0.02, 0.15])
#: What builds each of `presets.SCENES`.
BUILDERS = {
    "farm": build_farm,
    "forest": build_forest,
    "yard": build_yard,
    "fields": build_fields,
}
STREAMS = (
    "scene", "flight", "navigation", "sensor", "offsets", "reference",
    "unseen vibration", "lever arm", "beam elevations", "beam azimuths", "reflectivity",
    "surfaces", "terrain",
)  # fmt: skip


@dataclass(frozen=True)
class Truth:
    """What a real survey never tells.

    ``boresight`` (3,) rad; ``range_offsets`` (rings,) m, to be added to the measured ranges;
    ``lever_arm`` (3,) m b-frame; ``trajectory`` of the scanner's body without error, with any
    vibration that the GNSS/INS does not see, and ``motion``, the function of time it samples;
    ``faces`` of the gable roofs; per strip ``labels`` (N,) int32, the face hit or -1, and
    ``classes`` (N,) uint8 of `ObjectClass`; the ``scene`` and the ``lines`` as planned;
    ``scanner_errors``; the ``relief`` of surfaces that are no planes, or None.

    A strip's time stamps are those of the laser: the trajectory's plus
    ``scanner_errors.clock_delay``.
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
    scanner_errors: ScannerErrors = field(default_factory=ScannerErrors)
    relief: Relief | None = None

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
    natural = rng["terrain"] if config.terrain == "natural" else None
    layout = Layout(config.site_rows, config.site_columns)
    sites = {"layout": layout} if config.scene == "farm" else {}
    scene = BUILDERS[config.scene](rng["scene"], config.ground_relief, natural, **sites)
    lines, model = flight_plan(config.plan), SCANNERS[config.scanner]
    relief = draw_relief(
        scene, config.roof_surface, config.roof_surface_scale, config.ground_roughness_m,
        rng["surfaces"],
    )  # fmt: skip
    caster = Raycaster(scene, relief)
    reported = fly(lines, rng["flight"], config.gust_scale, config.vibration_scale)
    unseen = draw_unseen_vibration(config.unseen_vibration_deg, rng["unseen vibration"])
    motion = reported.vibrating(unseen) if config.unseen_vibration_deg else reported
    known = Mounting(lever_arm=LEVER_ARM)
    offsets = config.range_offset_sigma_m * rng["offsets"].normal(size=model.n_rings)
    true = known.with_calibration(config.boresight, offsets)
    errors = draw_scanner_errors(config, rng)
    reflectivity = draw_reflectivity(scene, rng["reflectivity"])
    recorder = Recorder(
        caster, scene, motion, model, true, config.sensor_noise, errors, reflectivity
    )
    strips, labels, classes = _record_all(recorder, lines, config.thinning, seeds["sensor"])
    trajectory = motion.record()
    without = trajectory if motion is reported else reported.record()
    measured, navigation = disturb(
        without, config.noise_scale, rng["navigation"], config.navigation
    )
    told = replace(
        known, lever_arm=LEVER_ARM + config.lever_arm_sigma_m * rng["lever arm"].normal(size=3)
    )
    cloud = reference.scan(caster, config.reference_noise, rng["reference"], layout.reach)
    survey = Survey(strips, measured, told, recorder.scanner, navigation, cloud)
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
        scanner_errors=errors,
        relief=relief,
    )
    return survey, truth


def draw_scanner_errors(config: SimulationConfig, rng: dict) -> ScannerErrors:
    """As ``config`` sizes them, from the streams of ``rng``."""
    n_rings = SCANNERS[config.scanner].n_rings
    elevation, azimuth = (
        np.radians(sigma_deg) * rng[f"beam {name}"].normal(size=n_rings)
        for name, sigma_deg in (
            ("elevations", config.beam_elevation_sigma_deg),
            ("azimuths", config.beam_azimuth_sigma_deg),
        )
    )
    return ScannerErrors(
        elevation_offsets=elevation,
        azimuth_offsets=azimuth,
        range_scale=1e-6 * config.range_scale_ppm,
        noise_growth=config.range_noise_growth,
        clock_delay=config.clock_delay_s,
    )


def _record_all(recorder: Recorder, lines, thinning: int, seed: np.random.SeedSequence):
    """Strips, labels and classes of all lines, each line with its own random stream."""
    records = [
        recorder.record(line, thinning, np.random.default_rng(child))
        for line, child in zip(lines, seed.spawn(len(lines)), strict=True)
    ]
    return zip(*records, strict=True)
