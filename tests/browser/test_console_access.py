"""Who may do what, what is said when the connection is gone, and every button by keyboard."""

import signal
from collections.abc import Iterator

import pytest
from console_bench import SOON_MS, TARGET_PX, Console, Station, chromes, console, station
from ground import SOON_S, wait_until
from playwright.sync_api import Browser, expect

from gcs.api.auth.tokens import create_token
from gcs.service.access import Role

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
        expect(desk.part("kill-names")).to_have_text("d1")  # the selection, not the fleet
        desk.part("kill-arm").focus()
        desk.page.keyboard.press("Enter")
        expect(desk.part("kill-hold")).to_be_visible(timeout=SOON_MS)
        expect(desk.part("kill-names")).to_have_text("d1")
        assert desk.serious() == []
        desk.part("kill-disarm").focus()
        desk.page.keyboard.press("Enter")
        expect(desk.part("kill-hold")).to_be_hidden()
        assert not [command for command in ground.client.commands() if command.action == "kill"]


def touch(desk: Console, *places: tuple[float, float]) -> None:
    """A finger from the first place over the others to the last."""
    finger = desk.page.context.new_cdp_session(desk.page)
    for kind, place in zip(("touchStart", *("touchMove",) * (len(places) - 1)), places, strict=True):
        points = [{"x": place[0], "y": place[1]}]
        finger.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    finger.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def test_the_target_is_moved_by_touch(chrome: Browser, ground: Station) -> None:
    with console(chrome, ground.url, touch=True) as desk:
        desk.says("connection", "Live")
        desk.part("camera-top").tap()
        x, y = desk.resting("target")
        before = ground.client.target()
        touch(desk, *((x + 5.0 * step, y + TARGET_PX - 4.0 * step) for step in range(11)))
        desk.closes(lambda: desk.part("ghost-confirm").tap(timeout=SOON_MS), "ghost")
        wait_until("moved", SOON_S, lambda: ground.client.target().x_m != before.x_m)
        assert desk.wrong == []


def test_a_silent_service_is_reported_within_a_second_and_comes_back(
    chrome: Browser, ground: Station
) -> None:
    with console(chrome, ground.url) as desk:
        desk.says("connection", "Live")
        ground.process.send_signal(signal.SIGSTOP)  # the socket stays open, and says nothing
        try:
            desk.loses_its_service()
        finally:
            ground.process.send_signal(signal.SIGCONT)
        desk.says("connection", "Live")
        expect(desk.part("banner")).to_be_hidden()
        desk.press("start")  # what it knows is now, and may be acted on
        assert desk.wrong == []


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Station, dict[Role, str]]]:
    """One vehicle, and a token for each role."""
    folder = tmp_path_factory.mktemp("guarded")
    file = folder / "tokens.json"
    tokens = {role: create_token(file, f"the-{role.value}", role) for role in Role}
    with station(folder, 1, access={"tokens_file": str(file)}) as started:
        yield started, tokens


def enter(desk: Console, token: str) -> None:
    """By keyboard: the field has the focus as soon as it is there."""
    desk.says("login-reason", "token")
    desk.part("token").fill(token)
    desk.page.keyboard.press("Enter")


def refused(desk: Console, *buttons: str) -> dict[str, str]:
    """Why those may not be pressed, as is written on each."""
    for name in buttons:
        expect(desk.part(name)).to_have_attribute("aria-disabled", "true", timeout=SOON_MS)
    return {name: desk.part(f"why-{name}").inner_text() for name in buttons}


BIG = ("start", "pause", "resume", "stop", "abort", "kill")

Guarded = tuple[Station, dict[Role, str]]


def test_a_wrong_token_says_so_and_a_watcher_sees_all_and_may_press_nothing(
    chrome: Browser, guarded: Guarded
) -> None:
    ground, tokens = guarded
    with console(chrome, ground.url) as desk:
        desk.says("login-reason", "asks for a token")
        enter(desk, "gcs_guess")
        desk.says("login-reason", "not known")
        assert desk.serious() == []
        enter(desk, tokens[Role.WATCH])
        desk.says("connection", "Live")
        desk.says("who", "the-watch")
        expect(desk.part("row-d1")).to_contain_text("standby", timeout=SOON_MS)
        assert refused(desk, *BIG) == dict.fromkeys(BIG, "Your token is for viewing only.")
        desk.page.keyboard.press("Shift+K")
        desk.tells("refused", "Your token is for viewing only.")
        expect(desk.part("sheet-kill")).to_have_count(0)
        desk.page.keyboard.press("2")
        expect(desk.part("show-upload")).to_be_disabled()
        desk.page.reload()  # the token is kept
        desk.says("connection", "Live")
        desk.says("who", "the-watch")


def test_an_operator_may_start_and_an_emergency_token_may_bring_down_and_kill_alone(
    chrome: Browser, guarded: Guarded
) -> None:
    ground, tokens = guarded
    with console(chrome, ground.url) as desk:
        enter(desk, tokens[Role.OPERATE])
        desk.says("who", "the-operate")
        desk.opens("Shift+S", "start-go")
        expect(desk.part("start-go")).not_to_have_attribute("aria-disabled", "true", timeout=SOON_MS)
    with console(chrome, ground.url) as desk:
        enter(desk, tokens[Role.EMERGENCY])
        desk.says("who", "the-emergency")
        only = "Your token is for emergencies only: pause, return, land, kill."
        assert refused(desk, "start", "resume") == dict.fromkeys(("start", "resume"), only)
        desk.opens("Shift+K", "kill-arm")
        desk.says("kill-names", "No vehicle is chosen")
        desk.by_key("kill-pick-d1")
        desk.by_key("kill-arm")
        desk.part("kill-typed").fill(desk.part("kill-code").inner_text())
        desk.page.keyboard.press("Enter")
        expect(desk.part("row-d1")).to_contain_text("killed", timeout=SOON_MS)
