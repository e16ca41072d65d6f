"""Points that a test puts on known planes: faces, their rays and matches, no segmentation involved."""

import numpy as np

from paperrepro.adjustment.matched import MatchedFaces
from paperrepro.georeference import georeference
from paperrepro.survey import Mounting, Navigation, Rays, Scanner, Survey, Trajectory

SCANNER = Scanner("test", np.deg2rad(np.linspace(-10, 10, 16)), 0.02, np.deg2rad(0.01))
NAVIGATION = Navigation("test", np.array([0.02, 0.02, 0.04]), np.deg2rad([0.025, 0.025, 0.08]), 30.0)
LEVER_ARM = np.array([0.10, -0.02, 0.15])
HEADINGS_DEG = (0.0, 180.0, 90.0, 270.0)


def gable_planes(rng, n_roofs=6):
    """Planes (2 n_roofs, 4) of gables of varied azimuth and pitch within 25 m of the origin."""
    azimuth = np.repeat(np.linspace(0, np.pi, n_roofs, endpoint=False), 2) + np.tile([0, np.pi], n_roofs)
    pitch = np.repeat(np.deg2rad(rng.uniform(18, 33, n_roofs)), 2)
    n = np.column_stack([np.sin(pitch) * np.sin(azimuth), np.sin(pitch) * np.cos(azimuth), np.cos(pitch)])
    centre = np.repeat(rng.uniform([-20, -20, 3], [20, 20, 6], (n_roofs, 3)), 2, axis=0) + 2 * n * [1, 1, 0]
    return np.column_stack([n, np.einsum("ga,ga->g", n, centre)]), centre


def rays_on_plane(rng, plane, centre, heading_deg, mounting, count, line_offset=8.0):
    """Rays (count) from a line of that heading, 30 m up, whose true points lie on ``plane`` near ``centre``."""
    heading = np.deg2rad(heading_deg)
    ahead = np.array([np.sin(heading), np.cos(heading)])
    aside = np.array([ahead[1], -ahead[0]])
    target = centre[:2] + rng.uniform(-3, 3, (count, 2))
    ring = rng.integers(0, 16, count)
    elevation = SCANNER.beam_elevations[ring]
    along = target @ ahead - 27 * np.tan(elevation)
    attitude = np.column_stack([rng.normal(0, 0.03, (count, 2)), heading + rng.normal(0, 0.03, count)])
    position = along[:, None] * ahead + line_offset * aside
    pose = np.column_stack([position, 30 + rng.normal(0, 0.2, count), attitude])
    across = (target - position) @ aside
    azimuth = -np.arctan2(across, 27.0) + attitude[:, 0]
    rays = Rays(pose, ring, azimuth, elevation, np.zeros(count))
    return _with_ranges(rays, plane, mounting)


def _with_ranges(rays, plane, mounting):
    def at(rho):
        moved = Rays(*rays._columns()[:4], np.full(len(rays), rho) - mounting.offsets(16)[rays.ring])
        return georeference(moved, mounting)

    start = at(0.0)
    step = at(1.0) - start
    rho = (plane[3] - start @ plane[:3]) / (step @ plane[:3])
    return Rays(*rays._columns()[:4], rho - mounting.offsets(16)[rays.ring])


def survey_of(start=None):
    """A `Survey` without strips, holding specifications and the start of the mounting."""
    trajectory = Trajectory(np.array([0.0, 1.0]), np.zeros((2, 3)), np.zeros((2, 3)))
    mounting = Mounting(lever_arm=LEVER_ARM) if start is None else start
    return Survey((), trajectory, mounting, SCANNER, NAVIGATION)


def matched_faces(seed=0, boresight_deg=(1.1, -0.8, 1.3), offsets=None, count=120, n_roofs=6, headings=HEADINGS_DEG):
    """`MatchedFaces` without noise, and the true `Mounting` and planes."""
    rng = np.random.default_rng(seed)
    truth = Mounting(lever_arm=LEVER_ARM, boresight=np.deg2rad(boresight_deg), range_offsets=offsets)
    planes, centres = gable_planes(rng, n_roofs)
    faces, strips, tie = [], [], []
    for plane, centre in zip(planes, centres, strict=True):
        tie.append(list(range(len(faces), len(faces) + len(headings))))
        for k, heading in enumerate(headings):
            faces.append(rays_on_plane(rng, plane, centre, heading, truth, count, line_offset=(-1) ** k * 8.0))
            strips.append(f"F{k + 1}")
    pairs = [(a, b) for members in tie for i, a in enumerate(members) for b in members[i + 1 :]]
    return MatchedFaces.build(faces, strips, tie, pairs), truth, planes
