"""Alarms as they come, the selection, and the way back after a stall: what an operator sees and commands."""

import json
import random
import re
import resource
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from math import dist
from pathlib import Path
from typing import Any, Final

import httpx
import pytest
from playwright.sync_api import Browser, Locator, expect
from pymavlink.dialects.v20 import common as dialect

from gcs.client import Client
from gcs.config import schema as configuration
from tests.support.console_bench import (
    FLIGHT_MS,
    LOOK_MS,
    SOON_MS,
    Console,
    Station,
    chromes,
    console,
    station,
)
from tests.support.ground import ORIGIN, SOON_S, flying_config, proper, service, wait_until
from tests.support.machine import free_ports

chrome = pytest.fixture(scope="module")(chromes)

COUNT: Final = 12
ON_SCREEN_MS: Final = 500.0
"""From the message to the picture; the service sends what has changed within 0.5 s."""

LAID_OUT_MS: Final = 700.0
"""For the page to take note of the window's new size."""

BOX_PX: Final = 16.0
"""From the outermost vehicles of a box to its sides."""

MIDDLES: Final = """(all, name) => all.filter((each) => each.textContent === name)
  .map((each) => each.getBoundingClientRect()).filter(({ x }) => x > 0)
  .map(({ x, y, width, height }) => [x + width / 2, y + height / 2])"""
"""Of the words in the picture that are this name; a word that is not used lies far to the left."""

NAME_PX: Final = 26.0
"""From a vehicle to its name, which is above it."""

WHOLE: Final = """() => {
  const box = (name) => document.querySelector(name)?.getBoundingClientRect();
  const within = (row, top, bottom) => {
    const at = row.getBoundingClientRect();
    const middle = document.elementFromPoint((at.left + at.right) / 2, (at.top + at.bottom) / 2);
    return at.top > top - 1 && at.bottom < Math.min(bottom, innerHeight) + 1 && row.contains(middle);
  };
  const rows = (name, ...place) => [...document.querySelectorAll(name)].map((row) => within(row, ...place));
  const table = box(".table-scroll");
  return {
    alarms: rows("[data-alarm]", box(".alarm-list > header").bottom, box(".alarms").bottom),
    rows: table ? rows("[data-testid^=row-]", box(".fleet thead").bottom, table.bottom) : [],
  };
}"""
"""Of each alarm and each row of the fleet's table, from top to bottom: whether all of it is on screen."""

SEVERITIES: Final = ("emergency", "warning", "caution", "information")

Fault = Callable[..., None]


@dataclass(frozen=True, slots=True)
class Field:
    """A station over vehicles that receive faults."""

    ground: Station
    fault: Fault
    port: int  # of the service, for the first vehicle
    fleet: subprocess.Popen[bytes]


@contextmanager
def broken_fleet(folder: Path, count: int = COUNT) -> Iterator[Field]:
    """Vehicles that receive faults, and a service whose reactions keep the show where it is."""
    port, control = free_ports(count), free_ports()
    raw = flying_config(count, port, silence_s=2.0, takeoff_height_m=4.0).model_dump()
    raw["api"]["port"] = free_ports()
    raw["formation"] |= {"radius_m": 9.0, "height_m": 15.0}
    raw["map"] = {"tiles": str(folder / "none.mbtiles")}
    raw["failsafes"]["service_late"]["action"] = "ignore"
    raw["failsafes"]["vehicles_lost"] |= {"action": "pause", "count": 2, "share": 0.01}
    wind = {
        "action": "pause",
        "then_return_after_s": None,
        "speed_error_m_s": 0.8,
        "for_s": 1.5,  # a machine that stands still for a moment is no wind
        "share": 0.05,
    }
    raw["failsafes"]["wind"] |= wind  # also of a fleet that is paused, and steers against it
    raw["failsafes"]["links_late"] |= {"late_s": 5.0, "arrive_min": 0.2}  # a busy machine is no late link
    config = configuration.Config.model_validate(raw)
    command = [sys.executable, "-m", "gcs.sim", "--count", str(count), "--port-base", str(port)]
    command += ["--origin", ORIGIN, "--grid-columns", "4", "--quirk", "late-ready=off"]
    command += ["--control", str(control), *proper(config)]

    def fault(**sequence: Any) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:
            outlet.settimeout(30.0)
            outlet.sendto(json.dumps(sequence).encode(), ("127.0.0.1", control))
            answer = json.loads(outlet.recv(2000))
        assert answer["ok"], answer

    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as fleet:
        try:
            with service(config, folder / "service") as (client, process):
                url = f"http://127.0.0.1:{config.api.port}"
                yield Field(Station(url, client, process, config, folder / "service"), fault, port, fleet)
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


