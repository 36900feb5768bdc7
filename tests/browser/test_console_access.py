"""Who may do what, what is said when the connection is gone, and every button by keyboard."""

import os
import signal
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from gcs.api.auth.tokens import create_token
from gcs.service.access import Role
from tests.support.console_bench import SOON_MS, TARGET_PX, Console, Station, console, station
from tests.support.processes import SOON_S, wait_until

REACHABLE = """() => [...document.querySelectorAll("button, input, select, textarea, a[href], [role=region]")]
  .filter((each) => each.checkVisibility({ visibilityProperty: true }) && each.tabIndex >= 0)
  .map((each) => each.dataset.testid ?? each.outerHTML.slice(0, 80))"""

NOTE_FOCUS = """() => {
  const name = (each) => each.dataset.testid ?? each.outerHTML.slice(0, 80);
  const note = (event) => window.focused.push(name(event.target));
  if (!window.focused) document.addEventListener("focusin", note);
  window.focused = [];
  document.activeElement.blur();
}"""


@pytest.fixture(scope="module")
def ground(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """Two vehicles that stay where they are."""
    with station(tmp_path_factory.mktemp("ground"), 2) as started:
        yield started


def reached_by_tab(ui: Console) -> set[str]:
    """Everything that the Tab key comes to, until it begins again."""
    ui.page.evaluate(NOTE_FOCUS)
    found: list[str] = []
    while found.count("start") < 2 and len(found) < 300:
        for _ in range(20):
            ui.page.keyboard.press("Tab")
        found = ui.page.evaluate("window.focused")
    return set(found)


def not_reached(ui: Console) -> set[str]:
    """What is on the page and the Tab key never comes to; again when an alarm comes or goes meanwhile."""
    reached: set[str] = set()
    for _ in range(5):
        before = set(ui.page.evaluate(REACHABLE))
        reached |= reached_by_tab(ui)
        after = set(ui.page.evaluate(REACHABLE))
        missing = (before & after) - reached
        if before == after and not missing:
            break
    return missing


PANELS = [
    *(("preflight", "fleet"), ("shows", "vehicle"), ("shape", "events"), ("obstacles", "plots")),
]


@pytest.mark.soak
@pytest.mark.parametrize(("left", "right"), PANELS)
def test_keyboard_reaches_every_control(chrome: Browser, ground: Station, left: str, right: str) -> None:
    with console(chrome, ground.url) as ui:
        ui.says("connection", "Live")
        for name in (left, right):
            if ui.part(f"panel-{name}").count() == 0:
                ui.part(f"tab-{name}").focus()
                ui.page.keyboard.press("Enter")
            expect(ui.part(f"panel-{name}")).to_be_visible()
        there = set(ui.page.evaluate(REACHABLE))
        assert {"start", "pause", "stop", "abort", "kill", "night", f"tab-{left}"} <= there
        assert not_reached(ui) == set()
        assert ui.wrong == []


@pytest.mark.soak
def test_vehicle_selection_and_kill_by_keyboard(chrome: Browser, ground: Station) -> None:
    with console(chrome, ground.url) as ui:
        ui.says("connection", "Live")
        ui.part("fleet-scroll").focus()
        ui.page.keyboard.press("ArrowDown")
        ui.page.keyboard.press("Enter")
        ui.says("vehicle-id", "d1")
        ui.opens("Shift+K", "kill-arm")
        expect(ui.part("kill-names")).to_have_text("d1")  # the selection, not the fleet
        ui.part("kill-arm").focus()
        ui.page.keyboard.press("Enter")
        expect(ui.part("kill-hold")).to_be_visible(timeout=SOON_MS)
        expect(ui.part("kill-names")).to_have_text("d1")
        ui.part("kill-disarm").focus()
        ui.page.keyboard.press("Enter")
        expect(ui.part("kill-hold")).to_be_hidden()
        assert not [command for command in ground.client.commands() if command.action == "kill"]


def touch(ui: Console, *places: tuple[float, float]) -> None:
    """A finger from the first place over the others to the last."""
    finger = ui.page.context.new_cdp_session(ui.page)
    for kind, place in zip(("touchStart", *("touchMove",) * (len(places) - 1)), places, strict=True):
        points = [{"x": place[0], "y": place[1]}]
        finger.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    finger.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


@pytest.mark.soak
def test_the_target_is_moved_by_touch(chrome: Browser, ground: Station) -> None:
    with console(chrome, ground.url, touch=True) as ui:
        ui.says("connection", "Live")
        ui.part("camera-top").tap()
        x, y = ui.resting("target")
        before = ground.client.target()
        touch(ui, *((x + 5.0 * step, y + TARGET_PX - 4.0 * step) for step in range(11)))
        ui.closes(lambda: ui.part("preview-confirm").tap(timeout=SOON_MS), "preview")
        wait_until("moved", SOON_S, lambda: ground.client.target().x_m != before.x_m)
        assert ui.wrong == []


def children(pid: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text("ascii").split()]


def signalled(pids: Iterable[int], number: int) -> None:
    for pid in pids:
        os.kill(pid, number)


def test_silent_service_is_reported_within_a_second_and_returns(chrome: Browser, ground: Station) -> None:
    with console(chrome, ground.url) as ui:
        ui.says("connection", "Live")
        control = ground.process.pid
        processes = [*children(control), control]  # the API's own would say that control has stopped
        assert len(processes) > 1
        signalled(processes, signal.SIGSTOP)  # the socket stays open, and says nothing
        try:
            ui.loses_its_service()
        finally:
            signalled(processes, signal.SIGCONT)
        ui.says("connection", "Live")
        expect(ui.part("banner")).to_be_hidden()
        ui.press("start")  # what it knows is now, and may be acted on
        assert not [each for each in ui.wrong if "503" not in each]  # until control has ticked again


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Station, dict[Role, str]]]:
    """One vehicle, and a token for each role."""
    folder = tmp_path_factory.mktemp("guarded")
    file = folder / "tokens.json"
    tokens = {role: create_token(file, f"the-{role.value}", role) for role in Role}
    with station(folder, 1, access={"tokens_file": str(file)}) as started:
        yield started, tokens


