"""The steps that maneuvers are made of: wait, command, take control, touch down.

A refused command raises, and so ends the maneuver; the vehicle stays in its phase.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine
from typing import TypeAlias

from gcs.flight.state.newest import Newest
from gcs.flight.state.vehicle import Vehicle
from gcs.links import Command, Verb
from gcs.model.errors import CommandError, RefusedError
from gcs.model.lifecycle import FLOWN, Event, Phase
from gcs.model.state import Mode, VehicleId

log = logging.getLogger(__name__)

Maneuver: TypeAlias = Callable[[Vehicle], Coroutine[None, None, None]]

SETPOINTS_FIRST_S = 0.3
RETRY_S = 1.0
ENGAGE_TRIES = 3
NO_PROGRESS_S = 30.0
"""A return or landing that takes longer than this is logged for the operator."""


class Steps:
    """The steps of one flight's maneuvers."""

    def __init__(
        self,
        newest: Newest,
        ticked: Callable[[], Awaitable[None]],
        execute: Callable[[Command], Awaitable[None]],
    ) -> None:
        self._newest, self.ticked, self._execute = newest, ticked, execute
        self.touching: dict[VehicleId, str] = {}  # being handed over, or landed: why LAND was refused last

    async def until(
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
            await self.ticked()

    async def command(self, vehicle: Vehicle, verb: Verb, height_m: float = 0.0) -> None:
        """Execute a command, while both the old and the new mode count as commanded."""
        obeyed = vehicle.autopilot.modes.get(verb, frozenset())
        vehicle.modes = vehicle.modes | obeyed
        await self._execute(Command(vehicle.id, verb, height_m))
        if obeyed:
            vehicle.modes = obeyed

    async def engage(self, vehicle: Vehicle) -> None:
        """Send setpoints at rest first, then command OFFBOARD: it may be refused without them."""
        vehicle.hold_m = self._newest.position_m(vehicle).copy()
        vehicle.set_flags(entering_offboard=True)
        await asyncio.sleep(SETPOINTS_FIRST_S)
        for left in reversed(range(ENGAGE_TRIES)):
            await self.ticked()  # after a pause of this service setpoints must flow again first
            try:
                await self.command(vehicle, Verb.OFFBOARD)
            except CommandError:
                if left == 0:
                    raise
                await asyncio.sleep(RETRY_S)
            else:
                return

    async def under_control(self, vehicle: Vehicle, event: Event, reason: str) -> bool:
        """Take control in OFFBOARD. If the autopilot refuses it, the last resort is its own LAND.

        Returns: False when the autopilot has landed it instead.
        """
        commanded = vehicle.modes == vehicle.autopilot.modes[Verb.OFFBOARD]
        obeys = commanded and self._newest.mode(vehicle) is Mode.OFFBOARD
        if vehicle.phase is Phase.HOLD or not obeys:
            try:
                await self.engage(vehicle)
            except CommandError as error:
                log.error("offboard_refused", extra={"vehicle": vehicle.id, "reason": str(error)})
                await self.autopilot_land(vehicle)
                return False
        if vehicle.phase is Phase.LANDING and event is Event.DESCEND:
            return True
        vehicle.goal_m = here_m = self._newest.position_m(vehicle).copy()
        vehicle.apply(event, reason)
        vehicle.goal_m = here_m
        return True

    async def autopilot_land(self, vehicle: Vehicle) -> None:
        """Have the autopilot land straight down: from a climb, or as a last resort."""
        if vehicle.phase is not Phase.LANDING:
            vehicle.apply(Event.DESCEND, "its autopilot lands it")
        vehicle.set_flags(handed_over=True)
        await self.touch_down(vehicle)

    async def touch_down(self, vehicle: Vehicle) -> None:
        """Command LAND until the autopilot obeys, then wait until the vehicle stands.

        There is no other way down: so this has no end but that, and the alarm names the vehicle meanwhile.
        """
        self.touching[vehicle.id] = ""
        try:
            await self._hand_over(vehicle)
            while vehicle.phase is Phase.LANDING:
                await self.ticked()
        finally:
            self.touching.pop(vehicle.id, None)
        if vehicle.phase is not Phase.STANDBY:
            raise RefusedError(f"{vehicle.id} is {vehicle.phase} now: {vehicle.reason}")

    async def _hand_over(self, vehicle: Vehicle) -> None:
        while vehicle.phase is Phase.LANDING:
            try:
                await self.command(vehicle, Verb.LAND)
            except CommandError as error:
                self.touching[vehicle.id] = str(error)
                log.warning("land_refused", extra={"vehicle": vehicle.id, "reason": str(error)})
                await asyncio.sleep(RETRY_S)
            else:
                self.touching[vehicle.id] = ""
                vehicle.set_flags(handed_over=True)
                return
