"""How targets move: position and velocity as functions of time alone, the same for the same seed."""

import csv
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from math import atan2, cos, degrees, inf, isfinite, pi, radians, sin
from pathlib import Path
from random import Random
from typing import NamedTuple, TypeAlias

from gcs.sim.settings import Origin
from gcs.sim.vehicle.sensors import MAJOR_M, SQUARED

ROUNDABOUT_M, LOITER_M = 15.0, 80.0
CORNER_S = 10.0
HAIRPIN_M, HAIRPIN_M_S = 6.0, 3.0
ASIDE_M_S2 = 4.0
"""Most acceleration towards the inside of a corner; tyres on a dry road hold twice as much."""

DRIFT_M_S = 0.4
"""Of the water, which a boat's bow does not show."""

FOREVER_S = 1e9

WALK = Path(__file__).with_name("walk.csv")
"""A person walks along a lake, stops, turns back: a receiver's track, published with gpxpy (Apache-2.0), in
test_files/cerknicko-jezero.gpx from 2010-08-05 14:45:06 UTC on."""

WALKS_FROM_S = 600.0
"""It is begun anywhere before; 150 s follow."""


class State(NamedTuple):
    """Where a target is and how it moves, from where it began."""

    north_m: float
    east_m: float
    down_m: float
    north_m_s: float
    east_m_s: float
    down_m_s: float


Motion: TypeAlias = Callable[[float], State]
"""State at a time since the beginning, in s."""


class Leg(NamedTuple):
    """A stretch with one acceleration and one rate of turn."""

    duration_s: float
    acceleration_m_s2: float = 0.0
    turn_rad_s: float = 0.0


class _Stretch(NamedTuple):
    """A leg from where it begins."""

    begin_s: float
    north_m: float
    east_m: float
    course_rad: float
    speed_m_s: float
    leg: Leg

    def at(self, time_s: float) -> "_Stretch":
        """The stretch that begins there, on the same leg."""
        for_s, change, turn = time_s - self.begin_s, self.leg.acceleration_m_s2, self.leg.turn_rad_s
        course, speed = self.course_rad + turn * for_s, self.speed_m_s + change * for_s
        if turn == 0.0:
            way_m = for_s * (self.speed_m_s + speed) / 2
            north_m, east_m = way_m * cos(course), way_m * sin(course)
        else:  # integral of a speed that changes evenly, along a circle's direction
            before = self.course_rad
            along, across = change / turn**2, 1.0 / turn
            north_m = across * (speed * sin(course) - self.speed_m_s * sin(before))
            north_m += along * (cos(course) - cos(before))
            east_m = -across * (speed * cos(course) - self.speed_m_s * cos(before))
            east_m += along * (sin(course) - sin(before))
        return _Stretch(time_s, self.north_m + north_m, self.east_m + east_m, course, speed, self.leg)


class Course:
    """Legs one after the other; what was found of them is kept."""

    def __init__(self, legs: Iterator[Leg], speed_m_s: float, course_rad: float) -> None:
        self._legs = legs
        self._stretches = [_Stretch(0.0, 0.0, 0.0, course_rad, speed_m_s, next(legs))]

    def __call__(self, time_s: float) -> State:
        stretches = self._stretches
        while (end_s := stretches[-1].begin_s + stretches[-1].leg.duration_s) <= time_s:
            stretches.append(stretches[-1].at(end_s)._replace(leg=next(self._legs)))
        at = bisect_right(stretches, time_s, key=lambda stretch: stretch.begin_s) - 1
        now = stretches[max(at, 0)].at(time_s)
        speed_m_s, course = now.speed_m_s, now.course_rad
        return State(now.north_m, now.east_m, 0.0, speed_m_s * cos(course), speed_m_s * sin(course), 0.0)


def _straight(_speed_m_s: float, _random: Random) -> Iterator[Leg]:
    while True:
        yield Leg(FOREVER_S)


def _walker(speed_m_s: float, random: Random) -> Iterator[Leg]:
    """Walks in bends, stops, looks around, and goes on elsewhere; begins standing."""
    while True:
        yield Leg(1.0, speed_m_s)
        for _ in range(random.randint(2, 5)):
            yield Leg(random.uniform(2.0, 6.0), 0.0, random.uniform(-0.4, 0.4))
        yield Leg(0.5, -2.0 * speed_m_s)
        yield Leg(random.uniform(2.0, 8.0), 0.0, random.uniform(-1.0, 1.0))