def are_acknowledged(ground: Station, ids: Collection[str]) -> bool:
    """Whether this page has acknowledged each of these alarms that is still listed."""
    return {alarm["acknowledged_by"] for alarm in alarms(ground) if alarm["id"] in ids} == {"local"}


def kill(client: Client, name: str) -> None:
    client.confirm_kill(client.arm_kill([name]).code)


def listed(ui: Console) -> list[dict[str, Any]]:
    """The alarms of the page, from top to bottom."""
    found: list[dict[str, Any]] = ui.part("alarm").evaluate_all(
        "(all) => all.map((each) => ({...each.dataset, height: each.getBoundingClientRect().height,"
        " ended: each.classList.contains('ended')}))"
    )
    return found


def at_rest(ui: Console, name: str) -> tuple[float, float]:
    """Where a vehicle is on the screen once the camera has come to rest. CSS pixels."""
    words = ui.page.locator(".scene-word.name")
    seen: list[tuple[float, float]] = []
    for _ in range(60):
        for x, y in words.evaluate_all(MIDDLES, name)[:1]:
            seen = [*seen[-2:], (x, y + NAME_PX)]
        if len(seen) == 3 and max(dist(one, seen[0]) for one in seen) < 3.0:
            return seen[0]  # its position is never quite still
        ui.page.wait_for_timeout(LOOK_MS)
    raise AssertionError(f"{name} does not come to rest: {seen}")


def selected(ui: Console) -> set[str]:
    """Rows of the fleet's table that are selected."""
    found = ui.page.locator("tr.selected").evaluate_all("(rows) => rows.map((row) => row.dataset.testid)")
    return set(found)


def sees(ui: Console, row: Locator) -> None:
    """Scroll to an alarm. A new one may move the list meanwhile, back to its top."""
    ui.until(
        lambda: row.scroll_into_view_if_needed(timeout=SOON_MS),
        lambda within_ms: expect(row).to_be_in_viewport(ratio=0.9, timeout=within_ms),
    )


def not_shown_in_time(ui: Console) -> list[str]:
    """Alarms sent to the page and not shown on it so long after, without the time it stood still."""
    seen = ui.seen()
    late = []
    for alarm, reported_ms in seen["reported"].items():
        shown_ms = seen["shown"].get(alarm, float("inf"))
        stalled_ms = sum(
            max(0.0, min(each["to_ms"], shown_ms) - max(each["from_ms"], reported_ms))
            for each in seen["stalled"]
        )
        if shown_ms - reported_ms - stalled_ms > ON_SCREEN_MS:
            late.append(f"{alarm}: {shown_ms - reported_ms:.0f} ms, stalled {stalled_ms:.0f} ms")
    return late


def ports_of(process: subprocess.Popen[bytes]) -> list[int]:
    """UDP ports that a process has open."""
    links = [str(each.readlink()) for each in Path(f"/proc/{process.pid}/fd").iterdir()]
    inodes = {link[len("socket:[") : -1] for link in links if link.startswith("socket:[")}
    rows = [line.split() for line in Path("/proc/net/udp").read_text(encoding="ascii").splitlines()[1:]]
    return [int(row[1].partition(":")[2], 16) for row in rows if row[9] in inodes]


def another_station_sets(fleet: subprocess.Popen[bytes], system_id: int, name: str, value: float) -> None:
    """A parameter of one vehicle. Which port is its own is not known: it is the one addressed."""
    message = dialect.MAVLink_param_set_message(
        system_id, 1, name.encode(), value, dialect.MAV_PARAM_TYPE_REAL32
    )
    frame = message.pack(dialect.MAVLink(None, srcSystem=250, srcComponent=190))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:
        for port in ports_of(fleet):
            outlet.sendto(frame, ("127.0.0.1", port))


def fill_the_disk(process: subprocess.Popen[str]) -> None:
    """No file of the service grows any more."""
    _, hard = resource.prlimit(process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (4096, hard))


