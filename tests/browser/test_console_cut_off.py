"""A written show flown by keyboard from its file to the ground: cut off, taken over, one vehicle killed."""

import re
from datetime import datetime, timedelta
from pathlib import Path
from typing import Final

import pytest
from console_bench import FLIGHT_MS, SOON_MS, Console, Station, chromes, console, station
from playwright.sync_api import Browser, expect

from gcs.client import Client

chrome = pytest.fixture(scope="module")(chromes)

SHOW: Final = """
about: Three vehicles stand on their sphere, and turn.
origin: {latitude_deg: 47.397742, longitude_deg: 8.545594, altitude_amsl_m: 488.0, heading_deg: 0.0}
fleet:
  vehicles: 3
  pads: {columns: 3, spacing_m: 4.0, x_m: 0.0, y_m: 4.0}
  takeoff_height_m: 4.0
  takeoff_stagger_s: 0.2
  endurance_s: 900.0
fence: {height_min_m: 3.0, height_max_m: 60.0, distance_max_m: 100.0}
duration_s: 60.0
timeline:
  - {cue: stand, at_s: 0, radius_m: 4, height_m: 8, target: {x_m: 4, y_m: 4}, lights: ["#ff0000"]}
  - {cue: turn, at_s: 1, spin: {rate_deg_s: 8}, over_s: 4}
"""
WRONG_LINE: Final = 13


def choose_show(desk: Console, folder: Path) -> None:
    """Upload two, read why the one is none, select the other."""
    desk.opens("2", "panel-shows")
    for name, text in (("broken", SHOW.replace("radius_m: 4", "radius_m: wide")), ("circle", SHOW)):
        file = folder / f"{name}.yaml"
        file.write_text(text, encoding="utf-8")
        desk.part("show-upload").set_input_files(file)
        expect(desk.part(f"show-{name}")).to_be_visible(timeout=SOON_MS)
    problem = desk.part("show-broken").get_by_test_id("show-problems")
    expect(problem).to_contain_text(f"line {WRONG_LINE}", timeout=FLIGHT_MS)
    expect(problem).to_contain_text("radius_m = 'wide'")
    expect(desk.part("show-select-broken")).to_have_attribute("aria-disabled", "true")
    expect(desk.part("show-verdict-circle")).to_contain_text("good to fly", timeout=FLIGHT_MS)
    desk.opens(lambda: desk.by_key("show-select-circle"), "show-deselect-circle")


def start_at_a_clock_time(desk: Console, ground: Station) -> None:
    """Typed on the page. Where this machine was so slow that the time had passed, it is tomorrow's: again."""
    for ahead_s in (6, 30, 120):
        expect(desk.part("start")).not_to_have_attribute("aria-disabled", "true", timeout=FLIGHT_MS)
        desk.opens("Shift+S", "start-go")
        desk.says("start-show", "circle")
        expect(desk.part("start-preflight")).to_contain_text("passed", timeout=SOON_MS)
        desk.by_key("start-when-at")
        at = (datetime.now().astimezone() + timedelta(seconds=ahead_s)).replace(microsecond=0)
        desk.part("start-time").fill(f"{at:%H:%M:%S}")
        desk.page.keyboard.press("Enter")
        desk.says("show-phase", re.compile("counting down|taking off|assembling|running"))
        ordered_s = ground.client.show().start_unix_time_s
        if ordered_s is None or ordered_s == pytest.approx(at.timestamp(), abs=1.0):
            return
        desk.page.keyboard.press("Shift+H")
        desk.says("show-phase", "idle")
    raise AssertionError("it was never in time")


def counted_down(desk: Console) -> list[int]:
    """The seconds that it has shown until it began."""
    shown = [each["text"].split(":") for each in desk.seen()["counted"]]
    return [60 * int(minutes) + int(seconds) for minutes, seconds in shown]


def kill(desk: Console, client: Client, name: str) -> None:
    """The first step alone does nothing; the second is held."""
    desk.opens("Shift+K", "kill-arm")
    expect(desk.part("kill-names")).to_have_text("No vehicle is chosen.")
    desk.by_key(f"kill-pick-{name}")
    expect(desk.part("kill-names")).to_have_text(name)
    desk.by_key("kill-arm")
    expect(desk.part("kill-code")).to_be_visible(timeout=SOON_MS)
    expect(desk.part("kill-names")).to_have_text(name)
    expect(desk.part("airborne")).to_contain_text("3/3")
    assert not [command for command in client.commands() if command.action == "kill"]
    desk.part("kill-hold").focus()
    desk.page.keyboard.down(" ")
    expect(desk.part(f"row-{name}")).to_contain_text("killed", timeout=SOON_MS)
    desk.page.keyboard.up(" ")


def test_a_show_that_was_started_by_the_clock_and_cut_off_is_taken_over_by_keyboard(
    chrome: Browser, tmp_path: Path
) -> None:
    with station(tmp_path, 3, takeoff_m=4.0) as ground, console(chrome, ground.url) as desk:
        desk.says("connection", "Live")
        choose_show(desk, tmp_path)
        start_at_a_clock_time(desk, ground)
        desk.says("show-phase", "running", FLIGHT_MS)
        counted_s = counted_down(desk)
        assert counted_s
        assert counted_s == sorted(set(counted_s), reverse=True)

        ground.process.kill()
        desk.loses_its_service()
        expect(desk.part("start")).to_have_attribute("aria-disabled", "true")
        # it can be pressed, and says why it does nothing
        desk.until(
            lambda: desk.page.keyboard.press("Shift+S"),
            lambda ms: desk.tells("refused", "No fresh data", ms),
        )
        with ground.again() as client:
            desk.says("connection", "Live", FLIGHT_MS)
            desk.says("show-verdict-circle", "not checked")  # by this one, which has begun just now
            desk.says("interrupted", "the service was cut off; the show was running")
            desk.says("interrupted", re.compile(r"d1, d2, d3.*waits in mode"), FLIGHT_MS)
            desk.says("interrupted", "3 airborne, not under control")
            desk.says("show-phase", "not under control")
            desk.until(lambda: desk.by_key("take-over"), lambda ms: desk.tells("done", "Take control", ms))
            desk.says("show-phase", "paused", FLIGHT_MS)
            desk.says("show-reason", "circle")
            for name in ("d1", "d2", "d3"):
                expect(desk.part(f"row-{name}")).to_contain_text("formation", timeout=FLIGHT_MS)
            expect(desk.part("interrupted")).to_have_count(0, timeout=SOON_MS)

            kill(desk, client, "d3")
            desk.says("airborne", "2/3")
            assert [each.phase for each in client.vehicles()] == ["formation", "formation", "killed"]
            desk.phase("Shift+L", "landing now")
            for name in ("d1", "d2"):
                expect(desk.part(f"row-{name}")).to_contain_text("landing", timeout=FLIGHT_MS)
            assert [command.action for command in client.commands()] == ["abort", "kill", "take-over"]
