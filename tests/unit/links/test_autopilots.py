"""What is known of each autopilot, compared with what a real one sent."""

from collections.abc import Callable
from math import nan

import numpy as np
import pytest

from gcs.links.autopilots import AUTOPILOTS, DEFAULT, Autopilot, CommandLong, SetParameter
from gcs.links.link import Command, ParameterValue, Verb
from gcs.links.settings import StreamSettings
from gcs.links.stream_requests import desired_rates
from gcs.links.telemetry import FleetTelemetry, VehicleReport
from gcs.mavlink import codec
from gcs.mavlink.framing import EKF_STATUS_REPORT, PARAM_VALUE
from gcs.model.response import FleetResponse, Response
from gcs.model.state import Landed, Mode, Telemetry
from gcs.safety.constraints import Braking
from tests.support.tlog_files import frames, read

PX4, ARDUPILOT = DEFAULT, AUTOPILOTS["ardupilot"]
EVERY = pytest.mark.parametrize("autopilot", AUTOPILOTS.values(), ids=list(AUTOPILOTS))

GUIDED, BRAKE, STABILIZE = 4, 17, 0
SINKING = {2, 5, 7, 16}
"""ALT_HOLD, LOITER, CIRCLE, POSHOLD: without a transmitter ArduCopter sinks in these."""


@pytest.mark.parametrize(
    ("main", "sub", "mode"),
    [
        (6, 0, Mode.OFFBOARD),
        (4, 2, Mode.TAKEOFF),
        (4, 3, Mode.HOLD),
        (4, 5, Mode.RETURN),
        (4, 6, Mode.LAND),
        (3, 0, Mode.POSITION),
        (4, 1, Mode.READY),
        (4, 4, Mode.OTHER),
        (1, 0, Mode.OTHER),
    ],
)
def test_px4_modes_have_our_names(main: int, sub: int, mode: Mode) -> None:
    assert PX4.mode(main << 16 | sub << 24) is mode


@pytest.mark.parametrize(
    ("number", "mode"),
    [
        (GUIDED, Mode.OFFBOARD),
        (BRAKE, Mode.HOLD),
        (6, Mode.RETURN),
        (21, Mode.RETURN),
        (9, Mode.LAND),
        (5, Mode.POSITION),
        (16, Mode.POSITION),
        (2, Mode.POSITION),
        (STABILIZE, Mode.OTHER),
        (3, Mode.OTHER),
        (7, Mode.OTHER),
        (4 << 16 | 3 << 24, Mode.OTHER),  # PX4's HOLD
    ],
)
def test_ardupilot_modes_have_our_names(number: int, mode: Mode) -> None:
    assert ARDUPILOT.mode(number) is mode


@EVERY
def test_every_command_leads_to_a_mode_that_it_explains(autopilot: Autopilot) -> None:
    for verb in set(Verb) - {Verb.KILL}:
        *_, last = autopilot.steps(Command("d1", verb, 5.0))
        assert isinstance(last, CommandLong)
        if last.command == 176:  # DO_SET_MODE
            custom = last.params[1] if len(last.params) == 2 else 0
            if len(last.params) == 3:
                custom = int(last.params[1]) << 16 | int(last.params[2]) << 24
            assert autopilot.mode(int(custom)) in autopilot.modes[verb], verb


def test_ardupilot_is_never_ordered_into_a_mode_that_sinks() -> None:
    ordered = {
        int(step.params[1])
        for verb in set(Verb) - {Verb.KILL}
        for step in ARDUPILOT.steps(Command("d1", verb, 5.0))
        if isinstance(step, CommandLong) and step.command == 176
    }
    assert ordered == {GUIDED, BRAKE, 6, 9}
    assert not ordered & SINKING


def test_takeoff_height_is_a_parameter_or_part_of_the_command() -> None:
    height, command = PX4.steps(Command("d1", Verb.TAKEOFF, 4.0))
    assert height == SetParameter("MIS_TAKEOFF_ALT", 4.0)
    assert isinstance(command, CommandLong)
    assert np.isnan(command.params).all(), "from where it stands"
    assert ARDUPILOT.steps(Command("d1", Verb.TAKEOFF, 4.0)) == (CommandLong(22, (0.0,) * 6 + (4.0,)),)


