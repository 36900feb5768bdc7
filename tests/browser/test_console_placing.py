"""A drawn show is moved and turned by hand, fitted to the vehicles as they stand, and stored."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from gcs.shows.formats import write_drawing
from tests.browser.test_console_sizes import COMMANDS, UNREACHABLE
from tests.support.console_bench import FLIGHT_MS, TARGET_PX, Console, console, station
from tests.support.drawn_shows import drawn_show

COUNT = 6
"""The fake vehicles stand in two rows of three, as the drawing has its pads."""


@pytest.fixture(scope="module")
def drawing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("drawing") / "night.skyc"
    write_drawing(drawn_show(COUNT, 20.0, 3.0, ("rings",)), path)
    return path


def number(ui: Console, name: str) -> float:
    """The first number of a text of the page, or the value of a field."""
    part = ui.part(name)
    text = part.input_value() if name in {"placing-x", "placing-y", "placing-turn"} else part.inner_text()
    return float(re.findall(r"-?\d+(?:\.\d+)?", text)[0])


def dragged(ui: Console, word: str, off_px: float, by_px: tuple[int, int], *fields: str) -> None:
    """Drag what is drawn `off_px` below a word of the scene, until these fields have changed, and rest."""

    def placed() -> list[float]:
        return [number(ui, f"placing-{name}") for name in fields]

    before = placed()

    def pull() -> None:
        x, y = ui.resting(word)
        mouse = ui.page.mouse
        mouse.move(x, y + off_px)
        mouse.down()
        mouse.move(x + by_px[0], y + off_px + by_px[1], steps=6)
        mouse.up()

    def is_moved(within_ms: float) -> None:
        ui.page.wait_for_timeout(min(within_ms, 500.0))
        assert placed() != before

    ui.until(pull, is_moved)
    while (now := placed()) != before:  # a slow page follows the pointer late
        before = now
        ui.page.wait_for_timeout(500)


def becomes(ui: Console, name: str, good: Callable[[float], bool]) -> float:
    """Wait until a number of the page is good."""
    for _ in range(120):
        if good(number(ui, name)):
            return number(ui, name)
        ui.page.wait_for_timeout(500)
    raise AssertionError(f"{name}: {number(ui, name)}")


@pytest.mark.soak
def test_pads_are_dragged_turned_fitted_and_applied(chrome: Browser, tmp_path: Path, drawing: Path) -> None:
    with (
        station(tmp_path, COUNT, noise=0.0) as running,  # a fit is as good as the positions
        console(chrome, running.url, width=1440, height=900) as ui,
    ):
        ui.press("tab-shows")
        ui.part("show-upload").set_input_files(drawing)
        expect(ui.part("drawn")).to_be_visible(timeout=FLIGHT_MS)
        ui.opens(lambda: ui.press("show-place-night"), "placing")
        ui.says("placing-panel", "names another origin")  # its heading is 40 degrees
        assert number(ui, "placing-turn") == pytest.approx(40.0)
        assert number(ui, "placing-max") > 1.0

        ui.press("camera-top")
        dragged(ui, "pads of night", TARGET_PX, (90, 40), "x", "y")
        assert number(ui, "placing-turn") == pytest.approx(40.0)
        dragged(ui, "turn ", 0.0, (-60, -60), "turn")
        assert number(ui, "placing-turn") != pytest.approx(40.0)

        before = number(ui, "placing-x")
        ui.part("placing-x").press("ArrowUp")  # without a pointer
        becomes(ui, "placing-x", lambda x_m: before < x_m <= before + 0.1001)
        ui.part("placing-turn").fill("30")
        ui.part("placing-turn").press("Enter")
        becomes(ui, "placing-turn", lambda turn_deg: turn_deg == 30.0)

        ui.press("placing-fit")
        becomes(ui, "placing-max", lambda off_m: off_m < 1.0)
        assert abs(number(ui, "placing-turn")) < 3.0  # as the vehicles stand, and not the other way round
        ui.says("placing-vehicle-d1", " m")
        for width, height in ((1440, 900), (844, 390), (360, 640)):
            ui.page.set_viewport_size({"width": width, "height": height})
            ui.settles(UNREACHABLE, list(COMMANDS), at=[])
            ui.settles(UNREACHABLE, ["placing-fit", "placing-apply"], at=[])
        ui.page.set_viewport_size({"width": 1440, "height": 900})

        text = running.client.shows.text("night")
        assert "place:" not in text
        ui.press("placing-apply")
        ui.tells("done", "night has moved")
        expect(ui.part("placing-apply")).to_have_attribute("aria-disabled", "true", timeout=FLIGHT_MS)
        placed = running.client.shows.text("night")
        assert "place: {x_m:" in placed
        assert "heading_deg: 0" in placed
        assert number(ui, "placing-max") < 1.0
        ui.closes("Escape", "placing")
        assert ui.wrong == []
