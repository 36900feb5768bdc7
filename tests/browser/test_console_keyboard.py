"""Every command of the API is given by keyboard alone, from a page that was just opened."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Final, TypeAlias

import pytest
from playwright.sync_api import Browser, expect

from gcs.api.app import create_app
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service.alarms import AlarmCause
from tests.support import console_states as states
from tests.support.api_fake_service import FakeService
from tests.support.console_bench import AGAIN_MS, SOON_MS, Console
from tests.support.console_states import ConsoleState, Prepare, flown, in_state
from tests.support.show_files import checked_show

pytestmark = pytest.mark.usefixtures("prompt_checks")

Command: TypeAlias = tuple[str, str]
"""Method and path of the API, below /api/v1/."""

Step: TypeAlias = str | Callable[[Console], None]
"""`!KEY` is pressed, `@NAME` is reached by Tab, `>NAME` is reached and pressed, `>>NAME` once more when it
asks, `NAME=TEXT` is reached and typed into. `*` ends the beginning of a name."""

TABS_MAX: Final = 250

ASKING: Final = re.compile(r"\bdanger\b")
"""Class of a button that is pressed once, and waits for the second press."""

KEYS: Final = dict(zip(("preflight", "shows", "shape", "obstacles", "fleet"), "12345", strict=True))

FOCUS: Final = """() => {
  const one = document.activeElement;
  if (one === null || one === document.body) return { name: "", wrong: "" };
  const ringed = one.matches("input[type=file]") ? one.closest("label") : one.closest(".field-box") ?? one;
  const { outlineStyle, boxShadow } = getComputedStyle(ringed);
  const { left, top, right, bottom } = ringed.getBoundingClientRect();
  const isOnScreen = right > 0 && bottom > 0 && left < innerWidth && top < innerHeight;
  const hasRing = outlineStyle !== "none" || boxShadow !== "none";
  const name = one.dataset.testid ?? one.outerHTML.slice(0, 80);
  return { name, wrong: !isOnScreen ? "is off the screen" : hasRing ? "" : "has no ring" };
}"""
"""What has the focus, and what is wrong with how that is seen."""


@dataclass(frozen=True, slots=True)
class ByKeys:
    """How a command is given in one state of the console."""

    steps: Sequence[Step]
    prepare: Prepare = states.running
    stations: tuple[str, ...] = ()
    life: str = "Live"
    is_lost: bool = False  # the focus: nothing of the page had it


def is_named(desired: str, name: str) -> bool:
    return name.startswith(desired[:-1]) if desired.endswith("*") else name == desired


def reach(ui: Console, desired: str) -> None:
    """Press Tab until that part has the focus. What has it meanwhile is seen to have it, and lets it go."""
    before = ui.page.evaluate(FOCUS)["name"]
    for _ in range(TABS_MAX):
        if is_named(desired, before):
            return
        ui.page.keyboard.press("Tab")
        focus = ui.page.evaluate(FOCUS)
        assert focus["wrong"] == "", focus
        before = focus["name"]
    raise AssertionError(f"Tab does not come to {desired}")


def take(ui: Console, step: Step) -> None:
    """One step, once the page is ready for it."""
    if not isinstance(step, str):
        step(ui)
    elif step.startswith("@"):
        reach(ui, step[1:])
    elif step.startswith("!"):
        ui.page.keyboard.press(step[1:])
    elif step.startswith(">>"):
        take(ui, step[1:])
        expect(ui.part(step[2:])).to_have_class(ASKING)  # what is pressed before it is drawn confirms nothing
        take(ui, step[1:])
    elif step.startswith(">"):
        part = ui.page.locator(selector(step[1:])).first
        expect(part).not_to_have_attribute("aria-disabled", "true", timeout=SOON_MS)
        reach(ui, step[1:])
        ui.page.keyboard.press("Enter")
    else:
        name, _, text = step.partition("=")
        expect(ui.part(name)).to_be_visible(timeout=SOON_MS)
        reach(ui, name)
        ui.page.keyboard.press("Control+a")
        ui.page.keyboard.type(text)


def selector(name: str) -> str:
    return f'[data-testid^="{name[:-1]}"]' if name.endswith("*") else f'[data-testid="{name}"]'


def type_code(ui: Console) -> None:
    """The code of the kill, as it is shown."""
    take(ui, f"kill-typed={ui.part('kill-code').inner_text()}")


def chooses(name: str, content: Callable[[], bytes]) -> Step:
    """With the focus on the button that uploads: Enter asks for a file."""

    def step(ui: Console) -> None:
        expect(ui.part("show-upload")).to_be_visible(timeout=SOON_MS)
        reach(ui, "show-upload")
        ui.until(lambda: press(ui), lambda _within_ms: None)

    def press(ui: Console) -> None:
        """In vain while the page has no fresh data."""
        with ui.page.expect_file_chooser(timeout=AGAIN_MS) as asked:
            ui.page.keyboard.press("Enter")
        asked.value.set_files({"name": name, "mimeType": "text/plain", "buffer": content()})

    return step


def opened(panel: str) -> Step:
    """By its key, unless it is open."""

    def step(ui: Console) -> None:
        if ui.part(f"panel-{panel}").count() == 0:
            ui.page.keyboard.press(KEYS[panel])
        expect(ui.part(f"panel-{panel}")).to_be_visible(timeout=SOON_MS)

    return step


def shows(part: str) -> Step:
    return lambda ui: expect(ui.part(part).first).to_be_visible(timeout=SOON_MS)


def with_show(service: FakeService) -> None:
    """A show that was checked, and is good to fly."""
    checked_show(service.shows)


def with_selected(service: FakeService) -> None:
    show_hash = checked_show(service.shows)
    states.selected(service)
    assert service.selected is not None
    service.selected = replace(service.selected, name="lighthouse", hash=show_hash)


def excluded(service: FakeService) -> None:
    service.exclude("d2", "propeller")


TABLE: Final = (opened("fleet"), shows("row-d1"), "@fleet-scroll")


def of_vehicle(action: str, phase: Phase) -> ByKeys:
    """On the page of the first vehicle."""
    show = ShowPhase.IDLE if phase is Phase.STANDBY else ShowPhase.RUNNING
    steps = (*TABLE, "!Home", "!Enter", shows("vehicle-id"), f">vehicle-{action}")
    return ByKeys(steps, flown(show, phase))


def of_selection(action: str, phase: Phase) -> ByKeys:
    """For every vehicle of the table."""
    return ByKeys((*TABLE, "!Control+a", f">selection-{action}"), flown(ShowPhase.RUNNING, phase))


def of_show(key: str, phase: ShowPhase = ShowPhase.RUNNING) -> ByKeys:
    """At once, wherever the focus is."""
    return ByKeys((f"!Shift+{key}",), flown(phase, Phase.FORMATION), is_lost=True)


NOON: Final = f"{datetime.now().astimezone() + timedelta(hours=2):%H:%M:%S}"
FROM: Final = {
    "hold": Phase.FORMATION,
    "join": Phase.HOLD,
    "return": Phase.FORMATION,
    "land": Phase.FORMATION,
    "take-control": Phase.PILOT,
}

COMMANDS: Final[dict[Command, ByKeys]] = {
    ("POST", "alarms/acknowledge"): ByKeys((">acknowledge-all",), states.alarmed(AlarmCause.WIND)),
    ("POST", "alarms/{alarm_id}/acknowledge"): ByKeys(
        (">acknowledge-wind*",), states.alarmed(AlarmCause.WIND)
    ),
    **{("POST", f"fleet/{action}"): of_selection(action, phase) for action, phase in FROM.items()},
    **{
        ("POST", f"vehicles/{{vehicle_id}}/{action}"): of_vehicle(action, phase)
        for action, phase in FROM.items()
    },
    ("POST", "vehicles/{vehicle_id}/confirm-down"): of_vehicle("confirm-down", Phase.LOST),
    ("POST", "vehicles/{vehicle_id}/find"): of_vehicle("find", Phase.STANDBY),
    ("POST", "vehicles/{vehicle_id}/exclude"): ByKeys(
        (opened("preflight"), ">exclude-d3", "exclude-reason=propeller", "!Enter"), states.fails
    ),
    ("POST", "vehicles/{vehicle_id}/include"): ByKeys((opened("preflight"), ">include-d2"), excluded),
    ("POST", "show/confirm"): ByKeys((">>go-confirm",), states.proposed),
    ("POST", "go/sign"): ByKeys((">tab-feature-go", ">sign-pads-1"), states.proposed),
    ("POST", "go/reopen"): ByKeys((">tab-feature-go", ">reopen-pads-2"), states.proposed),
    ("PUT", "go/weather"): ByKeys(
        (">tab-feature-go", "weather:wind_m_s=4", ">weather-enter"), states.proposed
    ),
    ("PATCH", "formation"): ByKeys((opened("shape"), "formation:radius_m=14", "!Enter")),
    ("PATCH", "orbit"): ByKeys((opened("shape"), "orbit:radius_m=5", "!Enter")),
    ("PATCH", "yaw"): ByKeys((opened("shape"), ">yaw-policy-target")),
    ("PUT", "target"): ByKeys((opened("shape"), "target:x_m=10", "!Enter")),
    ("POST", "obstacles"): ByKeys(
        (opened("obstacles"), ">obstacle-add", "obstacle-id=hall", "obstacle:x_m=30", "!Enter")
    ),
    ("PUT", "obstacles/{obstacle_id}"): ByKeys(
        (opened("obstacles"), ">obstacle-change-van", "obstacle:y_m=9", ">obstacle-save"), states.obstacles
    ),
    ("DELETE", "obstacles/{obstacle_id}"): ByKeys(
        (opened("obstacles"), ">>obstacle-remove-tower"), states.obstacles
    ),
    ("PUT", "site"): ByKeys(
        (">tab-feature-site", ">site-edit", "@site-corner-0", "!Shift+ArrowDown", "!Insert", ">site-save"),
        states.with_site,
    ),
    ("POST", "kill"): ByKeys(("!Shift+K", ">kill-pick-d2", ">kill-arm")),
    ("POST", "kill/confirm"): ByKeys(
        ("!Shift+K", ">kill-who-all", ">kill-arm", shows("kill-code"), type_code, "!Enter")
    ),
    ("POST", "show/start"): ByKeys(
        ("!Shift+S", shows("start-go"), ">start-go"), flown(ShowPhase.IDLE, Phase.STANDBY)
    ),
    ("POST", "show/pause"): of_show("P"),
    ("POST", "show/resume"): of_show("R", ShowPhase.PAUSED),
    ("POST", "show/stop"): of_show("H"),
    ("POST", "show/abort"): of_show("L"),
    ("POST", "show/take-over"): ByKeys((">take-over",), states.interrupted),
    ("POST", "show/bring-home"): ByKeys((">bring-home",), states.interrupted),
    ("POST", "show/begin"): ByKeys((">begin", f"begin-time={NOON}", "!Enter"), states.begins),
    ("DELETE", "show/begin"): ByKeys((">>begin-cancel",), states.begins),
    ("POST", "show/external-clock"): ByKeys((">>follow",), states.timecode(frozen=True)),
    ("POST", "show/seek"): ByKeys((">cue-turn",), with_selected),
    ("POST", "show/deselect"): ByKeys((opened("shows"), ">show-deselect-lighthouse"), with_selected),
    ("POST", "shows"): ByKeys((opened("shows"), chooses("night.skyc", states.night_skyc)), states.nothing),
    ("PUT", "shows/{name}"): ByKeys(
        (opened("shows"), chooses("walk.yaml", lambda: b"about: A walk.\n")), states.nothing
    ),
    ("POST", "shows/{name}/check"): ByKeys((opened("shows"), ">show-check-lighthouse"), with_show),
    ("POST", "shows/{name}/select"): ByKeys((opened("shows"), ">show-select-lighthouse"), with_show),
    ("DELETE", "shows/{name}"): ByKeys((opened("shows"), ">>show-remove-lighthouse"), with_show),
    ("PUT", "shows/{name}/placement"): ByKeys(
        (
            opened("shows"),
            chooses("night.skyc", states.night_skyc),
            shows("drawn"),
            ">show-place-night",
            shows("placing"),
            "placing-x=7",
            "!Enter",
            ">placing-apply",
        ),
        states.nothing,
    ),
    ("POST", "targets/select"): ByKeys((">tab-feature-targets", ">>target-follow-walker"), states.targets),
    ("POST", "targets/hold"): ByKeys((">tab-feature-targets", ">target-hold"), states.targets),
    ("POST", "stations/lead"): ByKeys(("!9", ">>lead-take"), states.station_lost, states.SITE),
    ("POST", "replay"): ByKeys(("!Space",), states.replayed, life="Replay", is_lost=True),
}

NOT_ON_THE_PAGE: Final[dict[Command, str]] = {
    (
        "POST",
        "stations/{name}/take-over",
    ): "an operator gives it at the terminal of the standby (gcs station take-over)",
    ("POST", "targets/{name}/report"): "a program gives it, several times a second",
}


def commands_of_the_api() -> set[Command]:
    """Each call that changes something."""
    paths = create_app(FakeService()).openapi()["paths"]
    return {
        (method.upper(), path.removeprefix("/api/v1/"))
        for path, calls in paths.items()
        for method in calls
        if method != "get"
    }


def test_each_command_of_the_api_has_keys() -> None:
    assert COMMANDS.keys() | NOT_ON_THE_PAGE.keys() == commands_of_the_api()
    assert COMMANDS.keys().isdisjoint(NOT_ON_THE_PAGE)


@pytest.mark.soak
@pytest.mark.parametrize("command", [pytest.param(each, id=" ".join(each)) for each in COMMANDS])
def test_a_command_is_given_by_keys_alone(chrome: Browser, tmp_path: Path, command: Command) -> None:
    by, (method, path) = COMMANDS[command], command
    state = ConsoleState("command", "panels", by.prepare, stations=by.stations, life=by.life)
    called = re.compile(re.sub(r"\{\w+\}", r"[^/]+", f".*/api/v1/{path}") + r"(\?.*)?")
    with in_state(chrome, state, tmp_path, (1440, 900)) as ui:
        for step in by.steps[:-1]:
            take(ui, step)
        with ui.page.expect_request(
            lambda request: request.method == method and called.fullmatch(request.url) is not None,
            timeout=SOON_MS,
        ) as asked:
            take(ui, by.steps[-1])
        answer = asked.value.response()
        assert answer is not None
        assert answer.ok, answer.text()
        ui.page.wait_for_timeout(500)  # for what closes to be gone
        focus = ui.page.evaluate(FOCUS)
        assert bool(focus["name"]) != by.is_lost, focus
        assert focus["wrong"] == ""
        assert not [each for each in ui.wrong if "(Not Found)" not in each]  # a show that was never checked