def _rover(_speed_m_s: float, _random: Random) -> Iterator[Leg]:
    turn_rad_s, angle = 0.8, radians(30.0)
    while True:
        yield Leg(abs(angle) / turn_rad_s, 0.0, turn_rad_s if angle > 0.0 else -turn_rad_s)
        yield Leg(5.0)
        angle = radians(-60.0 if angle > 0.0 else 60.0)


def _roundabout(speed_m_s: float, _random: Random) -> Iterator[Leg]:
    while True:
        yield Leg(FOREVER_S, 0.0, speed_m_s / ROUNDABOUT_M)


def _loiter(speed_m_s: float, _random: Random) -> Iterator[Leg]:
    while True:
        yield Leg(FOREVER_S, 0.0, speed_m_s / LOITER_M)


def _corners(speed_m_s: float, _random: Random) -> Iterator[Leg]:
    turn_rad_s = min(pi / 2, ASIDE_M_S2 / max(speed_m_s, 0.1))
    turning_s = min(pi / 2 / turn_rad_s, CORNER_S)
    while True:
        yield Leg(CORNER_S - turning_s)
        yield Leg(turning_s, 0.0, pi / 2 / turning_s)


def _hairpin(speed_m_s: float, _random: Random) -> Iterator[Leg]:
    """Brakes before each turn, and accelerates out of it."""
    slow_m_s = min(HAIRPIN_M_S, speed_m_s)
    turn_rad_s = slow_m_s / HAIRPIN_M
    while True:
        yield Leg(6.0)
        yield Leg((speed_m_s - slow_m_s) / 2.0, -2.0)
        yield Leg(pi / turn_rad_s, 0.0, turn_rad_s)
        yield Leg((speed_m_s - slow_m_s) / 2.0, 2.0)


def _random(speed_m_s: float, random: Random) -> Iterator[Leg]:
    """Goes, stops and turns as it likes, with up to 2 m/s^2 ahead and aside; never backwards."""
    now_m_s = speed_m_s
    while True:
        then_m_s = random.choice((0.0, random.uniform(0.0, speed_m_s), speed_m_s))
        changing_s = max(abs(then_m_s - now_m_s) / 2.0, 0.1)
        yield Leg(changing_s, (then_m_s - now_m_s) / changing_s)
        most_rad_s = min(2.0 / max(then_m_s, 0.1), 1.5)
        turn_rad_s = random.choice((0.0, random.uniform(-most_rad_s, most_rad_s)))
        yield Leg(random.uniform(1.0, 6.0), 0.0, turn_rad_s)
        now_m_s = then_m_s


def _boat(_speed_m_s: float, _random: Random) -> Iterator[Leg]:
    yield Leg(10.0, 0.0, 0.06)
    while True:
        yield Leg(20.0, 0.0, -0.06)
        yield Leg(20.0, 0.0, 0.06)


class _Kind(NamedTuple):
    speed_m_s: float
    legs: Callable[[float, Random], Iterator[Leg]] | None  # None: recorded


KINDS = {
    "still": _Kind(0.0, _straight),
    "walker": _Kind(1.5, _walker),
    "walk": _Kind(1.2, None),
    "rover": _Kind(2.0, _rover),
    "straight": _Kind(10.0, _straight),
    "corners": _Kind(8.0, _corners),
    "roundabout": _Kind(5.0, _roundabout),
    "loiter": _Kind(12.0, _loiter),
    "hairpin": _Kind(8.0, _hairpin),
    "boat": _Kind(2.5, _boat),
    "random": _Kind(3.0, _random),
}
"""Motions by name, with their usual speeds."""


def motion(name: str, *, seed: int = 0, course_deg: float = 0.0, speed_m_s: float | None = None) -> Motion:
    """One of `KINDS`, first along a course."""
    kind, random = KINDS[name], Random(seed)
    speed_m_s = kind.speed_m_s if speed_m_s is None else speed_m_s
    if kind.legs is None:
        walk, begin_s = played(read_track(WALK))[1], random.uniform(0.0, WALKS_FROM_S)
        return _begun(walk, begin_s, speed_m_s / kind.speed_m_s, radians(course_deg))
    begin_m_s = 0.0 if name == "walker" else speed_m_s
    course = Course(kind.legs(speed_m_s, random), begin_m_s, radians(course_deg))
    if name != "boat":
        return course
    angle = random.uniform(-pi, pi)
    drift = DRIFT_M_S * cos(angle), DRIFT_M_S * sin(angle)
    return lambda time_s: _added(course(time_s), drift[0] * time_s, drift[1] * time_s, *drift)