def enter(ui: Console, token: str) -> None:
    """By keyboard: the field has the focus as soon as it is there."""
    ui.says("login-reason", "token")
    ui.part("token").fill(token)
    ui.page.keyboard.press("Enter")


def refused(ui: Console, *buttons: str) -> dict[str, str]:
    """Why those may not be pressed, as is written on each."""
    for name in buttons:
        expect(ui.part(name)).to_have_attribute("aria-disabled", "true", timeout=SOON_MS)
    return {name: ui.part(f"why-{name}").inner_text() for name in buttons}


BIG = ("start", "pause", "resume", "stop", "abort", "kill")

Guarded = tuple[Station, dict[Role, str]]


@pytest.mark.soak
def test_wrong_token_is_reported_and_a_viewer_sees_all(chrome: Browser, guarded: Guarded) -> None:
    ground, tokens = guarded
    with console(chrome, ground.url) as ui:
        ui.says("login-reason", "asks for a token")
        enter(ui, "gcs_guess")
        ui.says("login-reason", "not known")
        enter(ui, tokens[Role.WATCH])
        ui.says("connection", "Live")
        ui.says("who", "the-watch")
        expect(ui.part("row-d1")).to_contain_text("standby", timeout=SOON_MS)
        assert refused(ui, *BIG) == dict.fromkeys(BIG, "Your token is for viewing only.")
        ui.page.keyboard.press("Shift+K")
        ui.tells("refused", "Your token is for viewing only.")
        expect(ui.part("sheet-kill")).to_have_count(0)
        ui.page.keyboard.press("2")
        expect(ui.part("show-upload")).to_be_disabled()
        ui.page.reload()  # the token is kept
        ui.says("connection", "Live")
        ui.says("who", "the-watch")


@pytest.mark.soak
def test_token_scopes_for_start_landing_and_kill(chrome: Browser, guarded: Guarded) -> None:
    ground, tokens = guarded
    with console(chrome, ground.url) as ui:
        enter(ui, tokens[Role.OPERATE])
        ui.says("who", "the-operate")
        ui.opens("Shift+S", "start-go")
        expect(ui.part("start-go")).not_to_have_attribute("aria-disabled", "true", timeout=SOON_MS)
    with console(chrome, ground.url) as ui:
        enter(ui, tokens[Role.EMERGENCY])
        ui.says("who", "the-emergency")
        only = "Your token is for emergencies only: pause, return, land, kill."
        assert refused(ui, "start", "resume") == dict.fromkeys(("start", "resume"), only)
        ui.opens("Shift+K", "kill-arm")
        ui.says("kill-names", "No vehicle is chosen")
        ui.by_key("kill-pick-d1")
        ui.by_key("kill-arm")
        ui.part("kill-typed").fill(ui.part("kill-code").inner_text())
        ui.page.keyboard.press("Enter")
        expect(ui.part("row-d1")).to_contain_text("killed", timeout=SOON_MS)
