"""Flight plans, that of Table 1 first, and the true motion of the mission.

m-frame east-north-up, attitude roll, pitch, heading as in `paperrepro.frames`; metres, seconds,
radians. The plan is exact over flat ground: swath 2 h tan 60 deg from 30 m. The true motion is the
planned course plus gusts and vibration, a smooth function of time.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BPoly, PPoly

from data_synth.motion import Motion, draw_disturbance
from data_synth.sensors import HALF_SWATH, MAX_RANGE
from paperrepro.errors import BadInput

HEIGHT, SPEED, LINE_LENGTH = 30.0, 4.5, 140.0
#: Time at speed before and after each recorded line, and at either end of the mission, s.
RUN_IN = 2.0
#: The mission begins here, s; any GPS time would do.
MISSION_START = 1000.0
#: A turn lasts this long at least, s, and its mean speed is so much below the cruising speed.
TURN_TIME, TURN_SLOWNESS = 12.0, 1.9

NORTH, EAST, SOUTH, WEST = (np.radians(h) for h in (0.0, 90.0, 180.0, 270.0))


@dataclass(frozen=True)
class PlannedLine:
    """``name``; ``offset`` across, in swaths, east or north of the site's middle; ``heading`` rad,
    one of `NORTH`, `EAST`, `SOUTH`, `WEST`; ``length`` m, ``height`` m and ``speed`` m/s where they
    are not the plan's."""

    name: str
    offset: float
    heading: float
    length: float | None = None
    height: float | None = None
    speed: float | None = None


@dataclass(frozen=True)
class FlightPlan:
    """``lines`` one after the other, each of ``length`` m about the site's middle, ``height`` m
    above the mean ground, at ``speed`` m/s, unless it has its own. Raises `BadInput`."""

    lines: tuple[PlannedLine, ...]
    length: float = LINE_LENGTH
    height: float = HEIGHT
    speed: float = SPEED

    def __post_init__(self):
        if not self.lines or len({line.name for line in self.lines}) < len(self.lines):
            raise BadInput("flight plan: expected lines of different names; name each line once")
        for line in self.lines:
            _require_sane(self.whole(line))
            if min(abs(line.heading - course) for course in (NORTH, EAST, SOUTH, WEST)) > 1e-9:
                raise BadInput(
                    f"{line.name}: expected a heading north, east, south or west, got "
                    f"{np.degrees(line.heading):g} degrees; turn the site instead"
                )

    def whole(self, line: PlannedLine) -> PlannedLine:
        """``line`` with what it takes from the plan."""
        own = {n: getattr(line, n) for n in ("length", "height", "speed")}
        return replace(line, **{n: getattr(self, n) if x is None else x for n, x in own.items()})

    def only(self, *names: str) -> "FlightPlan":
        """The same with the lines of these names, in the order of the plan."""
        return replace(self, lines=tuple(line for line in self.lines if line.name in names))


def _require_sane(line: PlannedLine) -> None:
    """Of a line with all it needs. Its strip is named by it."""
    if not re.fullmatch(r"\w[\w .-]*", str(line.name)):
        raise BadInput(f"line {line.name!r}: expected a name of letters and digits; rename it")
    if not np.isfinite([line.offset, line.heading, line.length, line.height, line.speed]).all():
        raise BadInput(f"line {line.name}: expected finite numbers; correct it")
    if not min(line.length, line.height, line.speed) > 0:
        raise BadInput(f"line {line.name}: expected length, height and speed above 0; correct it")
    if line.height >= MAX_RANGE:
        raise BadInput(
            f"line {line.name}: height: expected below {MAX_RANGE:g} m, the scanner's reach, got "
            f"{line.height:g}; plan it lower"
        )


def swath_width(height: float) -> float:
    """Over flat ground, m, from ``height`` m."""
    return 2 * height * np.tan(HALF_SWATH)


