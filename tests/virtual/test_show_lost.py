"""Vehicles that fall silent, are taken over, fail safe or are killed, while the others fly on."""

from typing import NamedTuple

import numpy as np
import pytest
from virtual_show import HOLDS_WHEN_LOST, JUMP_M_S, Refusal, Show, Track, fly, refused, show_config

from gcs.errors import RefusedError
from gcs.lifecycle import Phase, ShowPhase
from gcs.links import Verb
from gcs.plan import Target
from gcs.service import OrderRecord, Outcome, ShowAction, VehicleAction
from gcs.state import Mode, VehicleId
from sim.modes import Mode as PilotMode

pytestmark = pytest.mark.xdist_group("show-lost")

OTHERS = ("d1", "d3", "d4")


class Silence(NamedTuple):
    track: Track
    silent_s: float
    lost_s: float
    heard_s: float
    last_sent_s: float  # the last setpoint before it was heard again
    sent_when_holding: int
    verbs_before_join: list[Verb]  # ordered since
    holding: Track  # from then until it is ordered to join
    back: Track  # from the moment it is heard again
    joined: OrderRecord
    refusals: dict[str, Refusal]
    floor_violations: int


async def silent_for_a_while(show: Show) -> Silence:
    """All is cut, both ways; the vehicle's own failsafe holds it where it is."""
    await show.start()
    await show.wait(8.0)
    silent_s = show.now_s
    show.link.silence("d2")
    await show.phase("d2", Phase.LOST)
    lost_s, last_sent_s = show.now_s, show.link.sent["d2"][-1].time_s
    await show.wait(12.0)
    refusals = {
        "join": await refused(show, lambda: show.service.command_vehicle("d2", VehicleAction.JOIN)),
        "land": await refused(show, lambda: show.service.command_vehicle("d2", VehicleAction.LAND)),
    }
    assert show.link.sent["d2"][-1].time_s == last_sent_s
    heard_s = show.now_s
    show.link.restore("d2")
    await show.phase("d2", Phase.HOLD)
    await show.wait(3.0)
    sent_when_holding = sum(setpoint.time_s > heard_s for setpoint in show.link.sent["d2"])
    verbs = [order.verb for order in show.link.orders["d2"] if order.time_s > heard_s]
    holding = show.track.between(heard_s)
    joined = await show.order("d2", VehicleAction.JOIN)
    await show.wait(6.0)
    return Silence(
        show.track,
        silent_s,
        lost_s,
        heard_s,
        last_sent_s,
        sent_when_holding,
        verbs,
        holding,
        show.track.between(heard_s),
        joined,
        refusals,
        show.floor_violations(),
    )


@pytest.fixture(scope="module")
def silence() -> Silence:
    return fly(silent_for_a_while, show_config(4, operation=HOLDS_WHEN_LOST))


def test_a_vehicle_silent_in_the_air_is_lost_within_the_limit(silence: Silence) -> None:
    assert silence.lost_s - silence.silent_s < 2.1
    assert "silent for 2" in silence.track.between(silence.lost_s, silence.heard_s).of("d2")[-1].reason


def test_a_vehicle_without_fresh_telemetry_gets_no_setpoint_long_before_it_is_lost(silence: Silence) -> None:
    assert 0.4 < silence.last_sent_s - silence.silent_s < 0.6


def test_the_others_setpoints_keep_their_rate_while_one_is_silent(silence: Silence) -> None:
    for name in OTHERS:
        rate_per_s = silence.track.between(silence.silent_s, silence.heard_s).setpoints_per_s(name)
        assert rate_per_s == pytest.approx(20.0, abs=0.2)


def test_the_others_re_form_without_the_lost_one(silence: Silence) -> None:
    before_m = silence.track.between(silence.silent_s - 0.5, silence.silent_s).true_m[-1]
    after_m = silence.track.between(silence.heard_s - 0.5, silence.heard_s).true_m[-1]
    rows = [silence.track.ids.index(name) for name in OTHERS]
    assert nearest(after_m[rows]) > nearest(before_m[rows]) + 0.3  # a triangle is wider than a tetrahedron


