"""Orders to one vehicle of a show that flies, and those that are refused."""

from typing import NamedTuple

import numpy as np
import pytest

from gcs.model.errors import RefusedError, UnknownError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Formation
from gcs.model.state import Array, Mode, VehicleId
from gcs.service import CommandRecord, Outcome, ShowAction, VehicleAction
from gcs.testing.virtual_show import (
    HOLDS_WHEN_LOST,
    JUMP_M_S,
    FlownTrack,
    RefusedCall,
    VirtualShow,
    fly,
    refused,
    show_config,
)
from tests.support.show_phases import running

HOLD, JOIN, RETURN, LAND, TAKE_CONTROL, CONFIRM_DOWN = (
    VehicleAction.HOLD,
    VehicleAction.JOIN,
    VehicleAction.RETURN,
    VehicleAction.LAND,
    VehicleAction.TAKE_CONTROL,
    VehicleAction.CONFIRM_DOWN,
)


class Flight(NamedTuple):
    track: FlownTrack
    records: dict[str, CommandRecord]
    held: FlownTrack
    sent_in_hold: int
    joined: FlownTrack
    landed_from_m: Array
    landed_at_m: Array
    refusals: dict[str, RefusedCall]
    floor_violations: int


async def commands(show: VirtualShow) -> Flight:
    service, records, turned_down = show.service, {}, {}

    async def try_all(when: str, name: VehicleId, *actions: VehicleAction) -> None:
        for action in actions:
            refusal = await refused(show, lambda: service.commands.command_vehicle(name, action))  # noqa: B023
            turned_down[f"{when}: {action}"] = refusal

    await show.standby()
    await try_all("standby", "d1", HOLD, JOIN, RETURN, LAND, TAKE_CONTROL, CONFIRM_DOWN)
    await show.start()
    await show.wait(2.0)
    await try_all("formation", "d1", JOIN, TAKE_CONTROL, CONFIRM_DOWN)
    await try_all("unknown", "d9", HOLD)

    records["hold"] = await show.command("d1", HOLD)
    began_s = show.now_s
    await show.wait(5.0)
    held = show.track.between(began_s + 3.0)
    sent_in_hold = sum(setpoint.time_s > began_s for setpoint in show.ports.sent["d1"])
    records["hold again"] = await show.command("d1", HOLD)
    began_s = show.now_s
    records["join"] = await show.command("d1", JOIN)
    await show.wait(6.0)
    joined = show.track.between(began_s)

    landed_from_m = show.true_m[2].copy()
    service.commands.command_vehicle("d2", RETURN)
    landing = service.commands.command_vehicle("d3", LAND)
    await show.phase("d2", Phase.RETURN)
    records["return again"] = await show.command("d2", RETURN)
    records["land"] = await show.settled(landing)
    landed_at_m = show.true_m[2].copy()
    await try_all("landed", "d3", JOIN)
    service.commands.command_show(ShowAction.STOP)
    await show.phase("d1", Phase.RETURN)
    await try_all("returning", "d1", JOIN)
    await show.reach(ShowPhase.LANDED)
    return Flight(
        show.track,
        records,
        held,
        sent_in_hold,
        joined,
        landed_from_m,
        landed_at_m,
        turned_down,
        show.floor_violations(),
    )


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly(commands, show_config(3))


def test_every_vehicle_command_is_carried_out(flight: Flight) -> None:
    assert {name: record.outcome for name, record in flight.records.items()} == dict.fromkeys(
        flight.records, Outcome.DONE
    )


def test_a_vehicle_on_hold_stays_where_it_is_and_is_sent_nothing(flight: Flight) -> None:
    seen = flight.held.of("d1")
    assert {view.phase for view in seen} == {Phase.HOLD}
    assert {view.mode for view in seen} == {Mode.HOLD}
    assert flight.sent_in_hold == 0
    strayed_m = np.linalg.norm(flight.held.true_m[:, 0] - flight.held.true_m[0, 0], axis=1)
    assert strayed_m.max() < 1.5


