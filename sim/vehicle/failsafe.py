"""PX4's own failsafes: which action each cause has, its texts, and the HOLD before it, by release.

Sources: src/modules/commander/failsafe (failsafe.cpp, framework.cpp) of v1.14 to v1.18, and flights on v1.16.
"""

from collections.abc import Mapping
from enum import IntEnum

from gcs.sim.vehicle.px4 import Mode
from gcs.sim.vehicle.state import Charge

TERMINATE, DISARM = -2, -3
"""Actions that are no mode."""

ACTIVATED = "Failsafe activated"
WITH_COLON, WORSE_THAN_AT_ARMING, NO_TEXT_FOR_WARNINGS, BY_RC_LOSS = (1, 15), (1, 16), (1, 17), (1, 17)
"""Releases from which on the text of HOLD has a colon, a battery acts only where it is worse than at arming,
a warning has no text, and lost setpoints without a transmitter are a lost transmitter."""


class Loss(IntEnum):
    """NAV_DLL_ACT, and NAV_RCL_ACT."""

    HOLD = 1
    RETURN = 2
    LAND = 3
    TERMINATE = 5
    DISARM = 6


LOSS_ACTIONS: Mapping[int, int] = {
    Loss.HOLD: Mode.HOLD.number,
    Loss.RETURN: Mode.RETURN.number,
    Loss.LAND: Mode.LAND.number,
    Loss.TERMINATE: TERMINATE,
    Loss.DISARM: DISARM,
}

SETPOINT_LOSS_ACTIONS: Mapping[int, int] = {
    0: Mode.POSITION.number,
    1: Mode.ALTITUDE.number,
    2: Mode.MANUAL.number,
    3: Mode.RETURN.number,
    4: Mode.LAND.number,
    5: Mode.HOLD.number,
    6: TERMINATE,
    7: DISARM,
}
"""By COM_OBL_RC_ACT."""
NEEDS_TRANSMITTER = range(3)
"""Values of COM_OBL_RC_ACT that fall back on a mode flown by hand."""

BATTERY_TEXTS: Mapping[int, str] = {
    Charge.LOW: "Low battery",
    Charge.CRITICAL: "Critical battery",
    Charge.EMERGENCY: "Emergency battery level",
}
BATTERY_ACTIONS: Mapping[tuple[int, int], int] = {
    (2, Charge.CRITICAL): Mode.LAND.number,
    (2, Charge.EMERGENCY): Mode.LAND.number,
    (3, Charge.CRITICAL): Mode.RETURN.number,
    (3, Charge.EMERGENCY): Mode.LAND.number,
}
"""By COM_LOW_BAT_ACT and the charge; all else is a warning."""


FENCE_ACTIONS: Mapping[int, int] = {
    2: Mode.HOLD.number,
    3: Mode.RETURN.number,
    4: TERMINATE,
    5: Mode.LAND.number,
}
"""By GF_ACTION; 1 is a warning, 0 nothing."""


TRANSPONDER_ACTS = (1, 18)
"""Release from which on a transponder that fails in flight has an action; before, COM_ARM_ODID ends at 2."""

TRANSPONDER_ACTIONS: Mapping[int, int] = {3: Mode.RETURN.number, 4: Mode.LAND.number, 5: TERMINATE}
"""By COM_ARM_ODID; up to 2 only arming is refused."""


def fence_text(release: tuple[int, int]) -> str:
    """The text of a breach of an uploaded fence."""
    if release < (1, 15):
        return "Preflight Fail: Geofence violation"
    kind = "Geofence" if release >= (1, 16) else "Geofence violation"
    return f"{kind}: approaching or outside geofence"


def hold_text(release: tuple[int, int], hold_s: float) -> str:
    """The text of the HOLD before an action (COM_FAIL_ACT_T)."""
    mark = ":" if release >= WITH_COLON else ","
    return f"{ACTIVATED}{mark} entering Hold for {hold_s:.0f} seconds"


def setpoint_loss_action(release: tuple[int, int], action: int, rc_loss_action: int) -> int:
    """What follows from lost setpoints without a transmitter, by COM_OBL_RC_ACT and NAV_RCL_ACT."""
    if release >= BY_RC_LOSS and action in NEEDS_TRANSMITTER:
        return LOSS_ACTIONS.get(rc_loss_action, SETPOINT_LOSS_ACTIONS[action])
    return SETPOINT_LOSS_ACTIONS[action]
