"""What telemetry does to a vehicle's phase, rule by rule."""

import numpy as np
import pytest

from gcs.control import Task
from gcs.failsafe.autopilot_failsafe import FailsafeCause
from gcs.flight.state.vehicle import LANDED_UNKNOWN, Vehicle, VehicleStatus, require_phase
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import AIRBORNE, Event, Phase, ShowPhase
from gcs.model.state import Landed, Mode

HERE_M = np.array([1.0, 2.0, -5.0])
FLOWN_BY_US = frozenset({Mode.OFFBOARD, Mode.HOLD, Mode.TAKEOFF})
COMMANDED = sorted(AIRBORNE)


def vehicle(phase: Phase, *, modes: frozenset[Mode] = FLOWN_BY_US) -> Vehicle:
    return Vehicle("d1", 0, 1, "link", phase=phase, modes=modes)


def status(
    *, silent: bool = False, mode: Mode = Mode.OFFBOARD, armed: bool = True, landed: Landed = Landed.IN_AIR
) -> VehicleStatus:
    lacks = "no telemetry for 2.1 s" if silent else ""
    return VehicleStatus(silent, mode, armed, landed, lacks=lacks)


ON_GROUND = status(mode=Mode.HOLD, armed=False, landed=Landed.ON_GROUND)


def test_vehicle_never_received_stays_offline() -> None:
    subject = vehicle(Phase.OFFLINE)
    assert not subject.observe(status(silent=True))
    assert subject.phase is Phase.OFFLINE


def test_vehicle_received_on_the_ground_is_on_standby() -> None:
    subject = vehicle(Phase.OFFLINE)
    assert subject.observe(ON_GROUND)
    assert subject.phase is Phase.STANDBY


@pytest.mark.parametrize("phase", [Phase.OFFLINE, Phase.STANDBY])
@pytest.mark.parametrize("landed", [Landed.IN_AIR, Landed.TAKEOFF, Landed.LANDING])
def test_airborne_without_a_command_is_pilot_control(phase: Phase, landed: Landed) -> None:
    subject = vehicle(phase)
    assert subject.observe(status(landed=landed))
    assert subject.phase is Phase.PILOT
    assert "without a command of this station" in subject.reason


def test_an_armed_vehicle_on_the_ground_is_still_on_standby() -> None:
    subject = vehicle(Phase.STANDBY)
    assert not subject.observe(status(landed=Landed.ON_GROUND, mode=Mode.HOLD))


def test_armed_and_possibly_airborne_is_not_on_the_ground() -> None:
    subject = vehicle(Phase.STANDBY)
    assert subject.observe(status(landed=Landed.UNKNOWN, mode=Mode.HOLD))
    assert subject.phase is Phase.PILOT


def test_unknown_landed_state_keeps_it_offline_with_the_reason() -> None:
    subject = vehicle(Phase.OFFLINE)
    assert not subject.observe(status(landed=Landed.UNKNOWN))
    assert subject.reason == LANDED_UNKNOWN


def test_vehicle_silent_on_the_ground_is_offline() -> None:
    subject = vehicle(Phase.STANDBY)
    assert subject.observe(status(silent=True))
    assert subject.phase is Phase.OFFLINE
    assert subject.reason == "no telemetry for 2.1 s"


@pytest.mark.parametrize("phase", [*COMMANDED, Phase.PILOT])
def test_vehicle_silent_in_the_air_is_lost(phase: Phase) -> None:
    subject = vehicle(phase)
    assert subject.observe(status(silent=True))
    assert subject.phase is Phase.LOST
    assert subject.reason == "no telemetry for 2.1 s"


@pytest.mark.parametrize("phase", COMMANDED)
@pytest.mark.parametrize("mode", [Mode.POSITION, Mode.RETURN, Mode.LAND, Mode.OTHER, Mode.UNKNOWN])
def test_unexplained_mode_gives_the_pilot_control(phase: Phase, mode: Mode) -> None:
    subject = vehicle(phase)
    assert subject.observe(status(mode=mode))
    assert subject.phase is Phase.PILOT
    assert "this station did not command" in subject.reason


@pytest.mark.parametrize("phase", COMMANDED)
@pytest.mark.parametrize("mode", sorted(FLOWN_BY_US))
def test_mode_explained_by_a_command_changes_nothing(phase: Phase, mode: Mode) -> None:
    subject = vehicle(phase)
    assert not subject.observe(status(mode=mode))
    assert subject.phase is phase


@pytest.mark.parametrize("phase", [*COMMANDED, Phase.PILOT])
def test_motors_off_means_on_the_ground_in_any_mode(phase: Phase) -> None:
    subject = vehicle(phase)
    assert subject.observe(status(mode=Mode.POSITION, armed=False, landed=Landed.ON_GROUND))
    assert subject.phase is Phase.STANDBY