#: A plan as a table: what a line may say, with the plan's own values where there are such; ``name``
#: is F1 and so on without it.
TABLE = {
    "offset_m": None, "heading_deg": None, "length_m": LINE_LENGTH, "height_m": HEIGHT,
    "speed_m_s": SPEED,
}  # fmt: skip


def plan_of(table: Iterable[Mapping]) -> FlightPlan:
    """The plan of a table, a line a row with keys of `TABLE`: ``offset_m`` east or north of the
    site's middle, ``heading_deg``, 0, 90, 180 or 270. Raises `BadInput`."""
    lines = []
    for count, row in enumerate(table, 1):
        name = str(row.get("name", f"F{count}")) if isinstance(row, Mapping) else f"number {count}"
        offset, heading, length, height, speed = read_numbers(row, TABLE, f"line {name}", "name")
        across = offset / swath_width(height) if height > 0 else offset
        lines.append(PlannedLine(name, across, np.radians(heading % 360), length, height, speed))
    return FlightPlan(tuple(lines))


def read_numbers(row, known: Mapping[str, float | None], where: str, *more: str) -> list[float]:
    """Values of a table's keys ``known``, by default theirs; it may have the keys ``more``, too."""
    if not isinstance(row, Mapping) or set(row) - {*known, *more}:
        got = ", ".join(map(str, set(row) - {*known, *more})) if isinstance(row, Mapping) else row
        raise BadInput(f"{where}: expected {', '.join([*more, *known])}, got {got}; name those")
    values = [row.get(key, default) for key, default in known.items()]
    for key, value in zip(known, values, strict=True):
        if isinstance(value, bool) or not isinstance(value, int | float | np.number):
            raise BadInput(f"{where}: {key}: expected a number, got {value!r}; give one")
    return [float(value) for value in values]


#: Spacing = (1 - overlap) swaths gives Table 1.
TABLE_1 = FlightPlan(
    (
        PlannedLine("F1", 0.0, NORTH),
        PlannedLine("F2", 0.0, SOUTH),
        PlannedLine("F3", 0.3, NORTH),
        PlannedLine("F4", 0.8, SOUTH),
        PlannedLine("F5", -0.3, NORTH),
        PlannedLine("F6", -0.8, SOUTH),
        PlannedLine("F7", 0.0, EAST),
        PlannedLine("F8", 0.0, WEST),
    )
)


def covering(
    half_east: float, half_north: float, overlap: float = 0.5, height: float = HEIGHT,
    speed: float = SPEED,
) -> FlightPlan:  # fmt: skip
    """A plan for a site of these half extents, m: lines to and fro that ``overlap``, 0-1, and two
    across the middle. Raises `BadInput`."""
    if not (0 <= overlap < 1 and height > 0):
        raise BadInput(
            f"covering: expected an overlap of 0 to below 1 and a height above 0, got {overlap:g} "
            f"and {height:g}; correct them"
        )
    count = int(np.ceil(2 * half_east / (swath_width(height) * (1 - overlap)))) + 1
    offsets = (1 - overlap) * (np.arange(count) - 0.5 * (count - 1))
    lines = [
        PlannedLine(f"F{k + 1}", float(offset), (NORTH, SOUTH)[k % 2], 2 * half_north)
        for k, offset in enumerate(offsets)
    ]
    across = [PlannedLine(f"F{count + 1 + k}", 0.0, (EAST, WEST)[k], 2 * half_east) for k in (0, 1)]
    return FlightPlan((*lines, *across), height=height, speed=speed)


@dataclass(frozen=True)
class FlightLine:
    """A recorded line: ``start`` and ``end`` (2,) m east, north; ``heading`` rad; the record's
    ``start_time`` and ``end_time`` s; ``height`` m."""

    name: str
    start: np.ndarray
    end: np.ndarray
    heading: float
    start_time: float
    end_time: float
    height: float = HEIGHT

    @property
    def velocity(self) -> np.ndarray:
        """(2,) m/s."""
        return (self.end - self.start) / (self.end_time - self.start_time)

    def swath(self) -> np.ndarray:
        """(2, 2): lower left and upper right corner of the ground it covers over flat ground, m."""
        along = np.abs(self.end - self.start)
        across = self.height * np.tan(HALF_SWATH) * (along == 0)
        low, high = np.minimum(self.start, self.end), np.maximum(self.start, self.end)
        return np.array([low - across, high + across])


