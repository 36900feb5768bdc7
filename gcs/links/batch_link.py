"""Common part of both transports: a fleet's frames moved in batches.

Received frames are addressed and read here for all vehicles at once; so are our heartbeats, and the requests
for streams. Signing and forwarding are filters that only links with them pay for.
"""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Callable, Collection, Coroutine, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from functools import partial
from math import radians
from pathlib import Path
from threading import Lock
from time import monotonic
from types import MappingProxyType
from typing import Any, Final, Protocol

import numpy as np

from gcs.links import receiver, sender
from gcs.links.address_book import Addresses
from gcs.links.autopilots import Autopilot
from gcs.links.command_protocol import CommandChannel, CommandProtocol, KillLatch
from gcs.links.endpoints.ports import Ports
from gcs.links.endpoints.streams import LinkPorts
from gcs.links.fence_transfer import FenceTransfers, StoredFence
from gcs.links.forwarding import Forwarding
from gcs.links.link import Absent, Address, Command, Counters, Observer, ParameterValue, Verb
from gcs.links.listening import FrameListener
from gcs.links.receiver import Inbox, ParameterUpdates
from gcs.links.round_trips import RoundTrips
from gcs.links.send_budget import Budget
from gcs.links.sender import Outbox, SentSetpoints, SetpointBatch, before_it_leaves_s, most_urgent_first
from gcs.links.settings import EXTRA_BYTES_PER_S, Forward, Place, check_system_ids
from gcs.links.signing import SignatureFilter, Signing
from gcs.links.stream_requests import REQUESTING_COMPONENT, StreamRequests
from gcs.links.telemetry import FleetTelemetry, VehicleReport
from gcs.links.tlog import Recorder
from gcs.links.version_requests import VersionRequests
from gcs.mavlink import codec, reports
from gcs.mavlink.fences import FenceVertex
from gcs.mavlink.framing import COMMAND_LONG, HEARTBEAT, SET_POSITION_TARGET_LOCAL_NED
from gcs.mavlink.kernels import Whole
from gcs.mavlink.reports import SILENT_AFTER_S
from gcs.mavlink.setpoints import VELOCITY, setpoint_messages
from gcs.model.errors import CommandError, UnknownError
from gcs.model.frames import ShowFrame
from gcs.model.state import Array, Landed, Mask, Setpoints, Telemetry, VehicleId

_BEAT_S: Final = 1.0
_BUSY_S: Final = 0.005
_IDLE_S: Final = 0.05
"""Periods of reading the sockets: while an answer is awaited, and otherwise. Each tick also reads, which then
suffices.
"""

_AHEAD_S: Final = 0.004
"""Time before a tick is due at which the sockets are read, so that the tick itself finds little to read."""

_WATCH_S: Final = 0.1
"""Period of looking for vehicles that connected, or that have forgotten their streams."""

_TICKS_ENDED_S: Final = 0.5
"""Without a tick for this long control has ended or hangs, although this link still runs."""

_FLEW_WITHIN_S: Final = 3.0
"""Age of the last setpoint after which no autopilot flies on with it."""

_NONE_READY: Final = np.zeros(0)

Coroutines = Mapping[str, Coroutine[Any, Any, None]]
"""By name, a transport's additional tasks while the link runs."""


class Part(Protocol):
    """What a link opens and closes, and what blocks when it does."""

    def open(self) -> None:
        """Raises: LinkError."""

    def close(self) -> None:
        """May be called without `open`."""


class LinkParts:
    """The parts of one run. A thread cannot be cancelled, so `close` waits for `open`, or prevents it."""

    def __init__(self, parts: Sequence[Part]) -> None:
        self._parts, self._lock, self._closed = parts, Lock(), False

    def open(self) -> None:
        """Open them in their order. Raises: LinkError."""
        with self._lock:
            for part in () if self._closed else self._parts:
                part.open()

    def close(self) -> None:
        with self._lock:
            self._closed = True
            for part in reversed(self._parts):
                part.close()


