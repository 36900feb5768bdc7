"""The maneuvers of one vehicle, step by step, as tasks of the control group: take off, join, return, land.

A refused command ends the maneuver and leaves the vehicle in its phase.
"""

import asyncio
import logging
from collections.abc import Callable, Coroutine
from functools import partial
from math import inf
from typing import TypeAlias

import numpy as np

from gcs.flight.collective_return import CollectiveReturn
from gcs.flight.descent import SLOW_S, Descent
from gcs.flight.fleet import Fleet
from gcs.flight.landing_places import homes_m, is_covered, is_taken, landing_sites_m
from gcs.flight.vehicle import Vehicle
from gcs.links import Command, Verb
from gcs.model.errors import CommandError, RefusedError
from gcs.model.lifecycle import FLOWN, Event, Phase, ShowPhase
from gcs.model.state import Array, FleetState, Mode, VehicleId
from gcs.planning.return_paths.paths import above_place_m, is_above
from gcs.service import Outcome

log = logging.getLogger(__name__)

Maneuver: TypeAlias = Callable[[Vehicle], Coroutine[None, None, None]]
Done: TypeAlias = Callable[[Outcome, str], None]

UP_SHARE, ENDED_SHARE = 0.85, 0.6
"""Share of the commanded height: sufficient in any case; enough once the autopilot has ended its climb."""

SEARCHES_A_TICK = 2
"""Landing places that are chosen in one tick while some are closed: each takes up to 20 ms."""

EARLY_S = 0.05
"""Two take-offs may be closer than the stagger by this time: their timers are not exact."""

UNREADY_S = 10.0
"""Longest wait for a vehicle to be ready again at its turn to take off; then it stays on the ground."""

_LOOKS_S = 0.2
SETPOINTS_FIRST_S = 0.3
RETRY_S = 1.0
ENGAGE_TRIES = 3
NO_PROGRESS_S = 30.0
"""A return or landing that takes longer than this is logged for the operator."""

WAY_S = 90.0
"""The same limit for returns along planned paths, on which some vehicles wait for others."""

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