def flight_plan(plan: FlightPlan = TABLE_1) -> tuple[FlightLine, ...]:
    """The lines of a plan with their times."""
    lines, time, before, speed_before = [], MISSION_START + RUN_IN, None, np.inf
    for planned in map(plan.whole, plan.lines):
        offset, heading, height = planned.offset, planned.heading, planned.height
        length, speed = planned.length, planned.speed
        along = np.round([np.sin(heading), np.cos(heading)])
        across = np.round([np.cos(heading) ** 2, np.sin(heading) ** 2])
        middle = offset * swath_width(height) * across
        start, end = middle - 0.5 * length * along, middle + 0.5 * length * along
        if before is not None:
            entry = start - RUN_IN * speed * along
            turn = _turn_time(before, entry, height, min(speed, speed_before))
            time = before.end_time + 2 * RUN_IN + turn
        speed_before = speed
        before = FlightLine(
            planned.name, start, end, float(heading), time, time + length / speed, height
        )
        lines.append(before)
    return tuple(lines)


def _turn_time(before: FlightLine, entry: np.ndarray, height: float, speed: float) -> float:
    gap = np.linalg.norm(entry - (before.end + RUN_IN * before.velocity))
    gap = np.hypot(gap, height - before.height)
    return max(TURN_TIME, float(TURN_SLOWNESS * gap / speed))


def overlap(a: FlightLine, b: FlightLine) -> float:
    """Share of a line's nominal swath that the other's covers too, 0-1. Table 1."""
    low = np.maximum(a.swath()[0], b.swath()[0])
    high = np.minimum(a.swath()[1], b.swath()[1])
    return float(np.maximum(high - low, 0.0).prod() / np.diff(a.swath(), axis=0).prod())


def direction_words(a: FlightLine, b: FlightLine) -> str:
    """Direction of a pair as Table 1 has it: the axis doubled if both fly the same way
    ("North-North", also for two southward lines), both ends of the axis if opposite ways."""
    dot = a.velocity @ b.velocity
    if not np.isclose(abs(dot), np.linalg.norm(a.velocity) * np.linalg.norm(b.velocity)):
        raise BadInput(f"{a.name}-{b.name}: expected parallel lines, they cross; pair others")
    first, second = ("North", "South") if a.velocity[0] == 0 else ("West", "East")
    return f"{first}-{first if dot > 0 else second}"


def fly(
    lines: tuple[FlightLine, ...],
    rng: np.random.Generator,
    gust_scale: float = 1.0,
    vibration_scale: float = 1.0,
) -> Motion:
    """The true motion of the whole mission, as `data_synth.motion.draw_disturbance` disturbs it."""
    course = _course(lines)
    disturbance = draw_disturbance(rng, gust_scale, vibration_scale)
    return Motion(course, disturbance, course.x[0], course.x[-1])


def _course(lines: tuple[FlightLine, ...]) -> PPoly:
    """East, north, up, heading as quintics with continuous acceleration: straight at constant
    speed on the lines, smooth through the turns; headings turn the short way."""
    times, nodes, heading = [], [], lines[0].heading
    for line in lines:
        heading += (line.heading - heading + np.pi) % (2 * np.pi) - np.pi
        for time in (line.start_time - RUN_IN, line.end_time + RUN_IN):
            at = line.start + (time - line.start_time) * line.velocity
            state = np.zeros((3, 4))
            state[0], state[1, :2] = (*at, line.height, heading), line.velocity
            times.append(time)
            nodes.append(state)
    return PPoly.from_bernstein_basis(BPoly.from_derivatives(times, np.array(nodes)))
