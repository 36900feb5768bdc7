"""Maneuvers as tasks of the control group: which vehicle executes which, take off, join, hold.

Those that end on the ground are in `landings`.
"""

import asyncio
import logging
from collections.abc import Callable
from math import inf
from typing import TypeAlias

from gcs.config.sections import OperationSettings
from gcs.flight.maneuvers.landings import Landings
from gcs.flight.maneuvers.maneuver_steps import Maneuver, Steps
from gcs.flight.state.newest import Newest
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.links import Verb
from gcs.model.errors import CommandError, RefusedError
from gcs.model.lifecycle import Event, Phase, ShowPhase
from gcs.service import Outcome

log = logging.getLogger(__name__)

Done: TypeAlias = Callable[[Outcome, str], None]

UP_SHARE, ENDED_SHARE = 0.85, 0.6
"""Share of the commanded height: sufficient in any case; enough once the autopilot has ended its climb."""

EARLY_S = 0.05
"""Two take-offs may be closer than the stagger by this time: their timers are not exact."""

UNREADY_S = 10.0
"""Longest wait for a vehicle to be ready again at its turn to take off; then it stays on the ground."""

_LOOKS_S = 0.2


class Maneuvers:
    """Starts, replaces and ends maneuvers: which vehicle executes which."""

    def __init__(
        self,
        group: asyncio.TaskGroup,
        steps: Steps,
        landings: Landings,
        newest: Newest,
        vehicles: FlightVehicles,
        show: ShowState,
        settings: OperationSettings,
        climb_ended: Callable[[Vehicle], bool],
        once: Callable[[str, Callable[[], bool]], bool],
        others_up: Callable[[], bool],
    ) -> None:
        """Runs maneuvers as tasks of `group`; `once` keeps what is computed once a tick."""
        self._group = group
        self._running: dict[str, tuple[asyncio.Task[None], Done]] = {}
        self._newest, self._vehicles, self._show, self._settings = newest, vehicles, show, settings
        self._climb_ended, self._once, self._others_up = climb_ended, once, others_up
        self._steps, self.landings, self.autopilot_land = steps, landings, steps.autopilot_land
        self._next_turn_s = -inf  # time of the next take-off

    @property
    def waiting(self) -> list[Vehicle]:
        """Vehicles on the ground that are about to take off."""
        on_ground = self._vehicles.in_phase(Phase.STANDBY) if self._show.phase is ShowPhase.ARMING else []
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
        vehicle.set_flags(entering_offboard=False)
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

    def task(self, vehicle: Vehicle) -> object:
        """What the vehicle executes, the same object until it ends or is replaced; None: nothing."""
        running = self._running.get(vehicle.id)
        return None if running is None else running[0]

    def instead(self, vehicle: Vehicle, maneuver: Maneuver) -> None:
        """Start `maneuver` as a part of the command that the vehicle executes, if any: it ends with this."""
        running = self._running.pop(vehicle.id, None)
        if running is None or running[0].done():
            self.start(vehicle, maneuver, lambda _outcome, _reason: None)
            return
        running[0].cancel()
        self.start(vehicle, maneuver, running[1])

    def touches_down(self, vehicle: Vehicle) -> bool:
        """Whether it is being handed over to its autopilot's own LAND, or was."""
        return vehicle.id in self._steps.touching

    def refused(self, vehicle: Vehicle) -> str:
        """Why its autopilot refused the LAND that is being commanded; empty: it did not."""
        return self._steps.touching.get(vehicle.id, "")

    async def land_in_place(self, vehicle: Vehicle, reason: str) -> None:
        """Have the autopilot land it where it is. Until it obeys, the vehicle is led as before."""
        if vehicle.phase is Phase.LANDING:
            vehicle.reason = reason
        else:
            vehicle.apply(Event.DESCEND, reason)
        await self._steps.touch_down(vehicle)

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
        vehicle.set_flags(entering_offboard=False)
        done(outcome, reason)

    # maneuvers

    def take_off(self, delay_s: float, check: Callable[[Vehicle], None]) -> Maneuver:
        """Wait for the vehicle's turn, arm, climb straight up, wait there for the others, join.

        `check` raises RefusedError when the vehicle may no longer fly: its turn may come late.
        """

        async def maneuver(vehicle: Vehicle) -> None:
            await asyncio.sleep(delay_s)
            await self._ready_again(vehicle, check)
            await self._steps.command(vehicle, Verb.STANDBY)
            await self._turn()
            await self._steps.command(vehicle, Verb.ARM)
            if vehicle.phase is not Phase.STANDBY:
                await self._steps.command(vehicle, Verb.DISARM)
                raise RefusedError(f"{vehicle.id} is {vehicle.phase} now: {vehicle.reason}")
            vehicle.apply(Event.TAKE_OFF, "climbs straight up")
            await self._climb(vehicle)
            vehicle.apply(Event.HOLD, "up, waits for the others")
            await self._steps.until(vehicle, self._all_up_everywhere, frozenset({Phase.HOLD}))
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
            await self._steps.command(vehicle, Verb.TAKEOFF, height_m)
            async with asyncio.timeout(timeout_s):
                await self._steps.until(vehicle, lambda: self._is_up(vehicle), frozenset({Phase.TAKEOFF}))
            await self._steps.command(vehicle, Verb.HOLD)
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
        await self._steps.engage(vehicle)
        vehicle.apply(Event.ENGAGE, "flies with the formation")

    async def hold(self, vehicle: Vehicle) -> None:
        """Stop any maneuver; the autopilot holds position."""
        await self._steps.command(vehicle, Verb.HOLD)
        if vehicle.phase is not Phase.HOLD:
            vehicle.apply(Event.HOLD, "holds as commanded")

    async def stay_down(self, vehicle: Vehicle) -> None:
        """Keep a vehicle on the ground that is not to take off any more: disarm it if its motors run."""
        await self._steps.command(vehicle, Verb.DISARM)

    async def rest(self, vehicle: Vehicle) -> None:
        """On the ground: leave the mode of a landing, in which the autopilot does not pass its checks."""
        await self._steps.command(vehicle, Verb.STANDBY)

    async def take_control(self, vehicle: Vehicle) -> None:
        await self._steps.command(vehicle, Verb.HOLD)
        vehicle.apply(Event.TAKE_CONTROL, "under this station's control again, holds")

    def take_control_first(self, then: Maneuver) -> Maneuver:
        """Take control of a vehicle that is airborne outside control, then continue with `then`."""

        async def maneuver(vehicle: Vehicle) -> None:
            if vehicle.phase is Phase.PILOT:
                await self.take_control(vehicle)
            await then(vehicle)

        return maneuver

    # parts of maneuvers

    def _all_up(self) -> bool:
        """Whether no vehicle climbs any more, or waits on the ground for its turn."""
        return self._once("all up", self._all_up_now)

    def _all_up_now(self) -> bool:
        return not any(map(self.running, self._vehicles.in_phase(Phase.STANDBY, Phase.TAKEOFF)))

    @property
    def all_up(self) -> bool:
        """Whether no vehicle of this station climbs, or waits on the ground for its turn."""
        return self._all_up()

    def _all_up_everywhere(self) -> bool:
        return self._all_up() and self._others_up()

    def _is_up(self, vehicle: Vehicle) -> bool:
        """Decide by height, or by the autopilot's end of the climb: the heights may be wrong by metres."""
        if vehicle.home_m is None:
            return False
        height_m = float(vehicle.home_m[2] - self._newest.position_m(vehicle)[2])
        share = height_m / self._settings.takeoff_height_m
        return share > UP_SHARE or (share > ENDED_SHARE and self._climb_ended(vehicle))
