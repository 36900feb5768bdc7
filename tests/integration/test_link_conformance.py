"""What every link must do: each transport over each kind of connection, signed, and forwarded.

In `make test` the first story runs so, and each other one over each kind of connection with one transport.
"""

import asyncio
import socket
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as dialect

from gcs.links import Command, Verb
from gcs.links.settings import Forward, Listen, Place, SerialPort, TcpIn
from gcs.links.signing import Signing
from gcs.mavlink.codec import split
from gcs.model.errors import CommandError
from gcs.model.state import Mode
from tests.support.link_bench import AnyLink, Ticks, a_link, do, ready, repeated, running, until
from tests.support.link_lines import Line, SerialLine, TcpLine, UdpLine
from tests.support.link_peer import Peer
from tests.support.machine import Pauses, free_ports
from tests.support.wire_bench import a_socket

KEY = bytes(range(32))
REAL32 = 9
SETPOINT_TIMEOUT_S = 0.2

pytestmark = pytest.mark.usefixtures("transport")
CONNECTIONS = ["udp", "tcp", "serial", "signed", "forwarded"]


@dataclass
class Setup:
    """A link, the lines to it, and what the connection has beside them."""

    kind: str
    folder: Path
    stack: ExitStack
    port: int = field(default_factory=free_ports)
    station: socket.socket | None = None
    lines: int = 0

    def line(self) -> Line:
        """A further line to the link, from an address of its own."""
        self.lines += 1
        if self.kind == "tcp":
            return TcpLine(self.port)
        if self.kind == "serial":
            return SerialLine(self.folder / f"tty{self.lines}")
        return UdpLine(self.port)

    def peer(self) -> Peer:
        """A vehicle with the system id 1; each signs as another sender."""
        key = KEY if self.kind == "signed" else None
        line = self.line()
        made = Peer(self.port, 1, line=line, key=key, signs_as=self.lines)
        made.parameters["MPC_XY_VEL_MAX"] = (7.5, REAL32)
        return self.stack.enter_context(made)

    def link(self) -> AnyLink:
        places: list[Place] = [Listen("127.0.0.1", self.port)]
        signing: Signing | None = None
        forward: tuple[Forward, ...] = ()
        if self.kind == "tcp":
            places = [TcpIn("127.0.0.1", self.port)]
        elif self.kind == "serial":
            places = [SerialPort(str(self.folder / f"tty{number}"), 921600) for number in (1, 2)]
        elif self.kind == "signed":
            file = self.folder / "key"
            file.write_bytes(KEY)
            file.chmod(0o600)
            signing = Signing(file, 5)
        elif self.kind == "forwarded":
            self.station = self.stack.enter_context(a_socket())
            url = f"udp://127.0.0.1:{self.station.getsockname()[1]}"
            forward = (Forward(url=url, read_only=False),)
        return a_link(0, [1], places=places, signing=signing, forward=forward)


Story = Callable[[Setup, AnyLink, Peer], Awaitable[None]]


@pytest.fixture(params=CONNECTIONS)
def fly(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[Story], None]:
    """Runs a story with a link that is ready and its vehicle."""

    def run(story: Story) -> None:
        with ExitStack() as stack:
            setup = Setup(request.param, tmp_path, stack)
            peer, link = setup.peer(), setup.link()

            async def main() -> None:
                async with running(link):
                    await ready(link)
                    await story(setup, link, peer)

            asyncio.run(main())
            if setup.kind == "signed":
                accepted = [message for _, message in peer.received if message.get_msgId() >= 0]
                assert all(message.get_signed() for message in accepted)

    return run


def setpoints(peer: Peer) -> list[float]:
    return [time_s for time_s, _ in peer.messages("SET_POSITION_TARGET_LOCAL_NED")]


def is_at(link: AnyLink, line: Line) -> bool:
    """Whether the link reaches the vehicle over this line."""
    address = link.addresses.get("v1")
    return address is not None and address[:2] == line.address


def test_telemetry_commands_and_parameters(fly: Callable[[Story], None]) -> None:
    async def story(setup: Setup, link: AnyLink, peer: Peer) -> None:
        newest = link.snapshot()
        assert newest.latitude_deg == pytest.approx([47.4])
        assert newest.battery_remaining == pytest.approx([0.8])
        assert newest.mode == (Mode.HOLD,)
        assert is_at(link, peer.line)
        await do(link, Verb.ARM, "v1")
        assert peer.armed
        assert dict(await link.read_parameters("v1", ["MPC_XY_VEL_MAX"])) == {"MPC_XY_VEL_MAX": 7.5}
        await link.set_parameter("v1", "MPC_XY_VEL_MAX", 9.25)
        assert peer.parameters["MPC_XY_VEL_MAX"][0] == 9.25
        await do(link, Verb.DISARM, "v1")
        if setup.station is not None:
            await answered(setup.station, link, peer)

    fly(story)


