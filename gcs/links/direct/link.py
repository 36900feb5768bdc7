"""The link for large fleets: the whole fleet's frames made and read at once, by ourselves.

Setpoints leave in `send` and nowhere else, so that nothing repeats one: when the tick ends, they end.
"""

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from math import radians
from pathlib import Path
from time import monotonic
from typing import Final

import numpy as np

from gcs.errors import OrderError, UnknownError
from gcs.frames import ShowFrame, wrap_rad
from gcs.links.deadman import before_it_leaves_s
from gcs.links.direct import codec
from gcs.links.direct.addresses import Addresses
from gcs.links.direct.commands import Commands
from gcs.links.direct.hand import DirectHand, kill_message
from gcs.links.direct.heard import FleetHeard
from gcs.links.direct.inbox import Inbox
from gcs.links.direct.kernels import Whole
from gcs.links.direct.messages import SETPOINT, heartbeats, setpoint_messages
from gcs.links.direct.outbox import Outbox
from gcs.links.direct.packets import Packets
from gcs.links.direct.sent import Sent
from gcs.links.direct.streams import Streams
from gcs.links.endpoints import Listen
from gcs.links.facts import LinkFacts
from gcs.links.killlatch import KillLatch
from gcs.links.link import Order, ParameterValue, Verb
from gcs.links.mavlink_frames import COMMAND_LONG, HEARTBEAT
from gcs.links.orders import Orders
from gcs.links.recorder import Recorder
from gcs.links.roster import SILENT_AFTER_S
from gcs.links.traffic import Counters, Observer
from gcs.state import Mask, Setpoints, Telemetry, VehicleId

log = logging.getLogger(__name__)

_BEAT_S: Final = 1.0
_BUSY_S: Final = 0.005
_IDLE_S: Final = 0.05
"""Between two looks at the sockets: while an answer is awaited, and otherwise. Each tick looks too, and then
nobody else need look."""

_WATCH_S: Final = 0.1
"""Between two looks at who has come, or has forgotten what it was asked."""


