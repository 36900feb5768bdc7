"""What one vehicle suffers: it leaves, where it can fly it comes home, and the rest close the gap."""

import numpy as np
import pytest

from gcs.failsafe.policy import Cause
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import Outcome, ShowAction, VehicleAction
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, alarm_texts, fly, show_config
from tests.support.failsafe_flights import (
    by_itself,
    carried_out,
    failsafe,
    nearest_m,
    off_pad_m,
    off_sphere_m,
    reacts,
)
from tests.support.show_phases import running

OTHERS = ("d1", "d2", "d4", "d5")
FOUR, FIVE = (show_config(count, operation=HOLDS_WHEN_LOST) for count in (4, 5))


async def lands_all(show: VirtualShow) -> None:
    """And no vehicle was below the floor."""
    await show.show(ShowAction.STOP)
    await show.reach(ShowPhase.LANDED)
    assert show.floor_violations() == 0


@pytest.mark.soak
def test_vehicle_lost_the_rest_re_form() -> None:
    async def story(show: VirtualShow) -> None:
        await show.wait(6.0)
        before_m = nearest_m(show, *OTHERS)
        show.ports.silence("d3")
        reported = await reacts(show, Cause.VEHICLE_LOST)
        assert (reported.action, reported.vehicles) == ("re-form", ("d3",))
        command = await carried_out(show, reported)
        assert (command.action, command.by) == ("re-form", "service")
        assert {name for name, part in command.outcomes.items() if part.outcome is Outcome.DONE} == set(
            OTHERS
        )
        assert command.outcomes["d3"].outcome is Outcome.NOT_INCLUDED
        await show.wait(8.0)
        assert off_sphere_m(show, *OTHERS) < 1.2
        assert nearest_m(show, *OTHERS) > before_m + 0.2
        assert any(text.startswith("Vehicle d3 lost: ") for text in alarm_texts(show))
        assert len(by_itself(show)) == 2, "the start, and this once"
        show.ports.restore("d3")
        await show.until(lambda: failsafe(show, Cause.VEHICLE_LOST) is None)
        await lands_all(show)

    fly(story, FIVE, after=running)


@pytest.mark.soak
def test_low_battery_is_ignored_and_a_loss_pauses_where_set() -> None:
    """An ignored battery is left to the autopilot; a lost vehicle pauses the show until it is resumed."""

    async def story(show: VirtualShow) -> None:
        await show.start()
        show.befall("d3", "battery", remaining=0.15)
        await show.wait(10.0)
        assert show.view.failsafes == ()
        assert show.vehicle("d3").phase is Phase.FORMATION
        show.ports.silence("d2")
        await show.reach(ShowPhase.PAUSED)
        assert "vehicle lost" in show.view.reason
        show.service.commands.command_show(ShowAction.RESUME)
        await show.reach(ShowPhase.RUNNING)
        await show.wait(10.0)
        assert show.view.show is ShowPhase.RUNNING, "the operator's later order counts"
        assert failsafe(show, Cause.VEHICLE_LOST) is not None
        assert failsafe(show, Cause.LOW_BATTERY) is None
        assert show.floor_violations() == 0

    failsafes = {"vehicle_lost": {"action": "pause"}, "low_battery": {"action": "ignore"}, "clear_s": 2.0}
    fly(story, show_config(4, operation=HOLDS_WHEN_LOST, failsafes=failsafes))


def test_low_battery_returns_home_while_the_rest_re_form() -> None:
    async def story(show: VirtualShow) -> None:
        await show.wait(4.0)
        show.befall("d3", "battery", remaining=0.15)
        reported = await reacts(show, Cause.LOW_BATTERY)
        assert (reported.action, reported.vehicles) == ("return", ("d3",))
        assert "15%" in reported.reason
        command = await carried_out(show, reported)
        assert (command.action, command.by) == ("return", "service")
        assert command.outcomes.keys() == {"d3"}
        assert command.outcome is Outcome.DONE
        assert show.track.phases("d3")[-3:] == [Phase.RETURN, Phase.LANDING, Phase.STANDBY]
        assert off_pad_m(show, "d3") < 1.5
        await show.wait(8.0)
        assert show.view.show is ShowPhase.RUNNING
        assert {show.vehicle(name).phase for name in OTHERS} == {Phase.FORMATION}
        assert off_sphere_m(show, *OTHERS) < 1.2
        assert failsafe(show, Cause.LOW_BATTERY) is None, "it is down"
        assert show.floor_violations() == 0

    fly(story, FIVE, after=running)


