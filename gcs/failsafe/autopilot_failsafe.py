"""Infers which autopilot failsafe explains a mode that this station did not command. Pure.

PX4 v1.16 reports in STATUSTEXT only that a failsafe was activated (its events carry the cause, and MAVLink's
dialects do not decode them). So the cause follows from several signs together: the heartbeat's system_status
(CRITICAL while PX4 itself intervenes, never while a pilot flies), the mode, the battery, the status texts of
the last seconds, and the longest recent gap between sent setpoints. Decision 0024.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import isnan
from typing import Final

from gcs.failsafe.autopilots.texts import Meaning, meaning_of
from gcs.model.state import Mode, VehicleId

LOW_BELOW, CRITICAL_BELOW = 0.15, 0.07
"""Defaults of PX4's BAT_LOW_THR and BAT_CRIT_THR."""

ROUNDING: Final = 0.01
"""Autopilots report whole percents, rounded up."""

TEXTS_COUNT_S: Final = 15.0
"""A status text explains a mode change for this time: PX4 holds for COM_FAIL_ACT_T (5 s) before it acts."""


class FailsafeCause(StrEnum):
    """Why a vehicle is in a mode that this station did not command."""

    LOW_BATTERY = "low-battery"
    CRITICAL_BATTERY = "critical-battery"
    SETPOINT_LOSS = "setpoint-loss"
    DATA_LINK_LOSS = "data-link-loss"
    GEOFENCE = "geofence"
    POSITION_LOSS = "position-loss"
    RC_LOSS = "rc-loss"
    TERMINATION = "termination"  # its motors are stopped: it falls
    OTHER = "other"  # the autopilot's own failsafe, of unknown kind
    UNKNOWN = "unknown"  # a pilot, another ground station, or the autopilot


BATTERY: Final = frozenset({FailsafeCause.LOW_BATTERY, FailsafeCause.CRITICAL_BATTERY})


@dataclass(frozen=True, slots=True)
class FailsafeInputs:
    """What is known of one vehicle at one time. NaN: not known."""

    mode: Mode
    in_failsafe: bool  # its heartbeat's system_status is CRITICAL or EMERGENCY
    battery_remaining: float  # 0 to 1
    battery_critical_below: float  # `failsafes.low_battery.critical_below`
    texts: Sequence[str]  # its status texts of the last TEXTS_COUNT_S, oldest first
    setpoint_gap_s: float  # the longest time in which this station could send it none, of the last seconds
    setpoint_loss_s: float  # how long it flies on, as `WithoutSetpoints`
    setpoint_loss_action: str  # COM_OBL_RC_ACT as configured, see `gcs.config.schema.OperationSettings`
    position_age_s: float  # inf: no plausible position
    beyond_fence: bool = False  # its autopilot reports that its own fence is breached
    position_doubtful: bool = False  # positions arrive, and are not to be trusted: see `FleetState.doubtful`


_NAMED: Final = (
    FailsafeCause.GEOFENCE,
    FailsafeCause.POSITION_LOSS,
    FailsafeCause.DATA_LINK_LOSS,
    FailsafeCause.RC_LOSS,
)
"""Causes that texts name, most specific first. They count only beside a failsafe, or a battery's beside a
landing: autopilots warn of batteries and positions long before they act.
"""

_FENCE_MODES: Final = frozenset({Mode.HOLD, Mode.LAND, Mode.RETURN})
"""What a fence does with a vehicle; in another mode a pilot flies it, also outside."""

_BLIND_MODES: Final = frozenset({Mode.LAND, Mode.POSITION, Mode.OTHER})
"""What an autopilot's own failsafe does with a vehicle that has no position: HOLD and RETURN need one."""

_SETPOINT_LOSS_MODES: Final = {
    "hold": frozenset({Mode.HOLD}),
    "land": frozenset({Mode.LAND}),
    "return": frozenset({Mode.RETURN}),
    "descend": frozenset({Mode.POSITION, Mode.OTHER}),  # POSCTL, or what is left without a position
}


