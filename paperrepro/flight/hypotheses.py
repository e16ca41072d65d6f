"""The mistakes that files of a flight are known to hold, one table, and what they are tried on.

Each hypothesis names the file, the mistake and its remedy, and undoes it by a change of the
`Evidence`: the points of the strips, the trajectory and the mounting as the files have them. What
is said of it, mended or refused, is for `consistency`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from paperrepro.errors import BadInput
from paperrepro.flight import ray_test
from paperrepro.flight.geodesy import Grid, LocalFrame
from paperrepro.flight.ray_test import Fit, Sample
from paperrepro.flight.sbet import Poses
from paperrepro.frames import BODY_AXES, rotation_zyx
from paperrepro.survey import Mounting

#: Points lie within this of the trajectory, m, in plan and in height.
NEAR, STEEP = 2000.0, 1000.0
FOOT = 0.3048
#: UTC is behind GPS time by so much: since 2017, 2015, 2012, 2009, 2006.
LEAP_SECONDS = (18.0, 17.0, 16.0, 15.0, 14.0)
#: Of all points, the share that may lie outside of the trajectory's time.
OUTSIDE = 0.001


@dataclass(frozen=True)
class StripSample:
    """Points of a file: ``name``, ``grid`` of ``xyz`` (N, 3), ``time`` (N,) s of the trajectory's
    clock, ``ring`` (N,) as recorded; ``step`` m and ``time_step`` s, how fine they are."""

    name: str
    grid: Grid
    time: np.ndarray
    ring: np.ndarray
    xyz: np.ndarray
    step: float
    time_step: float

    def local(self, frame: LocalFrame) -> np.ndarray:
        """(N, 3) m, m-frame of ``frame``."""
        return frame.from_geodetic(*self.grid.to_geodetic(self.xyz))


@dataclass(frozen=True)
class Evidence:
    """What the files say: ``samples`` of the strips, ``poses`` of the trajectory, the nominal
    ``mounting``. ``shift`` (3,) m is added to the points in the m-frame of ``frame``; ``beams``:
    whether those of the scanner keep their elevations."""

    samples: tuple[StripSample, ...]
    poses: Poses
    mounting: Mounting
    frame: LocalFrame
    shift: np.ndarray
    beams: bool = True

    @property
    def attitude(self) -> np.ndarray:
        """(M, 3) rad, roll, pitch, heading of all poses."""
        return self.poses.attitude

    def with_attitude(self, attitude: np.ndarray) -> "Evidence":
        """With other attitudes (M, 3)."""
        return replace(self, poses=replace(self.poses, attitude=attitude))

    def few(self, count: int = 2000) -> "Evidence":
        """Some ``count`` of the points."""
        every = max(1, sum(len(s.time) for s in self.samples) // count)
        few = [
            replace(s, time=s.time[::every], ring=s.ring[::every], xyz=s.xyz[::every])
            for s in self.samples
        ]
        return replace(self, samples=tuple(few))

    @cached_property
    def rays(self) -> tuple[np.ndarray, Sample]:
        """Poses (K, 6) of the points that the trajectory covers, and those points."""
        time = np.concatenate([s.time for s in self.samples])
        first, last = self.poses.time[[0, -1]] + self.poses.week
        inside = np.flatnonzero((time >= first) & (time <= last))
        points = np.concatenate([s.local(self.frame) for s in self.samples]) + self.shift
        inside = inside[np.isfinite(points[inside]).all(axis=1)]
        sample = Sample(
            points[inside], np.concatenate([s.ring for s in self.samples])[inside],
            max(s.step for s in self.samples), self.beams,
        )  # fmt: skip
        if not len(inside):
            return np.empty((0, 6)), sample
        path = self.poses.near(time[inside]).in_frame(self.frame)
        return path.at(time[inside], self.samples[0].name), sample

    @property
    def is_covered(self) -> bool:
        """Whether the trajectory covers all points but a few."""
        n = sum(len(s.time) for s in self.samples)
        return len(self.rays[0]) > (1 - OUTSIDE) * n

    @cached_property
    def fit(self) -> Fit | None:
        """Of the rays; None where the trajectory does not cover them."""
        return ray_test.fit(*self.rays, self.mounting) if self.is_covered else None

    def with_height(self) -> "Evidence":
        """With the shift of heights under which the rays fit best."""
        height, _ = ray_test.best_height(*self.rays, self.mounting)
        return replace(self, shift=self.shift + height * ray_test.UP)

    def with_shift(self) -> "Evidence":
        """With the shift in plan and height under which the rays fit best."""
        start, _ = ray_test.best_height(*self.rays, self.mounting)
        shift, _ = ray_test.best_shift(*self.rays, self.mounting, start * ray_test.UP)
        return replace(self, shift=self.shift + shift)

    @property
    def is_near(self) -> bool:
        """Whether the points lie near the trajectory, each file's middle one."""
        return all(
            self.apart(s)[0] <= NEAR and abs(self.apart(s)[1]) <= STEEP for s in self.samples
        )

    def apart(self, sample: StripSample) -> tuple[float, float]:
        """Distance in plan, and height of the trajectory above a file's middle point, m, at the
        pose nearest to it."""
        try:
            at = sample.grid.to_geodetic(np.median(sample.xyz, axis=0)[None])
        except BadInput:
            return np.inf, np.inf
        if not np.isfinite(at).all() or np.abs(self.poses.latitude).max() > 0.5001 * np.pi:
            return np.inf, np.inf
        frame = LocalFrame(*(float(value[0]) for value in at), *sample.grid.shape)
        few = slice(None, None, max(1, len(self.poses.time) // 2000))
        poses = self.poses
        local = frame.from_geodetic(poses.latitude[few], poses.longitude[few], poses.height[few])
        plan = np.hypot(local[:, 0], local[:, 1])
        nearest = int(plan.argmin())
        return float(plan[nearest]), float(local[nearest, 2])


# --- the hypotheses ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Hypothesis:
    """A mistake: in which file (``where``: strip, trajectory, mounting), ``what`` it is, its
    ``remedy``, and the ``change`` of an `Evidence` that undoes it. With a ``mend`` in place of the
    remedy, a note that says what was done, it is undone; else refused."""

    where: str
    what: str
    remedy: str
    change: Callable
    mend: bool = False


def _attitude(change: Callable[[np.ndarray], None]) -> Callable:
    def changed(evidence):
        attitude = evidence.attitude.copy()
        change(attitude)
        return evidence.with_attitude(attitude)

    return changed


def _column(k: int, change: Callable) -> Callable:
    return _attitude(lambda angles: angles.__setitem__((slice(None), k), change(angles[:, k])))


def _place(change: Callable) -> Callable:
    def changed(evidence: Evidence) -> Evidence:
        latitude, longitude = change(evidence.poses.latitude, evidence.poses.longitude)
        return replace(
            evidence, poses=replace(evidence.poses, latitude=latitude, longitude=longitude)
        )

    return changed


def _points(**change: Callable) -> Callable:
    def changed(evidence: Evidence) -> Evidence:
        samples = [
            replace(s, **{name: turn(getattr(s, name)) for name, turn in change.items()})
            for s in evidence.samples
        ]
        return replace(evidence, samples=tuple(samples))

    return changed


def _mounting(**change: Callable) -> Callable:
    def changed(evidence: Evidence) -> Evidence:
        given = evidence.mounting
        turned = {name: turn(getattr(given, name)) for name, turn in change.items()}
        return replace(evidence, mounting=replace(given, **turned))

    return changed


def _turn(axis: int, degrees: int) -> Hypothesis:
    """The scanner sits a quarter or half turn about a body axis from where the mounting says."""
    turn, name = rotation_zyx(*np.radians(degrees) * np.eye(3)[axis]).round(), BODY_AXES[axis]
    return Hypothesis(
        "mounting", f"the rotation is off by {degrees} degrees about the body's axis {name}",
        f"multiply it from the left by {turn.astype(int).tolist()}",
        _mounting(R_nominal=lambda rotation: turn @ rotation),
    )  # fmt: skip


def _grid_heading(evidence: Evidence) -> Evidence:
    poses, grid = evidence.poses, evidence.samples[0].grid
    turned = grid.convergence(poses.latitude, poses.longitude)
    return evidence.with_attitude(poses.attitude + np.outer(turned, [0, 0, 1]))


def _wander_heading(evidence: Evidence) -> Evidence:
    return evidence.with_attitude(evidence.attitude - np.outer(evidence.poses.wander, [0, 0, 1]))


def _clock(seconds: float) -> Hypothesis:
    what = (
        f"{seconds:+.0f} s are added to the strips' times: one of the files counts UTC, without "
        "the leap seconds of GPS time"
    )
    return Hypothesis("strip", what, "", _points(time=lambda time: time + seconds), mend=True)


ROLL, PITCH, HEADING = range(3)
METRES = "export it in metres, or with the right --crs"
CLOCKWISE = "give it clockwise from north"
GRID_NORTH = Hypothesis(
    "trajectory", "the heading is read as clockwise from grid north", "", _grid_heading, mend=True
)
HEADINGS = (
    GRID_NORTH,
    Hypothesis(
        "trajectory",
        "the heading is read as against the wander frame, whose angle is taken off", "",
        _wander_heading, mend=True,
    ),
)  # fmt: skip
CLOCKS = tuple(_clock(sign * seconds) for sign in (1, -1) for seconds in LEAP_SECONDS)
#: Turns of the attitude that rays may be blind to: tested on the strips' agreement as well.
ATTITUDES = (
    Hypothesis("trajectory", "the heading is counted counter-clockwise from east (ENU)", CLOCKWISE,
               _column(HEADING, lambda angle: np.pi / 2 - angle)),
    Hypothesis("trajectory", "the heading is counted counter-clockwise from north", CLOCKWISE,
               _column(HEADING, np.negative)),
    Hypothesis("trajectory", "the heading is counted clockwise from south", "add 180 degrees to it",
               _column(HEADING, lambda angle: angle + np.pi)),
    Hypothesis("trajectory", "the heading is in degrees", "give radians",
               _column(HEADING, np.radians)),
    Hypothesis("trajectory", "the attitude is in degrees", "give radians",
               _attitude(lambda angles: np.radians(angles, out=angles))),
    Hypothesis("trajectory", "the pitch is counted nose down",
               "turn its sign: nose up is positive", _column(PITCH, np.negative)),
    Hypothesis("trajectory", "the roll is counted left wing down",
               "turn its sign: right wing down is positive", _column(ROLL, np.negative)),
    Hypothesis("trajectory", "roll and pitch are interchanged", "interchange them",
               _attitude(lambda angles: angles.__setitem__(
                   (slice(None), [ROLL, PITCH]), angles[:, [PITCH, ROLL]]))),
    Hypothesis("trajectory", "the signs of roll and pitch are both turned", "turn them",
               _attitude(lambda angles: angles.__imul__([-1, -1, 1]))),
    Hypothesis("trajectory", "the roll is in degrees", "give radians", _column(ROLL, np.radians)),
)  # fmt: skip
TABLE = (
    Hypothesis("trajectory", "its latitude and longitude are interchanged", "write latitude first",
               _place(lambda latitude, longitude: (longitude, latitude))),
    Hypothesis("trajectory", "its latitude has the wrong sign", "south is negative",
               _place(lambda latitude, longitude: (-latitude, longitude))),
    Hypothesis("trajectory", "its longitude has the wrong sign", "west is negative",
               _place(lambda latitude, longitude: (latitude, -longitude))),
    Hypothesis("trajectory", "latitude and longitude have the wrong sign",
               "south and west are negative",
               _place(lambda latitude, longitude: (-latitude, -longitude))),
    Hypothesis("strip", "its points are in feet", METRES, _points(xyz=lambda xyz: xyz * FOOT)),
    Hypothesis("strip", "its heights are in feet", METRES,
               _points(xyz=lambda xyz: xyz * [1, 1, FOOT])),
    Hypothesis("strip", "its x, y are in feet", METRES,
               _points(xyz=lambda xyz: xyz * [FOOT, FOOT, 1])),
    *HEADINGS,
    *CLOCKS,
    *ATTITUDES,
    Hypothesis("mounting", "the rotation is transposed (b to l)",
               "give l to b: rows are body forward, right, down",
               _mounting(R_nominal=np.transpose)),
    *(_turn(axis, degrees) for degrees in (90, -90, 180) for axis in range(3)),
    Hypothesis("mounting", "the lever arm points from the laser to the GNSS/INS", "turn its signs",
               _mounting(lever_arm=np.negative)),
    Hypothesis("mounting", "the lever arm stands in forward, left, up",
               "give it forward, right, down",
               _mounting(lever_arm=lambda arm: np.asarray(arm) * [1, -1, -1])),
)  # fmt: skip


def zones(evidence: Evidence) -> Iterator[Hypothesis]:
    """Each other zone of a map in zones of six degrees."""
    grid = evidence.samples[0].grid
    for number in (z for z in range(-59, 60) if z and grid.crs.is_projected):
        side = f"{abs(number)} {'east' if number > 0 else 'west'} of that of {grid.name}"
        turn = np.radians(6.0 * number)
        yield Hypothesis("strip", f"its zone is {side}", "name the right one with --crs",
                         _place(lambda lat, lon, turn=turn: (lat, lon - turn)))  # fmt: skip