class DirectLink(LinkFacts):
    """Up to 250 vehicles over UDP, without MAVSDK. A `gcs.links.Link`. Used on the loop's thread only."""

    def __init__(
        self,
        name: str,
        vehicles: Mapping[VehicleId, int],
        listen: Listen,
        frame: ShowFrame,
        *,
        deadman_s: float = 0.2,
        heartbeat_hold_s: float = 3.0,
        rates_hz: Mapping[int, float] | None = None,
        record: Path | None = None,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        """Nothing is opened before `run`. What has to be compiled is compiled here.

        Args:
            name: as the configuration calls it.
            vehicles: system id of each vehicle, 1 to 250, each once.
            listen: UDP ports where the vehicles send to.
            frame: to turn setpoints from the show frame to NED.
            deadman_s: no setpoint leaves later than this after the time of the tick that asked for it.
            heartbeat_hold_s: our heartbeats end when `send` has not been called for this long.
            rates_hz: how often the vehicles are to send which message; they are not asked when not given.
            record: a folder for recordings of every frame.
            clock: the loop's, ``loop.time``.

        Raises: InvalidError for a system id out of range or used twice, and for a deadman's time that leaves
            nothing.
        """
        counters = Counters()
        recorder = None if record is None else Recorder(record, name, counters, clock)
        self._addresses = Addresses(name, tuple(vehicles.values()), counters, clock)
        super().__init__(name, vehicles, self._addresses, counters, recorder)
        self._row = {vehicle_id: row for row, vehicle_id in enumerate(vehicles)}
        self._system_ids: Whole = np.array(list(vehicles.values()), np.int64)
        self._frame = frame
        self._clock = clock
        self._hold_s = before_it_leaves_s(deadman_s)
        self._heartbeat_hold_s = heartbeat_hold_s
        self._packets = Packets(name, listen, clock)
        self._outbox = Outbox(self._packets, self._addresses, self._counters, self._system_ids)
        self._heard = FleetHeard(self._ids)
        self._streams = Streams(self._system_ids, rates_hz or {}, self._tell)
        self._inbox = Inbox(self._addresses, self._heard, self._streams, self._counters)
        self._latch = KillLatch(vehicles.values())
        self._killed: set[int] = set()
        self._sent = Sent(len(self._ids))
        self._listed: tuple[tuple[VehicleId, ...], Whole, Whole] = ((), np.zeros(0, int), np.zeros(0, int))
        self._ticked_s = -np.inf
        self._received_s = -np.inf
        self._open: tuple[Orders, Commands] | None = None
        codec.warm_up()

    def observe(self, observer: Observer) -> Callable[[], None]:
        """Show every frame to `observer` from now on; call the result to stop. See `Observer`."""
        boxes = self._inbox, self._outbox
        for box in boxes:
            box.observers = (*box.observers, observer)

        def stop() -> None:
            for box in boxes:
                box.observers = tuple(other for other in box.observers if other is not observer)

        return stop

    def setpoint_times_s(self, vehicle_id: VehicleId) -> tuple[float, ...]:
        """When the latest setpoints to this vehicle left our socket, oldest first; bounded."""
        return self._sent.times_s(self._row[vehicle_id])

    async def run(self) -> None:
        """Move bytes until cancelled. Raises: LinkError naming the port that cannot be had."""
        self._packets.open()
        orders = Orders(self._vehicles, self._latch, self._clock)
        commands = Commands(self._system_ids, self._tell)
        self._open, self._inbox.commands = (orders, commands), commands
        self._ticked_s = self._clock()  # time to begin
        recorder = self._recorder
        stop_recording = None if recorder is None else self.observe(recorder.record)
        try:
            if recorder is not None:
                recorder.open()
            async with asyncio.TaskGroup() as group:
                group.create_task(self._keep_receiving(commands), name=f"link/{self._name}/receive")
                group.create_task(self._keep_beating(), name=f"link/{self._name}/beat")
        finally:
            self._open, self._inbox.commands = None, None
            orders.close()
            commands.close()
            self._packets.close()
            if recorder is not None and stop_recording is not None:
                stop_recording()
                await asyncio.to_thread(recorder.close)

    def snapshot(self) -> Telemetry:
        """The newest known of every vehicle, with arrival times: what waits in the sockets is read first."""
        self._receive()
        return self._heard.telemetry(may_be_ready=self._open is not None)

    def send(self, setpoints: Setpoints) -> None:
        """Send one tick's orders, now. Never blocks.

        A batch that is older than the deadman's time when it comes is not sent at all. A row that is not
        finite, and one for a vehicle that is not connected or was killed, is left out, as if it were not
        listed.
        """
        now_s = self._clock()
        self._ticked_s = now_s
        if setpoints.ids != self._listed[0]:
            self._listed = self._places(setpoints.ids)
        _, at, rows = self._listed
        if self._open is None or not len(rows):
            return
        velocity_ned_m_s = self._frame.into_ned(setpoints.velocity_m_s[at])
        yaw_rad = wrap_rad(setpoints.yaw_rad[at] + radians(self._frame.heading_deg))
        fit = np.isfinite(velocity_ned_m_s).all(axis=1) & np.isfinite(yaw_rad) & self._connected(now_s)[rows]
        for row in [row for row in self._killed if self._latch.is_shut(int(self._system_ids[row]))]:
            fit &= rows != row
        rows = rows[fit]
        messages = setpoint_messages(
            self._system_ids[rows], velocity_ned_m_s[fit], yaw_rad[fit], time_s=now_s
        )
        frames = self._outbox.encode(SETPOINT, messages, rows)
        if not self._clock() - min(now_s, setpoints.time_s) <= self._hold_s:
            self._counters.setpoints_dropped += len(rows)
            return
        left = rows[self._outbox.send(frames, rows, now_s)]
        self._sent.note(left, self._clock())  # after the call: never earlier than the truth
        self._counters.setpoints_sent += len(left)

    async def execute(self, order: Order) -> None:
        """Order, and return when the vehicle is seen to obey. See `Link.execute`.

        Raises: UnknownError for a vehicle of another link; OrderError.
        """
        orders, commands, row = self._open_for(order.vehicle_id, f"{order.verb} impossible")
        said = self._heard.said(row)
        if order.verb is Verb.KILL:
            self._killed.add(row)
            killing = orders.kill(order, said, lambda: self._send_kill(row))
            self._counters.commands_dropped += commands.fail(lambda other: other == row, "killed meanwhile")
            await killing
            return
        orders, hand = self._hand(order.vehicle_id, f"{order.verb} impossible")
        if order.verb is Verb.OFFBOARD and not self._clock() - self._sent.newest_s[row] <= self._hold_s:
            raise OrderError(f"{order.vehicle_id}: offboard refused: no setpoints are flowing to it")
        await orders.execute(order, hand, said)

    async def read_parameters(
        self, vehicle_id: VehicleId, names: Sequence[str]
    ) -> Mapping[str, ParameterValue]:
        """See `Link.read_parameters`."""
        orders, hand = self._hand(vehicle_id, "its parameters cannot be read")
        return await orders.read_parameters(vehicle_id, names, hand)

    async def set_parameter(self, vehicle_id: VehicleId, name: str, value: ParameterValue) -> None:
        """See `Link.set_parameter`."""
        orders, hand = self._hand(vehicle_id, f"{name} cannot be set")
        await orders.set_parameter(vehicle_id, name, value, hand)

    def _open_for(self, vehicle_id: VehicleId, otherwise: str) -> tuple[Orders, Commands, int]:
        """What there is while the link runs, and the vehicle's row. Raises: UnknownError, OrderError."""
        row = self._row.get(vehicle_id)
        if row is None:
            raise UnknownError(f"{vehicle_id} is not on link {self._name}")
        if self._open is None:
            raise OrderError(f"{vehicle_id}: {otherwise}: link {self._name} is not open")
        return *self._open, row

    def _hand(self, vehicle_id: VehicleId, otherwise: str) -> tuple[Orders, DirectHand]:
        """What moves the vehicle. Raises: OrderError for one that was never heard."""
        orders, commands, row = self._open_for(vehicle_id, otherwise)
        said = self._heard.said(row)
        if not np.isfinite(said.heartbeat_time_s):
            raise OrderError(f"{vehicle_id}: {otherwise}: never heard on link {self._name}")
        return orders, DirectHand(row, commands, said)

    def _places(self, ids: tuple[VehicleId, ...]) -> tuple[tuple[VehicleId, ...], Whole, Whole]:
        """The ids, which of them are ours (k,), and their rows here (k,); a later mention counts."""
        ours = {self._row[name]: at for at, name in enumerate(ids) if name in self._row}
        return ids, np.array(list(ours.values()), np.int64), np.array(list(ours), np.int64)

    def _connected(self, now_s: float) -> Mask:
        connected: Mask = now_s - self._heard.heartbeat_time_s <= SILENT_AFTER_S
        return connected

    def _tell(self, message_id: int, messages: codec.Records, rows: Whole) -> None:
        self._outbox.tell(message_id, messages, rows, self._clock())

    def _send_kill(self, row: int) -> None:
        self._tell(COMMAND_LONG, kill_message(int(self._system_ids[row])), np.array([row]))

    def _receive(self) -> None:
        self._received_s = self._clock()
        self._packets.receive(self._inbox.take)

    async def _keep_receiving(self, commands: Commands) -> None:
        watched_s = -np.inf
        while True:
            busy = commands.awaited or self._heard.awaited
            now_s = self._clock()
            if busy or now_s - self._received_s >= _IDLE_S:
                self._receive()
            if now_s - watched_s >= _WATCH_S:
                watched_s = now_s
                self._watch_streams(now_s)
            await asyncio.sleep(_BUSY_S if busy else _IDLE_S / 2)

    def _watch_streams(self, now_s: float) -> None:
        self._streams.watch(self._connected(now_s), self._heard.lives, self._heard.positions, now_s)

    async def _keep_beating(self) -> None:
        """Our heartbeat, for as long as control lives: autopilots have a failsafe for its end."""
        while True:
            now_s = self._clock()
            rows = self._addresses.everybody()
            if now_s - self._ticked_s <= self._heartbeat_hold_s and len(rows):
                frames = self._outbox.encode(HEARTBEAT, heartbeats(len(rows)), rows)
                self._outbox.send(frames, rows, now_s, to_all=True)
            await asyncio.sleep(_BEAT_S)
