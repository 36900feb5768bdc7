"""Floods of a link's ports: little work in every tick, the sender is named, and no vehicle is missed."""

from collections.abc import Callable, Sequence
from itertools import cycle, islice
from math import inf
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as dialect

from gcs.links.endpoints.ports import Datagrams, Ports, host_number, source_of
from gcs.links.intake import TURN_S, of_vehicles
from gcs.links.link_intake import ONE_BY_ONE_MAX, newest_of_each
from gcs.links.native.link import NativeLink
from gcs.links.settings import Listen
from gcs.links.signing import Signing
from gcs.mavlink.codec import split
from gcs.mavlink.framing import Signer
from gcs.mavlink.kernels import LONGEST_FRAME, Bytes, Whole
from gcs.mavlink.signing_time import signing_time
from gcs.model.frames import ShowFrame
from tests.support.floods import FLOODS, frames, heartbeat, position
from tests.support.work import lines_run

COUNT = 6
IDS = tuple(range(1, COUNT + 1))
VEHICLES = [source_of(host_number("10.0.0.1"), 14550 + at, 0) for at in range(COUNT)]
STRANGER = source_of(host_number("192.0.2.9"), 4711, 0)
PER_S = 3000
TICKS = 40
LINES_MAX, LINES_MEAN = 60_000, 20_000
"""Python of one reading; a core runs so many in a few milliseconds. The first one has what was saved up."""

NOW = 1_790_000_000.0


class FloodedPorts(Ports):
    """Datagrams of any sender, as UDP ports give them."""

    def __init__(self) -> None:
        self.arrived: list[tuple[int, bytes]] = []
        self.now_s = 0.0

    def open(self) -> None:
        """Nothing to open."""

    def close(self) -> None:
        """Nothing to close."""

    def clock(self) -> float:
        return self.now_s

    def receive(self, take: Callable[[Datagrams], None]) -> None:
        arrived, self.arrived = self.arrived, []
        if arrived:
            length = np.array([len(datagram) for _, datagram in arrived])
            start = np.cumsum(length + LONGEST_FRAME) - length
            data = np.zeros(start[-1] + length[-1], np.uint8)
            for (_, datagram), at in zip(arrived, start.tolist(), strict=True):
                data[at : at + len(datagram)] = np.frombuffer(datagram, np.uint8)
            source = np.array([source for source, _ in arrived])
            take(Datagrams(data, start, length, source, np.full(len(arrived), self.now_s), LONGEST_FRAME))

    def send(
        self, data: Bytes, length: Whole, destination: Whole, *, until_s: float = inf
    ) -> NDArray[np.bool_]:
        return np.ones(len(destination), np.bool_)


class Flooded:
    """A link of six vehicles that send a heartbeat and a position in every tick."""

    def __init__(self, signing: Signing | None = None) -> None:
        self.ports = FloodedPorts()
        vehicles = {f"v{system_id}": system_id for system_id in IDS}
        self.link = NativeLink(
            "radio",
            vehicles,
            Listen("127.0.0.1", 1),
            ShowFrame(47.4, 8.5, 500.0),
            signing=signing,
            clock=self.ports.clock,
            ports=self.ports,
        )
        self.observed = 0
        self.link.observe(self._note)
        self._signer = None
        if signing is not None:
            self._signer = Signer(signing.signer._key, 1, start=0, clock=lambda: signing_time(NOW))
        (self._intake,) = self.link.counters.intakes

    def _note(self, *_: object) -> None:
        self.observed += 1

    def tick(self, flood: Sequence[bytes] = (), *sources: int) -> int:
        """One tick, in which the flood of these sources in turn arrives around what the vehicles send.

        Returns: lines of Python.
        """
        self.ports.now_s += TURN_S
        strangers = list(zip(islice(cycle(sources or (STRANGER,)), len(flood)), flood, strict=True))
        half, own = len(flood) // 2, list(zip(VEHICLES, self._sent(), strict=True))
        self.ports.arrived = strangers[:half] + own + strangers[half:]
        lines = lines_run(self.link._receive)
        assert lines < LINES_MAX
        return lines

    def _sent(self) -> list[bytes]:
        at, sent = round(self.ports.now_s / TURN_S), []
        for system_id in IDS:
            packer = dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)
            raws = [bytes(message(at).pack(packer)) for message in (heartbeat, position)]
            sent.append(
                b"".join(raws if self._signer is None else [self._signer.sign(raw) or b"" for raw in raws])
            )
        return sent

    def received(self) -> list[bool]:
        """Of each vehicle, whether its position of this tick has arrived."""
        received: list[bool] = (self.link._telemetry.position_time_s == self.ports.now_s).tolist()
        return received

    def named(self) -> str:
        return self._intake.why_over(self.ports.now_s)