def injections(field: Field, stack: ExitStack) -> dict[str, Callable[[], object]]:
    """Twelve causes, and how each comes about."""
    ground, fault = field.ground, field.fault
    wind = {"north_m_s": 13.0, "east_m_s": 0.0, "down_m_s": 0.0}
    return {
        "vehicle-lost": lambda: fault(vehicle=1, fault="silence"),
        "outside-control": lambda: fault(vehicle=2, fault="pilot", mode="POSITION"),
        "killed": lambda: kill(ground.client, "d3"),
        "low-battery": lambda: fault(vehicle=4, fault="battery", remaining=0.18),
        "critical-battery": lambda: fault(vehicle=5, fault="battery", remaining=0.09),
        "bad-position": lambda: fault(vehicle=6, fault="accuracy", eph_m=20.0),
        "vehicles-lost": lambda: fault(vehicles=[7, 10], fault="silence"),
        "poor-link": lambda: fault(vehicle=8, fault="loss", share=0.4),
        "duplicate-system-id": lambda: stack.enter_context(second_with_the_same_id(field.port)),
        "parameter-changed": lambda: another_station_sets(field.fleet, 11, "COM_OF_LOSS_T", 60.0),
        "record-fails": lambda: fill_the_disk(ground.process),
        "wind": lambda: fault(vehicles="all", fault="wind", **wind),
    }


def take_off(field: Field, *spare: str) -> None:
    """Until the show runs; `spare` vehicles stay on the ground."""
    client = field.ground.client
    wait_until("ready", SOON_S, lambda: all(each.ready for each in client.fleet().vehicles))
    for name in spare:
        client.preflight.exclude(name, reason="spare")
    wait_until("passes", SOON_S, lambda: client.preflight.report().passes)
    client.start()
    wait_until("running", SOON_S, lambda: client.show().phase == "running")


@pytest.mark.parametrize("seed", [14, 2026])
def test_twelve_alarms_three_at_once_are_visible_by_severity(
    chrome: Browser, tmp_path: Path, seed: int
) -> None:
    with (
        broken_fleet(tmp_path) as field,
        ExitStack() as stack,
        console(chrome, field.ground.url, width=1440, height=900) as ui,
    ):
        ground = field.ground
        ui.says("connection", "Live")
        ui.page.keyboard.press("Escape")
        take_off(field, "d12")
        inject = injections(field, stack)
        sequence = list(inject)
        random.Random(seed).shuffle(sequence)
        for first in range(0, len(sequence), 3):
            batch = sequence[first : first + 3]
            for cause in batch:
                inject[cause]()
            wait_until(f"{batch} of seed {seed} are alarms", SOON_S, partial(all_are, ground, batch))
            for cause in batch:
                row = ui.page.locator(f"[data-alarm][data-cause={cause}]")
                expect(row.first).to_be_attached(timeout=SOON_MS)
            assert not_shown_in_time(ui) == []
            assert ui.page.evaluate(WHOLE)["alarms"][0], "the most severe is on screen"
        expected = {*sequence, "not-flying", "service-note"}
        there = listed(ui)
        assert {each["cause"] for each in there} >= expected
        ranks = [(each["ended"], SEVERITIES.index(each["severity"])) for each in there]
        assert ranks == sorted(ranks)
        for how in ("dense", "all"):
            if how == "all":
                ui.press("alarms-all")
            for each in there:
                if each["severity"] in {"emergency", "warning"}:  # these stay until they are acknowledged
                    sees(ui, ui.page.locator(f"[data-alarm={each['alarm']}]"))
        ui.says("overall-word", "Emergency")
        assert ui.page.title().startswith("EMERGENCY")
        assert "icon-emergency" in (ui.page.locator("link[rel=icon]").get_attribute("href") or "")
        assert ui.seen()["tones"] > 0
        assert ui.serious() == []

        ui.press("alarms-fold")
        for minor in ("caution", "information"):
            expect(ui.page.locator(f"[data-severity={minor}][data-alarm]")).to_have_count(0)
        assert {each["severity"] for each in listed(ui)} == {"emergency", "warning"}
        before = {each["id"] for each in alarms(ground)}
        ui.press("acknowledge-all")
        wait_until("acknowledged", SOON_S, partial(are_acknowledged, ground, before))  # others are new
        ui.until(
            lambda: ui.press("sound"),
            lambda within_ms: expect(ui.part("sound")).to_have_attribute(
                "aria-pressed", "false", timeout=within_ms
            ),
        )
        ui.page.reload()
        expect(ui.part("sound")).to_have_attribute("aria-pressed", "false", timeout=SOON_MS)
        assert ui.wrong == []


