"""The timeline of a show: loops written out, smooth transitions, the plan at any time. Pure.

Time is the show's own, in seconds: 0 is when the first cue's sphere is assembled (decision 0011).
"""

from bisect import bisect_right
from dataclasses import dataclass, replace
from math import hypot, inf, radians, sqrt
from typing import TypeAlias

import numpy as np
import scipy  # its parts are loaded on first use: 30 MB, which most flights do not need
from numpy.typing import NDArray

from gcs.model.plan import Direction, Formation, Obstacle, Orbit, Plan, Target
from gcs.model.state import Array
from gcs.safety.fenced_areas import FencedArea
from gcs.shows.drawn import DrawnShow, Motion
from gcs.shows.drawn_parts import PlayedPart, drawn_s
from gcs.shows.format import Box, Cue, Loop, Path, Place, Show, Spin

RATE = 15.0 / 8.0
"""Greatest rate of the transition, times time over change: of 10 u^3 - 15 u^4 + 6 u^5 at u = 1/2."""

ACCELERATION = 10.0 / sqrt(3.0)
"""Greatest acceleration, times time squared over change: at u = 1/2 -+ 1 / (2 sqrt(3))."""


def shortest_s(change: float, rate_max: float, acceleration_max: float) -> float:
    """Least time in s in which a change keeps rate and acceleration; any unit, its own per s and s^2."""
    size = abs(change)
    return max(RATE * size / rate_max, sqrt(ACCELERATION * size / acceleration_max))


@dataclass(frozen=True, slots=True, eq=False)
class Glide:
    """Transition of one value (...) to another between two times; constant before and after."""

    from_s: float
    to_s: float
    before: Array
    after: Array
    cue: int  # index in the file's timeline of the cue that requests it

    def value(self, time_s: float) -> Array:
        """(...) Value at that time."""
        u = self._share(time_s)
        value: Array = self.before + (u * u * u * (10.0 + u * (6.0 * u - 15.0))) * (self.after - self.before)
        return value

    def rate(self, time_s: float) -> Array:
        """(...) Rate per s at that time."""
        u = self._share(time_s)
        if self.to_s <= self.from_s:
            return np.zeros_like(self.after)
        rate: Array = 30.0 * u * u * (1.0 - u) ** 2 / (self.to_s - self.from_s) * (self.after - self.before)
        return rate

    def _share(self, time_s: float) -> float:
        if time_s >= self.to_s:
            return 1.0
        if time_s <= self.from_s:
            return 0.0
        return (time_s - self.from_s) / (self.to_s - self.from_s)


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One quantity over the whole show: transitions in order of time, without overlap."""

    glides: tuple[Glide, ...]

    def at(self, time_s: float) -> Glide:
        """Return the newest transition that has begun; the first one before that."""
        begun = bisect_right(self.glides, time_s, key=lambda glide: glide.from_s)
        return self.glides[max(begun - 1, 0)]

    def value(self, time_s: float) -> Array:
        """(...) Value at that time."""
        return self.at(time_s).value(time_s)


LEAST_SHARE = 0.05
"""Least share of a limit left by an orbit to the target; the validation reports too small a share."""


@dataclass(frozen=True, slots=True)
class Played:
    """A cue as it is played."""

    index: int  # in the file's timeline
    at_s: float
    cue: Cue
    passage: int = 1  # of its loop


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A target on its path."""

    from_s: float
    to_s: float
    spline: "scipy.interpolate.CubicSpline"  # (2,) over seconds from `from_s`
    cue: int

    def value(self, time_s: float) -> Array:
        """(2,) Position in m."""
        return np.asarray(self.spline(min(max(time_s, self.from_s), self.to_s) - self.from_s))

    def rate(self, time_s: float) -> Array:
        """(2,) Velocity in m/s."""
        inside = self.from_s <= time_s <= self.to_s
        return np.asarray(self.spline(time_s - self.from_s, 1)) if inside else np.zeros(2)


