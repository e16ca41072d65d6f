"""Planes of any kind found in all strips and matched, for flights without gable roofs.

As `pipeline.find_roofs` does with roofs: coarse and with the central beams first, then all beams,
until the boresight under which the patches were found no longer changes.
"""

from dataclasses import dataclass, replace

import numpy as np

from paperrepro.adjustment.matched import LEAST_PLANES, MatchedFaces, Rejection
from paperrepro.adjustment.screening import screen
from paperrepro.adjustment.trajectory import lasting_sigma
from paperrepro.errors import TooFewPlanes
from paperrepro.georeference import georeference
from paperrepro.matching import FaceKey
from paperrepro.passes import Progress, settle, silent
from paperrepro.patch_matching import (
    PatchMatchParameters,
    choose,
    common_footprint,
    match_patches,
)
from paperrepro.segmentation.patches import Patches, PatchParameters, find_patches
from paperrepro.survey import Mounting, Rays, Survey


@dataclass(frozen=True)
class PatchPass:
    """One pass: beams within ``fan_deg`` of the scanner's equator."""

    patches: PatchParameters
    matching: PatchMatchParameters
    fan_deg: float

    @classmethod
    def coarse(cls, tile_m: float) -> "PatchPass":
        """For boresights wrong by up to 3 degrees; see `matching.MatchParameters.coarse`."""
        inclination = max(10.0, 3 * normal_noise_deg(tile_m))
        matching = PatchMatchParameters(3.0, max(tile_m, 3.0), inclination, same_tile=False)
        return cls(PatchParameters.coarse(tile_m), matching, fan_deg=3.5)

    @classmethod
    def fine(cls, tile_m: float) -> "PatchPass":
        """All beams, for a boresight right to 0.2 degrees."""
        inclination = max(3.0, 3 * normal_noise_deg(tile_m))
        matching = PatchMatchParameters(0.3, tile_m, inclination, same_tile=True)
        return cls(PatchParameters.fine(tile_m), matching, fan_deg=90.0)


def normal_noise_deg(tile_m: float, roughness_m: float = 0.03, independent: int = 10) -> float:
    """To what a normal is known whose patch departs from its plane by ``roughness_m`` in so many
    ``independent`` places: 3 degrees at 0.6 m, half a degree at 4 m."""
    return float(np.degrees(roughness_m / np.sqrt(independent) / (tile_m / np.sqrt(12))))


@dataclass(frozen=True)
class PatchSurvey:
    """Patches found and matched under ``mounting``; ``matched`` what the adjustment takes, its
    faces in the order of ``keys``; ``rejected`` faces, wrong matches left out of ``matched``;
    ``found`` patches a strip and ``tied`` places that two strips or more show; ``boresights``
    (passes + 1, 3) rad, as the passes went."""

    mounting: Mounting
    matched: MatchedFaces
    keys: tuple[FaceKey, ...]
    rejected: tuple[Rejection, ...]
    found: dict[str, int]
    tied: int
    boresights: np.ndarray


#: Most points of a strip that are looked at, of a face that are adjusted, and planes.
MOST_POINTS, MOST_OF_FACE, MOST_PLANES = 400_000, 400, 200
#: Edge of a patch: at most so many metres, at least so many, and so many patches in a strip. The
#: fewest points that a patch of a strip should have sets a limit from below, too.
TILE_M, TILES_PER_STRIP, POINTS_PER_TILE = (0.6, 4.0), 200, 100
#: The passes end when the boresight changes by less, in degrees or in its standard deviations, or
#: when there were too many.
SETTLED_DEG, SETTLED_SIGMAS, MAX_PASSES = 0.02, 0.5, 12


def sample_rays(survey: Survey, seed: int = 0) -> dict[str, Rays]:
    """At most `MOST_POINTS` rays of each strip, drawn at random, in their order."""
    generators = np.random.default_rng(seed).spawn(len(survey.strips))
    samples = {}
    for strip, rng in zip(survey.strips, generators, strict=True):
        index = slice(None)
        if len(strip) > MOST_POINTS:
            index = np.sort(rng.choice(len(strip), MOST_POINTS, replace=False))
        samples[strip.name] = survey.rays(strip, index)
    return samples


def tile_size(samples: dict[str, Rays], mounting: Mounting) -> float:
    """Edge of the patches, m, that suits the extent and the density of the strips."""
    edges = []
    for rays in samples.values():
        cell = np.unique(np.floor(georeference(rays, mounting)[:, :2]).astype(int), axis=0)
        density = len(rays) / len(cell)  # points a square metre
        edges.append(max(np.sqrt(len(cell) / TILES_PER_STRIP), np.sqrt(POINTS_PER_TILE / density)))
    return float(np.clip(np.median(edges), *TILE_M))


