"""Alarms of the space that vehicles fly in: too near to each other or to an obstacle, and no way on."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.control import Tick
from gcs.flight.state.newest import InForce, Newest
from gcs.flight.state.vehicle import FlightVehicles
from gcs.model.lifecycle import FLOWN
from gcs.model.plan import Obstacle
from gcs.model.state import Array, Mask
from gcs.planning.feasibility import without_room_m
from gcs.safety.floor import Floor
from gcs.safety.neighbours import near_pairs
from gcs.safety.target_clearance import away_m
from gcs.service.alarms import AlarmCause, AlarmSeverity, Condition, Limit, beyond

CLOSE: Final = Limit(on=1.0, off=1.05)
"""Distance as a share of the minimum, in the metric in which the ellipsoid is a sphere."""

WITHIN: Final = 0.5
"""Share of an obstacle's margins: farther inside them is too near."""


class ClosePairs:
    """Finds close pairs, and remembers them for the hysteresis."""

    def __init__(self) -> None:
        self._close: frozenset[tuple[int, int]] = frozenset()

    @property
    def any(self) -> bool:
        return bool(self._close)

    @staticmethod
    def reach_m(floor: Floor) -> float:
        """Distance above which a pair cannot count, provided that no pair was close before."""
        return CLOSE.off * max(floor.horizontal_m, floor.vertical_m)

    def look(self, position_m: Array, airborne: Mask, floor: Floor) -> list[tuple[int, int, float]]:
        """Return all pairs that are too close, by their rows, and their true distances; nearest first.

        Args:
            position_m: (n, 3) show frame, NaN where not known.
            airborne: (n,) a pair counts if at least one is airborne and not both are below the pad height.
            floor: the minimum-separation ellipsoid.
        """
        located: Mask = np.asarray(np.isfinite(position_m).all(axis=1))
        reach_m = np.full(len(position_m), CLOSE.off * floor.horizontal_m / 2.0)
        first, second = np.sort(near_pairs(located, position_m * floor.scale, located, reach_m), axis=0)
        is_low: Mask = np.asarray(-position_m[:, 2] < floor.pad_height_m)
        counts = (airborne[first] | airborne[second]) & ~(is_low[first] & is_low[second])
        first, second = first[counts], second[counts]
        offset_m = position_m[first] - position_m[second]
        share = np.linalg.norm(offset_m * floor.scale, axis=1) / floor.horizontal_m
        rows = list(zip(first.tolist(), second.tolist(), strict=True))
        was_close = np.array([pair in self._close for pair in rows], np.bool_)
        close = beyond(was_close, share, CLOSE)
        self._close = frozenset(pair for pair, is_close in zip(rows, close, strict=True) if is_close)
        apart_m = np.linalg.norm(offset_m, axis=1)
        nearest_first = np.argsort(share).tolist()
        return [(*rows[at], float(apart_m[at])) for at in nearest_first if close[at]]


def inside_margins(
    boxes: Sequence[Obstacle], position_m: Array, time_s: float, margin_m: float, headroom_m: float
) -> Mask:
    """Find positions beside or above boxes that are nearer than these margins, or inside.

    Args:
        boxes: k of them, show frame.
        position_m: (n, 3) show frame; NaN is in none.
        time_s: of the positions.
        margin_m: sideways.
        headroom_m: upwards.

    Returns: (n, k)
    """
    center_m = np.array([box.position_m(time_s) for box in boxes])
    half_m = np.array([(box.half_length_x_m, box.half_length_y_m) for box in boxes]) + margin_m
    top_m = np.array([box.height_m for box in boxes]) + headroom_m
    beside: Mask = (np.abs(position_m[:, None, :2] - center_m) < half_m).all(axis=2)
    return np.asarray(beside & (-position_m[:, 2, None] < top_m))


PATHS: Final = "the paths of lost vehicles"
STANDING: Final = "obstacles that stand"
W: Final = AlarmSeverity.WARNING

SURE_S: Final = 2.0
"""For so long the planner finds no way before the alarm begins."""