def test_ardupilot_climbs_in_guided_until_it_stands_in_the_air() -> None:
    climbs = ARDUPILOT.climb_ended
    assert not climbs(Mode.OFFBOARD, Landed.TAKEOFF, 0.0)
    assert not climbs(Mode.OFFBOARD, Landed.IN_AIR, 2.0), "it reports IN_AIR below the height"
    assert not climbs(Mode.OFFBOARD, Landed.IN_AIR, nan)
    assert climbs(Mode.OFFBOARD, Landed.IN_AIR, 0.1)
    assert PX4.climb_ended(Mode.HOLD, Landed.UNKNOWN, nan)


@pytest.mark.parametrize("value", [5, -3, 1, 0, 5.0, 0.25])
@EVERY
def test_parameter_survives_its_encoding(autopilot: Autopilot, value: ParameterValue) -> None:
    raw, kind = autopilot.encoded(value)
    decoded = autopilot.decoded(raw, kind)
    assert (decoded, type(decoded)) == (value, type(value))


def test_integers_are_bits_to_px4_and_numbers_to_ardupilot() -> None:
    """ArduCopter took a FENCE_ACTION of 4, sent as bits, for 0."""
    bits, number = PX4.encoded(4)[0], ARDUPILOT.encoded(4)[0]
    assert number[0] == 4.0
    assert bits[0] == pytest.approx(0.0, abs=1e-40)
    assert (bits.view(np.int32)[0], ARDUPILOT.decoded(bits, 2)) == (4, 0)


def test_recorded_parameters_of_ardupilot_are_read() -> None:
    values: dict[str, ParameterValue] = {}
    for _, frame in frames("ardupilot/session.tlog.xz"):
        if frame.message_id == PARAM_VALUE:
            data = np.frombuffer(bytearray(frame.raw), np.uint8)
            found = codec.find(data, np.array([0]), np.array([len(data)])).frames
            (message,) = codec.decode(PARAM_VALUE, data, found)
            raw = np.array([message["param_value"]], np.float32)
            values[codec.text(message["param_id"])] = ARDUPILOT.decoded(raw, int(message["param_type"]))
    expected = {"SYSID_MYGCS": 255, "RTL_ALT": 1500, "WPNAV_ACCEL": 100.0, "FENCE_TYPE": 7, "ARMING_CHECK": 1}
    assert {name: values[name] for name in expected} == expected
    assert {name: type(values[name]) for name in ("RTL_ALT", "WPNAV_ACCEL")} == {
        "RTL_ALT": int,
        "WPNAV_ACCEL": float,
    }


def test_ardupilot_is_asked_only_for_what_it_knows() -> None:
    desired_hz = desired_rates(StreamSettings())
    assert PX4.streams_hz(desired_hz) == desired_hz
    asked_hz = ARDUPILOT.streams_hz(desired_hz)
    accepted = {1, 2, 24, 30, 32, 33, 36, 74, 85, 87, 147, 193, 241, 245}  # as recorded
    assert set(asked_hz) == accepted
    assert asked_hz[EKF_STATUS_REPORT] > 0.0
    assert asked_hz[33] == desired_hz[33]


def story(
    name: str, autopilot: Autopilot, note: Callable[[float, FleetTelemetry, Telemetry], object]
) -> FleetTelemetry:
    """Read a recording as of one vehicle with that profile, and call `note` after each frame."""
    fleet = FleetTelemetry(("d1",), (autopilot,))
    for time_s, frame in frames(name):
        read(fleet, time_s, frame)
        note(time_s, fleet, fleet.telemetry())
    return fleet


def test_recorded_flight_of_ardupilot_is_understood() -> None:
    seen: list[tuple[Mode, bool, Landed]] = []

    def note(_time_s: float, _fleet: FleetTelemetry, now: Telemetry) -> None:
        state = now.mode[0], now.armed[0], now.landed[0]
        if not seen or seen[-1] != state:
            seen.append(state)

    story("ardupilot/session.tlog.xz", ARDUPILOT, note)
    modes = list(dict.fromkeys(mode for mode, *_ in seen))
    assert modes == [Mode.OTHER, Mode.OFFBOARD, Mode.RETURN]
    flown = [landed for mode, armed, landed in seen if armed and mode is Mode.OFFBOARD]
    assert list(dict.fromkeys(flown)) == [Landed.ON_GROUND, Landed.TAKEOFF, Landed.IN_AIR]
    assert seen[-1] == (Mode.RETURN, False, Landed.ON_GROUND), "it stays in the mode of its landing"


