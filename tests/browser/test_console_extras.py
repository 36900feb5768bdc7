"""What is sent beside setpoints: a vehicle's lights blink, the corrections' age and base are shown."""

import socket
from pathlib import Path
from typing import Final

import pytest
from playwright.sync_api import Browser, expect

from tests.support.console_bench import console, station
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, last_truths, wait_passes, wait_until
from tests.support.rtcm import base_message, rtcm

WHITE: Final = "#ffffff"


@pytest.mark.soak
def test_a_vehicle_is_found_by_its_lights(chrome: Browser, tmp_path: Path) -> None:
    lights = {"driver": "led-control", "find_s": 60.0}
    with (
        station(tmp_path, 2, sections={"lights": lights}) as running,
        console(chrome, running.url) as ui,
    ):
        wait_passes(running.client)
        ui.says("connection", "Live")
        ui.part("open-d2").first.click()
        ui.press("vehicle-find")
        ui.tells("done", "d2")
        wait_until(
            "white light", SOON_S, lambda: str(last_truths(tmp_path / "truth.jsonl")[1]["light"]) == WHITE
        )
        sent = running.client.fleet().features.lights
        assert sent is not None
        assert (sent.driver, sent.sent > 0) == ("led-control", True)
        assert ui.wrong == []


@pytest.mark.soak
def test_without_lights_the_page_says_why_nothing_blinks(chrome: Browser, tmp_path: Path) -> None:
    with station(tmp_path, 1) as running, console(chrome, running.url) as ui:
        wait_passes(running.client)
        ui.part("open-d1").first.click()
        expect(ui.part("vehicle-find")).to_have_attribute(
            "title", "No lights are sent: lights.driver of the configuration is none"
        )


@pytest.mark.soak
def test_corrections_are_shown_and_missed(chrome: Browser, tmp_path: Path) -> None:
    port = free_ports()
    rtk = {"source": f"udp://127.0.0.1:{port}", "age_max_s": 3.0}
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as base,
        station(tmp_path, 2, sections={"rtk": rtk}) as running,
        console(chrome, running.url, width=1440, height=900) as ui,
    ):

        def arrived() -> bool:
            for message in (base_message(), rtcm(1074, 300)):
                base.sendto(message, ("127.0.0.1", port))
            found = running.client.features().corrections
            return found is not None and found.messages > 3

        wait_until("corrections", SOON_S, arrived)
        ui.says("corrections-base", "47.397700, 8.545600")
        expect(ui.part("corrections-messages")).not_to_have_text("0")
        ui.says("corrections-age", "stopped")  # none follows
        alarm = ui.part("alarm").filter(has_text="Corrections for RTK stopped").first
        for width, height in ((1440, 900), (844, 390), (360, 640)):
            ui.page.set_viewport_size({"width": width, "height": height})
            expect(alarm).to_be_visible()
        assert ui.wrong == []
