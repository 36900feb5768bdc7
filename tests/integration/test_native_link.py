"""What only the native transport does: batches, our own heartbeat, stream rates."""

import asyncio
import socket
import time
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as dialect

from gcs.links import Verb
from gcs.links.endpoints.ports import Datagrams, host_number, socket_of, source_of
from gcs.links.endpoints.udp import UdpPorts
from gcs.links.link import FrameDirection
from gcs.links.native.link import NativeLink
from gcs.links.settings import Listen, StreamSettings
from gcs.links.stream_requests import desired_rates
from gcs.mavlink.kernels import Whole
from gcs.model.errors import LinkError
from gcs.model.frames import ShowFrame
from gcs.model.state import Setpoints
from tests.support.link_bench import Ticks, do, ready, running, until
from tests.support.link_peer import Peer
from tests.support.machine import free_ports

HOST = "127.0.0.1"


def direct(port: int, *system_ids: int, name: str = "bench") -> NativeLink:
    vehicles = {f"{name}{system_id}": system_id for system_id in system_ids}
    frame = ShowFrame(47.4, 8.5, 500.0)
    rates_hz = desired_rates(StreamSettings())
    listen = Listen(HOST, port)
    return NativeLink(name, vehicles, listen, frame, rates_hz=rates_hz)


def until_stamped(ports: UdpPorts, sender: socket.socket, port: int) -> None:
    """The kernel begins to stamp datagrams soon after a socket asks it to; before, when they are read."""
    stamped: list[bool] = []
    while not any(stamped):
        assert len(stamped) < 500
        sender.sendto(b"?", (HOST, port))
        sent_s = time.monotonic()
        time.sleep(0.02)

        def take(arrived: Datagrams, sent_s: float = sent_s) -> None:
            stamped.append(bool((arrived.time_s < sent_s + 0.01).all()))

        ports.receive(take)


def test_datagrams_come_and_go_in_batches_with_the_kernels_times() -> None:
    port = free_ports(2)
    ports = UdpPorts("bench", Listen(HOST, port, 2), time.monotonic)
    ports.open()
    with closing(ports), closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as one:
        one.bind((HOST, 0))
        until_stamped(ports, one, port)
        before_s = time.monotonic()
        for number in range(1000):  # more than one batch, more than there is room for at once
            one.sendto(bytes([number % 251]) * (1 + number % 7), (HOST, port + number % 2))
        after_s = time.monotonic()
        time.sleep(0.2)  # a stalled loop is the subject
        came: list[Datagrams] = []

        def take(arrived: Datagrams) -> None:
            came.append(arrived._replace(data=arrived.data.copy()))

        for _ in range(50):  # a turn has 20 ms, in which a busy machine reads only some
            ports.receive(take)
        assert sum(len(part.start) for part in came) == 1000
        for part in came:
            for start, length, source in zip(part.start, part.length, part.source.tolist(), strict=True):
                data = part.data[start : start + length]
                assert (data == data[0]).all()
                assert ports.address(source)[:2] == one.getsockname()
                assert socket_of(source) in (0, 1)
            assert (part.time_s > before_s - 1.0).all()  # older where the machine pauses between two clocks
            assert (part.time_s < after_s + 0.05).all()
        destination = np.array([came[0].source[0], -1, came[0].source[0]])
        data = np.arange(12, dtype=np.uint8).reshape(3, 4)
        assert ports.send(data, np.array([1, 2, 4]), destination).tolist() == [True, False, True]
        assert [one.recv(10), one.recv(10)] == [b"\0", b"\x08\x09\x0a\x0b"]
    assert not ports.send(data, np.array([1, 2, 4]), destination).any()


def test_each_socket_sends_once_in_any_order(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[int, int]] = []
    send_all = UdpPorts._send_all

    def counted(ports: UdpPorts, destination: Whole, *more: Any) -> None:
        calls.append(more[1:3])
        send_all(ports, destination, *more)

    monkeypatch.setattr(UdpPorts, "_send_all", counted)
    ports = UdpPorts("bench", Listen(HOST, port := free_ports(2), 2), time.monotonic)
    ports.open()
    with closing(ports), closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as one:
        one.bind((HOST, 0))
        one.settimeout(60.0)
        number = host_number(HOST)
        to = [source_of(number, one.getsockname()[1], index) for index in (0, 1)]
        destination = np.array([to[row % 2] for row in range(10)])
        destination[4] = -1
        data = np.arange(10, dtype=np.uint8)[:, None].repeat(4, axis=1)
        left = ports.send(data, np.full(10, 4), destination)
        assert left.tolist() == [row != 4 for row in range(10)]
        came = [one.recvfrom(16) for _ in range(9)]
    assert [end - first for first, end in calls] == [4, 5]
    assert [(stated[0], place[1] - port) for stated, place in came] == [
        *((row, 0) for row in (0, 2, 6, 8)),
        *((row, 1) for row in (1, 3, 5, 7, 9)),
    ]