async def answered(station: socket.socket, link: AnyLink, peer: Peer) -> None:
    """The further station receives the vehicle's frames; its command passes, its setpoint does not."""
    async with asyncio.timeout(60):
        data, ground = await asyncio.get_running_loop().sock_recvfrom(station, 2048)
    assert {frame.system_id for frame in split(data).frames} == {1}
    other = dialect.MAVLink(None, srcSystem=255, srcComponent=190)
    refused = dialect.MAVLink_manual_control_message(1, 0, 0, 0, 0, 0)
    given = dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    station.sendto(bytes(refused.pack(other)) + bytes(given.pack(other)), ("127.0.0.1", ground[1]))
    await until(lambda: peer.armed)
    assert (link.counters.taken_from_others, link.counters.refused_from_others) == (1, 1)
    assert not peer.messages("MANUAL_CONTROL")


@pytest.mark.alternates(0)
def test_setpoints_flow_and_stop_with_the_ticks(fly: Callable[[Story], None]) -> None:
    async def story(_setup: Setup, link: AnyLink, peer: Peer) -> None:
        ticks = Ticks(link, "v1")
        await do(link, Verb.ARM, "v1")
        with Pauses() as machine:
            async with ticks.running():
                await until(lambda: len(setpoints(peer)) > 5)
                await ticks.offboard()
                await until(lambda: peer.messages("HEARTBEAT"))
            await ticks.last()
            dropped = link.counters.setpoints_dropped
            await repeated(link, 6, since=dropped)
            await until(lambda: time.monotonic() > ticks.last_s + 0.5)
            left_s = link.setpoint_times_s("v1")
            assert machine.awake_s(ticks.last_s, left_s[-1]) <= SETPOINT_TIMEOUT_S
        await until(lambda: len(setpoints(peer)) == link.setpoints_sent)
        assert link.setpoint_times_s("v1") == left_s
        (_, newest), *_ = reversed(peer.messages("SET_POSITION_TARGET_LOCAL_NED"))
        assert (newest.target_system, newest.vx, newest.vy) == (1, 1.0, 0.5)

    fly(story)


@pytest.mark.alternates(1)
def test_kill_overtakes_and_outlives_a_waiting_command(fly: Callable[[Story], None]) -> None:
    async def story(_setup: Setup, link: AnyLink, peer: Peer) -> None:
        ticks = Ticks(link, "v1")
        async with ticks.running():
            await until(lambda: setpoints(peer))
            peer.answers = False
            arming = asyncio.create_task(link.execute(Command("v1", Verb.ARM)))
            await until(lambda: arms(peer))
            peer.armed = peer.answers = True
            peer.acknowledges = False
            await do(link, Verb.KILL, "v1")
            killed_s = time.monotonic()
            assert not peer.armed
            with pytest.raises(CommandError):
                await arming
            before = len(link.setpoint_times_s("v1"))
            await asyncio.sleep(0.3)
            assert len(link.setpoint_times_s("v1")) == before, "no setpoint to a killed vehicle"
        after = [message for time_s, message in arms(peer) if time_s > killed_s]
        assert all((message.param1, message.param2) == (0.0, 21196.0) for message in after)
        peer.acknowledges = True
        await do(link, Verb.ARM, "v1")

    fly(story)


def arms(peer: Peer) -> list[tuple[float, Any]]:
    return [each for each in peer.messages("COMMAND_LONG") if each[1].command == 400]


@asynccontextmanager
async def second(setup: Setup) -> AsyncIterator[Peer]:
    """Another vehicle with the same system id, at another address."""
    peer = setup.peer()
    try:
        yield peer
    finally:
        peer.speaks = False
        peer.line.lose()


@pytest.mark.alternates(0)
def test_garbage_duplicates_and_a_lost_connection(fly: Callable[[Story], None]) -> None:
    async def story(setup: Setup, link: AnyLink, peer: Peer) -> None:
        peer.send_bytes(b"\xfd\x09\x00" + bytes(400) + b"\xfe\x02")
        await until(lambda: link.counters.garbage_bytes > 300)
        async with second(setup) as other:
            await until(lambda: link.conflicts)
            for line in (peer.line, other.line):
                host, port = line.address
                assert (f"{host}:{port}" if port else host) in link.conflicts["v1"]
            await do(link, Verb.ARM, "v1")
            assert (peer.armed, other.armed) == (True, False)
        before = peer.line.address
        peer.line.lose()
        if setup.kind in ("tcp", "serial"):
            await until(lambda: "v1" not in link.addresses)
        else:  # a vehicle may speak from another address when it was silent for so long
            await asyncio.sleep(3.1)
        peer.line.restore()
        await until(lambda: is_at(link, peer.line))
        assert peer.line.address != before or setup.kind == "serial"
        await until(lambda: all(link.snapshot().ready))
        await do(link, Verb.DISARM, "v1")
        assert not peer.armed

    fly(story)
