"""Which of an autopilot's own failsafes explains a mode that this station did not command."""

from dataclasses import replace
from math import nan

import pytest

from gcs.failsafe.autopilot_failsafe import (
    FailsafeCause,
    FailsafeInputs,
    cause_of,
    control_refusal,
    described,
    lost_on_the_way,
)
from gcs.model.state import Mode

INPUTS = FailsafeInputs(
    mode=Mode.HOLD,
    in_failsafe=True,
    battery_remaining=0.8,
    battery_critical_below=0.1,
    texts=("Failsafe activated",),
    setpoint_gap_s=0.05,
    setpoint_loss_s=1.0,
    setpoint_loss_action="hold",
    position_age_s=0.1,
)
LANDS = replace(INPUTS, mode=Mode.LAND)


@pytest.mark.parametrize(
    ("inputs", "cause"),
    [
        (replace(LANDS, battery_remaining=0.05), FailsafeCause.CRITICAL_BATTERY),
        (replace(LANDS, battery_remaining=nan, texts=("Critical battery",)), FailsafeCause.CRITICAL_BATTERY),
        (replace(LANDS, texts=("Battery 1 disconnected",)), FailsafeCause.CRITICAL_BATTERY),
        (replace(INPUTS, mode=Mode.RETURN, battery_remaining=0.14), FailsafeCause.LOW_BATTERY),
        (
            replace(LANDS, in_failsafe=False, texts=("Critical battery, landing",)),
            FailsafeCause.CRITICAL_BATTERY,
        ),
        (INPUTS, FailsafeCause.SETPOINT_LOSS),
        (replace(INPUTS, mode=Mode.POSITION, setpoint_loss_action="descend"), FailsafeCause.SETPOINT_LOSS),
        (replace(INPUTS, mode=Mode.RETURN, texts=("GCS connection lost",)), FailsafeCause.DATA_LINK_LOSS),
        (
            replace(INPUTS, texts=("Geofence: exceeding maximum distance to Home", "Failsafe activated")),
            FailsafeCause.GEOFENCE,
        ),
        (replace(LANDS, texts=("No valid local position estimate",)), FailsafeCause.POSITION_LOSS),
        (replace(LANDS, position_age_s=9.0), FailsafeCause.POSITION_LOSS),
        (replace(INPUTS, mode=Mode.RETURN, texts=("Manual control lost",)), FailsafeCause.RC_LOSS),
        (replace(LANDS, position_doubtful=True), FailsafeCause.POSITION_LOSS),
        (replace(INPUTS, mode=Mode.OTHER, position_doubtful=True), FailsafeCause.POSITION_LOSS),
        (replace(INPUTS, position_doubtful=True), FailsafeCause.SETPOINT_LOSS),  # it holds: it has one
        (replace(LANDS, in_failsafe=False, position_doubtful=True), FailsafeCause.UNKNOWN),
        (replace(INPUTS, mode=Mode.TERMINATED), FailsafeCause.TERMINATION),
        (replace(LANDS, texts=("Compass needs calibration - Land now!",)), FailsafeCause.OTHER),
        (replace(INPUTS, mode=Mode.RETURN), FailsafeCause.OTHER),
        (replace(INPUTS, in_failsafe=False), FailsafeCause.UNKNOWN),
        (replace(LANDS, in_failsafe=False, texts=("Landing at current position",)), FailsafeCause.UNKNOWN),
        (
            replace(INPUTS, mode=Mode.POSITION, in_failsafe=False, battery_remaining=0.05),
            FailsafeCause.UNKNOWN,  # a pilot flies on a flat battery
        ),
    ],
)
def test_each_failsafe_is_distinguished_from_the_others(inputs: FailsafeInputs, cause: FailsafeCause) -> None:
    assert cause_of(inputs) is cause


ARDUPILOT = replace(INPUTS, mode=Mode.RETURN, setpoint_loss_s=3.0, setpoint_loss_action="")


@pytest.mark.parametrize(
    ("inputs", "cause"),
    [
        (replace(ARDUPILOT, texts=("GCS Failsafe",)), FailsafeCause.DATA_LINK_LOSS),
        (
            replace(ARDUPILOT, texts=("Battery 1 is low 10.81V used 2461 mAh", "Battery Failsafe")),
            FailsafeCause.LOW_BATTERY,
        ),
        (
            replace(
                ARDUPILOT,
                mode=Mode.LAND,
                texts=("Battery 1 is critical 9.77V used 2557 mAh", "Battery Failsafe"),
            ),
            FailsafeCause.CRITICAL_BATTERY,
        ),
        (replace(ARDUPILOT, texts=("Radio Failsafe",)), FailsafeCause.RC_LOSS),
        (replace(ARDUPILOT, mode=Mode.LAND, texts=("EKF variance",)), FailsafeCause.POSITION_LOSS),
        (replace(ARDUPILOT, mode=Mode.HOLD, texts=()), FailsafeCause.OTHER),  # never for want of setpoints
        (replace(ARDUPILOT, texts=("PreArm: Battery failsafe",)), FailsafeCause.OTHER),
        (
            replace(ARDUPILOT, in_failsafe=False, texts=("GCS Failsafe Cleared",)),
            FailsafeCause.DATA_LINK_LOSS,
        ),
        (replace(ARDUPILOT, in_failsafe=False, mode=Mode.HOLD, beyond_fence=True), FailsafeCause.GEOFENCE),
        (replace(ARDUPILOT, in_failsafe=False, beyond_fence=True), FailsafeCause.GEOFENCE),
        (
            replace(ARDUPILOT, in_failsafe=False, mode=Mode.POSITION, beyond_fence=True),
            FailsafeCause.UNKNOWN,  # a pilot flies it outside
        ),
        (
            replace(ARDUPILOT, in_failsafe=False, mode=Mode.POSITION, texts=("GCS Failsafe Cleared",)),
            FailsafeCause.UNKNOWN,  # a pilot has taken it since
        ),
    ],
)
def test_failsafes_that_ardupilot_named_are_recognised(inputs: FailsafeInputs, cause: FailsafeCause) -> None:
    """Texts as recorded."""
    assert cause_of(inputs) is cause


