"""What can be ordered after a stall: the formation again, home, or only what no pilot has."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gcs.model.interrupted_flight import Offer
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Mode
from gcs.service import CommandRecord, Outcome, ShowAction, VehicleAction
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import (
    HOLDS_WHEN_LOST,
    JUMP_M_S,
    VirtualShow,
    fly,
    refused,
    show_config,
)
from tests.support.sessions import four, sessions
from tests.support.show_phases import running
from tests.support.stalls import stall
from tests.support.written_show import config, select
from tests.support.written_show import fly as fly_written

FIRST = ("d1", "d2", "d3")


async def cut_off(show: VirtualShow, stalled_s: float = 4.0) -> None:
    await running(show)
    await show.wait(3.0)
    stall(show, stalled_s)
    await show.wait(1.0)


@pytest.mark.soak
def test_stall_reports_uncontrolled_vehicles_and_does_nothing() -> None:
    async def story(show: VirtualShow) -> None:
        await cut_off(show, 4.4)
        view = show.view
        assert view.show is ShowPhase.UNCONTROLLED
        assert view.reason.startswith(
            "4 vehicles airborne, not under this station's control: the service stall"
        )
        assert "stalled for 4.4" in view.reason or "stalled for 4.5" in view.reason
        assert (view.counts.airborne, view.counts.controlled, view.counts.uncontrolled) == (4, 0, 4)
        assert view.interrupted is not None
        assert view.interrupted.offers == (Offer.TAKE_OVER, Offer.BRING_HOME)
        turned_down = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
        assert "a start needs all vehicles on the ground: 4 vehicles airborne" in turned_down.text
        sent = show.view.setpoints_sent
        await show.wait(10.0)
        assert (show.view.setpoints_sent, show.view.show) == (sent, ShowPhase.UNCONTROLLED)

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST), after=running)


def test_recovered_vehicles_re_form_and_resume() -> None:
    async def story(show: VirtualShow) -> None:
        record = await show.settled(show.service.recovery.settle(Offer.TAKE_OVER))
        assert {part.outcome for part in record.outcomes.values()} == {Outcome.DONE}
        assert show.view.show is ShowPhase.PAUSED
        assert {seen.phase for seen in vehicles_of(show.view)} == {Phase.FORMATION}
        await show.until(lambda: show.view.interrupted is None)
        since_s = show.now_s
        await show.show(ShowAction.RESUME)
        await show.reach(ShowPhase.RUNNING)
        assert show.track.between(since_s).hardest_change_m_s() < JUMP_M_S
        assert show.floor_violations() == 0

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST), after=cut_off)


@pytest.mark.soak
def test_take_over_waits_for_a_heartbeat_after_the_stall() -> None:
    """Of what the vehicles sent meanwhile the oldest was kept: their modes are not known yet."""

    async def story(show: VirtualShow) -> None:
        stall(show, 5.3, kept_share=0.3)
        await show.until(lambda: show.view.interrupted is not None, 2.0)
        ages_s = [seen.heartbeat_age_s or 0.0 for seen in vehicles_of(show.view)]
        assert min(ages_s) > 3.0
        show.befall("d4", "pilot")
        record = await show.settled(show.service.recovery.settle(Offer.TAKE_OVER))
        assert [record.outcomes[name].outcome for name in FIRST] == [Outcome.DONE] * 3
        assert record.outcomes["d4"].outcome is Outcome.NOT_INCLUDED
        assert show.vehicle("d4").phase is Phase.PILOT

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST), after=running)


@pytest.mark.soak
def test_vehicle_piloted_around_the_stall_stays_piloted() -> None:
    async def story(show: VirtualShow) -> None:
        show.befall("d1", "pilot")
        await show.phase("d1", Phase.PILOT)
        await show.wait(1.0)
        show.befall("d2", "pilot")
        stall(show, 4.0)
        await show.wait(1.0)
        assert show.view.interrupted is not None
        assert set(show.view.interrupted.vehicles) == {"d3", "d4"}
        record = await show.settled(show.service.commands.command_show(ShowAction.STOP), 150.0)
        for name in ("d1", "d2"):
            assert record.outcomes[name].outcome is Outcome.NOT_INCLUDED
            assert f"take-control {name}" in record.outcomes[name].reason
            assert show.vehicle(name).phase is Phase.PILOT
        assert [record.outcomes[name].outcome for name in ("d3", "d4")] == [Outcome.DONE] * 2
        await show.reach(ShowPhase.UNCONTROLLED)
        assert show.view.reason.startswith("2 vehicles airborne, not under this station's control")

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST), after=running)


@pytest.mark.soak
def test_late_pilot_takeover_is_not_explained_by_the_stall() -> None:
    async def story(show: VirtualShow) -> None:
        await show.command("d1", VehicleAction.TAKE_CONTROL)
        show.befall("d1", "pilot")
        await show.phase("d1", Phase.PILOT)
        record = show.service.commands.command_show(ShowAction.STOP)
        assert record.outcomes["d1"].outcome is Outcome.NOT_INCLUDED

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST), after=cut_off)


@pytest.mark.soak
def test_a_short_pause_of_the_service_explains_nothing() -> None:
    async def story(show: VirtualShow) -> None:
        stall(show, 0.4)
        await show.wait(4.0)
        assert show.view.show is ShowPhase.RUNNING
        assert show.view.interrupted is None

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST), after=running)


@pytest.mark.soak
def test_pause_on_the_way_home_stands_and_stop_lands() -> None:
    async def story(show: VirtualShow) -> None:
        show.service.commands.command_show(ShowAction.STOP)
        await show.wait(4.0)
        await show.show(ShowAction.PAUSE)
        await show.wait(3.0)
        before_m = show.true_m.copy()
        await show.wait(5.0)
        assert show.view.show is ShowPhase.PAUSED
        assert np.abs(show.true_m - before_m).max() < 1.0
        await show.show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED)
        assert show.floor_violations() == 0

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST), after=running)


@pytest.mark.soak
def test_takeoffs_delayed_by_a_stall_follow_one_another() -> None:
    async def story(show: VirtualShow) -> list[float]:
        await show.standby()
        show.service.commands.command_show(ShowAction.START)
        await show.wait(0.5)
        stall(show, 4.0)
        await show.until(lambda: all(seen.armed for seen in vehicles_of(show.view)), 30.0)
        return sorted(
            next(command.time_s for command in show.ports.commands[name] if command.verb == "arm")
            for name in show.config.ids
        )

    armed_s = fly(story, show_config(4, operation=HOLDS_WHEN_LOST))
    assert np.diff(armed_s).min() > 0.5


@pytest.mark.soak
def test_service_ending_after_a_stall_knows_its_vehicles(tmp_path: Path) -> None:
    async def goes_on(show: VirtualShow) -> None:
        await show.until(lambda: {seen.phase for seen in vehicles_of(show.view)} == {Phase.PILOT})
        assert show.view.show is ShowPhase.UNCONTROLLED
        show.service.recovery.settle(Offer.BRING_HOME)
        await show.until(lambda: {seen.reason for seen in vehicles_of(show.view)} == {"on its way home"})

    sessions(tmp_path, (four(), cut_off), (four(), goes_on))


def test_stop_during_recovery_reaches_vehicles_that_hold() -> None:
    async def story(show: VirtualShow) -> None:
        show.ports.silence("d4", up=False)
        take_over = show.service.recovery.settle(Offer.TAKE_OVER)
        await show.until(lambda: [show.vehicle(name).phase for name in FIRST] == [Phase.HOLD] * 3)
        stopped = show.service.commands.command_show(ShowAction.STOP)
        show.ports.restore("d4")
        await show.until(lambda: {seen.reason for seen in vehicles_of(show.view)} == {"on its way home"})
        parts = show.service.command_log.get(stopped.id).outcomes.values()
        assert {(part.outcome, part.reason) for part in parts} == {(Outcome.PENDING, "")}
        assert {part.outcome for part in show.service.command_log.get(take_over.id).outcomes.values()} == {
            Outcome.FAILED
        }

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST), after=cut_off)


@pytest.mark.soak
def test_repeated_recovery_leaves_nothing_pending() -> None:
    async def story(show: VirtualShow) -> None:
        show.ports.silence("d4", up=False)
        first = show.service.recovery.settle(Offer.TAKE_OVER)
        await show.until(lambda: [show.vehicle(name).phase for name in FIRST] == [Phase.HOLD] * 3)
        show.ports.restore("d4")
        second = await show.settled(show.service.recovery.settle(Offer.TAKE_OVER))
        assert {part.outcome for part in second.outcomes.values()} == {Outcome.DONE}
        assert show.service.command_log.get(first.id).outcome is Outcome.FAILED

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST), after=cut_off)


@pytest.mark.soak
def test_fleet_command_skips_vehicles_without_heartbeats() -> None:
    async def story(show: VirtualShow) -> None:
        show.ports.beatless.add("d1")
        await show.wait(1.0)
        show.befall("d1", "pilot")
        await show.wait(4.0)
        assert show.vehicle("d1").phase is Phase.PILOT
        assert show.vehicle("d1").mode is Mode.HOLD, "nothing is known of the pilot"
        sent = len(show.ports.commands["d1"])
        commands: tuple[Callable[[], CommandRecord], ...] = (
            lambda: show.service.recovery.settle(Offer.TAKE_OVER),
            lambda: show.service.commands.command_vehicles(VehicleAction.TAKE_CONTROL),
            lambda: show.service.commands.command_show(ShowAction.PAUSE),
            lambda: show.service.commands.command_show(ShowAction.STOP),
        )
        for command in commands:
            record = command()
            assert record.outcomes["d1"].outcome is Outcome.NOT_INCLUDED
            assert "take-control d1" in record.outcomes["d1"].reason
            await show.wait(0.1)
        await show.wait(3.0)
        assert len(show.ports.commands["d1"]) == sent

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST), after=cut_off)


@pytest.mark.soak
def test_end_of_a_written_show_takes_no_control(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        show_hash = select(show)
        await show.standby()
        show.service.player.seek("tower")  # 8 s before its end
        show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
        await show.reach(ShowPhase.RUNNING)
        await show.wait(1.0)
        stall(show, 4.0)
        await show.wait(1.0)
        for name in FIRST:
            await show.command(name, VehicleAction.TAKE_CONTROL)
            await show.command(name, VehicleAction.JOIN)
        await show.show(ShowAction.RESUME)
        await show.reach(ShowPhase.RETURNING, 300.0)
        await show.wait(5.0)
        assert show.view.reason.endswith("is over: all vehicles return home")
        assert show.vehicle("d4").phase is Phase.PILOT
        assert show.vehicle("d4").setpoint_m_s is None

    fly_written(story, config(tmp_path, operation=HOLDS_WHEN_LOST))
