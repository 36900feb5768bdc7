"""What is below a vehicle that its autopilot would land where it is, as far as the flight knows it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from gcs.flight.state.flight import Flight
from gcs.flight.state.vehicle import Vehicle
from gcs.model.lifecycle import GROUNDED
from gcs.model.plan import Obstacle, Target
from gcs.model.state import Array
from gcs.planning.way_down import WayDown, least_m, meets, nearest_m, nearest_to_paths_m, way_down
from gcs.safety.fenced_areas import beyond_m
from gcs.safety.target_clearance import kept_clear_m

APART: Final = 2.0
"""Times the least distance sideways: so far a vehicle that nothing leads keeps off those below."""

OFF_EDGES_M: Final = 1.0
"""From closed areas and obstacles, beside what is not known of the vehicle's position."""

UNKNOWN_PLACE: Final = "what is below (its position is not known)"


class Below(NamedTuple):
    """What keeps a vehicle from landing where it is, and what it hits if it does."""

    in_the_way: tuple[str, ...]  # each in words
    hits: tuple[str, ...]
    end_m: Array  # (3,) where it comes down, show frame


@dataclass(frozen=True, eq=False)
class SpaceBelow:
    """Of one flight, as of its newest tick."""

    flight: Flight

    def of(self, vehicle: Vehicle, drift_m_s: Array) -> Below:
        """Look below a vehicle that wind carries on with (2,) while its autopilot lands it."""
        here_m = self.flight.newest.position_m(vehicle)
        if not np.isfinite(here_m).all():
            return Below((UNKNOWN_PLACE,), (), np.full(3, np.nan))
        way = way_down(here_m, drift_m_s, 0.0 if vehicle.home_m is None else float(vehicle.home_m[2]))
        own_m = float(self.flight.newest.traits.uncertainty_m[vehicle.row])
        vehicles = list(self._vehicles(vehicle, way, own_m))
        people = list(self._people(way, own_m))
        areas = list(self._closed_areas(way, own_m))
        boxes = list(self._obstacles(way, own_m))
        ends_on = [name for name, apart_m in vehicles if apart_m < self._floor_m]
        in_the_way = [*people, *(name for name, _ in vehicles), *areas, *boxes]
        hits = [*people, *ends_on, *boxes, *areas, *self._ground_outside(way.end_m)]
        return Below(tuple(dict.fromkeys(in_the_way)), tuple(dict.fromkeys(hits)), way.end_m)

    @property
    def _floor_m(self) -> float:
        return self.flight.in_force.control.safety.floor.horizontal_m

    def _vehicles(self, vehicle: Vehicle, way: WayDown, own_m: float) -> Iterator[tuple[str, float]]:
        """Yield those below it that come too near to its way, and how near; nearest first."""
        flight, floor = self.flight, self.flight.in_force.control.safety.floor
        state, others = flight.seen(), flight.elsewhere.others
        still = np.array([phase in GROUNDED for phase in flight.vehicles.phases], np.bool_)
        place_m = np.array(state.position_m)
        velocity_m_s = np.where(still[:, None], 0.0, np.nan_to_num(state.velocity_m_s))
        place_m[vehicle.row] = np.nan
        ids, wide_m = state.ids, flight.newest.traits.uncertainty_m
        if others is not None:
            ids += others.ids
            place_m = np.concatenate([place_m, others.position_m])
            velocity_m_s = np.concatenate([velocity_m_s, np.nan_to_num(others.velocity_m_s)])
            wide_m = np.concatenate([wide_m, others.uncertainty_m])
        kept_m = np.maximum(
            APART * floor.horizontal_m, floor.horizontal_m + floor.margin_m + floor.reserve_m(own_m, wide_m)
        )
        apart_m = nearest_m(way, place_m, velocity_m_s, float(way.end_m[2]))
        near = (place_m[:, 2] >= way.place_m[0, 2]) & (apart_m < kept_m)  # False for NaN
        for row in sorted(np.flatnonzero(near).tolist(), key=lambda at: float(apart_m[at])):
            yield ids[row], float(apart_m[row])
        segments_m, lost_m = flight.closed()
        if len(segments_m):
            kept_m = floor.horizontal_m + floor.margin_m + floor.reserve_m(own_m, lost_m)
            if bool((nearest_to_paths_m(way, segments_m) < kept_m).any()):
                yield "the way of a lost vehicle", np.inf

    def _people(self, way: WayDown, own_m: float) -> Iterator[str]:
        """Yield targets that vehicles keep clear of."""
        newest, plan = self.flight.newest, self.flight.in_force.plan
        targets: list[tuple[str, Target]] = [*newest.kept_clear.items(), ("", plan.target)]
        for name, target in targets:
            if not target.clearance_m:
                continue
            floor = self.flight.in_force.control.safety.floor
            kept_m = float(kept_clear_m(target, floor, np.array([own_m]))[0, 0])
            times_s = newest.state.time_s + way.after_s
            their_m = np.array([target.position_m(time_s) for time_s in times_s.tolist()])
            if float(least_m((way.place_m[:, :2] - their_m)[:, None])[0]) < kept_m:
                yield f"target {name}" if name else "the target"

    def _closed_areas(self, way: WayDown, own_m: float) -> Iterator[str]:
        """Yield areas that vehicles stay out of, where it may come down: the latter half of its way."""
        fence = self.flight.in_force.control.safety.fence
        closed = tuple(area for area in fence.areas if not area.inside)
        landing_m = np.ascontiguousarray(way.place_m[len(way.place_m) // 2 :, :2])
        if closed and float(beyond_m(closed, landing_m).max()) > -OFF_EDGES_M - own_m:
            yield "a closed area"

    def _obstacles(self, way: WayDown, own_m: float) -> Iterator[str]:
        newest = self.flight.newest
        slow = () if newest.near_traffic is None else newest.near_traffic.boxes
        boxes: tuple[Obstacle, ...] = (*self.flight.in_force.plan.obstacles, *slow)
        for box in boxes:
            if meets(way, box, newest.state.time_s, OFF_EDGES_M + own_m):
                yield f"obstacle {box.id}"

    def _ground_outside(self, end_m: Array) -> Iterator[str]:
        fence = self.flight.in_force.control.safety.fence
        ground, end = fence.controlled_ground, np.ascontiguousarray(end_m[None, :2])
        if ground is not None and float(beyond_m((ground,), end)[0]) > 0.0:
            yield "ground that is not controlled"
        inside = tuple(area for area in fence.areas if area.inside)
        if inside and float(beyond_m(inside, end)[0]) > 0.0:
            yield "ground outside the fence"