class Link(ABC):
    """Up to 250 vehicles behind one transport. Used on the loop's thread only.

    Attributes:
        ids: the vehicles configured on this link, whether connected or not; never changes.
        outbox: sends what features have, within `budget`, after the setpoints, while vehicles are `reached`.
        fences: transfers of fences to and from the vehicles.
    """

    def __init__(
        self,
        name: str,
        vehicles: Mapping[VehicleId, int],
        places: Place | Sequence[Place],
        frame: ShowFrame,
        *,
        autopilots: Sequence[Autopilot] | None = None,
        setpoint_timeout_s: float = 0.2,
        heartbeat_hold_s: float = 3.0,
        rates_hz: Mapping[int, float] | None = None,
        record: Path | None = None,
        signing: Signing | None = None,
        forward: Sequence[Forward] = (),
        extra_bytes_per_s: float = EXTRA_BYTES_PER_S,
        clock: Callable[[], float] = monotonic,
        ports: Ports | None = None,
    ) -> None:
        """Nothing is opened before `run`. Kernels are compiled here.

        Args:
            name: the name in the configuration.
            vehicles: system id of each vehicle, 1 to 250, each once.
            places: where the vehicles are.
            frame: to turn setpoints from the show frame to NED.
            autopilots: of each vehicle; None: the default of all.
            setpoint_timeout_s: no setpoint leaves later than this after the time of its tick.
            heartbeat_hold_s: our heartbeats end when `send` has not been called for this long.
            rates_hz: rate to request for each message; without it no rates are requested.
            record: a folder for recordings of every frame.
            signing: signs sent frames, refuses unsigned ones. Of this link alone.
            forward: further ground stations.
            extra_bytes_per_s: what features may send together.
            clock: the loop's, ``loop.time``.
            ports: used instead of ports at `places`, such as datagrams in memory.

        Raises:
            InvalidError: a system id is out of range or used twice, or `setpoint_timeout_s` leaves no time
            to send.
        """
        check_system_ids(vehicles)
        system_ids = tuple(vehicles.values())
        self.name = name
        self._vehicles = MappingProxyType(dict(vehicles))
        self.ids = tuple(vehicles)
        self._station_id = self._own_id()
        self._row = {vehicle_id: row for row, vehicle_id in enumerate(vehicles)}
        self._system_ids: Whole = np.array(system_ids, np.int64)
        self._frame, self._clock = frame, clock
        self._hold_s = before_it_leaves_s(setpoint_timeout_s)
        self._heartbeat_hold_s = heartbeat_hold_s
        self.counters = Counters()
        self._recorder = None if record is None else Recorder(record, name, clock)
        self._signing = signing
        self._ports = LinkPorts(name, places, clock) if ports is None else ports
        address = self._ports.address
        self._addresses = Addresses(name, system_ids, address, self.counters, clock)
        signatures = (
            None if signing is None else SignatureFilter(name, signing, system_ids, address, self.counters)
        )
        self.outbox = Outbox(
            self._ports, self._addresses, self.counters, self._system_ids, self._station_id, signatures
        )
        self.budget = Budget(extra_bytes_per_s)
        self._telemetry = FleetTelemetry(self.ids, autopilots)
        profiles = self._telemetry.autopilots
        self._climbs_alone: Mask = np.array([each.takeoff_ends_with_setpoints for each in profiles], np.bool_)
        self._flies_on: Mask = np.array([each.stops_on_setpoint_only for each in profiles], np.bool_)
        self._stopped_s = -np.inf  # when setpoints at rest were sent last, see `_stop_those_that_fly_on`
        request = partial(self._send_message, component_id=REQUESTING_COMPONENT)
        self._streams = StreamRequests(
            self._system_ids,
            [each.streams_hz(rates_hz) if rates_hz else {} for each in profiles],
            request,
            self._station_id,
        )
        self._versions, self._round_trips = (
            VersionRequests(self._system_ids, request),
            RoundTrips(self._telemetry, self.outbox.broadcast),
        )
        self._parameters = ParameterUpdates(self.ids)
        self._inbox = Inbox(
            self._addresses, self._telemetry, self._streams, self.counters, self._parameters, signatures
        )
        self._latch = KillLatch(system_ids)
        self.fences = FenceTransfers(
            self._system_ids, request, self.budget, clock, self._station_id, REQUESTING_COMPONENT
        )
        self._watches_fences = False
        self._forwarding = Forwarding(
            forward,
            self.counters,
            rows={system_id: row for row, system_id in enumerate(system_ids)},
            station_id=self._station_id,
            latch=self._latch,
            outbox=self.outbox,
            signatures=signatures,
            clock=clock,
        )
        if forward:
            self._inbox.observers = (self._forwarding.offer,)
        # vehicles that the transport can send commands to, connected or not
        self._commandable: Mask = np.ones(len(self.ids), np.bool_)
        self._killed: set[int] = set()
        self._sent = SentSetpoints(len(self.ids))
        # ids of the newest batch, the indices of this link's vehicles in it (k,), their rows here (k,)
        self._listed: tuple[tuple[VehicleId, ...], Whole, Whole] = ((), np.zeros(0, int), np.zeros(0, int))
        self._ready: tuple[SetpointBatch, Array] | None = None  # what was prepared and has not left
        self._ticked_s = self._received_s = -np.inf
        self._snapshot_s = self._snapshot_before_s = -np.inf  # of the newest snapshots
        self._protocol: CommandProtocol | None = None  # while the link is open
        codec.warm_up()
        reports.warm_up()
        sender.warm_up()
        receiver.warm_up()
        self._prepare()

    # what transports do differently

    @abstractmethod
    def _own_id(self) -> int:
        """Our own system id."""

    @abstractmethod
    def _prepare(self) -> None:
        """Create what the transport needs; last in construction."""

    @abstractmethod
    def _opened(self) -> AbstractAsyncContextManager[Coroutines]:
        """Open what the transport needs, `_protocol` last; close it again, `_protocol` first."""

    @asynccontextmanager
    async def _parts_open(self, *parts: Part) -> AsyncIterator[None]:
        """Open signing first, so that nothing leaves unsigned; end it last, after recording."""
        given = [part for part in (self._signing, self._recorder, *parts) if part is not None]
        if not given:
            yield
            return
        opened = LinkParts(given)
        try:
            await asyncio.to_thread(opened.open)
            yield
        finally:
            await asyncio.to_thread(opened.close)

    @abstractmethod
    def _expect_setpoints(self, batch: SetpointBatch) -> None:
        """Begin to send these, and none of earlier ticks any more; not called while the link is not open."""

    @abstractmethod
    def _send_setpoints(self, desired: SetpointBatch) -> None:
        """Send these of the expected setpoints, the next in their order."""

    @abstractmethod
    def _command_channel(self, row: int, otherwise: str) -> CommandChannel:
        """The command channel of a vehicle. Raises: CommandError for one without frames so far."""

    @abstractmethod
    def _forget_commands(self, row: int) -> None:
        """A kill was commanded: end what is under way with this vehicle."""

    @abstractmethod
    def _is_awaiting(self) -> bool:
        """Whether an answer may come at any moment."""

    @abstractmethod
    def _move_bytes(self) -> None:
        """Move the transport's own bytes, also between ticks."""

    # the link

    @property
    def problems(self) -> Sequence[str]:
        """Problems that do not end the flight but concern an operator, like a failed recording. In words."""
        problem = "" if self._recorder is None else self._recorder.problem
        return (f"link {self.name}: {problem}",) if problem else ()

    @property
    def conflicts(self) -> Mapping[VehicleId, str]:
        """Vehicles with recent frames of their system id from two addresses; the text names both."""
        return {self.ids[row]: text for row, text in self._addresses.conflicts().items()}

    @property
    def foreign(self) -> Mapping[VehicleId, str]:
        """Vehicles with another autopilot than configured; the text names both."""
        rows = np.flatnonzero(self._telemetry.is_foreign).tolist()
        return {self.ids[row]: self._telemetry.foreign(row) for row in rows}

    @property
    def without_autopilot(self) -> Mapping[VehicleId, Absent]:
        """Vehicles of which other components are received, but no autopilot."""
        absent = self._addresses.without_autopilot()
        return {self.ids[row]: self._absent(row, *seen) for row, seen in absent.items()}

    def _absent(self, row: int, component: int, is_autopilot: bool) -> Absent:
        problem = f"system {self._system_ids[row]} is received from component {component} only"
        name = self._telemetry.autopilots[row].component_parameter
        if not is_autopilot:
            return Absent(problem, "look after the autopilot itself, which is component 1")
        if not name:
            return Absent(problem, "give its autopilot component id 1")
        return Absent(problem, f"set {name} to 1, and restart its autopilot")

    @property
    def setpoints_sent(self) -> int:
        return self.counters.setpoints_sent

    @property
    def addresses(self) -> Mapping[VehicleId, Address]:
        """Source of each vehicle's newest frame: all that a kill from another process needs."""
        address_of = {name: self._addresses.address(row) for row, name in enumerate(self.ids)}
        return {name: address for name, address in address_of.items() if address is not None}

    def watch_parameters(self, names: Collection[str]) -> None:
        """Keep the values of these parameters that vehicles announce, whichever station set them."""
        self._parameters.watch(names)

    def reported_parameters(self) -> Mapping[VehicleId, Mapping[str, ParameterValue]]:
        """Newest values of watched parameters that vehicles announced since the last call."""
        return self._parameters.drain()

    def observe(self, observer: Observer) -> Callable[[], None]:
        """Pass every frame to `observer` from now on; call the result to stop. See `Observer`."""
        boxes = self._inbox, self.outbox
        for box in boxes:
            box.observers = (*box.observers, observer)

        def stop() -> None:
            for box in boxes:
                box.observers = tuple(other for other in box.observers if other is not observer)

        return stop

    def setpoint_times_s(self, vehicle_id: VehicleId) -> tuple[float, ...]:
        """Times at which the latest setpoints to this vehicle left our socket, oldest first; bounded."""
        return self._sent.times_s(self._row[vehicle_id])

    async def run(self) -> None:
        """Move bytes until cancelled. Raises: LinkError, after which the supervisor calls it again."""
        stop_recording = None if self._recorder is None else self.observe(self._recorder.record)
        try:
            self._ports.open()
            self._forwarding.open()
            self._ticked_s = self._clock()  # control gets time to start
            async with self._opened() as coroutines, asyncio.TaskGroup() as group:
                group.create_task(self._keep_receiving(), name=f"link/{self.name}/receive")
                group.create_task(self._keep_beating(), name=f"link/{self.name}/beat")
                for name, work in coroutines.items():
                    group.create_task(work, name=f"link/{self.name}/{name}")
        finally:
            self.fences.close()
            self._forwarding.close()
            self._ports.close()
            self._addresses.forget(self._ports.gone())
            if stop_recording is not None:
                stop_recording()

    def snapshot(self) -> Telemetry:
        """The newest telemetry of every vehicle, with arrival times. Never blocks."""
        self._receive_for_tick()
        return self._telemetry.telemetry(may_be_ready=self._protocol is not None)

    def _receive_for_tick(self) -> None:
        """Read pending datagrams for a tick, and schedule the next reading shortly before the next tick."""
        self._receive()
        self._snapshot_before_s, self._snapshot_s = self._snapshot_s, self._received_s
        ahead_s = 2.0 * self._snapshot_s - self._snapshot_before_s - _AHEAD_S
        if self._protocol is not None and self._snapshot_s < ahead_s < self._snapshot_s + _IDLE_S:
            asyncio.get_running_loop().call_at(ahead_s, self._receive)

    def send(self, setpoints: Setpoints) -> None:
        """Send one tick's setpoints, now: `prepare` and `send_until` in one."""
        self.prepare(setpoints)
        self.send_until()

    def prepare(self, setpoints: Setpoints) -> Array:
        """Take one tick's setpoints, of which `send_until` sends those whose samples are oldest first.

        A vehicle of this link that is not listed gets no further setpoint from the moment of the call; one
        that is listed gets none later than the watchdog's time after the last call that listed it.
        A batch that is already older than the watchdog's time is not sent at all. A row that is not finite,
        and one for a vehicle that is not connected or was killed, is left out, as if it were not listed.

        Returns: (k,) arrival of each new sample that a setpoint answers, oldest first; inf: no new one.
        """
        now_s = self._clock()
        self._ticked_s = now_s
        self._ready = None
        if self._protocol is None:
            return _NONE_READY
        if setpoints.ids != self._listed[0]:
            ours = {self._row[name]: at for at, name in enumerate(setpoints.ids) if name in self._row}
            self._listed = setpoints.ids, np.array(list(ours.values()), int), np.array(list(ours), int)
        _, at, rows = self._listed
        may_receive = self._connected(now_s) & self._commandable & ~self._telemetry.is_foreign
        if np.count_nonzero(self._climbs_alone):
            may_receive &= ~(self._climbs_alone & (self._telemetry.landed == Landed.TAKEOFF))
        for row in self._killed:
            may_receive[row] &= not self._latch.is_shut(int(self._system_ids[row]))
        rows, velocity_ned_m_s, yaw_rad, sample_s = most_urgent_first(
            setpoints.velocity_m_s,
            setpoints.yaw_rad,
            at,
            rows,
            may_receive,
            radians(self._frame.heading_deg),
            self._telemetry.position_time_s,
            self._snapshot_before_s,
        )
        until_s = min(now_s, setpoints.time_s) + self._hold_s
        batch = SetpointBatch(rows, velocity_ned_m_s, yaw_rad, until_s)
        self._expect_setpoints(batch)
        self._ready = batch, sample_s
        return sample_s

    def send_until(self, sample_s: float = np.inf) -> None:
        """Send what was prepared and has not left, for samples that arrived until `sample_s`.

        Waits some milliseconds at most, for MAVSDK's threads.
        """
        if self._ready is None:
            return
        batch, samples_s = self._ready
        end = int(samples_s.searchsorted(sample_s, side="right"))
        self._ready = batch.part(slice(end, None)), samples_s[end:]
        self._send_setpoints(batch.part(slice(end)))

    def reached(self) -> tuple[float, Mask] | None:
        """The link's time, and the vehicles (n,) that are connected; None: the link is not open."""
        now_s = self._clock()
        return None if self._protocol is None else (now_s, self._connected(now_s))

    async def execute(self, command: Command) -> None:
        """Send a command, and return when the vehicle's heartbeat confirms it.

        OFFBOARD needs setpoints already flowing for that vehicle. TAKEOFF returns when the climb has begun.

        Raises: CommandError with a reason a person can act on, when it refuses or does not answer in time.
        """
        otherwise = f"{command.verb} impossible"
        protocol, row = self._protocol_for(command.vehicle_id, otherwise)
        reported = VehicleReport(self._telemetry, row)
        if command.verb is Verb.KILL:
            self._killed.add(row)
            killing = protocol.kill(command, reported, partial(self._send_kill, row))
            self._forget_commands(row)
            await killing
            return
        channel = self._channel(row, otherwise)
        if command.verb is Verb.OFFBOARD and not self._clock() - self._sent.newest_s[row] <= self._hold_s:
            raise CommandError(f"{command.vehicle_id}: offboard refused: no setpoints are flowing to it")
        await protocol.execute(command, channel, reported)

    async def read_parameters(
        self, vehicle_id: VehicleId, names: Sequence[str], may_lack: Collection[str] = ()
    ) -> Mapping[str, ParameterValue]:
        """The autopilot's present values of `names`. Takes seconds, and delays no other vehicle.

        Of those that it `may_lack`, the result leaves out what is not answered.

        Raises: UnknownError for a vehicle of another link; CommandError naming the parameter, when it does
        not exist or the vehicle does not answer (which cannot be distinguished).
        """
        otherwise = "its parameters cannot be read"
        protocol, row = self._protocol_for(vehicle_id, otherwise)
        channel = self._channel(row, otherwise)
        return await protocol.read_parameters(vehicle_id, names, channel, may_lack)

    async def set_parameter(self, vehicle_id: VehicleId, name: str, value: ParameterValue) -> None:
        """Set one; an int only where the autopilot holds an integer. To be certain, read it back.

        Raises: UnknownError for a vehicle of another link; CommandError naming the parameter.
        """
        otherwise = f"{name} cannot be set"
        protocol, row = self._protocol_for(vehicle_id, otherwise)
        await protocol.set_parameter(vehicle_id, name, value, self._channel(row, otherwise))

    def watch_fences(self) -> None:
        """Read what autopilots say of their fences, from now on."""
        if not self._watches_fences:
            self._watches_fences = True
            self.listen(self.fences.listener)

    def listen(self, listener: FrameListener) -> None:
        """Have further frames read from now on."""
        self._inbox.listeners = (*self._inbox.listeners, listener)

    async def upload_fence(
        self, vehicle_id: VehicleId, vertices: Sequence[FenceVertex], *, anew: bool
    ) -> None:
        """Send a vehicle its fence, as `FenceTransfers.upload`; to be certain, read it back.

        Raises: UnknownError for a vehicle of another link; CommandError with what it answers.
        """
        row = self._row_for(vehicle_id, "its fence cannot be sent")
        try:
            await self.fences.upload(row, vertices, anew=anew)
        except CommandError as error:
            raise CommandError(f"{vehicle_id}: its fence was not taken: {error}") from error

    async def read_fence(self, vehicle_id: VehicleId, expected: Sequence[FenceVertex]) -> StoredFence:
        """What fence a vehicle has, beside the expected one. Raises: as `upload_fence`."""
        row = self._row_for(vehicle_id, "its fence cannot be read")
        try:
            return await self.fences.read(row, expected)
        except CommandError as error:
            raise CommandError(f"{vehicle_id}: its fence cannot be read: {error}") from error

    def _row_for(self, vehicle_id: VehicleId, otherwise: str) -> int:
        """The row of a vehicle that can be asked now. Raises: UnknownError, CommandError."""
        _, row = self._protocol_for(vehicle_id, otherwise)
        self._channel(row, otherwise)
        self.watch_fences()
        return row

    def _protocol_for(self, vehicle_id: VehicleId, otherwise: str) -> tuple[CommandProtocol, int]:
        """The command protocol, and the vehicle's row. Raises: UnknownError, CommandError."""
        row = self._row.get(vehicle_id)
        if row is None:
            raise UnknownError(f"{vehicle_id} is not on link {self.name}")
        if self._protocol is None:
            raise CommandError(f"{vehicle_id}: {otherwise}: link {self.name} is not open")
        return self._protocol, row

    def _channel(self, row: int, otherwise: str) -> CommandChannel:
        """The command channel of a vehicle that has its autopilot as configured. Raises: CommandError."""
        channel = self._command_channel(row, otherwise)
        if foreign := self._telemetry.foreign(row):
            raise CommandError(f"{self.ids[row]}: {otherwise}: {foreign}")
        return channel

    def _never_connected(self, row: int, otherwise: str) -> CommandError:
        absent = self.without_autopilot.get(self.ids[row])
        why = f"never received on link {self.name}" if absent is None else str(absent)
        return CommandError(f"{self.ids[row]}: {otherwise}: {why}")

    def _connected(self, now_s: float) -> Mask:
        """(n,) vehicles with a sign of life and a known mode."""
        alive: Mask = now_s - self._telemetry.life_time_s <= SILENT_AFTER_S
        connected: Mask = alive & np.isfinite(self._telemetry.heartbeat_time_s)
        return connected

    def _send_message(
        self, message_id: int, messages: codec.Records, rows: Whole, component_id: int = codec.COMPONENT_ID
    ) -> None:
        frames = self.outbox.encode(message_id, messages, rows, component_id=component_id)
        self.outbox.send(frames, rows, self._clock())

    def _send_kill(self, row: int) -> None:
        self._send_message(COMMAND_LONG, codec.kill_message(int(self._system_ids[row])), np.array([row]))

    def _stop_those_that_fly_on(self) -> None:
        """Send one setpoint at rest to vehicles that flew a setpoint until now, and would fly on without."""
        self._stopped_s = now_s = self._clock()
        rows = np.flatnonzero(self._flies_on & (now_s - self._sent.newest_s <= _FLEW_WITHIN_S))
        system_ids = self._system_ids[rows]
        rows = rows[[not self._latch.is_shut(system_id) for system_id in system_ids.tolist()]]
        if len(rows):
            still = np.zeros((len(rows), 3)), np.zeros(len(rows))
            messages = setpoint_messages(self._system_ids[rows], *still, time_s=now_s)
            messages["type_mask"] = VELOCITY
            self._send_message(SET_POSITION_TARGET_LOCAL_NED, messages, rows)

    def _receive(self) -> None:
        self._received_s = self._clock()
        self._ports.receive(self._inbox.take)
        self._addresses.forget(self._ports.gone())
        self._forwarding.exchange()

    async def _keep_receiving(self) -> None:
        watched_s = -np.inf
        try:
            while True:
                busy = self._is_awaiting() or bool(self._telemetry.waiting) or self.fences.awaited
                now_s = self._clock()
                if now_s - self._ticked_s > _TICKS_ENDED_S and self._stopped_s < self._ticked_s:
                    self._stop_those_that_fly_on()
                if busy or now_s - self._received_s >= _IDLE_S:
                    self._receive()
                self._move_bytes()
                if now_s - watched_s >= _WATCH_S:
                    watched_s = now_s
                    self._watch(now_s)
                await asyncio.sleep(_BUSY_S if busy else _IDLE_S / 2)
        finally:
            self._stop_those_that_fly_on()

    def _watch(self, now_s: float) -> None:
        may_be_asked = self._connected(now_s) & self._commandable
        connection_count = self._telemetry.connection_count
        self._streams.watch(may_be_asked, connection_count, now_s)
        self._versions.watch(may_be_asked, connection_count, self._telemetry.version_time_s, now_s)
        self._round_trips.watch(may_be_asked, now_s)

    async def _keep_beating(self) -> None:
        """Send our heartbeat while control runs: autopilots have a failsafe for its end."""
        while True:
            now_s = self._clock()
            if now_s - self._ticked_s <= self._heartbeat_hold_s:
                self.outbox.broadcast(HEARTBEAT, codec.heartbeats(1), now_s)
            await asyncio.sleep(_BEAT_S)
