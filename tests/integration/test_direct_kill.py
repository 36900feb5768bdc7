"""A kill without the service reaches vehicles over whatever the link is: signed, TCP both ways, serial."""

import os
import pty
import socket
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as dialect

from gcs.cli.kill.directly import KillPart, kill_directly
from gcs.cli.kill.plan import KillPlan, links_of
from gcs.model.errors import ConfigError
from tests.support.machine import free_ports

KEY, OTHER_KEY = bytes(range(32)), bytes(32)
KILL = (0.0, 21196.0)
SOON_S = 60.0
STUBBORN_S = 0.5
LOOK_S = 0.01

Send = Callable[[bytes], object]
Receive = Callable[[], bytes]
"""What has come; may be nothing."""


class Vehicle:
    """Armed, until a kill reaches it."""

    def __init__(
        self,
        send: Send,
        receive: Receive,
        key: bytes | None = None,
        *,
        system_id: int = 1,
        beats_s: float = 0.1,
    ) -> None:
        """With a `key` it signs, and believes nothing unsigned; a heartbeat comes every `beats_s`."""
        self.armed = True
        self._beats_s = beats_s
        self.beside: list[Any] = []  # further messages with each heartbeat
        self._send, self._receive = send, receive
        self._packer = dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)
        self._system_id = system_id
        self.parser = dialect.MAVLink(None)
        self.parser.robust_parsing = True
        if key is not None:
            self._packer.signing.secret_key = self.parser.signing.secret_key = key
            self._packer.signing.sign_outgoing = True
            self._packer.signing.timestamp = int((time.time() - 1_420_070_400) * 1e5)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._live, name="vehicle")
        self._thread.start()

    def close(self) -> None:
        """Fall silent."""
        self._over.set()
        self._thread.join()

    def _say(self, message: Any) -> None:
        self._send(message.pack(self._packer))

    def _live(self) -> None:
        due_s = 0.0
        while not self._over.wait(LOOK_S):
            if time.monotonic() >= due_s:
                due_s = time.monotonic() + self._beats_s
                self._say(dialect.MAVLink_heartbeat_message(2, 12, 1 | self.armed << 7, 6 << 16, 4, 3))
                for each in self.beside:
                    self._say(each)
            for message in self.parser.parse_buffer(self._receive()) or []:
                if message.get_type() != "COMMAND_LONG" or message.target_system != self._system_id:
                    continue
                if message.command == 400:
                    self.armed = self.armed and (message.param1, message.param2) != KILL
                    self._say(dialect.MAVLink_command_ack_message(400, 0))


def reader(sock: socket.socket) -> Receive:
    sock.setblocking(False)

    def receive() -> bytes:
        try:
            return sock.recv(2048)
        except BlockingIOError:
            return b""

    return receive


@contextmanager
def over_udp(key: bytes | None = None) -> Iterator[tuple[Vehicle, str]]:
    port = free_ports()
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as made:
        made.bind(("127.0.0.1", 0))
        with closing(
            Vehicle(lambda data: made.sendto(data, ("127.0.0.1", port)), reader(made), key)
        ) as vehicle:
            yield vehicle, f"udpin://127.0.0.1:{port}"


class Stream:
    """One TCP connection that comes when it comes; what is said before it stands is lost, as on a radio."""

    def __init__(self, come: Callable[[], socket.socket]) -> None:
        self._come = come
        self._connection: socket.socket | None = None

    def _there(self) -> socket.socket | None:
        if self._connection is None:
            try:
                self._connection = self._come()
                self._connection.setblocking(False)
            except (BlockingIOError, ConnectionError):
                return None
        return self._connection

    def send(self, data: bytes) -> None:
        """To the far end, if there is one."""
        connection = self._there()
        if connection is not None:
            with suppress(ConnectionError):  # the station is done, and has hung up
                connection.send(data)

    def receive(self) -> bytes:
        """What has come."""
        connection = self._there()
        try:
            return b"" if connection is None else reader(connection)()
        except ConnectionError:
            return b""

    def close(self) -> None:
        """The connection too."""
        if self._connection is not None:
            self._connection.close()


@contextmanager
def behind_a_tcp_server() -> Iterator[tuple[Vehicle, str]]:
    with closing(socket.socket()) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        listener.setblocking(False)
        port = listener.getsockname()[1]
        with (
            closing(Stream(lambda: listener.accept()[0])) as stream,
            closing(Vehicle(stream.send, stream.receive)) as vehicle,
        ):
            yield vehicle, f"tcpout://127.0.0.1:{port}"


@contextmanager
def that_dials_in() -> Iterator[tuple[Vehicle, str]]:
    port = free_ports()
    with (
        closing(Stream(lambda: socket.create_connection(("127.0.0.1", port), timeout=1.0))) as stream,
        closing(Vehicle(stream.send, stream.receive)) as vehicle,
    ):
        yield vehicle, f"tcpin://127.0.0.1:{port}"


