"""Vehicles that fall silent in the air, while the others fly on, and what becomes of them."""

from typing import NamedTuple

import numpy as np
import pytest

from gcs.links import Verb
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Target
from gcs.model.state import Mode
from gcs.service import CommandRecord, Outcome, ShowAction, VehicleAction
from gcs.testing.virtual_show import (
    FLEET_STEP_S,
    HOLDS_WHEN_LOST,
    JUMP_M_S,
    SLOWLY_DISARMED,
    FlownTrack,
    RefusedCall,
    VirtualShow,
    fly,
    refused,
    show_config,
)
from tests.support.show_phases import running

OTHERS = ("d1", "d3", "d4")


class Silence(NamedTuple):
    track: FlownTrack
    silent_s: float
    position_s: float  # of the last that arrived
    lost_s: float
    received_s: float
    last_sent_s: float  # the last setpoint before it was received again
    sent_before_hold: int
    verbs: list[Verb]  # ordered since
    holding: FlownTrack  # from then until it holds
    back: FlownTrack  # from the moment it is received again
    joins: list[CommandRecord]  # that anybody gave
    refusals: dict[str, RefusedCall]
    floor_violations: int


async def silent_for_a_while(show: VirtualShow) -> Silence:
    """All is cut, both ways; the vehicle's own failsafe holds it where it is."""
    await show.wait(8.0)
    silent_s = show.now_s
    show.ports.silence("d2")
    await show.phase("d2", Phase.LOST)
    position_s = float(show.service.flight.newest.telemetry.position_time_s[1])
    lost_s, last_sent_s = show.now_s, show.ports.sent["d2"][-1].time_s
    await show.wait(12.0)
    refusals = {
        "join": await refused(show, lambda: show.service.commands.command_vehicle("d2", VehicleAction.JOIN)),
        "land": await refused(show, lambda: show.service.commands.command_vehicle("d2", VehicleAction.LAND)),
    }
    assert show.ports.sent["d2"][-1].time_s == last_sent_s
    received_s = show.now_s
    show.ports.restore("d2")
    await show.phase("d2", Phase.HOLD)
    await show.wait(0.0)  # this tick is in the track as well
    holds_s = show.track.between(received_s).since("d2", Phase.HOLD)
    sent_before_hold = sum(received_s < setpoint.time_s < holds_s for setpoint in show.ports.sent["d2"])
    holding = show.track.between(received_s)
    await show.phase("d2", Phase.FORMATION, 10.0)
    verbs = [command.verb for command in show.ports.commands["d2"] if command.time_s > received_s]
    joins = [command for command in show.service.command_log.newest() if command.action == "join"]
    await show.wait(6.0)
    return Silence(
        show.track,
        silent_s,
        position_s,
        lost_s,
        received_s,
        last_sent_s,
        sent_before_hold,
        verbs,
        holding,
        show.track.between(received_s),
        joins,
        refusals,
        show.floor_violations(),
    )


@pytest.fixture(scope="module")
def silence() -> Silence:
    return fly(
        silent_for_a_while, show_config(4, operation=HOLDS_WHEN_LOST), after=running, step_s=FLEET_STEP_S
    )


def test_a_vehicle_silent_in_the_air_is_lost_within_the_limit(silence: Silence) -> None:
    assert silence.lost_s - silence.silent_s < 2.1
    reasons = [view.reason for view in silence.track.between(silence.lost_s, silence.received_s).of("d2")]
    assert reasons[0].startswith("no telemetry for 2")
    assert reasons[-1] == "no telemetry for 14 s", "it counts on"


def test_stale_telemetry_stops_setpoints_long_before_loss(silence: Silence) -> None:
    assert 0.4 < silence.last_sent_s - silence.position_s < 0.6


def test_other_setpoints_keep_their_rate_while_one_is_silent(silence: Silence) -> None:
    for name in OTHERS:
        rate_per_s = silence.track.between(silence.silent_s, silence.received_s).setpoints_per_s(name)
        assert rate_per_s == pytest.approx(20.0, abs=0.2)


def test_the_others_re_form_without_the_lost_one(silence: Silence) -> None:
    before_m = silence.track.between(silence.silent_s - 0.5, silence.silent_s).true_m[-1]
    after_m = silence.track.between(silence.received_s - 0.5, silence.received_s).true_m[-1]
    rows = [silence.track.ids.index(name) for name in OTHERS]
    assert nearest(after_m[rows]) > nearest(before_m[rows]) + 0.3  # a triangle is wider than a tetrahedron


