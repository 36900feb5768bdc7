"""The link over MAVSDK: MAVSDK's commands and setpoints, our ports, telemetry and parameters.

MAVSDK's bytes leave only through `SetpointFilter`: MAVSDK repeats setpoints without end, from its own
threads, whatever happens to the program that set them.
"""

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from math import inf
from time import sleep
from typing import Final

import numpy as np

from gcs.links.batch_link import Coroutines, Link
from gcs.links.command_protocol import CLOSED, CommandProtocol
from gcs.links.endpoints import mmsg
from gcs.links.link import Command, ParameterValue, Verb
from gcs.links.mavsdk.binding import COMPONENT_ID, MavsdkInstances, MavsdkVehicle
from gcs.links.mavsdk.setpoint_filter import SetpointFilter
from gcs.links.own_commands import OwnCommandChannel, OwnCommands
from gcs.links.sender import SetpointBatch
from gcs.links.settings import station_id
from gcs.links.stream_requests import NOT_FOR_MAVSDK, REQUESTING_COMPONENT, SETTLE_S
from gcs.mavlink import codec
from gcs.mavlink.codec import AUTOPILOT_COMPONENT
from gcs.mavlink.fences import TRANSFERS
from gcs.mavlink.framing import COMMAND_ACK, GLOBAL_POSITION_INT
from gcs.mavlink.kernels import BEGIN, COMPONENT, END, MESSAGE, Bytes, Whole
from gcs.model.errors import CommandError
from gcs.model.state import Array, Mask, Telemetry, VehicleId

log = logging.getLogger(__name__)

_LOOKS_S: Final = (0.0005, 0.001, 0.002, 0.004, 0.008)
"""MAVSDK's threads write a moment after the call. Pauses between reads of its output until all is there."""

_PAUSES_S: Final = (0.0002, 0.0003, 0.0004)
"""Pauses in which the tick itself waits for them."""

_PATIENCE_S: Final = 0.015
"""Time after the start of a tick from which no link waits any more."""

_DISCOVER_S: Final = 0.25
_HEALTH_SHARES: Final = 5
"""One in this many vehicles is queried for its health at a time."""

_URGENT: Final = 32
"""Setpoints of this many vehicles leave before the others are set."""

_POSITION_PERIOD_S: Final = 0.5
"""Period of the positions that MAVSDK receives; the tick uses all of them."""

_ROOM: Final = 1024
_LONGEST_BYTES: Final = 300
"""Longest frame: 280 bytes."""

_OFFBOARD_TRIES: Final = 3
_OFFBOARD_RETRY_S: Final = 0.1


class FrameFilter:
    """Chooses the frames for MAVSDK, whose threads pay more for each than the link does."""

    def __init__(self, count: int, station_id: int) -> None:
        self._station_id = station_id
        self._hidden: Whole = np.array(sorted(NOT_FOR_MAVSDK.union(TRANSFERS)), np.int64)
        self._position_s = np.full(count, -np.inf)  # arrival of the newest position given to MAVSDK

    def of(self, data: Bytes, frames: Whole, rows: Whole, time_s: Array) -> Mask:
        """(k,) which frames MAVSDK receives; arguments as of `FleetTelemetry.take`."""
        message = frames[:, MESSAGE]
        shown: Mask = (frames[:, COMPONENT] == AUTOPILOT_COMPONENT) & ~np.isin(message, self._hidden)
        positions = np.flatnonzero(shown & (message == GLOBAL_POSITION_INT))
        due = time_s[positions] - self._position_s[rows[positions]] >= _POSITION_PERIOD_S
        shown[positions] = due
        self._position_s[rows[positions[due]]] = time_s[positions[due]]
        acks = np.flatnonzero(shown & (message == COMMAND_ACK))
        if len(acks):  # to requests that MAVSDK did not send as well
            reported = codec.decode(COMMAND_ACK, data, frames[acks])
            shown[acks] = codec.answers(reported, self._station_id, COMPONENT_ID)
        return shown


