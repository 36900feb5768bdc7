"""PX4 as it is: what docs/FACTS.md, section 3, says of it, item by item, against the service.

Items that other tests show are listed with them in docs/px4.md.
"""

import pytest

from gcs.links import Command, Verb
from gcs.model.errors import CommandError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import ShowAction, VehicleAction
from gcs.sim.vehicle.px4 import Quirks
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, RefusedCall, VirtualShow, fly, refused, show_config
from tests.support.show_phases import running


def test_item_3_acknowledgement_needs_a_matching_heartbeat() -> None:
    """The first of PX4's two acks says ACCEPTED whatever happens; here the mode then does not change."""

    async def story(show: VirtualShow) -> str:
        show.befall("d1", "stuck-mode", answer="accepted")
        record = await show.command("d1", VehicleAction.HOLD)
        return record.outcomes["d1"].reason

    assert "d1: hold sent, but not seen to happen: it reports offboard, armed" in fly(
        story, show_config(2), after=running
    )


@pytest.mark.soak
def test_item_4_offboard_not_commanded_without_setpoints() -> None:
    async def story(show: VirtualShow) -> str:
        await show.standby()
        with pytest.raises(CommandError) as refusal:
            await show.link.execute(Command("d1", Verb.OFFBOARD))
        return str(refusal.value)

    assert fly(story, show_config(2)) == "d1: offboard refused: no setpoints are flowing to it"


@pytest.mark.soak
def test_item_6_failsafe_vehicle_flies_on_only_through_hold() -> None:
    """Setpoints that resumed would take it back to OFFBOARD unseen: it gets none before it holds on command.

    Until decision 0024 it waited for an operator; where its link alone had lost setpoints nothing speaks
    against flying it on.
    """

    async def story(show: VirtualShow) -> tuple[list[Phase], int, list[Verb]]:
        show.ports.silence("d2", down=False)  # it receives nothing, and its reports still arrive
        await show.phase("d2", Phase.PILOT)
        began_s = show.now_s
        show.ports.restore("d2")
        await show.phase("d2", Phase.FORMATION)
        await show.wait(0.2)
        track = show.track.between(began_s)
        sent = sum(began_s < each.time_s < track.since("d2", Phase.HOLD) for each in show.ports.sent["d2"])
        verbs = [command.verb for command in show.ports.commands["d2"] if command.time_s > began_s]
        return track.phases("d2"), sent, verbs

    phases, sent, verbs = fly(story, show_config(3, operation=HOLDS_WHEN_LOST), after=running)
    assert phases == [Phase.PILOT, Phase.HOLD, Phase.FORMATION]
    assert sent == 0
    assert verbs[-2:] == [Verb.HOLD, Verb.OFFBOARD]


@pytest.mark.soak
def test_item_7_show_restarts_after_landing_from_offboard() -> None:
    async def story(show: VirtualShow) -> ShowPhase:
        await show.start()
        await show.show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED)
        await show.standby()
        await show.wait(1.0)
        show.service.commands.command_show(ShowAction.START)
        await show.reach(ShowPhase.RUNNING)
        return show.view.show

    assert fly(story, show_config(2), spacing_m=8.0) is ShowPhase.RUNNING


@pytest.mark.soak
def test_item_11_no_takeoff_disarmed_no_disarming_airborne() -> None:
    async def story(show: VirtualShow) -> tuple[str, str]:
        await show.standby()
        with pytest.raises(CommandError) as takeoff:
            await show.link.execute(Command("d1", Verb.TAKEOFF, 5.0))
        await show.start()
        with pytest.raises(CommandError) as disarm:
            await show.link.execute(Command("d1", Verb.DISARM))
        return str(takeoff.value), str(disarm.value)

    takeoff, disarm = fly(story, show_config(2))
    assert takeoff == "d1: takeoff while disarmed; arm it first"
    assert 'it reports "Disarming denied: not landed"' in disarm


@pytest.mark.soak
def test_item_12_boot_clock_jump_changes_nothing_in_flight() -> None:
    async def story(show: VirtualShow) -> tuple[list[Phase], float, int]:
        await show.wait(3.0)
        jumped_s = show.now_s
        show.befall("d2", "clock-jump", by_s=-10.0)
        await show.wait(5.0)
        after = show.track.between(jumped_s)
        return after.phases("d2"), after.setpoints_per_s("d2"), show.floor_violations()

    phases, per_s, violations = fly(story, show_config(3), after=running)
    assert phases == [Phase.FORMATION]
    assert per_s == pytest.approx(20.0, abs=0.3)
    assert violations == 0


@pytest.mark.soak
def test_item_13_a_gap_of_less_than_half_a_second_is_no_loss() -> None:
    async def story(show: VirtualShow) -> list[Phase]:
        gap_s = show.now_s
        show.ports.silence("d2", down=False)
        await show.wait(0.4)
        show.ports.restore("d2")
        await show.wait(3.0)
        return show.track.between(gap_s).phases("d2")

    assert fly(story, show_config(2), after=running) == [Phase.FORMATION]


@pytest.mark.soak
def test_item_2_early_start_says_the_autopilot_is_not_ready() -> None:
    async def story(show: VirtualShow) -> RefusedCall:
        await show.until(lambda: all(seen.phase is Phase.STANDBY for seen in vehicles_of(show.view)))
        return await refused(show, lambda: show.service.commands.command_show(ShowAction.START))

    assert "does not yet pass its own arming checks" in fly(story, show_config(2), quirks=Quirks()).text
