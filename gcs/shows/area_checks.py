"""Checks a show against the areas of a service's fence: at which cue, when, and by how many metres. Pure."""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from gcs.formation.orbit import CLEAR_OF_FENCE_M
from gcs.model.state import Array
from gcs.planning.area_room import Space, area_name, ground_lack_m, lacking_m, swept_m
from gcs.safety.controlled_ground import ground_margins
from gcs.safety.fenced_areas import FencedArea, beyond_m, too_many
from gcs.shows.flaws import Flaw
from gcs.shows.format import TOO_MANY
from gcs.shows.service_rules import ServiceRules
from gcs.shows.timeline import Timeline

SAMPLED_S: Final = 0.2
NEARLY_M: Final = 0.01

GROUND: Final = "the edge of the controlled ground, on which vehicles may fall"

Lacking: TypeAlias = Iterator[tuple[int, float, Flaw]]
"""Number of the cue in the file, what is missing there in m, and that in words."""


class _LawTimes(NamedTuple):
    """Times of the law's parts, and what the formation takes then."""

    time_s: list[float]
    cue: list[int]  # in the file's timeline
    space: Space
    speed_m_s: Array  # (k,) of the formation as a whole


def area_flaws(timeline: Timeline, rules: ServiceRules) -> list[Flaw]:
    """Return where the show has no room within the areas of the service: for each cue the worst time.

    Formations are checked as spheres on their orbits, drawn parts by the places and velocities of their
    vehicles, and the pads. Needs a timeline with its drawing.
    """
    if not rules.areas and rules.controlled_ground is None:
        return []
    if flaws := count_flaws(timeline, rules.areas):
        return flaws
    worst: dict[int, tuple[float, Flaw]] = {}
    moments = _moments(timeline)
    formations = [] if moments is None else [*_of_formations(timeline, rules, moments)]
    for index, lack_m, flaw in (*formations, *_of_drawings(timeline, rules)):
        if lack_m > worst.get(index, (0.0, None))[0]:
            worst[index] = lack_m, flaw
    return [*_of_pads(timeline, rules), *(flaw for _, (_, flaw) in sorted(worst.items()))]


def count_flaws(timeline: Timeline, areas: Sequence[FencedArea]) -> list[Flaw]:
    """Return that the service's areas and the drawing's are more than a fence can have, if they are."""
    why = too_many((*areas, *timeline.areas))
    return [Flaw(("drawing",), TOO_MANY.format(why))] if why else []


def _of_pads(timeline: Timeline, rules: ServiceRules) -> Iterator[Flaw]:
    over_m = beyond_m(rules.areas, timeline.show.start_places_m)
    out = np.flatnonzero(over_m > NEARLY_M)
    if len(out):
        row = int(over_m.argmax())
        more = f", and {len(out) - 1} more are" if len(out) > 1 else ""
        text = f"pads: pad {row + 1} is {over_m[row]:.2f} m beyond an area of the service's fence{more}"
        yield Flaw(("fleet", "pads"), text)


def _moments(timeline: Timeline) -> _LawTimes | None:
    """Every time of the law's parts; None: the drawing leads all along."""
    times_s = np.arange(0.0, timeline.duration_s + SAMPLED_S / 2, SAMPLED_S).tolist()
    plans = [(time_s, timeline.plan_at(time_s)) for time_s in times_s if timeline.drawn_s(time_s) is None]
    if not plans:
        return None
    places_m = [plan.target.position_m(time_s) for time_s, plan in plans]
    rings_m = [swept_m(plan.orbit, plan.formation) for _, plan in plans]
    spheres = np.array([(plan.formation.height_m, plan.formation.radius_m) for _, plan in plans])
    heights_m = spheres[:, :1] + spheres[:, 1:] * (-1.0, 1.0)
    speeds_m_s = [
        plan.target.speed_m_s + (plan.orbit.speed_m_s if plan.orbit.radius_m > 0.0 else 0.0)
        for _, plan in plans
    ]
    return _LawTimes(
        [time_s for time_s, _ in plans],
        [timeline.cue_at(time_s).index for time_s, _ in plans],
        Space(np.array(places_m)[:, :2], np.array(rings_m), heights_m),
        np.array(speeds_m_s),
    )


