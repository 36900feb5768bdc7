"""Construction of endpoints from their descriptions."""

from collections.abc import Iterable

from gcs.links.address_book import Address
from gcs.links.endpoints.endpoint import Endpoint
from gcs.links.endpoints.redialled import Redialled
from gcs.links.endpoints.serial_port import SerialDial
from gcs.links.endpoints.tcp import TcpDial, TcpServer
from gcs.links.endpoints.udp import Udp
from gcs.links.endpoints.urls import Listen, Place, SerialPort, TcpIn, TcpOut, UdpOut


def make(name: str, places: Iterable[Place]) -> tuple[Endpoint, ...]:
    """One endpoint for every port; its index is the socket index of its addresses. `name` is the link's."""
    made: list[Endpoint] = []
    for place in places:
        match place:
            case Listen(host, first, count):
                made += [Udp(name, len(made) + i, bound=(host, first + i)) for i in range(count)]
            case UdpOut(host, first, count):
                made += [Udp(name, len(made) + i, far=(host, first + i)) for i in range(count)]
            case TcpIn(host, port):
                made.append(TcpServer(name, len(made), host, port))
            case TcpOut(host, port):
                made.append(Redialled(name, Address(host, port, len(made)), TcpDial(host, port)))
            case SerialPort(device, baud):
                address = Address(device, 0, len(made))
                made.append(Redialled(name, address, SerialDial(device, baud)))
    return tuple(made)
