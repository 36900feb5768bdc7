"""Settings of a link: endpoints, system ids, recording, signing, streams and forwarding. No I/O."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from ipaddress import AddressValueError, IPv4Address
from pathlib import Path
from typing import Annotated, Final, TypeAlias
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field, model_validator

from gcs.model.errors import ConfigError, InvalidError
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import VehicleId

FORMS: Final = (
    "udpin://HOST:PORT, udpout://HOST:PORT, tcpin://HOST:PORT, tcpout://HOST:PORT or serial://DEVICE:BAUD"
)

_NETWORK: Final = re.compile(r"^(?P<kind>udpin|udpout|tcpin|tcpout)://(?P<host>[^:/]+):(?P<port>\d{1,5})$")
_SERIAL: Final = re.compile(r"^serial://(?P<device>/?[^:]+):(?P<baud>\d{1,8})$")
_PORT_MAX: Final = 65535
_BAUD_MIN, _BAUD_MAX = 1200, 12_000_000

SYSTEM_ID_MAX: Final = 250

EXTRA_BYTES_PER_S: Final = 100_000.0
SERIAL_SHARE: Final = 0.25
"""What features may use unless set: so much, or this share of a serial port's rate."""

VEHICLES_MAX: Final = 64
"""Per MAVSDK instance."""

INSTANCES_MAX: Final = 16
"""Per process; the 20th was measured to speak MAVLink 1."""

_MAVSDK_ID: Final = 245
SPARE_ID: Final = 254  # 255 is used by most other stations

_FORWARD: Final = re.compile(r"^udp://(?P<host>\d{1,3}(?:\.\d{1,3}){3}):(?P<port>\d{1,5})$")


@dataclass(frozen=True, slots=True)
class Listen:
    """UDP ports to listen on: one per vehicle, or one for all behind a radio or router."""

    host: str
    first_port: int
    port_count: int = 1


@dataclass(frozen=True, slots=True)
class UdpOut:
    """Consecutive UDP ports of one host to send to first: one per vehicle, or one for all."""

    host: str
    first_port: int
    port_count: int = 1


@dataclass(frozen=True, slots=True)
class TcpIn:
    """A TCP port to which vehicles or routers connect."""

    host: str
    port: int


@dataclass(frozen=True, slots=True)
class TcpOut:
    """A TCP server to connect to, and to reconnect to."""

    host: str
    port: int


@dataclass(frozen=True, slots=True)
class SerialPort:
    """A serial device, whether present or not."""

    device: str
    baud: int


Place: TypeAlias = Listen | UdpOut | TcpIn | TcpOut | SerialPort


def parse(url: str, port_count: int = 1) -> Place:
    """The description of a URL.

    Args:
        url: one of `FORMS`.
        port_count: consecutive ports, of the UDP forms only.

    Raises: ConfigError with the URL and what is allowed.
    """
    serial = _SERIAL.match(url)
    if serial is not None:
        baud = int(serial["baud"])
        if not _BAUD_MIN <= baud <= _BAUD_MAX:
            raise ConfigError(f"{url}: a baud rate from {_BAUD_MIN} to {_BAUD_MAX} is needed")
        _refuse_many(url, port_count)
        return SerialPort(serial["device"], baud)
    network = _NETWORK.match(url)
    if network is None:
        raise ConfigError(f"{url}: {FORMS} is needed")
    kind, host, port = network["kind"], _numeric(url, network["host"]), int(network["port"])
    if not 1 <= port <= _PORT_MAX + 1 - port_count:
        raise ConfigError(f"{url}: ports {port} to {port + port_count - 1}: 1 to {_PORT_MAX} are possible")
    if kind == "udpin":
        return Listen(host, port, port_count)
    if kind == "udpout":
        return UdpOut(host, port, port_count)
    _refuse_many(url, port_count)
    return TcpIn(host, port) if kind == "tcpin" else TcpOut(host, port)


def serial_port(url: str) -> SerialPort:
    """The description of `serial://DEVICE:BAUD`. Raises: ConfigError."""
    place = parse(url)
    if not isinstance(place, SerialPort):
        raise ConfigError(f"{url} is not a serial port")
    return place


def _reachable(url: str) -> str:
    if url.startswith("serial:"):
        try:
            serial_port(url)
        except ConfigError as error:
            raise ValueError(error) from None
    elif not urlsplit(url).port:  # raises ValueError beyond 65535
        raise ValueError(f"{url}: a port from 1 to 65535 is needed")
    return url


