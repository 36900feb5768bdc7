"""When a show begins, by the clock and by timecode: ordered, seen and cancelled on the page."""

import re
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Final

import pytest
from playwright.sync_api import Browser, expect

from gcs.client import Client
from gcs.service.features import TimecodeView
from gcs.shows.timecode.smpte import Label, parse_label
from tests.browser.test_console_cut_off import SHOW
from tests.browser.test_console_sizes import COMMANDS, UNREACHABLE
from tests.support.console_bench import FLIGHT_MS, Console, console, station
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, wait_until
from tests.support.rtp_desk import RtpDesk

ZONE: Final = "Asia/Kolkata"
HERE: Final = timezone(timedelta(hours=5, minutes=30))
"""Where the page's operator is: neither UTC nor, likely, where the tests run."""

SIZES: Final = ((1440, 900), (1024, 768), (390, 844), (740, 360))


def choose_show(client: Client) -> None:
    """Have the show checked, and select it."""
    client.shows.upload("circle", SHOW)
    client.shows.check("circle")
    wait_until("checked", 2 * SOON_S, lambda: client.shows.checked("circle").state == "done")
    show_hash = client.shows.checked("circle").hash
    assert show_hash is not None
    client.shows.select("circle", show_hash)


def open_start(ui: Console) -> None:
    expect(ui.part("start")).not_to_have_attribute("aria-disabled", "true", timeout=FLIGHT_MS)
    ui.opens("Shift+S", "start-go")
    expect(ui.part("start-preflight")).to_contain_text("passed", timeout=FLIGHT_MS)


def clock(ahead_s: float) -> datetime:
    """A whole second on the operator's clock."""
    return (datetime.now(HERE) + timedelta(seconds=ahead_s)).replace(microsecond=0)


def ordered_s(client: Client) -> float | None:
    """The time at which the selected show begins, as the service has it."""
    selected = client.show().selected
    return None if selected is None or selected.begin is None else selected.begin.at_unix_time_s


def waited_s(ui: Console) -> list[int]:
    """The seconds that the page has shown until the show begins, each once."""
    texts = [each["text"].removeprefix("in ").split(":") for each in ui.seen()["waited"]]
    return [60 * int(minutes) + int(seconds) for minutes, seconds in texts]


def reachable(ui: Console, *parts: str) -> None:
    """At every size these parts are seen, and no flight command is covered."""
    for width, height in SIZES:
        ui.page.set_viewport_size({"width": width, "height": height})
        ui.settles(UNREACHABLE, list(COMMANDS), at=[])
        for part in parts:
            expect(ui.part(part)).to_be_in_viewport()
    ui.page.set_viewport_size({"width": 1280, "height": 720})


def order_with_the_start(ui: Console, client: Client) -> None:
    """Typed in local time into the start; a time that has passed is refused, and nothing takes off."""
    open_start(ui)
    ui.by_key("begin-when-at")
    ui.part("begin-time").fill(f"{clock(-30.0):%H:%M:%S}")
    expect(ui.part("start-go")).to_have_attribute("aria-disabled", "true")
    ui.says("sheet-start", "has passed 0:3")
    at = clock(900.0)
    ui.part("begin-time").fill(f"{at:%H:%M:%S}")
    ui.says("begin-means", f"{at.astimezone(UTC):%H:%M:%S} UTC, in 1")
    ui.says("start-go", f"begin at {at:%H:%M:%S}")
    ui.closes(lambda: ui.by_key("start-go"), "sheet-start")
    assert ordered_s(client) == pytest.approx(at.timestamp())
    ui.says("begins", f"circle begins at {at:%H:%M:%S}")
    ui.says("begins-in", re.compile(r"in 1[45]:\d\d"))


