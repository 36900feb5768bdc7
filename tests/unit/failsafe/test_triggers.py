"""The rules of failsafes: thresholds, how long a cause must last, what comes first, and bad settings."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from gcs.config.schema import Config
from gcs.failsafe.arbitration import SHOW_ROW, Standing, due, keys
from gcs.failsafe.policy import SEVERITY, Action, Cause, FailsafePolicy
from gcs.failsafe.triggers import FailsafeRequest, Known, Roles, Seen, advance, is_calm, look
from gcs.safety.fenced_areas import FencedArea
from gcs.safety.walls import Fence

N = 8
TICK_S = 0.05
FENCE = Fence(height_min_m=3.0, height_max_m=50.0, distance_max_m=100.0)
ALL_SHOW = frozenset({Action.PAUSE, Action.RE_FORM, Action.HOLD_TARGET, Action.RETURN, Action.LAND})


def calm(**changes: Any) -> Seen:
    """Eight stand 20 m up, well, as they are told."""
    still = np.zeros((N, 3))
    seen = Seen(
        time_s=0.0,
        position_m=np.column_stack([4.0 * np.arange(N), np.zeros(N), np.full(N, -20.0)]),
        velocity_m_s=still,
        desired_m_s=still,
        battery=np.full(N, 0.8),
        horizontal_m=np.full(N, 0.9),
        vertical_m=np.full(N, 1.8),
        unbelieved=np.zeros(N, dtype=np.bool_),
        doubts=np.zeros(N, dtype=np.int64),
        silent=np.zeros(N, dtype=np.bool_),
        reset_time_s=np.full(N, -np.inf),
        fence=FENCE,
        target_age_s=np.nan,
        late_s=0.0,
        link_late_s=np.zeros(N),
        link_share=np.ones(N),
    )
    return replace(seen, **changes)


def one(value: float, others: float) -> np.ndarray[Any, Any]:
    """(n,) another value for the first."""
    values = np.full(N, others)
    values[0] = value
    return values


class Rules:
    """Rules that are asked tick by tick, as in flight: nothing more than telemetry while it is calm."""

    def __init__(self, **settings: Any) -> None:
        self.settings = FailsafePolicy(**settings)
        self.known = Known.nothing(N, 0.0, self.settings)
        self.now_s = 0.0
        self.lost = np.zeros(N, dtype=np.bool_)
        self.flying = np.ones(N, dtype=np.bool_)
        self.paused_s = 0.0
        self.was_calm = True

    def see(self, seen: Seen, for_s: float = TICK_S) -> tuple[FailsafeRequest, ...]:
        """The same for a while. Returns: what is wanted at the end."""
        requests: tuple[FailsafeRequest, ...] = ()
        for _ in range(round(for_s / TICK_S)):
            self.now_s += TICK_S
            now = replace(seen, time_s=self.now_s, silent=self.lost.copy())
            known, on, weather = look(now, self.known, self.settings)
            self.was_calm = is_calm(on, known, now, self.settings, weather)
            if self.was_calm:
                self.known, requests = known, ()
                continue
            roles = Roles(self.flying & ~self.lost, self.flying & ~self.lost, self.lost, self.paused_s)
            self.known, requests = advance(on, roles, now, known, self.settings, weather)
        return requests


def describe(requests: tuple[FailsafeRequest, ...]) -> list[tuple[Cause, Action, tuple[int, ...]]]:
    return [(request.cause, request.action, request.rows) for request in requests]


def test_normal_flight_requests_nothing() -> None:
    rules = Rules()
    assert rules.see(calm(), 5.0) == ()
    assert rules.was_calm


def test_an_area_of_the_fence_is_left_like_the_fence() -> None:
    """The last vehicles are at x 24 and 28 m: within 30 m, and beyond 20 m; NaN is nowhere."""

    def within(x_m: float) -> Fence:
        corners_m = (-5.0, -5.0), (x_m, -5.0), (x_m, 5.0), (-5.0, 5.0)
        return FENCE.model_copy(update={"areas": (FencedArea(corners_m=corners_m),)})

    assert Rules().see(calm(fence=within(30.0)), 9.0) == ()
    beyond = calm(fence=within(20.0))
    found = Rules().see(beyond, 9.0)
    assert [(request.cause, request.rows) for request in found] == [(Cause.FENCE, (6, 7))]
    nowhere = np.array(beyond.position_m)
    nowhere[7] = np.nan
    assert [request.rows for request in Rules().see(replace(beyond, position_m=nowhere), 9.0)] == [(6,)]


@pytest.mark.parametrize(
    ("changes", "after_s", "cause", "action"),
    [
        ({"battery": one(0.19, 0.8)}, 2.0, Cause.LOW_BATTERY, Action.RETURN),
        ({"horizontal_m": one(4.1, 0.9)}, 3.0, Cause.BAD_POSITION, Action.HOLD),
        ({"vertical_m": one(8.1, 1.8)}, 3.0, Cause.BAD_POSITION, Action.HOLD),
        ({"horizontal_m": one(np.inf, 0.9)}, 3.0, Cause.BAD_POSITION, Action.HOLD),
        ({"unbelieved": one(1.0, 0.0).astype(np.bool_)}, 0.3, Cause.BAD_POSITION, Action.HOLD),
    ],
)
def test_cause_starts_after_its_delay_and_ends_after_absence(
    changes: dict[str, Any], after_s: float, cause: Cause, action: Action
) -> None:
    rules, bad = Rules(), calm(**changes)
    assert rules.see(bad, after_s - TICK_S) == ()
    assert describe(rules.see(bad, 3 * TICK_S)) == [(cause, action, (0,))]
    assert describe(rules.see(calm(), 4.9)) == [(cause, action, (0,))]
    assert rules.see(calm(), 0.2) == ()


@pytest.mark.parametrize(
    "changes",
    [
        {"battery": one(0.2, 0.8)},
        {"battery": np.full(N, np.nan)},
        {"horizontal_m": one(4.0, 0.9), "vertical_m": one(8.0, 1.8)},
        {"horizontal_m": np.full(N, np.nan), "vertical_m": np.full(N, np.nan)},
        {"target_age_s": 5.0},
        {"late_s": 0.05},
        {"desired_m_s": np.full((N, 3), np.nan), "velocity_m_s": np.full((N, 3), 4.0) * [1, 1, 0]},
    ],
)
def test_at_the_threshold_or_unknown_nothing_happens(changes: dict[str, Any]) -> None:
    assert Rules().see(calm(**changes), 20.0) == ()


def test_battery_near_its_limit_is_one_low_battery_event() -> None:
    rules = Rules()
    for _ in range(5):
        assert describe(rules.see(calm(battery=one(0.195, 0.8)), 8.0)) == [
            (Cause.LOW_BATTERY, Action.RETURN, (0,))
        ]
        requests = rules.see(calm(battery=one(0.215, 0.8)), 8.0)
        assert describe(requests) == [(Cause.LOW_BATTERY, Action.RETURN, (0,))]
        assert requests[0].since_s < 2.2, "the first, and no other"
    assert rules.see(calm(battery=one(0.24, 0.8)), 5.2) == ()


def test_condition_shorter_than_its_delay_is_no_cause() -> None:
    rules = Rules()
    for _ in range(20):
        assert rules.see(calm(horizontal_m=one(9.0, 0.9)), 1.0) == ()
        assert rules.see(calm(), 0.5) == ()


def test_a_critical_battery_is_more_severe_than_a_low_one() -> None:
    requests = Rules().see(calm(battery=one(0.09, 0.8)), 2.2)
    assert describe(requests) == [
        (Cause.CRITICAL_BATTERY, Action.LAND, (0,)),
        (Cause.LOW_BATTERY, Action.RETURN, (0,)),
    ]
    assert "9%" in requests[0].reason


def test_lasting_bad_position_lands_only_that_vehicle() -> None:
    rules, bad = Rules(), calm(horizontal_m=one(9.0, 0.9))
    rules.see(bad, 8.0)
    both = calm(horizontal_m=np.where(np.arange(N) < 2, 9.0, 0.9))
    assert describe(rules.see(both, 5.5)) == [
        (Cause.BAD_POSITION, Action.LAND, (0,)),
        (Cause.BAD_POSITION, Action.HOLD, (1,)),
    ]


@pytest.mark.parametrize(("apart_s", "found"), [(14.0, True), (16.0, False)])
def test_three_jumps_within_half_a_minute_are_a_bad_position(apart_s: float, found: bool) -> None:
    rules = Rules()
    for _ in range(2):
        assert rules.see(calm(reset_time_s=one(rules.now_s + TICK_S, -np.inf)), apart_s) == ()
    requests = rules.see(calm(reset_time_s=one(rules.now_s + TICK_S, -np.inf)), 0.5)
    assert describe(requests) == ([(Cause.BAD_POSITION, Action.HOLD, (0,))] if found else [])


@pytest.mark.parametrize(
    ("x_m", "height_m", "velocity_m_s", "crosses"),
    [
        (98.0, 20.0, (2.4, 0.0, 0.0), False),
        (98.0, 20.0, (2.6, 0.0, 0.0), True),
        (98.0, 20.0, (-5.0, 0.0, 0.0), False),
        (0.0, 49.0, (0.0, 0.0, -1.6), True),
        (0.0, 4.0, (0.0, 0.0, 1.4), False),
        (0.0, 4.0, (0.0, 0.0, 1.6), True),
        (101.0, 20.0, (0.0, 0.0, 0.0), True),
    ],
)
def test_fence_is_ahead_where_the_path_leaves_it(
    x_m: float, height_m: float, velocity_m_s: tuple[float, float, float], crosses: bool
) -> None:
    position_m, flown_m_s = calm().position_m.copy(), np.zeros((N, 3))
    position_m[0], flown_m_s[0] = (x_m, 0.0, -height_m), velocity_m_s
    requests = Rules().see(calm(position_m=position_m, velocity_m_s=flown_m_s, desired_m_s=flown_m_s), 0.5)
    assert describe(requests) == ([(Cause.FENCE, Action.RETURN, (0,))] if crosses else [])


def test_braking_at_the_fence_as_filtered_is_no_fence_breach() -> None:
    """v t + v^2 / 2 a = gap, with the filter's 0.8 s and 2 m/s^2: see decision 0004."""
    for gap_m in np.linspace(0.0, 20.0, N):
        speed_m_s = 2.0 * (np.sqrt(0.8**2 + gap_m) - 0.8)
        position_m, flown_m_s = calm().position_m.copy(), np.zeros((N, 3))
        position_m[0, 0], flown_m_s[0, 0] = FENCE.distance_max_m - gap_m, speed_m_s + 0.3  # and noise
        seen = calm(position_m=position_m, velocity_m_s=flown_m_s, desired_m_s=flown_m_s)
        assert Rules().see(seen, 1.0) == ()