@pytest.mark.parametrize("mode", sorted(set(Mode) - {Mode.TERMINATED}))
def test_piloted_vehicle_stays_piloted_in_every_mode(mode: Mode) -> None:
    subject = vehicle(Phase.PILOT)
    assert not subject.observe(status(mode=mode))
    assert subject.phase is Phase.PILOT


@pytest.mark.parametrize("mode", [Mode.OFFBOARD, Mode.HOLD])
def test_lost_vehicle_that_waits_needs_a_hold_command(mode: Mode) -> None:
    subject = vehicle(Phase.LOST)
    assert not subject.observe(status(mode=mode))
    assert subject.phase is Phase.LOST


def test_hold_command_takes_control_of_a_lost_vehicle() -> None:
    subject = vehicle(Phase.LOST)
    subject.apply(Event.HOLD, "holds as commanded")
    assert subject.phase is Phase.HOLD
    assert subject.reason == "holds as commanded"


@pytest.mark.parametrize("mode", [Mode.TAKEOFF, Mode.LAND])
def test_lost_vehicle_back_in_a_commanded_mode_is_not_piloted(mode: Mode) -> None:
    subject = vehicle(Phase.LOST)
    subject.modes = frozenset({mode})
    assert not subject.observe(status(mode=mode))
    assert subject.phase is Phase.LOST


@pytest.mark.parametrize("mode", sorted(set(Mode) - {Mode.OFFBOARD, Mode.HOLD, Mode.TERMINATED}))
def test_lost_vehicle_back_in_an_uncommanded_mode_is_piloted(mode: Mode) -> None:
    subject = vehicle(Phase.LOST)
    subject.modes = frozenset({Mode.OFFBOARD})
    assert subject.observe(status(mode=mode))
    assert subject.phase is Phase.PILOT
    assert "received again" in subject.reason


def test_lost_vehicle_back_with_motors_off_is_on_standby() -> None:
    subject = vehicle(Phase.LOST)
    assert subject.observe(ON_GROUND)
    assert subject.phase is Phase.STANDBY


def test_a_lost_vehicle_stays_lost_while_it_is_silent() -> None:
    subject = vehicle(Phase.LOST)
    assert not subject.observe(status(silent=True))


@pytest.mark.parametrize(
    "telemetry", [status(), ON_GROUND, status(silent=True), status(mode=Mode.LAND, landed=Landed.LANDING)]
)
def test_no_telemetry_brings_a_killed_vehicle_back(telemetry: VehicleStatus) -> None:
    subject = vehicle(Phase.KILLED)
    assert not subject.observe(telemetry)
    assert subject.phase is Phase.KILLED


@pytest.mark.parametrize(
    ("phase", "event"),
    [(Phase.FORMATION, Event.HOLD), (Phase.RETURN, Event.SILENT), (Phase.LANDING, Event.TAKEN_OVER)],
)
def test_leaving_flown_phases_clears_goal_and_handover(phase: Phase, event: Event) -> None:
    subject = vehicle(phase)
    subject.goal_m = HERE_M
    subject.set_flags(entering_offboard=True, handed_over=True)
    subject.apply(event, "for a test")
    left: list[object] = [subject.goal_m, subject.flags.entering_offboard, subject.flags.handed_over]
    assert left == [None, False, False]


def test_a_goal_is_kept_from_return_to_landing() -> None:
    subject = vehicle(Phase.RETURN)
    subject.goal_m = HERE_M
    subject.apply(Event.DESCEND, "above its start")
    assert subject.goal_m is HERE_M


def test_event_outside_the_table_changes_nothing() -> None:
    subject = vehicle(Phase.STANDBY)
    with pytest.raises(RefusedError):
        subject.apply(Event.ENGAGE, "for a test")
    assert subject.phase is Phase.STANDBY


def test_required_phase_names_the_vehicle_and_possible_actions() -> None:
    with pytest.raises(RefusedError, match="d1: 'engage' is not possible while landing; it is from hold"):
        require_phase(vehicle(Phase.LANDING), Event.ENGAGE)
    require_phase(vehicle(Phase.HOLD), Event.ENGAGE)


@pytest.mark.parametrize("show", sorted(ShowPhase))
def test_in_formation_follows_the_law_or_holds_its_place(
    show: ShowPhase,
) -> None:
    subject = vehicle(Phase.FORMATION)
    subject.hold_m = HERE_M
    task, goal_m = subject.task(show, 0.0)
    if show in {ShowPhase.ASSEMBLING, ShowPhase.RUNNING}:
        assert (task, goal_m) == (Task.FORMATION, None)
    else:
        assert task is Task.GOAL
        assert goal_m is HERE_M