class Live(Glide):
    """A live target: the show knows only its position when it became live, and has no transition to it."""


Leg: TypeAlias = Glide | Curve


def written_out(cues: tuple[Cue, ...], loops: tuple[Loop, ...]) -> tuple[Played, ...]:
    """Return every cue each time it is played. Loops must be in order: see `gcs.shows.validation`."""
    index_of = {cue.cue: index for index, cue in enumerate(cues)}
    ends = {index_of[loop.to_cue] - 1: (index_of[loop.from_cue], loop.times) for loop in loops}
    played: list[Played] = []
    later_s = 0.0
    for index, cue in enumerate(cues):
        played.append(Played(index, cue.at_s + later_s, cue))
        if index not in ends:
            continue
        first, times = ends[index]
        length_s = cues[index + 1].at_s - cues[first].at_s
        for passage in range(2, times + 1):
            later_s += length_s
            played += [
                Played(at, cues[at].at_s + later_s, cues[at], passage) for at in range(first, index + 1)
            ]
    return tuple(played)


def total_s(show: Show) -> float:
    at_s = {cue.cue: cue.at_s for cue in show.timeline}
    again_s = ((loop.times - 1) * (at_s[loop.to_cue] - at_s[loop.from_cue]) for loop in show.loops)
    return show.duration_s + sum(again_s)