@pytest.mark.parametrize(("blown", "found"), [(3, False), (4, True)])
def test_wind_is_too_strong_when_half_cannot_follow_setpoints(blown: int, found: bool) -> None:
    flown_m_s = np.where((np.arange(N) < blown)[:, None], (1.8, 0.0, 0.0), 0.0)
    rules, windy = Rules(), calm(velocity_m_s=flown_m_s)
    assert rules.see(windy, 5.0) == ()
    assert describe(rules.see(windy, 3.0)) == ([(Cause.WIND, Action.PAUSE, ())] if found else [])
    rules.paused_s = 11.0
    assert describe(rules.see(windy, 7.0)) == ([(Cause.WIND, Action.PAUSE, ())] if found else [])
    assert describe(rules.see(windy, 2.0)) == ([(Cause.WIND, Action.RETURN, ())] if found else [])


def test_oscillation_about_the_setpoint_is_not_wind() -> None:
    rules = Rules()
    for beat in range(40):
        flown_m_s = np.full((N, 3), 2.5 if beat % 2 else -2.5) * (1.0, 0.0, 0.0)
        assert rules.see(calm(velocity_m_s=flown_m_s), 0.4) == ()


def test_wind_after_a_resume_does_not_escalate_to_a_return() -> None:
    rules, windy = Rules(), calm(velocity_m_s=np.full((N, 3), 2.0) * (1.0, 0.0, 0.0))
    assert describe(rules.see(windy, 40.0)) == [(Cause.WIND, Action.PAUSE, ())]