def test_a_vehicle_joins_again_without_a_jump(flight: Flight) -> None:
    assert flight.joined.phases("d1") == [Phase.HOLD, Phase.FORMATION]
    assert flight.joined.hardest_change_m_s() < JUMP_M_S


def test_return_lands_at_its_start_while_the_others_fly(flight: Flight) -> None:
    off_m = np.hypot(*(flight.track.true_m[-1, 1] - flight.track.true_m[0, 1])[:2])
    assert off_m < 1.5
    assert Phase.RETURN in flight.track.phases("d2")


def test_land_brings_a_vehicle_down_where_it_is(flight: Flight) -> None:
    assert np.hypot(*(flight.landed_at_m - flight.landed_from_m)[:2]) < 2.5
    assert flight.landed_at_m[2] == pytest.approx(0.0, abs=0.05)


def test_true_separation_keeps_the_floor_during_commands(flight: Flight) -> None:
    assert flight.floor_violations == 0


@pytest.mark.parametrize(
    ("name", "possible"),
    [
        ("standby: hold", "it is from formation, landing, lost, return, takeoff"),
        ("standby: join", "it is from hold"),
        ("standby: return", "it is from formation, hold, landing"),
        ("standby: land", "it is from formation, hold, return, takeoff"),
        ("standby: take-control", "it is from pilot"),
        ("standby: confirm-down", "it is from killed, lost"),
        ("formation: join", "it is from hold"),
        ("formation: take-control", "it is from pilot"),
        ("formation: confirm-down", "it is from killed, lost"),
        ("landed: join", "it is from hold"),
        ("returning: join", "it is from hold"),
    ],
)
def test_command_in_the_wrong_phase_names_the_right_phases(flight: Flight, name: str, possible: str) -> None:
    refusal = flight.refusals[name]
    assert refusal.kind is RefusedError
    assert possible in refusal.text
    assert refusal.plan_kept


@pytest.mark.soak
@pytest.mark.parametrize("name", ["unknown: hold"])
def test_command_to_an_unknown_vehicle_names_the_known_ones(flight: Flight, name: str) -> None:
    refusal = flight.refusals[name]
    assert refusal.kind is UnknownError
    assert refusal.text == "there is no vehicle d9; there are d1, d2, d3"


async def no_room(show: VirtualShow) -> tuple[RefusedCall, CommandRecord]:
    """The sphere shrinks while one is out of our hands; then it wants to come back."""
    show.ports.silence("d4")
    await show.phase("d4", Phase.LOST)
    show.service.plan.set_formation(Formation(4.4, 14.0))
    show.ports.restore("d4")
    await show.phase("d4", Phase.HOLD)
    refusal = await refused(show, lambda: show.service.commands.command_vehicle("d4", JOIN))
    show.service.plan.set_formation(Formation(4.7, 14.0))
    return refusal, await show.command("d4", JOIN)


@pytest.mark.soak
def test_joining_a_too_small_sphere_names_the_radius_that_fits() -> None:
    refusal, joined = fly(no_room, show_config(4, operation=HOLDS_WHEN_LOST), after=running)
    assert refusal.kind is RefusedError
    assert "at least 4.7 m for 4 vehicles" in refusal.text
    assert joined.outcome is Outcome.DONE


async def join_without_a_show(show: VirtualShow) -> RefusedCall:
    await show.command("d1", HOLD)
    show.service.commands.command_show(ShowAction.STOP)
    await show.phase("d1", Phase.RETURN)
    await show.command("d1", HOLD)
    return await refused(show, lambda: show.service.commands.command_vehicle("d1", JOIN))


@pytest.mark.soak
def test_joining_is_refused_while_the_show_returns() -> None:
    refusal = fly(join_without_a_show, show_config(3), after=running)
    assert refusal.kind is RefusedError
    assert refusal.text == "d1 has no formation to join: the show is returning; accepted instead: land d1"
