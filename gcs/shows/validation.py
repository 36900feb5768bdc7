"""Finds what is wrong with a show without flying it. Pure.

Applies the tick's own limits to the plan at every time of every transition. What violates them would be
flown late, elsewhere or not at all.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import hypot
from typing import TypeAlias

import numpy as np

from gcs.config.yaml_files import Loc
from gcs.control import ControlSettings
from gcs.model.errors import InvalidError, RefusedError
from gcs.model.plan import MAX_OBSTACLES, Plan
from gcs.planning.feasibility import check_formation, check_obstacle, check_orbit, check_target
from gcs.shows.drawn_parts import cue_flaws, span_flaws
from gcs.shows.flaws import Flaw, of_value
from gcs.shows.format import MAX_CUES, Cue, Path, Show, ShowLimits
from gcs.shows.timeline import (
    Curve,
    Glide,
    Leg,
    Live,
    Played,
    Timeline,
    obstacle_of,
    shortest_s,
    total_s,
    turning,
    written_out,
)

SAMPLED_S = 0.1
"""Interval at which the whole plan is examined."""

NEARLY = 1e-6
"""Tolerance for rounding errors."""

LONGEST_S = 7200.0
"""Loops included; no battery lasts as long."""


Kind: TypeAlias = tuple[str, tuple[Leg, ...], float | None]
"""A quantity: its key, its transitions, and its greatest rate."""


def flaws(show: Show) -> list[Flaw]:
    """Return everything that is wrong with a show as far as it is detectable without flying it."""
    flawed = [*_fleet(show), *_structure(show), *_loops(show), *cue_flaws(show)]
    if flawed:
        return flawed  # the rest needs a valid timeline
    flawed = [*_paths(show), *_obstacles(show)]
    if flawed:
        return flawed
    timeline = Timeline.of(show)
    begins_s = [played.at_s for played in timeline.played]
    flawed = list(span_flaws(timeline.parts, begins_s, timeline.duration_s))
    return [*flawed, *_transitions(timeline), *_moments(timeline)]


# before loops are written out


def _fleet(show: Show) -> Iterator[Flaw]:
    fence, fleet, floor = show.fence, show.fleet, show.control.safety.floor
    if not fence.height_min_m < fence.height_max_m:
        yield of_value(fence.height_max_m, "above height_min_m", "fence", "height_max_m")
    if fleet.takeoff_height_m < fence.height_min_m:
        text = f"at least the fence's {fence.height_min_m:g} m"
        yield of_value(fleet.takeoff_height_m, text, "fleet", "takeoff_height_m")
    least_m = floor.kept_m(floor.worst_reserve_m())[0]
    if fleet.vehicles > 1 and fleet.pads.spacing_m < least_m - NEARLY:
        text = f"at least {least_m:.3g} m, or a climbing vehicle comes too close to its neighbour"
        yield of_value(fleet.pads.spacing_m, text, "fleet", "pads", "spacing_m")
    farthest_m = float(np.hypot(*show.start_places_m[:, :2].T).max())
    if farthest_m > fence.distance_max_m:
        text = f"a pad lies {farthest_m:.1f} m from the origin, beyond the fence at"
        yield Flaw(("fleet", "pads"), f"{text} {fence.distance_max_m:g} m")


def _structure(show: Show) -> Iterator[Flaw]:
    cues = show.timeline
    first = cues[0]
    if first.at_s != 0.0:
        yield of_value(first.at_s, "the first cue begins at 0", "timeline", 0, "at_s")
    leads = next((index for index, cue in enumerate(cues) if cue.trajectories is None), None)
    for key in ("radius_m", "height_m"):
        if leads is not None and getattr(cues[leads], key) is None:
            where = "where the show begins" if leads == 0 else "where the formation begins"
            which = "first cue" if leads == 0 else "first cue without trajectories"
            yield Flaw(("timeline", leads), f"{key} is missing: the {which} says {where}")
    named = Counter(cue.cue for cue in cues)
    for index, (before, cue) in enumerate(pairwise(cues), start=1):
        if not cue.at_s > before.at_s:
            text = f"after the {before.at_s:g} s of '{before.cue}'"
            yield of_value(cue.at_s, text, "timeline", index, "at_s")
        if named[cue.cue] > 1 and cue.cue in {earlier.cue for earlier in cues[:index]}:
            yield of_value(cue.cue, "the name is there twice", "timeline", index, "cue")
    if show.duration_s <= cues[-1].at_s:
        text = f"longer than the {cues[-1].at_s:g} s of the last cue"
        yield of_value(show.duration_s, text, "duration_s")


def _loops(show: Show) -> Iterator[Flaw]:
    """Check ends and order of the loops, and the duration that results."""
    index_of = {cue.cue: index for index, cue in enumerate(show.timeline)}
    taken: set[int] = set()
    sound = True
    for at, loop in enumerate(show.loops):
        unknown = [key for key in ("from_cue", "to_cue") if getattr(loop, key) not in index_of]
        for key in unknown:
            yield of_value(getattr(loop, key), "there is no such cue", "loops", at, key)
        if unknown:
            sound = False
            continue
        inside = set(range(index_of[loop.from_cue], index_of[loop.to_cue]))
        if not inside:
            yield of_value(loop.to_cue, f"a cue after '{loop.from_cue}'", "loops", at, "to_cue")
        if inside & taken:
            text = f"the loop from '{loop.from_cue}' lies in another one; loops follow each other"
            yield Flaw(("loops", at), text)
        sound = sound and bool(inside) and not inside & taken
        taken |= inside
    if not sound:
        return
    long_s = total_s(show)
    if long_s > LONGEST_S:
        yield Flaw(("duration_s",), f"{long_s:g} s with the loops: at most {LONGEST_S:g} s")
    count = len(written_out(show.timeline, show.loops)) if long_s <= LONGEST_S else 0
    if count > MAX_CUES:
        yield Flaw(("loops",), f"{count} cues with the loops: at most {MAX_CUES}")


def _paths(show: Show) -> Iterator[Flaw]:
    """Check times of the points, and whether a path begins at the target."""
    for index, cue in enumerate(show.timeline):
        if not isinstance(cue.target, Path):
            continue
        for at, (before, point) in enumerate(pairwise(cue.target.path), start=1):
            if not point.after_s > before.after_s:
                text = f"more than the {before.after_s:g} s of the point before"
                yield of_value(point.after_s, text, "timeline", index, "target", "path", at, "after_s")


def _obstacles(show: Show) -> Iterator[Flaw]:
    """Check that obstacles appear and disappear consistently, loops played."""
    avoidance = show.control.law.avoidance
    pads_m = {f"pad {row + 1}": place_m for row, place_m in enumerate(show.start_places_m)}
    standing: set[str] = set()
    reported: set[tuple[int, str]] = set()
    for played in written_out(show.timeline, show.loops):
        loc = ("timeline", played.index, "obstacles")
        for at, name in enumerate(played.cue.obstacles.go):
            if name not in standing and (played.index, name) not in reported:
                reported.add((played.index, name))
                yield Flaw((*loc, "go", at), f"go = {name}: {_again(played)}no such obstacle stands")
            standing.discard(name)
        for at, box in enumerate(played.cue.obstacles.appear):
            if box.id in standing and (played.index, box.id) not in reported:
                reported.add((played.index, box.id))
                yield Flaw((*loc, "appear", at, "id"), f"id = {box.id}: {_again(played)}it stands already")
            standing.add(box.id)
            try:
                check_obstacle(obstacle_of(box), avoidance, {}, pads_m)
            except RefusedError as error:
                if played.passage == 1:
                    yield Flaw((*loc, "appear", at), str(error))
        if len(standing) > MAX_OBSTACLES and played.passage == 1:
            yield Flaw(loc, f"{len(standing)} obstacles at once: at most {MAX_OBSTACLES}")


def _again(played: Played) -> str:
    return "" if played.passage == 1 else f"in passage {played.passage} of its loop: "


# every transition


def _transitions(timeline: Timeline) -> list[Flaw]:
    """Check that each is slow enough, and ends before the next begins and before the show ends."""
    limits = timeline.show.limits
    kinds: tuple[Kind, ...] = (
        ("radius_m", timeline.radius_m.glides, limits.radius_rate_max_m_s),
        ("height_m", timeline.height_m.glides, limits.formation_climb_max_m_s),
        ("spin", timeline.spin_rad_s.glides, None),
        ("lights", timeline.lights.glides, None),
        ("target", timeline.legs, limits.formation_speed_max_m_s),
    )
    flaw_at: dict[Loc, Flaw] = {}
    for key, legs, rate_m_s in kinds:
        fast = [] if rate_m_s is None else _too_fast(key, legs, rate_m_s, limits)
        for flaw in (*fast, *_in_time(timeline, key, legs)):
            flaw_at.setdefault(flaw.loc, flaw)
    for flaw in (*_paths_begin(timeline), *_cut_by_parts(timeline, kinds)):
        flaw_at.setdefault(flaw.loc, flaw)
    return list(flaw_at.values())


def _cut_by_parts(timeline: Timeline, kinds: Sequence[Kind]) -> Iterator[Flaw]:
    """Yield drawn parts that begin while the law changes something."""
    for key, legs, _ in kinds:
        for leg in legs:
            for part in timeline.parts:
                if leg.from_s < part.begin_s < leg.to_s - NEARLY:
                    name = timeline.show.timeline[leg.cue].cue
                    text = f"trajectories: {key} of '{name}' is on its way until {leg.to_s:.1f} s"
                    yield Flaw(("timeline", part.index, "trajectories"), text)


def _in_time(timeline: Timeline, key: str, legs: Sequence[Leg]) -> Iterator[Flaw]:
    for before, leg in pairwise(legs):
        if before.to_s > leg.from_s + NEARLY:
            way = f"{key}: '{timeline.show.timeline[before.cue].cue}' is on its way until {before.to_s:.1f} s"
            begins = f"this begins at {leg.from_s:g} s of the show{_written(timeline, leg.cue, leg.from_s)}"
            yield Flaw(("timeline", leg.cue, key), f"{way}, {begins}")
    last = legs[-1]
    if last.to_s > timeline.duration_s + NEARLY:
        text = f"{key} is on its way until {last.to_s:.1f} s, the show ends at {timeline.duration_s:g} s"
        yield Flaw(("timeline", last.cue, key), text)


def _written(timeline: Timeline, index: int, at_s: float) -> str:
    """Return the time written in the file, if it differs."""
    written_s = timeline.show.timeline[index].at_s
    return "" if abs(written_s - at_s) < NEARLY else f" (its loop repeats the cue of {written_s:g} s)"


def _too_fast(key: str, legs: Sequence[Leg], rate_m_s: float, limits: ShowLimits) -> Iterator[Flaw]:
    change_m_s2 = limits.formation_acceleration_max_m_s2
    for glide in legs:
        if not isinstance(glide, Glide) or glide.to_s <= glide.from_s:
            continue
        size_m = float(np.linalg.norm(glide.after - glide.before))
        needed_s, given_s = shortest_s(size_m, rate_m_s, change_m_s2), glide.to_s - glide.from_s
        if given_s < needed_s - NEARLY:
            least = f"that takes at least {needed_s:.1f} s at {rate_m_s:g} m/s and {change_m_s2:g} m/s^2"
            text = f"{key} changes by {size_m:.3g} m, {least}"
            yield of_value(given_s, text, "timeline", glide.cue, "over_s")


def _paths_begin(timeline: Timeline) -> Iterator[Flaw]:
    """Check that each path begins at the target's position then."""
    for before, leg in pairwise(timeline.legs):
        if isinstance(before, Live) or not isinstance(leg, Curve):
            continue
        off_m = leg.value(leg.from_s) - before.value(leg.from_s)
        if hypot(*off_m.tolist()) > 0.05:
            there = "({:.1f}, {:.1f}) m".format(*before.value(leg.from_s).tolist())
            begins = f"the path begins {hypot(*off_m.tolist()):.1f} m from the target, which is at {there} at"
            when = f"{leg.from_s:g} s of the show{_written(timeline, leg.cue, leg.from_s)}"
            yield Flaw(("timeline", leg.cue, "target", "path", 0), f"{begins} {when}")


