"""Alarms as they come, the selection, and the way back after a stall: what an operator sees and commands."""

import json
import random
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

import httpx
import pytest
from console_bench import FLIGHT_MS, SOON_MS, Console, Station, chromes, console, station
from ground import ORIGIN, SOON_S, flying_config, proper, service, wait_until
from machine import free_ports
from playwright.sync_api import Browser, expect

from gcs import config as configuration
from gcs.client import Client

chrome = pytest.fixture(scope="module")(chromes)

COUNT: Final = 12
ON_SCREEN_MS: Final = 500.0
"""From the message to the picture; the service sends what has changed within 0.5 s."""

SEVERITIES: Final = ("emergency", "warning", "caution", "information")

Fault = Callable[..., None]


@contextmanager
def broken_fleet(folder: Path) -> Iterator[tuple[Station, Fault, int]]:
    """Vehicles that receive faults, and a service whose reactions keep the show where it is."""
    port, control = free_ports(COUNT), free_ports()
    raw = flying_config(COUNT, port, silence_s=2.0, takeoff_height_m=4.0).model_dump()
    raw["api"]["port"] = free_ports()
    raw["formation"] |= {"radius_m": 9.0, "height_m": 15.0}
    raw["map"] = {"tiles": str(folder / "none.mbtiles")}
    raw["reactions"]["service_late"]["action"] = "ignore"
    raw["reactions"]["vehicles_lost"] |= {"action": "pause", "count": 2, "share": 0.01}
    wind = {
        "action": "pause",
        "then_return_after_s": None,
        "speed_error_m_s": 0.8,
        "for_s": 1.5,  # a machine that stands still for a moment is no wind
        "share": 0.05,
    }
    raw["reactions"]["wind"] |= wind  # also of a fleet that is paused, and steers against it
    raw["reactions"]["links_late"] |= {"late_s": 5.0, "arrive_min": 0.2}  # a busy machine is no late link
    config = configuration.Config.model_validate(raw)
    command = [sys.executable, "-m", "gcs.sim", "--count", str(COUNT), "--port-base", str(port)]
    command += ["--origin", ORIGIN, "--grid-columns", "4", "--quirk", "late-ready=off"]
    command += ["--control", str(control), *proper(config)]

    def fault(**order: Any) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:
            outlet.settimeout(30.0)
            outlet.sendto(json.dumps(order).encode(), ("127.0.0.1", control))
            answer = json.loads(outlet.recv(2000))
        assert answer["ok"], answer

    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as fleet:
        try:
            with service(config, folder / "service") as (client, process):
                url = f"http://127.0.0.1:{config.api.port}"
                yield Station(url, client, process, config, folder / "service"), fault, port
        finally:
            fleet.terminate()


@contextmanager
def second_with_the_same_id(port: int) -> Iterator[None]:
    """Another vehicle with the system id of d9, on its port."""
    command = [sys.executable, "-m", "gcs.sim", "--first", "8", "--count", "1", "--port-base", str(port)]
    with subprocess.Popen([*command, "--origin", ORIGIN], stdout=subprocess.DEVNULL) as other:
        try:
            yield
        finally:
            other.terminate()


def alarms(ground: Station) -> list[dict[str, Any]]:
    """As the service lists them."""
    found: list[dict[str, Any]] = httpx.get(f"{ground.url}/api/v1/alarms", timeout=30.0).json()["alarms"]
    return found


def all_are(ground: Station, causes: Collection[str]) -> bool:
    """Whether each of these causes has an alarm."""
    return set(causes) <= {alarm["cause"] for alarm in alarms(ground)}


def kill(client: Client, name: str) -> None:
    client.confirm_kill(client.arm_kill([name]).code)


def listed(desk: Console) -> list[dict[str, Any]]:
    """The alarms of the page, from top to bottom."""
    found: list[dict[str, Any]] = desk.part("alarm").evaluate_all(
        "(all) => all.map((each) => ({...each.dataset, height: each.getBoundingClientRect().height,"
        " ended: each.classList.contains('ended')}))"
    )
    return found


