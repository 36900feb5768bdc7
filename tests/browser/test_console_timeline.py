"""The timeline follows a show from its plan to its landing, and seeks in the replay of that flight."""

import signal
from pathlib import Path
from typing import Final

import pytest
from playwright.sync_api import Browser, ViewportSize, expect

from gcs.client import Client
from tests.browser.test_console_cut_off import SHOW
from tests.support.console_bench import FLIGHT_MS, SOON_MS, Console, Station, console, fault, station
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, wait_passes, wait_until
from tests.support.replays import replay

NAME: Final = "a-show-with-a-name-of-forty-characters-1"
TURNS: Final = SHOW.replace("cue: turn, at_s: 1,", "cue: turn, at_s: 10,")

SHARES: Final = """(names) => names.map((name) => {
  const { left, width } = document.querySelector(".course").getBoundingClientRect();
  const found = document.querySelector(`[data-testid="${name}"]`).getBoundingClientRect();
  return (found.left + found.width / 2 - left) / width;
})"""
"""Where these lie on the timeline, 0 to 1."""

PHONE: Final[ViewportSize] = {"width": 360, "height": 640}
DESK: Final[ViewportSize] = {"width": 1280, "height": 800}


def fly(ui: Console, ground: Station, control: int) -> None:
    """From the plan, by a cue that is chosen, a hold and an alarm, to the ground."""
    ground.client.shows.upload(NAME, TURNS)
    ground.client.shows.check(NAME)
    wait_until("checked", SOON_S, lambda: ground.client.shows.checked(NAME).state == "done")
    ground.client.shows.select(NAME, ground.client.shows.checked(NAME).hash or "")
    ui.says("timeline-show", NAME)
    ui.press("cue-turn")
    ui.says("show-clock", "0:10 / 1:00")
    ui.by_key("cue-stand")
    ui.says("show-clock", "0:00 / 1:00")
    ui.page.set_viewport_size(PHONE)
    expect(ui.part("course")).to_have_count(0)
    ui.press("timeline-open")
    expect(ui.part("course")).to_be_visible()
    ui.page.set_viewport_size(DESK)
    wait_passes(ground.client)
    ground.client.start(show_hash=ground.client.show().selected.hash)  # type: ignore[union-attr]
    ui.says("show-phase", "running", FLIGHT_MS)
    ui.says("timeline-left", "left, down in")
    ground.client.command_vehicles("hold", ["d2"])
    fault(control, vehicle=3, fault="battery", remaining=0.12)
    expect(ui.part("mark-warning")).to_be_visible(timeout=SOON_MS)
    ui.by_key("mark-warning")
    expect(ui.part("alarm").first).to_be_focused()
    ui.says("show-phase", "landed", FLIGHT_MS)
    ui.says("timeline-show", "Last flight")
    command, alarm, now = ui.page.evaluate(SHARES, ["mark-command", "mark-warning", "playhead"])
    assert 0.0 <= command < alarm < now == pytest.approx(1.0, abs=0.01)
    assert ui.findings() == []
    ui.press("timeline-plan")
    ui.says("show-clock", "0:00 / 1:00")


def seek(ui: Console, client: Client) -> None:
    """By keys, by the mouse and at a mark."""
    ui.press("replay-play")
    wait_until("paused", SOON_S, lambda: client.playback.now().paused)
    slider = ui.part("replay-scrubber")
    slider.press("Home")
    wait_until("at the beginning", SOON_S, lambda: client.playback.now().position_s == 0.0)
    for at_s in (5.0, 10.0):
        ui.says("replay-position", f"0:{at_s - 5.0:02.0f}")
        slider.press("ArrowRight")
        wait_until("5 s on", SOON_S, lambda at_s=at_s: abs(client.playback.now().position_s - at_s) < 0.9)  # type: ignore[misc]
    running = client.marks().phases[-3]
    box = ui.part("course").bounding_box()
    assert box is not None
    at_s = (running.from_s + running.until_s) / 2.0
    ui.page.mouse.click(box["x"] + box["width"] * at_s / client.playback.now().duration_s, box["y"] + 10.0)
    wait_until("there", SOON_S, lambda: abs(client.playback.now().position_s - at_s) < 2.0)
    ui.says("show-phase", "running")
    ui.press("mark-warning")
    raised = next(mark for mark in client.marks().events if mark.alarm_severity == "warning")
    wait_until("at the alarm", SOON_S, lambda: abs(client.playback.now().position_s - raised.at_s) < 1.0)
    assert ui.findings() == []
    ui.page.set_viewport_size(PHONE)
    assert ui.findings() == []


@pytest.mark.soak
def test_timeline_follows_a_show_and_seeks_in_its_replay(chrome: Browser, tmp_path: Path) -> None:
    control = free_ports()
    with station(tmp_path, 3, takeoff_m=4.0, control=control) as ground:
        with console(chrome, ground.url, **DESK) as ui:
            ui.says("connection", "Live")
            expect(ui.part("timeline")).to_have_count(0)  # nothing is selected, and nothing has flown
            fly(ui, ground, control)
            assert ui.wrong == []
        ground.process.send_signal(signal.SIGINT)
        ground.process.wait(SOON_S)
    with (
        replay(ground.folder) as url,
        Client(url, timeout_s=30.0) as client,
        console(chrome, url, **DESK) as ui,
    ):
        ui.says("connection", "Replay")
        seek(ui, client)
        assert ui.wrong == []
