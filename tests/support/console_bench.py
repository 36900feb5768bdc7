"""Fixtures of the browser tests: a service over fake vehicles and a Chromium that shows its page."""

import json
import os
import re
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from playwright.sync_api import Browser, Locator, Page, ViewportSize, expect, sync_playwright
from playwright.sync_api import Error as PlaywrightError

from gcs.client import Client
from gcs.config import schema as configuration
from tests.support.browsers import chromium
from tests.support.machine import free_ports
from tests.support.processes import flying_config, proper, service, vehicles
from tests.support.started import Started

ROOT: Final = Path(__file__).parents[2]

FLAGS: Final = (
    *("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--disable-gpu"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
)
"""Draws without a graphics card, and asks nothing of the internet."""

QUIET: Final = Path(__file__).with_name("quiet_chromium")
"""Starts Chromium below the flights that it shows."""

SOON_MS: Final = 60_000
FLIGHT_MS: Final = 180_000
"""Patience with a machine that is busy; what is waited for comes within a few seconds, or a minute."""

expect.set_options(timeout=SOON_MS)  # 5 s otherwise

WORDS: Final = ".scene-word.thing, .scene-word.handle"
"""What is written in the scene beside what a hand can move."""

PLACES: Final = """(all) => all.map((each) => [each.matches(".handle"), each.getBoundingClientRect()])
  .filter(([, box]) => box.x > 0)
  .map(([handle, box]) => [handle ? box.x - 16 : box.x + box.width / 2, box.y + box.height / 2])"""
"""Of those that are in the picture: the middle of a word; the handle that stands before its word."""

AGAIN_MS: Final = 4000.0
"""After so long what was pressed in vain is pressed again."""

LATE_MS: Final = 250.0
"""What a busy machine takes in pauses too short to be noted."""

LOOK_MS: Final = 500
"""Between two looks at a word; as long as it moves the camera does."""

TARGET_PX, BOX_PX, SPHERE_PX = -26.0, 14.0, 0.0
"""Where target, obstacle and the sphere's handle are drawn, below the words that name them."""

AXE: Final = ROOT / "api" / "console" / "node_modules" / "axe-core" / "axe.min.js"

AXE_RUN: Final = """async () => {
  if (matchMedia("(forced-colors: active)").matches) {
    const all = [...document.querySelectorAll("body *")].map((each) => [each, getComputedStyle(each).color]);
    for (const [{ style }, painted] of all) style.webkitTextFillColor = painted;
  }
  const rules = Object.fromEntries(axe.getRules().map(({ ruleId }) => [ruleId, { enabled: true }]));
  rules["color-contrast-enhanced"].enabled = false;
  return axe.run(document, { resultTypes: ["violations"], rules });
}"""
"""In forced colours axe reads the fill of a text, for which Chromium reports the colour that it replaces."""

SEEN: Final = """
// When messages came, what the page announced when, and how long it could not draw. Of each alarm, each time
// that it is listed: from when, when it was on the page and when it left the list; null: it has not yet.
window.seen = { message_ms: 0, stated: [], counted: [], waited: [], stalled: [], alarms: [], tones: 0 };
window.WebSocket = class extends WebSocket {
  constructor(...given) {
    super(...given);
    this.addEventListener("message", ({ data }) => {
      const now_ms = (window.seen.message_ms = performance.now());
      if (typeof data !== "string") return;
      const listed = new Set(JSON.parse(data).alarms.map(({ id }) => id));
      for (const alarm of window.seen.alarms) {
        if (alarm.left_ms === null && !listed.delete(alarm.id)) alarm.left_ms = now_ms;
      }
      for (const id of listed) {
        window.seen.alarms.push({ id, listed_ms: now_ms, shown_ms: null, left_ms: null });
      }
    });
  }
};
const note = (where, list) => {
  const now = document.querySelector(where)?.textContent;
  if (now !== undefined && now !== list.at(-1)?.text) {
    list.push({ text: now, at_ms: performance.now(), message_ms: window.seen.message_ms });
  }
};
const look = () => {
  note("[data-testid=connection] strong", window.seen.stated);
  note("[data-testid=countdown] .gauge-value", window.seen.counted);
  note("[data-testid=begins-in]", window.seen.waited);
  for (const alarm of window.seen.alarms) {
    if (alarm.left_ms !== null || alarm.shown_ms !== null) continue;
    if (document.querySelector(`[data-alarm="${alarm.id}"]`)) alarm.shown_ms = performance.now();
  }
};
new MutationObserver(look).observe(document, { subtree: true, childList: true, characterData: true });
const start = AudioScheduledSourceNode.prototype.start;
AudioScheduledSourceNode.prototype.start = function (...given) {
  window.seen.tones += 1;
  return start.apply(this, given);
};
let before_ms = performance.now();
const drawn = (now_ms) => {
  if (now_ms - before_ms > 50) window.seen.stalled.push({ from_ms: before_ms, to_ms: now_ms });
  before_ms = now_ms;
  requestAnimationFrame(drawn);
};
requestAnimationFrame(drawn);
"""


@contextmanager
def browser() -> Iterator[Browser]:
    """Debian's Chromium, without a window."""
    with sync_playwright() as playwright:
        found = chromium()
        assert found is not None
        environment: dict[str, str | float | bool] = {**os.environ, "CHROMIUM": found}
        started = playwright.chromium.launch(executable_path=QUIET, args=list(FLAGS), env=environment)
        try:
            yield started
        finally:
            started.close()


@dataclass(frozen=True, slots=True)
class Console:
    """The page, driven as an operator drives it."""

    page: Page
    wrong: list[str]  # problems that the browser reported

    def part(self, name: str) -> Locator:
        """Return the element of that name."""
        return self.page.get_by_test_id(name)

    def press(self, name: str) -> None:
        """Press a button once it is enabled."""
        button = self.part(name)
        expect(button).not_to_have_attribute("aria-disabled", "true", timeout=SOON_MS)
        button.click(timeout=SOON_MS)

    def tap(self, name: str) -> None:
        """Tap a button once it is enabled."""
        button = self.part(name)
        expect(button).not_to_have_attribute("aria-disabled", "true")
        button.tap(timeout=SOON_MS)

    def until(self, act: Callable[[], None], reached: Callable[[float], None]) -> None:
        """Repeat an action until a condition holds: a page that was busy refuses to act on old state."""
        for _ in range(10):
            with suppress(PlaywrightError, AssertionError):
                act()
                reached(AGAIN_MS)
                return
        reached(SOON_MS)

    def opens(self, act: str | Callable[[], None], name: str) -> None:
        """Press a key, or do another action, until that part is visible."""
        self.until(self._pressing(act), lambda ms: expect(self.part(name)).to_be_visible(timeout=ms))

    def closes(self, act: str | Callable[[], None], name: str) -> None:
        """Press a key, or do another action, until that part is gone."""
        self.until(self._pressing(act), lambda ms: expect(self.part(name)).to_have_count(0, timeout=ms))

    def phase(self, key: str, text: str | re.Pattern[str]) -> None:
        """Press the key of a command until the show is in that phase."""
        self.until(self._pressing(key), lambda ms: self.says("show-phase", text, ms))

    def _pressing(self, act: str | Callable[[], None]) -> Callable[[], None]:
        return partial(self.page.keyboard.press, act) if isinstance(act, str) else act

    def settles(self, script: str, argument: object = None, *, at: object) -> None:
        """Wait until the page answers `at`: it lays itself out a moment after what changed it."""
        found: object = None
        for _ in range(SOON_MS // LOOK_MS):
            found = self.page.evaluate(script, argument)
            if found == at:
                return
            self.page.wait_for_timeout(LOOK_MS)
        assert found == at, found

    def says(self, name: str, text: str | re.Pattern[str], timeout_ms: float = SOON_MS) -> None:
        """Wait until that part of the page has this text."""
        expect(self.part(name)).to_contain_text(text, timeout=timeout_ms)

    def tells(self, kind: str, text: str, timeout_ms: float = SOON_MS) -> None:
        """Wait until an answer of the page, "done" or "refused", has this text."""
        reported = self.part(f"toast-{kind}").filter(has_text=text).first
        expect(reported).to_be_visible(timeout=timeout_ms)

    def resting(self, word: str) -> tuple[float, float]:
        """Position of a label of the scene once the camera is at rest, in CSS pixels."""
        seen: list[list[list[float]]] = []
        for _ in range(60):
            seen = [*seen[-2:], self.places(word)]
            if len(seen) == 3 and seen[0] == seen[1] == seen[2] and len(seen[0]) == 1:
                ((x, y),) = seen[0]
                return x, y
            self.page.wait_for_timeout(LOOK_MS)
        raise AssertionError(f"{word!r} does not come to rest: {seen}")

    def places(self, word: str) -> Any:
        """Where a word of the scene is, each time it is there. In CSS pixels."""
        return self.page.locator(WORDS).filter(has_text=word).evaluate_all(PLACES)

    def findings(self) -> list[str]:
        """Findings of axe: rule and place. Of every rule that it has, experimental ones too, but one.

        Left out is the contrast of 7 to 1 (WCAG AAA): red, orange and yellow would look alike. On a busy
        machine data are old for a moment, and drawn paler: axe looks again.
        """
        self.page.evaluate(AXE.read_text(encoding="utf-8"))
        found: list[str] = []
        for _ in range(5):
            found = self._findings()
            if not found:
                break
            self.page.wait_for_timeout(AGAIN_MS)
        return found

    def _findings(self) -> list[str]:
        found = self.page.evaluate(AXE_RUN)
        return [
            f"{each['id']}: {each['help']}: {node['target']}: {node['failureSummary']}"
            for each in found["violations"]
            for node in each["nodes"]
        ]

    def seen(self) -> Any:
        """Return the notes of `SEEN`."""
        return json.loads(self.page.evaluate("JSON.stringify(window.seen)"))

    def loses_its_service(self) -> None:
        """Check that a silent service is reported within a second of time in which the page could draw."""
        self.says("connection", "No connection")
        expect(self.part("banner")).to_be_visible()
        expect(self.part("panels")).to_have_attribute("data-life", "lost")
        seen = self.seen()
        # the last time: a paused machine may have caused an earlier report
        *_, lost = [each for each in seen["stated"] if each["text"] == "No connection"]
        last_ms = lost["message_ms"]
        stood_still_ms = sum(
            each["to_ms"] - each["from_ms"] for each in seen["stalled"] if each["to_ms"] > last_ms
        )
        assert lost["at_ms"] - last_ms < 1000.0 + stood_still_ms + LATE_MS

    def by_key(self, name: str) -> None:
        """Press the element of that name by keyboard once it is enabled."""
        button = self.part(name)
        expect(button).not_to_have_attribute("aria-disabled", "true", timeout=SOON_MS)
        button.focus(timeout=SOON_MS)
        self.page.keyboard.press("Enter")


@contextmanager
def console(
    chrome: Browser,
    url: str,
    *,
    width: int = 1280,
    height: int = 720,
    touch: bool = False,
    time_zone: str | None = None,
) -> Iterator[Console]:
    """Open `url` in a new tab with empty storage; `time_zone` None: this machine's."""
    size: ViewportSize = {"width": width, "height": height}
    context = chrome.new_context(
        viewport=size, reduced_motion="reduce", has_touch=touch, timezone_id=time_zone
    )
    try:
        page = context.new_page()
        wrong: list[str] = []
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("console", lambda stated: wrong.append(stated.text) if stated.type == "error" else None)
        page.add_init_script(SEEN)
        page.goto(url)
        yield Console(page, wrong)
    finally:
        context.close()


@dataclass(frozen=True, slots=True)
class Station:
    """A running service and the address of its page."""

    url: str
    client: Client
    process: Started
    config: configuration.Config
    folder: Path
    fleet: Started

    @contextmanager
    def again(self) -> Iterator[Client]:
        """Restart an ended service until the block ends; the fleet has flown on meanwhile."""
        self.process.wait()
        with service(self.config, self.folder) as (client, _):
            yield client


def fault(control: int, **command: object) -> None:
    """Set or clear a fault of the fake vehicles that receive faults on port `control`."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:
        outlet.settimeout(30.0)
        outlet.sendto(json.dumps(command).encode(), ("127.0.0.1", control))
        answer = json.loads(outlet.recv(2000))
    if not answer["ok"]:
        raise RuntimeError(f"{command}: {answer['error']}")


@contextmanager
def station(
    folder: Path,
    count: int,
    *,
    access: dict[str, Any] | None = None,
    takeoff_m: float = 5.0,
    ground: dict[str, Any] | None = None,
    heading_deg: float = 0.0,
    control: int | None = None,
    silence_s: float = 5.0,
    noise: float = 1.0,
    failsafes: dict[str, dict[str, Any]] | None = None,
    sections: dict[str, Any] | None = None,
    **formation: Any,
) -> Iterator[Station]:
    """Run the service over fake vehicles that take off to `takeoff_m`; `ground` is the section `map`.

    The vehicles receive faults on UDP port `control`; None: they receive none. Of `sections` each replaces
    those keys of the configuration, or a whole list. `noise` scales the errors of the vehicles' positions.
    Their true states are in `folder`/truth.jsonl.
    """
    port = free_ports(count)
    raw = flying_config(count, port, silence_s=silence_s, takeoff_height_m=takeoff_m).model_dump()
    raw["api"]["port"] = free_ports()
    raw["formation"] |= formation
    raw["access"] |= access or {}
    raw["map"] = ground
    raw["show_frame"]["heading_deg"] = heading_deg
    raw["shows"] = {"folder": folder / "shows"}
    raw["failsafes"]["links_late"]["action"] = "ignore"
    raw["failsafes"]["service_late"]["action"] = "ignore"  # a Chromium without a graphics card is beside it
    for cause, settings in (failsafes or {}).items():
        raw["failsafes"][cause] |= settings
    for name, section in (sections or {}).items():
        raw[name] = section if isinstance(section, list) else {**(raw.get(name) or {}), **section}
    config = configuration.Config.model_validate(raw)
    faults = () if control is None else ("--control", str(control))
    with (
        vehicles(count, port, folder, *proper(config), *faults, "--noise", str(noise)) as fleet,
        service(config, folder / "service") as (client, process),
    ):
        yield Station(
            f"http://127.0.0.1:{config.api.port}", client, process, config, folder / "service", fleet
        )
