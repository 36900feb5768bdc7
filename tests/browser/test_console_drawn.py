"""A drawing is uploaded in the console, and its show is seen before it flies."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from gcs.config.yaml_files import shipped_folder
from tests.browser.test_console_sizes import COMMANDS, UNREACHABLE
from tests.support.console_bench import FLIGHT_MS, console, station

DRAWING = shipped_folder() / "shows" / "drawn-30.skyc"


@pytest.mark.soak
def test_a_drawing_is_uploaded_played_and_scrubbed(chrome: Browser, tmp_path: Path) -> None:
    with station(tmp_path, 2) as running, console(chrome, running.url) as ui:
        ui.press("tab-shows")
        ui.part("show-upload").set_input_files(DRAWING)
        expect(ui.part("drawn")).to_be_visible(timeout=FLIGHT_MS)
        ui.says("drawn-label", "drawn-30")
        ui.says("drawn-position", "0:00")
        ui.press("drawn-play")
        ui.says("drawn-position", "0:02")
        ui.press("drawn-play")
        ui.part("drawn-scrubber").fill("30")
        ui.says("drawn-position", "0:30")
        ui.part("drawn-scrubber").press("End")
        ui.says("drawn-position", "1:10")
        ui.closes(lambda: ui.press("drawn-close"), "drawn")
        ui.opens(lambda: ui.press("show-preview-drawn-30"), "drawn")
        ui.says("drawn-position", "0:00")
        for width, height in ((640, 360), (360, 640), (844, 390)):  # the flight commands stay on the screen
            ui.page.set_viewport_size({"width": width, "height": height})
            ui.settles(UNREACHABLE, list(COMMANDS), at=[])
        ui.closes(lambda: ui.press("drawn-close"), "drawn")
        assert ui.wrong == []
