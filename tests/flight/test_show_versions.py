"""Vehicles whose autopilots have other versions than before, or than this station knows."""

import pytest

from gcs.model.errors import RefusedError
from gcs.model.preflight_report import PreflightReport
from gcs.service import ShowAction
from gcs.testing.virtual_show import RefusedCall, VirtualShow, fly, refused, show_config

HOLDS = {"setpoint_loss_action": "hold"}


def report_version(show: VirtualShow, raw: int) -> None:
    """Let d1 report this flight_sw_version from now on, as after an update of its firmware."""
    columns = show.link._telemetry._columns
    columns.version[0] = raw
    columns.changes[0] += 1


async def start(show: VirtualShow) -> RefusedCall:
    return await refused(show, lambda: show.service.commands.command_show(ShowAction.START))


async def after(show: VirtualShow, raw: int) -> PreflightReport:
    report_version(show, raw)
    await show.wait(3.0)
    return show.service.preflight.report()


def test_version_is_received_and_shown_before_a_start() -> None:
    async def story(show: VirtualShow) -> PreflightReport:
        await show.standby()
        return show.service.preflight.report()

    report = fly(story, show_config(2))
    assert [each.version for each in report.vehicles] == ["1.16.1", "1.16.1"]
    assert not [text for text in report.not_checked if "version" in text]


@pytest.mark.soak
def test_changed_version_is_noticed_and_parameters_read_again(caplog: pytest.LogCaptureFixture) -> None:
    async def story(show: VirtualShow) -> tuple[int, PreflightReport]:
        await show.standby()
        before = show.ports.reads()
        report = await after(show, 0x010F04FF)
        return show.ports.reads() - before, report

    reads, report = fly(story, show_config(2))
    assert reads == 1
    assert report.passes
    (changed,) = [each for each in caplog.records if each.msg == "autopilot_version_changed"]
    assert changed.__dict__["reason"] == "PX4 1.15.4, before it was 1.16.1: its parameters are read again"


def test_too_old_a_version_is_refused_in_words() -> None:
    async def story(show: VirtualShow) -> RefusedCall:
        await show.standby()
        await after(show, 0x010D03FF)
        return await start(show)

    refusal = fly(story, show_config(2))
    assert refusal.kind is RefusedError
    assert refusal.text == "d1: it has PX4 1.13.3, PX4 1.14 to 1.18 can be flown; d1: update its firmware"


@pytest.mark.soak
def test_newer_version_flies_and_is_listed_as_not_checked() -> None:
    """The fake has no MAN_OVERRIDE_SPD, which counts in the newest version: the sticks are not asked for."""

    async def story(show: VirtualShow) -> PreflightReport:
        await show.standby()
        return await after(show, 0x011300FF)

    report = fly(story, show_config(2, operation={**HOLDS, "pilot_takes_over": False}))
    assert report.passes
    newer, polygons = [text for text in report.not_checked if text.startswith("d1: ")]
    assert newer.startswith("d1: it has PX4 1.19.0, newer than what this station knows (PX4 1.14 to 1.18)")
    assert polygons.startswith("d1: its RTL flies round polygon fences")


@pytest.mark.soak
def test_what_a_newer_version_lacks_is_refused_by_name() -> None:
    async def story(show: VirtualShow) -> RefusedCall:
        await show.standby()
        await after(show, 0x011300FF)
        return await start(show)

    refusal = fly(story, show_config(2, operation=HOLDS))
    assert "parameter MAN_OVERRIDE_SPD: no answer; there is no such parameter" in refusal.text
    assert "wait; if it stays so, update the station, or fly PX4 1.14 to 1.18" in refusal.text
    assert "gcs params apply" not in refusal.text
