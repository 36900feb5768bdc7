"""MAVSDK's blocking calls, off the loop: one worker per vehicle."""

import asyncio
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Final, TypeVar

from gcs.links.command_protocol import CLOSED
from gcs.links.link import Command, ParameterValue, Verb
from gcs.links.mavsdk.binding import MavsdkVehicle
from gcs.model.errors import CommandError
from gcs.model.state import VehicleId

T = TypeVar("T")

_OFFBOARD_TRIES: Final = 3
_OFFBOARD_RETRY_S: Final = 0.1


class Workers:
    """One thread for each vehicle that is commanded, so that silent vehicles delay no other."""

    def __init__(self, vehicle_ids: Iterable[VehicleId]) -> None:
        self._closed = False
        self._workers = {
            vehicle_id: ThreadPoolExecutor(1, thread_name_prefix=f"command/{vehicle_id}")
            for vehicle_id in vehicle_ids
        }

    def channel(self, vehicle_id: VehicleId, vehicle: MavsdkVehicle) -> "MavsdkCommandChannel":
        return MavsdkCommandChannel(vehicle, self._workers[vehicle_id], lambda: self._closed)

    def open(self) -> None:
        """Threads start with the first call."""

    def stop(self) -> None:
        """Start no further call. On the loop's thread, before `close`."""
        self._closed = True

    def close(self) -> None:
        """Wait for the calls under way, 5 s at most. Blocks."""
        for worker in self._workers.values():
            worker.shutdown(wait=True)


@dataclass(eq=False)
class MavsdkCommandChannel:
    """One vehicle through MAVSDK. A `gcs.links.command_protocol.CommandChannel`."""

    vehicle: MavsdkVehicle
    worker: ThreadPoolExecutor
    closed: Callable[[], bool]

    async def command(self, command: Command, may_leave: Callable[[], None]) -> None:
        tries = _OFFBOARD_TRIES if command.verb is Verb.OFFBOARD else 1
        for left in reversed(range(tries)):
            try:
                await self._run(partial(self._call, command, may_leave))
            except CommandError as error:
                # Outside OFFBOARD, MAVSDK forgets a setpoint after 3 s, until the next tick sets it again.
                if not left or str(error) != "NO_SETPOINT_SET":
                    raise
                await asyncio.sleep(_OFFBOARD_RETRY_S)
            else:
                return

    async def parameter(self, name: str) -> ParameterValue:
        return await self._run(partial(self.vehicle.parameter, name))

    async def set_parameter(self, name: str, value: ParameterValue) -> None:
        await self._run(partial(self.vehicle.set_parameter, name, value))

    async def _run(self, blocking: Callable[[], T]) -> T:
        """The result of a call on the vehicle's worker, after earlier ones. Raises: CommandError."""

        def unless_closed() -> T:
            if self.closed():
                raise CommandError(CLOSED)
            return blocking()

        if self.closed():  # then the workers accept no more calls
            raise CommandError(CLOSED)
        return await asyncio.get_running_loop().run_in_executor(self.worker, unless_closed)

    def _call(self, command: Command, may_leave: Callable[[], None]) -> None:
        """On the worker: any earlier call has ended here, even one whose command was cancelled."""
        may_leave()
        self.vehicle.command(command.verb, command.height_m)
