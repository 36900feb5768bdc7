"""Traffic of a scenario: tracks that cross the formation, as they are and as they are reported."""

from dataclasses import dataclass, field
from itertools import product
from math import cos, inf, nan, pi, radians, sin

import numpy as np

from gcs.control.memory import Memory
from gcs.control.traffic import Sphere, announced, tracks_near
from gcs.estimation.traffic import TrackReport, TrackTable
from gcs.model.state import Array
from gcs.safety.near_traffic import NearTraffic
from gcs.safety.surroundings import SafetySettings
from gcs.sim.targets.motions import FOREVER_S, Course, Leg
from gcs.simulation.scenario import CrossingTraffic

GONE_M, PAUSE_S, FORGOTTEN_S = 60.0, 10.0, 5.0
"""A track ends so far beyond the formation; the next one begins so long after; when one is forgotten."""

TOGETHER = 0.2
"""Tracks that cross together differ in speed by up to this share, so that they arrive together."""

WAYS_M = (0.0, 10.0, 20.0, 40.0, 60.0, 90.0, 130.0)
"""Lengths of the ways out that are tried, in 16 directions sideways, up and down."""

WAYS = np.array([(cos(k * pi / 8), sin(k * pi / 8), 0.0) for k in range(16)] + [(0, 0, -1.0), (0, 0, 1.0)])
STEP_S = 0.25


@dataclass(slots=True, eq=False)
class Passage:
    """One track: its truth, and what became of it."""

    begins_s: float
    start_m: Array  # (3,)
    course: Course
    legs_s: tuple[float, ...]  # when each of its legs begins, since it began
    silent_s: float = inf  # nothing is reported from then on, since it began
    sent: int = 0
    announced_s: float = nan
    closest_m: float = inf  # of any vehicle to the cylinder, over the tick's positions
    entered: dict[int, float] = field(default_factory=dict)  # row, and when
    known: list[tuple[float, Array]] = field(default_factory=list)  # legs: when, where vehicles (n, 3) are
    unavoidable: set[int] = field(default_factory=set)  # rows

    def place_m(self, time_s: float) -> Array:
        state = self.course(time_s - self.begins_s)
        moved_m: Array = self.start_m + np.array([state.north_m, state.east_m, 0.0])
        return moved_m

    def velocity_m_s(self, time_s: float) -> Array:
        state = self.course(time_s - self.begins_s)
        return np.array([state.north_m_s, state.east_m_s, 0.0])

    def is_over(self, now_s: float, sphere: Sphere) -> bool:
        """Whether it goes straight on, beyond the formation."""
        velocity_m_s = self.velocity_m_s(now_s)
        beyond_m = float((self.place_m(now_s) - sphere.center_m) @ velocity_m_s)
        gone = beyond_m > GONE_M * np.linalg.norm(velocity_m_s)
        return bool(gone) and now_s - self.begins_s >= self.legs_s[-1]