@pytest.mark.parametrize(("lost", "found"), [(1, False), (2, True)])
def test_too_many_are_lost_when_count_and_share_are_reached(lost: int, found: bool) -> None:
    rules = Rules()
    rules.lost[:lost] = True
    causes = [request.cause for request in rules.see(calm())]
    assert (Cause.VEHICLES_LOST in causes) is found
    assert Cause.VEHICLE_LOST in causes
    few = Rules(vehicles_lost={"share": 0.3})
    few.lost[:lost] = True
    assert Cause.VEHICLES_LOST not in [request.cause for request in few.see(calm())]


def test_a_target_is_stale_when_it_was_not_renewed() -> None:
    rules = Rules()
    assert describe(rules.see(calm(target_age_s=5.1))) == [(Cause.TARGET_STALE, Action.HOLD_TARGET, ())]
    assert rules.see(calm(target_age_s=0.1), 5.2) == ()


def test_service_is_late_when_it_lasts_not_after_one_stall() -> None:
    rules = Rules()
    assert rules.see(calm(late_s=0.1), 3.0) == ()
    assert describe(rules.see(calm(late_s=0.1), 1.0)) == [(Cause.SERVICE_LATE, Action.PAUSE, ())]
    stalled = Rules()
    stalled.see(calm(late_s=20.0))
    assert stalled.see(calm(), 10.0) == ()