def cause_of(inputs: FailsafeInputs) -> FailsafeCause:
    """Return the failsafe that explains a mode that this station did not command."""
    if inputs.mode is Mode.TERMINATED:
        return FailsafeCause.TERMINATION
    meanings = {meaning_of(text) for text in inputs.texts}
    announced = {cause for cause in FailsafeCause if cause.value in meanings}
    lands = inputs.mode in {Mode.LAND, Mode.RETURN}
    battery = _battery(inputs, announced)
    if battery is not None and (inputs.in_failsafe or (lands and announced & BATTERY)):
        return battery
    if lands and Meaning.LINK_BACK in meanings:
        return FailsafeCause.DATA_LINK_LOSS
    if not inputs.in_failsafe:
        stopped = inputs.beyond_fence and inputs.mode in _FENCE_MODES
        return FailsafeCause.GEOFENCE if stopped else FailsafeCause.UNKNOWN
    if inputs.position_doubtful and inputs.mode in _BLIND_MODES:
        return FailsafeCause.POSITION_LOSS
    for cause in _NAMED:
        if cause in announced:
            return cause
    if not inputs.position_age_s <= inputs.setpoint_loss_s + 1.0 and inputs.mode in {Mode.LAND, Mode.OTHER}:
        return FailsafeCause.POSITION_LOSS
    # nothing holds before it holds: another action follows
    fits = not _holds_first(inputs) and inputs.mode in _SETPOINT_LOSS_MODES.get(
        inputs.setpoint_loss_action, frozenset()
    )
    return FailsafeCause.SETPOINT_LOSS if fits else FailsafeCause.OTHER


def _battery(inputs: FailsafeInputs, announced: set[FailsafeCause]) -> FailsafeCause | None:
    left = inputs.battery_remaining
    if FailsafeCause.CRITICAL_BATTERY in announced or left <= CRITICAL_BELOW + ROUNDING:  # False for NaN
        return FailsafeCause.CRITICAL_BATTERY
    if FailsafeCause.LOW_BATTERY in announced or left <= LOW_BELOW + ROUNDING:
        return FailsafeCause.LOW_BATTERY
    return None


_ACTS: Final = frozenset({Meaning.HOLDS_FIRST, Meaning.UNSAID})

_DOES: Final = {Mode.HOLD: "holds", Mode.LAND: "lands", Mode.RETURN: "returns", Mode.POSITION: "descends"}

TERMINATED: Final = "its autopilot has stopped its motors (flight termination, or a kill switch)"

_BLIND: Final = "It cannot be steered without a position: leave it, keep clear of it."
_TAKE_CONTROL: Final = "Take control to fly it again."
_LEAVE: Final = "Leave it."
_LAND: Final = "Take control, and land it."

ADVICE_TO_MANY: Final = {
    _BLIND: "They cannot be steered without positions: leave them alone.",
    _TAKE_CONTROL: "Take control to fly them again.",
    _LEAVE: "Leave them.",
    _LAND: "Take control, and land them.",
}
"""Advice in `described` for several vehicles."""


