"""MAVSDK, typed: the only module that imports it. Its instances behind one link, and their vehicles."""

import logging
import os
import selectors
import socket
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import Any, Final

from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk
from mavsdk.exceptions import MavsdkError
from mavsdk.logging import LogLevel, log_subscribe
from mavsdk.plugins.action import Action
from mavsdk.plugins.offboard import Offboard
from mavsdk.plugins.offboard.offboard import OffboardResult, VelocityNedYawCStruct
from mavsdk.plugins.telemetry import Telemetry

from gcs.links.endpoints import mmsg
from gcs.links.link import Verb
from gcs.links.settings import instances
from gcs.model.errors import CommandError, LinkError

log = logging.getLogger(__name__)

COMPONENT_ID: Final = 190
"""MAVSDK's own component id as a ground station."""

_SUCCESS: Final = int(OffboardResult.SUCCESS)

_LOG_LEVELS: Final = {LogLevel.WARN: logging.INFO, LogLevel.ERROR: logging.WARNING}
"""Other levels are for developers of MAVSDK. Errors are rare; the last may say why the process ends."""

_HOST: Final = "127.0.0.1"
_LONGEST_BYTES: Final = 2048
_BUFFER_BYTES: Final = 4 << 20
_GREETING_S: Final = 5.0


class Loopback:
    """Our end of one instance's connection: a UDP port of this machine.

    MAVSDK writes to it without Python: its threads and ours never wait for each other.
    """

    def __init__(self, name: str) -> None:
        """Bind to a port that the system picks. Raises: LinkError. `name` is for errors."""
        self._name = name
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
            self._socket.bind((_HOST, 0))
        except OSError as error:
            self._socket.close()
            raise LinkError(f"{name}: a UDP port on {_HOST}: {error}") from error
        self.fd, self.close = self._socket.fileno(), self._socket.close
        self.url = f"udpout://{_HOST}:{self._socket.getsockname()[1]}"

    def await_mavsdk(self) -> None:
        """Wait for MAVSDK's first heartbeat, and accept no other sender from then on. Raises: LinkError."""
        self._socket.settimeout(_GREETING_S)
        try:
            _, sender = self._socket.recvfrom(_LONGEST_BYTES)
            self._socket.connect(sender)
        except OSError as error:
            raise LinkError(f"{self._name}: MAVSDK sends nothing: {error}") from error
        self._socket.setblocking(False)

    def give(self, data: bytes) -> bool:
        """Send one datagram of frames; False when there is no room or no receiver."""
        try:
            self._socket.send(data)
        except OSError:
            return False
        return True

    def take(self, room: mmsg.Batch, first: int = 0) -> int:
        """Fill `room` from row `first` on with what MAVSDK has written since. Never blocks.

        Returns: number of datagrams.
        """
        return room.read(self._socket.fileno(), first, len(room.length) - first)


@contextmanager
def _failure_named() -> Iterator[None]:
    """Raises: CommandError with MAVSDK's name for the failure."""
    try:
        yield
    except MavsdkError as error:
        raise CommandError(error.result.name) from error


