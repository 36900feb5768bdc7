"""A record in the same page: played, stopped, looked at anywhere, and judged."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest
from playwright.sync_api import Browser, expect

from gcs.client import Client
from gcs.model.lifecycle import ShowPhase
from gcs.recording.session import Record
from gcs.service import ShowAction
from gcs.sim.vehicle.px4 import Quirks
from gcs.testing.virtual_show import SLOWLY_DISARMED, VirtualShow, fly, show_config
from gcs.testing.virtual_time import UnixClock
from tests.support.console_bench import FLIGHT_MS, SOON_MS, console
from tests.support.processes import SOON_S, wait_until
from tests.support.replays import replay

CONFIG = show_config(4)


async def a_show(show: VirtualShow) -> None:
    await show.start()
    await show.wait(30.0)  # so that the middle of the record is in formation
    await show.show(ShowAction.STOP)
    await show.reach(ShowPhase.LANDED)


@contextmanager
def reported_in_flown_time() -> Iterator[None]:
    """Until the block ends, events are of the virtual clock, as the recorded states are."""
    usual, clock = logging.getLogRecordFactory(), UnixClock()

    def made(*given: Any, **named: Any) -> logging.LogRecord:
        record = usual(*given, **named)
        with suppress(RuntimeError):  # outside of a flight there is no virtual clock
            record.created = clock()
        return record

    logging.setLogRecordFactory(made)
    try:
        yield
    finally:
        logging.setLogRecordFactory(usual)


@pytest.fixture(scope="module")
def replayed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """`gcs replay` of a flight in virtual time; where its page is."""
    root = tmp_path_factory.mktemp("runs")
    vehicles = {name: (row + 1, "loop") for row, name in enumerate(CONFIG.ids)}
    with reported_in_flown_time(), Record(root, CONFIG.model_dump_json(), vehicles) as record:
        fly(a_show, CONFIG, record=record, quirks=Quirks(), parameters=SLOWLY_DISARMED)
    with replay(root) as address:
        yield address


@pytest.mark.soak
def test_record_is_played_stopped_searched_and_reported(replayed: str, chrome: Browser) -> None:
    with Client(replayed, timeout_s=30.0) as client, console(chrome, replayed) as ui:
        ui.says("connection", "Replay")
        expect(ui.part("start")).to_have_count(0)  # nothing can be ordered of what is over

        ui.press("replay-play")
        wait_until("paused", SOON_S, lambda: client.playback.now().paused)
        ui.part("replay-scrubber").fill("0")
        wait_until("rewound", SOON_S, lambda: client.playback.now().position_s == 0.0)
        expect(ui.part("airborne")).to_contain_text("0/4", timeout=SOON_MS)
        ui.part("replay-scrubber").focus()
        ui.page.keyboard.press("End")
        last_s = client.playback.now().duration_s - 1.0
        wait_until("near its end", SOON_S, lambda: client.playback.now().position_s > last_s)
        ui.says("show-phase", "landed")
        ui.part("replay-scrubber").fill(f"{last_s / 2.0:.1f}")
        ui.says("show-phase", "running")
        expect(ui.part("row-d1")).to_contain_text("formation", timeout=SOON_MS)
        ui.part("replay-scrubber").fill("0")
        expect(ui.part("airborne")).to_contain_text("0/4", timeout=SOON_MS)
        ui.press("replay-speed-10")
        ui.press("replay-play")
        ui.says("show-phase", "running", FLIGHT_MS)

        ui.press("tab-report")
        ui.press("report-read")
        expect(ui.part("report-verdict")).to_be_visible(timeout=FLIGHT_MS)
        expect(ui.part("report-checks")).to_contain_text("separation")
        assert ui.wrong == []