def find_planes(survey: Survey, settled: bool = False, progress: Progress = silent) -> PatchSurvey:
    """Planar patches of all strips and their matches, from the survey's own mounting as start.

    ``settled``: that mounting is right to 0.2 degrees already. Raises `TooFewPlanes`,
    `RankDefect`, `NoConvergence`.
    """
    samples = sample_rays(survey)
    tile_m = tile_size(samples, survey.mounting)
    fine = PatchPass.fine(tile_m)
    return settle(
        survey,
        lambda mounting, step: planes_under(survey, samples, mounting, step),
        [fine] if settled else [PatchPass.coarse(tile_m), fine],
        MAX_PASSES,
        lambda found, x: _settled_deg(survey, found.matched, x),
        progress,
    )


def _settled_deg(survey: Survey, matched: MatchedFaces, boresight: np.ndarray) -> np.ndarray:
    """Change (3,) deg of an angle that does not matter: small, or small against its sigma. Where a
    flight hardly determines an angle, each pass draws another one."""
    sigma = np.rad2deg(lasting_sigma(survey, matched, boresight))
    return np.maximum(SETTLED_DEG, SETTLED_SIGMAS * sigma)


def planes_under(
    survey: Survey, samples: dict[str, Rays], mounting: Mounting, step: PatchPass
) -> PatchSurvey:
    """One pass: patches found and matched as they lie under ``mounting``."""
    in_fan = np.abs(survey.scanner.beam_elevations) <= np.deg2rad(step.fan_deg)
    rays = {name: r if in_fan.all() else r.take(in_fan[r.ring]) for name, r in samples.items()}
    p_m = {name: georeference(r, mounting) for name, r in rays.items()}
    patches = {name: find_patches(p, step.patches) for name, p in p_m.items()}
    ties = match_patches(patches, step.matching)
    found = {name: len(of_strip) for name, of_strip in patches.items()}
    if len(ties) < LEAST_PLANES:
        counts = ", ".join(f"{name} {count}" for name, count in found.items())
        raise TooFewPlanes(
            f"expected at least {LEAST_PLANES} planar patches that two strips share, got "
            f"{len(ties)}; patches per strip: {counts}; give strips that overlap, over ground, "
            "roofs or walls, or start from a boresight closer to the truth"
        )
    chosen = _chosen(ties, patches)
    matched, keys = _matched(rays, p_m, patches, chosen, step)
    screening = screen(replace(survey, mounting=mounting), matched)
    if screening.rejected:
        keys = _surviving(matched, keys, screening.kept)
        matched = matched.subset(screening.kept)
    return PatchSurvey(
        mounting, matched, tuple(keys), screening.rejected, found, len(ties),
        np.array([mounting.boresight]),
    )  # fmt: skip


def _chosen(ties, patches: dict[str, Patches]) -> list[tuple[FaceKey, ...]]:
    """At most `MOST_PLANES` of the places, of varied direction and spread out."""
    first = [(patches[strip], number) for (strip, number), *_ in ties]
    normal = np.array([of.normal[number] for of, number in first])
    centroid = np.array([of.centroid[number] for of, number in first])
    views = np.array([len(tie) for tie in ties])
    return [ties[k] for k in choose(normal, centroid, views, MOST_PLANES)]


def _matched(rays, p_m, patches, ties, step: PatchPass) -> tuple[MatchedFaces, list[FaceKey]]:
    """The patches of ``ties`` as the adjustment takes them, and their keys in that order."""
    faces, keys, planes = [], [], []
    for tie in ties:
        views = [(key, index) for key, index in _views(tie, p_m, patches, step) if len(index)]
        if len(views) > 1:
            planes.append(list(range(len(keys), len(keys) + len(views))))
            keys += [key for key, _ in views]
            faces += [rays[strip].take(index) for (strip, _), index in views]
    pairs = [(a, b) for plane in planes for k, a in enumerate(plane) for b in plane[k + 1 :]]
    return MatchedFaces.build(faces, [strip for strip, _ in keys], planes, pairs), keys


def _views(tie, p_m, patches: dict[str, Patches], step: PatchPass):
    """Each key of ``tie`` with its points, at most `MOST_OF_FACE`; none for a view that shows too
    little of the place."""
    members = [patches[strip].members(number) for strip, number in tie]
    if step.matching.same_tile:
        axis = int(patches[tie[0][0]].tile[tie[0][1], 0])
        seen = [p_m[strip][index] for (strip, _), index in zip(tie, members, strict=True)]
        masks = common_footprint(seen, axis, step.patches.tile_m)
        members = [index[mask] for index, mask in zip(members, masks, strict=True)]
    for key, index in zip(tie, members, strict=True):
        enough = len(index) >= step.patches.min_points // 2
        yield key, _evenly(index, MOST_OF_FACE) if enough else index[:0]


def _evenly(index: np.ndarray, most: int) -> np.ndarray:
    return index[np.linspace(0, len(index) - 1, min(most, len(index))).astype(int)]


def _surviving(matched: MatchedFaces, keys: list[FaceKey], kept: np.ndarray) -> list[FaceKey]:
    """Keys of the faces that `MatchedFaces.subset` keeps."""
    views = np.bincount(matched.plane[kept], minlength=matched.n_planes)
    kept = kept & (views > 1)[matched.plane]
    return [key for key, keep in zip(keys, kept, strict=True) if keep]