def not_shown_in_time(desk: Console) -> list[str]:
    """Alarms sent to the page and not shown on it so long after, without the time it stood still."""
    seen = desk.seen()
    late = []
    for alarm, told_ms in seen["told"].items():
        shown_ms = seen["shown"].get(alarm, float("inf"))
        stalled_ms = sum(
            max(0.0, min(each["to_ms"], shown_ms) - max(each["from_ms"], told_ms)) for each in seen["stalled"]
        )
        if shown_ms - told_ms - stalled_ms > ON_SCREEN_MS:
            late.append(f"{alarm}: {shown_ms - told_ms:.0f} ms, stalled {stalled_ms:.0f} ms")
    return late


def test_twelve_alarms_three_at_once_are_all_on_screen_the_most_severe_on_top(
    chrome: Browser, tmp_path: Path
) -> None:
    with (
        broken_fleet(tmp_path) as (ground, fault, port),
        console(chrome, ground.url, width=1440, height=900) as desk,
    ):
        client = ground.client
        desk.says("connection", "Live")
        desk.page.keyboard.press("Escape")
        wait_until("ready", SOON_S, lambda: all(each.ready for each in client.fleet().vehicles))
        client.preflight.exclude("d12", reason="spare")
        wait_until("passes", SOON_S, lambda: client.preflight.report().passes)
        client.start()
        desk.says("show-phase", "running", FLIGHT_MS)

        def wind() -> None:
            fault(vehicles="all", fault="wind", north_m_s=13.0, east_m_s=0.0, down_m_s=0.0)

        injections: dict[str, Callable[[], None]] = {
            "vehicle-lost": lambda: fault(vehicle=1, fault="silence"),
            "outside-control": lambda: fault(vehicle=2, fault="pilot", mode="POSITION"),
            "killed": lambda: kill(client, "d3"),
            "low-battery": lambda: fault(vehicle=4, fault="battery", remaining=0.18),
            "critical-battery": lambda: fault(vehicle=5, fault="battery", remaining=0.09),
            "bad-position": lambda: fault(vehicle=6, fault="accuracy", eph_m=20.0),
            "poor-link": lambda: fault(vehicle=8, fault="loss", share=0.4),
            "wind": wind,
        }
        order = list(injections)
        random.Random(14).shuffle(order)
        with second_with_the_same_id(port):
            for first in range(0, len(order), 3):
                batch = order[first : first + 3]
                for cause in batch:
                    injections[cause]()
                wait_until(f"{batch} are alarms", SOON_S, partial(all_are, ground, batch))
            expected = {*order, "not-flying", "service-note", "vehicles-lost", "duplicate-system-id"}
            wait_until("all", SOON_S, partial(all_are, ground, expected))
            expect(desk.part("alarm")).to_have_count(len(alarms(ground)), timeout=SOON_MS)
            assert not_shown_in_time(desk) == []
            there = listed(desk)
            assert {each["cause"] for each in there} >= expected
            ranks = [(each["ended"], SEVERITIES.index(each["severity"])) for each in there]
            assert ranks == sorted(ranks)
            assert all(each["height"] > 20.0 for each in there)
            for each in range(len(there)):
                row = desk.part("alarm").nth(each)
                row.scroll_into_view_if_needed()
                expect(row).to_be_in_viewport(ratio=0.9)
            desk.says("overall-word", "Emergency")
            assert desk.page.title().startswith("EMERGENCY")
            assert "icon-emergency" in (desk.page.locator("link[rel=icon]").get_attribute("href") or "")
            assert desk.seen()["tones"] > 0
            assert desk.serious() == []

            desk.press("alarms-fold")
            for minor in ("caution", "information"):
                expect(desk.page.locator(f"[data-severity={minor}][data-alarm]")).to_have_count(0)
            assert {each["severity"] for each in listed(desk)} == {"emergency", "warning"}
            desk.press("acknowledge-all")
            expect(desk.part("acknowledge-all")).to_have_count(0, timeout=SOON_MS)
            assert {each["acknowledged_by"] for each in alarms(ground)} == {"local"}
            desk.press("sound")
            desk.page.reload()
            expect(desk.part("sound")).to_have_attribute("aria-pressed", "false", timeout=SOON_MS)
        assert desk.wrong == []