def _of_formations(timeline: Timeline, rules: ServiceRules, moments: _LawTimes) -> Lacking:
    """Yield every time of the law's parts at which the sphere on its orbit has no room."""
    for lack_m, names in _lacks(rules, moments):
        for at in np.flatnonzero(lack_m > NEARLY_M).tolist():
            cue = timeline.show.timeline[moments.cue[at]].cue
            when = f"at {moments.time_s[at]:.1f} s of the show ('{cue}')"
            text = f"{when} {lack_m[at]:.1f} m are missing to {names[at]}: {_takes(moments.space, at)}"
            yield moments.cue[at], float(lack_m[at]), Flaw(("timeline", moments.cue[at]), text)


def _takes(space: Space, at: int) -> str:
    (x_m, y_m), reach_m, (low_m, high_m) = space.place_m[at], space.ring_m[at, 1], space.heights_m[at]
    around = f"orbit and sphere reach {reach_m:.1f} m from ({x_m:.1f}, {y_m:.1f}) m"
    return f"{around}, {low_m:.1f} to {high_m:.1f} m high"


def _lacks(rules: ServiceRules, moments: _LawTimes) -> Iterator[tuple[Array, Sequence[str]]]:
    """Yield (k,) what is missing, and to what."""
    space, count = moments.space, len(moments.time_s)
    if rules.areas:
        lack = lacking_m(rules.areas, space, CLEAR_OF_FENCE_M)
        yield lack.lack_m, [area_name(rules.areas, area) for area in lack.area.tolist()]
    if rules.fence is not None:
        low_m, high_m = rules.fence.height_min_m, rules.fence.height_max_m
        yield space.heights_m[:, 1] - high_m, [f"the {high_m:g} m of the service's fence"] * count
        yield low_m - space.heights_m[:, 0], [f"the {low_m:g} m of the service's fence"] * count
    if rules.controlled_ground is not None:
        fastest_m_s = float(moments.speed_m_s.max())
        yield ground_lack_m(rules.controlled_ground, space, rules.impact, fastest_m_s), [GROUND] * count


def _of_drawings(timeline: Timeline, rules: ServiceRules) -> Lacking:
    """Yield for each drawn part the vehicle that is drawn farthest beyond an area, or would fall there."""
    drawing = timeline.drawing
    if drawing is None:
        return
    for part in {part.index: part for part in reversed(timeline.parts)}.values():  # loops repeat a part
        times_s = np.append(np.arange(part.from_s, part.to_s, SAMPLED_S), part.to_s - 1e-6)
        over_m = np.stack([_over_m(timeline, rules, time_s) for time_s in times_s.tolist()])
        for kind, does in enumerate(("is {:.2f} m beyond an area of the service's fence", FALLS)):
            at, row = np.unravel_index(int(over_m[:, kind].argmax()), over_m[:, kind].shape)
            lack_m = float(over_m[at, kind, row])
            if lack_m > NEARLY_M:
                place_m = drawing.trajectories.at(float(times_s[at])).position_m[row]
                where = "x {:.1f} m, y {:.1f} m, {:.1f} m high".format(*place_m[:2], -place_m[2])
                text = f"trajectories: {drawing.vehicles[row]} {does.format(lack_m)} at {times_s[at]:.1f} s"
                flaw = Flaw(("timeline", part.index, "trajectories"), f"{text} of the drawing, {where}")
                yield part.index, lack_m, flaw


FALLS: Final = "might fall {:.2f} m outside of the controlled ground"


def _over_m(timeline: Timeline, rules: ServiceRules, time_s: float) -> Array:
    """(2, n) By how much drawn vehicles are beyond areas, and might fall outside, at a time of it."""
    if timeline.drawing is None:
        return np.zeros((2, 0))
    motion = timeline.drawing.trajectories.at(time_s)
    over_m = np.full((2, len(motion.position_m)), -np.inf)
    over_m[0] = beyond_m(rules.areas, motion.position_m)
    if rules.controlled_ground is not None:
        ground = rules.controlled_ground
        over_m[1] = -ground_margins(motion.position_m, motion.velocity_m_s, ground, rules.impact).margin_m
    return over_m
