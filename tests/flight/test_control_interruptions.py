"""What happens in between: pause and resume, silence, a lost vehicle, a new radius, a late tick."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.control import Task
from gcs.model.plan import Formation, Orbit, Target, Yaw, YawPolicy
from gcs.model.state import Array
from gcs.planning.lost_space import swept_segments_m
from tests.support.control_flight import (
    SETTINGS,
    TICK_S,
    Flight,
    Sample,
    closest_m_and_violations,
    largest_setpoint_change_m_s,
    shape,
)


def in_orbit(*, noise_scale: float = 1.0) -> Flight:
    """Four drones, assembled, on the orbit."""
    flight = Flight(4, Formation(8.0, 20.0), noise_scale=noise_scale)
    flight.run(12.0)
    flight.plan = replace(flight.plan, orbit=Orbit(15.0, 2.5), target=Target(10.0, 0.0))
    flight.center_moves = True
    flight.run(10.0)
    return flight


@pytest.fixture(scope="module")
def paused() -> tuple[list[Sample], list[Sample], list[Sample]]:
    """The last second in orbit, the pause, and what follows."""
    flight = in_orbit()
    before = flight.history[-20:]
    flight.hold_in_place()
    pause = flight.run(10.0)
    flight.resume()
    flight.center_moves = True
    return before, pause, flight.run(10.0)


def test_pause_stops_every_vehicle_in_place(
    paused: tuple[list[Sample], list[Sample], list[Sample]],
) -> None:
    _, pause, _ = paused
    travelled_m = np.linalg.norm(pause[-1].position_m - pause[0].position_m, axis=1)
    assert travelled_m.max() < 4.0
    late_m = np.linalg.norm(pause[-1].position_m - pause[-40].position_m, axis=1)
    assert late_m.max() < 1.0


def test_setpoints_do_not_jump_at_pause_or_resume(
    paused: tuple[list[Sample], list[Sample], list[Sample]],
) -> None:
    before, pause, after = paused
    usual_m_s = largest_setpoint_change_m_s(before)
    assert largest_setpoint_change_m_s([before[-1], *pause[:20]]) < usual_m_s + 1.0
    assert largest_setpoint_change_m_s([pause[-1], *after[:20]]) < usual_m_s + 1.0


def test_formation_continues_from_where_it_paused(
    paused: tuple[list[Sample], list[Sample], list[Sample]],
) -> None:
    before, pause, after = paused
    assert np.linalg.norm(pause[-1].center_m - before[-1].center_m) < 5.0
    assert np.linalg.norm(after[0].center_m - pause[-1].center_m) < 0.1
    turned_m = np.linalg.norm(after[-1].center_m - pause[-1].center_m)
    assert turned_m > 10.0


def test_floor_holds_during_pause_and_resume(
    paused: tuple[list[Sample], list[Sample], list[Sample]],
) -> None:
    assert closest_m_and_violations([*paused[1], *paused[2]])[1] == 0


def test_only_the_vehicle_with_stale_telemetry_is_skipped() -> None:
    flight = Flight(4, Formation(8.0, 20.0))
    flight.run(1.0)
    flight.age_s[2] = SETTINGS.telemetry_age_max_s + 0.01
    silent = flight.run(1.0)
    assert all(sample.tick.setpoints.ids == ("d1", "d2", "d4") for sample in silent)
    flight.age_s[2] = 0.02
    again = flight.run(1.0)
    assert again[0].tick.setpoints.ids == ("d1", "d2", "d3", "d4")
    # it begins from the velocity it has, not from the one it was once given
    desired = again[0].tick.memory.desired_m_s[2]
    assert np.linalg.norm(desired - flight.history[-20].tick.memory.desired_m_s[2]) < 1.0


def test_tick_without_telemetry_commands_none_and_keeps_flying() -> None:
    flight = Flight(4, Formation(8.0, 20.0))
    (*_, before) = flight.run(1.0)
    flight.age_s[:] = np.inf
    (sample,) = flight.run(TICK_S)
    assert sample.tick.setpoints.ids == ()
    flight.age_s[:] = 0.02
    (sample,) = flight.run(TICK_S)
    assert len(sample.tick.setpoints.ids) == 4
    assert sample.center_m == pytest.approx(before.center_m, abs=0.1)
    assert sample.tick.memory.radius_m == pytest.approx(before.tick.memory.radius_m, abs=0.2)


@pytest.fixture(scope="module")
def with_one_lost() -> tuple[list[Sample], Array]:
    """One of four falls silent and sinks, as COM_OBL_RC_ACT 0 makes it; the others fly on."""
    flight = in_orbit()
    flight.run(11.0)  # from here its column stands in the others' way
    flight.task[0] = Task.NONE
    flight.airborne[0] = False  # unknown to the station: its column stands for it
    last_m = flight.believed_m[0].copy()
    flight.segments_m = swept_segments_m(
        last_m, flight.believed_m_s[0].copy(), flight.pads_m[0], "descend", 30.0
    )
    flight.handed_over[0] = True
    return flight.run(45.0), last_m


def test_the_column_of_a_lost_vehicle_is_avoided_by_the_others(
    with_one_lost: tuple[list[Sample], Array],
) -> None:
    history, last_m = with_one_lost
    floor = SETTINGS.safety.floor
    for sample in history:
        others_m = sample.position_m[1:]
        nearest_m = np.tile(last_m, (3, 1))
        nearest_m[:, 2] = np.clip(others_m[:, 2], last_m[2], 0.0)
        scaled_m = np.linalg.norm((others_m - nearest_m) * floor.scale, axis=1)
        assert scaled_m.min() > floor.horizontal_m


def test_others_avoid_the_path_of_a_lost_vehicle_and_continue(
    with_one_lost: tuple[list[Sample], Array],
) -> None:
    history, last_m = with_one_lost
    undisturbed = in_orbit()
    undisturbed.run(11.0)
    course_m = np.array([sample.position_m[1:, :2] for sample in undisturbed.run(45.0)])
    through_m = np.hypot(*(course_m - last_m[:2]).transpose(2, 0, 1)).min()
    assert through_m < SETTINGS.safety.floor.horizontal_m, "their course leads through its column"
    assert history[-1].tick.setpoints.ids == ("d2", "d3", "d4")
    energy_ratio, _, radius_error_m = shape(
        [replace(sample, position_m=sample.position_m[1:]) for sample in history[300:400]]
    )
    assert energy_ratio < 1.01
    assert radius_error_m < 1.5
    assert np.linalg.norm(history[-1].center_m[:2] - last_m[:2]) < 40.0


@pytest.fixture(scope="module")
def widened() -> list[Sample]:
    """From 8 to 11 m of radius."""
    flight = Flight(4, Formation(8.0, 25.0), noise_scale=0.0)
    flight.run(15.0)
    flight.plan = replace(flight.plan, formation=Formation(11.0, 25.0))
    return flight.run(15.0)


def test_a_new_radius_is_followed_gradually(widened: list[Sample]) -> None:
    radius_m = np.array([sample.tick.memory.radius_m for sample in widened])
    assert np.abs(np.diff(radius_m)).max() <= SETTINGS.radius_rate_m_s * TICK_S + 1e-9
    assert radius_m[0] == pytest.approx(8.0 + SETTINGS.radius_rate_m_s * TICK_S)
    assert radius_m[-1] == 11.0
    true_m = [float(np.linalg.norm(sample.position_m - sample.center_m, axis=1).mean()) for sample in widened]
    assert true_m[-1] == pytest.approx(11.0, abs=0.1)
    assert max(true_m) < 11.6


def test_setpoints_do_not_jump_at_the_change_of_the_radius(widened: list[Sample]) -> None:
    assert largest_setpoint_change_m_s(widened) < 1.0


def test_centre_does_not_catch_up_after_a_pause_of_the_service() -> None:
    flight = in_orbit(noise_scale=0.0)
    before_m = flight.history[-1].center_m
    flight.time_s += 5.0
    (sample,) = flight.run(TICK_S)
    assert np.linalg.norm(sample.center_m - before_m) < 0.2 * 1.1 * SETTINGS.law.center_speed_max_m_s


def test_all_vehicles_turn_to_the_target_at_the_yaw_rate() -> None:
    flight = Flight(4, Formation(8.0, 20.0))
    flight.run(0.5)
    flight.plan = replace(flight.plan, yaw=Yaw(YawPolicy.TARGET), target=Target(100.0, 100.0))
    turned = flight.run(6.0)
    yaw = np.array([sample.tick.setpoints.yaw_rad for sample in turned])
    rate_max = np.radians(SETTINGS.yaw_rate_max_deg_s)
    assert np.abs(np.diff(yaw, axis=0)).max() <= rate_max * TICK_S + 1e-9
    assert yaw[-1] == pytest.approx(np.full(4, np.pi / 4), abs=0.15)
