"""Four stations that fly one formation, in the console of one: which flies what, which is lost, the lead."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from playwright.sync_api import Browser, expect

from tests.support.api_background import Ticking, in_background
from tests.support.api_fake_service import FakeService
from tests.support.console_bench import SOON_MS, console

NAMES = ("north", "south", "west", "east")


@contextmanager
def site(count: int) -> Iterator[tuple[FakeService, str]]:
    """The first of four stations that fly so many vehicles, led by the second; and its address."""
    service = FakeService(count, station_names=NAMES)
    service.fly()
    service.lead = "south"
    with in_background(Ticking(service)) as port:
        yield service, f"http://127.0.0.1:{port}"


@pytest.mark.soak
def test_stations_panel_shows_a_lost_one_and_takes_the_lead(chrome: Browser) -> None:
    with site(16) as (service, url), console(chrome, url, width=1440, height=900) as ui:
        ui.says("connection", "Live")
        ui.says("role", "station north")
        ui.opens("9", "panel-stations")
        for name in NAMES:
            ui.says(f"station-{name}-vehicles", "4")
        expect(ui.part("leads-south")).to_be_visible()

        service.silent_s["west"] = 2.5
        ui.says("banner-stations", "Not received: station west. 4 vehicles are shown as last received.")
        ui.says("station-missing-west", "NOT RECEIVED, silent for 2.5 s")
        del service.silent_s["west"]
        expect(ui.part("banner-stations")).to_have_count(0, timeout=SOON_MS)

        ui.press("lead-take")
        ui.says("panel-stations", "north takes over plan and formation from south")
        assert service.lead == "south"
        ui.press("lead-take")
        ui.tells("done", "The lead is taken")
        expect(ui.part("leads-north")).to_be_visible()
        expect(ui.part("lead-take")).to_have_attribute("aria-disabled", "true")
        assert service.lead == "north"

        ui.press("station-select-east")
        ui.opens("5", "panel-fleet")
        ui.says("selection-count", "4 vehicles selected")
        ui.press("selection-hold")
        ui.tells("done", "Hold d13, d14, d15, d16")
        ui.press("chip-station-south")
        ui.says("fleet-count", "4 of 16")
        ui.press("open-d5")
        ui.says("vehicle-station", "south")
        assert ui.wrong == []


@pytest.mark.soak
def test_one_station_has_no_panel_of_stations(chrome: Browser) -> None:
    service = FakeService(3)
    with (
        in_background(Ticking(service)) as port,
        console(chrome, f"http://127.0.0.1:{port}", width=1440, height=900) as ui,
    ):
        ui.says("connection", "Live")
        ui.opens("5", "fleet-table")
        expect(ui.part("tab-stations")).to_have_count(0)
        expect(ui.part("sort-station")).to_have_count(0)
        ui.page.keyboard.press("9")
        expect(ui.part("panel-fleet")).to_be_visible()