# every time


def _moments(timeline: Timeline) -> list[Flaw]:
    """Check the plan at every time against the limits of an operator's commands."""
    flaw_at: dict[tuple[int, str], Flaw] = {}
    began_s: dict[tuple[int, str], float] = {}
    control = timeline.show.control
    for time_s in np.arange(0.0, timeline.duration_s + SAMPLED_S / 2, SAMPLED_S).tolist():
        if timeline.drawn_s(time_s) is not None:
            continue
        played = timeline.cue_at(time_s)
        for key, text in _moment(timeline, time_s, control):
            index = _index_of(timeline, key, played, time_s)
            if (index, key) in flaw_at and key == "target":
                continue  # a path is reported where the violation begins, a size or speed where it ends
            from_s = began_s.setdefault((index, key), time_s)
            cue = timeline.show.timeline[index]
            loc = ("timeline", index, key) if _sets(cue, key) else ("timeline", index)
            flaw_at[index, key] = Flaw(loc, f"{text} (from {from_s:.1f} s of the show)")
    return list(flaw_at.values())


def _sets(cue: Cue, key: str) -> bool:
    return getattr(cue, key) is not None


def _index_of(timeline: Timeline, key: str, played: Played, time_s: float) -> int:
    """Return the newest cue so far that sets `key`."""
    setting = [other.index for other in timeline.played if other.at_s <= time_s and _sets(other.cue, key)]
    return setting[-1] if setting else played.index