def test_without_vehicles_in_the_air_there_is_no_failsafe() -> None:
    rules = Rules()
    rules.flying[:] = False
    bad = calm(
        battery=np.zeros(N),
        horizontal_m=np.full(N, 9.0),
        late_s=1.0,
        target_age_s=9.0,
        position_m=np.zeros((N, 3)),
    )
    assert rules.see(bad, 10.0) == ()


def test_ignored_cause_requests_nothing() -> None:
    ignored = {"action": "ignore"}
    rules = Rules(
        low_battery=ignored, wind=ignored, vehicles_lost=ignored, target_stale=ignored, service_late=ignored
    )
    rules.lost[5:] = True
    blown = np.full((N, 3), 3.0) * (1.0, 0.0, 0.0)
    bad = calm(battery=np.full(N, 0.15), velocity_m_s=blown, target_age_s=99.0, late_s=0.5)
    assert [request.cause for request in rules.see(bad, 20.0)] == [Cause.VEHICLE_LOST]


# what comes first


def request(cause: Cause, action: Action, *rows: int, whole_show: bool = False) -> FailsafeRequest:
    return FailsafeRequest(cause, action, 0.0, rows, whole_show, "because")


def standing(show: int = 0, **vehicles: int) -> Standing:
    severities = np.zeros(N)
    for name, severity in vehicles.items():
        severities[int(name[1:])] = severity
    return Standing(show, severities, ALL_SHOW)


