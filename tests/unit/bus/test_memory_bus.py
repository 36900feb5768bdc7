"""The bus in memory: late, lossy and cut as configured, the same every time, and bounded."""

import asyncio
from contextlib import suppress

import pytest

from gcs.bus import PAYLOAD_MAX
from gcs.model.errors import LinkError
from gcs.testing.memory_bus import UNDER_WAY_MAX, MemoryBus, MemoryNetwork, network


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


def payloads(bus: MemoryBus) -> list[bytes]:
    return [message.payload for message in bus.newest()]


def test_the_newest_message_of_each_topic_arrives_everywhere(clock: Clock) -> None:
    site = network(["north", "south", "west"], clock)
    north = site.buses["north"]
    for payload in (b"1", b"2"):
        north.publish({"states": payload})
    north.publish({"plan": b"p"})
    for name in ("south", "west"):
        received = site.buses[name].newest()
        assert {(one.sender, one.topic, one.payload) for one in received} == {
            ("north", "states", b"2"),
            ("north", "plan", b"p"),
        }
        assert site.buses[name].newest() == []
    assert north.newest() == []
    assert (north.counters.sent, north.counters.sent_bytes) == (
        3,
        3 + 3 * len("-----") + len("statesstatesplan"),
    )
    assert site.buses["south"].counters.received == 3


def test_a_message_arrives_after_the_delay_and_says_when(clock: Clock) -> None:
    site = network(["north", "south"], clock, delay_s=0.02)
    site.buses["north"].publish({"states": b"1"})
    clock.now_s = 0.019
    assert site.buses["south"].newest() == []
    clock.now_s = 0.05
    (message,) = site.buses["south"].newest()
    assert message.time_s == pytest.approx(0.02)


def test_messages_of_one_station_keep_their_order(clock: Clock) -> None:
    site = network(["north", "south"], clock, delay_s=0.02, spread_s=0.02, seed=3)
    numbers = []
    for step in range(400):
        clock.now_s = step * 0.001
        site.buses["north"].publish({"states": step.to_bytes(2, "little")})
        numbers += [int.from_bytes(one, "little") for one in payloads(site.buses["south"])]
    assert len(numbers) > 50
    assert numbers == sorted(numbers)


def test_loss_is_the_given_share_and_repeats_with_the_seed(clock: Clock) -> None:
    def received(seed: int) -> list[int]:
        site = network(["north", "south"], clock, loss=0.1, seed=seed)
        found = []
        for step in range(2000):
            site.buses["north"].publish({"states": b""})
            found += [step] * len(site.buses["south"].newest())
        return found

    once = received(1)
    assert len(once) == pytest.approx(1800, abs=60)
    assert received(1) == once != received(2)


def test_a_cut_bus_carries_within_each_half_until_it_heals(clock: Clock) -> None:
    site = network(["a", "b", "c", "d"], clock, connection_s=0.2)
    site.cut(["a", "b"], ["c", "d"])
    site.buses["a"].publish({"states": b"1"})
    assert payloads(site.buses["b"]) == [b"1"]
    assert payloads(site.buses["c"]) == payloads(site.buses["d"]) == []
    assert site.buses["a"].present == {"b", "c", "d"}
    clock.now_s = 0.3
    assert site.buses["a"].present == {"b"}
    assert site.buses["d"].present == {"c"}
    site.cut()
    site.buses["a"].publish({"states": b"2"})
    assert payloads(site.buses["d"]) == [b"2"]
    assert site.buses["a"].present == {"b", "c", "d"}


def test_a_bus_that_was_closed_neither_sends_nor_receives(clock: Clock) -> None:
    site = network(["north", "south"], clock)

    async def story() -> None:
        running = asyncio.create_task(site.buses["north"].run())
        await asyncio.sleep(0)
        assert site.buses["south"].present == {"north"}
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running

    asyncio.run(story())
    assert site.buses["south"].present == frozenset()
    site.buses["north"].publish({"states": b"1"})
    site.buses["south"].publish({"states": b"2"})
    assert payloads(site.buses["south"]) == payloads(site.buses["north"]) == []
    assert site.buses["north"].counters.sent == 0


def test_a_payload_that_is_too_large_is_refused(clock: Clock) -> None:
    site = network(["north", "south"], clock)
    site.buses["north"].publish({"states": bytes(PAYLOAD_MAX)})
    with pytest.raises(LinkError, match=f"states: {PAYLOAD_MAX + 1} bytes where {PAYLOAD_MAX} are possible"):
        site.buses["north"].publish({"states": bytes(PAYLOAD_MAX + 1)})
    assert [len(one) for one in payloads(site.buses["south"])] == [PAYLOAD_MAX]


def test_messages_that_are_not_collected_are_bounded(clock: Clock) -> None:
    site = MemoryNetwork(clock)
    north, south = site.bus("north"), site.bus("south")
    for number in range(UNDER_WAY_MAX + 10):
        north.publish({f"t{number}": b""})
    assert len(south.newest()) == UNDER_WAY_MAX
