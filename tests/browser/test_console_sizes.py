"""At every size of the window every flight command is on screen and pressable.

A fleet flies, with an alarm; the page is held upright and sideways, and turned.
"""

import re
import signal
from collections.abc import Iterator
from typing import Final

import pytest
from playwright.sync_api import Browser, expect

from tests.support.console_bench import FLIGHT_MS, SOON_MS, Console, Station, console, fault, station
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, wait_passes, wait_until

pytestmark = pytest.mark.soak

COMMANDS: Final = ("start", "pause", "resume", "stop", "abort", "kill")
PHASES: Final = (
    "running",
    "assembling",
    "taking off",
    "returning home",
    "counting down",
    "not under control",
)
OFFERS: Final = ("take-over", "bring-home")
STALL_MS: Final = 6_500
"""Longer than the fake vehicles fly on without setpoints."""

WIDE: Final = ((740, 360), (1024, 768), (1440, 900))
PHONE: Final = (390, 844)
SIZES: Final = (
    *((360, 640), (740, 360), (768, 1024), (1440, 900)),
    *(PHONE, (1024, 768), (844, 390), (2560, 1440), (360, 740), (900, 1440), (1440, 2560)),
)
"""Upright and sideways. `make test` has the smallest."""

UNREACHABLE: Final = """(names) => names.flatMap((name) => {
  const element = document.querySelector(`[data-testid="${name}"]`);
  if (element === null) return [`${name} is not there`];
  const { left, top, right, bottom } = element.getBoundingClientRect();
  const wrong = [];
  if (right - left < 44 || bottom - top < 44) wrong.push(`${name} is ${right - left} x ${bottom - top}`);
  if (left < 0 || top < 0 || right > innerWidth || bottom > innerHeight) wrong.push(`${name} is off screen`);
  for (const across of [0.1, 0.5, 0.9]) {
    for (const down of [0.1, 0.5, 0.9]) {
      const hit = document.elementFromPoint(left + across * (right - left), top + down * (bottom - top));
      if (!element.contains(hit)) wrong.push(`${name} is covered by ${hit?.className}`);
    }
  }
  return wrong;
})"""
"""Of these, what cannot be pressed with a finger, and why."""

CUT_OFF: Final = """() => [...document.querySelectorAll(
    ".big-label, .offers .button, .topbar, .topbar strong, .fleet th, .table-scroll")]
  .filter((each) => each.checkVisibility() && each.scrollWidth > each.clientWidth + 1)
  .map((each) => `${each.className}: ${each.textContent.trim().slice(0, 60)}`)"""
"""Words and columns that their place cuts off."""

CUT_WORDS: Final = """(words) => {
  const phase = document.querySelector("[data-testid=show-phase]");
  const text = [...phase.childNodes].find((node) => node.nodeType === Node.TEXT_NODE && node.data.trim());
  const was = text.data;
  try {
    return words.filter((word) => (text.data = word, phase.scrollWidth > phase.clientWidth + 1));
  } finally {
    text.data = was;
  }
}"""
"""Which of these phases the bar cuts off."""

REMARK_IS_CUT: Final = """(remark) => {
  const nodes = ["phase", "reason"].map((name) => {
    const place = document.querySelector(`[data-testid=show-${name}]`);
    return [...place.childNodes].find((node) => node.nodeType === Node.TEXT_NODE);
  });
  const was = nodes.map((node) => node.data);
  const small = nodes[1].parentElement;
  try {
    [nodes[0].data, nodes[1].data] = ["idle", remark];
    return small.scrollWidth > small.clientWidth + 1 || small.scrollHeight > small.clientHeight + 1;
  } finally {
    [nodes[0].data, nodes[1].data] = was;
  }
}"""
"""Whether the bar cuts off this remark beside its shortest phase."""

HIDDEN_TABS: Final = """() => [...document.querySelectorAll(".rails .tab")].filter((tab) => {
  const { left, right, top, bottom } = tab.getBoundingClientRect();
  const [span] = tab.getElementsByTagName("span");
  const isCut = span.getBoundingClientRect().width > right - left + 1;
  return isCut || left < 0 || top < 0 || right > innerWidth || bottom > innerHeight;
}).map((tab) => tab.textContent.trim())"""
"""Tabs of panels that are off screen, or whose name has no room."""

ROWS: Final = """() => {
  const { top, bottom } = document.querySelector(".table-scroll").getBoundingClientRect();
  const rows = [...document.querySelectorAll("tr[data-testid]")].map((row) => row.getBoundingClientRect());
  return rows.filter((row) => row.top >= top && row.bottom <= Math.min(bottom, innerHeight)).length;
}"""
"""Rows of the fleet's table that are seen whole."""

OVERLAPS: Final = """() => {
  const box = (name) => document.querySelector(name).getBoundingClientRect();
  const [alarms, room] = [box(".alarms"), box("[data-room]")];
  const across = alarms.left < room.right && room.left < alarms.right;
  return across && alarms.top < room.bottom && room.top < alarms.bottom;
}"""
"""Whether alarms lie over the scene."""