WINDY = request(Cause.WIND, Action.PAUSE, whole_show=True)
LOST_MANY = request(Cause.VEHICLES_LOST, Action.RETURN, 6, 7, whole_show=True)
LOW = request(Cause.LOW_BATTERY, Action.RETURN, 0)
CRITICAL = request(Cause.CRITICAL_BATTERY, Action.LAND, 0)
POOR = request(Cause.BAD_POSITION, Action.HOLD, 0)


def test_the_most_severe_wins() -> None:
    show, vehicles = due([CRITICAL, LOST_MANY, LOW, POOR, WINDY], standing(), {}, 0.5)
    assert show is LOST_MANY
    assert describe(vehicles) == [(Cause.CRITICAL_BATTERY, Action.LAND, (0,))]


def test_running_action_is_not_replaced_by_an_equal_or_weaker() -> None:
    return_settings = standing(SEVERITY[Action.RETURN], v0=SEVERITY[Action.RETURN])
    assert due([LOST_MANY, LOW, POOR, WINDY], return_settings, {}, 0.5) == (None, ())
    show, vehicles = due([CRITICAL, LOW], return_settings, {}, 0.5)
    assert show is None
    assert describe(vehicles) == [(Cause.CRITICAL_BATTERY, Action.LAND, (0,))]


def test_vehicle_not_under_our_control_is_left_alone() -> None:
    not_ours = replace(standing(), vehicles=one(np.nan, 0.0))
    assert due([CRITICAL, LOW, POOR], not_ours, {}, 0.5) == (None, ())


def test_handled_request_repeats_only_with_higher_severity() -> None:
    acted = {(Cause.LOW_BATTERY, 0): LOW.severity, (Cause.WIND, SHOW_ROW): WINDY.severity}
    assert due([LOW, WINDY], standing(), acted, 0.5) == (None, ())
    worse = request(Cause.WIND, Action.RETURN, whole_show=True)
    show, vehicles = due([worse, CRITICAL, LOW], standing(), acted, 0.5)
    assert show is worse
    assert describe(vehicles) == [(Cause.CRITICAL_BATTERY, Action.LAND, (0,))]
    both = request(Cause.LOW_BATTERY, Action.RETURN, 0, 1)
    assert describe(due([both], standing(), acted, 0.5)[1]) == [(Cause.LOW_BATTERY, Action.RETURN, (1,))]


def test_when_many_must_leave_the_whole_fleet_returns() -> None:
    half = request(Cause.LOW_BATTERY, Action.RETURN, 0, 1, 2, 3)
    show, vehicles = due([half], standing(), {}, 0.5)
    assert show is not None
    assert (show.action, show.whole_show, show.rows) == (Action.RETURN, True, (0, 1, 2, 3))
    assert "4 of 8" in show.reason
    assert vehicles == ()
    fewer = replace(half, rows=(0, 1, 2))
    assert due([fewer], standing(), {}, 0.5) == (None, (fewer,))


def test_request_that_is_not_possible_now_waits() -> None:
    climbing = replace(standing(), possible=frozenset({Action.RETURN, Action.LAND}))
    assert due([WINDY], climbing, {}, 0.5) == (None, ())
    assert due([WINDY], standing(), {}, 0.5)[0] is WINDY
    assert keys(WINDY) == [(Cause.WIND, SHOW_ROW)]


# settings


