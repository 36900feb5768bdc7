"""A written show flown by keyboard from its file to the ground: cut off, taken over, one vehicle killed."""

import re
from datetime import datetime, timedelta
from pathlib import Path
from typing import Final

import pytest
from playwright.sync_api import Browser, expect

from gcs.client import Client
from tests.support.console_bench import FLIGHT_MS, SOON_MS, Console, Station, console, station

pytestmark = pytest.mark.soak

SHOW: Final = """
about: Three vehicles stand on their sphere, and turn.
origin: {latitude_deg: 47.397742, longitude_deg: 8.545594, altitude_amsl_m: 488.0, heading_deg: 0.0}
fleet:
  vehicles: 3
  pads: {columns: 3, spacing_m: 5.0, x_m: 0.0, y_m: 5.0}
  takeoff_height_m: 4.0
  takeoff_stagger_s: 0.2
  endurance_s: 900.0
fence: {height_min_m: 3.0, height_max_m: 60.0, distance_max_m: 100.0}
duration_s: 60.0
timeline:
  - {cue: stand, at_s: 0, radius_m: 5, height_m: 9, target: {x_m: 4, y_m: 4}, lights: ["#ff0000"]}
  - {cue: turn, at_s: 1, spin: {rate_deg_s: 8}, over_s: 4}
"""
WRONG_LINE: Final = 13


def choose_show(ui: Console, folder: Path) -> None:
    """Upload two, read why the one is none, select the other."""
    ui.opens("2", "panel-shows")
    for name, text in (("broken", SHOW.replace("radius_m: 5", "radius_m: wide")), ("circle", SHOW)):
        file = folder / f"{name}.yaml"
        file.write_text(text, encoding="utf-8")
        ui.part("show-upload").set_input_files(file)
        expect(ui.part(f"show-{name}")).to_be_visible(timeout=SOON_MS)
    problem = ui.part("show-broken").get_by_test_id("show-problems")
    expect(problem).to_contain_text(f"line {WRONG_LINE}", timeout=FLIGHT_MS)
    expect(problem).to_contain_text("radius_m = 'wide'")
    expect(ui.part("show-select-broken")).to_have_attribute("aria-disabled", "true")
    expect(ui.part("show-verdict-circle")).to_contain_text("good to fly", timeout=FLIGHT_MS)
    ui.opens(lambda: ui.by_key("show-select-circle"), "show-deselect-circle")


def start_at_a_clock_time(ui: Console, ground: Station) -> None:
    """Typed on the page. Where this machine was so slow that the time had passed, it is tomorrow's: again."""
    for ahead_s in (6, 30, 120):
        expect(ui.part("start")).not_to_have_attribute("aria-disabled", "true", timeout=FLIGHT_MS)
        ui.opens("Shift+S", "start-go")
        ui.says("start-show", "circle")
        expect(ui.part("start-preflight")).to_contain_text("passed", timeout=SOON_MS)
        ui.by_key("start-when-at")
        at = (datetime.now().astimezone() + timedelta(seconds=ahead_s)).replace(microsecond=0)
        ui.part("start-time").fill(f"{at:%H:%M:%S}")
        ui.page.keyboard.press("Enter")
        ui.says("show-phase", re.compile("counting down|taking off|assembling|running"))
        ordered_s = ground.client.show().start_unix_time_s
        if ordered_s is None or ordered_s == pytest.approx(at.timestamp(), abs=1.0):
            return
        ui.page.keyboard.press("Shift+H")
        ui.says("show-phase", "idle")
    raise AssertionError("it was never in time")


def counted_down(ui: Console) -> list[int]:
    """The seconds that it has shown until it began."""
    shown = [each["text"].split(":") for each in ui.seen()["counted"]]
    return [60 * int(minutes) + int(seconds) for minutes, seconds in shown]


def kill(ui: Console, client: Client, name: str) -> None:
    """The first step alone does nothing; the second is held."""
    ui.opens("Shift+K", "kill-arm")
    expect(ui.part("kill-names")).to_have_text("No vehicle is chosen.")
    ui.by_key(f"kill-pick-{name}")
    expect(ui.part("kill-names")).to_have_text(name)
    ui.by_key("kill-arm")
    expect(ui.part("kill-code")).to_be_visible(timeout=SOON_MS)
    expect(ui.part("kill-names")).to_have_text(name)
    expect(ui.part("airborne")).to_contain_text("3/3")
    assert not [command for command in client.commands() if command.action == "kill"]
    ui.part("kill-hold").focus()
    ui.page.keyboard.down(" ")
    expect(ui.part(f"row-{name}")).to_contain_text("killed", timeout=SOON_MS)
    ui.page.keyboard.up(" ")


def test_interrupted_show_is_recovered_by_keyboard(chrome: Browser, tmp_path: Path) -> None:
    with station(tmp_path, 3, takeoff_m=4.0) as ground, console(chrome, ground.url) as ui:
        ui.says("connection", "Live")
        choose_show(ui, tmp_path)
        start_at_a_clock_time(ui, ground)
        ui.says("show-phase", "running", FLIGHT_MS)
        counted_s = counted_down(ui)
        assert counted_s
        assert counted_s == sorted(set(counted_s), reverse=True)

        ground.process.kill()
        ui.loses_its_service()
        expect(ui.part("start")).to_have_attribute("aria-disabled", "true")
        # it can be pressed, and says why it does nothing
        ui.until(
            lambda: ui.page.keyboard.press("Shift+S"),
            lambda ms: ui.tells("refused", "No fresh data", ms),
        )
        with ground.again() as client:
            ui.says("connection", "Live", FLIGHT_MS)
            # closed where preflight failed for a moment: that panel took its place, and closed at take-off
            if ui.part("panel-shows").count() == 0:
                ui.opens("2", "panel-shows")
            ui.says("show-verdict-circle", "not checked")  # by this one, which has begun just now
            ui.says("interrupted", "the service was cut off; the show was running")
            ui.says("interrupted", re.compile(r"d1, d2, d3.*waits in mode"), FLIGHT_MS)
            ui.says("interrupted", "3 airborne, not under control")
            ui.says("show-phase", "not under control")
            ui.until(lambda: ui.by_key("take-over"), lambda ms: ui.tells("done", "Take control", ms))
            ui.says("show-phase", "paused", FLIGHT_MS)
            ui.says("show-reason", "circle")
            for name in ("d1", "d2", "d3"):
                expect(ui.part(f"row-{name}")).to_contain_text("formation", timeout=FLIGHT_MS)
            expect(ui.part("interrupted")).to_have_count(0, timeout=SOON_MS)

            kill(ui, client, "d3")
            ui.says("airborne", "2/3")
            assert [each.phase for each in client.vehicles()] == ["formation", "formation", "killed"]
            ui.phase("Shift+L", "landing now")
            for name in ("d1", "d2"):
                expect(ui.part(f"row-{name}")).to_contain_text("landing", timeout=FLIGHT_MS)
            assert [command.action for command in client.commands()] == ["abort", "kill", "take-over"]