Reachable: Final = AfterValidator(_reachable)
"""What a URL of a network needs beside its form: a port; and that of a serial port: a baud rate."""


def _numeric(url: str, host: str) -> str:
    """An IPv4 address. A host name would have to be resolved, which blocks, also in flight."""
    if host == "localhost":
        return "127.0.0.1"
    try:
        return str(IPv4Address(host))
    except AddressValueError:
        raise ConfigError(f"{url}: {host}: an IPv4 address in numbers is needed (or localhost)") from None


def _refuse_many(url: str, port_count: int) -> None:
    if port_count != 1:
        raise ConfigError(f"{url}: ports = {port_count}: only udpin and udpout can have more than one")


def occupied(place: Place) -> tuple[str, ...]:
    """What only one endpoint can use at a time: ports to listen on, devices."""
    match place:
        case Listen(host, first, count):
            return tuple(f"{host}:{port}" for port in range(first, first + count))
        case TcpIn(host, port):
            return (f"{host}:{port} (TCP)",)
        case SerialPort(device, _):
            return (device,)
        case _:
            return ()


def extra_bytes_per_s(places: Sequence[Place]) -> float:
    """What features may use of a link, where the configuration does not say."""
    serial = [SERIAL_SHARE * place.baud / 10 for place in places if isinstance(place, SerialPort)]
    return min(serial, default=EXTRA_BYTES_PER_S)


def station_id(vehicles: Collection[int]) -> int:
    """This station's own: MAVSDK's usual one, unless a vehicle has it."""
    return SPARE_ID if _MAVSDK_ID in vehicles else _MAVSDK_ID


def instances(vehicle_count: int) -> int:
    return -(-vehicle_count // VEHICLES_MAX)


def check_system_ids(vehicles: Mapping[VehicleId, int]) -> None:
    """Raises: InvalidError for an id out of range or used twice."""
    owners: dict[int, VehicleId] = {}
    for vehicle_id, system_id in vehicles.items():
        if not 1 <= system_id <= SYSTEM_ID_MAX:
            raise InvalidError(f"vehicles.{vehicle_id}", system_id, f"1 to {SYSTEM_ID_MAX}")
        if system_id in owners:
            raise InvalidError(
                f"vehicles.{vehicle_id}", system_id, f"another system id: {owners[system_id]} has it"
            )
        owners[system_id] = vehicle_id


class RecordSettings(Settings):
    """What is recorded of every flight.

    In `folder`: `audit.sqlite`, and for each run of the service a folder with flight data and with every
    frame of each link.
    """

    folder: Path
    """Folder of the records; one service at a time writes there."""
    flight: bool = True
    """Whether flight data are recorded at the tick's rate (MCAP)."""
    frames: bool = True
    """Whether every frame of each link is recorded (.tlog)."""


class SigningSettings(Settings):
    """MAVLink 2 signing. `link_id` distinguishes links that share a key."""

    key_file: Path
    """File of `gcs key create`: 32 bytes, raw, hex or base64; its folder must be writable."""
    link_id: Annotated[int, Field(ge=0, le=255)] = 0
    """Distinguishes links that share a key."""


class StreamSettings(Settings):
    """Rates of the vehicles' reports; `others_hz` is for messages that only further stations use."""

    position_hz: Positive = 10.0
    """Positions a second; the tick brings them forward with their velocities."""
    attitude_hz: NotNegative = 4.0
    """Attitudes a second, of which the wind is measured; 0: none, and the wind is not known."""
    state_hz: Positive = 5.0
    """Reports of battery, fix, mode and the like a second."""
    others_hz: NotNegative = 0.0
    """Messages a second that only further stations use; 0: none."""


class Forward(Settings):
    """A further ground station. What one that is not read-only may do: docs/decisions/mavlink.md."""

    url: Annotated[str, Field(pattern=_FORWARD.pattern)]
    """`udp://IP:PORT` of the station that receives."""
    read_only: bool = True
    """Whether what it sends is dropped."""

    @property
    def address(self) -> tuple[str, int]:
        """Host and port."""
        host, _, port = self.url.removeprefix("udp://").partition(":")
        return host, int(port)

    @model_validator(mode="after")
    def _check(self) -> "Forward":
        host, port = self.address
        try:
            IPv4Address(host)
        except AddressValueError as error:
            raise ValueError(f"url: {error}") from None
        if not 1 <= port <= 65535:
            raise ValueError(f"url: port {port}: 1 to 65535")
        return self
