from math import nan

from gcs.links.setpoint_watchdog import ExpectedSetpoints, HeartbeatGate, SetpointWatchdog


def test_nothing_is_allowed_before_the_first_tick() -> None:
    assert not SetpointWatchdog(0.2).allows(1, 0.0)


def test_a_listed_vehicle_is_allowed_for_the_hold_time_only() -> None:
    setpoint_watchdog = SetpointWatchdog(0.2)
    setpoint_watchdog.refresh([1, 2], 10.0)
    assert setpoint_watchdog.allows(1, 10.0)
    assert setpoint_watchdog.allows(2, 10.2)
    assert not setpoint_watchdog.allows(2, 10.2001)


def test_a_vehicle_no_longer_listed_is_forbidden_at_once() -> None:
    setpoint_watchdog = SetpointWatchdog(0.2)
    setpoint_watchdog.refresh([1, 2], 10.0)
    setpoint_watchdog.refresh([2], 10.05)
    assert not setpoint_watchdog.allows(1, 10.05)
    assert setpoint_watchdog.allows(2, 10.25)


def test_broadcast_is_never_allowed() -> None:
    setpoint_watchdog = SetpointWatchdog(0.2)
    setpoint_watchdog.refresh([0, 1], 10.0)
    assert not setpoint_watchdog.allows(0, 10.0)


def test_time_that_is_nan_allows_nothing() -> None:
    setpoint_watchdog = SetpointWatchdog(0.2)
    setpoint_watchdog.refresh([1], nan)
    assert not setpoint_watchdog.allows(1, 10.0)


def test_only_the_newest_request_is_new() -> None:
    asked = ExpectedSetpoints()
    assert not asked.is_newest(1, b"")
    asked.replace({1: b"north", 2: b"east"})
    assert asked.is_newest(1, b"north")
    assert not asked.is_newest(1, b"east")
    asked.replace({2: b"south"})
    assert not asked.is_newest(1, b"north")
    assert not asked.is_newest(2, b"east")


def test_heartbeat_gate_stays_open_for_its_hold_time() -> None:
    heartbeat_gate = HeartbeatGate(3.0)
    assert not heartbeat_gate.is_alive(0.0)
    heartbeat_gate.beat(10.0)
    assert heartbeat_gate.is_alive(13.0)
    assert not heartbeat_gate.is_alive(13.001)
    heartbeat_gate.beat(20.0)
    assert heartbeat_gate.is_alive(20.0)


def test_heartbeat_gate_is_closed_at_a_time_that_is_nan() -> None:
    heartbeat_gate = HeartbeatGate(3.0)
    heartbeat_gate.beat(nan)
    assert not heartbeat_gate.is_alive(1.0)