def described(vehicle_id: VehicleId, cause: FailsafeCause, inputs: FailsafeInputs) -> str:
    """Return the text for the operator: what the vehicle does, why, and what to do about it."""
    if cause is FailsafeCause.UNKNOWN:
        by = "a pilot, another station, or its autopilot"
        if any(meaning_of(text) is Meaning.PILOT for text in inputs.texts):
            by = "its pilot took over with the sticks"
        blind = f" {_BLIND}" if inputs.position_doubtful else " Take control when the pilot agrees."
        return f"{vehicle_id} is in mode {inputs.mode}, which this station did not command: {by}.{blind}"
    does = _DOES.get(inputs.mode, f"is in mode {inputs.mode}")
    failsafe = "a failsafe of its own" if cause is FailsafeCause.OTHER else f"its own {cause} failsafe"
    level = (
        f", battery {inputs.battery_remaining:.0%}"
        if cause in BATTERY and not isnan(inputs.battery_remaining)
        else ""
    )
    advice = _BLIND if cause is FailsafeCause.POSITION_LOSS else _TAKE_CONTROL
    acts_soon = inputs.mode is Mode.HOLD and _holds_first(inputs)
    does += " for a few seconds first" if acts_soon else ""
    if cause in BATTERY:
        advice = _LEAVE if acts_soon or comes_down(inputs) else _LAND
    if cause is FailsafeCause.SETPOINT_LOSS:
        level = f": {_setpoints(inputs)}"
    return f"{vehicle_id} {does} by {failsafe}{level}. {advice}"


def _holds_first(inputs: FailsafeInputs) -> bool:
    """Whether it holds until its failsafe acts, as its newest text says."""
    acts = [meaning for text in inputs.texts if (meaning := meaning_of(text)) in _ACTS]
    return acts[-1:] == [Meaning.HOLDS_FIRST]


def _setpoints(inputs: FailsafeInputs) -> str:
    """Describe where setpoints were lost: at this station or on the link."""
    if isnan(inputs.setpoint_gap_s):
        return "this station has sent none since it started"
    if inputs.setpoint_gap_s >= inputs.setpoint_loss_s:  # False for NaN
        return f"this station sent none for {inputs.setpoint_gap_s:.1f} s"
    return "its link lost them, or its positions"


def lost_on_the_way(
    cause: FailsafeCause | None, inputs: FailsafeInputs, *, hold_commanded: bool = False
) -> bool:
    """Whether it holds because its link lost setpoints, so that it can be flown on.

    False if this station sent none: after a stall the operator decides for the whole fleet.

    Args:
        cause: why it left control.
        inputs: what is known of it now.
        hold_commanded: whether this station has commanded HOLD since, even if the answer was lost: the
            command ends the failsafe, and the mode stays.
    """
    sent = inputs.setpoint_gap_s < inputs.setpoint_loss_s  # False for NaN
    holds = inputs.mode is Mode.HOLD and (inputs.in_failsafe or hold_commanded)
    sent = sent and not inputs.position_doubtful
    return cause is FailsafeCause.SETPOINT_LOSS and holds and sent


def control_refusal(vehicle_id: VehicleId, inputs: FailsafeInputs) -> str:
    """Why control of an airborne vehicle may not be taken (into HOLD), and what is safe; empty: it may.

    A vehicle without a position accepts no mode of this station's. On a critical battery only one that comes
    down by itself is left alone. One that hovers on it may be taken: nothing else brings it down.
    """
    if inputs.position_doubtful:
        left = (
            "leave it to its autopilot, which brings it down" if comes_down(inputs) else "its pilot lands it"
        )
        return (
            f"{vehicle_id}: its receiver has no 3D fix: without a position it cannot be steered, and its"
            f" autopilot accepts no hold. Safe instead: {left}; keep clear of it;"
            f" `gcs kill {vehicle_id}` is the last resort"
        )
    if inputs.battery_remaining < inputs.battery_critical_below and comes_down(inputs):  # False for NaN
        return (
            f"{vehicle_id}: battery {inputs.battery_remaining:.0%}, critical below"
            f" {inputs.battery_critical_below:.0%}: taking control would stop its landing. Safe instead:"
            f" leave it to its autopilot, which brings it down; `gcs kill {vehicle_id}` is the last resort"
        )
    return ""


def comes_down(inputs: FailsafeInputs) -> bool:
    """Whether its mode brings it to the ground: a landing, a return, or the descent of a failsafe."""
    descends = inputs.in_failsafe and inputs.mode in {Mode.POSITION, Mode.OTHER}
    return descends or inputs.mode in {Mode.LAND, Mode.RETURN}
