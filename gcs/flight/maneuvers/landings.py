"""Maneuvers that end on the ground: home alone, home with all, and down from where a vehicle is."""

import asyncio
import logging
from collections.abc import Callable
from functools import partial

import numpy as np

from gcs.flight.maneuvers.collective_return import CollectiveReturn
from gcs.flight.maneuvers.descent import SLOW_S, Descent
from gcs.flight.maneuvers.landing_places import LandingPlaces
from gcs.flight.maneuvers.maneuver_steps import NO_PROGRESS_S, Maneuver, Steps
from gcs.flight.state.newest import Newest
from gcs.flight.state.vehicle import Vehicle
from gcs.model.lifecycle import Event
from gcs.model.state import Array, FleetState, VehicleId
from gcs.planning.return_paths.paths import above_place_m, is_above

log = logging.getLogger(__name__)

SEARCHES_A_TICK = 2
"""Landing places that are chosen in one tick while some are closed: each takes up to 20 ms."""

WAY_S = 90.0
"""The limit `NO_PROGRESS_S` for returns along planned paths, on which some vehicles wait for others."""

SEARCH_AGAIN_S = 2.0
"""While no place to land is free of obstacles, the next search is so much later."""


def comes_down(place_m: Array, home_m: Array) -> str:
    """Describe the descent of a returning vehicle onto a place (3,), with its pad at `home_m` (3,)."""
    if (place_m == home_m).all():
        return "above its start, comes down"
    away_m = float(np.hypot(*(place_m - home_m)[:2]))
    return f"comes down {away_m:.0f} m beside its start: a lost vehicle or an obstacle is there"


def _has_passed(time_s: float) -> bool:
    return asyncio.get_running_loop().time() >= time_s


