"""A position that jumps while its vehicle stands ready keeps it on the ground until somebody has looked."""

import pytest

from gcs.estimation.pad_places import SETTLES_S
from gcs.model.preflight_report import Check, PreflightReport
from gcs.service import ShowAction
from gcs.service.alarms import Alarm, AlarmAction, AlarmCause, AlarmSeverity
from gcs.sim.vehicle.px4 import Quirks
from gcs.testing.virtual_show import VirtualShow, fly, refused, show_config
from tests.flight.test_show_autopilots import config_of

STANDS_S = SETTLES_S + 2.0
JUMPED = "d2: its position moved by 30 m sideways while it stood"


def report(show: VirtualShow) -> PreflightReport:
    """As of now: a report is made at most once a second."""
    show.service.preflight._last = None
    return show.service.preflight.report()


def jump_of(show: VirtualShow, vehicle: str = "d2") -> Check:
    checks = next(each.checks for each in report(show).vehicles if each.id == vehicle)
    return next(check for check in checks if check.name == "jump")


async def stood(show: VirtualShow) -> None:
    await show.standby()
    await show.wait(STANDS_S)
    assert report(show).passes


def jump(show: VirtualShow, **by_m: float) -> None:
    show.befall("d2", "gps-jump", **by_m)


async def refusal(show: VirtualShow) -> str:
    refusal = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
    return refusal.text


def alarm(show: VirtualShow) -> Alarm | None:
    return next((each for each in show.view.alarms if each.cause is AlarmCause.MOVED_ON_PAD), None)


@pytest.mark.soak
def test_a_jump_of_30_m_on_the_pad_is_never_green_again() -> None:
    async def story(show: VirtualShow) -> None:
        jump(show, north_m=30.0)
        for _ in range(13):
            await show.wait(10.0)
            assert not report(show).passes
        assert not show.vehicle("d2").ready
        assert jump_of(show).value == pytest.approx(30.0, abs=1.0)
        (cause,) = report(show).causes
        assert cause.text.startswith(JUMPED)
        assert cause.text.endswith("2 min ago")
        assert "reboot it where it stands; or confirm its place: leave it out" in cause.to_do
        assert JUMPED in await refusal(show)

    fly(story, show_config(3), after=stood)


def test_leaving_out_and_including_confirms_where_it_stands() -> None:
    async def story(show: VirtualShow) -> None:
        preflight = show.service.preflight
        preflight.exclude("d2", "its battery is changed")
        show.befall("d2", "gps-jump", north_m=30.0)
        await show.wait(4.0)
        preflight.include("d2")
        assert not report(show).passes, "it jumped after it was left out: that was not seen"
        preflight.exclude("d2", "it stands there")
        preflight.include("d2")
        assert report(show).passes

    fly(story, show_config(3), after=stood)


@pytest.mark.soak
def test_a_position_that_is_back_and_steady_is_believed_again() -> None:
    async def story(show: VirtualShow) -> None:
        jump(show, north_m=6.0)
        await show.wait(4.0)
        show.befall("d2", "none")
        await show.wait(SETTLES_S - 2.0)
        assert "is back for less than 10 s" in jump_of(show).problem
        assert not report(show).passes
        await show.wait(4.0)
        assert report(show).passes

    fly(story, show_config(3), after=stood)


@pytest.mark.soak
def test_after_a_reboot_it_stands_where_it_is_reported() -> None:
    async def story(show: VirtualShow) -> None:
        jump(show, north_m=30.0)
        await show.wait(4.0)
        assert not report(show).passes
        show.befall("d2", "reboot", off_s=3.0)
        await show.until(lambda: report(show).passes, 40.0)

    fly(story, show_config(3), after=stood)


@pytest.mark.soak
def test_a_slow_drift_beyond_the_accuracy_is_named_as_well() -> None:
    async def story(show: VirtualShow) -> None:
        jump(show, east_m=0.05)
        for _ in range(60):
            show.befall("d2", "gps-jump", east_m=0.05)
            await show.wait(1.0)
        assert jump_of(show).value == pytest.approx(3.0, abs=0.6)
        assert "m sideways while it stood" in jump_of(show).problem

    fly(story, show_config(3), after=stood, ideal=True)


@pytest.mark.soak
def test_what_jumps_while_it_starts_is_held_against_none() -> None:
    async def story(show: VirtualShow) -> None:
        for vehicle in show.config.ids:
            show.befall(vehicle, "reboot", off_s=1.0)
        for _ in range(8):  # until it is ready an estimate wanders
            await show.wait(0.5)
            for vehicle in show.config.ids:
                show.befall(vehicle, "gps-jump", north_m=-1.0, east_m=0.5)
        await show.until(lambda: report(show).passes, 60.0)
        await show.wait(STANDS_S)
        assert report(show).passes
        for vehicle in show.config.ids:
            assert jump_of(show, vehicle).value == pytest.approx(0.0, abs=0.5)

    fly(story, config_of(("px4", "ardupilot"), 2), quirks=Quirks(), ideal=True)


@pytest.mark.soak
def test_jumps_on_the_pads_are_one_alarm_until_confirmed() -> None:
    async def story(show: VirtualShow) -> None:
        preflight = show.service.preflight
        jump(show, north_m=30.0)
        await show.until(lambda: alarm(show) is not None, 3.0)
        show.befall("d3", "gps-jump", east_m=6.0)
        await show.until(lambda: (of_both := alarm(show)) is not None and len(of_both.vehicles) == 2, 3.0)
        both = alarm(show)
        assert both is not None
        assert (both.severity, both.action) == (AlarmSeverity.CAUTION, AlarmAction.LEAVE_OUT)
        assert both.text.startswith("Vehicles d2, d3 not where they stood: d2: moved by 30 m sideways, ")
        assert "; d3: moved by 6" in both.text
        assert "leave them out, and include them again" in both.advice
        preflight.exclude("d2", "it stands there")
        await show.until(lambda: (of_one := alarm(show)) is not None and of_one.vehicles == ("d3",), 3.0)
        preflight.include("d2")
        show.befall("d3", "none")
        await show.until(lambda: alarm(show) is None, SETTLES_S + 3.0)
        assert report(show).passes

    fly(story, show_config(3), after=stood)


@pytest.mark.soak
def test_a_vehicle_that_stays_on_its_pad_moves_without_an_alarm() -> None:
    async def story(show: VirtualShow) -> None:
        show.service.commands.command_show(ShowAction.START, ["d1", "d3"])
        await show.until(lambda: show.view.counts.airborne == 2)
        show.befall("d2", "gps-jump", north_m=30.0)
        await show.wait(3.0)
        assert alarm(show) is None, "it cannot be looked at below those that fly"
        await show.show(ShowAction.STOP)
        await show.until(lambda: alarm(show) is not None)

    fly(story, show_config(3), after=stood)
