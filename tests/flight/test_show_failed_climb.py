"""A take-off that fails in the air: that vehicle comes down, and no other waits for it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from gcs.links import Verb
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Mode, VehicleId
from gcs.service import CommandRecord, Outcome, ShowAction, VehicleAction
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import FlownTrack, VirtualShow, fly, show_config

TIMEOUT_S = 8.0


class Failed(NamedTuple):
    track: FlownTrack
    record: CommandRecord
    reason: str  # of the vehicle, while it comes down
    setpoints: int  # that were sent to it
    violations: int


def hangs(show: VirtualShow) -> None:
    """It ends its climb a metre above its pad, and stays there."""
    show.fleet.state.target_m[1, 2] += 4.0


def refuses_to_hold(show: VirtualShow) -> None:
    """It climbs past its height, and refuses to stop there."""
    show.fleet.state.target_m[1, 2] -= 4.0
    show.ports.refused.add(("d2", Verb.HOLD))


def refuses_to_climb(show: VirtualShow) -> None:
    """Its motors run, on the ground."""
    show.ports.refused.add(("d2", Verb.TAKEOFF))


async def climbing(show: VirtualShow, vehicle_id: VehicleId) -> None:
    """Wait until its autopilot has begun to climb."""
    await show.until(lambda: show.vehicle(vehicle_id).mode is Mode.TAKEOFF)


async def with_failure(show: VirtualShow, fault: Callable[[VirtualShow], Any], *, in_the_air: bool) -> Failed:
    """d2 suffers `fault` before its turn, or while it climbs; the other two fly."""
    await show.standby()
    record = show.service.commands.command_show(ShowAction.START)
    if in_the_air:
        await climbing(show, "d2")
    fault(show)
    await show.phase("d2", Phase.LANDING)
    reason = show.vehicle("d2").reason
    await show.reach(ShowPhase.RUNNING)
    record = await show.settled(record)
    return Failed(show.track, record, reason, len(show.ports.sent["d2"]), show.floor_violations())


@pytest.mark.keeps("hangs-True-d2 did not reach 5 m within 8 s")
@pytest.mark.parametrize(
    ("fault", "in_the_air", "says"),
    [
        (hangs, True, "d2 did not reach 5 m within 8 s"),
        (refuses_to_hold, True, "d2: hold failed (COMMAND_DENIED)"),
        (refuses_to_climb, False, "d2: takeoff failed (COMMAND_DENIED)"),
    ],
)
def test_failed_climb_lands_on_its_pad_and_the_others_fly(
    fault: Callable[[VirtualShow], Any], in_the_air: bool, says: str
) -> None:
    config = show_config(3, operation={"takeoff_timeout_s": TIMEOUT_S})
    failed = fly(lambda show: with_failure(show, fault, in_the_air=in_the_air), config)
    track, outcomes = failed.track, failed.record.outcomes
    assert {outcomes[name].outcome for name in ("d1", "d3")} == {Outcome.DONE}
    assert outcomes["d2"].outcome is Outcome.FAILED
    assert says in outcomes["d2"].reason
    assert failed.reason.startswith("its take-off failed, its autopilot lands it: ")
    assert says in failed.reason
    assert track.phases("d2")[-2:] == [Phase.LANDING, Phase.STANDBY]
    assert not track.samples[-1].armed[1]
    assert np.linalg.norm(track.true_m[-1, 1] - track.true_m[0, 1]) < 1.0, "on its own pad"
    assert failed.setpoints == 0
    assert failed.violations == 0


async def stuck_in_the_air(show: VirtualShow) -> tuple[list[Phase], str, bool]:
    """d2 hangs a metre above its pad, and refuses even to land."""
    await show.standby()
    show.service.commands.command_show(ShowAction.START)
    await climbing(show, "d2")
    hangs(show)
    show.ports.refused.add(("d2", Verb.LAND))
    await show.reach(ShowPhase.RUNNING)
    reason = show.vehicle("d2").reason
    phases = [vehicle.phase for vehicle in vehicles_of(show.view)]
    show.ports.refused.clear()
    await show.phase("d2", Phase.STANDBY)
    return phases, reason, show.view.show is ShowPhase.RUNNING


@pytest.mark.soak
def test_vehicle_that_refuses_landing_delays_no_other() -> None:
    config = show_config(3, operation={"takeoff_timeout_s": TIMEOUT_S})
    phases, reason, still_running = fly(stuck_in_the_air, config)
    assert phases == [Phase.FORMATION, Phase.LANDING, Phase.FORMATION]
    assert "did not reach 5 m" in reason
    assert still_running


async def hold_refused_by_one_that_climbs(show: VirtualShow) -> tuple[Outcome, Phase]:
    """An operator's order to hold ends what d2 was led through, and is refused."""
    await show.standby()
    show.service.commands.command_show(ShowAction.START)
    await climbing(show, "d2")
    show.ports.refused.add(("d2", Verb.HOLD))
    held = await show.command("d2", VehicleAction.HOLD)
    await show.reach(ShowPhase.RUNNING)
    return held.outcome, show.vehicle("d1").phase


@pytest.mark.soak
def test_climb_without_a_maneuver_delays_no_other() -> None:
    assert fly(hold_refused_by_one_that_climbs, show_config(3)) == (Outcome.FAILED, Phase.FORMATION)


async def one_alone(show: VirtualShow) -> tuple[list[ShowPhase], CommandRecord]:
    await show.standby()
    record = show.service.commands.command_show(ShowAction.START)
    await climbing(show, "d1")
    show.ports.refused.add(("d1", Verb.HOLD))
    await show.reach(ShowPhase.LANDED)
    await show.wait(0.1)
    return show.track.show_phases(), await show.settled(record)


@pytest.mark.soak
def test_show_ends_when_its_only_vehicle_fails_to_climb() -> None:
    phases, record = fly(one_alone, show_config(1), ideal=True)  # else it may hold by itself, and join
    assert phases == [ShowPhase.IDLE, ShowPhase.ARMING, ShowPhase.LANDED]
    assert record.outcome is Outcome.FAILED


class NoneJoined(NamedTuple):
    shows: list[ShowPhase]
    reason: str
    armed: tuple[bool, ...]


async def none_can_join(show: VirtualShow) -> NoneJoined:
    """All are up, and every autopilot refuses OFFBOARD; then all are ordered home."""
    await show.standby()
    show.service.commands.command_show(ShowAction.START)
    show.ports.refused |= {(name, Verb.OFFBOARD) for name in show.config.ids}
    await show.reach(ShowPhase.PAUSED)
    reason = show.view.reason
    await show.settled(show.service.commands.command_show(ShowAction.STOP))
    await show.reach(ShowPhase.LANDED)
    return NoneJoined(show.track.show_phases(), reason, show.track.samples[-1].armed)


@pytest.mark.soak
def test_show_that_no_vehicle_can_join_pauses_with_its_reason() -> None:
    flight = fly(none_can_join, show_config(2))
    assert flight.shows[-4:] == [ShowPhase.ARMING, ShowPhase.PAUSED, ShowPhase.RETURNING, ShowPhase.LANDED]
    assert flight.reason.startswith("no vehicle in formation; waiting for commands: d1 (up, but cannot join:")
    assert "d2: offboard failed (COMMAND_DENIED)" in flight.reason
    assert flight.armed == (False, False)
