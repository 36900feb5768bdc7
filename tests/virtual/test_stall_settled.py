"""What can be ordered after a stall: the formation again, home, or only what no pilot has."""

import asyncio
import time
from pathlib import Path

import numpy as np
from stalls import stall
from test_show_interrupted import four, one_session
from virtual_show import HOLDS_WHEN_LOST, JUMP_M_S, Show, UnixClock, fly, refused, run_virtual, show_config
from written_show import on_pads

from gcs.interrupted import Offer
from gcs.lifecycle import Phase, ShowPhase
from gcs.parameters import requirements, settings_of
from gcs.service import Outcome, ShowAction, VehicleAction
from gcs.sim.fleet import Fleet, Settings


async def cut_off(show: Show, stalled_s: float = 4.0) -> None:
    await show.start()
    await show.wait(3.0)
    stall(show, stalled_s)
    await show.wait(1.0)


def test_the_show_says_how_many_are_out_of_control_and_why_and_nothing_happens_by_itself() -> None:
    async def story(show: Show) -> None:
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
        turned_down = await refused(show, lambda: show.service.command_show(ShowAction.START))
        assert "a start needs all vehicles on the ground: 4 vehicles airborne" in turned_down.text
        sent = show.view.setpoints_sent
        await show.wait(10.0)
        assert (show.view.setpoints_sent, show.view.show) == (sent, ShowPhase.UNCONTROLLED)

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST))


def test_taken_over_they_are_in_formation_again_and_fly_on_when_resumed() -> None:
    async def story(show: Show) -> None:
        await cut_off(show)
        record = await show.settled(show.service.settle(Offer.TAKE_OVER))
        assert {part.outcome for part in record.outcomes.values()} == {Outcome.DONE}
        assert show.view.show is ShowPhase.PAUSED
        assert {seen.phase for seen in show.view.vehicles} == {Phase.FORMATION}
        await show.until(lambda: show.view.interrupted is None)
        since_s = show.now_s
        await show.show(ShowAction.RESUME)
        await show.reach(ShowPhase.RUNNING)
        assert show.track.between(since_s).hardest_change_m_s() < JUMP_M_S
        assert show.floor_violations() == 0

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST))


def test_a_vehicle_taken_by_a_pilot_before_or_during_the_stall_stays_the_pilots() -> None:
    async def story(show: Show) -> None:
        await show.start()
        show.befall("d1", "pilot")
        await show.phase("d1", Phase.PILOT)
        await show.wait(1.0)
        show.befall("d2", "pilot")
        stall(show, 4.0)
        await show.wait(1.0)
        assert show.view.interrupted is not None
        assert {one.id for one in show.view.interrupted.vehicles} == {"d3", "d4"}
        record = await show.settled(show.service.command_show(ShowAction.STOP), 150.0)
        for name in ("d1", "d2"):
            assert record.outcomes[name].outcome is Outcome.NOT_INCLUDED
            assert f"take-control {name}" in record.outcomes[name].reason
            assert show.vehicle(name).phase is Phase.PILOT
        assert [record.outcomes[name].outcome for name in ("d3", "d4")] == [Outcome.DONE] * 2
        await show.reach(ShowPhase.UNCONTROLLED)
        assert show.view.reason.startswith("2 vehicles airborne, not under this station's control")

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST))


def test_what_is_taken_by_a_pilot_long_after_the_stall_is_not_explained_by_it() -> None:
    async def story(show: Show) -> None:
        await cut_off(show)
        await show.order("d1", VehicleAction.TAKE_CONTROL)
        show.befall("d1", "pilot")
        await show.phase("d1", Phase.PILOT)
        record = show.service.command_show(ShowAction.STOP)
        assert record.outcomes["d1"].outcome is Outcome.NOT_INCLUDED
        await show.settled(record, 150.0)

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST))


def test_a_short_pause_of_the_service_explains_nothing() -> None:
    async def story(show: Show) -> None:
        await show.start()
        stall(show, 0.4)
        await show.wait(4.0)
        assert show.view.show is ShowPhase.RUNNING
        assert show.view.interrupted is None

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST))


def test_paused_on_the_way_home_they_stand_and_stopped_again_they_land() -> None:
    async def story(show: Show) -> None:
        await show.start()
        show.service.command_show(ShowAction.STOP)
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

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST))


def test_take_offs_that_a_stall_has_held_up_follow_one_another() -> None:
    async def story(show: Show) -> list[float]:
        await show.standby()
        show.service.command_show(ShowAction.START)
        await show.wait(0.5)
        stall(show, 4.0)
        await show.until(lambda: all(seen.armed for seen in show.view.vehicles), 30.0)
        return sorted(
            next(order.time_s for order in show.link.orders[name] if order.verb == "arm")
            for name in show.config.ids
        )

    armed_s = fly(story, show_config(4, operation=HOLDS_WHEN_LOST))
    assert np.diff(armed_s).min() > 0.5


def test_a_service_that_ends_after_a_stall_still_knows_which_vehicles_it_flew(tmp_path: Path) -> None:
    config = four()

    async def goes_on(show: Show) -> None:
        await show.until(lambda: {seen.phase for seen in show.view.vehicles} == {Phase.PILOT})
        assert show.view.show is ShowPhase.UNCONTROLLED
        record = await show.settled(show.service.settle(Offer.BRING_HOME), 150.0)
        assert {part.outcome for part in record.outcomes.values()} == {Outcome.DONE}
        await show.reach(ShowPhase.LANDED)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        proper = settings_of(requirements(config.operation, config.control))
        settings = Settings(count=4, grid_columns=2, parameters=proper, **on_pads())
        unix = UnixClock()
        unix.ahead_s = time.time() - loop.time()
        fleet = Fleet(settings, start_s=loop.time(), unix_at_start_s=unix())
        await one_session(config, fleet, tmp_path, unix, cut_off)
        await asyncio.sleep(2.0)
        await one_session(config, fleet, tmp_path, unix, goes_on)

    run_virtual(main)
