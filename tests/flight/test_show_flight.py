"""One whole show, twice: up, onto the sphere, round the target, home; one vehicle is never received."""

from typing import NamedTuple

import numpy as np
import pytest

from gcs.links import Verb
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Orbit
from gcs.model.state import VehicleId
from gcs.service import CommandRecord, Outcome, ShowAction
from gcs.testing.virtual_link import SentCommand, SentSetpoint
from gcs.testing.virtual_show import (
    HEADING_DEG,
    JUMP_M_S,
    TAKEOFF_HEIGHT_M,
    TARGET_M,
    FlownTrack,
    VirtualShow,
    fly,
)

FLIERS = ("d1", "d2", "d3")
ORBIT_M = 5.0


class Flight(NamedTuple):
    track: FlownTrack  # of the first flight
    started: CommandRecord
    stopped: CommandRecord
    running_s: tuple[float, float]  # standing still, before the orbit
    orbiting_s: tuple[float, float]
    stop_s: float
    floor_violations: int
    sent: dict[VehicleId, list[SentSetpoint]]
    commands: dict[VehicleId, list[SentCommand]]
    second_start: CommandRecord
    second: FlownTrack


async def two_flights(show: VirtualShow) -> Flight:
    show.ports.silence("d4")
    started = await show.start()
    await show.wait(5.0)
    running_s = (show.now_s - 2.0, show.now_s)
    show.service.plan.set_orbit(Orbit(radius_m=ORBIT_M, speed_m_s=2.0))
    await show.wait(15.0)
    orbiting_s = (show.now_s - 4.0, show.now_s)
    stop_s = show.now_s
    stopped = await show.show(ShowAction.STOP)
    await show.reach(ShowPhase.LANDED)
    first, violations = show.track, show.floor_violations()
    sent = {name: list(setpoints) for name, setpoints in show.ports.sent.items()}
    commands = {name: list(given) for name, given in show.ports.commands.items()}
    await show.wait(9.0)  # where they say that they stand drifts by half a metre
    again_s = show.now_s
    second_start = await show.start()
    await show.wait(0.1)
    return Flight(
        first,
        show.service.command_log.get(started.id),
        stopped,
        running_s,
        orbiting_s,
        stop_s,
        violations,
        sent,
        commands,
        show.service.command_log.get(second_start.id),
        show.track.between(again_s),
    )


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly(two_flights)


def test_show_phases_follow_from_idle_to_landed(flight: Flight) -> None:
    assert flight.track.show_phases() == [
        ShowPhase.IDLE,
        ShowPhase.ARMING,
        ShowPhase.ASSEMBLING,
        ShowPhase.RUNNING,
        ShowPhase.RETURNING,
        ShowPhase.LANDED,
    ]


@pytest.mark.parametrize("name", FLIERS)
def test_vehicle_phases_follow_in_order(flight: Flight, name: str) -> None:
    assert flight.track.phases(name)[-7:] == [
        Phase.STANDBY,
        Phase.TAKEOFF,
        Phase.HOLD,
        Phase.FORMATION,
        Phase.RETURN,
        Phase.LANDING,
        Phase.STANDBY,
    ]


def test_start_and_stop_are_done_by_every_vehicle_of_the_show(flight: Flight) -> None:
    for record in (flight.started, flight.stopped):
        assert {name: record.outcomes[name].outcome for name in FLIERS} == dict.fromkeys(FLIERS, Outcome.DONE)
        assert record.outcome is Outcome.DONE


def test_vehicle_never_received_is_excluded_and_sent_nothing(flight: Flight) -> None:
    left_out = flight.started.outcomes["d4"]
    assert left_out.outcome is Outcome.NOT_INCLUDED
    assert left_out.reason == "not chosen"
    assert flight.sent["d4"] == []
    assert flight.commands["d4"] == []


def test_vehicles_take_their_turns_to_take_off(flight: Flight) -> None:
    turns_s = [flight.commands[name][0].time_s for name in FLIERS]
    assert np.diff(turns_s) == pytest.approx([1.0, 1.0])
    for name in FLIERS:
        verbs = [command.verb for command in flight.commands[name]]
        assert verbs[: verbs.index(Verb.TAKEOFF) + 1] == [Verb.HOLD, Verb.ARM, Verb.TAKEOFF]


