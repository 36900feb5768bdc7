"""URLs of endpoints, parsed to plain descriptions. Nothing is opened here."""

import re
from dataclasses import dataclass
from ipaddress import AddressValueError, IPv4Address
from typing import Final, TypeAlias

from gcs.model.errors import ConfigError

FORMS: Final = (
    "udpin://HOST:PORT, udpout://HOST:PORT, tcpin://HOST:PORT, tcpout://HOST:PORT or serial://DEVICE:BAUD"
)

_NETWORK: Final = re.compile(r"^(?P<kind>udpin|udpout|tcpin|tcpout)://(?P<host>[^:/]+):(?P<port>\d{1,5})$")
_SERIAL: Final = re.compile(r"^serial://(?P<device>/?[^:]+):(?P<baud>\d{1,8})$")
_PORT_MAX: Final = 65535
_BAUD_MIN, _BAUD_MAX = 1200, 12_000_000


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