@contextmanager
def on_a_cable() -> Iterator[tuple[Vehicle, str]]:
    master, near = pty.openpty()
    tty.setraw(near)
    os.set_blocking(master, False)

    def receive() -> bytes:
        try:
            return os.read(master, 2048)
        except BlockingIOError:
            return b""

    def send(data: bytes) -> None:
        try:
            os.write(master, data)
        except BlockingIOError:  # nothing reads yet, and the buffer is full
            return

    try:
        with closing(Vehicle(send, receive)) as vehicle:
            yield vehicle, f"serial://{os.ttyname(near)}:57600"
    finally:
        os.close(master)
        os.close(near)


def plan_of(url: str, at: tuple[str, int] | None = None, **link: object) -> KillPlan:
    raw = {"name": "far", "listen": url, "vehicles": [{"id": "d1", "system_id": 1}], **link}
    addresses = {} if at is None else {"d1": at}
    return KillPlan("test", links_of({"links": [raw]}, "test"), addresses)


def kill(plan: KillPlan, within_s: float = SOON_S) -> KillPart:
    return kill_directly(plan, ["d1"], within_s)["d1"]


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    file = tmp_path / "key"
    file.write_text(KEY.hex())
    file.chmod(0o600)
    return file


@pytest.mark.parametrize("way", [over_udp, behind_a_tcp_server, that_dials_in, on_a_cable])
def test_kill_without_the_service_reaches_the_vehicle(
    way: Callable[[], AbstractContextManager[tuple[Vehicle, str]]],
) -> None:
    with way() as (vehicle, url):
        assert kill(plan_of(url)) == KillPart(True, "its motors are off")
        assert not vehicle.armed


def test_stale_address_stops_no_other_vehicle() -> None:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as made:
        made.bind(("127.0.0.1", 0))
        silent = Vehicle(len, reader(made), system_id=2)
        with closing(silent) as other, over_udp() as (vehicle, url):
            assert kill(plan_of(url, made.getsockname())).done
            assert (vehicle.armed, other.armed) == (False, True)


def test_heartbeats_from_another_host_confirm_no_kill() -> None:
    with over_udp() as (vehicle, url):
        reported = kill(plan_of(url, ("192.0.2.7", 14580)), STUBBORN_S)
        assert not vehicle.armed, "the commands go there as well"
        assert not reported.done
        assert "its id is sent from 127.0.0.1, and it was at 192.0.2.7: look at" in reported.reason


@pytest.mark.parametrize("of_one_radio", [False, True])
def test_of_two_that_send_one_id_both_must_stop(*, of_one_radio: bool) -> None:
    """The other one's next heartbeat comes a second after its first, as those of autopilots do."""
    port = free_ports()
    with (
        closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as made,
        closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as another,
    ):
        made.bind(("127.0.0.1", 0))
        another.bind(("127.0.0.1", 0))
        second = made if of_one_radio else another
        to = ("127.0.0.1", port)
        with (
            closing(Vehicle(lambda data: made.sendto(data, to), reader(made), beats_s=1.0)) as vehicle,
            closing(Vehicle(lambda data: second.sendto(data, to), lambda: b"", beats_s=1.0)),
        ):
            reported = kill(plan_of(f"udpin://127.0.0.1:{port}"), 3.5)
        assert not vehicle.armed
    assert not reported.done
    assert "its motors were not seen to stop" in reported.reason


def test_vehicle_that_requires_signing_is_killed_with_the_key(key_file: Path) -> None:
    with over_udp(KEY) as (vehicle, url):
        reported = kill(plan_of(url, signing={"key_file": str(key_file), "link_id": 5}))
        assert reported.done, reported.reason
        link_ids = {link_id for link_id, *_ in vehicle.parser.signing.stream_timestamps}
        assert link_ids == {255}, "frames of a service that goes on are not taken for repeated ones"
        assert not vehicle.armed


def test_another_key_does_not_kill_and_reports_no_success(key_file: Path) -> None:
    with over_udp(OTHER_KEY) as (vehicle, url):
        reported = kill(plan_of(url, signing={"key_file": str(key_file), "link_id": 5}), STUBBORN_S)
        assert vehicle.armed
        assert not reported.done


def test_what_is_no_autopilot_confirms_no_kill() -> None:
    with over_udp(OTHER_KEY) as (vehicle, url):
        vehicle.beside = [
            dialect.MAVLink_command_ack_message(400, 0, 0, 0, 255, 190),
            dialect.MAVLink_heartbeat_message(18, dialect.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3),
        ]
        reported = kill(plan_of(url), STUBBORN_S)
        assert (vehicle.armed, reported.done) == (True, False)
        assert "accepted" not in reported.reason


def test_unreadable_key_is_named_before_anything_is_sent(tmp_path: Path) -> None:
    with over_udp(KEY) as (vehicle, url):
        plan = plan_of(url, signing={"key_file": str(tmp_path / "none"), "link_id": 5})
        with pytest.raises(ConfigError, match="none"):
            kill(plan)
        assert vehicle.armed


def test_unplugged_cable_is_reported() -> None:
    reported = kill(plan_of("serial:///dev/gcs-is-not-there:57600"), STUBBORN_S)
    assert not reported.done
    assert "nothing could be sent" in reported.reason
