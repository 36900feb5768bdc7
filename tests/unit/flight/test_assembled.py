"""When the sphere stands, and what is kept free around a vehicle that is lost."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.control import Memory, Task
from gcs.flight.state.flight import SETTLES_S, Flight, stands
from gcs.formation.orbit import Center
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Array, FleetState, Telemetry
from gcs.simulation.reference_shapes import best
from tests.support.silent_link import SilentLink

CENTER_M, RADIUS_M = np.array([3.0, 1.0, -20.0]), 8.0


class Climbing(SilentLink):
    """A link whose one vehicle was received once, at 0 s: 2 m up, at 1 m/s along x."""

    def snapshot(self) -> Telemetry:
        """The same at all times."""
        once_s = np.zeros(1)
        return replace(
            super().snapshot(),
            position_time_s=once_s,
            heartbeat_time_s=once_s,
            life_time_s=once_s,
            latitude_deg=np.array([47.0]),
            longitude_deg=np.array([8.0]),
            altitude_amsl_m=np.array([402.0]),
            velocity_ned_m_s=np.array([[1.0, 0.0, 0.0]]),
        )


def flight(
    count: int, charges: tuple[float, ...] | None = None, link: type[SilentLink] = SilentLink
) -> Flight:
    vehicles = [
        {"id": f"d{row}", "system_id": row + 1, "charge": 1.0 if charges is None else charges[row]}
        for row in range(count)
    ]
    config = Config.model_validate(
        {
            "show_frame": {"latitude_deg": 47.0, "longitude_deg": 8.0, "altitude_amsl_m": 400.0},
            "links": [{"name": "none", "listen": "udpin://127.0.0.1:14540", "vehicles": vehicles}],
            "formation": {"radius_m": RADIUS_M, "height_m": 20.0},
            "operation": {"takeoff_height_m": 5.0},
        }
    )
    return Flight(config, [link(config.ids)], 0.0)


def at(subject: Flight, position_m: Array) -> Flight:
    n = len(position_m)
    subject.newest.state = FleetState(
        0.0, subject.newest.state.ids, position_m, np.zeros((n, 3)), np.zeros(n), np.zeros(n)
    )
    subject.newest.memory = replace(Memory.fresh(n, 0.0), center=Center.at_rest(CENTER_M), radius_m=RADIUS_M)
    for vehicle in subject.vehicles.values():
        vehicle.phase = Phase.FORMATION
    return subject


@pytest.mark.parametrize("count", [2, 3, 4, 8, 20])
def test_sphere_is_stable_in_its_best_shape(count: int) -> None:
    assert at(flight(count), CENTER_M + RADIUS_M * best(count)).assembled()


@pytest.mark.parametrize("count", [2, 3, 4, 8, 20])
def test_sphere_is_unstable_with_all_on_its_lower_half(count: int) -> None:
    direction = best(count).copy()
    direction[:, 2] = np.abs(direction[:, 2]) + 0.8
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    assert not at(flight(count), CENTER_M + RADIUS_M * direction).assembled()


def test_sphere_is_unstable_with_a_vehicle_off_it() -> None:
    position = CENTER_M + RADIUS_M * best(4)
    position[2] += (position[2] - CENTER_M) * 0.3
    assert not at(flight(4), position).assembled()


def test_sphere_without_slots_is_stable_when_spread_evenly() -> None:
    """Or when it stands for long as it is: around lost vehicles it never becomes even."""
    half_chord = 0.8
    apart = np.array([[half_chord, 0.0, -0.6], [-half_chord, 0.0, -0.6]])
    subject = at(flight(2), CENTER_M + RADIUS_M * apart)
    assert subject.assembled(), "the slots are kept from the first"
    subject = at(flight(2), CENTER_M + RADIUS_M * apart)
    subject.in_force.plan = replace(
        subject.in_force.plan, formation=replace(subject.in_force.plan.formation, law="article")
    )
    assert not subject.assembled()
    subject.newest.state = replace(subject.newest.state, time_s=SETTLES_S)
    assert subject.assembled()
    subject = at(subject, CENTER_M + RADIUS_M * best(2))
    assert subject.assembled()


def test_single_vehicle_is_stable_once_on_the_sphere() -> None:
    assert at(flight(1), CENTER_M[None] + (0.0, 0.0, RADIUS_M)).assembled()


def test_small_charges_may_settle_closer_together() -> None:
    angle_rad = np.radians([0.0, 155.0, 205.0])  # 50 degrees apart, both far from the large one
    direction = np.stack([np.cos(angle_rad), np.sin(angle_rad), np.zeros(3)], axis=1)
    assert at(flight(3, (20.0, 1.0, 1.0)), CENTER_M + RADIUS_M * direction).assembled()
    assert not at(flight(3), CENTER_M + RADIUS_M * direction).assembled()


def test_a_look_at_a_large_sphere_lists_no_far_pairs() -> None:
    """A list of all pairs of 1,200 took a tick 40 ms; 4 stations on 2 cores then sent setpoints late."""
    count = 2000
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn_rad = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    across = np.sqrt(1.0 - height**2)
    spiral = np.stack([across * np.cos(turn_rad), across * np.sin(turn_rad), height], axis=1)
    two_in_one_place = spiral.copy()
    two_in_one_place[7] = spiral[8]
    tracemalloc.start()
    assert stands(100.0 * spiral, 100.0, np.ones(count))
    assert not stands(100.0 * two_in_one_place, 100.0, np.ones(count))
    _, most_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most_bytes < 1000 * count


def test_in_formation_only_frozen_or_returning_have_a_goal() -> None:
    subject = at(flight(3), CENTER_M + RADIUS_M * best(3))
    subject.show.phase = ShowPhase.RUNNING
    tasks = subject.tasks()
    assert tasks.task.tolist() == [Task.FORMATION] * 3
    assert tasks.airborne.all()
    assert not tasks.descending.any()
    assert tasks.center_moves
    first, second, _ = subject.vehicles.values()
    here_m = subject.newest.position_m(first)
    first.freeze(here_m, 1.0, "a jump")
    tasks = subject.tasks()
    assert tasks.task.tolist() == [Task.GOAL, Task.FORMATION, Task.FORMATION]
    assert (tasks.goal_m[0] == here_m).all()
    first.frozen_until_s = -1.0
    second.phase, second.goal_m = Phase.RETURN, here_m
    assert subject.tasks().task.tolist() == [Task.FORMATION, Task.GOAL, Task.FORMATION]
    second.phase, subject.show.phase = Phase.FORMATION, ShowPhase.PAUSED
    assert Task.FORMATION not in subject.tasks().task.tolist()


@pytest.mark.parametrize(("phase", "climbs"), [(Phase.LOST, True), (Phase.KILLED, False)])
def test_vehicle_lost_in_its_climb_keeps_climb_and_drift_free(phase: Phase, climbs: bool) -> None:
    subject = flight(1, link=Climbing)
    (vehicle,) = subject.vehicles.values()
    vehicle.phase, vehicle.home_m = phase, np.zeros(3)
    subject.note_seen(np.ones(1, np.bool_))
    segments_m = subject.tasks().segments_m
    assert ([[0.0, 0.0, -6.0], [0.0, 0.0, 0.0]] in segments_m.tolist()) == climbs
    assert segments_m[:, :, 0].max() == pytest.approx(2.2)


@pytest.mark.parametrize("age_s", [0.0, 1.9, 3.0, 20.0])
def test_the_swept_space_of_a_lost_vehicle_never_shrinks(age_s: float) -> None:
    """Its estimated velocity fades, but it can have flown on with the whole of its last velocity."""
    subject = flight(1, link=Climbing)
    (vehicle,) = subject.vehicles.values()
    vehicle.phase, vehicle.home_m = Phase.LOST, np.zeros(3)
    subject.note_seen(np.ones(1, np.bool_))
    subject.receive(age_s)
    subject.note_seen(
        np.ones(1, np.bool_)
    )  # also where its position is not believed, but its telemetry arrives
    assert subject.tasks().segments_m[:, :, 0].max() == pytest.approx(2.2 + min(age_s, 0.5), abs=1e-3)
