"""Vehicles selected in the scene and in the table, and the commands that act on them."""

import re
from functools import partial
from math import dist
from pathlib import Path
from typing import Final

import pytest
from playwright.sync_api import Browser, expect

from gcs.client import Client
from tests.support.console_bench import AGAIN_MS, FLIGHT_MS, LOOK_MS, SOON_MS, Console, console, station
from tests.support.processes import SOON_S, wait_passes, wait_until

pytestmark = pytest.mark.soak

BOX_PX: Final = 16.0
"""From the outermost vehicles of a box to its sides."""

MIDDLES: Final = """(all, name) => all.filter((each) => each.textContent === name)
  .map((each) => each.getBoundingClientRect()).filter(({ x }) => x > 0)
  .map(({ x, y, width, height }) => [x + width / 2, y + height / 2])"""
"""Of the words in the picture that are this name; a word that is not used lies far to the left."""

NAME_PX: Final = 26.0
"""From a vehicle to its name, which is above it."""


def at_rest(ui: Console, name: str) -> tuple[float, float]:
    """Where a vehicle is on the screen once the camera has come to rest. CSS pixels."""
    words = ui.page.locator(".scene-word.name")
    seen: list[tuple[float, float]] = []
    for _ in range(60):
        for x, y in words.evaluate_all(MIDDLES, name)[:1]:
            seen = [*seen[-2:], (x, y + NAME_PX)]
        if len(seen) == 3 and max(dist(one, seen[0]) for one in seen) < 3.0:
            return seen[0]  # its position is never quite still
        ui.page.wait_for_timeout(LOOK_MS)
    raise AssertionError(f"{name} does not come to rest: {seen}")


def selected(ui: Console) -> set[str]:
    """Rows of the fleet's table that are selected."""
    found = ui.page.locator("tr.selected").evaluate_all("(rows) => rows.map((row) => row.dataset.testid)")
    return set(found)


def commanded(ui: Console, client: Client, button: str, action: str) -> None:
    """Press a button until the service has this command: a page that was busy refuses to act on old state."""

    def received(within_ms: float) -> None:
        wait_until(action, within_ms / 1000.0, lambda: client.commands()[0].action == action)

    ui.until(lambda: ui.press(button), received)


@pytest.mark.soak
def test_box_dragged_in_the_scene_selects_its_vehicles(chrome: Browser, tmp_path: Path) -> None:
    with station(tmp_path, 6) as ground, console(chrome, ground.url, width=1440, height=900) as ui:
        ui.says("connection", "Live")
        ui.press("camera-top")

        def drag(*names: str, keys: tuple[str, ...]) -> None:
            """A box around these."""
            across, down = zip(*(at_rest(ui, name) for name in names), strict=True)
            for key in keys:
                ui.page.keyboard.down(key)
            ui.page.mouse.move(min(across) - BOX_PX, min(down) - BOX_PX)
            ui.page.mouse.down()
            ui.page.mouse.move(max(across) + BOX_PX, max(down) + BOX_PX, steps=5)
            expect(ui.page.locator(".scene-box")).to_be_visible()
            ui.page.mouse.up()
            for key in keys:
                ui.page.keyboard.up(key)
            expect(ui.page.locator(".scene-box")).to_be_hidden()

        def selects(*names: str, keys: tuple[str, ...], rows: set[str]) -> None:
            count = ui.page.locator("tr.selected")
            ui.until(
                partial(drag, *names, keys=keys),
                lambda ms: expect(count).to_have_count(len(rows), timeout=ms),
            )
            assert selected(ui) == rows

        selects("d1", "d2", keys=("Control",), rows={"row-d1", "row-d2"})
        selects("d5", "d6", keys=("Control", "Shift"), rows={"row-d1", "row-d2", "row-d5", "row-d6"})
        selects("d4", keys=("Control",), rows={"row-d4"})
        assert ui.wrong == []
        assert ground.client.commands() == [], "a selection commands nothing"


def test_a_command_acts_on_the_selection_and_kill_begins_with_it(chrome: Browser, tmp_path: Path) -> None:
    with (
        station(tmp_path, 5, takeoff_m=3.0, radius_m=5.5, height_m=10.5) as ground,
        console(chrome, ground.url, width=1440, height=900) as ui,
    ):
        client = ground.client

        def phases(phase: str) -> set[str]:
            return {each.id for each in client.vehicles() if each.phase == phase}

        ui.says("connection", "Live")
        wait_passes(client)
        client.start()
        ui.says("show-phase", "running", FLIGHT_MS)

        def select() -> None:
            ui.part("row-d2").click()
            ui.part("row-d4").click(modifiers=["Shift"])
            ui.says("selection-count", "3 vehicles", AGAIN_MS)
            ui.part("row-d3").click(modifiers=["Control"])

        ui.until(select, lambda ms: ui.says("selection-count", "2 vehicles", ms))
        commanded(ui, client, "selection-hold", "hold")
        wait_until("hold", SOON_S, lambda: phases("hold") == {"d2", "d4"})
        assert phases("formation") == {"d1", "d3", "d5"}
        ui.opens(lambda: ui.part("selection-open").click(), "group-page")
        for name in ("d2", "d4"):
            expect(ui.part(f"selected-command-{name}")).to_contain_text("done", timeout=SOON_MS)

        ui.opens("Shift+K", "kill-arm")
        expect(ui.part("kill-names")).to_have_text("d2, d4")
        ui.closes("Escape", "sheet-kill")
        commanded(ui, client, "selection-return", "return")
        wait_until("return", SOON_S, lambda: phases("hold") == set())
        ui.page.keyboard.press("Escape")
        expect(ui.part("group-page")).to_have_count(0)
        ui.opens("Shift+K", "kill-arm")
        expect(ui.part("kill-arm")).to_have_attribute("aria-disabled", "true")  # nothing is selected
        ui.closes("Escape", "sheet-kill")
        assert [sequence.action for sequence in client.commands()] == ["return", "hold", "start"]
        ui.phase("Shift+H", re.compile("returning home|landed"))
        ui.says("show-phase", "landed", FLIGHT_MS)
        assert ui.wrong == []