def _moment(timeline: Timeline, time_s: float, control: ControlSettings) -> Iterator[tuple[str, str]]:
    """Yield key and text of everything that is wrong at one time."""
    plan, limits = timeline.plan_at(time_s), timeline.show.limits
    try:
        check_formation(plan.formation, timeline.show.fleet.vehicles, control.safety)
    except InvalidError as error:
        yield error.field, str(error)
    try:
        check_orbit(plan.orbit, control.law)
    except InvalidError as error:
        yield "orbit", f"orbit: {error}"
    if plan.target.speed_m_s > limits.formation_speed_max_m_s + NEARLY:
        text = f"target: {plan.target.speed_m_s:.2f} m/s, at most {limits.formation_speed_max_m_s:g} m/s"
        yield "target", text
    else:
        try:
            check_target(plan.target, plan.orbit, plan.formation, control)
        except InvalidError as error:
            yield "target", f"target: {error}"
        yield from _together(timeline, plan, time_s)


def _together(timeline: Timeline, plan: Plan, time_s: float) -> Iterator[tuple[str, str]]:
    """Check the sum of target, orbit and spin for the centre and the vehicles."""
    limits, (orbit_m_s, turn_m_s2) = timeline.show.limits, turning(plan.orbit)
    along_m_s = plan.target.speed_m_s + orbit_m_s
    fastest_m_s = limits.formation_speed_max_m_s
    if orbit_m_s <= fastest_m_s < along_m_s - NEARLY:
        both = f"its {plan.target.speed_m_s:.2f} m/s and the orbit's {orbit_m_s:g} m/s"
        yield "target", f"target: {both} are more than the formation's {fastest_m_s:g} m/s"
    ahead = timeline.plan_at(min(time_s + SAMPLED_S, timeline.duration_s)).target
    change_m_s = np.subtract(ahead.velocity_m_s, plan.target.velocity_m_s)
    strongest_m_s2 = limits.formation_acceleration_max_m_s2
    push_m_s2 = hypot(*change_m_s.tolist()) / SAMPLED_S + turn_m_s2
    if turn_m_s2 <= strongest_m_s2 and push_m_s2 > 1.02 * strongest_m_s2 and time_s < timeline.duration_s:
        push = f"it turns or speeds up by {push_m_s2:.2f} m/s^2 with the orbit"
        yield "target", f"target: {push}, at most {strongest_m_s2:g} m/s^2: give it more time"
    radius_m, spin_rad_s = plan.formation.radius_m, abs(plan.formation.spin_rad_s)
    rim_m_s, pull_m_s2 = spin_rad_s * radius_m, spin_rad_s**2 * radius_m
    rim = f"at the rim of {radius_m:g} m"
    if spin_rad_s and rim_m_s + along_m_s > limits.speed_max_m_s + NEARLY:
        both = f"{rim_m_s:.1f} m/s {rim} and {along_m_s:.1f} m/s of the centre"
        yield "spin", f"spin: {both}: at most the vehicles' {limits.speed_max_m_s:g} m/s"
    elif pull_m_s2 > strongest_m_s2 + NEARLY:
        most_deg_s = np.floor(10.0 * np.degrees(np.sqrt(strongest_m_s2 / radius_m))) / 10.0
        limit = f"at most {strongest_m_s2:g} m/s^2: {most_deg_s:.1f} deg/s"
        yield "spin", f"spin: {pull_m_s2:.2f} m/s^2 {rim}, {limit}"