class Landings:
    """The landings of one flight."""

    def __init__(
        self,
        newest: Newest,
        steps: Steps,
        places: LandingPlaces,
        descent: Callable[[Vehicle, Array], Descent],
        may_descend: Callable[[Vehicle], bool],
        closing: Callable[[], frozenset[VehicleId]],
    ) -> None:
        """Whether a vehicle `may_descend` depends on those below it; `closing` are the lost vehicles."""
        self._newest, self._steps, self._places = newest, steps, places
        self._descent, self._may_descend, self._closing = descent, may_descend, closing
        self._searched: tuple[FleetState, int] | None = None  # landing places in one tick

    async def come_home(self, vehicle: Vehicle) -> None:
        home_m = await self._home_to_fly_to_m(vehicle, "on its way home")
        if home_m is None:
            return
        place_m = await self._fly_above_place(vehicle, self._home_m)
        vehicle.apply(Event.DESCEND, comes_down(place_m, home_m))
        await self._descend_slowly(vehicle, place_m, self._home_m)

    def come_home_together(self, collective_return: CollectiveReturn, stops_m: Array) -> Maneuver:
        """Stop at `stops_m` (3,), follow the path of the collective return, and land."""

        async def maneuver(vehicle: Vehicle) -> None:
            home_m = await self._home_to_fly_to_m(vehicle, "stops, before all come home")
            if home_m is None:
                return
            vehicle.goal_m = stops_m
            collective_return.stopping(vehicle)
            await self._steps.until(
                vehicle, lambda: collective_return.is_planned or not collective_return.takes_part(vehicle)
            )
            if collective_return.takes_part(vehicle):
                vehicle.reason, vehicle.lands_at_m = "on its way home", collective_return.place_m(vehicle)
                await self._steps.until(
                    vehicle, lambda: self._led(vehicle, collective_return), patience_s=WAY_S
                )
            if not collective_return.takes_part(vehicle):
                vehicle.lands_at_m = None
                await self.come_home(vehicle)
                return
            place_m = collective_return.place_m(vehicle)
            vehicle.apply(Event.DESCEND, comes_down(place_m, home_m))
            await self._descend_slowly(vehicle, place_m, self._home_m)

        return maneuver

    async def _home_to_fly_to_m(self, vehicle: Vehicle, reason: str) -> Array | None:
        """Begin the way home. Returns: (3,) its pad; None where its autopilot lands it, or has control."""
        home_m = vehicle.home_m
        if vehicle.comes_down_alone or home_m is None:
            await self._steps.autopilot_land(vehicle)
            return None
        return home_m if await self._steps.under_control(vehicle, Event.COME_HOME, reason) else None

    def _led(self, vehicle: Vehicle, collective_return: CollectiveReturn) -> bool:
        """Move the goal along the path. Returns: whether it is above its place, or has left the plan."""
        if not collective_return.takes_part(vehicle):
            return self._is_received(vehicle)
        vehicle.goal_m = collective_return.goal_m(vehicle)
        vehicle.set_flags(follows_planned_path=collective_return.follows_path(vehicle))
        return collective_return.has_arrived(vehicle)

    def descend(self, place_m: Array) -> Maneuver:
        """Descend onto `place_m` (3,), lowest vehicle first, and land."""

        async def maneuver(vehicle: Vehicle) -> None:
            if vehicle.comes_down_alone:
                await self._steps.autopilot_land(vehicle)
                return
            if not await self._steps.under_control(vehicle, Event.DESCEND, "comes down"):
                return
            vehicle.goal_m = np.array([place_m[0], place_m[1], self._newest.position_m(vehicle)[2]])
            await self._steps.ticked()  # until then all vehicles commanded together have begun, and count
            await self._steps.until(
                vehicle,
                lambda: (
                    (self._above(vehicle, place_m) and self._may_descend(vehicle))
                    or self._is_covered(vehicle, place_m)
                ),
            )
            await self._descend_slowly(vehicle, place_m, self._near_m)

        return maneuver

    def _home_m(self, vehicle: Vehicle) -> Array:
        """(3,) Its pad or the nearest open place, show frame."""
        return np.asarray(self._places.homes_m([vehicle])[0])

    def _near_m(self, vehicle: Vehicle) -> Array:
        """(3,) The nearest open place to where it is, show frame."""
        return self._places.sites_m([vehicle])[vehicle.id]

    async def _fly_above_place(self, vehicle: Vehicle, chosen_m: Callable[[Vehicle], Array]) -> Array:
        """Lead a vehicle above the place that `chosen_m` returns, and above another when that is closed.

        Returns: (3,) that place, show frame.
        """
        least_m, reason = self._places.operation.takeoff_height_m, vehicle.reason
        loop = asyncio.get_running_loop()
        vehicle.set_flags(follows_planned_path=False)
        while True:
            if self._closing() or (vehicle.home_m is not None and self._places.is_covered(vehicle.home_m)):
                await self._steps.until(vehicle, self._may_search)
            closing, place_m = self._closing(), chosen_m(vehicle)
            if self._is_covered(vehicle, place_m):
                vehicle.goal_m = self._newest.position_m(vehicle).copy()
                vehicle.reason = "waits in the air: no place to land is free of obstacles"
                await self._steps.until(vehicle, partial(_has_passed, loop.time() + SEARCH_AGAIN_S))
                continue
            vehicle.reason = reason
            # sideways at its own height, but not lower than the take-off height of all
            vehicle.goal_m = above_place_m(self._newest.position_m(vehicle)[None], place_m[None], least_m)[0]
            ended = partial(self._above_or_closed, vehicle, place_m, closing)
            await self._steps.until(vehicle, ended)
            if self._above(vehicle, place_m) and not self._is_closed(vehicle, place_m):
                return place_m

    def _may_search(self) -> bool:
        """Whether a vehicle may search for its landing place in this tick: only a few fit into it."""
        fleet, before = self._newest.state, self._searched
        count = 0 if before is None or before[0] is not fleet else before[1]
        self._searched = fleet, count + 1
        return count < SEARCHES_A_TICK

    def _above_or_closed(self, vehicle: Vehicle, place_m: Array, closing: frozenset[VehicleId]) -> bool:
        """Whether it is above its place, or that is to be chosen again: not while its position is unknown."""
        changed = self._closing() != closing or self._is_closed(vehicle, place_m)
        return self._above(vehicle, place_m) or (changed and self._is_received(vehicle))

    def _is_closed(self, vehicle: Vehicle, place_m: Array) -> bool:
        """Whether another station's vehicle or an obstacle has come to a place (3,) since it was chosen."""
        return self._places.is_taken(vehicle, place_m) or self._places.is_covered(place_m)

    def _is_covered(self, vehicle: Vehicle, place_m: Array) -> bool:
        """Whether an obstacle or a vehicle that stands closes a place (3,), and another can be chosen now."""
        closed = self._places.is_covered(place_m) or self._places.is_occupied(place_m)
        return closed and self._is_received(vehicle)

    async def _descend_slowly(
        self, vehicle: Vehicle, place_m: Array, chosen_m: Callable[[Vehicle], Array]
    ) -> None:
        """Descend through the safety filter to just above the place, then have the autopilot touch down.

        When an obstacle comes there, it goes on to the place that `chosen_m` returns then.
        """
        while not await self._comes_down(vehicle, place_m):
            vehicle.reason = "an obstacle has come to its landing place: it lands elsewhere"
            log.warning("landing_place_closed", extra={"vehicle": vehicle.id})
            place_m = await self._fly_above_place(vehicle, chosen_m)
        await self._steps.touch_down(vehicle)

    async def _comes_down(self, vehicle: Vehicle, place_m: Array) -> bool:
        """Whether it has come down to just above the place; False: an obstacle has come there first."""
        descent, is_low = self._descent(vehicle, place_m), False

        def ended() -> bool:
            nonlocal is_low
            is_low = descent.advance()
            return is_low or self._is_covered(vehicle, place_m)

        await self._steps.until(vehicle, ended, patience_s=NO_PROGRESS_S + SLOW_S)
        return is_low

    def _above(self, vehicle: Vehicle, place_m: Array) -> bool:
        return bool(is_above(self._newest.position_m(vehicle)[None], place_m[None])[0])

    def _is_received(self, vehicle: Vehicle) -> bool:
        return bool(np.isfinite(self._newest.position_m(vehicle)).all())