@pytest.mark.soak
def test_a_show_is_ordered_to_begin_counted_down_and_cancelled(chrome: Browser, tmp_path: Path) -> None:
    with (
        station(tmp_path, 3, takeoff_m=4.0) as ground,
        console(chrome, ground.url, time_zone=ZONE) as ui,
    ):
        ui.says("connection", "Live")
        choose_show(ground.client)
        order_with_the_start(ui, ground.client)
        ui.says("begins-state", "the vehicles wait", FLIGHT_MS)
        ui.says("show-phase", "assembling")
        reachable(ui, "begins-in", "begin-cancel")

        ui.press("begin-cancel")
        ui.says("begin-cancel", "Yes, hold the show")
        assert ordered_s(ground.client) is not None  # the first press asks
        ui.press("begin-cancel")
        ui.says("begins-state", "held")
        assert ordered_s(ground.client) is None
        expect(ui.part("begins-in")).to_have_count(0)

        for ahead_s in (8.0, 30.0, 120.0):  # more where the machine was so slow that it had passed
            ui.opens(lambda: ui.press("begin"), "begin-time")
            at = clock(ahead_s)
            ui.part("begin-time").fill(f"{at:%H:%M:%S}")
            ui.part("begin-time").press("Enter")
            if ordered_s(ground.client) is not None or ui.part("sheet-begin").count() == 0:
                break
        ui.says("show-phase", "running", FLIGHT_MS)
        expect(ui.part("begins")).to_have_count(0)
        last = waited_s(ui)[-3:]
        assert last == sorted(set(last), reverse=True)
        assert last[-1] <= 2
        assert ui.wrong == []


def timecode(client: Client) -> TimecodeView:
    found = client.fleet().features.timecode
    assert found is not None
    return found


def place(client: Client) -> Label:
    """Where the timecode stands, at an even frame."""
    label = parse_label(timecode(client).label)
    return Label(label.hours, label.minutes, label.seconds, label.frames // 2 * 2)


def freezes(ui: Console) -> None:
    """The source has fallen silent: that cannot be missed at any size."""
    ui.says("timecode-stance", "SHOW FROZEN")
    ui.says("timecode-state", "LOST")
    ui.says("frozen-why", "timecode lost since")
    ui.says("show-phase", "frozen")
    alarm = ui.page.locator("[data-alarm][data-cause=timecode][data-severity=warning]").first
    expect(alarm).to_be_visible()
    reachable(ui, "timecode-stance", "frozen-for", "follow")


@pytest.mark.soak
def test_timecode_is_seen_running_frozen_and_running_again(chrome: Browser, tmp_path: Path) -> None:
    port = free_ports(2)
    section = {"source": f"rtp-midi://127.0.0.1:{port}", "starts_at": "01:00:00:00"}
    with (
        station(tmp_path, 3, takeoff_m=4.0, sections={"timecode": section}) as ground,
        console(chrome, ground.url) as ui,
        RtpDesk(port) as desk,
    ):
        client = ground.client
        ui.says("timecode-source", f"rtp-midi://127.0.0.1:{port}")
        ui.says("timecode-state", "none yet")
        choose_show(client)
        open_start(ui)
        ui.says("start-begins", "With the timecode")
        ui.closes(lambda: ui.by_key("start-go"), "sheet-start")
        ui.says("timecode-stance", "The show waits: no timecode has arrived", FLIGHT_MS)
        with desk.runs(Label(0, 59, 57, 0)):
            ui.says("timecode-state", "running")
            ui.says("show-phase", "running", FLIGHT_MS)
            ui.says("timecode-label", re.compile(r"01:00:0[4-9]:\d\d"))
            ui.says("timecode-behind", re.compile(r"show \d+ ms (behind|ahead)"))
        freezes(ui)

        stood = place(client)
        desk.stands_at(stood)
        ui.says("timecode-state", "stopped")
        ui.says("frozen-why", "timecode stopped since")
        with desk.runs(stood):
            ui.says("timecode-state", "running")
            ui.says("show-phase", "running")
            wait_until("on", SOON_S, lambda: abs(timecode(client).behind_s or 9.0) < 0.1)
            expect(ui.part("frozen-for")).to_have_count(0)

        ui.says("timecode-stance", "SHOW FROZEN")
        ui.press("follow")
        ui.says("follow", "Yes, go on by the clock now")
        ui.press("follow")
        ui.says("timecode-stance", "Not followed")
        ui.says("show-phase", "running")
        assert not timecode(client).followed
        assert ui.wrong == []
