"""PX4 as it is: what docs/FACTS.md, section 3, says of it, item by item, against the service.

Items that other tests show are listed with them in docs/operations.md.
"""

import pytest
from virtual_show import HOLDS_WHEN_LOST, Refusal, Show, fly, refused, show_config

from gcs.errors import OrderError
from gcs.lifecycle import Phase, ShowPhase
from gcs.links import Order, Verb
from gcs.service import ShowAction, VehicleAction
from gcs.state import Mode


def test_item_3_an_acknowledgement_that_the_heartbeat_does_not_bear_out_is_not_believed() -> None:
    """The first of PX4's two acks says ACCEPTED whatever happens; here the mode then does not change."""

    async def story(show: Show) -> str:
        await show.start()
        show.befall("d1", "stuck-mode", answer="accepted")
        record = await show.order("d1", VehicleAction.HOLD)
        return record.outcomes["d1"].reason

    assert "d1: hold sent, but not seen to happen: it reports offboard, armed" in fly(story, show_config(2))


def test_item_4_offboard_is_not_ordered_of_a_vehicle_that_gets_no_setpoints() -> None:
    async def story(show: Show) -> str:
        await show.standby()
        with pytest.raises(OrderError) as refusal:
            await show.link.execute(Order("d1", Verb.OFFBOARD))
        return str(refusal.value)

    assert fly(story, show_config(2)) == "d1: offboard refused: no setpoints are flowing to it"


def test_item_6_a_vehicle_that_failed_safe_is_not_flown_on_by_itself_when_we_are_back() -> None:
    """Setpoints that resumed would take it back to OFFBOARD unasked: it gets none until handed back."""

    async def story(show: Show) -> tuple[list[Phase], Phase, int, Mode]:
        await show.start()
        show.link.silence("d2", down=False)  # it hears nothing, we hear everything
        await show.phase("d2", Phase.PILOT)
        sent = len(show.link.sent["d2"])
        show.link.restore("d2")
        await show.wait(5.0)
        flown, seen = len(show.link.sent["d2"]) - sent, show.vehicle("d2")
        await show.order("d2", VehicleAction.TAKE_CONTROL)
        return show.track.phases("d2"), seen.phase, flown, seen.mode

    phases, phase, flown, mode = fly(story, show_config(3, operation=HOLDS_WHEN_LOST))
    assert (phase, flown, mode) == (Phase.PILOT, 0, Mode.HOLD)
    assert phases[-1] is Phase.HOLD


def test_item_7_after_landing_from_offboard_the_show_can_be_started_again() -> None:
    async def story(show: Show) -> ShowPhase:
        await show.start()
        await show.show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED)
        await show.standby()
        await show.wait(1.0)
        show.service.command_show(ShowAction.START)
        await show.reach(ShowPhase.RUNNING)
        return show.view.show

    assert fly(story, show_config(2), spacing_m=8.0) is ShowPhase.RUNNING


def test_item_11_takeoff_is_not_ordered_of_a_disarmed_vehicle_nor_disarming_of_one_in_the_air() -> None:
    async def story(show: Show) -> tuple[str, str]:
        await show.standby()
        with pytest.raises(OrderError) as takeoff:
            await show.link.execute(Order("d1", Verb.TAKEOFF, 5.0))
        await show.start()
        with pytest.raises(OrderError) as disarm:
            await show.link.execute(Order("d1", Verb.DISARM))
        return str(takeoff.value), str(disarm.value)

    takeoff, disarm = fly(story, show_config(2))
    assert takeoff == "d1: takeoff while disarmed; arm it first"
    assert 'it says "Disarming denied: not landed"' in disarm


def test_item_12_a_boot_clock_that_jumps_changes_nothing_in_flight() -> None:
    async def story(show: Show) -> tuple[list[Phase], float, int]:
        await show.start()
        await show.wait(3.0)
        jumped_s = show.now_s
        show.befall("d2", "clock-jump", by_s=-10.0)
        await show.wait(5.0)
        after = show.track.between(jumped_s)
        return after.phases("d2"), after.setpoints_per_s("d2"), show.floor_violations()

    phases, per_s, violations = fly(story, show_config(3))
    assert phases == [Phase.FORMATION]
    assert per_s == pytest.approx(20.0, abs=0.3)
    assert violations == 0


def test_item_13_a_gap_of_less_than_half_a_second_is_no_loss() -> None:
    async def story(show: Show) -> list[Phase]:
        await show.start()
        gap_s = show.now_s
        show.link.silence("d2", down=False)
        await show.wait(0.4)
        show.link.restore("d2")
        await show.wait(3.0)
        return show.track.between(gap_s).phases("d2")

    assert fly(story, show_config(2)) == [Phase.FORMATION]


def test_a_start_too_early_says_that_the_autopilot_is_not_ready_item_2() -> None:
    async def story(show: Show) -> Refusal:
        await show.until(lambda: all(seen.phase is Phase.STANDBY for seen in show.view.vehicles))
        return await refused(show, lambda: show.service.command_show(ShowAction.START))

    assert "does not yet pass its own arming checks" in fly(story, show_config(2)).text