def test_ardupilot_is_ready_only_in_guided_with_a_position() -> None:
    """In STABILIZE its pre-arm bit was true 20 s before it had an estimate of its position."""
    ready, passed = [], []

    def note(time_s: float, fleet: FleetTelemetry, now: Telemetry) -> None:
        if fleet.prearm_ok[0]:
            passed.append((time_s, now.mode[0]))
        if now.ready[0]:
            ready.append((time_s, now.mode[0]))

    story("ardupilot/session.tlog.xz", ARDUPILOT, note)
    assert passed[0][1] is Mode.OTHER
    assert ready[0][0] > passed[0][0] + 20.0
    assert {mode for _, mode in ready} == {Mode.OFFBOARD}


@pytest.mark.parametrize(
    ("flags", "good"), [(165, False), (831, True), (831 | 0x80, False), (831 & ~0x10, False), (-1, False)]
)
def test_estimator_flags_decide_whether_ardupilot_is_ready(flags: int, good: bool) -> None:
    assert ARDUPILOT.ready(np.array([GUIDED]), np.array([flags])).tolist() == [good]
    assert not ARDUPILOT.ready(np.array([STABILIZE]), np.array([flags]))[0]


def test_ardupilot_in_a_failsafe_says_so_until_it_is_cleared() -> None:
    """After a battery failsafe it does not clear, whoever flies; it counts only outside control."""
    seen: list[tuple[Mode, bool]] = []

    def note(_time_s: float, _fleet: FleetTelemetry, now: Telemetry) -> None:
        state = now.mode[0], now.in_failsafe[0]
        if not seen or seen[-1] != state:
            seen.append(state)

    story("ardupilot/failsafes.tlog.xz", ARDUPILOT, note)
    first = seen.index((Mode.RETURN, True))
    assert seen[first : first + 3] == [(Mode.RETURN, True), (Mode.RETURN, False), (Mode.OFFBOARD, False)]
    assert (Mode.LAND, True) in seen
    assert (Mode.OFFBOARD, True) in seen


def test_other_autopilot_than_configured_is_named() -> None:
    fleet = story("ardupilot/session.tlog.xz", PX4, lambda *_: None)
    assert fleet.is_foreign.tolist() == [True]
    assert fleet.foreign(0) == "it reports ArduPilot, and is configured as PX4 (autopilot: px4)"
    assert fleet.telemetry().mode == (Mode.OTHER,)
    assert VehicleReport(fleet, 0).mode is Mode.OTHER
    assert not fleet.telemetry().ready[0]
    assert not story("ardupilot/session.tlog.xz", ARDUPILOT, lambda *_: None).is_foreign[0]


@pytest.mark.parametrize(
    ("accel_cm_s2", "stops_m"),
    [
        (100.0, {2: 2.6, 4: 8.6, 5: 13.0, 8: 32.6, 10: 50.7}),
        (250.0, {2: 1.5, 4: 4.5, 5: 6.6, 8: 14.6, 10: 21.5}),
    ],
)
def test_every_recorded_stop_is_within_what_the_filter_counts_on(
    accel_cm_s2: float, stops_m: dict[int, float]
) -> None:
    """The farthest points of recorded stops, from these speeds."""
    response = ARDUPILOT.response({"WPNAV_ACCEL": accel_cm_s2, "PILOT_ACCEL_Z": 250.0})
    assert response.acceleration_m_s2 == pytest.approx(0.8 * accel_cm_s2 / 100.0)
    braking = Braking().of_slowest(FleetResponse.of([response]))
    for speed_m_s, farthest_m in stops_m.items():
        assert float(braking.speed_m_s(np.array([farthest_m]))[0]) <= speed_m_s


def test_gentler_axis_counts_and_none_is_trusted_unread() -> None:
    assert ARDUPILOT.response({"WPNAV_ACCEL": 500.0, "PILOT_ACCEL_Z": 200}).acceleration_m_s2 == 1.6
    assert ARDUPILOT.response({}).acceleration_m_s2 == 0.8
    assert ARDUPILOT.response({"WPNAV_ACCEL": 0.0}).acceleration_m_s2 == 0.4


def test_control_is_set_for_px4() -> None:
    assert PX4.response({"MPC_ACC_HOR": 1.0}) == Response()