@pytest.mark.parametrize("name", FLIERS)
def test_vehicles_climb_straight_up_before_they_move_sideways(flight: Flight, name: str) -> None:
    true_m = flight.track.true_m[:, flight.track.ids.index(name)]
    up = -true_m[:, 2] > 0.85 * TAKEOFF_HEIGHT_M - 1.0  # a metre of height error is usual
    climb_m = true_m[: int(np.argmax(up))]
    assert len(climb_m) > 20
    sideways_m = np.hypot(*(climb_m - climb_m[0])[:, :2].T)
    assert sideways_m.max() < 1.0


@pytest.mark.parametrize("name", FLIERS)
def test_no_setpoint_before_the_vehicle_holds_at_its_height(flight: Flight, name: str) -> None:
    assert flight.sent[name][0].time_s >= flight.track.since(name, Phase.HOLD)


def test_setpoints_leave_each_tick_from_engagement_to_landing(flight: Flight) -> None:
    for name in FLIERS:
        times_s = np.array([setpoint.time_s for setpoint in flight.sent[name]])
        assert np.diff(times_s) == pytest.approx(np.full(len(times_s) - 1, 0.05), abs=1e-6)


def test_setpoints_in_ned_equal_those_in_the_show_frame(flight: Flight) -> None:
    decided_m_s = flight.track.between(*flight.orbiting_s).setpoint_m_s[:, 0]
    begin_s, end_s = flight.orbiting_s
    sent_m_s = np.array(
        [sent.velocity_ned_m_s for sent in flight.sent["d1"] if begin_s <= sent.time_s <= end_s]
    )
    c, s = np.cos(np.radians(HEADING_DEG)), np.sin(np.radians(HEADING_DEG))
    north_m_s = c * decided_m_s[:, 0] - s * decided_m_s[:, 1]
    east_m_s = s * decided_m_s[:, 0] + c * decided_m_s[:, 1]
    assert np.column_stack([north_m_s, east_m_s, decided_m_s[:, 2]]) == pytest.approx(sent_m_s)


def test_the_sphere_truly_stands_around_the_target(flight: Flight) -> None:
    standing = flight.track.between(*flight.running_s)
    true_m = standing.true_m[:, :3]
    center_m = np.array([sample.view.center_m for sample in standing.samples])
    radius_m = np.array([sample.view.radius_m for sample in standing.samples])
    assert center_m[-1][:2] == pytest.approx(TARGET_M, abs=0.5)
    off_m = np.linalg.norm(true_m - center_m[:, None], axis=2) - radius_m[:, None]
    assert np.abs(off_m).max() < 1.5  # the fake's own position error, mostly
    distance_m = np.linalg.norm(true_m - np.roll(true_m, 1, axis=1), axis=2)
    assert distance_m.min() > 0.8 * np.sqrt(3.0) * radius_m.max()  # the equilateral triangle's side


def test_the_formation_circles_the_target(flight: Flight) -> None:
    centroid_m = flight.track.between(*flight.orbiting_s).true_m[:, :3].mean(axis=1)
    distance_m = np.hypot(*(centroid_m[:, :2] - TARGET_M).T)
    assert distance_m == pytest.approx(np.full(len(distance_m), ORBIT_M), abs=1.2)
    speed_m_s = np.linalg.norm(np.diff(centroid_m[:, :2], axis=0), axis=1).mean() / 0.05
    assert speed_m_s == pytest.approx(2.0, abs=0.4)


def test_true_separation_keeps_the_floor(flight: Flight) -> None:
    assert flight.floor_violations == 0


def test_setpoints_never_jump_from_one_tick_to_the_next(flight: Flight) -> None:
    assert flight.track.hardest_change_m_s() < JUMP_M_S


def test_every_vehicle_lands_on_its_own_start_and_disarms(flight: Flight) -> None:
    first, last = flight.track.samples[0], flight.track.samples[-1]
    off_m = np.linalg.norm(last.true_m - first.true_m, axis=1)
    assert off_m.max() < 1.5
    assert last.armed == (False,) * 4


def test_a_second_start_after_landing_flies_again(flight: Flight) -> None:
    assert {flight.second_start.outcomes[name].outcome for name in FLIERS} == {Outcome.DONE}
    assert flight.second.show_phases()[-2:] == [ShowPhase.ASSEMBLING, ShowPhase.RUNNING]
    assert (-flight.second.samples[-1].true_m[:3, 2]).min() > 3.0
