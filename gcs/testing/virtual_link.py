"""The production `NativeLink` over datagrams in memory, to and from the fake autopilots of `sim`.

No sockets, no threads: under `async_solipsism.EventLoop` a flight of minutes takes seconds. A datagram has
the time at which its vehicle sent it, as the kernel's times of arrival have it.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from ipaddress import IPv4Address
from math import inf, isnan
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common

from gcs.config.schema import Config
from gcs.links import Command, Verb
from gcs.links.autopilots import DEFAULT, Autopilot, CommandLong
from gcs.links.endpoints.ports import Datagrams, Ports, source_of
from gcs.links.native.link import NativeLink
from gcs.links.settings import StreamSettings
from gcs.links.stream_requests import desired_rates
from gcs.mavlink.kernels import Bytes, Whole
from gcs.model.errors import LinkError
from gcs.model.state import VehicleId
from gcs.sim.faults.injector import FaultInjector
from gcs.sim.fleet import Fleet
from gcs.sim.protocol import frames
from gcs.sim.protocol.streams import RECORDED_HZ

UNREAD: Final = (
    common.MAVLINK_MSG_ID_PING,
    common.MAVLINK_MSG_ID_MISSION_CURRENT,
    common.MAVLINK_MSG_ID_ATTITUDE_TARGET,
    common.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
)
_RATES_HZ: Final = {**RECORDED_HZ, **desired_rates(StreamSettings()), **dict.fromkeys(UNREAD, 0.0)}
STREAMS_HZ: Final = {message_id: rate_hz for message_id, rate_hz in _RATES_HZ.items() if rate_hz}
"""For `sim.fleet.Settings`: what the link requests, and no stream without a reader, for speed."""

PORT: Final = 14580
VEHICLES_AT: Final = int(IPv4Address("10.0.0.1"))
DUPLICATES_AT: Final = int(IPv4Address("10.0.1.1"))


class SentSetpoint(NamedTuple):
    """One setpoint as sent: NED, with yaw from north."""

    time_s: float
    velocity_ned_m_s: tuple[float, float, float]
    yaw_rad: float


class SentCommand(NamedTuple):
    """One command as sent; a repetition for lack of an answer is not listed."""

    time_s: float
    verb: Verb


class VirtualPorts(Ports):
    """Datagrams between a link and a fake fleet. Steps the fleet.

    Attributes:
        fault_injector: its faults lose, delay and damage datagrams.
        beatless: vehicles whose heartbeats do not arrive.
        duplicated: vehicles whose heartbeats also arrive from a second address.
        refused: commands that the vehicle denies.
        commands: sent to each vehicle, oldest first.
        requested: parameters that were requested, oldest first.
        autopilot_of: profiles of the vehicles, by which their commands are read; without: the default.
    """

    def __init__(self, ids: Sequence[VehicleId], fleet: Fleet, clock: Callable[[], float]) -> None:
        """Vehicle i of `ids` is row i of the fleet, which may have more."""
        self.send_errors = 0
        self.fault_injector = FaultInjector(fleet)
        self.beatless: set[VehicleId] = set()
        self.duplicated: set[VehicleId] = set()
        self.refused: set[tuple[VehicleId, Verb]] = set()
        self.commands: dict[VehicleId, list[SentCommand]] = {name: [] for name in ids}
        self.autopilot_of: Mapping[VehicleId, Autopilot] = {}
        self.requested: list[tuple[VehicleId, str]] = []
        self._ids = (*ids, *(f"row {row}" for row in range(len(ids), len(fleet.autopilots))))
        self.ids = tuple(ids)
        self._fleet = fleet
        self._clock = clock
        self._is_open = False
        self._port = [PORT] * len(fleet.autopilots)  # of each vehicle now
        self._deaf: set[VehicleId] = set()  # it receives nothing
        self._mute: set[VehicleId] = set()  # nothing is received from it
        self._to_vehicles: deque[tuple[float, int, bytes]] = deque()
        self._to_station: list[tuple[float, int, bytes]] = []
        self._setpoints: dict[VehicleId, list[SentSetpoint]] = {name: [] for name in ids}
        self._unread: list[tuple[float, Whole, bytes]] = []
        self._mavlink = common.MAVLink(None)

    def silence(self, *ids: VehicleId, up: bool = True, down: bool = True) -> None:
        """Cut these vehicles off: they receive nothing (up), and nothing is received from them (down)."""
        self._deaf |= set(ids if up else ())
        self._mute |= set(ids if down else ())

    def restore(self, *ids: VehicleId) -> None:
        """End the silence in both directions."""
        self._deaf -= set(ids)
        self._mute -= set(ids)

    def change_port(self, vehicle_id: VehicleId) -> None:
        """Let it send from another port from now on; what is sent to the old one is lost."""
        self._port[self._ids.index(vehicle_id)] += 1

    def arrive_from(self, host: str, port: int, datagram: bytes) -> None:
        """Let a datagram of someone else arrive."""
        source = source_of(int(IPv4Address(host)), port, 0)
        self._to_station.append((self._fleet.time_s, source, datagram))

    def is_silent(self, vehicle_id: VehicleId) -> bool:
        """Whether nothing is received from this vehicle."""
        return vehicle_id in self._mute

    @property
    def sent(self) -> Mapping[VehicleId, list[SentSetpoint]]:
        """Setpoints sent to each vehicle, oldest first."""
        for time_s, rows, raw in self._unread:
            found = frames.setpoints(raw)
            assert found is not None
            for row, sent in zip(rows.tolist(), found[0], strict=True):
                velocity = (float(sent["vx"]), float(sent["vy"]), float(sent["vz"]))
                self._setpoints[self._ids[row]].append(SentSetpoint(time_s, velocity, float(sent["yaw"])))
        self._unread.clear()
        return self._setpoints

    def reads(self, name: str = "GF_ACTION") -> int:
        """How often a parameter was requested, by default one that every preflight check reads."""
        return sum(requested == name for _, requested in self.requested)

    def step(self) -> None:
        """Step the vehicles, which first receive what was sent to them until then."""
        broken, time_s = self.fault_injector.broken, self._fleet.time_s + self._fleet.step_s
        arrived: list[tuple[int, bytes]] = []
        while self._to_vehicles and self._to_vehicles[0][0] <= time_s:
            _, row, datagram = self._to_vehicles.popleft()
            if self._ids[row] in self._deaf:
                continue
            if row in broken:
                broken[row].into.put(datagram, None, time_s)
            else:
                arrived.append((row, datagram))
        for row, channel in broken.items():
            arrived += [(row, datagram) for datagram, _ in channel.into.take(time_s)]
        self._fleet.receiver.receive(arrived)
        self._fleet.step()
        self.fault_injector.pass_time()
        for row, packed in self._fleet.take_frames().items():
            self._put(row, packed)
        for row, channel in broken.items():
            for datagram in *(each for each, _ in channel.out.take(time_s)), *channel.jammer.take(time_s):
                self._arrive(VEHICLES_AT, row, datagram)

    def keep_oldest(self, share: float) -> None:
        """Drop the youngest datagrams that the station has not read, as a full buffer does."""
        del self._to_station[round(share * len(self._to_station)) :]

    # what the link uses

    def open(self) -> None:
        """See `Ports.open`."""
        self._is_open = True

    def close(self) -> None:
        """See `Ports.close`."""
        self._is_open = False
        self._to_station.clear()

    def receive(self, take: Callable[[Datagrams], None]) -> None:
        """See `Ports.receive`."""
        if not self._to_station:
            return
        time_s, source, data = zip(*self._to_station, strict=True)
        self._to_station.clear()
        length = np.array([len(each) for each in data], np.int64)
        flat = np.frombuffer(bytearray(b"".join(data)), np.uint8)  # writable, as the kernels are compiled for
        arrival_s = np.minimum(time_s, self._clock())
        take(Datagrams(flat, np.cumsum(length) - length, length, np.array(source, np.int64), arrival_s))

    def send(
        self, data: Bytes, length: Whole, destination: Whole, *, until_s: float = inf
    ) -> NDArray[np.bool_]:
        """See `Ports.send`."""
        now_s = self._clock()
        left: NDArray[np.bool_] = (destination >= 0) & (self._is_open and now_s <= until_s)
        rows = (destination >> 16 & 0xFFFFFFFF) - VEHICLES_AT
        sent = left.nonzero()[0].tolist()
        ports = (destination[left] & 0xFFFF).tolist()
        for at, row, port in zip(sent, rows[left].tolist(), ports, strict=True):
            if 0 <= row < len(self._port) and port == self._port[row]:
                datagram = data[at, : length[at]].tobytes()
                if self._delivers(row, datagram, now_s):
                    self._to_vehicles.append((now_s, row, datagram))
        if sent and _message_id(data[0].tobytes()) == common.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED:
            self._unread.append((now_s, rows[left], data[left, : length[0]].tobytes()))
        return left

    # its parts

    def _put(self, row: int, packed: Iterable[bytes]) -> None:
        """What a vehicle sends at once: one datagram."""
        vehicle_id, broken = self._ids[row], self.fault_injector.broken
        if vehicle_id in self.beatless:
            packed = [frame for frame in packed if _message_id(frame) != common.MAVLINK_MSG_ID_HEARTBEAT]
        if vehicle_id in self.duplicated:
            for frame in packed:
                if _message_id(frame) == common.MAVLINK_MSG_ID_HEARTBEAT:
                    self._arrive(DUPLICATES_AT, row, frame)
        datagram = b"".join(packed)
        if row in broken:
            broken[row].out.put(datagram, None, self._fleet.time_s)
        else:
            self._arrive(VEHICLES_AT, row, datagram)

    def _arrive(self, first_host: int, row: int, datagram: bytes) -> None:
        if self._is_open and datagram and self._ids[row] not in self._mute:
            port = self._port[row] if first_host == VEHICLES_AT else PORT
            source = source_of(first_host + row, port, 0)
            self._to_station.append((self._fleet.time_s, source, datagram))

    def _delivers(self, row: int, datagram: bytes, now_s: float) -> bool:
        """Note commands and requests; False for a command that is refused instead of delivered."""
        vehicle_id, message_id = self._ids[row], _message_id(datagram)
        if message_id == common.MAVLINK_MSG_ID_PARAM_REQUEST_READ:
            self.requested.append((vehicle_id, self._mavlink.decode(bytearray(datagram)).param_id))
        if message_id != common.MAVLINK_MSG_ID_COMMAND_LONG:
            return True
        sent: Any = self._mavlink.decode(bytearray(datagram))
        verb = _verb(sent, self.autopilot_of.get(vehicle_id, DEFAULT))
        if verb is not None and sent.confirmation == 0:
            self.commands[vehicle_id].append(SentCommand(now_s, verb))
        if (vehicle_id, verb) not in self.refused:
            return True
        if vehicle_id not in self._deaf:
            denied = common.MAVLink_command_ack_message(
                sent.command, common.MAV_RESULT_DENIED, 0, 0, sent.get_srcSystem(), sent.get_srcComponent()
            )
            self._fleet.autopilots[row].reply(denied)
        return False


class VirtualLink(NativeLink):
    """The production link over `VirtualPorts`; the fleet flies while it runs.

    Attributes:
        ports: what passes, and controls for tests.
        failures: `run` raises the next of them, at once or while it runs.
        runs: how often `run` was called.
        takes_s: time that each batch of setpoints takes, as on a machine that has too much to do.
        recording_problem: one of `problems`, if it is not empty.
    """

    def __init__(
        self,
        config: Config,
        fleet: Fleet,
        *,
        ids: Sequence[VehicleId] | None = None,
        ports: VirtualPorts | None = None,
    ) -> None:
        """The link `loop` to all vehicles of the configuration, or `ids`; vehicle i is row i of the fleet."""
        clock = asyncio.get_running_loop().time
        names = config.ids if ids is None else ids
        profiles = [profile for link in config.links for profile in link.autopilots]
        autopilot_of = dict(zip(config.ids, profiles, strict=True))
        self.ports = ports or VirtualPorts(names, fleet, clock)
        self.ports.autopilot_of = autopilot_of
        super().__init__(
            "loop",
            {name: system_id for system_id, name in enumerate(names, start=1)},
            (),
            config.frame,
            autopilots=[autopilot_of[name] for name in names],
            setpoint_timeout_s=config.setpoint_timeout_s,
            rates_hz=desired_rates(StreamSettings()),
            clock=clock,
            ports=self.ports,
        )
        self.failures: asyncio.Queue[LinkError] = asyncio.Queue()
        self.runs = 0
        self.takes_s = 0.0
        self.recording_problem = ""
        self._fleet = fleet

    @property
    def problems(self) -> Sequence[str]:
        """See `Link.problems`."""
        return (*super().problems, *([self.recording_problem] if self.recording_problem else []))

    async def run(self) -> None:
        """See `Link.run`. The fleet catches up with the time in which the link did not run."""
        self.runs += 1
        if not self.failures.empty():
            raise self.failures.get_nowait()
        self._step_until(asyncio.get_running_loop().time())
        async with asyncio.TaskGroup() as group:
            group.create_task(self._fly())
            group.create_task(self._fail())
            await super().run()

    def send_until(self, sample_s: float = inf) -> None:
        """See `Link.send_until`."""
        super().send_until(sample_s)
        if self.takes_s > 0.0:
            loop: Any = asyncio.get_running_loop()  # async_solipsism's
            loop._selector.clock.advance(self.takes_s)

    async def _fly(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            self._step_until(loop.time())
            await asyncio.sleep(self._fleet.time_s + self._fleet.step_s - loop.time())

    def _step_until(self, time_s: float) -> None:
        while self._fleet.time_s + self._fleet.step_s / 2 < time_s:
            self.ports.step()

    async def _fail(self) -> None:
        raise await self.failures.get()


def _message_id(frame: bytes) -> int:
    return int.from_bytes(frame[7:10], "little")


def _verb(sent: Any, autopilot: Autopilot) -> Verb | None:
    """The command of a COMMAND_LONG; None for one that is not a `Verb`. STANDBY is the mode that it sets."""
    if sent.command == common.MAV_CMD_COMPONENT_ARM_DISARM:
        return Verb.KILL if sent.param2 else Verb.ARM if sent.param1 else Verb.DISARM
    if sent.command == common.MAV_CMD_NAV_TAKEOFF:
        return Verb.TAKEOFF
    for verb in (Verb.HOLD, Verb.OFFBOARD, Verb.RETURN, Verb.LAND):
        (step,) = autopilot.steps(Command("", verb))
        assert isinstance(step, CommandLong)
        values = sent.param1, sent.param2, sent.param3
        if step.command == sent.command and (isnan(step.params[0]) or values == (*step.params, 0.0, 0.0)[:3]):
            return verb
    return None
