"""Who may do what, what is said when the connection is gone, and every button by keyboard."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from console_bench import SOON_MS, Console, Station, chromes, console, station
from playwright.sync_api import Browser, expect

from gcs.access import Role
from gcs.tokens import create_token

REACHABLE = """() => [...document.querySelectorAll("button, input, select, textarea, a[href], [role=region]")]
  .filter((each) => each.checkVisibility({ visibilityProperty: true }) && each.tabIndex >= 0)
  .map((each) => each.dataset.testid ?? each.outerHTML.slice(0, 80))"""

chrome = pytest.fixture(scope="module")(chromes)

NOTE_FOCUS = """() => {
  window.focused = [];
  const name = (each) => each.dataset.testid ?? each.outerHTML.slice(0, 80);
  document.addEventListener("focusin", (event) => window.focused.push(name(event.target)));
  document.activeElement.blur();
}"""


@pytest.fixture(scope="module")
def ground(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """Two vehicles that stay where they are."""
    with station(tmp_path_factory.mktemp("ground"), 2) as started:
        yield started


def reached_by_tab(desk: Console) -> set[str]:
    """Everything that the Tab key comes to, until it begins again."""
    desk.page.evaluate(NOTE_FOCUS)
    found: list[str] = []
    while found.count("start") < 2 and len(found) < 300:
        for _ in range(20):
            desk.page.keyboard.press("Tab")
        found = desk.page.evaluate("window.focused")
    return set(found)


PANELS = [
    *(("preflight", "fleet"), ("shows", "vehicle"), ("shape", "events"), ("obstacles", "plots")),
]


@pytest.mark.parametrize(("left", "right"), PANELS)
def test_every_button_and_field_is_reached_by_keyboard_and_axe_finds_nothing_serious(
    chrome: Browser, ground: Station, left: str, right: str
) -> None:
    with console(chrome, ground.url) as desk:
        desk.says("connection", "Live")
        for name in (left, right):
            if desk.part(f"panel-{name}").count() == 0:
                desk.part(f"tab-{name}").focus()
                desk.page.keyboard.press("Enter")
            expect(desk.part(f"panel-{name}")).to_be_visible()
        there = set(desk.page.evaluate(REACHABLE))
        assert {"start", "pause", "stop", "abort", "kill", "night", f"tab-{left}"} <= there
        assert there - reached_by_tab(desk) == set()
        assert desk.serious() == []
        assert desk.wrong == []


def test_a_vehicle_is_chosen_and_a_kill_is_armed_and_disarmed_by_keyboard(
    chrome: Browser, ground: Station
) -> None:
    with console(chrome, ground.url) as desk:
        desk.says("connection", "Live")
        desk.part("fleet-scroll").focus()
        desk.page.keyboard.press("ArrowDown")
        desk.page.keyboard.press("Enter")
        desk.says("vehicle-id", "d1")
        desk.opens("Shift+K", "kill-arm")
        desk.part("kill-arm").focus()
        desk.page.keyboard.press("Enter")
        desk.says("kill-names", "d1, d2")
        assert desk.serious() == []
        desk.part("kill-disarm").focus()
        desk.page.keyboard.press("Enter")
        expect(desk.part("kill-hold")).to_be_hidden()
        assert not [order for order in ground.client.orders() if order.action == "kill"]


def test_a_silent_service_is_told_within_a_second_and_comes_back(chrome: Browser, ground: Station) -> None:
    with console(chrome, ground.url) as desk:
        desk.says("connection", "Live")
        ground.process.send_signal(signal.SIGSTOP)  # the socket stays open, and says nothing
        try:
            desk.says("connection", "No connection")
            expect(desk.part("banner")).to_be_visible()
            expect(desk.part("desk")).to_have_attribute("data-life", "lost")
            seen = desk.seen()
        finally:
            ground.process.send_signal(signal.SIGCONT)
        (lost,) = [each for each in seen["said"] if each["text"] == "No connection"]
        silent_ms = lost["at_ms"] - lost["message_ms"]
        stood_still_ms = sum(
            each["to_ms"] - each["from_ms"] for each in seen["stalled"] if each["to_ms"] > lost["message_ms"]
        )
        assert silent_ms < 1000.0 + stood_still_ms
        desk.says("connection", "Live")
        expect(desk.part("banner")).to_be_hidden()
        desk.press("start")  # what it knows is now, and may be acted on
        assert desk.wrong == []


def test_a_service_that_ends_is_told_at_once_and_nothing_can_be_ordered(
    chrome: Browser, tmp_path: Path
) -> None:
    with station(tmp_path, 1) as alone, console(chrome, alone.url) as desk:
        desk.says("connection", "Live")
        alone.process.kill()
        desk.says("connection", "No connection")
        expect(desk.part("start")).to_have_attribute("aria-disabled", "true")
        desk.part("start").click(force=True)  # it can be pressed, and says why it does nothing
        desk.says("toast-refused", "No fresh data")


def test_a_wrong_token_says_so_and_a_right_one_is_kept_and_may_what_it_may(
    chrome: Browser, tmp_path: Path
) -> None:
    file = tmp_path / "tokens.json"
    token = create_token(file, "guest", Role.WATCH)
    with (
        station(tmp_path, 1, access={"tokens_file": str(file)}) as ground,
        console(chrome, ground.url) as desk,
    ):
        desk.says("login-reason", "asks for a token")
        desk.part("token").fill("gcs_guess")
        desk.page.keyboard.press("Enter")
        desk.says("login-reason", "not known")
        assert desk.serious() == []
        desk.part("token").fill(token)
        desk.page.keyboard.press("Enter")
        desk.says("connection", "Live")
        desk.says("who", "guest")
        expect(desk.part("start")).to_have_attribute("aria-disabled", "true")
        desk.page.keyboard.press("Shift+S")
        expect(desk.part("toast-refused")).to_be_visible(timeout=SOON_MS)
        desk.page.reload()
        desk.says("connection", "Live")
        desk.says("who", "guest")