def test_the_operator_reads_what_it_does_why_and_what_to_do() -> None:
    flat = replace(LANDS, battery_remaining=0.05)
    text = described("d1", cause_of(flat), flat)
    assert text == "d1 lands by its own critical-battery failsafe, battery 5%. Leave it."
    stalled = replace(INPUTS, setpoint_gap_s=4.0)
    assert "this station sent none for 4.0 s" in described("d1", cause_of(stalled), stalled)
    assert "its link lost them" in described("d1", cause_of(INPUTS), INPUTS)
    taken = replace(INPUTS, in_failsafe=False)
    assert "when the pilot agrees" in described("d1", cause_of(taken), taken)


def test_control_is_refused_only_where_it_would_stop_a_landing() -> None:
    refusal = control_refusal("d1", replace(LANDS, battery_remaining=0.05))
    assert "battery 5%, critical below 10%" in refusal
    assert "leave it to its autopilot" in refusal
    assert "`gcs kill d1` is the last resort" in refusal
    assert control_refusal("d1", LANDS) == ""
    hovers = replace(INPUTS, battery_remaining=0.05)
    assert control_refusal("d1", hovers) == "", "nothing else brings it down"
    assert described("d1", cause_of(hovers), hovers).endswith("Take control, and land it.")


def test_battery_failsafe_that_holds_first_is_left_to_land() -> None:
    texts = ("Failsafe activated: entering Hold for 5 seconds",)
    held = replace(INPUTS, battery_remaining=0.05, texts=texts)
    text = described("d1", cause_of(held), held)
    assert (
        text == "d1 holds for a few seconds first by its own critical-battery failsafe, battery 5%. Leave it."
    )
    stays = replace(held, texts=(*texts, "Failsafe activated"))
    assert described("d1", cause_of(stays), stays).endswith("Take control, and land it.")


def test_hold_before_an_action_is_no_loss_of_setpoints() -> None:
    """The cause follows when it acts."""
    held = replace(INPUTS, texts=("Failsafe activated: entering Hold for 5 seconds",))
    assert cause_of(held) is FailsafeCause.OTHER
    text = described("d1", cause_of(held), held)
    assert text == "d1 holds for a few seconds first by a failsafe of its own. Take control to fly it again."
    assert not lost_on_the_way(cause_of(held), held), "it is not flown on by itself"
    caused = replace(held, mode=Mode.RETURN, texts=(*held.texts, "Connection to ground station lost"))
    assert cause_of(caused) is FailsafeCause.DATA_LINK_LOSS


def test_blind_vehicle_is_left_alone_in_words_and_deeds() -> None:
    blind = replace(LANDS, position_doubtful=True)
    text = described("d1", cause_of(blind), blind)
    assert "position-loss failsafe. It cannot be steered without a position" in text
    refusal = control_refusal("d1", blind)
    assert "no 3D fix" in refusal
    assert "leave it to its autopilot" in refusal
    by_hand = replace(blind, mode=Mode.OTHER, in_failsafe=False)
    assert "its pilot lands it" in control_refusal("d1", by_hand)
    assert "cannot be steered" in described("d1", cause_of(by_hand), by_hand)
    assert not lost_on_the_way(FailsafeCause.SETPOINT_LOSS, replace(INPUTS, position_doubtful=True))


def test_pilot_who_moved_the_sticks_is_named() -> None:
    taken = replace(INPUTS, mode=Mode.POSITION, in_failsafe=False, texts=("Pilot took over using sticks",))
    text = described("d1", cause_of(taken), taken)
    assert text.endswith("its pilot took over with the sticks. Take control when the pilot agrees.")


def test_newly_started_station_does_not_blame_the_link() -> None:
    inputs = replace(INPUTS, setpoint_gap_s=nan)
    text = described("d1", cause_of(inputs), inputs)
    assert "this station has sent none since it started" in text
    assert "did not reach it" not in text


@pytest.mark.parametrize(
    ("inputs", "hold_commanded", "flown_on"),
    [
        (INPUTS, False, True),
        (replace(INPUTS, in_failsafe=False), True, True),  # it obeys HOLD, and the answer was lost
        (replace(INPUTS, in_failsafe=False), False, False),  # a pilot may have chosen HOLD
        (replace(INPUTS, setpoint_gap_s=1.2), True, False),  # this station stalled
        (replace(INPUTS, setpoint_gap_s=nan), True, False),
        (replace(INPUTS, mode=Mode.POSITION), True, False),
    ],
)
def test_only_a_vehicle_whose_link_lost_setpoints_is_flown_on(
    inputs: FailsafeInputs, hold_commanded: bool, flown_on: bool
) -> None:
    cause = FailsafeCause.SETPOINT_LOSS
    assert lost_on_the_way(cause, inputs, hold_commanded=hold_commanded) is flown_on
    assert not lost_on_the_way(FailsafeCause.OTHER, inputs, hold_commanded=hold_commanded)