@pytest.fixture(scope="module")
def flying(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """Four vehicles in formation; the fourth one's battery is low, and no failsafe acts on it."""
    control = free_ports()
    folder = tmp_path_factory.mktemp("flying")
    with station(folder, 4, takeoff_m=3.0, radius_m=5.0, height_m=10.0, control=control) as ground:
        wait_passes(ground.client)
        ground.client.start()
        wait_until("running", SOON_S, lambda: ground.client.show().phase == "running")
        fault(control, vehicle=4, fault="battery", remaining=0.12)
        wait_until("alarm", SOON_S, lambda: ground.client.fleet().alarms != [])
        yield ground


def pressable(ui: Console, *names: str) -> None:
    """Nothing is in the way of these, without a scroll."""
    ui.settles(UNREACHABLE, list(names), at=[])
    ui.settles(CUT_OFF, at=[])
    ui.settles("document.scrollingElement.scrollWidth <= innerWidth", at=True)


@pytest.mark.keeps("360-640")
@pytest.mark.parametrize(("width", "height"), SIZES)
def test_flight_commands_are_on_screen_whatever_is_open(
    chrome: Browser, flying: Station, width: int, height: int
) -> None:
    with console(chrome, flying.url, width=width, height=height) as ui:
        ui.says("connection", "Live")
        expect(ui.part("alarm").first).to_be_visible()
        ui.settles(OVERLAPS, at=False)
        pressable(ui, *COMMANDS)
        ui.settles(CUT_WORDS, list(PHASES), at=[])
        ui.settles(HIDDEN_TABS, at=[])
        if (width, height) == PHONE:
            ui.settles(REMARK_IS_CUT, "nothing has been started", at=False)
        for panel in ("shape", "fleet"):
            if ui.part(f"panel-{panel}").count() == 0:
                ui.opens(lambda panel=panel: ui.press(f"tab-{panel}"), f"panel-{panel}")  # type: ignore[misc]
            pressable(ui, *COMMANDS)
        if ui.part("panel-size").count() > 0:
            ui.press("panel-size")  # the sheet covers the scene, and no command
            pressable(ui, *COMMANDS)
            ui.settles(f"({ROWS})() >= 4", at=True)
        for key, sheet in (("?", "help"), ("Shift+K", "kill")):
            ui.opens(key, f"sheet-{sheet}")
            pressable(ui, *COMMANDS)
            assert ui.part(f"sheet-{sheet}").evaluate("(sheet) => sheet.scrollTop") == 0
            ui.closes("Escape", f"sheet-{sheet}")
        assert ui.wrong == []


def test_a_kill_is_armed_and_disarmed_on_a_small_phone(chrome: Browser, flying: Station) -> None:
    with console(chrome, flying.url, width=360, height=640, touch=True) as ui:
        ui.says("connection", "Live")
        for width, height in ((360, 640), (640, 360)):
            ui.page.set_viewport_size({"width": width, "height": height})
            ui.opens(lambda: ui.tap("kill"), "kill-arm")
            ui.says("kill-count", "0 of the 4 vehicles listed here")
            ui.tap("kill-pick-d1")
            ui.tap("kill-arm")
            expect(ui.part("kill-hold")).to_be_visible(timeout=SOON_MS)
            pressable(ui, *COMMANDS)
            ui.part("kill-hold").scroll_into_view_if_needed()
            assert ui.page.evaluate(UNREACHABLE, ["kill-hold"]) == []
            ui.part("kill-disarm").tap()
            ui.part("kill-cancel").tap()
        assert not [command for command in flying.client.commands() if command.action == "kill"]


@pytest.mark.soak
def test_press_on_a_phone_explains_an_unavailable_command(chrome: Browser, flying: Station) -> None:
    with console(chrome, flying.url, width=390, height=844, touch=True) as ui:
        ui.says("connection", "Live")
        for width, height in ((390, 844), (844, 390)):
            ui.page.set_viewport_size({"width": width, "height": height})
            ui.until(
                lambda: ui.part("start").tap(force=True),  # it is unavailable, and answers
                lambda within_ms: ui.tells("refused", "airborne", within_ms),
            )
            expect(ui.part("toast-refused").first).to_be_in_viewport(ratio=1.0)
            ui.part("toast-dismiss").first.tap()
            expect(ui.part("toast-refused")).to_have_count(0, timeout=SOON_MS)


@pytest.mark.soak
def test_commands_on_a_turned_phone_and_after_a_stall(chrome: Browser, flying: Station) -> None:
    """Last of all: it lands the fleet."""
    with console(chrome, flying.url, width=360, height=740, touch=True) as ui:
        ui.says("connection", "Live")
        ui.until(lambda: ui.tap("pause"), lambda ms: ui.says("show-phase", "paused", ms))
        ui.part("tab-fleet").tap()
        ui.page.set_viewport_size({"width": 740, "height": 360})
        expect(ui.part("panels")).to_have_attribute("data-layout", "side")
        expect(ui.part("panel-fleet")).to_be_visible()
        pressable(ui, *COMMANDS)
        ui.part("close-right").tap()
        ui.until(
            lambda: ui.tap("resume"),
            lambda ms: expect(ui.part("show-phase")).not_to_contain_text("paused", timeout=ms),
        )

        ui.page.set_viewport_size({"width": 360, "height": 740})
        flying.process.send_signal(signal.SIGSTOP)
        try:
            expect(ui.part("banner")).to_be_visible(timeout=SOON_MS)
            ui.page.wait_for_timeout(STALL_MS)
        finally:
            flying.process.send_signal(signal.SIGCONT)
        expect(ui.part("take-over")).to_be_visible(timeout=SOON_MS)
        ui.says("show-phase", "not under control")
        ui.says("show-reason", re.compile("[34] airborne"))  # a low battery may have landed the fourth
        expect(ui.part("start")).to_have_attribute("aria-disabled", "true")
        for name in ("pause", "stop", "abort"):
            expect(ui.part(name)).not_to_have_attribute("aria-disabled", "true")
        pressable(ui, *OFFERS, *COMMANDS)
        ui.page.set_viewport_size({"width": 740, "height": 360})
        pressable(ui, *OFFERS, *COMMANDS)
        ui.closes(lambda: ui.tap("bring-home"), "bring-home")
        ui.says("show-phase", "landed", FLIGHT_MS)
        ui.says("airborne", "0/4")
        assert ui.wrong == []