def _begun(motion: Motion, begin_s: float, pace: float, turn_rad: float) -> Motion:
    """A motion from a later time on, at another pace, and turned clockwise."""
    first, along, across = motion(begin_s), cos(turn_rad), sin(turn_rad)

    def at(time_s: float) -> State:
        now = motion(begin_s + pace * time_s)
        north_m, east_m = now.north_m - first.north_m, now.east_m - first.east_m
        return State(
            along * north_m - across * east_m,
            across * north_m + along * east_m,
            now.down_m - first.down_m,
            pace * (along * now.north_m_s - across * now.east_m_s),
            pace * (across * now.north_m_s + along * now.east_m_s),
            pace * now.down_m_s,
        )

    return at


def moved(motion: Motion, north_m: float, east_m: float, down_m: float = 0.0) -> Motion:
    """The same motion elsewhere."""
    return lambda time_s: _added(motion(time_s), north_m, east_m, 0.0, 0.0, down_m)


def _added(
    state: State, north_m: float, east_m: float, north_m_s: float, east_m_s: float, down_m: float = 0.0
) -> State:
    return State(
        state.north_m + north_m,
        state.east_m + east_m,
        state.down_m + down_m,
        state.north_m_s + north_m_s,
        state.east_m_s + east_m_s,
        state.down_m_s,
    )


class TrackError(Exception):
    """A file is no track; the message names the line."""


Row: TypeAlias = tuple[float, float, float, float]
COLUMNS = ("time_s", "latitude_deg", "longitude_deg", "altitude_amsl_m")


def read_track(file: Path) -> list[Row]:
    """Time, latitude, longitude and altitude of each line; without altitudes that of `Origin`.

    Raises: TrackError, OSError.
    """
    rows: list[Row] = []
    with file.open(encoding="utf-8-sig", newline="") as opened:
        reader = csv.DictReader(opened)
        missing = [column for column in COLUMNS[:3] if column not in (reader.fieldnames or ())]
        if missing:
            raise TrackError(f"{file}: the header has no {', '.join(missing)}; it names {','.join(COLUMNS)}")
        for line in reader:
            texts = {COLUMNS[3]: str(Origin().altitude_amsl_m)} | line
            try:
                time_s, latitude_deg, longitude_deg, altitude_m = (
                    float(texts[name] or "") for name in COLUMNS
                )
            except ValueError:
                time_s = latitude_deg = longitude_deg = altitude_m = inf
            row = time_s, latitude_deg, longitude_deg, altitude_m
            if not all(map(isfinite, row)) or (rows and time_s <= rows[-1][0]):
                text = "numbers are needed, and a later time than before"
                raise TrackError(f"{file}, line {reader.line_num}: {text}")
            rows.append(row)
    if not rows:
        raise TrackError(f"{file} has no line below its header")
    return rows


def played(rows: Sequence[Row]) -> tuple[Origin, Motion]:
    """Straight from each position of a track to the next; at its end the target stands. With its origin."""
    origin = Origin(*rows[0][1:])
    curved = 1.0 - SQUARED * sin(radians(origin.latitude_deg)) ** 2
    normal_m = MAJOR_M / curved**0.5 + origin.altitude_amsl_m
    north_m = MAJOR_M * (1.0 - SQUARED) / curved**1.5 + origin.altitude_amsl_m
    east_m = normal_m * cos(radians(origin.latitude_deg))
    places = [
        (
            row[0] - rows[0][0],
            north_m * radians(row[1] - origin.latitude_deg),
            east_m * radians(row[2] - origin.longitude_deg),
            origin.altitude_amsl_m - row[3],
        )
        for row in rows
    ]
    stretches = [_between(*pair) for pair in pairwise(places)]
    stretches.append(State(*places[-1][1:], 0.0, 0.0, 0.0))
    times_s = [place[0] for place in places]

    def at(time_s: float) -> State:
        index = max(bisect_right(times_s, time_s) - 1, 0)
        begin, for_s = stretches[index], time_s - times_s[index]
        return State(
            begin.north_m + begin.north_m_s * for_s,
            begin.east_m + begin.east_m_s * for_s,
            begin.down_m + begin.down_m_s * for_s,
            *begin[3:],
        )

    return origin, at


def _between(begin: Row, end: Row) -> State:
    for_s = end[0] - begin[0]
    north_m_s, east_m_s, down_m_s = (
        (after - before) / for_s for before, after in zip(begin[1:], end[1:], strict=True)
    )
    return State(*begin[1:], north_m_s, east_m_s, down_m_s)


def course_deg(state: State) -> float:
    """Over ground, clockwise from north."""
    return degrees(atan2(state.east_m_s, state.north_m_s)) % 360.0