class Maneuvers:
    """Starts, replaces and ends maneuvers: which vehicle executes which."""

    def __init__(self, group: asyncio.TaskGroup, flight: Fleet) -> None:
        self._group = group
        self._running: dict[str, tuple[asyncio.Task[None], Done]] = {}
        self._flight = flight
        self._settings = flight.config.operation
        self._next_turn_s = -inf  # time of the next take-off
        self._searched: tuple[FleetState, int] | None = None  # landing places in one tick
        self._up: tuple[FleetState, bool] | None = None  # for one tick: see `_all_up`

    @property
    def waiting(self) -> list[Vehicle]:
        """Vehicles on the ground that are about to take off."""
        on_ground = self._flight.in_phase(Phase.STANDBY) if self._flight.show is ShowPhase.ARMING else []
        return [vehicle for vehicle in on_ground if self.running(vehicle)]

    @property
    def any_running(self) -> bool:
        return any(not task.done() for task, _ in self._running.values())

    def running(self, vehicle: Vehicle) -> bool:
        running = self._running.get(vehicle.id)
        return running is not None and not running[0].done()

    def stop(self, vehicle: Vehicle, reason: str) -> None:
        """End the vehicle's maneuver, if any; its outcome is FAILED with that reason."""
        running = self._running.pop(vehicle.id, None)
        vehicle.entering_offboard = False
        if running is not None and not running[0].done():
            task, done = running
            task.cancel()
            done(Outcome.FAILED, reason)  # here: a task cancelled before its first step reports nothing

    def start(self, vehicle: Vehicle, maneuver: Maneuver, done: Done) -> None:
        """Start `maneuver` in place of any other; `done` is called once with the outcome."""
        self.stop(vehicle, "replaced by another command")
        task = self._group.create_task(self._run(vehicle, maneuver, done), name=f"maneuver/{vehicle.id}")
        self._running[vehicle.id] = task, done
        task.add_done_callback(lambda ended: self._forget(vehicle, ended))

    def _forget(self, vehicle: Vehicle, ended: asyncio.Task[None]) -> None:
        running = self._running.get(vehicle.id)
        if running is not None and running[0] is ended:
            del self._running[vehicle.id]

    async def _run(self, vehicle: Vehicle, maneuver: Maneuver, done: Done) -> None:
        outcome, reason = Outcome.DONE, ""
        try:
            await maneuver(vehicle)
        except (CommandError, RefusedError) as error:
            outcome, reason = Outcome.FAILED, str(error)
            log.warning("command_failed", extra={"vehicle": vehicle.id, "reason": reason})
        # Not reached when `stop` cancels: it has done both, and the vehicle may execute its next maneuver.
        vehicle.entering_offboard = False
        done(outcome, reason)

    # maneuvers

    def take_off(self, delay_s: float, check: Callable[[Vehicle], None]) -> Maneuver:
        """Wait for the vehicle's turn, arm, climb straight up, wait there for the others, join.

        `check` raises RefusedError when the vehicle may no longer fly: its turn may come late.
        """

        async def maneuver(vehicle: Vehicle) -> None:
            await asyncio.sleep(delay_s)
            await self._ready_again(vehicle, check)
            await self._command(vehicle, Verb.STANDBY)
            await self._turn()
            await self._command(vehicle, Verb.ARM)
            if vehicle.phase is not Phase.STANDBY:
                await self._command(vehicle, Verb.DISARM)
                raise RefusedError(f"{vehicle.id} is {vehicle.phase} now: {vehicle.reason}")
            vehicle.apply(Event.TAKE_OFF, "climbs straight up")
            await self._climb(vehicle)
            vehicle.apply(Event.HOLD, "up, waits for the others")
            await self._until(vehicle, self._all_up_everywhere, frozenset({Phase.HOLD}))
            try:
                await self.join(vehicle)
            except CommandError as error:
                vehicle.reason = f"up, but cannot join: {error}"
                raise

        return maneuver

    async def _ready_again(self, vehicle: Vehicle, check: Callable[[Vehicle], None]) -> None:
        """Wait for the check to pass, as it did at the start: a link or an estimator may need seconds.

        Raises: RefusedError, of the check.
        """
        loop = asyncio.get_running_loop()
        until_s = loop.time() + UNREADY_S
        while True:
            try:
                check(vehicle)
            except RefusedError:
                if loop.time() >= until_s or vehicle.phase is not Phase.STANDBY:
                    raise
            else:
                return
            await asyncio.sleep(_LOOKS_S)

    async def _turn(self) -> None:
        """Wait for the stagger after the last take-off: after a stall many are due at once."""
        loop = asyncio.get_running_loop()
        turn_s = self._next_turn_s
        self._next_turn_s = max(turn_s, loop.time()) + self._settings.takeoff_stagger_s - EARLY_S
        if (wait_s := turn_s - loop.time()) > EARLY_S:
            await asyncio.sleep(wait_s)

    async def _climb(self, vehicle: Vehicle) -> None:
        """Climb straight up to HOLD; on failure land the vehicle. Raises: CommandError with the reason."""
        height_m, timeout_s = self._settings.takeoff_height_m, self._settings.takeoff_timeout_s
        try:
            await self._command(vehicle, Verb.TAKEOFF, height_m)
            async with asyncio.timeout(timeout_s):
                await self._until(vehicle, lambda: self._is_up(vehicle), frozenset({Phase.TAKEOFF}))
            await self._command(vehicle, Verb.HOLD)
        except TimeoutError:
            reason = f"{vehicle.id} did not reach {height_m:g} m within {timeout_s:g} s"
        except CommandError as error:
            reason = str(error)
        else:
            return
        log.warning("takeoff_failed", extra={"vehicle": vehicle.id, "reason": reason})
        if vehicle.phase is Phase.TAKEOFF:
            vehicle.apply(Event.DESCEND, f"its take-off failed, its autopilot lands it: {reason}")
            await self.autopilot_land(vehicle)
        raise CommandError(reason)

    async def join(self, vehicle: Vehicle) -> None:
        """Enter the formation from HOLD under the service's control, at first in place."""
        if vehicle.phase is Phase.TAKEOFF:
            raise RefusedError(f"{vehicle.id} still climbs")
        await self._engage(vehicle)
        vehicle.apply(Event.ENGAGE, "flies with the formation")

    async def come_home(self, vehicle: Vehicle) -> None:
        home_m = vehicle.home_m
        if vehicle.comes_down_alone or home_m is None:
            await self.autopilot_land(vehicle)
            return
        if not await self._under_control(vehicle, Event.COME_HOME, "on its way home"):
            return
        place_m = await self._fly_above_place(vehicle, self._home_m)
        vehicle.apply(Event.DESCEND, comes_down(place_m, home_m))
        await self._descend_slowly(vehicle, place_m, self._home_m)

    def _home_m(self, vehicle: Vehicle) -> Array:
        """(3,) Its pad or the nearest open place, show frame."""
        return np.asarray(homes_m(self._flight, [vehicle])[0])

    def _near_m(self, vehicle: Vehicle) -> Array:
        """(3,) The nearest open place to where it is, show frame."""
        return landing_sites_m(self._flight, [vehicle])[vehicle.id]

    async def _fly_above_place(self, vehicle: Vehicle, chosen_m: Callable[[Vehicle], Array]) -> Array:
        """Lead a vehicle above the place that `chosen_m` returns, and above another when that is closed.

        Returns: (3,) that place, show frame.
        """
        flight, least_m = self._flight, self._settings.takeoff_height_m
        loop = asyncio.get_running_loop()
        vehicle.follows_planned_path = False
        while True:
            if flight.closing() or (vehicle.home_m is not None and is_covered(flight, vehicle.home_m)):
                await self._until(vehicle, self._may_search)
            closing, place_m = flight.closing(), chosen_m(vehicle)
            if self._is_covered(vehicle, place_m):
                vehicle.goal_m = flight.position_m(vehicle).copy()
                vehicle.reason = "waits in the air: no place to land is free of obstacles"
                await self._until(vehicle, partial(_has_passed, loop.time() + SEARCH_AGAIN_S))
                continue
            # sideways at its own height, but not lower than the take-off height of all
            vehicle.goal_m = above_place_m(flight.position_m(vehicle)[None], place_m[None], least_m)[0]
            ended = partial(self._above_or_closed, vehicle, place_m, closing)
            await self._until(vehicle, ended)
            if self._above(vehicle, place_m) and not self._is_closed(vehicle, place_m):
                return place_m

    def _may_search(self) -> bool:
        """Whether a vehicle may search for its landing place in this tick: only a few fit into it."""
        fleet, before = self._flight.fleet, self._searched
        count = 0 if before is None or before[0] is not fleet else before[1]
        self._searched = fleet, count + 1
        return count < SEARCHES_A_TICK

    def _above_or_closed(self, vehicle: Vehicle, place_m: Array, closing: frozenset[VehicleId]) -> bool:
        """Whether it is above its place, or that is to be chosen again: not while its position is unknown."""
        changed = self._flight.closing() != closing or self._is_closed(vehicle, place_m)
        return self._above(vehicle, place_m) or (changed and self._is_received(vehicle))

    def _is_closed(self, vehicle: Vehicle, place_m: Array) -> bool:
        """Whether another station's vehicle or an obstacle has come to a place (3,) since it was chosen."""
        return is_taken(self._flight, vehicle, place_m) or is_covered(self._flight, place_m)

    def _is_covered(self, vehicle: Vehicle, place_m: Array) -> bool:
        """Whether an obstacle closes a place (3,), and another can be chosen now."""
        return is_covered(self._flight, place_m) and self._is_received(vehicle)

    def _is_received(self, vehicle: Vehicle) -> bool:
        return bool(np.isfinite(self._flight.position_m(vehicle)).all())

    def come_home_together(self, collective_return: CollectiveReturn, stops_m: Array) -> Maneuver:
        """Stop at `stops_m` (3,), follow the path of the collective return, and land."""

        async def maneuver(vehicle: Vehicle) -> None:
            home_m = vehicle.home_m
            if vehicle.comes_down_alone or home_m is None:
                await self.autopilot_land(vehicle)
                return
            if not await self._under_control(vehicle, Event.COME_HOME, "stops, before all come home"):
                return
            vehicle.goal_m = stops_m
            collective_return.stopping(vehicle)
            await self._until(
                vehicle, lambda: collective_return.is_planned or not collective_return.takes_part(vehicle)
            )
            if collective_return.takes_part(vehicle):
                vehicle.reason = "on its way home"
                await self._until(vehicle, lambda: self._led(vehicle, collective_return), patience_s=WAY_S)
            if not collective_return.takes_part(vehicle):
                await self.come_home(vehicle)
                return
            place_m = collective_return.place_m(vehicle)
            vehicle.apply(Event.DESCEND, comes_down(place_m, home_m))
            await self._descend_slowly(vehicle, place_m, self._home_m)

        return maneuver

    def _led(self, vehicle: Vehicle, collective_return: CollectiveReturn) -> bool:
        """Move the goal along the path. Returns: whether it is above its place, or has left the plan."""
        if not collective_return.takes_part(vehicle):
            return self._is_received(vehicle)
        vehicle.goal_m = collective_return.goal_m(vehicle)
        vehicle.follows_planned_path = collective_return.follows_path(vehicle)
        return collective_return.has_arrived(vehicle)

    def descend(self, place_m: Array) -> Maneuver:
        """Descend onto `place_m` (3,), lowest vehicle first, and land."""

        async def maneuver(vehicle: Vehicle) -> None:
            if vehicle.comes_down_alone:
                await self.autopilot_land(vehicle)
                return
            if not await self._under_control(vehicle, Event.DESCEND, "comes down"):
                return
            vehicle.goal_m = np.array([place_m[0], place_m[1], self._flight.position_m(vehicle)[2]])
            await self._flight.ticked()  # until then all vehicles commanded together have begun, and count
            await self._until(
                vehicle,
                lambda: (
                    (self._above(vehicle, place_m) and self._flight.may_descend(vehicle))
                    or self._is_covered(vehicle, place_m)
                ),
            )
            await self._descend_slowly(vehicle, place_m, self._near_m)

        return maneuver

    async def hold(self, vehicle: Vehicle) -> None:
        """Stop any maneuver; the autopilot holds position."""
        await self._command(vehicle, Verb.HOLD)
        if vehicle.phase is not Phase.HOLD:
            vehicle.apply(Event.HOLD, "holds as commanded")

    async def stay_down(self, vehicle: Vehicle) -> None:
        """Keep a vehicle on the ground that is not to take off any more: disarm it if its motors run."""
        await self._command(vehicle, Verb.DISARM)

    async def rest(self, vehicle: Vehicle) -> None:
        """On the ground: leave the mode of a landing, in which the autopilot does not pass its checks."""
        await self._command(vehicle, Verb.STANDBY)

    async def take_control(self, vehicle: Vehicle) -> None:
        await self._command(vehicle, Verb.HOLD)
        vehicle.apply(Event.TAKE_CONTROL, "under this station's control again, holds")

    def take_control_first(self, then: Maneuver) -> Maneuver:
        """Take control of a vehicle that is airborne outside control, then continue with `then`."""

        async def maneuver(vehicle: Vehicle) -> None:
            if vehicle.phase is Phase.PILOT:
                await self.take_control(vehicle)
            await then(vehicle)

        return maneuver

    async def autopilot_land(self, vehicle: Vehicle) -> None:
        """Have the autopilot land straight down: from a climb, or as a last resort."""
        if vehicle.phase is not Phase.LANDING:
            vehicle.apply(Event.DESCEND, "its autopilot lands it")
        vehicle.handed_over = True
        await self._touch_down(vehicle)

    # parts of maneuvers

    def _all_up(self) -> bool:
        """Whether no vehicle climbs any more, or waits on the ground for its turn."""
        fleet = self._flight.fleet
        if self._up is None or self._up[0] is not fleet:  # every waiting vehicle asks in every tick
            below = self._flight.in_phase(Phase.STANDBY, Phase.TAKEOFF)
            self._up = fleet, not any(map(self.running, below))
        return self._up[1]

    @property
    def all_up(self) -> bool:
        """Whether no vehicle of this station climbs, or waits on the ground for its turn."""
        return self._all_up()

    def _all_up_everywhere(self) -> bool:
        site = self._flight.site
        return self._all_up() and (site is None or site.all_up)

    def _is_up(self, vehicle: Vehicle) -> bool:
        """Decide by height, or by the autopilot's end of the climb: the heights may be wrong by metres."""
        if vehicle.home_m is None:
            return False
        height_m = float(vehicle.home_m[2] - self._flight.position_m(vehicle)[2])
        share = height_m / self._settings.takeoff_height_m
        return share > UP_SHARE or (share > ENDED_SHARE and self._flight.climb_ended(vehicle))

    def _above(self, vehicle: Vehicle, place_m: Array) -> bool:
        return bool(is_above(self._flight.position_m(vehicle)[None], place_m[None])[0])

    async def _until(
        self,
        vehicle: Vehicle,
        reached: Callable[[], bool],
        phases: frozenset[Phase] = FLOWN,
        *,
        patience_s: float = NO_PROGRESS_S,
    ) -> None:
        """Wait while the vehicle is in one of `phases`. Raises: RefusedError when it leaves them."""
        loop = asyncio.get_running_loop()
        since_s = loop.time()
        while not reached():
            if vehicle.phase not in phases:
                raise RefusedError(f"{vehicle.id} is {vehicle.phase} now: {vehicle.reason}")
            if phases is FLOWN and loop.time() - since_s > patience_s:
                vehicle.reason = f"{vehicle.phase} for more than {patience_s:g} s: something is in its way"
                log.warning("no_progress", extra={"vehicle": vehicle.id, "phase": vehicle.phase.value})
                since_s = loop.time()
            await self._flight.ticked()

    async def _engage(self, vehicle: Vehicle) -> None:
        """Send setpoints at rest first, then command OFFBOARD: it may be refused without them."""
        vehicle.hold_m = self._flight.position_m(vehicle).copy()
        vehicle.entering_offboard = True
        await asyncio.sleep(SETPOINTS_FIRST_S)
        for left in reversed(range(ENGAGE_TRIES)):
            await self._flight.ticked()  # after a pause of this service setpoints must flow again first
            try:
                await self._command(vehicle, Verb.OFFBOARD)
            except CommandError:
                if left == 0:
                    raise
                await asyncio.sleep(RETRY_S)
            else:
                return

    async def _under_control(self, vehicle: Vehicle, event: Event, reason: str) -> bool:
        """Take control in OFFBOARD. If the autopilot refuses it, the last resort is its own LAND.

        Returns: False when the autopilot has landed it instead.
        """
        commanded = vehicle.modes == vehicle.autopilot.modes[Verb.OFFBOARD]
        obeys = commanded and self._flight.mode(vehicle) is Mode.OFFBOARD
        if vehicle.phase is Phase.HOLD or not obeys:
            try:
                await self._engage(vehicle)
            except CommandError as error:
                log.error("offboard_refused", extra={"vehicle": vehicle.id, "reason": str(error)})
                await self.autopilot_land(vehicle)
                return False
        if vehicle.phase is Phase.LANDING and event is Event.DESCEND:
            return True
        vehicle.goal_m = here_m = self._flight.position_m(vehicle).copy()
        vehicle.apply(event, reason)
        vehicle.goal_m = here_m
        return True

    async def _descend_slowly(
        self, vehicle: Vehicle, place_m: Array, chosen_m: Callable[[Vehicle], Array]
    ) -> None:
        """Descend through the safety filter to just above the place, then have the autopilot touch down.

        When an obstacle comes there, it goes on to the place that `chosen_m` returns then.
        """
        while not await self._comes_down(vehicle, place_m):
            log.warning("landing_place_closed", extra={"vehicle": vehicle.id})
            place_m = await self._fly_above_place(vehicle, chosen_m)
        await self._touch_down(vehicle)

    async def _comes_down(self, vehicle: Vehicle, place_m: Array) -> bool:
        """Whether it has come down to just above the place; False: an obstacle has come there first."""
        descent, is_low = Descent(self._flight, vehicle, place_m), False

        def ended() -> bool:
            nonlocal is_low
            is_low = descent.advance()
            return is_low or self._is_covered(vehicle, place_m)

        await self._until(vehicle, ended, patience_s=NO_PROGRESS_S + SLOW_S)
        return is_low

    async def _touch_down(self, vehicle: Vehicle) -> None:
        while vehicle.phase is Phase.LANDING:
            try:
                await self._command(vehicle, Verb.LAND)
            except CommandError as error:
                log.warning("land_refused", extra={"vehicle": vehicle.id, "reason": str(error)})
                await asyncio.sleep(RETRY_S)
                continue
            vehicle.handed_over = True
            break
        while vehicle.phase is Phase.LANDING:
            await self._flight.ticked()
        if vehicle.phase is not Phase.STANDBY:
            raise RefusedError(f"{vehicle.id} is {vehicle.phase} now: {vehicle.reason}")

    async def _command(self, vehicle: Vehicle, verb: Verb, height_m: float = 0.0) -> None:
        """Execute a command, while both the old and the new mode count as commanded."""
        obeyed = vehicle.autopilot.modes.get(verb, frozenset())
        vehicle.modes = vehicle.modes | obeyed
        await self._flight.execute(Command(vehicle.id, verb, height_m))
        if obeyed:
            vehicle.modes = obeyed