@pytest.mark.parametrize("phase", [Phase.RETURN, Phase.LANDING])
def test_descending_vehicle_is_flown_until_the_autopilot_lands(phase: Phase) -> None:
    subject = vehicle(phase)
    subject.goal_m = HERE_M
    task, goal_m = subject.task(ShowPhase.RETURNING, 0.0)
    assert task is Task.GOAL
    assert goal_m is HERE_M
    subject.set_flags(handed_over=True)
    assert subject.task(ShowPhase.RETURNING, 0.0) == (Task.NONE, None)


@pytest.mark.parametrize("phase", sorted(set(Phase) - {Phase.FORMATION, Phase.RETURN, Phase.LANDING}))
def test_no_other_vehicle_is_sent_setpoints(phase: Phase) -> None:
    subject = vehicle(phase)
    subject.goal_m = subject.hold_m = HERE_M
    assert subject.task(ShowPhase.RUNNING, 0.0) == (Task.NONE, None)


def test_engaging_vehicle_is_sent_its_own_position() -> None:
    subject = vehicle(Phase.HOLD)
    subject.hold_m = HERE_M
    subject.set_flags(entering_offboard=True)
    task, goal_m = subject.task(ShowPhase.RUNNING, 0.0)
    assert task is Task.GOAL
    assert goal_m is HERE_M


@pytest.mark.parametrize(
    ("phase", "handed_over", "alone"),
    [
        (Phase.TAKEOFF, False, True),
        (Phase.LANDING, True, True),
        (Phase.LANDING, False, False),
        (Phase.FORMATION, False, False),
    ],
)
def test_landing_from_climb_or_after_handover_needs_no_setpoint(
    phase: Phase, handed_over: bool, alone: bool
) -> None:
    subject = vehicle(phase)
    subject.set_flags(handed_over=handed_over)
    assert subject.comes_down_alone is alone


@pytest.mark.parametrize("mode", sorted(set(Mode) - {Mode.TERMINATED}))
def test_piloted_before_a_silence_is_piloted_after_it(mode: Mode) -> None:
    subject = vehicle(Phase.FORMATION)
    assert subject.observe(status(mode=Mode.POSITION))
    assert subject.observe(status(silent=True))
    assert (subject.phase, subject.flags.pilot_in_control) == (Phase.LOST, True)
    assert subject.observe(status(mode=mode))
    assert (subject.phase, subject.flags.pilot_in_control) == (Phase.PILOT, True)
    assert "no take-control came since" in subject.reason


@pytest.mark.parametrize("ends", [Event.TAKE_CONTROL, Event.TOUCHED_DOWN])
def test_taken_or_on_the_ground_it_is_under_our_control(ends: Event) -> None:
    subject = vehicle(Phase.FORMATION)
    subject.apply(Event.TAKEN_OVER, "for a test")
    subject.apply(ends, "for a test")
    assert not subject.flags.pilot_in_control


def test_piloted_vehicle_landing_while_silent_is_on_standby() -> None:
    subject = vehicle(Phase.PILOT)
    subject.apply(Event.SILENT, "for a test")
    assert subject.observe(ON_GROUND)
    assert (subject.phase, subject.flags.pilot_in_control) == (Phase.STANDBY, False)


def test_lost_vehicle_in_hold_is_piloted_if_failsafe_differs() -> None:
    for lost_holds, phase in ((True, Phase.LOST), (False, Phase.PILOT)):
        subject = vehicle(Phase.LOST, modes=frozenset({Mode.OFFBOARD}))
        subject.observe(status(mode=Mode.HOLD), lost_holds=lost_holds)
        assert subject.phase is phase


def test_lost_vehicle_in_uncommanded_offboard_is_piloted() -> None:
    subject = vehicle(Phase.LOST, modes=frozenset({Mode.HOLD}))
    assert subject.observe(status(mode=Mode.OFFBOARD))
    assert subject.phase is Phase.PILOT


@pytest.mark.parametrize("phase", [*COMMANDED, Phase.PILOT, Phase.LOST])
def test_vehicle_that_stops_its_motors_in_flight_is_killed(phase: Phase) -> None:
    subject = vehicle(phase)
    assert subject.observe(status(mode=Mode.TERMINATED))
    assert (subject.phase, subject.cause) == (Phase.KILLED, FailsafeCause.TERMINATION)
    assert "flight termination" in subject.reason
    assert not subject.observe(status(mode=Mode.TERMINATED)), "it stays so until it is seen on the ground"
    subject.apply(Event.CONFIRMED_DOWN, "seen")
    assert subject.cause is None
    assert subject.observe(status(mode=Mode.TERMINATED)), "it still reports that it flies, and lies there"
    assert subject.phase is Phase.STANDBY
    assert not subject.observe(status(mode=Mode.TERMINATED))


def test_kill_on_command_is_no_termination() -> None:
    subject = vehicle(Phase.FORMATION)
    assert subject.observe(status(mode=Mode.TERMINATED))
    subject.apply(Event.KILL, "motors stopped on command")
    assert subject.cause is None