@pytest.mark.soak
def test_critical_battery_lands_it_where_it_is_safe() -> None:
    async def story(show: VirtualShow) -> None:
        await show.wait(4.0)
        show.befall("d3", "battery", remaining=0.09)
        reported = await reacts(show, Cause.CRITICAL_BATTERY)
        assert (reported.action, reported.vehicles) == ("land", ("d3",))
        command = await carried_out(show, reported)
        assert (command.action, command.by, command.outcome) == ("land", "service", Outcome.DONE)
        assert Phase.RETURN not in show.track.phases("d3")
        pads_m = show.track.samples[0].true_m[[show.config.ids.index(name) for name in OTHERS]]
        row = show.config.ids.index("d3")
        beside_m = np.hypot(*(pads_m - show.true_m[row])[:, :2].T)
        assert beside_m.min() > show.config.operation.landing_site_spacing_m - 1.0, "clear of all pads"
        assert show.view.show is ShowPhase.RUNNING
        assert show.floor_violations() == 0

    fly(story, FIVE, after=running)


@pytest.mark.soak
def test_low_battery_overruled_acts_again_only_when_critical() -> None:
    async def story(show: VirtualShow) -> None:
        show.befall("d2", "battery", remaining=0.18)
        reported = await reacts(show, Cause.LOW_BATTERY)
        await show.phase("d2", Phase.RETURN)
        await show.command("d2", VehicleAction.HOLD)
        assert (await show.command("d2", VehicleAction.JOIN)).outcome is Outcome.DONE
        await show.wait(12.0)
        assert show.vehicle("d2").phase is Phase.FORMATION
        assert failsafe(show, Cause.LOW_BATTERY) is not None, "and it is still told"
        assert show.service.command_log.get(str(reported.command_id)).outcome is Outcome.FAILED
        show.befall("d2", "battery", remaining=0.08)
        await show.phase("d2", Phase.LANDING)
        await show.phase("d2", Phase.STANDBY)
        assert show.floor_violations() == 0

    fly(story, FOUR, after=running)


@pytest.mark.soak
def test_low_battery_of_many_returns_the_fleet() -> None:
    async def story(show: VirtualShow) -> None:
        for name in ("d1", "d2", "d3"):
            show.befall(name, "battery", remaining=0.19)
        await show.reach(ShowPhase.RETURNING)
        assert "low battery" in show.view.reason
        await show.reach(ShowPhase.LANDED, 120.0)
        *_, stop = by_itself(
            show
        )  # batteries are reported one after the other: the first vehicle returns alone
        stop = await show.settled(stop)
        assert (stop.action, len(stop.outcomes)) == ("stop", 4)
        assert {part.outcome for part in stop.outcomes.values()} == {Outcome.DONE}
        assert max(off_pad_m(show, name) for name in show.config.ids) < 1.5
        assert show.floor_violations() == 0

    fly(story, FOUR, after=running)


@pytest.mark.soak
def test_low_battery_under_pilot_control_is_left_to_the_pilot() -> None:
    async def story(show: VirtualShow) -> None:
        show.befall("d2", "pilot", mode="POSITION")
        await show.phase("d2", Phase.PILOT)
        commands = len(show.ports.commands["d2"])
        show.befall("d2", "battery", remaining=0.05)
        await show.wait(10.0)
        assert len(show.ports.commands["d2"]) == commands
        assert show.view.failsafes == ()
        assert show.view.show is ShowPhase.RUNNING

    fly(story, FOUR, after=running)


@pytest.mark.soak
def test_low_battery_during_the_climb_lands_straight_down() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        show.service.commands.command_show(ShowAction.START)
        await show.phase("d2", Phase.TAKEOFF)
        show.befall("d2", "battery", remaining=0.18)
        command = await carried_out(show, await reacts(show, Cause.LOW_BATTERY))
        assert (command.action, command.by, command.outcome) == ("return", "service", Outcome.DONE)
        assert show.track.phases("d2")[-3:] == [Phase.TAKEOFF, Phase.LANDING, Phase.STANDBY]
        assert off_pad_m(show, "d2") < 1.0
        await show.reach(ShowPhase.RUNNING)
        assert {show.vehicle(name).phase for name in ("d1", "d3")} == {Phase.FORMATION}
        assert show.floor_violations() == 0

    fly(story, show_config(3, failsafes={"low_battery": {"for_s": 0.5}}))