def test_after_a_stall_alarms_table_and_recovery_are_visible(chrome: Browser, tmp_path: Path) -> None:
    with (
        broken_fleet(tmp_path, 7) as field,
        console(chrome, field.ground.url, width=1440, height=900) as ui,
    ):
        ground, fault = field.ground, field.fault
        take_off(field)
        fault(vehicle=1, fault="silence")
        fault(vehicle=2, fault="pilot", mode="POSITION")
        wait_until("lost", SOON_S, partial(all_are, ground, ["vehicle-lost", "outside-control"]))
        ground.process.send_signal(signal.SIGSTOP)
        ui.page.wait_for_timeout(8_000)  # longer than the vehicles wait for setpoints
        ground.process.send_signal(signal.SIGCONT)
        kill(ground.client, "d3")
        wait_until("all", SOON_S, partial(all_are, ground, ["killed", "interrupted", "own-failsafe"]))
        ui.says("connection", "Live")
        expect(ui.page.locator("[data-cause=killed]")).to_be_attached(timeout=SOON_MS)
        expect(ui.part("take-over")).to_be_visible(timeout=SOON_MS)
        for (width, height), (least, rows) in {
            (1440, 900): (5, 3),
            (1024, 768): (3, 2),
            (768, 1024): (3, 0),
            (390, 844): (2, 0),
            (360, 640): (1, 0),
            (844, 390): (1, 0),
            (640, 360): (1, 0),
        }.items():
            ui.page.set_viewport_size({"width": width, "height": height})
            ui.page.wait_for_timeout(LAID_OUT_MS)
            if rows > 0:
                for panel in ("preflight", "fleet"):
                    if ui.part(f"panel-{panel}").count() == 0:
                        ui.press(f"tab-{panel}")
                expect(ui.part("panel-fleet")).to_be_visible()
            expect(ui.part("take-over")).to_be_in_viewport(ratio=1.0)
            ui.page.wait_for_timeout(LAID_OUT_MS)
            seen = ui.page.evaluate(WHOLE)
            emergencies = {each["cause"] for each in listed(ui) if each["severity"] == "emergency"}
            assert "killed" in emergencies
            assert listed(ui)[0]["cause"] in emergencies  # a busy machine may report control-stopped after it
            assert seen["alarms"][:least] == [True] * least, (width, height, seen)
            assert sum(seen["rows"]) >= rows, (width, height, seen)
            if rows == 0:
                ui.says("alarms-all", f"{len(seen['alarms']) - 1} more")
                ui.press("alarms-all")
                expect(ui.part("alarms-all")).to_have_attribute("aria-expanded", "true")
                expect(ui.part("acknowledge-all")).to_be_in_viewport(ratio=1.0)
                last = ui.part("alarm").last
                sees(ui, last)
                ui.press("alarms-all")
        assert ui.wrong == []


def test_box_dragged_in_the_scene_selects_its_vehicles(chrome: Browser, tmp_path: Path) -> None:
    with station(tmp_path, 6) as ground, console(chrome, ground.url, width=1440, height=900) as ui:
        ui.says("connection", "Live")
        ui.press("camera-top")
        places = {name: at_rest(ui, name) for name in ("d1", "d2", "d3", "d4", "d5", "d6")}

        def drag(*names: str, keys: tuple[str, ...]) -> None:
            """A box around these."""
            across, down = zip(*(places[name] for name in names), strict=True)
            for key in keys:
                ui.page.keyboard.down(key)
            ui.page.mouse.move(min(across) - BOX_PX, min(down) - BOX_PX)
            ui.page.mouse.down()
            ui.page.mouse.move(max(across) + BOX_PX, max(down) + BOX_PX, steps=5)
            expect(ui.page.locator(".scene-box")).to_be_visible()
            ui.page.mouse.up()
            for key in keys:
                ui.page.keyboard.up(key)
            expect(ui.page.locator(".scene-box")).to_be_hidden()

        drag("d1", "d2", keys=("Control",))
        expect(ui.page.locator("tr.selected")).to_have_count(2, timeout=SOON_MS)
        assert selected(ui) == {"row-d1", "row-d2"}
        drag("d5", "d6", keys=("Control", "Shift"))
        expect(ui.page.locator("tr.selected")).to_have_count(4, timeout=SOON_MS)
        assert selected(ui) == {"row-d1", "row-d2", "row-d5", "row-d6"}
        drag("d4", keys=("Control",))
        expect(ui.page.locator("tr.selected")).to_have_count(1, timeout=SOON_MS)
        assert selected(ui) == {"row-d4"}
        assert ui.wrong == []
        assert ground.client.commands() == [], "a selection commands nothing"


