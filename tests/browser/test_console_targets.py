"""A target that a program reports: seen, followed from the panel and from the scene, coasting, lost."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pytest
from playwright.sync_api import Browser, expect

from gcs.client import Client
from tests.browser.test_console_sizes import COMMANDS, HIDDEN_TABS, pressable
from tests.support.console_bench import Console, console, station
from tests.support.processes import SOON_S, wait_until

PERIOD_S: Final = 0.2
TARGETS: Final = [
    {"name": "boat", "sources": [{"kind": "rest"}], "coast_s": 15.0},
    {"name": "walker", "sources": [{"kind": "rest"}]},
]
ABOVE_PX: Final = 22.0
"""The name of a target is written so far above its mark."""


@contextmanager
def reporting(url: str) -> Iterator[None]:
    """The boat stands north of the pads, and reports that until the block ends."""
    over = threading.Event()

    def report() -> None:
        with Client(url) as client:
            origin = client.fleet().origin
            while not over.wait(PERIOD_S):
                client.report_target(
                    "boat",
                    latitude_deg=origin.latitude_deg + 2e-4,
                    longitude_deg=origin.longitude_deg,
                    deviation_m=0.5,
                )

    sender = threading.Thread(target=report, name="boat")
    sender.start()
    try:
        yield
    finally:
        over.set()
        sender.join()


def selected(client: Client) -> str:
    return client.targets().selected


def click_on(ui: Console, name: str) -> None:
    """On its mark in the scene."""
    x, y = ui.resting(name)
    ui.page.mouse.click(x, y + ABOVE_PX)


@pytest.mark.soak
def test_a_target_is_followed_coasts_and_is_lost(chrome: Browser, tmp_path: Path) -> None:
    with (
        station(tmp_path, 3, sections={"targets": TARGETS}) as ground,
        console(chrome, ground.url) as ui,
    ):
        ui.says("connection", "Live")
        ui.opens(lambda: ui.by_key("tab-feature-targets"), "panel-feature-targets")
        ui.says("target-boat-state", "no report yet")
        ui.says("target-boat-why", "nothing was received yet")
        with reporting(ground.url):
            ui.says("target-boat-state", "tracked")
            ui.says("target-boat-radius_m", " m")
            expect(ui.part("target-boat-why")).to_have_count(0)
            assert ui.findings() == []

            ui.by_key("target-follow-boat")
            ui.says("target-follow-boat", "Yes, follow boat")
            assert selected(ground.client) == ""  # the first press asks
            ui.by_key("target-follow-boat")
            ui.tells("done", "boat is selected to be followed")
            ui.says("target-boat-selected", "followed")
            assert selected(ground.client) == "boat"
            expect(ui.part("target-follow-boat")).to_have_attribute("aria-disabled", "true")

            ui.press("target-hold")
            expect(ui.part("target-boat-selected")).to_have_count(0)
            assert selected(ground.client) == ""
            ui.closes(lambda: ui.press("close-right"), "targets")
            ui.opens(lambda: click_on(ui, "boat"), "target-follow-boat")
            ui.says("target-follow-boat", "Yes, follow boat")
            assert selected(ground.client) == ""
            ui.press("target-follow-boat")
            wait_until("followed", SOON_S, lambda: selected(ground.client) == "boat")

        ui.says("target-boat-state", "coasting")
        ui.says("target-boat-why", "nothing for")
        ui.says("panel-preflight", "target boat: nothing for")  # on the ground no alarm
        ui.says("target-boat-state", "LOST")
        ui.says("target-follow-boat", "Follow boat again")
        assert ui.findings() == []
        ui.page.set_viewport_size({"width": 360, "height": 640})
        expect(ui.part("panels")).to_have_attribute("data-layout", "sheet")
        ui.settles(HIDDEN_TABS, at=[])
        ui.page.set_viewport_size({"width": 640, "height": 360})
        expect(ui.part("panels")).to_have_attribute("data-layout", "side")
        ui.settles(HIDDEN_TABS, at=[])
        ui.page.set_viewport_size({"width": 360, "height": 640})
        expect(ui.part("panels")).to_have_attribute("data-layout", "sheet")
        ui.opens(lambda: ui.by_key("tab-feature-targets"), "targets")
        assert ui.findings() == []
        pressable(ui, *COMMANDS)
        ui.part("target-hold").scroll_into_view_if_needed()
        expect(ui.part("target-hold")).to_be_in_viewport(ratio=1.0)
        assert ui.wrong == []