def nearest(places_m: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """The smallest distance between three."""
    return float(np.linalg.norm(places_m - np.roll(places_m, 1, axis=0), axis=1).min())


def test_lost_vehicle_volume_is_avoided(silence: Silence) -> None:
    assert silence.floor_violations == 0


def test_lost_vehicle_returns_through_hold_and_is_sent_nothing(
    silence: Silence,
) -> None:
    assert silence.back.phases("d2") == [Phase.LOST, Phase.HOLD, Phase.FORMATION]
    assert silence.sent_before_hold == 0
    assert silence.verbs == [Verb.HOLD, Verb.OFFBOARD]
    assert {seen.mode for seen in silence.holding.of("d2") if seen.phase is Phase.HOLD} == {Mode.HOLD}


def test_after_hold_it_rejoins_by_itself(silence: Silence) -> None:
    assert silence.joins == []
    assert silence.back.hardest_change_m_s() < JUMP_M_S


def test_commands_to_a_lost_vehicle_are_refused_with_choices(silence: Silence) -> None:
    assert silence.refusals["join"].kind is RefusedError
    assert "d2: 'engage' is not possible while lost; it is from hold" in silence.refusals["join"].text
    assert "not possible while lost" in silence.refusals["land"].text


class Crossing(NamedTuple):
    column_m: list[float]  # from the lost one's column, while lower than it
    past_m: float  # how far the other has got beyond it


async def across_a_lost_one(show: VirtualShow) -> Crossing:
    """Of two the upper is lost; then the target moves so that the lower one has to go below it."""
    await show.start()
    await show.wait(6.0)
    lost, other = np.argsort(show.true_m[:, 2]).tolist()
    name = show.config.ids[lost]
    show.ports.silence(name)
    await show.phase(name, Phase.LOST)
    began_s, at_m = show.now_s, show.true_m[lost].copy()
    way_m = 2.0 * (at_m - show.true_m[other])
    x_m, y_m = show.view.target_m
    show.service.plan.set_target(Target(x_m + float(way_m[0]), y_m + float(way_m[1])))
    await show.wait(20.0)
    track = show.track.between(began_s)
    beside_m = np.hypot(*(track.true_m[:, other, :2] - at_m[:2]).T)
    lower = track.true_m[:, other, 2] > at_m[2]
    ahead = way_m[:2] / np.hypot(*way_m[:2])
    return Crossing(
        beside_m[lower].tolist(),
        float((show.true_m[other, :2] - at_m[:2]) @ ahead),
    )


@pytest.mark.soak
def test_no_vehicle_flies_below_a_lost_one() -> None:
    crossing = fly(across_a_lost_one, show_config(2, operation=HOLDS_WHEN_LOST))
    assert len(crossing.column_m) > 50
    assert min(crossing.column_m) > 2.0
    assert crossing.past_m > 2.0


async def without_a_heartbeat(show: VirtualShow) -> tuple[float, set[Phase], float]:
    """One heartbeat is lost, and a few positions with it."""
    await show.start()
    began_s = show.now_s
    await show.until(lambda: 0.9 < (show.vehicle("d2").heartbeat_age_s or 0.0) < 0.98)
    show.ports.silence("d2", up=False)
    await show.wait(0.2)
    show.ports.restore("d2")
    await show.wait(1.5)
    seen = show.track.between(began_s).of("d2")
    oldest_s = max(view.heartbeat_age_s or 0.0 for view in seen)
    return oldest_s, {view.phase for view in seen}, show.track.between(began_s).setpoints_per_s("d2")


@pytest.mark.soak
def test_one_lost_heartbeat_changes_nothing() -> None:
    silence_s = 1.5  # a beat comes every second
    config = show_config(2, operation={"silence_s": silence_s})
    oldest_s, phases, setpoints_per_s = fly(without_a_heartbeat, config)
    assert oldest_s > silence_s
    assert phases == {Phase.FORMATION}
    assert setpoints_per_s == pytest.approx(20.0, abs=0.5)


async def lost_on_its_way_home(show: VirtualShow, action: ShowAction) -> tuple[list[Phase], int]:
    """Every vehicle is commanded home or down; one is silent for so long that its own failsafe holds it."""
    record = show.service.commands.command_show(action)
    on_its_way = Phase.RETURN if action is ShowAction.STOP else Phase.LANDING
    await show.phase("d2", on_its_way)
    show.ports.silence("d2")
    await show.phase("d2", Phase.LOST)
    await show.wait(2.0)
    show.ports.restore("d2")
    await show.settled(record)
    await show.phase("d2", Phase.STANDBY, 90.0)
    await show.reach(ShowPhase.LANDED)
    await show.wait(0.1)
    return show.track.phases("d2"), show.floor_violations()


@pytest.mark.soak
@pytest.mark.parametrize(
    ("action", "on_its_way"), [(ShowAction.STOP, Phase.RETURN), (ShowAction.ABORT, Phase.LANDING)]
)
def test_vehicle_lost_during_landing_is_landed_once_it_is_back(action: ShowAction, on_its_way: Phase) -> None:
    config = show_config(4, operation=HOLDS_WHEN_LOST)
    phases, violations = fly(lambda show: lost_on_its_way_home(show, action), config, after=running)
    after = phases[phases.index(Phase.LOST) :]
    assert after[:3] == [Phase.LOST, Phase.HOLD, on_its_way]
    assert after[-2:] == [Phase.LANDING, Phase.STANDBY]
    assert violations == 0


async def back_when_all_others_are_down(
    show: VirtualShow, action: ShowAction
) -> tuple[FlownTrack, list[Verb], int, float]:
    """One is lost; the others are brought down, and the show is over; then it is received again."""
    show.ports.silence("d2")
    await show.phase("d2", Phase.LOST)
    await show.settled(show.service.commands.command_show(action), 120.0)
    await show.reach(ShowPhase.LANDED)
    assert "not confirmed on the ground: d2" in show.view.reason
    await show.wait(5.0)
    back_s = show.now_s
    show.ports.restore("d2")
    await show.phase("d2", Phase.STANDBY, 120.0)
    await show.reach(ShowPhase.LANDED)
    verbs = [command.verb for command in show.ports.commands["d2"] if command.time_s > back_s]
    off_pad_m = float(np.hypot(*(show.track.true_m[-1] - show.track.true_m[0])[1, :2]))
    return show.track.between(back_s), verbs, show.floor_violations(), off_pad_m


@pytest.mark.soak
@pytest.mark.parametrize(
    ("action", "ends", "flown"),
    [
        (ShowAction.STOP, ShowPhase.RETURNING, Phase.RETURN),
        (ShowAction.ABORT, ShowPhase.ABORTING, Phase.LANDING),
    ],
)
def test_landing_command_stands_for_a_lost_vehicle(action: ShowAction, ends: ShowPhase, flown: Phase) -> None:
    """A lost vehicle is landed although it is received again after all others are down."""
    config = show_config(3, operation=HOLDS_WHEN_LOST)
    after, verbs, violations, off_pad_m = fly(
        lambda show: back_when_all_others_are_down(show, action),
        config,
        after=running,
        parameters=SLOWLY_DISARMED,
    )
    assert after.show_phases() == [ShowPhase.LANDED, ends, ShowPhase.LANDED]
    assert after.phases("d2")[:3] == [Phase.LOST, Phase.HOLD, flown]
    assert verbs[:3] == [Verb.HOLD, Verb.OFFBOARD, Verb.LAND]
    assert violations == 0
    if action is ShowAction.STOP:
        assert off_pad_m < 1.5


async def back_after_each_was_landed(show: VirtualShow) -> tuple[ShowPhase, str, Phase]:
    """No operator ended the show: the others were landed one by one while d2 was lost."""
    show.ports.silence("d2")
    await show.phase("d2", Phase.LOST)
    for name in ("d1", "d3"):
        await show.command(name, VehicleAction.LAND)
    await show.reach(ShowPhase.LANDED)
    show.ports.restore("d2")
    await show.phase("d2", Phase.HOLD)
    await show.wait(10.0)
    return show.view.show, show.view.reason, show.vehicle("d2").phase


@pytest.mark.soak
def test_lost_vehicle_back_without_command_holds_show_paused() -> None:
    show, reason, phase = fly(
        back_after_each_was_landed, show_config(3, operation=HOLDS_WHEN_LOST), after=running
    )
    assert (show, phase) == (ShowPhase.PAUSED, Phase.HOLD)
    assert "d2" in reason


async def confirmed_down_while_silent(show: VirtualShow) -> tuple[list[Phase], CommandRecord]:
    show.ports.silence("d2")
    await show.phase("d2", Phase.LOST)
    began_s = show.now_s
    await show.until(lambda: not show.autopilot("d2").commander.armed)  # by its own failsafe it has landed
    confirmed = await show.command("d2", VehicleAction.CONFIRM_DOWN)
    show.ports.restore("d2")
    await show.phase("d2", Phase.STANDBY)
    await show.wait(0.1)
    return show.track.between(began_s).phases("d2"), confirmed


@pytest.mark.soak
def test_lost_vehicle_confirmed_down_is_offline_until_seen() -> None:
    phases, confirmed = fly(confirmed_down_while_silent, after=running)
    assert phases == [Phase.LOST, Phase.OFFLINE, Phase.STANDBY]
    assert confirmed.outcome is Outcome.DONE