@pytest.mark.parametrize(
    ("failsafes", "words"),
    [
        ({"low_battery": {"action": "pause"}}, "low_battery.action"),
        ({"low_battery": {"below": 1.5}}, "low_battery.below"),
        ({"low_battery": {"below": 0.1, "critical_below": 0.2}}, "critical_below = 0.2: less than below"),
        ({"bad_position": {"action": "ignore"}}, "bad_position.action"),
        ({"bad_position": {"jumps": 0}}, "bad_position.jumps"),
        ({"fence": {"within_s": 0}}, "fence.within_s"),
        ({"wind": {"speed_error_m_s": -1}}, "wind.speed_error_m_s"),
        ({"wind": {"share": float("nan")}}, "wind.share"),
        ({"vehicles_lost": {"count": 0}}, "vehicles_lost.count"),
        ({"vehicle_lost": {"action": "ignore"}}, "vehicle_lost.action"),
        ({"target_stale": {"after_s": 0}}, "target_stale.after_s"),
        ({"service_late": {"action": "land"}}, "service_late.action"),
        ({"low_batery": {}}, "low_batery"),
        ({"clear_s": 0}, "clear_s"),
    ],
)
def test_inconsistent_settings_are_refused_by_name(failsafes: dict[str, Any], words: str) -> None:
    raw = {
        "show_frame": {"latitude_deg": 47.0, "longitude_deg": 8.0, "altitude_amsl_m": 400.0},
        "links": [{"name": "one", "listen": "udpin://127.0.0.1:14540", "vehicles": {"count": 1}}],
        "formation": {"radius_m": 6.0, "height_m": 14.0},
    }
    assert Config.model_validate(raw).failsafes == FailsafePolicy()
    with pytest.raises(ValidationError, match=words.replace(".", r"\.")):
        Config.model_validate({**raw, "failsafes": failsafes})


ASTRAY = calm(velocity_m_s=np.full((N, 3), 2.0) * [1, 0, 0])
"""The velocities of all are 2 m/s off their setpoints."""


def test_deviation_over_prompt_links_is_wind() -> None:
    assert describe(Rules().see(ASTRAY, 8.0)) == [(Cause.WIND, Action.PAUSE, ())]


@pytest.mark.parametrize(
    "poor", [{"link_late_s": np.full(N, 0.35)}, {"link_share": np.full(N, 0.4)}], ids=["late", "lossy"]
)
def test_deviation_over_late_links_is_not_wind(poor: dict[str, Any]) -> None:
    requests = Rules().see(replace(ASTRAY, **poor), 20.0)
    assert describe(requests) == [(Cause.LINKS_LATE, Action.PAUSE, ())]
    assert "8 of 8" in requests[0].reason


def test_late_service_that_recovers_sends_no_vehicle_home() -> None:
    """As it was flown: "16 ms late on average, at most 50 ms; a pause of 10 s did not help"."""
    rules, late = Rules(), calm(late_s=0.09)
    assert describe(rules.see(late, 6.0)) == [(Cause.SERVICE_LATE, Action.PAUSE, ())]
    rules.paused_s = 30.0
    for _ in range(8):  # a hiccup now and then keeps the cause from ending, no more
        (request,) = rules.see(calm(late_s=0.0), 4.0)
        assert request.action is Action.PAUSE
        assert "over for" in request.reason
        rules.see(calm(late_s=0.2), 0.6)
    requests = rules.see(late, 6.0)
    assert describe(requests) == [(Cause.SERVICE_LATE, Action.RETURN, ())], (
        "it is late now, and a pause did not help"
    )


def test_wind_that_dropped_sends_no_vehicle_home() -> None:
    rules = Rules()
    rules.see(ASTRAY, 8.0)
    rules.paused_s = 30.0
    (request,) = rules.see(calm(), 3.0)
    assert request.action is Action.PAUSE
    assert describe(rules.see(ASTRAY, 9.0)) == [(Cause.WIND, Action.RETURN, ())]


def test_recovered_position_is_not_landed() -> None:
    rules, bad = Rules(), calm(horizontal_m=one(5.0, 0.9))
    assert describe(rules.see(bad, 9.0)) == [(Cause.BAD_POSITION, Action.HOLD, (0,))]
    assert describe(rules.see(calm(), 4.5)) == [(Cause.BAD_POSITION, Action.HOLD, (0,))]
    assert describe(rules.see(bad, 2.0)) == [(Cause.BAD_POSITION, Action.HOLD, (0,))], (
        "not for long enough again"
    )
    assert describe(rules.see(bad, 2.0)) == [(Cause.BAD_POSITION, Action.LAND, (0,))]