@pytest.mark.soak
def test_bad_position_holds_then_lands() -> None:
    async def story(show: VirtualShow) -> None:
        await show.wait(4.0)
        show.befall("d4", "accuracy", eph_m=9.0, epv_m=20.0)
        reported = await reacts(show, Cause.BAD_POSITION)
        assert (reported.action, reported.vehicles) == ("hold", ("d4",))
        assert "9.0 m" in reported.reason
        held = await carried_out(show, reported)
        assert (held.action, held.by, held.outcome) == ("hold", "service", Outcome.DONE)
        assert show.vehicle("d4").phase is Phase.HOLD
        await show.phase("d4", Phase.STANDBY)
        assert [command.action for command in by_itself(show)[1:]] == ["hold", "land"]
        assert (await show.settled(by_itself(show)[-1])).outcome is Outcome.DONE
        assert show.view.show is ShowPhase.RUNNING
        assert off_sphere_m(show, "d1", "d2", "d3", "d5") < 1.2
        assert show.floor_violations() == 0

    fly(story, FIVE, after=running)


@pytest.mark.soak
def test_bad_position_that_recovers_holds_until_commanded() -> None:
    async def story(show: VirtualShow) -> None:
        show.befall("d2", "accuracy", eph_m=9.0, epv_m=20.0)
        await show.phase("d2", Phase.HOLD)
        show.befall("d2", "accuracy", eph_m=0.1, epv_m=0.2)
        await show.until(lambda: failsafe(show, Cause.BAD_POSITION) is None)
        await show.wait(10.0)
        assert show.vehicle("d2").phase is Phase.HOLD
        assert (await show.command("d2", VehicleAction.JOIN)).outcome is Outcome.DONE
        assert show.floor_violations() == 0

    fly(story, FOUR, after=running)


@pytest.mark.soak
def test_bad_position_by_jumping_again_and_again() -> None:
    async def story(show: VirtualShow) -> None:
        for east_m in (0.4, -0.4):
            show.befall("d2", "position-reset", east_m=east_m)
            await show.wait(5.0)
        assert show.view.failsafes == ()
        assert show.vehicle("d2").phase is Phase.FORMATION
        show.befall("d2", "position-reset", east_m=0.4)
        reported = await reacts(show, Cause.BAD_POSITION)
        assert "3 times" in reported.reason
        await show.phase("d2", Phase.HOLD)
        assert show.floor_violations() == 0

    fly(story, FOUR, after=running)


@pytest.mark.soak
def test_bad_position_kilometres_away_is_held_then_landed() -> None:
    async def story(show: VirtualShow) -> None:
        show.befall("d2", "gps-jump", north_m=5000.0)
        reported = await reacts(show, Cause.BAD_POSITION)
        assert reported.vehicles == ("d2",)
        await show.phase("d2", Phase.HOLD)
        await show.phase("d2", Phase.STANDBY, 90.0)
        assert Phase.PILOT not in show.track.phases("d2")
        show.befall("d2", "none")
        await lands_all(show)

    fly(story, FOUR, after=running)


@pytest.mark.soak
@pytest.mark.parametrize("action", ["return", "hold"])
def test_fence_about_to_be_crossed_brings_it_back(action: str) -> None:
    async def story(show: VirtualShow) -> None:
        await show.start()
        await show.wait(4.0)
        assert show.view.center_m is not None
        north = show.service.frame.into_ned(show.true_m - np.array(show.view.center_m))[:, 0]
        blown = show.config.ids[int(np.argmax(north))]
        show.befall(blown, "wind", north_m_s=14.0)
        reported = await reacts(show, Cause.FENCE)
        assert (reported.action, reported.vehicles) == (action, (blown,))
        show.befall(blown, "wind")
        command = await carried_out(show, reported)
        assert (command.action, command.by, command.outcome) == (action, "service", Outcome.DONE)
        row = show.config.ids.index(blown)
        away_m = np.hypot(*show.track.true_m[:, row, :2].T).max()
        assert away_m < FENCE_M + 2.0
        if action == "return":
            assert off_pad_m(show, blown) < 1.5
        assert show.view.show is ShowPhase.RUNNING
        assert show.floor_violations() == 0

    config = show_config(
        4,
        control={"safety": {"fence": {"distance_max_m": FENCE_M}}},
        operation={"pads_within_m": 30.0},
        failsafes={"fence": {"action": action}},
    )
    fly(story, config)


FENCE_M = 32.0
