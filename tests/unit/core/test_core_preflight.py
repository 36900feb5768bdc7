"""Before take-off every reason to stay on the ground is named, vehicle by vehicle."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.accuracy import Positioning, uncertainty_m
from gcs.preflight import PAD_HEIGHT_MAX_M, Finding, check_fleet, told
from gcs.safety.separation import Floor
from gcs.safety.walls import Fence
from gcs.state import FleetState, Landed, Mode, Telemetry

IDS = ("a", "b", "c")
FLOOR = Floor(horizontal_m=2.0, margin_m=1.0, uncertainty_m=0.0)
P = Positioning()
NEVER = np.full(3, np.inf)
FENCE = Fence(distance_max_m=300.0)

GOOD = Telemetry(
    ids=IDS,
    position_time_s=np.zeros(3),
    heartbeat_time_s=np.zeros(3),
    latitude_deg=np.zeros(3),
    longitude_deg=np.zeros(3),
    altitude_amsl_m=np.zeros(3),
    velocity_ned_m_s=np.zeros((3, 3)),
    yaw_deg=np.zeros(3),
    battery_remaining=np.ones(3),
    armed=(False,) * 3,
    mode=(Mode.HOLD,) * 3,
    landed=(Landed.ON_GROUND,) * 3,
    ready=(True,) * 3,
    horizontal_accuracy_m=np.full(3, np.nan),
    vertical_accuracy_m=np.full(3, np.nan),
    boots=(0,) * 3,
    position_resets=(0,) * 3,
    fix_type=np.full(3, 3.0),
    sick_sensors=np.zeros(3, np.int64),
    clock_base_s=np.zeros(3),
)


def findings(
    telemetry: Telemetry = GOOD,
    *,
    vehicles: tuple[str, ...] = IDS,
    age_s: tuple[float, float, float] = (0.1, 0.1, 0.1),
    east_m: tuple[float, float, float] = (0.0, 4.0, 8.0),
    height_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    conflicts: dict[str, str] | None = None,
    pads_within_m: float = np.inf,
) -> list[tuple[str, str]]:
    position = np.stack([np.zeros(3), np.array(east_m), -np.array(height_m)], axis=1)
    fleet = FleetState(0.0, IDS, position, np.zeros((3, 3)), np.zeros(3), np.array(age_s))
    reported_m = telemetry.horizontal_accuracy_m, telemetry.vertical_accuracy_m
    found = check_fleet(
        vehicles,
        fleet,
        {name: (telemetry, row) for row, name in enumerate(IDS)},
        conflicts or {},
        age_max_s=0.5,
        floor=FLOOR,
        fence=FENCE,
        uncertainty_m=uncertainty_m(0.0, *reported_m, NEVER, P),
        positioning=P,
        pads_within_m=pads_within_m,
    )
    return [(finding.vehicle_id, finding.problem) for finding in found]


def test_a_fleet_in_order_has_no_findings() -> None:
    assert findings() == []


@pytest.mark.parametrize("age_s", [0.7, float("inf"), float("nan")])
def test_a_position_that_is_old_or_was_never_heard_is_named(age_s: float) -> None:
    ((vehicle, problem),) = findings(age_s=(0.1, age_s, 0.1))
    assert vehicle == "b"
    assert "no position" in problem


def test_an_autopilot_that_is_not_ready_is_named() -> None:
    assert findings(replace(GOOD, ready=(True, True, False))) == [
        ("c", "its autopilot does not yet pass its own arming checks")
    ]


def test_a_weak_battery_is_named_with_what_is_needed() -> None:
    assert findings(replace(GOOD, battery_remaining=np.array([0.24, 0.25, 1.0]))) == [
        ("a", "battery at 24%, at least 25% is needed")
    ]


def test_a_battery_nobody_knows_is_not_taken_for_a_full_one() -> None:
    assert findings(replace(GOOD, battery_remaining=np.array([1.0, np.nan, 1.0]))) == [
        ("b", "battery unknown, at least 25% is needed")
    ]


def test_a_system_id_heard_from_two_places_is_named() -> None:
    ((vehicle, problem),) = findings(conflicts={"b": "system id 2 is heard from two addresses"})
    assert vehicle == "b"
    assert "system id 2 is heard from two addresses" in problem
    assert "a system id of its own" in problem


def test_pads_too_close_to_climb_side_by_side_are_named_with_both_vehicles() -> None:
    assert findings(east_m=(0.0, 2.5, 8.0)) == [("a", "stands 2.5 m from b, at least 3 m is needed")]


def test_a_neighbour_that_stays_on_the_ground_is_too_close_all_the_same() -> None:
    assert findings(vehicles=("a", "c"), east_m=(0.0, 2.5, 8.0)) == [
        ("a", "stands 2.5 m from b, at least 3 m is needed")
    ]


def test_pads_exactly_far_enough_are_not_named() -> None:
    assert findings(east_m=(0.0, 3.0, 6.0)) == []


def test_everything_wrong_is_named_at_once() -> None:
    bad = replace(GOOD, battery_remaining=np.array([0.1, 1.0, 1.0]), ready=(False, True, False))
    assert [vehicle for vehicle, _ in findings(bad, east_m=(0.0, 1.0, 8.0))] == ["a", "a", "c", "a"]


def test_only_those_who_are_to_fly_are_checked() -> None:
    assert findings(replace(GOOD, ready=(False, True, True)), vehicles=("b", "c")) == []


@pytest.mark.parametrize(("height_m", "where"), [(47.3, "47.3 m above"), (-3.1, "3.1 m below")])
def test_a_pad_far_above_or_below_the_origin_is_named_with_its_height(height_m: float, where: str) -> None:
    assert findings(height_m=(0.0, height_m, 0.0)) == [
        ("b", f"stands {where} the show's origin, at most 3 m is possible: check show_frame")
    ]
    assert findings(height_m=(0.0, PAD_HEIGHT_MAX_M, -PAD_HEIGHT_MAX_M)) == []


def test_a_pad_beyond_the_fence_is_named_with_its_distance() -> None:
    assert findings(east_m=(0.0, 4.0, 1234.5)) == [
        ("c", "stands 1234 m from the show's origin, beyond the fence at 300 m: check show_frame")
    ]
    assert findings(east_m=(0.0, 4.0, 300.0)) == []


def test_a_place_that_is_too_old_to_count_is_not_judged() -> None:
    ((_, problem),) = findings(height_m=(0.0, 50.0, 0.0), age_s=(0.1, 9.0, 0.1))
    assert "no position for 9.0 s" in problem


def test_a_position_that_is_heard_but_not_believed_is_told_from_one_never_heard() -> None:
    unheard = replace(GOOD, position_time_s=np.full(3, -np.inf))
    assert findings(unheard, age_s=(0.1, np.inf, 0.1)) == [("b", "no position yet")]
    ((_, problem),) = findings(age_s=(0.1, np.inf, 0.1))
    assert "no position to believe" in problem
    assert "check its GPS and show_frame" in problem


def test_a_pad_that_the_autopilots_own_fence_does_not_allow_for_is_named() -> None:
    ((vehicle, problem),) = findings(east_m=(0.0, 4.0, 60.0), pads_within_m=50.0)
    assert vehicle == "c"
    assert problem.startswith("stands 60 m from the show's origin, its autopilot's fence allows for 50 m")
    assert "raise operation.pads_within_m" in problem
    assert findings(east_m=(0.0, 4.0, 60.0), pads_within_m=60.0) == []


def test_a_receiver_without_a_good_fix_is_named_with_what_it_reports() -> None:
    poor = replace(
        GOOD, horizontal_accuracy_m=np.array([0.9, 6.0, np.nan]), vertical_accuracy_m=np.full(3, 1.8)
    )
    ((vehicle, problem),) = findings(poor, east_m=(0.0, 8.0, 16.0))
    assert vehicle == "b"
    assert problem.startswith("its receiver reports an accuracy of 6.0 m sideways and 1.8 m up")
    none = replace(GOOD, horizontal_accuracy_m=np.full(3, np.inf), vertical_accuracy_m=np.full(3, np.inf))
    assert len(findings(none, east_m=(0.0, 20.0, 40.0))) == 3


def test_pads_are_as_far_apart_as_the_reported_accuracies_ask_for() -> None:
    worse = replace(GOOD, horizontal_accuracy_m=np.array([3.0, 3.0, 0.9]))  # 0.4 times 2 m more, each
    ((vehicle, problem),) = findings(worse)
    assert (vehicle, problem) == ("a", "stands 4.0 m from b, at least 4.6 m is needed")


def test_what_is_wrong_with_several_is_said_once() -> None:
    found = [Finding("a", "is red"), Finding("b", "is blue"), Finding("c", "is red")]
    assert told(found) == "a, c: is red; b: is blue"