@dataclass(eq=False)
class SpaceAlarms:
    """Of one flight, on the event loop only."""

    newest: Newest
    in_force: InForce
    vehicles: FlightVehicles

    def __post_init__(self) -> None:
        self._pairs = ClosePairs()

    def of_distances(self, tick: Tick) -> Iterator[Condition]:
        """Yield pairs that are too close."""
        floor, pairs = tick.floor, self._pairs
        if not pairs.any and not tick.minimum_separation_m < pairs.reach_m(floor):
            return
        ids = self.newest.state.ids + tick.elsewhere
        least = f"at least {floor.horizontal_m:g} m sideways or {floor.vertical_m:g} m up and down"
        for one, other, apart_m in pairs.look(tick.position_m, tick.airborne, floor):
            yield Condition(AlarmCause.TOO_CLOSE, f"{apart_m:.1f} m apart, {least}", (ids[one], ids[other]))

    def of_obstacles(self) -> Iterator[Condition]:
        """Yield vehicles of this station inside the margins of obstacles, which may appear where they are."""
        fleet, boxes = self.newest.state, self.in_force.plan.obstacles
        steered = [vehicle for vehicle in self.vehicles.in_phase(*FLOWN) if not vehicle.flags.handed_over]
        if not boxes or not steered:
            return
        avoidance = self.in_force.control.law.avoidance
        here_m = fleet.position_m[[vehicle.row for vehicle in steered]]
        margins_m = WITHIN * avoidance.margin_m, WITHIN * avoidance.headroom_m
        inside = inside_margins(boxes, here_m, fleet.time_s, *margins_m)
        because = f"inside its margin of {avoidance.margin_m:g} m"
        consequence = "[It is|They are] led out the nearest way."
        for at, which in np.argwhere(inside).tolist():
            ids, about = (steered[at].id,), boxes[which].id
            yield Condition(AlarmCause.OBSTACLE_NEAR, because, ids, consequence, about=about)

    def of_the_target(self) -> Iterator[Condition]:
        """Yield own vehicles that are nearer to the target than its clearance, and a fence too low for it."""
        fleet, plan = self.newest.state, self.in_force.plan
        targets = [each for each in (*self.newest.kept_clear.values(), plan.target) if each.clearance_m]
        flying = [vehicle for vehicle in self.vehicles.in_phase(*FLOWN) if not vehicle.flags.handed_over]
        if not targets or not flying:
            return
        here_m = fleet.position_m[[each.row for each in flying]]
        apart_m = np.array([away_m(here_m, each, fleet.time_s) for each in targets])
        inside_m = apart_m - np.array([[each.clearance_m] for each in targets])
        for vehicle, which, off_m in zip(flying, inside_m.argmin(axis=0), inside_m.min(axis=0), strict=True):
            if off_m < 0.0:
                kept_m = targets[which].clearance_m
                because = f"{kept_m + off_m:.1f} m from it, {kept_m:g} m are kept"
                yield Condition(AlarmCause.TARGET_NEAR, because, (vehicle.id,))
        too_low_m = without_room_m(plan.target, plan.orbit, plan.formation, self.in_force.control.safety)
        if too_low_m > 0.0:
            because = f"the fence is {too_low_m:.0f} m too low for a sphere that keeps clear of it"
            consequence = f"The safety filter keeps {plan.target.clearance_m:g} m, and the shape gives way."
            yield Condition(AlarmCause.TARGET_NO_ROOM, because, consequence=consequence)


def of_the_centre(tick: Tick) -> Iterator[Condition]:
    """Yield the obstacle that keeps the centre from its target."""
    detour = tick.memory.detour
    if detour is None or not detour.held_by:
        return
    waits = "the way round it makes no headway" if detour.reaches else "no way leads to the target"
    consequence = "The formation keeps clear of it, and goes on as soon as a way is free."
    if detour.goal.flees:
        waits = "it comes towards the formation, and no way leads to the target"
        consequence = "The formation goes to open ground, and to the target as soon as a way is free."
    elif detour.goal.held_by:
        waits = "the whole formation has no room at the target"
        consequence = "The formation follows the target from the nearest place that has room."
    yield Condition(AlarmCause.NO_HEADWAY, waits, consequence=consequence, about=detour.held_by)


def of_routes(tick: Tick, ids: Sequence[str]) -> Iterator[Condition]:
    """Yield vehicles that no route leads past the closed paths of lost vehicles."""
    routes = tick.memory.routes
    for row in [] if routes is None else np.flatnonzero(routes.no_way).tolist():
        because = "none keeps the minimum separation from them"
        consequence = "[It stays|They stay] clear of the paths, and [looks|look] for a way again."
        yield Condition(AlarmCause.NO_WAY, because, (ids[row],), consequence, about=PATHS)


def of_ways(tick: Tick, ids: Sequence[str]) -> Iterator[Condition]:
    """Yield vehicles that no way leads to their goals past obstacles that stand."""
    since_s = tick.memory.no_way_s
    if since_s is None:
        return
    for row in np.flatnonzero(tick.memory.time_s - since_s >= SURE_S).tolist():
        because = "none leads round them, nor over them below the greatest height"
        consequence = (
            "[It rests|They rest] in the air, and [goes|go] on once there is one. Without one"
            " [it lands|they land] where [it is|they are] on the way home, after two minutes."
        )
        advice = "Remove obstacles that are gone, or land [it|them] where [it is|they are]."
        yield Condition(AlarmCause.NO_WAY, because, (ids[row],), consequence, advice, W, about=STANDING)