def test_a_command_acts_on_the_selection_and_kill_begins_with_it(chrome: Browser, tmp_path: Path) -> None:
    with (
        station(tmp_path, 5, takeoff_m=3.0, radius_m=5.0, height_m=10.0) as ground,
        console(chrome, ground.url, width=1440, height=900) as ui,
    ):
        client = ground.client

        def phases(phase: str) -> set[str]:
            return {each.id for each in client.vehicles() if each.phase == phase}

        ui.says("connection", "Live")
        wait_until("passes", SOON_S, lambda: client.preflight.report().passes)
        client.start()
        ui.says("show-phase", "running", FLIGHT_MS)

        ui.part("row-d2").click()
        ui.part("row-d4").click(modifiers=["Shift"])
        ui.says("selection-count", "3 vehicles")
        ui.part("row-d3").click(modifiers=["Control"])
        ui.says("selection-count", "2 vehicles")
        ui.press("selection-hold")
        wait_until("hold", SOON_S, lambda: phases("hold") == {"d2", "d4"})
        assert phases("formation") == {"d1", "d3", "d5"}
        ui.part("selection-open").click()
        for name in ("d2", "d4"):
            expect(ui.part(f"selected-command-{name}")).to_contain_text("done", timeout=SOON_MS)
        assert ui.serious() == []

        ui.opens("Shift+K", "kill-arm")
        expect(ui.part("kill-names")).to_have_text("d2, d4")
        ui.closes("Escape", "sheet-kill")
        ui.press("selection-return")
        wait_until("return", SOON_S, lambda: phases("hold") == set())
        ui.page.keyboard.press("Escape")
        expect(ui.part("group-page")).to_have_count(0)
        ui.opens("Shift+K", "kill-arm")
        expect(ui.part("kill-arm")).to_have_attribute("aria-disabled", "true")  # nothing is selected
        ui.closes("Escape", "sheet-kill")
        assert [sequence.action for sequence in client.commands()][:2] == ["return", "hold"]
        ui.press("stop")
        ui.says("show-phase", "landed", FLIGHT_MS)
        assert ui.wrong == []


def test_after_a_stall_two_presses_return_the_fleet(chrome: Browser, tmp_path: Path) -> None:
    with (
        station(tmp_path, 4, takeoff_m=3.0, radius_m=4.0, height_m=9.0) as ground,
        console(chrome, ground.url, width=1024, height=768) as ui,
    ):
        client = ground.client
        ui.says("connection", "Live")
        wait_until("passes", SOON_S, lambda: client.preflight.report().passes)
        client.start()
        ui.says("show-phase", "running", FLIGHT_MS)
        ground.process.send_signal(signal.SIGSTOP)
        try:
            expect(ui.part("banner")).to_be_visible(timeout=SOON_MS)
            ui.page.wait_for_timeout(8_000)  # longer than the vehicles wait for setpoints
        finally:
            ground.process.send_signal(signal.SIGCONT)
        ui.says("connection", "Live", FLIGHT_MS)
        ui.says("show-phase", "not under control")
        ui.says("show-reason", "4 airborne")
        expect(ui.part("start")).to_have_attribute("aria-disabled", "true")
        for name in ("pause", "stop", "abort"):
            expect(ui.part(name)).not_to_have_attribute("aria-disabled", "true")
        assert ui.serious() == []
        ui.press("take-over")
        ui.says("show-phase", "paused", FLIGHT_MS)
        expect(ui.part("interrupted")).to_have_count(0, timeout=SOON_MS)
        ui.press("stop")
        ui.says("show-phase", re.compile("returning home|landed"), FLIGHT_MS)
        ui.says("show-phase", "landed", FLIGHT_MS)
        ui.says("airborne", "0/4")
        assert ui.wrong == []
