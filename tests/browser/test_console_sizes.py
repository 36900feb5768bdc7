"""At every size of the window every flight command is on screen and pressable, and axe finds nothing serious.

A fleet flies, with an alarm; the page is held upright and sideways, and turned.
"""

import signal
import time
from collections.abc import Iterator
from typing import Final

import pytest
from console_bench import FLIGHT_MS, SOON_MS, Console, Station, chromes, console, fault, station
from ground import SOON_S, wait_until
from machine import free_ports
from playwright.sync_api import Browser, expect

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
STALL_S: Final = 8.0
"""Longer than the fake vehicles fly on without setpoints."""

WIDE: Final = ((740, 360), (844, 390), (1024, 768), (1440, 900), (2560, 1440))
SIZES: Final = ((360, 640), *WIDE, *((height, width) for width, height in WIDE))

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

OVERLAPS: Final = """() => {
  const box = (name) => document.querySelector(name).getBoundingClientRect();
  const [alarms, room] = [box(".alarms"), box("[data-room]")];
  const across = alarms.left < room.right && room.left < alarms.right;
  return across && alarms.top < room.bottom && room.top < alarms.bottom;
}"""
"""Whether alarms lie over the scene."""

chrome = pytest.fixture(scope="module")(chromes)


@pytest.fixture(scope="module")
def flying(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """Four vehicles in formation; the fourth one's battery is low, and no failsafe acts on it."""
    control = free_ports()
    folder = tmp_path_factory.mktemp("flying")
    with station(folder, 4, takeoff_m=3.0, radius_m=4.0, height_m=9.0, control=control) as ground:
        wait_until("ready", SOON_S, lambda: ground.client.preflight.report().passes)
        ground.client.start()
        wait_until("running", SOON_S, lambda: ground.client.show().phase == "running")
        fault(control, vehicle=4, fault="battery", remaining=0.12)
        wait_until("alarm", SOON_S, lambda: ground.client.fleet().alarms != [])
        yield ground


def pressable(desk: Console, *names: str) -> None:
    """Nothing is in the way of these, at once: not after a scroll."""
    assert desk.page.evaluate(UNREACHABLE, list(names)) == []
    assert desk.page.evaluate(CUT_OFF) == []
    assert desk.page.evaluate("document.scrollingElement.scrollWidth <= innerWidth")


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_flight_commands_are_on_screen_whatever_is_open(
    chrome: Browser, flying: Station, width: int, height: int
) -> None:
    with console(chrome, flying.url, width=width, height=height) as desk:
        desk.says("connection", "Live")
        expect(desk.part("alarm").first).to_be_visible()
        assert not desk.page.evaluate(OVERLAPS)
        pressable(desk, *COMMANDS)
        assert desk.page.evaluate(CUT_WORDS, list(PHASES)) == []
        assert desk.serious() == []
        for panel in ("shape", "fleet"):
            if desk.part(f"panel-{panel}").count() == 0:
                desk.press(f"tab-{panel}")
            expect(desk.part(f"panel-{panel}")).to_be_visible()
            pressable(desk, *COMMANDS)
        if desk.part("panel-size").count() > 0:
            desk.press("panel-size")  # the sheet covers the scene, and no command
            pressable(desk, *COMMANDS)
        assert desk.serious() == []
        for key, sheet in (("?", "help"), ("Shift+K", "kill")):
            desk.opens(key, f"sheet-{sheet}")
            pressable(desk, *COMMANDS)
            assert desk.serious() == []
            desk.closes("Escape", f"sheet-{sheet}")
        assert desk.wrong == []


def test_a_kill_is_armed_and_disarmed_on_a_small_phone(chrome: Browser, flying: Station) -> None:
    with console(chrome, flying.url, width=360, height=640, touch=True) as desk:
        desk.says("connection", "Live")
        for width, height in ((360, 640), (640, 360)):
            desk.page.set_viewport_size({"width": width, "height": height})
            desk.opens(lambda: desk.tap("kill"), "kill-arm")
            desk.tap("kill-pick-d1")
            desk.tap("kill-arm")
            expect(desk.part("kill-hold")).to_be_visible(timeout=SOON_MS)
            pressable(desk, *COMMANDS)
            desk.part("kill-hold").scroll_into_view_if_needed()
            assert desk.page.evaluate(UNREACHABLE, ["kill-hold"]) == []
            desk.part("kill-disarm").tap()
            desk.part("kill-cancel").tap()
        assert not [command for command in flying.client.commands() if command.action == "kill"]


def test_a_press_on_a_phone_says_why_a_command_is_unavailable(chrome: Browser, flying: Station) -> None:
    with console(chrome, flying.url, width=390, height=844, touch=True) as desk:
        desk.says("connection", "Live")
        for width, height in ((390, 844), (844, 390)):
            desk.page.set_viewport_size({"width": width, "height": height})
            desk.until(
                lambda: desk.part("start").tap(force=True),  # it is unavailable, and answers
                lambda within_ms: desk.tells("refused", "airborne", within_ms),
            )
            expect(desk.part("toast-refused").first).to_be_in_viewport(ratio=1.0)
            desk.part("toast-dismiss").first.tap()
            expect(desk.part("toast-refused")).to_have_count(0, timeout=SOON_MS)


def test_commands_are_given_on_a_phone_that_is_turned_and_after_a_stall(
    chrome: Browser, flying: Station
) -> None:
    """Last of all: it lands the fleet."""
    with console(chrome, flying.url, width=360, height=740, touch=True) as desk:
        desk.says("connection", "Live")
        desk.until(lambda: desk.tap("pause"), lambda ms: desk.says("show-phase", "paused", ms))
        desk.part("tab-fleet").tap()
        desk.page.set_viewport_size({"width": 740, "height": 360})
        expect(desk.part("desk")).to_have_attribute("data-layout", "side")
        expect(desk.part("panel-fleet")).to_be_visible()
        pressable(desk, *COMMANDS)
        desk.part("close-right").tap()
        desk.until(
            lambda: desk.tap("resume"),
            lambda ms: expect(desk.part("show-phase")).not_to_contain_text("paused", timeout=ms),
        )

        desk.page.set_viewport_size({"width": 360, "height": 740})
        flying.process.send_signal(signal.SIGSTOP)
        time.sleep(STALL_S)
        flying.process.send_signal(signal.SIGCONT)
        expect(desk.part("take-over")).to_be_visible(timeout=SOON_MS)
        pressable(desk, *OFFERS, *COMMANDS)
        assert desk.serious() == []
        desk.page.set_viewport_size({"width": 740, "height": 360})
        pressable(desk, *OFFERS, *COMMANDS)
        desk.closes(lambda: desk.tap("bring-home"), "bring-home")
        desk.says("show-phase", "landed", FLIGHT_MS)