@dataclass(frozen=True, slots=True, eq=False)
class Timeline:
    """The plan of a show at any of its times."""

    show: Show
    duration_s: float
    played: tuple[Played, ...]
    radius_m: Track
    height_m: Track
    spin_rad_s: Track
    lights: Track  # (n, 3) red, green, blue, from 0 to 255
    legs: tuple[Leg, ...]
    orbits: tuple[tuple[float, Orbit], ...]  # from when on
    obstacles: tuple[tuple[float, tuple[Obstacle, ...]], ...]  # from when on
    parts: tuple[PlayedPart, ...] = ()  # of the drawing
    drawing: DrawnShow | None = None  # of a show with drawn parts that is flown

    @staticmethod
    def of(show: Show, drawing: DrawnShow | None = None) -> "Timeline":
        """Expand the loops and lay out every transition. The show must be valid (`gcs.shows.validation`)."""
        return replace(_Writer(show).written(), drawing=drawing)

    @property
    def areas(self) -> tuple[FencedArea, ...]:
        """Areas of the drawing's own fence, as placed."""
        return () if self.drawing is None else tuple(polygon.area for polygon in self.drawing.fence)

    def plan_at(
        self, time_s: float, *, clock_s: float | None = None, runs: bool = True, live: Target | None = None
    ) -> Plan:
        """Return the plan for a tick at the show's time `time_s`.

        Args:
            time_s: from 0 to `duration_s`; before and after, the first and the last time count.
            clock_s: the tick's own time then, which targets use; None: the show's.
            runs: False while the show's clock is stopped: then the target does not move either.
            live: the newest target update, in the tick's time; None: the last known position.
        """
        now_s = min(max(time_s, 0.0), self.duration_s)
        leg = self.leg_at(now_s)
        (x_m, y_m), (x_m_s, y_m_s) = leg.value(now_s).tolist(), leg.rate(now_s).tolist()
        if not runs or now_s != time_s:
            x_m_s = y_m_s = 0.0
        reported = Target(x_m, y_m, x_m_s, y_m_s, time_s if clock_s is None else clock_s)
        radius_m, height_m, spin_rad_s = (float(track.value(now_s)[0]) for track in self._formation)
        return Plan(
            Formation(radius_m, height_m, spin_rad_s, self.show.law),
            self.orbit_at(now_s),
            live if live is not None and isinstance(leg, Live) else reported,
            self.obstacles_at(now_s),
        )

    def stages(self) -> tuple[tuple[str, Plan], ...]:
        """Cue and plan wherever a transition begins, ends or turns, in order, without repetitions."""
        times_s = {played.at_s for played in self.played}
        for track in self._formation:
            times_s |= {glide.to_s for glide in track.glides}
        for leg in self.legs:
            knots_s = leg.spline.x + leg.from_s if isinstance(leg, Curve) else [leg.from_s, leg.to_s]
            times_s |= set(np.asarray(knots_s).tolist())
        plans: list[tuple[str, Plan]] = []
        seen: set[tuple[Formation, Orbit, float, float]] = set()
        for time_s in sorted(time_s for time_s in times_s if time_s <= self.duration_s):
            if self.drawn_s(time_s) is not None:
                continue  # the drawing leads: no plan of the law
            plan = self.plan_at(time_s)
            key = (plan.formation, plan.orbit, round(plan.target.x_m), round(plan.target.y_m))
            if key not in seen:
                seen.add(key)
                plans.append((self.cue_at(time_s).cue.cue, plan))
        return tuple(plans)

    @property
    def _formation(self) -> tuple[Track, Track, Track]:
        return self.radius_m, self.height_m, self.spin_rad_s

    def drawn_s(self, time_s: float) -> float | None:
        """Return the drawing's time at a time of the show; None while the law leads, as `plan_at` says."""
        part = self.cue_at(time_s).cue.trajectories
        return None if part is None else drawn_s(self.parts, time_s)

    def motion_at(self, time_s: float) -> Motion | None:
        """Return where the drawing has all its vehicles at a time of the show, and how they move there.

        None while the law leads. Where a part has ended they rest.
        """
        at_s = self.drawn_s(time_s)
        if self.drawing is None or at_s is None:
            return None
        motion = self.drawing.trajectories.at(at_s)
        if time_s < self.parts[bisect_right(self.parts, time_s, key=lambda part: part.begin_s) - 1].end_s:
            return motion
        still = np.zeros_like(motion.position_m)
        return Motion(motion.position_m, still, still)

    def yaw_at(self, time_s: float) -> Array | None:
        """(n,) Yaw of all the drawing's vehicles, from the show's x axis; NaN where the drawing has none.

        None while the law leads, and for a show that does not ask for the drawing's yaw.
        """
        named, at_s = self.show.drawing, self.drawn_s(time_s)
        if self.drawing is None or named is None or named.yaw != "drawn" or at_s is None:
            return None
        return self.drawing.yaw.at(at_s)

    def colours_at(self, time_s: float) -> NDArray[np.uint8]:
        """(n, 3) Red, green and blue of every vehicle's light, in the order of the drawing or the fleet.

        After the last part of a drawing its lights go on to their own end, also while the vehicles return.
        """
        if self.drawing is not None and (at_s := self.drawn_s(time_s)) is not None:
            return self.drawing.lights.colours_at(at_s + max(time_s - self.parts[-1].end_s, 0.0))
        return np.asarray(np.rint(self.lights.value(time_s)).astype(np.uint8))

    @property
    def lit_until_s(self) -> float:
        """Time of the show at which its lights end."""
        if self.drawing is None or not self.parts:
            return self.duration_s
        return max(self.duration_s, self.parts[-1].end_s + self.drawing.lights.end_s - self.parts[-1].to_s)

    def cue_at(self, time_s: float) -> Played:
        return self.played[max(bisect_right(self.played, time_s, key=lambda played: played.at_s) - 1, 0)]

    def leg_at(self, time_s: float) -> Leg:
        return self.legs[max(bisect_right(self.legs, time_s, key=lambda leg: leg.from_s) - 1, 0)]

    def orbit_at(self, time_s: float) -> Orbit:
        return self.orbits[max(bisect_right(self.orbits, time_s, key=lambda at: at[0]) - 1, 0)][1]

    def obstacles_at(self, time_s: float) -> tuple[Obstacle, ...]:
        return self.obstacles[max(bisect_right(self.obstacles, time_s, key=lambda at: at[0]) - 1, 0)][1]


