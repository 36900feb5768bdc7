from time import monotonic

import pytest

from gcs.links.endpoints.ports import host_number, source_of
from gcs.links.endpoints.streams import LinkPorts
from gcs.links.settings import Listen, Place, SerialPort, TcpIn, TcpOut, UdpOut, occupied, parse
from gcs.model.errors import ConfigError


@pytest.mark.parametrize(
    ("url", "ports", "place", "taken"),
    [
        ("udpin://127.0.0.1:14540", 2, Listen("127.0.0.1", 14540, 2), ("127.0.0.1:14540", "127.0.0.1:14541")),
        ("udpin://localhost:65535", 1, Listen("127.0.0.1", 65535), ("127.0.0.1:65535",)),
        ("udpout://10.0.0.7:14580", 3, UdpOut("10.0.0.7", 14580, 3), ()),
        ("tcpin://127.0.0.1:5760", 1, TcpIn("127.0.0.1", 5760), ("127.0.0.1:5760 (TCP)",)),
        ("tcpout://10.0.0.7:5760", 1, TcpOut("10.0.0.7", 5760), ()),
        ("serial:///dev/ttyACM0:921600", 1, SerialPort("/dev/ttyACM0", 921600), ("/dev/ttyACM0",)),
    ],
)
def test_url_is_an_endpoint(url: str, ports: int, place: Place, taken: tuple[str, ...]) -> None:
    assert parse(url, ports) == place
    assert occupied(place) == taken


@pytest.mark.parametrize(
    ("url", "ports", "cause"),
    [
        ("", 1, "is needed"),
        ("udp://127.0.0.1:14540", 1, "udpin://HOST:PORT"),
        ("udpin://127.0.0.1", 1, "is needed"),
        ("udpin://127.0.0.1:0", 1, "ports 0 to 0"),
        ("udpin://127.0.0.1:65535", 2, "65535 to 65536"),
        ("udpin://127.0.0.256:14540", 1, "in numbers"),
        ("udpout://drone.local:14540", 1, "in numbers"),
        ("tcpin://127.0.0.1:5760", 2, "only udpin and udpout"),
        ("serial:///dev/ttyUSB0:57600", 2, "only udpin and udpout"),
        ("serial:///dev/ttyUSB0", 1, "is needed"),
        ("serial:///dev/ttyUSB0:300", 1, "baud"),
    ],
)
def test_invalid_endpoint_is_refused_by_name(url: str, ports: int, cause: str) -> None:
    with pytest.raises(ConfigError, match=cause) as refused:
        parse(url, ports)
    assert str(refused.value).startswith(f"{url}: ")


def test_every_port_has_an_index_and_some_may_send_first() -> None:
    places: list[Place] = [
        TcpOut("10.0.0.7", 5760),
        Listen("127.0.0.1", 14540, 2),
        SerialPort("/dev/ttyACM0", 57600),
        UdpOut("10.0.0.7", 14580, 2),
    ]
    ports = LinkPorts("link", places, monotonic)
    assert ports.udp_count == 4
    assert [ports.address(source) for source in ports.standing()] == [
        ("10.0.0.7", 14580, 2),
        ("10.0.0.7", 14581, 3),
    ]
    assert ports.address(source_of(host_number("10.0.0.7"), 5760, 4)) == ("10.0.0.7", 5760, 4)
    assert str(ports.address(source_of(0, 0, 5))) == "/dev/ttyACM0"