def nearest(places_m: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """The smallest distance between three."""
    return float(np.linalg.norm(places_m - np.roll(places_m, 1, axis=0), axis=1).min())


def test_nobody_flies_into_the_volume_of_a_lost_vehicle(silence: Silence) -> None:
    assert silence.floor_violations == 0


def test_a_lost_vehicle_heard_again_comes_back_through_hold_and_is_sent_nothing_there(
    silence: Silence,
) -> None:
    assert silence.back.phases("d2") == [Phase.LOST, Phase.HOLD, Phase.FORMATION]
    assert silence.sent_when_holding == 0
    assert silence.verbs_before_join == [Verb.HOLD]
    assert {seen.mode for seen in silence.holding.of("d2") if seen.phase is Phase.HOLD} == {Mode.HOLD}


def test_after_hold_it_joins_again_on_order(silence: Silence) -> None:
    assert silence.joined.outcome is Outcome.DONE
    assert silence.back.hardest_change_m_s() < JUMP_M_S


def test_orders_to_a_lost_vehicle_are_refused_naming_what_is_possible(silence: Silence) -> None:
    assert silence.refusals["join"].kind is RefusedError
    assert "d2: 'engage' is not possible while lost; it is from hold" in silence.refusals["join"].text
    assert "not possible while lost" in silence.refusals["land"].text


class Crossing(NamedTuple):
    column_m: list[float]  # from the lost one's column, while lower than it
    past_m: float  # how far the other has got beyond it
    reasons: set[str]


async def across_a_lost_one(show: Show) -> Crossing:
    """Of two the upper is lost; then the target moves so that the lower one has to go below it."""
    await show.start()
    await show.wait(6.0)
    lost, other = np.argsort(show.true_m[:, 2]).tolist()
    name = show.config.ids[lost]
    show.link.silence(name)
    await show.phase(name, Phase.LOST)
    began_s, at_m = show.now_s, show.true_m[lost].copy()
    way_m = 2.0 * (at_m - show.true_m[other])
    x_m, y_m = show.view.target_m
    show.service.set_target(Target(x_m + float(way_m[0]), y_m + float(way_m[1])))
    await show.wait(20.0)
    track = show.track.between(began_s)
    beside_m = np.hypot(*(track.true_m[:, other, :2] - at_m[:2]).T)
    lower = track.true_m[:, other, 2] > at_m[2]
    ahead = way_m[:2] / np.hypot(*way_m[:2])
    return Crossing(
        beside_m[lower].tolist(),
        float((show.true_m[other, :2] - at_m[:2]) @ ahead),
        {seen.restrained_by for seen in track.of(show.config.ids[other])},
    )


def test_nobody_flies_below_a_lost_vehicle_that_may_come_down() -> None:
    crossing = fly(across_a_lost_one, show_config(2, operation=HOLDS_WHEN_LOST), noise_scale=0.3)
    assert len(crossing.column_m) > 50
    assert min(crossing.column_m) > 2.0
    assert "the path of a lost vehicle" in crossing.reasons
    assert crossing.past_m > 2.0


async def without_a_heartbeat(show: Show) -> tuple[float, set[Phase], float]:
    """One heartbeat is lost, and a few positions with it."""
    await show.start()
    began_s = show.now_s
    await show.until(lambda: 0.9 < (show.vehicle("d2").heartbeat_age_s or 0.0) < 0.98)
    show.link.silence("d2", up=False)
    await show.wait(0.2)
    show.link.restore("d2")
    await show.wait(1.5)
    seen = show.track.between(began_s).of("d2")
    oldest_s = max(view.heartbeat_age_s or 0.0 for view in seen)
    return oldest_s, {view.phase for view in seen}, show.track.between(began_s).setpoints_per_s("d2")


def test_one_lost_heartbeat_changes_nothing() -> None:
    silence_s = 1.5  # a beat comes every second
    config = show_config(2, operation={"silence_s": silence_s})
    oldest_s, phases, setpoints_per_s = fly(without_a_heartbeat, config)
    assert oldest_s > silence_s
    assert phases == {Phase.FORMATION}
    assert setpoints_per_s == pytest.approx(20.0, abs=0.5)


async def lost_on_its_way_home(show: Show, action: ShowAction) -> tuple[list[Phase], int]:
    """Everybody is ordered home or down; one is silent for so long that its own failsafe holds it."""
    await show.start()
    record = show.service.command_show(action)
    on_its_way = Phase.RETURN if action is ShowAction.STOP else Phase.LANDING
    await show.phase("d2", on_its_way)
    show.link.silence("d2")
    await show.phase("d2", Phase.LOST)
    await show.wait(2.0)
    show.link.restore("d2")
    await show.settled(record)
    await show.phase("d2", Phase.STANDBY, 90.0)
    await show.reach(ShowPhase.LANDED)
    return show.track.phases("d2"), show.floor_violations()


@pytest.mark.parametrize(
    ("action", "on_its_way"), [(ShowAction.STOP, Phase.RETURN), (ShowAction.ABORT, Phase.LANDING)]
)
def test_a_vehicle_lost_while_all_come_down_is_brought_down_once_it_is_back(
    action: ShowAction, on_its_way: Phase
) -> None:
    config = show_config(4, operation=HOLDS_WHEN_LOST)
    phases, violations = fly(lambda show: lost_on_its_way_home(show, action), config)
    after = phases[phases.index(Phase.LOST) :]
    assert after[:3] == [Phase.LOST, Phase.HOLD, on_its_way]
    assert after[-2:] == [Phase.LANDING, Phase.STANDBY]
    assert violations == 0


async def back_when_all_others_are_down(show: Show, action: ShowAction) -> tuple[Show, float, list[Verb]]:
    """One is lost; the others are brought down, and the show is over; then it is heard again."""
    await show.start()
    show.link.silence("d2")
    await show.phase("d2", Phase.LOST)
    await show.settled(show.service.command_show(action), 120.0)
    await show.reach(ShowPhase.LANDED)
    assert "not ours to land: d2" in show.view.reason
    await show.wait(5.0)
    back_s = show.now_s
    show.link.restore("d2")
    await show.phase("d2", Phase.STANDBY, 120.0)
    await show.reach(ShowPhase.LANDED)
    return show, back_s, [order.verb for order in show.link.orders["d2"] if order.time_s > back_s]


@pytest.mark.parametrize(
    ("action", "ends", "flown"),
    [
        (ShowAction.STOP, ShowPhase.RETURNING, Phase.RETURN),
        (ShowAction.ABORT, ShowPhase.ABORTING, Phase.LANDING),
    ],
)
def test_the_order_to_come_down_stands_for_a_lost_vehicle_that_is_back_when_all_others_are_down(
    action: ShowAction, ends: ShowPhase, flown: Phase
) -> None:
    config = show_config(3, operation=HOLDS_WHEN_LOST)
    show, back_s, verbs = fly(lambda show: back_when_all_others_are_down(show, action), config)
    after = show.track.between(back_s)
    assert after.show_phases() == [ShowPhase.LANDED, ends, ShowPhase.LANDED]
    assert after.phases("d2")[:3] == [Phase.LOST, Phase.HOLD, flown]
    assert verbs[:3] == [Verb.HOLD, Verb.OFFBOARD, Verb.LAND]
    assert show.floor_violations() == 0
    if action is ShowAction.STOP:
        assert np.hypot(*(show.track.true_m[-1] - show.track.true_m[0])[1, :2]) < 1.5


async def back_after_each_was_landed(show: Show) -> tuple[ShowPhase, str, Phase]:
    """Nobody ordered the show to end: the others were landed one by one while d2 was lost."""
    await show.start()
    show.link.silence("d2")
    await show.phase("d2", Phase.LOST)
    for name in ("d1", "d3"):
        await show.order(name, VehicleAction.LAND)
    await show.reach(ShowPhase.LANDED)
    show.link.restore("d2")
    await show.phase("d2", Phase.HOLD)
    await show.wait(30.0)
    seen = show.view.show, show.view.reason, show.vehicle("d2").phase
    await show.show(ShowAction.STOP)
    await show.reach(ShowPhase.LANDED)
    return seen


def test_a_lost_vehicle_that_nobody_ordered_down_holds_until_ordered_and_the_show_is_paused() -> None:
    show, reason, phase = fly(back_after_each_was_landed, show_config(3, operation=HOLDS_WHEN_LOST))
    assert (show, phase) == (ShowPhase.PAUSED, Phase.HOLD)
    assert "d2" in reason


class TakenOver(NamedTuple):
    track: Track
    change_s: dict[VehicleId, float]
    pilot_s: dict[VehicleId, float]
    sent_to_pilots: dict[VehicleId, int]  # setpoints after the takeover was seen
    orders_to_pilots: dict[VehicleId, int]
    stopped: OrderRecord
    handed_back: OrderRecord
    after_hand_back: Track
    refusals: dict[str, Refusal]


async def taken_over(show: Show) -> TakenOver:
    """A person takes d3; d1 hears nothing any more and fails safe, while we still hear it."""
    await show.start()
    change_s: dict[VehicleId, float] = {"d3": show.now_s}
    pilot_s: dict[VehicleId, float] = {}
    show.link.pilot("d3", PilotMode.HOLD)
    await show.phase("d3", Phase.PILOT)
    pilot_s["d3"] = show.now_s
    change_s["d1"] = show.now_s
    show.link.silence("d1", down=False)
    await show.phase("d1", Phase.PILOT)
    pilot_s["d1"] = show.now_s
    show.link.restore("d1")
    orders_before = {name: len(show.link.orders[name]) for name in ("d1", "d3")}
    await show.wait(4.0)
    refusals = {
        name: await refused(show, lambda action=action: show.service.command_vehicle("d3", action))  # type: ignore[misc]
        for name, action in (("join", VehicleAction.JOIN), ("hold", VehicleAction.HOLD))
    }
    sent = {
        name: sum(setpoint.time_s > pilot_s[name] for setpoint in show.link.sent[name])
        for name in ("d1", "d3")
    }
    orders = {name: len(show.link.orders[name]) - orders_before[name] for name in ("d1", "d3")}
    back_s = show.now_s
    handed_back = await show.order("d3", VehicleAction.HAND_BACK)
    await show.wait(2.0)
    await show.order("d3", VehicleAction.JOIN)
    await show.wait(5.0)
    after = show.track.between(back_s)
    stopped = await show.show(ShowAction.STOP)
    await show.reach(ShowPhase.LANDED)
    return TakenOver(show.track, change_s, pilot_s, sent, orders, stopped, handed_back, after, refusals)


@pytest.fixture(scope="module")
def takeover() -> TakenOver:
    return fly(taken_over)


@pytest.mark.parametrize("name", ["d1", "d3"])
def test_a_mode_that_nobody_here_ordered_makes_the_vehicle_the_pilots(
    takeover: TakenOver, name: VehicleId
) -> None:
    waited_s = takeover.pilot_s[name] - takeover.change_s[name]
    assert waited_s < 2.3  # failing safe takes a second, and the next heartbeat another
    seen = takeover.track.between(takeover.pilot_s[name]).of(name)[0]
    assert seen.phase is Phase.PILOT
    assert "ordered by nobody here" in seen.reason


def test_the_autopilots_own_failsafe_counts_as_a_pilot(takeover: TakenOver) -> None:
    assert Mode.POSITION in {seen.mode for seen in takeover.track.of("d1") if seen.phase is Phase.PILOT}


@pytest.mark.parametrize("name", ["d1", "d3"])
def test_a_pilots_vehicle_gets_neither_setpoints_nor_orders(takeover: TakenOver, name: VehicleId) -> None:
    assert takeover.sent_to_pilots[name] == 0
    assert takeover.orders_to_pilots[name] == 0


def test_orders_to_a_pilots_vehicle_are_refused(takeover: TakenOver) -> None:
    for refusal in takeover.refusals.values():
        assert refusal.kind is RefusedError
        assert "d3: " in refusal.text
        assert "not possible while pilot" in refusal.text


def test_handed_back_it_holds_and_joins_on_order_without_a_jump(takeover: TakenOver) -> None:
    assert takeover.handed_back.outcome is Outcome.DONE
    assert takeover.after_hand_back.phases("d3") == [Phase.PILOT, Phase.HOLD, Phase.FORMATION]
    assert takeover.after_hand_back.hardest_change_m_s() < JUMP_M_S


def test_stop_leaves_a_pilots_vehicle_alone_and_the_show_ends_without_it(takeover: TakenOver) -> None:
    left_out = takeover.stopped.outcomes["d1"]
    assert (left_out.outcome, left_out.reason[:6]) == (Outcome.NOT_INCLUDED, "pilot:")
    assert takeover.stopped.outcome is Outcome.DONE


def test_a_vehicle_that_fails_safe_and_sinks_to_the_ground_is_on_standby_again(takeover: TakenOver) -> None:
    assert takeover.track.phases("d1")[-2:] == [Phase.PILOT, Phase.STANDBY]


async def taken_over_while_it_joins(show: Show) -> tuple[OrderRecord, set[Verb]]:
    """The pilot is heard of while setpoints flow already, and OFFBOARD is about to be ordered."""
    await show.start()
    await show.order("d1", VehicleAction.HOLD)
    await show.until(lambda: 0.9 < (show.vehicle("d1").heartbeat_age_s or 0.0) < 0.98)
    began_s = show.now_s
    show.link.pilot("d1", PilotMode.RETURN)
    joined = await show.order("d1", VehicleAction.JOIN)
    await show.wait(2.0)
    return joined, {order.verb for order in show.link.orders["d1"] if order.time_s > began_s}


def test_a_takeover_ends_what_the_vehicle_was_about_to_do() -> None:
    joined, verbs = fly(taken_over_while_it_joins, show_config(2))
    assert joined.outcome is Outcome.FAILED
    assert "d1 is pilot now: mode return was ordered by nobody here" in joined.outcomes["d1"].reason
    assert verbs == set()


class SilentPilot(NamedTuple):
    track: Track  # from the moment it is heard again
    sent: int  # setpoints and orders since the takeover
    hold_while_lost: Refusal
    reason: str
    handed_back: OrderRecord
    after_hand_back: list[Phase]


async def silent_while_a_pilot_has_it(show: Show, action: ShowAction | None) -> SilentPilot:
    """A person takes d2, it falls silent, is lost, and is heard again in HOLD, where its pilot left it."""
    await show.start()
    show.link.pilot("d2", PilotMode.HOLD)
    await show.phase("d2", Phase.PILOT)
    taken_s = show.now_s
    show.link.silence("d2")
    await show.phase("d2", Phase.LOST)
    if action is not None:
        show.service.command_show(action)
    hold = await refused(show, lambda: show.service.command_vehicle("d2", VehicleAction.HOLD))
    await show.wait(2.0)
    back_s = show.now_s
    show.link.restore("d2")
    await show.phase("d2", Phase.PILOT, 5.0)
    reason = show.vehicle("d2").reason
    await show.wait(30.0)
    track = show.track.between(back_s)
    sent = sum(setpoint.time_s > taken_s for setpoint in show.link.sent["d2"])
    sent += sum(order.time_s > taken_s for order in show.link.orders["d2"])
    given_s = show.now_s
    handed_back = await show.order("d2", VehicleAction.HAND_BACK)
    await show.wait(5.0)
    return SilentPilot(track, sent, hold, reason, handed_back, show.track.between(given_s).phases("d2"))


@pytest.mark.parametrize("action", [None, ShowAction.PAUSE, ShowAction.STOP, ShowAction.ABORT])
def test_a_pilots_vehicle_that_falls_silent_is_the_pilots_still_when_it_is_heard_again_in_hold(
    action: ShowAction | None,
) -> None:
    config = show_config(3, operation=HOLDS_WHEN_LOST)
    flight = fly(lambda show: silent_while_a_pilot_has_it(show, action), config)
    assert flight.track.phases("d2") == [Phase.LOST, Phase.PILOT]
    assert flight.sent == 0
    assert "nobody has handed it back" in flight.reason
    assert flight.hold_while_lost.kind is RefusedError
    assert "taken over before it fell silent" in flight.hold_while_lost.text
    assert flight.handed_back.outcome is Outcome.DONE
    assert flight.after_hand_back == [Phase.PILOT, Phase.HOLD], "handed back it waits for orders"


async def heard_again_in_hold(show: Show) -> tuple[list[Phase], list[Verb]]:
    """Its own failsafe would have it sink; it is found in HOLD: a person's doing."""
    await show.start()
    show.link.silence("d2")
    await show.phase("d2", Phase.LOST)
    show.link.pilot("d2", PilotMode.HOLD)
    back_s = show.now_s
    show.link.restore("d2")
    await show.wait(10.0)
    verbs = [order.verb for order in show.link.orders["d2"] if order.time_s > back_s]
    return show.track.between(back_s).phases("d2"), verbs


def test_hold_after_a_silence_is_a_pilots_where_the_failsafe_is_another() -> None:
    phases, verbs = fly(heard_again_in_hold, show_config(2))
    assert (phases, verbs) == ([Phase.LOST, Phase.PILOT], [])


class Killed(NamedTuple):
    track: Track
    kill_s: float
    off_s: float
    outcome: OrderRecord
    again: OrderRecord
    sent: int
    start: Refusal
    confirmed: OrderRecord


async def killed(show: Show) -> Killed:
    await show.start()
    await show.wait(3.0)
    kill_s = show.now_s
    record = show.service.command_vehicle("d2", VehicleAction.KILL)
    await show.until(lambda: not show.link.autopilot("d2").commander.armed)
    off_s = show.now_s
    outcome = await show.settled(record)
    again = await show.order("d2", VehicleAction.KILL)
    await show.wait(5.0)
    sent = sum(setpoint.time_s > kill_s + 0.06 for setpoint in show.link.sent["d2"])
    await show.show(ShowAction.STOP)
    await show.reach(ShowPhase.LANDED)
    await show.wait(3.0)
    start = await refused(show, lambda: show.service.command_show(ShowAction.START))
    confirmed = await show.order("d2", VehicleAction.CONFIRM_DOWN)
    await show.wait(1.0)
    return Killed(show.track, kill_s, off_s, outcome, again, sent, start, confirmed)


@pytest.fixture(scope="module")
def kill() -> Killed:
    return fly(killed)


def test_kill_stops_the_motors_at_once(kill: Killed) -> None:
    assert kill.off_s - kill.kill_s < 0.15
    assert kill.outcome.outcomes["d2"].outcome is Outcome.DONE


def test_a_killed_vehicle_gets_nothing_more_and_stays_out_until_it_is_confirmed_down(kill: Killed) -> None:
    assert kill.sent == 0
    assert kill.track.between(kill.kill_s + 0.06).phases("d2") == [Phase.KILLED, Phase.STANDBY]
    assert kill.start.kind is RefusedError
    assert "d2 is killed" in kill.start.text
    assert kill.confirmed.outcome is Outcome.DONE


def test_a_kill_may_be_repeated(kill: Killed) -> None:
    assert kill.again.outcome is Outcome.DONE


def test_the_others_fly_on_after_a_kill_and_come_home(kill: Killed) -> None:
    last = kill.track.moments[-1]
    off_m = np.hypot(*(last.true_m - kill.track.moments[0].true_m)[:, :2].T)
    assert off_m[[0, 2, 3]].max() < 1.5
    assert last.armed == (False,) * 4


async def confirmed_down_while_silent(show: Show) -> tuple[list[Phase], OrderRecord]:
    await show.start()
    show.link.silence("d2")
    await show.phase("d2", Phase.LOST)
    began_s = show.now_s
    await show.wait(30.0)  # by its own failsafe it sinks and disarms meanwhile
    confirmed = await show.order("d2", VehicleAction.CONFIRM_DOWN)
    show.link.restore("d2")
    await show.phase("d2", Phase.STANDBY)
    return show.track.between(began_s).phases("d2"), confirmed


def test_a_lost_vehicle_confirmed_down_is_offline_until_it_is_heard_on_the_ground() -> None:
    phases, confirmed = fly(confirmed_down_while_silent, noise_scale=0.5)
    assert phases == [Phase.LOST, Phase.OFFLINE, Phase.STANDBY]
    assert confirmed.outcome is Outcome.DONE