class MavsdkVehicle:
    """The plugins of one vehicle. Getters and `set_velocity` take microseconds; `command` blocks seconds."""

    def __init__(self, system: Any) -> None:
        """Raises: RuntimeError from MAVSDK when the system is gone already."""
        self.destroy = (
            system.destroy
        )  # releases the vehicle and its plugins, which may not be used afterwards
        self._telemetry: Any = Telemetry(system)
        self._offboard: Any = Offboard(system)
        self._action: Any = Action(system)
        self._velocity: Any = VelocityNedYawCStruct()
        # `Offboard.set_velocity_ned` makes this call and objects that cost 5 us: at 250 vehicles 3 % of a
        # core.
        self._set_velocity_ned: Any = self._offboard._lib.mavsdk_offboard_set_velocity_ned  # noqa: SLF001

    def healthy(self) -> bool:
        """Sensors present and calibrated, position and home known."""
        ok: bool = self._telemetry.health_all_ok()
        return ok

    def set_velocity(self, north_m_s: float, east_m_s: float, down_m_s: float, yaw_deg: float) -> bool:
        """Make MAVSDK send this at once, and then at 20 Hz until the next call; whether it accepted."""
        velocity = self._velocity
        velocity.north_m_s, velocity.east_m_s, velocity.down_m_s = north_m_s, east_m_s, down_m_s
        velocity.yaw_deg = yaw_deg
        result: int = self._set_velocity_ned(self._offboard._require_handle(), velocity)  # noqa: SLF001
        return result == _SUCCESS

    @_failure_named()
    def command(self, verb: Verb, height_m: float) -> None:
        """Send a command and wait for its acknowledgement, up to 2 s. Not STANDBY: MAVSDK has no call for it.

        Raises: CommandError with MAVSDK's name for the failure.
        """
        calls: dict[Verb, Callable[[], object]] = {
            Verb.ARM: self._action.arm,
            Verb.DISARM: self._action.disarm,
            Verb.TAKEOFF: lambda: self._take_off(height_m),
            Verb.HOLD: self._action.hold,
            Verb.OFFBOARD: self._offboard.start,
            Verb.LAND: self._action.land,
            Verb.RETURN: self._action.return_to_launch,
            Verb.KILL: self._action.kill,
        }
        calls[verb]()

    def _take_off(self, height_m: float) -> None:
        self._action.set_takeoff_altitude(height_m)
        self._action.takeoff()


class MavsdkBinding:
    """One MAVSDK instance, whose bytes the link moves.

    `open`, `discover` and `destroy` block for milliseconds and belong on another thread than the loop's. A
    thread cannot be cancelled, so they exclude each other, and after `destroy` the others do nothing: MAVSDK
    itself would crash.

    Every vehicle is kept and released here. Left to Python's garbage collector, one could be halfway through
    its release on another thread when MAVSDK ends, and MAVSDK aborts the process for that.
    """

    def __init__(self, station_id: int) -> None:
        self._station_id = station_id
        self._mavsdk: Any = None
        self._loopback: Loopback | None = None
        self._vehicles: list[MavsdkVehicle] = []
        self._destroyed = False
        self._lock = Lock()

    @property
    def loopback(self) -> Loopback:
        """Its bytes, in and out; only between `open` and `destroy`."""
        if self._loopback is None:
            raise LinkError("MAVSDK is not open")
        return self._loopback

    def open(self) -> None:
        """Start MAVSDK. Raises: LinkError."""
        with self._lock, _OPENING:
            if self._destroyed:
                return
            _take_messages()
            self._loopback = Loopback("MAVSDK")
            configuration: Any = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
            configuration.system_id = self._station_id
            with _unhurried():
                self._mavsdk = Mavsdk(configuration)
                result = self._mavsdk.add_any_connection(self._loopback.url)
            configuration.destroy()
            if result != ConnectionResult.SUCCESS:
                raise LinkError(f"MAVSDK's connection to {self._loopback.url}: {result.name}")
            self._loopback.await_mavsdk()

    def discover(self, desired: Collection[int]) -> dict[int, MavsdkVehicle]:
        """Those of the desired systems that MAVSDK has discovered, with new plugins."""
        discovered: dict[int, MavsdkVehicle] = {}
        with self._lock:
            for system in () if self._destroyed else self._mavsdk.get_systems():
                system_id: int = system.get_system_id()
                if system_id not in desired or not system.has_autopilot():
                    system.destroy()
                    continue
                try:
                    discovered[system_id] = MavsdkVehicle(system)
                    self._vehicles.append(discovered[system_id])
                except RuntimeError as error:  # a plugin could not be created; it is tried again soon
                    log.warning("vehicle_not_discovered", extra={"system_id": system_id, "cause": str(error)})
                    system.destroy()
        return discovered

    def destroy(self) -> None:
        """End its threads; its plugins may not be used afterwards."""
        with self._lock:
            self._destroyed = True
            for vehicle in self._vehicles:
                vehicle.destroy()
            if self._mavsdk is not None:
                self._mavsdk.destroy()
            if self._loopback is not None:
                self._loopback.close()