class Workers:
    """One thread for each vehicle that is commanded, so that silent vehicles delay no other."""

    def __init__(self, vehicle_ids: Iterable[VehicleId]) -> None:
        self._closed = False
        self._workers = {
            vehicle_id: ThreadPoolExecutor(1, thread_name_prefix=f"command/{vehicle_id}")
            for vehicle_id in vehicle_ids
        }

    def channel(
        self, vehicle_id: VehicleId, vehicle: MavsdkVehicle, own: OwnCommandChannel
    ) -> "MavsdkCommandChannel":
        return MavsdkCommandChannel(vehicle, own, self._workers[vehicle_id], lambda: self._closed)

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
    """One vehicle through MAVSDK. A `gcs.links.command_protocol.CommandChannel`.

    Parameters are read and set by our own messages, because their encoding is the autopilot's; so is the mode
    of STANDBY, for which MAVSDK has no call.
    """

    vehicle: MavsdkVehicle
    own: OwnCommandChannel
    worker: ThreadPoolExecutor
    closed: Callable[[], bool]

    async def command(self, command: Command, may_leave: Callable[[], None]) -> None:
        if command.verb is Verb.STANDBY:
            await self.own.command(command, may_leave)
            return
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
        return await self.own.parameter(name)

    async def set_parameter(self, name: str, value: ParameterValue) -> None:
        await self.own.set_parameter(name, value)

    async def _run(self, blocking: Callable[[], None]) -> None:
        """Make a call on the vehicle's worker, after earlier ones. Raises: CommandError."""

        def unless_closed() -> None:
            if self.closed():
                raise CommandError(CLOSED)
            blocking()

        if self.closed():  # then the workers accept no more calls
            raise CommandError(CLOSED)
        await asyncio.get_running_loop().run_in_executor(self.worker, unless_closed)

    def _call(self, command: Command, may_leave: Callable[[], None]) -> None:
        """On the worker: any earlier call has ended here, also that of a cancelled command."""
        may_leave()
        self.vehicle.command(command.verb, command.height_m)


