"""Runs maneuvers as tasks of the control group. A vehicle has at most one; a new one replaces it."""

import asyncio
import logging
from collections.abc import Callable, Coroutine
from typing import TypeAlias

from gcs.flight.vehicle import Vehicle
from gcs.model.errors import CommandError, RefusedError
from gcs.service import Outcome

log = logging.getLogger(__name__)

Maneuver: TypeAlias = Callable[[Vehicle], Coroutine[None, None, None]]
Done: TypeAlias = Callable[[Outcome, str], None]


class ManeuverTasks:
    """Starts, replaces and ends maneuvers."""

    def __init__(self, group: asyncio.TaskGroup) -> None:
        """`group` is the control group."""
        self._group = group
        self._running: dict[str, tuple[asyncio.Task[None], Done]] = {}

    def running(self, vehicle: Vehicle) -> bool:
        """Whether the vehicle executes a maneuver."""
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