class Crossing:
    """Tracks one after the other, or several at once; the table, and what is made of it, are the flight's."""

    def __init__(self, settings: CrossingTraffic, seed: int, safety: SafetySettings, extent_m: float) -> None:
        self.passages: list[Passage] = []
        self._settings, self._safety, self._extent_m = settings, safety, extent_m
        self._random, self._kinds = np.random.default_rng([seed, 2]), np.random.default_rng([seed, 3])
        self._table = TrackTable(FORGOTTEN_S)
        self._next_s = PAUSE_S
        self._group: list[Passage] = []
        self._begun = 0
        self.is_over = False

    def near(self, now_s: float, position_m: Array, memory: Memory) -> NearTraffic | None:
        """What vehicles at (n, 3) keep clear of in this tick."""
        center = memory.center
        if center is None or self.is_over:
            return None
        sphere = Sphere(center.position_m, center.velocity_m_s, max(memory.radius_m, self._extent_m))
        if now_s >= self._next_s:
            self._begin(now_s, sphere)
        for passage in self._group:
            self._pass(passage, now_s, position_m)
        if self._next_s == inf and all(passage.is_over(now_s, sphere) for passage in self._group):
            self._next_s = now_s + PAUSE_S
            self._judge(now_s)
        self._table.forget(now_s, sphere.center_m[:2])
        traffic = self._table.at(now_s)
        for row in announced(traffic, self._settings, sphere):
            passage = self.passages[int(traffic.ids[row])]
            passage.announced_s = np.fmin(passage.announced_s, now_s)
        return tracks_near(traffic, self._settings, sphere, now_s)[0]

    def _begin(self, now_s: float, sphere: Sphere) -> None:
        if self._begun == self._settings.count:
            self.is_over = True
            return
        most = self._settings.together
        count = 1 if most == 1 else int(self._kinds.integers(2, most + 1))
        self._group = [self._drawn(now_s, sphere, None)]
        speed_m_s = float(np.linalg.norm(self._group[0].velocity_m_s(now_s)))
        self._group += [self._drawn(now_s, sphere, speed_m_s) for _ in range(count - 1)]
        self.passages += self._group
        self._begun, self._next_s = self._begun + 1, inf

    def _drawn(self, now_s: float, sphere: Sphere, like_m_s: float | None) -> Passage:
        """A track that comes to the formation from `from_m` away; `like_m_s`: about as fast."""
        settings, random, kinds = self._settings, self._random, self._kinds
        angle = random.uniform(-pi, pi)
        aside = np.array([-sin(angle), cos(angle), 0.0])
        aim_m = sphere.center_m + random.uniform(-1.0, 1.0) * settings.aside_m * aside
        aim_m[2] += random.uniform(-1.0, 1.0) * settings.above_m
        speed_m_s = random.uniform(settings.speed_min_m_s, settings.speed_max_m_s)
        if like_m_s is not None:
            speed_m_s = like_m_s * kinds.uniform(1.0 - TOGETHER, 1.0 + TOGETHER)
        kind = settings.motions[int(kinds.integers(len(settings.motions)))]
        speed_m_s, legs, share = _legs(kind, speed_m_s, kinds)
        lasts_s = sum(leg.duration_s for leg in legs)
        straight_s = max(0.0, -share * lasts_s)
        while True:  # the way to where it is aimed begins `from_m` away
            course = Course(iter((Leg(straight_s), *legs, Leg(FOREVER_S))), speed_m_s, angle)
            there = course(straight_s + share * lasts_s)
            if np.hypot(there.north_m, there.east_m) >= settings.from_m:
                break
            straight_s += 0.05
        aim_m += kinds.uniform() * (straight_s + share * lasts_s) * sphere.velocity_m_s
        begins_s = np.cumsum([0.0, straight_s, *(leg.duration_s for leg in legs)])
        silent_s = inf
        if kinds.uniform() < settings.silent_share:
            silent_s = float(kinds.uniform(0.2, 0.8)) * settings.from_m / speed_m_s
        start_m = aim_m - np.array([there.north_m, there.east_m, 0.0])
        return Passage(now_s, start_m, course, tuple(begins_s.tolist()), silent_s)

    def _pass(self, passage: Passage, now_s: float, position_m: Array) -> None:
        settings, flown_s = self._settings, now_s - passage.begins_s
        while passage.sent / settings.rate_hz + settings.delay_s <= flown_s + 1e-9:
            was_s = passage.sent / settings.rate_hz
            if was_s <= passage.silent_s:
                self._report(passage, passage.begins_s + was_s, now_s)
                turned = [leg_s <= was_s - 1.0 / settings.rate_hz for leg_s in passage.legs_s[1:]]
                if sum(turned) >= len(passage.known):
                    passage.known += [(now_s, position_m.copy())]
            passage.sent += 1
        off_m = position_m - passage.place_m(now_s)
        outside_m = self._outside_m(off_m)
        passage.closest_m = min(passage.closest_m, float(outside_m.min()))
        for row in np.flatnonzero(outside_m < 0.0).tolist():
            passage.entered.setdefault(row, now_s)

    def _outside_m(self, off_m: Array) -> Array:
        """(...) how far places (..., 3) from a track are outside its cylinder."""
        level_m = np.hypot(off_m[..., 0], off_m[..., 1]) - self._settings.radius_m
        outside_m: Array = np.maximum(level_m, np.abs(off_m[..., 2]) - self._settings.half_height_m)
        return outside_m

    def _report(self, passage: Passage, was_s: float, now_s: float) -> None:
        settings, random = self._settings, self._random
        place_m = passage.place_m(was_s) + random.normal(0.0, settings.noise_m, 3)
        moves_m_s = passage.velocity_m_s(was_s) + random.normal(0.0, settings.noise_m_s, 3)
        if not settings.velocity:
            moves_m_s[:] = nan
        if not settings.height:
            place_m[2] = moves_m_s[2] = nan
        self._table.take(
            TrackReport(
                str(self.passages.index(passage)),
                "manned",
                now_s,
                was_s,
                tuple(place_m.tolist()),
                tuple(moves_m_s.tolist()),
                settings.noise_m,
                settings.noise_m,
                settings.noise_m_s,
            )
        )

    def _judge(self, until_s: float) -> None:
        """Tell entries apart that the vehicle could not have avoided with all known that was reported.

        Known is the first leg from its first report on, a later one from its second on. Tried are straight
        ways at the fastest, at once, which end anywhere, past all tracks that cross together.
        """
        for passage in self._group:
            for row, when_s in passage.entered.items():
                before = [each for each in passage.known if each[0] <= when_s]
                if not before or not self._could_leave(before[-1][1][row], before[-1][0], until_s):
                    passage.unavoidable.add(row)

    def _could_leave(self, place_m: Array, from_s: float, until_s: float) -> bool:
        limits, fence = self._safety.limits, self._safety.fence
        speeds_m_s = [limits.horizontal_m_s] * 16 + [limits.up_m_s, limits.down_m_s]
        times_s = np.arange(from_s, until_s, STEP_S)
        ways_m = [
            np.minimum(speed_m_s * (times_s - from_s), length_m)[:, None] * way
            for (way, speed_m_s), length_m in product(zip(WAYS, speeds_m_s, strict=True), WAYS_M)
        ]
        way_m = place_m + np.array(ways_m)  # (w, t, 3)
        free = (np.hypot(way_m[..., 0], way_m[..., 1]) <= fence.distance_max_m).all(axis=1)
        free &= ((-way_m[..., 2] >= fence.height_min_m) & (-way_m[..., 2] <= fence.height_max_m)).all(axis=1)
        for passage in self._group:
            track_m = np.array([passage.place_m(time_s) for time_s in times_s.tolist()])
            free &= (self._outside_m(way_m - track_m) >= 0.0).all(axis=1)
        return bool(free.any())


