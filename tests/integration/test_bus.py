"""The bus on loopback, in memory and over Zenoh: newest wins, what is gone is noticed, strangers refused."""

import asyncio
import json
import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
import zenoh

from gcs.bus import PAYLOAD_MAX
from gcs.bus.bundles import BUNDLE_MAX, bundles
from gcs.bus.keys import make_site_keys
from gcs.bus.settings import Endpoint, key_files
from gcs.bus.shared_memory import shared_file
from gcs.bus.zenoh_bus import KEPT, ZenohBus
from gcs.bus.zenoh_config import configuration
from gcs.model.errors import LinkError
from tests.support.bus_stations import bus_of, endpoints_of, opened, process_of, until

FOUR = ("north", "east", "south", "west")
SHARED_FILE = "gcs.bus.zenoh_bus.shared_file"


@pytest.fixture(params=["memory", "network"], autouse=True)
def _carried(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The buses of this process share memory, or none, as if their stations were on several hosts."""
    if request.param == "network":
        monkeypatch.setattr(SHARED_FILE, lambda _: tmp_path / "of another host" / "file")


async def all_present(*buses: ZenohBus) -> None:
    """Wait until these buses, and no other, know each other."""
    names = {bus.station for bus in buses}
    await until("present", lambda: all(bus.present == names - {bus.station} for bus in buses))


class Inbox:
    """What one bus received, newest by sender and topic."""

    def __init__(self, bus: ZenohBus) -> None:
        self._bus = bus
        self.newest: dict[tuple[str, str], bytes] = {}

    def collect(self) -> int:
        """Take what arrived. Returns: the number of messages."""
        received = self._bus.newest()
        self.newest |= {(one.sender, one.topic): one.payload for one in received}
        return len(received)

    async def has(self, sender: str, topic: str, payload: bytes) -> None:
        """Wait until this message is the newest."""

        def arrived() -> bool:
            self.collect()
            return self.newest.get((sender, topic)) == payload

        await until(f"{topic} of {sender}", arrived)


async def receive_each_other(buses: Sequence[ZenohBus]) -> None:
    """Each publishes its name, and receives that of every other one, and no more."""
    await all_present(*buses)
    for bus in buses:
        bus.publish({"states": bus.station.encode()})
    for bus in buses:
        inbox, others = Inbox(bus), {one.station for one in buses if one is not bus}
        for name in others:
            await inbox.has(name, "states", name.encode())
        assert inbox.newest.keys() == {(name, "states") for name in others}


@pytest.mark.parametrize("stations", [2, 3, 4])
def test_stations_exchange_their_newest_messages(stations: int) -> None:
    endpoints = endpoints_of(*FOUR[:stations])
    buses = [bus_of(name, endpoints) for name in endpoints]

    async def story() -> None:
        async with opened(*buses):
            await all_present(*buses)
            for number in range(5):
                for bus in buses:
                    bus.publish({"states": f"{bus.station}{number}".encode()})
            for bus in buses:
                inbox = Inbox(bus)
                for other in buses:
                    if other is not bus:
                        await inbox.has(other.station, "states", f"{other.station}4".encode())
                assert {sender for sender, _ in inbox.newest} == endpoints.keys() - {bus.station}
                assert bus.newest() == []

    asyncio.run(story())


def test_a_station_that_shares_no_memory_is_received_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    endpoints = endpoints_of("north", "south", "west")
    buses = [bus_of(name, endpoints) for name in endpoints]
    elsewhere = {endpoints["west"]: tmp_path / "of another user" / "file"}
    monkeypatch.setattr(SHARED_FILE, lambda one: elsewhere.get(one) or shared_file(one))

    async def story() -> None:
        async with opened(*buses):
            await receive_each_other(buses)

    asyncio.run(story())
    assert {vars(one)["other"] for one in caplog.records if one.msg == "memory_not_shared"} == {"west"}


def test_only_the_newest_of_many_messages_is_returned() -> None:
    endpoints = endpoints_of("north", "south")
    north, south = bus_of("north", endpoints), bus_of("south", endpoints)

    async def story() -> None:
        async with opened(north, south):
            await all_present(north, south)
            for number in range(10):
                north.publish({"states": bytes([number])})
                north.publish({"slots.south": bytes([100 + number])})
                await asyncio.sleep(0.005)
            await asyncio.sleep(0.5)
            received = south.newest()
            assert {(one.topic, one.payload) for one in received} == {
                ("states", bytes([9])),
                ("slots.south", bytes([109])),
            }
            now_s = time.monotonic()
            assert all(now_s - 1.0 < one.time_s <= now_s for one in received)

    asyncio.run(story())


def test_a_killed_station_is_gone_and_returns() -> None:
    endpoints = endpoints_of("north", "south", "west")
    north, west = bus_of("north", endpoints), bus_of("west", endpoints)

    async def story() -> None:
        async with opened(north, west):
            for _ in range(2):  # a station that was started again is known again
                with process_of("south", endpoints) as process:
                    await until("present", lambda: north.present == {"south", "west"})
                    inbox = Inbox(north)
                    await inbox.has("south", "states", b"south")
                    process.kill()
                    await all_present(north, west)
                assert north.present == {"west"}

    asyncio.run(story())


def test_a_hanging_station_is_gone_after_its_lease() -> None:
    endpoints = endpoints_of("north", "south")
    north = bus_of("north", endpoints)

    async def story() -> None:
        async with opened(north):
            with process_of("south", endpoints) as process:
                await until("present", lambda: north.present == {"south"})
                os.kill(process.pid, signal.SIGSTOP)
                longest_s = 0.0
                while "south" in north.present:
                    begin_s = time.thread_time()
                    north.publish({"states": bytes(PAYLOAD_MAX)})
                    longest_s = max(longest_s, time.thread_time() - begin_s)
                    await asyncio.sleep(0.01)
                assert longest_s < 0.05  # of this thread: the pauses of the machine do not count
                os.kill(process.pid, signal.SIGCONT)
                await until("present again", lambda: north.present == {"south"})

    asyncio.run(story())


def test_the_order_of_starts_does_not_matter() -> None:
    endpoints = endpoints_of("north", "south")

    async def story() -> None:
        for first, second in (("north", "south"), ("south", "north")):
            one, other = bus_of(first, endpoints), bus_of(second, endpoints)
            async with opened(one):
                await asyncio.sleep(1.0)  # its first attempts to connect have failed
                assert one.present == frozenset()
                async with opened(other):
                    await all_present(one, other)
                await all_present(one)

    asyncio.run(story())


def test_a_bus_that_cannot_listen_says_where() -> None:
    endpoints = endpoints_of("north", "south")
    taken = bus_of("north", endpoints)

    async def story() -> None:
        async with opened(taken):
            probe = bus_of("south", endpoints)
            async with opened(probe):
                await all_present(taken, probe)
                again = bus_of("north", endpoints)
                with pytest.raises(LinkError, match=f"127.0.0.1:{endpoints['north'].port}"):
                    await again.run()

    asyncio.run(story())


def test_a_payload_that_is_too_large_is_refused() -> None:
    endpoints = endpoints_of("north", "south")
    north, south = bus_of("north", endpoints), bus_of("south", endpoints)

    async def story() -> None:
        north.publish({"states": b"before it is open"})
        async with opened(north, south):
            await all_present(north, south)
            with pytest.raises(LinkError, match=f"{PAYLOAD_MAX + 1} bytes where {PAYLOAD_MAX} are possible"):
                north.publish({"states": bytes(PAYLOAD_MAX + 1)})
            north.publish({"states": bytes(PAYLOAD_MAX)})
            await Inbox(south).has("north", "states", bytes(PAYLOAD_MAX))

    asyncio.run(story())


def test_a_larger_message_of_another_program_is_dropped() -> None:
    endpoints = endpoints_of("north", "south", "rogue")
    north = bus_of("north", endpoints)

    async def story() -> None:
        async with opened(north):
            with zenoh.open(configuration("rogue", endpoints, None)) as session:
                token = session.liveliness().declare_token("gcs/rogue/alive")
                await until("present", lambda: north.present == {"rogue"})
                inbox = Inbox(north)
                (after,) = bundles({"after": b"1"})

                def arrived() -> bool:  # a busy machine misses the lease, and loses what was sent meanwhile
                    session.put("gcs/rogue/bundles", bytes(BUNDLE_MAX + 100))
                    session.put("gcs/rogue/bundles", after)
                    inbox.collect()
                    return north.counters.refused > 0 and bool(inbox.newest)

                await until("refused", arrived)
                session.put("gcs/rogue/bundles", bytes(10_000_000))
                await asyncio.sleep(0.5)
                inbox.collect()
                assert inbox.newest == {("rogue", "after"): b"1"}
                del token

    asyncio.run(story())


def test_a_flood_of_junk_is_bounded_and_blocks_nothing() -> None:
    endpoints = endpoints_of("north", "south", "rogue")
    north, south = bus_of("north", endpoints), bus_of("south", endpoints)

    async def story() -> None:
        async with opened(north, south):
            await all_present(north, south)
            with process_of("rogue", endpoints, junk=True):
                await until("flooded", lambda: len(north.newest()) > 10)
                inbox, most, longest_s, number = Inbox(south), 0, 0.0, 0
                end_s = time.monotonic() + 3.0
                while time.monotonic() < end_s:
                    number += 1
                    begin_s = time.thread_time()  # of this thread: the machine's pauses do not count
                    north.publish({"states": number.to_bytes(2)})
                    most = max(most, inbox.collect())
                    longest_s = max(longest_s, time.thread_time() - begin_s)
                    await asyncio.sleep(0.05)
                assert 10 < most <= KEPT + 1
                assert longest_s < 0.02
                await inbox.has("north", "states", number.to_bytes(2))

    asyncio.run(story())


@pytest.fixture
def site(tmp_path: Path) -> tuple[dict[str, Endpoint], Path]:
    """Endpoints of three stations, and the folder of their keys."""
    endpoints = endpoints_of("north", "south", "west")
    make_site_keys(tmp_path / "keys", {name: ["127.0.0.1"] for name in endpoints})
    return endpoints, tmp_path / "keys"


def test_stations_with_keys_exchange_messages(site: tuple[dict[str, Endpoint], Path]) -> None:
    endpoints, keys = site
    buses = [bus_of(name, endpoints, keys) for name in endpoints]

    async def story() -> None:
        async with opened(*buses):
            await receive_each_other(buses)

    asyncio.run(story())


async def refused_beside_others(
    endpoints: dict[str, Endpoint], keys: Path, config: zenoh.Config, forged: str
) -> None:
    """A rogue in place of west publishes as `forged`: north and south receive only each other."""
    north, south = (bus_of(name, endpoints, keys) for name in ("north", "south"))
    tls = json.loads(config.get_json("transport/link/protocols")) == ["tls"]
    theirs = [endpoints[name].url(tls=tls) for name in ("north", "south")]
    (forgery,) = bundles({"states": b"forged"})
    config.insert_json5("connect/endpoints", json.dumps(theirs))  # the last by name connects to none
    async with opened(north, south):
        await all_present(north, south)
        with zenoh.open(config) as session:
            token = session.liveliness().declare_token(f"gcs/{forged}/alive")
            inboxes = Inbox(north), Inbox(south)
            for number in range(30):
                session.put(f"gcs/{forged}/bundles", forgery)
                await asyncio.sleep(0.05)
                for inbox in inboxes:  # before a true state replaces it
                    inbox.collect()
                    assert b"forged" not in inbox.newest.values()
                north.publish({"states": bytes([number])})
                south.publish({"states": bytes([number])})
                await asyncio.sleep(0.05)
            await inboxes[0].has("south", "states", bytes([29]))
            await inboxes[1].has("north", "states", bytes([29]))
            assert north.present == {"south"}
            assert south.present == {"north"}
            del token


@pytest.mark.parametrize("whose", ["none", "another authority's"])
def test_a_station_without_a_certificate_of_the_site_is_refused(
    whose: str, site: tuple[dict[str, Endpoint], Path], tmp_path: Path
) -> None:
    endpoints, keys = site
    make_site_keys(tmp_path / "other", {"west": ["127.0.0.1"]})
    config = configuration("west", endpoints, tmp_path / "other")
    config.insert_json5("access_control", '{"enabled": false}')
    authority, certificate, key = key_files(keys, "west")[0], *key_files(tmp_path / "other", "west")[1:]
    config.insert_json5("transport/link/tls/root_ca_certificate", f'"{authority}"')  # it trusts the others
    if whose == "none":
        config.insert_json5("transport/link/tls/enable_mtls", "false")
        config.insert_json5("transport/link/tls/connect_certificate", "null")
        config.insert_json5("transport/link/tls/connect_private_key", "null")
    assert certificate.is_file()
    assert key.is_file()
    asyncio.run(refused_beside_others(endpoints, keys, config, "west"))


def test_a_station_that_publishes_as_another_is_refused(site: tuple[dict[str, Endpoint], Path]) -> None:
    endpoints, keys = site
    config = configuration("west", endpoints, keys)
    config.insert_json5("access_control", '{"enabled": false}')
    asyncio.run(refused_beside_others(endpoints, keys, config, "south"))


def test_a_connection_without_tls_is_refused(site: tuple[dict[str, Endpoint], Path]) -> None:
    endpoints, keys = site
    config = configuration("west", endpoints, None)
    asyncio.run(refused_beside_others(endpoints, keys, config, "west"))
