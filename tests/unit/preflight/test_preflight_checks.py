"""Before take-off every reason to stay on the ground is named: measured value, limit, and what to do."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcs.config.sections import PreflightSettings
from gcs.estimation.pad_places import Moved
from gcs.estimation.positioning import Positioning, uncertainty_m
from gcs.model.frames import ShowFrame
from gcs.model.preflight_report import Check, State, describe
from gcs.model.state import Array, FleetState, Landed, Mode, Telemetry
from gcs.preflight.fleet import Pattern, standing
from gcs.preflight.pad_distances import TO_THE_NEXT, spacing
from gcs.preflight.vehicles import PAD_HEIGHT_MAX_M, PreflightInputs, own_checks
from gcs.safety.fenced_areas import FencedArea
from gcs.safety.floor import Floor
from gcs.safety.walls import Fence
from tests.support.reported import reported

IDS = ("a", "b", "c")
FLOOR = Floor(horizontal_m=2.0, margin_m=0.8, deviations=2.0 * 2.0**0.5)  # 3 m with RTK
P = Positioning()
NEVER = np.full(3, np.inf)
FENCE = Fence(distance_max_m=300.0)

GOOD = reported(
    IDS,
    armed=(False,) * 3,
    mode=(Mode.HOLD,) * 3,
    landed=(Landed.ON_GROUND,) * 3,
    horizontal_accuracy_m=0.05,
    vertical_accuracy_m=0.1,
    fix_type=6.0,
)
LINE_M = (0.0, 4.0, 8.0)


def known(
    telemetry: Telemetry = GOOD,
    *,
    age_s: tuple[float, float, float] = (0.1, 0.1, 0.1),
    east_m: tuple[float, float, float] = LINE_M,
    height_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    settings: PreflightSettings | None = None,
    **more: Any,
) -> PreflightInputs:
    position = np.stack([np.zeros(3), np.array(east_m), -np.array(height_m)], axis=1)
    reported_m = telemetry.horizontal_accuracy_m, telemetry.vertical_accuracy_m
    given: dict[str, Any] = {
        "fleet": FleetState(0.0, IDS, position, np.zeros((3, 3)), np.zeros(3), np.array(age_s)),
        "rows": {name: row for row, name in enumerate(IDS)},
        "telemetry": telemetry,
        "conflicts": {},
        "uncertainty_m": uncertainty_m(0.0, 2.0, *reported_m, telemetry.fix_type, P),
        "age_max_s": 0.5,
        "floor": FLOOR,
        "fence": FENCE,
        "positioning": P,
        "settings": settings or PreflightSettings(),
    }
    return PreflightInputs(**{**given, **more})


def test_other_autopilot_than_configured_is_refused() -> None:
    text = "it reports ArduPilot, and is configured as PX4 (autopilot: px4)"
    name, check = only(known(foreign={"b": text}))
    assert (name, check.name, check.state, check.problem) == ("b", "autopilot", State.FAIL, text)
    assert "configuration" in check.to_do


def test_an_autopilot_is_quoted_and_its_words_are_bounded() -> None:
    says = [
        f"Compass {number} not calibrated, do that before arming the vehicle again" for number in range(9)
    ]
    not_ready = replace(GOOD, ready=(True, False, True))
    name, check = only(known(not_ready, complaints={"b": says}))
    assert (name, check.name, check.depends_on) == ("b", "autopilot", ())
    assert '; it says "Compass 0 not calibrated' in check.problem
    assert check.problem.endswith(" and 5 more")
    assert len(check.problem) < 350
    _, check = only(known(not_ready, complaints={"b": ["High GPS HDOP"]}))
    assert "fix" in check.depends_on
    assert failed(known(complaints={"b": says})) == [], "it passes its checks"


def test_a_jump_names_its_size_and_age() -> None:
    way_m = np.array([[0.1, 0.0, 0.0], [30.0, 0.0, -2.0], [np.nan] * 3])
    moved = Moved(way_m, np.full((3, 2), 1.0), np.array([np.inf, -25.0, np.inf]))
    name, check = only(known(moved=moved))
    assert (name, check.name, check.value, check.unit) == ("b", "jump", 30.0, "m")
    assert check.problem == "its position moved by 30 m sideways and 2 m up while it stood, 25 s ago"
    assert check.limit == "at most 1.0 m sideways and 1.0 m up or down"
    way_m[1] = 0.0
    assert only(known(moved=moved))[1].to_do == "wait"


def failed(facts: PreflightInputs) -> list[tuple[str, Check]]:
    """Whatever does not pass, of one vehicle by itself and of how it stands to its neighbours."""
    near = spacing(facts, IDS)
    found = [(name, check) for name in IDS for check in (*own_checks(facts, name), *near[name])]
    assert all(check.limit for _, check in found)
    assert all(check.problem and check.to_do for _, check in found if not check.passes)
    assert not any(check.problem or check.to_do for _, check in found if check.passes)
    return [(name, check) for name, check in found if not check.passes]


def only(facts: PreflightInputs) -> tuple[str, Check]:
    (one,) = failed(facts)
    return one


def test_fleet_in_order_passes_with_every_measured_value() -> None:
    assert failed(known()) == []
    names = [check.name for check in own_checks(known(), "b")]
    assert names == [
        *("address", "position", "fix", "accuracy sideways", "accuracy up", "autopilot", "battery"),
        *("height of the origin", "distance of the origin", "clock"),
    ]
    measured = {check.name: (check.value, check.unit) for check in own_checks(known(), "b")}
    assert measured["position"] == (0.1, "s")
    assert measured["fix"] == (6.0, "")
    assert measured["accuracy sideways"] == (0.05, "m")
    assert measured["battery"] == (1.0, "of 1")
    assert measured["distance of the origin"] == (4.0, "m")
    assert measured["clock"] == (0.0, "s")


def of_b(column: str, value: float) -> Telemetry:
    """A good fleet in which b tells something else."""
    values = getattr(GOOD, column).copy()
    values[1] = value
    changed: Telemetry = replace(GOOD, **{column: values})
    return changed


AREA = FencedArea(corners_m=((-1.0, -1.0), (1.0, -1.0), (1.0, 6.0), (-1.0, 6.0)))
FAILING: dict[str, tuple[PreflightInputs, State, str, str]] = {
    "address": (known(conflicts={"b": "system id 2 sends twice"}), State.FAIL, "sends twice", "its own"),
    "position": (known(age_s=(0.1, 0.7, 0.1)), State.FAIL, "no position for 0.7 s", "link"),
    "fix": (
        known(of_b("fix_type", 2.0), east_m=(0.0, 12.0, 24.0)),
        State.FAIL,
        "fix is 2D, 3D is needed",
        "open sky",
    ),
    "accuracy up": (known(of_b("vertical_accuracy_m", np.nan)), State.UNKNOWN, "not tell its", "better fix"),
    "autopilot": (
        known(of_b("unhealthy_sensors", 0x4)),
        State.FAIL,
        "unhealthy what it flies by: magn",
        "wait",
    ),
    "battery": (known(of_b("battery_remaining", 0.24)), State.FAIL, "battery at 24%, at least 25%", "charge"),
    "height of the origin": (known(height_m=(0.0, 47.3, 0.0)), State.FAIL, "47.3 m above the", "altitude"),
    "distance of the origin": (known(fence=Fence(distance_max_m=7.9), east_m=(0, 8, 4)), State.FAIL, "", ""),
    "area of the fence": (
        known(fence=FENCE.model_copy(update={"areas": (AREA,)}), east_m=(0, 8, 4)),
        *(State.FAIL, "stands 2.0 m beyond the fence of the show's drawing", "place the show anew"),
    ),
    "clock": (known(of_b("clock_base_s", -3.0)), State.FAIL, "3.0 s behind this machine's", "clock (NTP)"),
    "speed": (
        known(speed_max_m_s=np.array([np.inf, 3.0, 8.0]), speed_need_m_s=4.2),
        *(State.FAIL, "flies at most 3 m/s, this show needs 4.2 m/s", "slower one"),
    ),
}


@pytest.mark.parametrize("name", FAILING)
def test_each_check_of_a_vehicle_can_fail_and_is_named(name: str) -> None:
    facts, state, problem, to_do = FAILING[name]
    vehicle, check = only(facts)
    assert (vehicle, check.name, check.state) == ("b", name, state)
    assert problem in check.problem
    assert to_do in check.to_do


UNKNOWN: dict[str, tuple[Telemetry, dict[str, Any]]] = {
    "position": (replace(GOOD, position_time_s=np.full(3, -np.inf)), {"age_s": (0.1, np.inf, 0.1)}),
    "fix": (of_b("fix_type", np.nan), {}),
    "accuracy sideways": (of_b("horizontal_accuracy_m", np.nan), {}),
    "autopilot": (of_b("unhealthy_sensors", -1), {}),
    "battery": (of_b("battery_remaining", np.nan), {}),
    "clock": (of_b("clock_base_s", np.nan), {}),
}


@pytest.mark.parametrize("name", UNKNOWN)
def test_unknown_counts_as_failed_and_is_called_unknown(name: str) -> None:
    telemetry, more = UNKNOWN[name]
    vehicle, check = only(known(telemetry, **more))
    assert (vehicle, check.name, check.state, check.value) == ("b", name, State.UNKNOWN, None)


def test_check_not_configured_is_not_made() -> None:
    settings = PreflightSettings(require_fix=False, clock_max_s=None)
    assert failed(known(replace(of_b("fix_type", np.nan), clock_base_s=NEVER), settings=settings)) == []


@pytest.mark.parametrize(
    ("need", "left", "passes"), [(0.6, 0.59, False), (0.6, 0.6, True), (0.1, 0.24, False)]
)
def test_battery_needs_the_show_estimate_or_the_least(need: float, left: float, passes: bool) -> None:
    found = failed(known(of_b("battery_remaining", left), battery_need=need))
    assert bool(found) is not passes
    if need > 0.25 and not passes:
        assert found[0][1].problem == "battery at 59%, at least 60% is needed for this show"


def test_show_with_unknown_battery_need_is_not_flown() -> None:
    found = failed(known(battery_need=None))
    assert [(vehicle, check.state) for vehicle, check in found] == [(name, State.UNKNOWN) for name in IDS]


def test_autopilot_not_ready_names_its_unhealthy_sensors() -> None:
    _, check = only(known(replace(GOOD, ready=(True, True, False))))
    assert check.problem == "its autopilot does not yet pass its own arming checks"
    _, check = only(known(replace(of_b("unhealthy_sensors", 0x200001), ready=(True, False, True))))
    assert check.problem.endswith("arming checks: gyroscope, position and attitude estimate")


def test_rejected_position_differs_from_one_never_received() -> None:
    _, check = only(known(age_s=(0.1, np.inf, 0.1)))
    assert "no position to believe" in check.problem
    assert check.to_do == "check its GPS and show_frame"


@pytest.mark.parametrize(
    ("frame", "problem", "to_do"),
    [
        (ShowFrame(8.5456, 47.3977, 488.0), "at 47.3977, 8.5456", "exchange latitude and longitude in show"),
        (ShowFrame(47.9, 8.5, 488.0), "56 km from the show's origin", "check its GPS and show_frame"),
        (ShowFrame(47.39, 8.54, 488.0), "it jumped, or is kilometres away", "check its GPS and show_frame"),
    ],
    ids=["exchanged", "far", "near"],
)
def test_position_that_is_far_away_says_where(frame: ShowFrame, problem: str, to_do: str) -> None:
    at = replace(GOOD, latitude_deg=np.full(3, 47.3977), longitude_deg=np.full(3, 8.5456))
    _, check = only(known(at, age_s=(0.1, np.inf, 0.1), frame=frame))
    assert problem in check.problem
    assert check.to_do.startswith(to_do)


def test_stale_position_is_not_judged() -> None:
    _, check = only(known(height_m=(0.0, 50.0, 0.0), age_s=(0.1, 9.0, 0.1)))
    assert check.problem == "no position for 9.0 s"


def test_receiver_without_a_good_fix_is_named_with_its_report() -> None:
    found = failed(known(of_b("horizontal_accuracy_m", 6.0), east_m=(0.0, 12.0, 24.0)))
    assert [(vehicle, check.name) for vehicle, check in found] == [("b", "accuracy sideways")]
    assert found[0][1].problem.startswith("its receiver reports an accuracy of 6.0 m sideways and 0.1 m up")


def test_unknown_accuracy_is_not_reported_as_infinite() -> None:
    found = failed(known(of_b("horizontal_accuracy_m", np.inf), east_m=(0.0, 12.0, 24.0)))
    assert {check.problem for _, check in found} == {"its receiver does not tell its accuracy"}


def test_pads_too_close_to_climb_are_named_once_per_pair() -> None:
    assert [(vehicle, check.problem) for vehicle, check in failed(known(east_m=(0.0, 2.5, 8.0)))] == [
        ("a", "stands 2.5 m from b, at least 3.0 m is needed with an RTK fixed fix of 0.05 m"),
    ]
    assert [vehicle for vehicle, _ in failed(known(east_m=(0.0, 2.5, 5.0)))] == ["a", "b"]
    assert failed(known(east_m=(0.0, 3.0, 6.0))) == []


def test_grounded_neighbour_counts_as_too_close() -> None:
    (check,) = spacing(known(east_m=(0.0, 2.5, 8.0)), ["a"])["a"]
    assert (check.state, check.value) == (State.FAIL, 2.5)


def test_pads_that_were_far_enough_may_wander_together() -> None:
    """Of a passed check a start does not fail because two receivers report less apart than a moment ago."""
    nearer_m, passed = (0.0, 2.6, 8.0), frozenset((name, TO_THE_NEXT) for name in "abc")
    assert [vehicle for vehicle, _ in failed(known(east_m=nearer_m))] == ["a"]
    assert failed(known(east_m=nearer_m, passed=passed)) == []
    moved = known(east_m=(0.0, 2.4, 8.0), passed=passed)
    assert [vehicle for vehicle, _ in failed(moved)] == ["a"]


def test_pad_distance_depends_on_the_reported_accuracies() -> None:
    worse = replace(GOOD, horizontal_accuracy_m=np.array([0.45, 0.45, 0.05]))  # times 4 each
    found = failed(known(worse))
    assert found[0][1].problem == (
        "stands 4.0 m from b, at least 4.6 m is needed with an RTK fixed fix of 0.45 m"
    )


def test_fence_of_the_autopilot_bounds_the_pads() -> None:
    vehicle, check = only(known(east_m=(0.0, 4.0, 60.0), pads_within_m=50.0))
    assert vehicle == "c"
    assert check.problem == "stands 60 m from the show's origin, its autopilot's fence allows for 50 m"
    assert check.to_do.startswith("reboot it where it stands")  # the others stand where they should
    assert "raise operation.pads_within_m" in check.to_do
    for _, far in failed(known(east_m=(60.0, 65.0, 70.0), pads_within_m=50.0)):
        assert far.to_do.startswith("check show_frame, or raise operation.pads_within_m")
    (own,) = (
        each for _, each in failed(known(height_m=(0.0, 0.0, 5.0))) if each.name == "height of the origin"
    )
    assert own.to_do.startswith("reboot it where it stands")
    assert failed(known(height_m=(0.0, PAD_HEIGHT_MAX_M, -PAD_HEIGHT_MAX_M))) == []


# together

GRID_M = np.array([[row * 5.0, column * 5.0] for row in range(-1, 2) for column in range(-1, 2)])
NINE = tuple(f"d{number}" for number in range(1, 10))


def turned(place_m: Array, by_deg: float) -> Array:
    c, s = np.cos(np.radians(by_deg)), np.sin(np.radians(by_deg))
    round_m: Array = place_m @ np.array([[c, s], [-s, c]])
    return round_m


def nine(
    place_m: Array, height_m: Array | None = None, settings: PreflightSettings | None = None
) -> PreflightInputs:
    position = np.column_stack([place_m, np.zeros(9) if height_m is None else -height_m])
    fleet = FleetState(0.0, NINE, position, np.zeros((9, 3)), np.zeros(9), np.full(9, 0.1))
    rows = {name: row for row, name in enumerate(NINE)}
    settings = settings or PreflightSettings()
    return replace(known(settings=settings), fleet=fleet, rows=rows, uncertainty_m=np.full(9, 0.175))


def pattern(
    expected_m: Array = GRID_M, names: tuple[str, ...] = NINE, *, heading_deg: float = 30.0
) -> Pattern:
    return Pattern(expected_m, {name: row for row, name in enumerate(names)}, heading_deg)


def wrong(
    facts: PreflightInputs, flying: tuple[str, ...] = NINE, expected: Pattern | None = None
) -> dict[str, str]:
    """Problems by the vehicle's name or the fleet's check."""
    found = standing(facts, flying, expected or pattern())
    checks = [(check.name, check) for check in found.fleet]
    checks += [(name, check) for name, own in found.of.items() for check in own]
    assert all(check.limit and check.unit for _, check in checks if check.passes)
    assert all(check.to_do for _, check in checks if not check.passes)
    return {name: check.problem for name, check in checks if not check.passes}


def test_fleet_on_its_pads_passes_at_any_place() -> None:
    assert wrong(nine(GRID_M)) == {}
    far_m = turned(GRID_M, 77.0) + np.array((40.0, -12.0))
    assert wrong(nine(far_m), expected=pattern(far_m)) == {}


@pytest.mark.parametrize("by_deg", [7.0, -7.0, 90.0, 180.0])
def test_rotated_pattern_is_refused_with_angle_and_heading(
    by_deg: float,
) -> None:
    found = standing(nine(turned(GRID_M, by_deg)), NINE, pattern())
    (check,) = (check for check in found.fleet if not check.passes)
    assert check.name == "rotation of the start pattern"
    assert check.value is not None
    assert abs(check.value) == pytest.approx(abs(by_deg))
    assert f"{abs(by_deg):.1f} deg" in check.problem
    if abs(by_deg) < 180.0:
        assert ("counterclockwise" in check.problem) == (by_deg < 0.0)
        assert f"heading {(30.0 + by_deg) % 360.0:.1f} deg" in check.to_do
    assert all(check.passes for own in found.of.values() for check in own), "every vehicle is on its pad"


def test_pattern_shifted_by_5_m_is_refused_with_its_offset() -> None:
    assert wrong(nine(GRID_M + np.array((3.0, -4.0)))) == {
        "shift of the start pattern": "the start pattern is shifted by 5.0 m (+3.0 m along x, -4.0 m along y)"
        " from its middle (x 0.0 m, y 0.0 m), at most 2 m"
    }


def test_drawn_show_in_the_wrong_place_can_be_placed() -> None:
    found = standing(nine(GRID_M + np.array((3.0, -4.0))), NINE, replace(pattern(), drawn="night"))
    (check,) = (check for check in found.fleet if not check.passes)
    assert "gcs shows place night --fit yes" in check.to_do


def test_heading_wrong_by_7_degrees_shifts_distant_pads() -> None:
    away_m = GRID_M + np.array((40.0, 0.0))
    found = wrong(nine(turned(away_m, 7.0)), expected=pattern(away_m))
    assert set(found) == {"rotation of the start pattern", "shift of the start pattern"}
    assert "shifted by 4.9 m" in found["shift of the start pattern"]


def test_rotation_and_shift_within_their_limits_pass() -> None:
    assert wrong(nine(turned(GRID_M, 1.9) + np.array((1.3, 1.3)))) == {}


def test_limits_come_from_the_configuration() -> None:
    strict = PreflightSettings(rotation_max_deg=1.5, shift_max_m=1.0)
    found = wrong(nine(turned(GRID_M, 1.9) + np.array((1.3, 1.3)), settings=strict))
    assert set(found) == {"rotation of the start pattern", "shift of the start pattern"}


def test_only_two_swapped_vehicles_are_named() -> None:
    swapped_m = GRID_M[[0, 1, 2, 7, 4, 5, 6, 3, 8]]
    found = wrong(nine(turned(swapped_m, 1.0)))
    assert set(found) == {"d4", "d8"}
    assert found["d4"].endswith("m off its start place, on that of d8")
    assert found["d8"].endswith("m off its start place, on that of d4")


def test_one_displaced_vehicle_does_not_move_the_pattern() -> None:
    place_m = GRID_M.copy()
    place_m[2] += (0.0, 30.0)
    assert wrong(nine(place_m)) == {"d3": "stands 30.0 m off its start place"}


def test_fleet_in_another_pattern_is_reported() -> None:
    found = wrong(nine(np.column_stack([np.arange(9) * 4.0, np.zeros(9)])))
    assert "stand in the start pattern, however it is turned and shifted" in found["start pattern"]


def test_spare_takes_a_free_place_and_the_rest_are_named() -> None:
    expected = pattern(GRID_M[:8], NINE[:8])  # d9 is a spare
    place_m = GRID_M.copy()
    place_m[8] = GRID_M[3]  # and stands where d4 stood, which is out
    place_m[3] = (30.0, 30.0)
    assert wrong(nine(place_m), ("d1", "d2", "d3", "d5", "d6", "d7", "d8", "d9"), expected) == {}
    assert wrong(nine(GRID_M), NINE, expected) == {"d9": "has no place in the start pattern"}


def test_small_pattern_is_judged_without_a_rotation() -> None:
    two = ("d1", "d2")
    expected = pattern(np.array([[0.0, 0.0], [0.0, 4.0]]), two)
    place_m = np.zeros((9, 2))
    place_m[:2] = turned(expected.places_m, 6.0)
    assert wrong(nine(place_m), two, expected) == {}
    place_m[:2] = turned(expected.places_m, 12.0)
    assert "at most 7.1 deg" in wrong(nine(place_m), two, expected)["rotation of the start pattern"]
    alone = standing(nine(place_m), ("d1",), expected)
    assert [check.name for check in alone.fleet] == ["start pattern", "shift of the start pattern"]
    assert "too small to tell" in alone.not_checked[0]


def test_without_places_the_report_skips_the_pattern() -> None:
    found = standing(nine(GRID_M), NINE, None)
    assert found.fleet == []
    assert "preflight.start_places names no places" in found.not_checked[0]


def test_pad_at_another_height_is_named_against_the_median() -> None:
    height_m = np.full(9, 1.5)
    height_m[4] = -0.8
    assert wrong(nine(GRID_M, height_m)) == {
        "d5": "stands 2.3 m below the middle one of all pads, at most 2 m"
    }


def test_shared_problem_is_reported_once_with_its_remedy() -> None:
    red, blue = (
        Check("c", State.FAIL, problem=f"is {colour}", to_do="paint it") for colour in ("red", "blue")
    )
    fleet = Check("f", State.UNKNOWN, problem="not known")
    found = [("a", red), ("b", blue), ("c", red), (None, fleet), ("d", Check("c", State.PASS))]
    assert describe(found) == "a, c: is red; b: is blue; not known; a, b, c: paint it"