@pytest.fixture
def signing(tmp_path: Path) -> Signing:
    file = tmp_path / "key"
    file.write_bytes(bytes(range(32)))
    file.chmod(0o600)
    return Signing(file, 5, wall_clock=lambda: NOW)


def in_a_tick(kind: str, per_s: float = PER_S) -> list[bytes]:
    return list(islice(cycle(FLOODS[kind](IDS)), round(per_s * TURN_S)))


def of_one_vehicle(kind: str) -> list[bytes]:
    return list(islice(cycle(FLOODS[kind](IDS[:1])), round(PER_S * TURN_S)))


BOUND = of_vehicles(COUNT)
NAMED = f"more than {BOUND.bytes_per_s / 1000:g} kB or {BOUND.messages_per_s:g} messages"


@pytest.mark.parametrize("kind", FLOODS)
def test_a_strangers_flood_is_little_work_and_named(kind: str) -> None:
    flooded, flood = Flooded(), in_a_tick(kind)
    for _ in range(5):
        flooded.tick()
    assert flooded.named() == ""
    lines = 0
    for _ in range(TICKS):
        lines += flooded.tick(flood)
        assert flooded.received() == [True] * COUNT
    assert lines / TICKS < LINES_MEAN
    if kind != "tiny":
        assert flooded.named() == f"{NAMED} a second from 192.0.2.9:4711"
    else:
        assert sum(len(datagram) + 28 for datagram in flood) / TURN_S < of_vehicles(COUNT).bytes_per_s


@pytest.mark.parametrize("kind", [kind for kind in FLOODS if kind not in {"strangers", "tiny"}])
def test_a_flood_from_one_vehicles_address_harms_no_other(kind: str) -> None:
    flooded, flood = Flooded(), of_one_vehicle(kind)
    for _ in range(5):
        flooded.tick()
    before = flooded.observed
    lines = 0
    for _ in range(TICKS):
        lines += flooded.tick(flood, VEHICLES[0])
        assert flooded.received()[1:] == [True] * (COUNT - 1)
    assert lines / TICKS < LINES_MEAN
    assert flooded.named() == f"{NAMED} a second from 10.0.0.1:14550"
    assert flooded.observed - before < 2.5 * of_vehicles(COUNT).messages_per_s


@pytest.mark.parametrize("kind", ["heartbeats", "wrongly-signed", "texts"])
@pytest.mark.parametrize("source", [STRANGER, VEHICLES[0]])
def test_a_flood_of_a_signed_link_costs_little(kind: str, source: int, signing: Signing) -> None:
    flooded, flood = Flooded(signing), in_a_tick(kind)
    for _ in range(5):
        flooded.tick()
        assert flooded.received() == [True] * COUNT
    lines = 0
    for _ in range(TICKS):
        lines += flooded.tick(flood, source)
        assert flooded.received()[1:] == [True] * (COUNT - 1)
    assert lines / TICKS < LINES_MEAN
    assert flooded.named()


def test_the_newest_messages_of_each_vehicle_are_read_one_by_one() -> None:
    rows = np.array([1, 0, *[1] * ONE_BY_ONE_MAX, 0])
    assert newest_of_each(rows).tolist() == [False, True, *[True] * ONE_BY_ONE_MAX, True]


def test_as_many_senders_as_datagrams_starve_no_vehicle() -> None:
    """Every datagram has another address, and some name a vehicle."""
    flooded, flood = Flooded(), in_a_tick("heartbeats")
    for _ in range(5):
        flooded.tick()
    for turn in range(TICKS):
        ports = (1 + (len(flood) * turn + at) % 60_000 for at in range(len(flood)))
        flooded.tick(flood, *(source_of(host_number("192.0.2.9"), port, 0) for port in ports))
        assert flooded.received() == [True] * COUNT
    assert "from 192.0.2.9:" in flooded.named()


def test_usual_traffic_after_a_stall_is_not_dropped() -> None:
    """Fast streams of an onboard computer, of a second in which the machine stood still."""
    flooded = Flooded()
    for _ in range(5):
        flooded.tick()
    flooded.ports.now_s += 1.0
    second = [
        (source, frames(position, [system_id])[0]) for source, system_id in zip(VEHICLES, IDS, strict=True)
    ]
    flooded.ports.arrived = second * 2  # 2.9 kB and 70 messages of each vehicle
    flooded.link._receive()
    assert flooded.link.counters.received == 5 * 2 * COUNT + 2 * sum(
        len(split(each).frames) for _, each in second
    )
    assert flooded.named() == ""
