"""Points that a test puts on known planes: faces, rays and matches, no segmentation involved."""

from dataclasses import replace

import numpy as np

from paperrepro.method.adjustment.conditions import observation_variances
from paperrepro.method.georeference import georeference
from paperrepro.method.tie_planes import TiePlanes
from paperrepro.survey import Mounting, Navigation, Rays, Scanner, Survey, Trajectory

SCANNER = Scanner("test", np.deg2rad(np.linspace(-10, 10, 16)), 0.02, np.deg2rad(0.01))
NAVIGATION = Navigation(
    "test", np.array([0.02, 0.02, 0.04]), np.deg2rad([0.025, 0.025, 0.08]), 30.0
)
LEVER_ARM = np.array([0.10, -0.02, 0.15])
HEADINGS_DEG = (0.0, 180.0, 90.0, 270.0)
BORESIGHT_DEG = (1.1, -0.8, 1.3)


def gable_planes(rng, n_roofs=6, azimuth_deg=None):
    """Planes (2 n_roofs, 4) of gables of varied pitch within 25 m of the origin, their azimuths
    varied too or all ``azimuth_deg``."""
    azimuth = np.linspace(0, np.pi, n_roofs, endpoint=False)
    if azimuth_deg is not None:
        azimuth = np.full(n_roofs, np.deg2rad(azimuth_deg))
    azimuth = np.repeat(azimuth, 2) + np.tile([0, np.pi], n_roofs)
    pitch = np.repeat(np.deg2rad(rng.uniform(18, 33, n_roofs)), 2)
    level = np.column_stack([np.sin(azimuth), np.cos(azimuth)])
    n = np.column_stack([np.sin(pitch)[:, None] * level, np.cos(pitch)])
    centre = np.repeat(rng.uniform([-20, -20, 3], [20, 20, 6], (n_roofs, 3)), 2, axis=0)
    centre += 2 * n * [1, 1, 0]
    return np.column_stack([n, np.einsum("ga,ga->g", n, centre)]), centre


def rays_on_plane(rng, plane, centre, heading_deg, mounting, count, line_offset=8.0, gusts=True):
    """Rays (count) from a line of that heading, 30 m up, that end on ``plane`` near ``centre``.

    They do so under ``mounting``, the true one. Without ``gusts`` the line is straight and level.
    """
    heading = np.deg2rad(heading_deg)
    ahead = np.array([np.sin(heading), np.cos(heading)])
    aside = np.array([ahead[1], -ahead[0]])
    target = centre[:2] + rng.uniform(-3, 3, (count, 2))
    ring = rng.integers(0, SCANNER.n_rings, count)
    elevation = SCANNER.beam_elevations[ring]
    along = target @ ahead - 27 * np.tan(elevation)
    motion = rng.normal(0, [0.2, 0.03, 0.03, 0.03], (count, 4)) * gusts
    position = along[:, None] * ahead + line_offset * aside
    mean = np.array([30, 0, 0, heading])
    pose = np.column_stack([position, mean + motion])
    across = (target - position) @ aside
    azimuth = -np.arctan2(across, 27.0) + pose[:, 3]
    return reaching(plane, Rays(pose, ring, azimuth, elevation, np.zeros(count)), mounting)


def reaching(plane, rays, mounting):
    """``rays`` with the measured range that puts each on its ``plane``, (4,) or (N, 4), under
    ``mounting``."""
    offset = mounting.offsets(SCANNER.n_rings)[rays.ring]
    start = georeference(replace(rays, rho=-offset), mounting)
    step = georeference(replace(rays, rho=1.0 - offset), mounting) - start
    on = [(plane[..., :3] * each).sum(axis=-1) for each in (start, step)]
    rho = (plane[..., 3] - on[0]) / on[1]
    return replace(rays, rho=rho - offset)


def survey_of(start=None, scanner=SCANNER, navigation=NAVIGATION):
    """A `Survey` without strips, holding specifications and the start of the mounting."""
    trajectory = Trajectory(np.array([0.0, 1.0]), np.zeros((2, 3)), np.zeros((2, 3)))
    mounting = Mounting(lever_arm=LEVER_ARM) if start is None else start
    return Survey((), trajectory, mounting, scanner, navigation)


def matched_faces(
    seed=0, boresight_deg=BORESIGHT_DEG, offsets=None, count=120, n_roofs=6,
    headings=HEADINGS_DEG, gusts=True, azimuth_deg=None,
):  # fmt: skip
    """`TiePlanes` without noise, and the true `Mounting` and planes (2 n_roofs, 4)."""
    rng = np.random.default_rng(seed)
    truth = Mounting(
        lever_arm=LEVER_ARM, boresight=np.deg2rad(boresight_deg), range_offsets=offsets
    )
    planes, centres = gable_planes(rng, n_roofs, azimuth_deg)
    faces, strips, ties = [], [], []
    for plane, centre in zip(planes, centres, strict=True):
        ties.append(list(range(len(faces), len(faces) + len(headings))))
        for k, heading in enumerate(headings):
            side = (-1) ** k * 8.0
            faces.append(rays_on_plane(rng, plane, centre, heading, truth, count, side, gusts))
            strips.append(f"F{k + 1}")
    pairs = [(a, b) for tie in ties for i, a in enumerate(tie) for b in tie[i + 1 :]]
    return TiePlanes.build(faces, strips, ties, pairs), truth, planes


def with_noise(tie_planes, rng, scale=1.0):
    """``tie_planes`` with white noise of ``scale`` times the specification on all observations."""
    sigma = scale * np.sqrt(observation_variances(NAVIGATION, SCANNER))
    rays, e = tie_planes.rays, sigma * rng.standard_normal((len(tie_planes.rays), 9))
    noisy = replace(
        rays,
        pose=rays.pose + e[:, :6],
        rho=rays.rho + e[:, 6],
        azimuth=rays.azimuth + e[:, 7],
        elevation=rays.elevation + e[:, 8],
    )
    return replace(tie_planes, rays=noisy)


def with_offsets(tie_planes, offsets):
    """``tie_planes`` as a scanner of these range offsets (rings,) m, so far zero, measures."""
    rho = tie_planes.rays.rho - np.asarray(offsets)[tie_planes.rays.ring]
    return replace(tie_planes, rays=replace(tie_planes.rays, rho=rho))


def scaled(k):
    """Specifications whose standard deviations are all ``k`` times those of the test's own."""
    scanner = replace(
        SCANNER,
        range_sigma=k * SCANNER.range_sigma,
        angle_sigma=k * SCANNER.angle_sigma,
        range_offset_sigma=k * SCANNER.range_offset_sigma,
    )
    navigation = replace(
        NAVIGATION,
        position_sigma=k * NAVIGATION.position_sigma,
        attitude_sigma=k * NAVIGATION.attitude_sigma,
    )
    return {"scanner": scanner, "navigation": navigation}