class _Writer:
    """Lays out one cue after the other."""

    def __init__(self, show: Show) -> None:
        self._show, self._limits = show, show.limits
        self._glides: dict[str, list[Glide]] = {"radius_m": [], "height_m": [], "spin": [], "lights": []}
        self._legs: list[Leg] = []
        self._orbits: list[tuple[float, Orbit]] = []
        self._obstacles: list[tuple[float, tuple[Obstacle, ...]]] = []

    def written(self) -> Timeline:
        show = self._show
        played = written_out(show.timeline, show.loops)
        first = next((cue_played for cue_played in played if cue_played.cue.trajectories is None), None)
        parts: list[PlayedPart] = []
        for cue_played in played:
            self._stand(cue_played)
            if (part := cue_played.cue.trajectories) is not None:
                parts.append(PlayedPart(cue_played.index, cue_played.at_s, part.from_s, part.to_s))
            else:
                self._begin(cue_played) if cue_played is first else self._change(cue_played)
        if first is None:
            self._begin(replace(played[0], cue=_stand_in(show)))
        radius, height, spin, lights = (Track(tuple(glides)) for glides in self._glides.values())
        legs, orbits, obstacles = tuple(self._legs), tuple(self._orbits), tuple(self._obstacles)
        values = radius, height, spin, lights
        return Timeline(show, total_s(show), played, *values, legs, orbits, obstacles, tuple(parts))

    def _begin(self, played: Played) -> None:
        """Lay out the law's first cue: its values hold from the beginning."""
        cue, count = played.cue, self._show.fleet.vehicles
        self._set("radius_m", played, np.array([cue.radius_m or 0.0]))
        self._set("height_m", played, np.array([cue.height_m or 0.0]))
        self._set("spin", played, np.array([_rate_rad_s(cue.spin)]))
        self._set("lights", played, _colours(cue.lights or ("#000000",), count))
        self._orbits.append((0.0, Orbit() if cue.orbit is None else Orbit(**cue.orbit.model_dump())))
        place = cue.target if isinstance(cue.target, Place) else Place(x_m=0.0, y_m=0.0)
        if isinstance(cue.target, Path) and cue.target.path[0].after_s == 0.0:
            place = cue.target.path[0]
        place_m = np.array([place.x_m, place.y_m])
        self._legs.append(Glide(0.0, 0.0, place_m, place_m, played.index))
        if isinstance(cue.target, Path) or cue.target == "live":
            self._target(played)

    def _stand(self, played: Played) -> None:
        """Lay out the obstacles of a cue."""
        appear, go = played.cue.obstacles.appear, played.cue.obstacles.go
        if appear or go or not self._obstacles:
            before = self._obstacles[-1][1] if self._obstacles else ()
            stays = [box for box in before if box.id not in go]
            self._obstacles.append((played.at_s, (*stays, *map(obstacle_of, appear))))

    def _set(self, what: str, played: Played, value: Array) -> None:
        self._glides[what].append(Glide(0.0, 0.0, value, value, played.index))

    def _change(self, played: Played) -> None:
        """Lay out a later cue: its values change over its time, or the shortest."""
        cue, limits = played.cue, self._limits
        if cue.orbit is not None:
            self._orbits.append((played.at_s, Orbit(**cue.orbit.model_dump())))
        sizes = (
            ("radius_m", cue.radius_m, limits.radius_rate_max_m_s),
            ("height_m", cue.height_m, limits.formation_climb_max_m_s),
        )
        for what, value, rate_max in sizes:
            if value is not None:
                acceleration_max = limits.formation_acceleration_max_m_s2
                self._glide(what, played, np.array([value]), rate_max, acceleration_max)
        if cue.spin is not None:
            self._glide(
                "spin", played, np.array([_rate_rad_s(cue.spin)]), self.spin_change_max(played.at_s), inf
            )
        if cue.lights is not None:
            self._glide("lights", played, _colours(cue.lights, self._show.fleet.vehicles), inf, inf)
        if cue.target is not None:
            self._target(played)

    def spin_change_max(self, at_s: float) -> float:
        """Rate in rad/s^2 at which no vehicle accelerates more than the formation may."""
        glide = Track(tuple(self._glides["radius_m"])).at(at_s)
        rim_m = max(float(glide.value(at_s)[0]), float(glide.after[0]))
        return self._limits.formation_acceleration_max_m_s2 / rim_m

    def _glide(
        self, what: str, played: Played, after: Array, rate_max: float, acceleration_max: float
    ) -> None:
        before = Track(tuple(self._glides[what])).value(played.at_s)
        size = float(np.abs(after - before).max())
        over_s = played.cue.over_s or shortest_s(size, rate_max, acceleration_max)
        self._glides[what].append(Glide(played.at_s, played.at_s + over_s, before, after, played.index))

    def _target(self, played: Played) -> None:
        target, leg = played.cue.target, self._legs[-1]
        here_m = leg.value(played.at_s)
        if isinstance(target, Path):
            points = [(point.after_s, point.x_m, point.y_m) for point in target.path]
            if points[0][0] > 0.0:
                points.insert(0, (0.0, float(here_m[0]), float(here_m[1])))
            when_s, *place_m = np.array(points).T
            if len(points) == 1:
                self._legs.append(
                    Glide(played.at_s, played.at_s, here_m, np.array(points[0][1:]), played.index)
                )
                return
            spline = scipy.interpolate.CubicSpline(when_s, np.column_stack(place_m), bc_type="clamped")
            self._legs.append(Curve(played.at_s, played.at_s + float(when_s[-1]), spline, played.index))
        elif isinstance(target, Place):
            there_m = np.array([target.x_m, target.y_m])
            speed_m_s, acceleration_m_s2 = self._left_to_target()
            size_m = hypot(*(there_m - here_m).tolist())
            over_s = played.cue.over_s or shortest_s(size_m, speed_m_s, acceleration_m_s2)
            if isinstance(leg, Live):
                over_s = 0.0  # the start is not known: the centre flies there within its own limits
            self._legs.append(Glide(played.at_s, played.at_s + over_s, here_m, there_m, played.index))
        else:
            self._legs.append(Live(played.at_s, played.at_s, here_m, here_m, played.index))

    def _left_to_target(self) -> tuple[float, float]:
        """Speed and acceleration of the centre that the orbit leaves."""
        most = self._limits.formation_speed_max_m_s, self._limits.formation_acceleration_max_m_s2
        speed, turn = (
            max(limit - taken, LEAST_SHARE * limit)
            for limit, taken in zip(most, turning(self._orbits[-1][1]), strict=True)
        )
        return speed, turn


def _stand_in(show: Show) -> Cue:
    """Return a cue of the law for a show that is drawn all along; it never leads."""
    return Cue(cue="none", at_s=0.0, radius_m=1.0, height_m=show.fleet.takeoff_height_m)


def turning(orbit: Orbit) -> tuple[float, float]:
    """Speed in m/s and acceleration in m/s^2 of the centre on its orbit; zero above the target."""
    if not orbit.radius_m:
        return 0.0, 0.0
    return orbit.speed_m_s, orbit.speed_m_s**2 / orbit.radius_m


def obstacle_of(box: Box) -> Obstacle:
    return Obstacle(**box.model_dump())


def _rate_rad_s(spin: Spin | None) -> float:
    if spin is None:
        return 0.0
    return radians(spin.rate_deg_s) * (1.0 if spin.direction is Direction.CLOCKWISE else -1.0)


def _colours(lights: tuple[str, ...], count: int) -> Array:
    """(n, 3) Colours, assigned to the vehicles in turn."""
    rgb = np.array(
        [[int(colour[at : at + 2], 16) for at in (1, 3, 5)] for colour in lights], dtype=np.float64
    )
    return np.asarray(rgb[np.arange(count) % len(rgb)])
