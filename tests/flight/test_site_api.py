"""The API of one station of a site: it shows and commands the vehicles of all, in virtual time."""

from typing import Any

import httpx
import pytest

from gcs.api.app import create_app
from gcs.bus.bundles import bundles
from gcs.model.lifecycle import Phase
from gcs.testing.virtual_site import SiteShow, fly_site, site_config

BUS = {"delay_s": 0.02, "spread_s": 0.01, "loss": 0.01}


async def call(show: SiteShow, station: str, method: str, path: str, **options: Any) -> Any:
    """Call the API of a station. Returns: the JSON document. Raises: AssertionError when it is refused."""
    transport = httpx.ASGITransport(create_app(show[station].service))
    async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
        answer = await client.request(method, f"/api/v1{path}", **options)
    assert answer.is_success, answer.text
    return answer.json()


@pytest.mark.soak
def test_api_of_a_follower_shows_and_commands_every_vehicle() -> None:
    async def story(show: SiteShow) -> None:
        await show.start()
        fleet = await call(show, "south", "GET", "/fleet")
        owners = {each["id"]: each["station"] for each in fleet["vehicles"]}
        assert all(vehicle.startswith(station[0]) for vehicle, station in owners.items())
        assert {each["name"]: each["vehicles"] for each in fleet["stations"]} == dict.fromkeys(
            show.stations, 2
        )
        assert [each["name"] for each in fleet["stations"] if each["own"]] == ["south"]
        assert [each["name"] for each in fleet["stations"] if each["leads"]] == ["north"]
        assert fleet["counts"]["airborne"] == len(owners) == 8
        status = await call(show, "south", "GET", "/status")
        assert {each["id"]: each["station"] for each in status["vehicles"]} == owners
        first = next(name for name, station in owners.items() if station == "north")
        record = await call(show, "south", "POST", f"/vehicles/{first}/hold")
        assert record["outcomes"] == {first: {"outcome": "pending", "reason": ""}}
        await show.until(lambda: show.in_phase("north", Phase.HOLD) == 1, 10.0)
        await show.wait(1.0)
        record = await call(show, "south", "GET", f"/commands/{record['id']}")
        assert record["outcome"] == "done"
        taken = await call(show, "south", "POST", "/stations/lead")
        assert [each["name"] for each in taken if each["leads"]] == ["south"]
        await show.wait(1.0)
        for name in show.stations:
            listed = await call(show, name, "GET", "/stations")
            assert [each["name"] for each in listed if each["leads"]] == ["south"]
        await show["west"].kill()
        await show.wait(1.0)
        listed = await call(show, "south", "GET", "/stations")
        assert {each["name"]: each["received"] for each in listed} == {
            name: name != "west" for name in show.stations
        }
        assert show.violations == 0

    fly_site(story, site_config(4, 2), **BUS)


async def counted(show: SiteShow, station: str) -> dict[str, float]:
    """What a station's metrics say of its bus."""
    transport = httpx.ASGITransport(create_app(show[station].service))
    async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
        text = (await client.get("/metrics")).raise_for_status().text
    values = [line.rsplit(" ", 1) for line in text.splitlines() if line.startswith("gcs_bus_")]
    return {name.removeprefix("gcs_bus_").removesuffix("_total"): float(value) for name, value in values}


@pytest.mark.soak
def test_metrics_count_what_crosses_the_bus() -> None:
    async def story(show: SiteShow) -> None:
        passed: list[int] = []  # bytes of each message with its topic, as a third party receives them

        def note(topic: str, payload: bytes) -> bool:
            passed.extend(map(len, bundles({topic: payload})))
            return True

        watcher = show.network.bus("watcher")
        watcher.accepts = note
        await show.start()
        watcher.newest()
        passed.clear()
        before = {name: await counted(show, name) for name in ("north", "south")}
        (junk,) = map(len, bundles({"states": b"junk"}))
        for _ in range(7):
            show.network.carry("south", "states", b"junk")
        for _ in range(10):
            await show.wait(1.0)
            watcher.newest()
        watcher.newest()
        after = {name: await counted(show, name) for name in ("north", "south")}
        north, south = (
            {name: after[station][name] - before[station][name] for name in after[station]}
            for station in after
        )
        assert north["messages_sent"] + south["messages_sent"] == len(passed) - 7
        assert north["sent_bytes"] + south["sent_bytes"] == sum(passed) - 7 * junk
        assert north["messages_received"] == pytest.approx(south["messages_sent"], abs=5)  # those of a tick
        assert south["messages_received"] == pytest.approx(north["messages_sent"], abs=5)
        assert (
            200 <= south["messages_sent"] < north["messages_sent"]
        )  # 20 batches a second; the lead has more
        assert (north["messages_refused"], south["messages_refused"]) == (7, 0)

    fly_site(story, site_config(2, 2))