class MavsdkLink(Link):
    """Up to 250 vehicles, 64 for each MAVSDK instance. A `gcs.links.Link`."""

    def _own_id(self) -> int:
        return station_id(self._vehicles.values())

    def _prepare(self) -> None:
        n = len(self.ids)
        self._setpoint_filter = SetpointFilter(
            self.outbox, self._system_ids, self._latch, self._sent, self.counters, self._clock
        )
        self._room = mmsg.Batch(_ROOM, _LONGEST_BYTES)
        self._frame_filter = FrameFilter(n, self._station_id)
        self._inbox.pass_on = self._show
        self._fleet: MavsdkInstances | None = None
        self._workers: Workers | None = None
        self._discovered: Mapping[int, MavsdkVehicle] = {}  # by row
        self._is_discovered = self._commandable = np.zeros(n, np.bool_)
        self._healthy: Mask = np.zeros(n, np.bool_)
        self._needs_health = np.array(
            [each.health_by_mavsdk for each in self._telemetry.autopilots], np.bool_
        )
        self._polls = 0
        self._ticked = asyncio.Event()
        self._connection_count: Whole = np.zeros(n, np.int64)
        self._since_s: Array = np.full(n, inf)  # when MAVSDK discovered it, in its newest connection
        self._begin_commands()

    def _begin_commands(self) -> None:
        send = partial(
            self._send_message, component_id=REQUESTING_COMPONENT
        )  # MAVSDK sees no answers to these
        self._commands = OwnCommands(
            self._system_ids, self._telemetry.autopilots, send, self._station_id, REQUESTING_COMPONENT
        )
        self._inbox.take_acks, self._inbox.take_value = self._commands.take_acks, self._commands.take_value

    @asynccontextmanager
    async def _opened(self) -> AsyncIterator[Coroutines]:
        fleet = MavsdkInstances(tuple(self._system_ids.tolist()), self._station_id)
        protocol, workers = CommandProtocol(self._vehicles, self._latch, self._clock), Workers(self._vehicles)
        async with self._parts_open(fleet, workers):
            self._begin_commands()
            self._fleet, self._protocol, self._workers = fleet, protocol, workers
            try:
                yield {"pass on": self._pass_on_behind_ticks(), "discover": self._discover(fleet)}
            finally:  # from the inside out: setpoints, calls; then MAVSDK ends, and the ports are closed
                self._setpoint_filter.forbid(slice(None))
                self._fleet, self._protocol, self._workers, self._discovered = None, None, None, {}
                self._is_discovered[:], self._healthy[:], self._since_s[:] = False, False, inf
                protocol.close()
                self._commands.close()
                workers.stop()

    def snapshot(self) -> Telemetry:
        """Vehicles not yet discovered by MAVSDK have no position: they take no commands."""
        self._receive_for_tick()
        may_be_ready = self._is_discovered & (self._healthy | ~self._needs_health)
        return self._telemetry.telemetry(may_be_ready=may_be_ready, discovered=self._is_discovered)

    def _expect_setpoints(self, batch: SetpointBatch) -> None:
        self._setpoint_filter.expect(batch)  # discards the previous tick's setpoints

    def _send_setpoints(self, desired: SetpointBatch) -> None:
        began_s = desired.until_s - self._hold_s
        yaw_deg = np.degrees(desired.yaw_rad)[:, None]
        rows, values = desired.rows.tolist(), np.hstack([desired.velocity_ned_m_s, yaw_deg]).tolist()
        for part in (slice(_URGENT), slice(_URGENT, None)):
            for row, each in zip(rows[part], values[part], strict=True):
                if not self._discovered[row].set_velocity(*each):
                    self._setpoint_filter.forbid(np.array([row]))  # MAVSDK will not write this one
            self._await(desired.rows[: part.stop], began_s)
        self._move_bytes()
        if self._setpoint_filter.awaits(desired.rows):
            self._ticked.set()

    def _await(self, rows: Whole, began_s: float) -> None:
        """Send what MAVSDK's threads write for these. The only place where a tick sleeps.

        MAVSDK writes a setpoint from its own thread, which needs the core that the tick holds. Without these
        pauses setpoints would leave after the tick's other work, and the next tick would begin without them.
        """
        for pause_s in _PAUSES_S:
            if not self._setpoint_filter.awaits(rows) or self._clock() > began_s + _PATIENCE_S:
                return
            sleep(pause_s)
            self._pass_on()

    def _command_channel(self, row: int, otherwise: str) -> MavsdkCommandChannel:
        vehicle = self._discovered.get(row)
        if vehicle is None or self._workers is None:
            raise self._never_connected(row, otherwise)
        return self._workers.channel(self.ids[row], vehicle, OwnCommandChannel(row, self._commands))

    def _forget_commands(self, row: int) -> None:
        self._setpoint_filter.forbid(np.array([row]))  # the latch drops what MAVSDK still repeats
        self._commands.fail(lambda other: other == row, "killed meanwhile")

    def _is_awaiting(self) -> bool:
        return (self._protocol is not None and self._protocol.awaited) or bool(self._undiscovered().any())

    def _undiscovered(self) -> Mask:
        """(n,) vehicles that were received, but not discovered by MAVSDK."""
        undiscovered: Mask = np.isfinite(self._addresses.received_s) & ~self._is_discovered
        return undiscovered

    def _watch(self, now_s: float) -> None:
        """MAVSDK sets a rate itself when it discovers a vehicle; ours are requested afterwards."""
        self._polls += 1
        for row in range(self._polls % _HEALTH_SHARES, len(self.ids), _HEALTH_SHARES):
            vehicle = self._discovered.get(row)
            self._healthy[row] = vehicle is not None and vehicle.healthy()
        anew = self._is_discovered & (
            (self._telemetry.connection_count != self._connection_count) | (self._since_s == inf)
        )
        self._since_s[anew] = now_s
        self._connection_count = self._telemetry.connection_count.copy()
        may_be_asked = self._connected(now_s) & (now_s - self._since_s >= SETTLE_S)
        self._streams.watch(may_be_asked, self._telemetry.connection_count, now_s)

    def _move_bytes(self) -> None:
        """Send what MAVSDK has written, then give it the received frames: setpoints do not wait for them."""
        self._pass_on()
        if self._fleet is not None:
            self._fleet.flush()

    def _show(self, data: Bytes, frames: Whole, rows: Whole, time_s: Array) -> None:
        if self._fleet is None:
            return
        shown = self._frame_filter.of(data, frames, rows, time_s)
        for system_id, (begin, end) in zip(
            self._system_ids[rows[shown]].tolist(), frames[shown][:, [BEGIN, END]].tolist(), strict=True
        ):
            self._fleet.receive(system_id, data[begin:end].tobytes())

    def _pass_on(self) -> None:
        if self._fleet is not None:
            while count := self._fleet.take(self._room):
                self._setpoint_filter.take(self._room, count)

    async def _pass_on_behind_ticks(self) -> None:
        while True:
            await self._ticked.wait()
            self._ticked.clear()
            for wait_s in _LOOKS_S:
                await asyncio.sleep(wait_s)
                self._pass_on()
                if not self._setpoint_filter.awaits():
                    break

    async def _discover(self, fleet: MavsdkInstances) -> None:
        rows = {system_id: row for row, system_id in enumerate(self._system_ids.tolist())}
        while True:
            missing = self._system_ids[self._undiscovered()].tolist()
            if missing:
                new = await asyncio.to_thread(fleet.discover, missing)
                if new:
                    self._discovered = {
                        **self._discovered,
                        **{rows[system_id]: each for system_id, each in new.items()},
                    }
                    self._is_discovered[list(self._discovered)] = True
                    log.info(
                        "vehicles_discovered", extra={"link": self.name, "system_ids": tuple(sorted(new))}
                    )
            await asyncio.sleep(_DISCOVER_S)