def _legs(kind: str, speed_m_s: float, random: np.random.Generator) -> tuple[float, tuple[Leg, ...], float]:
    """Speed, the legs between two straight ones, and the share of these after which a track is at its aim."""
    side = random.choice((-1.0, 1.0))
    if kind == "turn":  # of standard rate
        turn_s = random.uniform(10.0, 60.0)
        return speed_m_s, (Leg(turn_s, 0.0, side * radians(3.0)),), random.uniform(0.0, 1.0)
    if kind == "circle":  # a helicopter
        speed_m_s = min(speed_m_s, 20.0)
        turn_rad_s = speed_m_s / random.uniform(40.0, 120.0)
        turns = random.uniform(1.0, 2.0)
        return (
            speed_m_s,
            (Leg(turns * 2 * pi / turn_rad_s, 0.0, side * turn_rad_s),),
            random.uniform(0.0, 1.0),
        )
    if kind == "back":  # a boat
        speed_m_s = min(speed_m_s, 8.0)
        turn_rad_s = speed_m_s / random.uniform(10.0, 30.0)
        return speed_m_s, (Leg(pi / turn_rad_s, 0.0, side * turn_rad_s),), random.uniform(-1.0, 2.0)
    if kind == "hover":
        brakes_s = speed_m_s / 2.0
        legs = (Leg(brakes_s, -2.0), Leg(random.uniform(10.0, 40.0)), Leg(brakes_s, 2.0))
        return speed_m_s, legs, random.uniform(0.0, 1.0)
    return speed_m_s, (), 0.0


@dataclass(frozen=True, slots=True)
class TrafficFigures:
    """Tracks that crossed the formation."""

    crossings: int
    announced: int
    entries: int  # of vehicles into a track's cylinder
    avoidable: int  # of these, the ones that could have been avoided
    closest_m: float | None  # to the cylinder


def figures(passages: list[Passage]) -> TrafficFigures:
    closest_m = min((passage.closest_m for passage in passages), default=inf)
    return TrafficFigures(
        crossings=len(passages),
        announced=int(np.isfinite([passage.announced_s for passage in passages]).sum()),
        entries=sum(len(passage.entered) for passage in passages),
        avoidable=sum(len(passage.entered.keys() - passage.unavoidable) for passage in passages),
        closest_m=round(closest_m, 3) if np.isfinite(closest_m) else None,
    )