def test_a_command_acts_on_the_selection_and_kill_begins_with_it(chrome: Browser, tmp_path: Path) -> None:
    with (
        station(tmp_path, 5, takeoff_m=3.0, radius_m=5.0, height_m=10.0) as ground,
        console(chrome, ground.url, width=1440, height=900) as desk,
    ):
        client = ground.client

        def phases(phase: str) -> set[str]:
            return {each.id for each in client.vehicles() if each.phase == phase}

        desk.says("connection", "Live")
        wait_until("passes", SOON_S, lambda: client.preflight.report().passes)
        client.start()
        desk.says("show-phase", "running", FLIGHT_MS)

        desk.part("row-d2").click()
        desk.part("row-d4").click(modifiers=["Shift"])
        desk.says("selection-count", "3 vehicles")
        desk.part("row-d3").click(modifiers=["Control"])
        desk.says("selection-count", "2 vehicles")
        desk.press("selection-hold")
        wait_until("hold", SOON_S, lambda: phases("hold") == {"d2", "d4"})
        assert phases("formation") == {"d1", "d3", "d5"}
        desk.part("selection-open").click()
        for name in ("d2", "d4"):
            expect(desk.part(f"selected-order-{name}")).to_contain_text("done", timeout=SOON_MS)
        assert desk.serious() == []

        desk.opens("Shift+K", "kill-arm")
        expect(desk.part("kill-names")).to_have_text("d2, d4")
        desk.closes("Escape", "sheet-kill")
        desk.press("selection-return")
        wait_until("return", SOON_S, lambda: phases("hold") == set())
        desk.page.keyboard.press("Escape")
        expect(desk.part("group-page")).to_have_count(0)
        desk.opens("Shift+K", "kill-arm")
        expect(desk.part("kill-arm")).to_have_attribute("aria-disabled", "true")  # nothing is selected
        desk.closes("Escape", "sheet-kill")
        assert [order.action for order in client.orders()][:2] == ["return", "hold"]
        desk.press("stop")
        desk.says("show-phase", "landed", FLIGHT_MS)
        assert desk.wrong == []


def test_after_a_stall_of_the_service_two_presses_bring_the_fleet_home(
    chrome: Browser, tmp_path: Path
) -> None:
    with (
        station(tmp_path, 4, takeoff_m=3.0, radius_m=4.0, height_m=9.0) as ground,
        console(chrome, ground.url, width=1024, height=768) as desk,
    ):
        client = ground.client
        desk.says("connection", "Live")
        wait_until("passes", SOON_S, lambda: client.preflight.report().passes)
        client.start()
        desk.says("show-phase", "running", FLIGHT_MS)
        ground.process.send_signal(signal.SIGSTOP)
        try:
            expect(desk.part("banner")).to_be_visible(timeout=SOON_MS)
            desk.page.wait_for_timeout(8_000)  # longer than the vehicles wait for setpoints
        finally:
            ground.process.send_signal(signal.SIGCONT)
        desk.says("connection", "Live", FLIGHT_MS)
        desk.says("show-phase", "not under control")
        desk.says("show-reason", "4 airborne")
        expect(desk.part("start")).to_have_attribute("aria-disabled", "true")
        for name in ("pause", "stop", "abort"):
            expect(desk.part(name)).not_to_have_attribute("aria-disabled", "true")
        assert desk.serious() == []
        desk.press("take-over")
        desk.says("show-phase", "paused", FLIGHT_MS)
        expect(desk.part("interrupted")).to_have_count(0, timeout=SOON_MS)
        desk.press("stop")
        desk.says("show-phase", re.compile("returning home|landed"), FLIGHT_MS)
        desk.says("show-phase", "landed", FLIGHT_MS)
        desk.says("airborne", "0/4")
        assert desk.wrong == []
