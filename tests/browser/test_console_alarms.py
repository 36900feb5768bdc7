"""Alarms as they come, the selection, and the way back after a stall: what an operator sees and commands."""

import random
import re
import signal
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

import httpx
import pytest
from playwright.sync_api import Browser, expect

from tests.support.alarm_causes import injections, kill
from tests.support.console_bench import (
    SOON_MS,
    Console,
    Station,
    console,
    fault,
    station,
)
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, wait_passes, wait_until

pytestmark = pytest.mark.soak

COUNT: Final = 12
ON_SCREEN_MS: Final = 500.0
"""From the message to the picture; the service sends what has changed within 0.5 s."""

LAID_OUT_MS: Final = 700.0
"""For the page to take note of the window's new size."""

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

COUNTED: Final = """() => [
  document.querySelectorAll("[data-alarm]").length,
  document.querySelector("[data-testid=alarms-all]").innerText.trim(),
]"""
"""How many alarms there are, and what the button for all of them says."""

UNSEEN: Final = """(rows) => [...document.querySelectorAll(rows)].filter((row) => {
  row.scrollIntoView({ block: "center", behavior: "instant" });
  const { left, right, top, bottom } = row.getBoundingClientRect();
  return !row.contains(document.elementFromPoint((left + right) / 2, (top + bottom) / 2));
}).map((row) => row.textContent)"""
"""Which of these cannot be scrolled to. In one turn of the page: no alarm comes or goes meanwhile."""

ALL_SHOWN: Final = "window.seen.alarms.every((each) => each.shown_ms !== null || each.left_ms !== null)"
"""Whether every alarm that is listed has been on the page."""

STAYING: Final = "[data-alarm]:is([data-severity=emergency], [data-severity=warning])"
"""Alarms that stay until they are acknowledged."""

SEVERITIES: Final = ("emergency", "warning", "caution", "information")

FAILSAFES: Final[dict[str, dict[str, Any]]] = {
    "vehicles_lost": {"action": "pause", "count": 2, "share": 0.01},
    "wind": {
        "action": "pause",
        "then_return_after_s": None,
        "speed_error_m_s": 0.8,  # also of a fleet that is paused, and steers against the wind
        "for_s": 4.0,  # fakes that fall behind their setpoints on a busy machine are no wind
        "share": 0.05,
    },
    "links_late": {"late_s": 5.0, "arrive_min": 0.2},  # a busy machine is no late link
}
"""These pause the show and do not end it."""


@contextmanager
def broken_fleet(folder: Path, control: int, count: int = COUNT) -> Iterator[Station]:
    """Vehicles that receive faults, and a service whose failsafes keep the show where it is."""
    with station(
        folder,
        count,
        takeoff_m=4.0,
        ground={"tiles": str(folder / "none.mbtiles")},
        control=control,
        silence_s=2.0,
        failsafes=FAILSAFES,
        radius_m=9.0,
        height_m=15.0,
    ) as ground:
        yield ground


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


def listed(ui: Console) -> list[dict[str, Any]]:
    """The alarms of the page, from top to bottom."""
    found: list[dict[str, Any]] = ui.part("alarm").evaluate_all(
        "(all) => all.map((each) => ({...each.dataset, height: each.getBoundingClientRect().height,"
        " ended: each.classList.contains('ended')}))"
    )
    return found


def not_shown_in_time(ui: Console) -> list[str]:
    """Alarms that the page did not show so long after they came, without the time it stood still.

    One that leaves the list before the page can draw, as a caution that ends, is in the log alone.
    Emergencies and warnings stay listed until they are acknowledged, all but control-stopped.
    """
    wait_until("every alarm is on the page", SOON_S, lambda: bool(ui.page.evaluate(ALL_SHOWN)))
    ui.page.evaluate("() => new Promise(requestAnimationFrame)")  # ends the time that it stands still now
    seen = ui.seen()
    late = []
    for alarm in seen["alarms"]:
        shown_ms, left_ms = alarm["shown_ms"], alarm["left_ms"]
        until_ms = next(at_ms for at_ms in (shown_ms, left_ms, seen["message_ms"]) if at_ms is not None)
        took_ms = until_ms - alarm["listed_ms"]
        stalled_ms = sum(
            max(0.0, min(each["to_ms"], until_ms) - max(each["from_ms"], alarm["listed_ms"]))
            for each in seen["stalled"]
        )
        if took_ms - stalled_ms > ON_SCREEN_MS:
            late.append(f"{alarm['id']}: {took_ms:.0f} ms, stalled {stalled_ms:.0f} ms")
    return late


def take_off(ground: Station, *spare: str) -> None:
    """Until the show runs; `spare` vehicles stay on the ground."""
    client = ground.client
    wait_until("ready", SOON_S, lambda: all(each.ready for each in client.fleet().vehicles))
    for name in spare:
        client.preflight.exclude(name, reason="spare")
    wait_passes(client)
    client.start()
    wait_until("running", SOON_S, lambda: client.show().phase == "running")


@pytest.mark.parametrize("seed", [14, pytest.param(2026, marks=pytest.mark.soak)])
def test_twelve_alarms_three_at_once_are_visible_by_severity(
    chrome: Browser, tmp_path: Path, seed: int
) -> None:
    control = free_ports()
    with (
        broken_fleet(tmp_path, control) as ground,
        ExitStack() as stack,
        console(chrome, ground.url, width=1440, height=900) as ui,
    ):
        ui.says("connection", "Live")
        ui.page.keyboard.press("Escape")
        take_off(ground, "d12")
        inject = injections(ground, control, stack)
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
        assert ui.page.evaluate(UNSEEN, STAYING) == []
        ui.press("alarms-all")
        assert ui.page.evaluate(UNSEEN, STAYING) == []
        ui.says("overall-word", "Emergency")
        expect(ui.page).to_have_title(re.compile("^EMERGENCY"))
        expect(ui.page.locator("link[rel=icon]")).to_have_attribute("href", re.compile("icon-emergency"))
        assert ui.seen()["tones"] > 0

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


@pytest.mark.soak
def test_after_a_stall_alarms_table_and_recovery_are_visible(chrome: Browser, tmp_path: Path) -> None:
    control = free_ports()
    with (
        broken_fleet(tmp_path, control, 7) as ground,
        console(chrome, ground.url, width=1440, height=900) as ui,
    ):
        take_off(ground)
        fault(control, vehicle=1, fault="silence")
        fault(control, vehicle=2, fault="pilot", mode="POSITION")
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
            alarms = listed(ui)
            assert alarms[0]["severity"] == "emergency"  # a busy machine may report control-stopped after it
            assert any(each["cause"] == "killed" for each in alarms)
            assert seen["alarms"][:least] == [True] * least, (width, height, seen)
            assert sum(seen["rows"]) >= rows, (width, height, seen)
            if rows == 0:
                count, text = ui.page.evaluate(COUNTED)  # at one moment: alarms come and end
                assert text == f"Show all {count}", (count, text)
                ui.press("alarms-all")
                expect(ui.part("alarms-all")).to_have_attribute("aria-expanded", "true")
                expect(ui.part("acknowledge-all")).to_be_in_viewport(ratio=1.0)
                assert ui.page.evaluate(UNSEEN, "[data-alarm]:last-of-type") == []
                ui.press("alarms-all")
        assert [each for each in ui.wrong if "503" not in each] == []  # the service stood still