@contextmanager
def _unhurried() -> Iterator[None]:
    """Keep threads started in the block from preempting ours as they wake: else a hundred times a tick."""
    policy, param = os.sched_getscheduler(0), os.sched_getparam(0)
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    try:
        yield
    finally:
        os.sched_setscheduler(0, policy, param)


_OPENING = Lock()
"""Several links open at the same time, each on its own thread, and MAVSDK has one log for all of them."""


@cache
def _take_messages() -> None:
    """Once a process: replacing the callback frees it under an instance that may be logging."""
    log_subscribe(_pass_on)


def _pass_on(level: LogLevel, message: str, _file: str | None, _line: int) -> bool:
    """MAVSDK prints to stdout unless a callback takes its messages."""
    log.log(_LOG_LEVELS.get(level, logging.DEBUG), "mavsdk", extra={"reported": message})
    return True


_DATAGRAM_BYTES: Final = 1400
"""MAVSDK reads 2048 bytes of one."""


class MavsdkInstances:
    """The instances of one link.

    Each has at most 64 vehicles, since its traffic grows with the square, and receives the bytes of its own
    vehicles only.

    `open`, `discover` and `close` block, see `MavsdkBinding`; all else belongs on the loop's thread,
    between `open` and `close`.
    """

    def __init__(self, system_ids: Sequence[int], station_id: int) -> None:
        """As many instances as needed, of similar size."""
        count = instances(len(system_ids))
        self._fleets = tuple(MavsdkBinding(station_id) for _ in range(count))
        self._ids = tuple(frozenset(system_ids[index::count]) for index in range(count))
        self._waiting: dict[MavsdkBinding, list[bytes]] = {fleet: [] for fleet in self._fleets}
        self._of = {
            system_id: fleet for fleet, ids in zip(self._fleets, self._ids, strict=True) for system_id in ids
        }
        self._written = selectors.DefaultSelector()

    def open(self) -> None:
        """Start them. Raises: LinkError."""
        for fleet in self._fleets:
            fleet.open()
            self._written.register(fleet.loopback.fd, selectors.EVENT_READ, fleet)

    def take(self, room: mmsg.Batch) -> int:
        """Fill `room` with what they have written, in each one's order. Returns: number. Never blocks."""
        count = 0
        for key, _ in self._written.select(0):
            count += key.data.loopback.take(room, count)
        return count

    def receive(self, system_id: int, raw: bytes) -> None:
        """Keep a frame of a configured vehicle until `flush`."""
        self._waiting[self._of[system_id]].append(raw)

    def flush(self) -> None:
        """Give the kept frames to MAVSDK, many to a datagram. Frames without room are lost."""
        for fleet, frames in self._waiting.items():
            if not frames:
                continue
            datagram = bytearray()
            for raw in frames:
                if len(datagram) + len(raw) > _DATAGRAM_BYTES:
                    fleet.loopback.give(bytes(datagram))
                    datagram.clear()
                datagram += raw
            fleet.loopback.give(bytes(datagram))
            frames.clear()

    def discover(self, desired: Collection[int]) -> dict[int, MavsdkVehicle]:
        discovered: dict[int, MavsdkVehicle] = {}
        for fleet, ids in zip(self._fleets, self._ids, strict=True):
            missing = ids.intersection(desired)
            if missing:
                discovered |= fleet.discover(missing)
        return discovered

    def close(self) -> None:
        """End all instances; their plugins may not be used afterwards."""
        self._written.close()
        for fleet in self._fleets:
            fleet.destroy()