@pytest.mark.parametrize("length", [65, 1400])  # 64 of the longer ones are too many for one piece
def test_adjacent_datagrams_to_one_address_stay_separate(length: int) -> None:
    ports = UdpPorts("bench", Listen(HOST, free_ports()), time.monotonic)
    ports.open()
    receivers = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    with closing(ports), closing(receivers[0]), closing(receivers[1]):
        for receiver in receivers:
            receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
            receiver.bind((HOST, 0))
            receiver.setblocking(False)
        number = host_number(HOST)
        sources = np.array([source_of(number, receiver.getsockname()[1], 0) for receiver in receivers])
        to = (np.arange(200) >= 150).astype(int)
        to[[20, 30]] = 1
        data = np.arange(200, dtype=np.uint8)[:, None].repeat(length, axis=1)
        lengths = np.full(200, length)
        lengths[100:103] = 11, 12, 11
        for _ in range(2):
            assert ports.send(data, lengths, sources[to]).all()
            for which, receiver in enumerate(receivers):
                came = [receiver.recv(2048) for _ in range((to == which).sum())]
                desired = [data[row, : lengths[row]].tobytes() for row in np.flatnonzero(to == which)]
                assert came == desired
                with pytest.raises(BlockingIOError):
                    receiver.recv(2048)
        assert ports.send_errors == 0


def test_a_port_in_use_is_named_and_no_other_stays_open() -> None:
    port = free_ports(2)
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as taken:
        taken.bind((HOST, port + 1))
        with pytest.raises(LinkError, match=f"UDP port {port + 1} on {HOST}: another program has it"):
            UdpPorts("bench", Listen(HOST, port, 2), time.monotonic).open()
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as free:
        free.bind((HOST, port))


def intervals(peer: Peer) -> list[tuple[float, float]]:
    return [(m.param1, m.param2) for _, m in peer.messages("COMMAND_LONG") if m.command == 511]


def test_stream_rates_are_requested_again_after_a_reboot() -> None:
    async def main(peer: Peer, link: NativeLink) -> None:
        async with running(link):
            await until(lambda: link._streams.settled.all() and intervals(peer))
            assert (33.0, 100_000.0) in intervals(peer)
            assert (31.0, -1.0) in intervals(peer)  # quaternions: of no use to this station
            before = intervals(peer).count((33.0, 100_000.0))
            late = dialect.MAVLink_global_position_int_message(60_000, 1, 1, 0, 0, 0, 0, 0, 0)
            peer.send(late)  # its other ones say 0: it has just begun anew
            await until(lambda: intervals(peer).count((33.0, 100_000.0)) > before)

    with Peer(port := free_ports(), 1) as peer:
        asyncio.run(main(peer, direct(port, 1)))


def test_several_links_carry_the_same_system_ids() -> None:
    async def main(one: NativeLink, other: NativeLink, first: Peer, second: Peer) -> None:
        async with running(one), running(other):
            await asyncio.gather(ready(one), ready(other))
            await do(other, Verb.ARM, "b1")
            assert (first.armed, second.armed) == (False, True)
            assert (one.snapshot().armed, other.snapshot().armed) == ((False,), (True,))

    port = free_ports(2)
    with Peer(port, 1) as first, Peer(port + 1, 1) as second:
        asyncio.run(main(direct(port, 1, name="a"), direct(port + 1, 1, name="b"), first, second))


def test_stale_batch_is_refused_whole() -> None:
    async def main(peer: Peer, link: NativeLink) -> None:
        async with running(link):
            await ready(link)
            link.send(Setpoints(time.monotonic() - 0.19, link.ids, np.zeros((1, 3)), np.zeros(1)))
            await asyncio.sleep(0.3)
            assert peer.messages("SET_POSITION_TARGET_LOCAL_NED") == []
            assert (link.setpoints_sent, link.counters.setpoints_dropped) == (0, 1)

    with Peer(port := free_ports(), 1) as peer:
        asyncio.run(main(peer, direct(port, 1)))


def test_observers_receive_every_delivered_frame() -> None:
    async def main(peer: Peer, link: NativeLink) -> None:
        async with running(link):
            await ready(link)
            seen: list[tuple[FrameDirection, bytes, int]] = []
            stop = link.observe(lambda _time_s, way, data, system_id: seen.append((way, data, system_id)))
            async with Ticks(link, "bench1").running():
                await until(lambda: peer.messages("SET_POSITION_TARGET_LOCAL_NED"))
                await until(lambda: len(seen) > 10)
            stop()
            (_, message), *_ = peer.messages("SET_POSITION_TARGET_LOCAL_NED")
            assert (FrameDirection.SENT, bytes(message.get_msgbuf()), 1) in seen
            received = [data for way, data, _ in seen if way is FrameDirection.RECEIVED]
            names = {dialect.MAVLink(None).decode(bytearray(data)).get_type() for data in received}
            assert "GLOBAL_POSITION_INT" in names

    with Peer(port := free_ports(), 1) as peer:
        asyncio.run(main(peer, direct(port, 1)))
