"""ArduCopter's flight modes: the number in HEARTBEAT's custom_mode is the mode (habit 11)."""

from collections.abc import Collection
from enum import IntEnum

import numpy as np

from gcs.sim.vehicle.dynamics import Mask

MODE_COUNT = 27


class Mode(IntEnum):
    """Copter's modes, by custom_mode."""

    STABILIZE = 0
    ACRO = 1
    ALT_HOLD = 2
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    CIRCLE = 7
    LAND = 9
    DRIFT = 11
    SPORT = 13
    FLIP = 14
    AUTOTUNE = 15
    POSHOLD = 16
    BRAKE = 17
    THROW = 18
    AVOID_ADSB = 19
    GUIDED_NOGPS = 20
    SMART_RTL = 21
    FLOWHOLD = 22
    FOLLOW = 23
    ZIGZAG = 24
    SYSTEMID = 25
    AUTOROTATE = 26


class Submode(IntEnum):
    """What GUIDED does."""

    HOVER = 0
    VELOCITY = 1
    POSITION = 2
    TAKEOFF = 3


class Phase(IntEnum):
    """Parts of a return."""

    CLIMB = 0
    RETURN = 1
    WAIT = 2
    LAND = 3


ARMABLE = frozenset({Mode.GUIDED, Mode.STABILIZE, Mode.LOITER, Mode.ALT_HOLD, Mode.THROW, Mode.GUIDED_NOGPS})
"""Modes in which a command arms the vehicle (habit 22)."""

IMPOSSIBLE_IN_AIR = frozenset(
    {
        *(Mode.AUTO, Mode.FLIP, Mode.AUTOTUNE, Mode.THROW, Mode.FLOWHOLD, Mode.FOLLOW, Mode.ZIGZAG),
        *(Mode.SYSTEMID, Mode.AUTOROTATE),
    }
)
"""Modes that need something that no vehicle here has: a mission, a leader, a sensor (habits 12, 14)."""

POSITION_MODES = frozenset(
    {
        *(Mode.AUTO, Mode.GUIDED, Mode.LOITER, Mode.RTL, Mode.CIRCLE, Mode.POSHOLD, Mode.BRAKE, Mode.THROW),
        *(Mode.AVOID_ADSB, Mode.SMART_RTL, Mode.FOLLOW, Mode.ZIGZAG, Mode.DRIFT, Mode.FLOWHOLD),
    }
)
"""Modes that need a position, and have the GUIDED flag in base_mode (habit 1)."""

BY_HAND = frozenset(
    {
        *(Mode.STABILIZE, Mode.ACRO, Mode.ALT_HOLD, Mode.LOITER, Mode.CIRCLE, Mode.DRIFT, Mode.SPORT),
        *(Mode.POSHOLD, Mode.FLOWHOLD, Mode.ZIGZAG),
    }
)
"""Modes that follow the sticks; without a pilot the throttle is low and the vehicle descends (habit 14)."""

RETURNING = frozenset({Mode.RTL, Mode.SMART_RTL})
DRIFTING = frozenset({Mode.STABILIZE, Mode.ACRO, Mode.ALT_HOLD, Mode.GUIDED_NOGPS})
"""Modes without control of the position."""

OF_PILOT = {
    "POSITION": Mode.LOITER,
    "ALTITUDE": Mode.ALT_HOLD,
    "MANUAL": Mode.ACRO,
    "STABILIZED": Mode.STABILIZE,
    "HOLD": Mode.BRAKE,
    "LAND": Mode.LAND,
    "RETURN": Mode.RTL,
}
"""By the PX4 mode that does the same, as faults name them."""

CUSTOM, STABILIZE_FLAG, GUIDED_FLAG, MANUAL_INPUT = 1, 16, 8, 64
BASE_MODES = np.array(
    [
        CUSTOM | STABILIZE_FLAG | MANUAL_INPUT | (GUIDED_FLAG if number in POSITION_MODES else 0)
        for number in range(MODE_COUNT)
    ],
    dtype=np.uint8,
)
"""By custom_mode, while disarmed: 0x51 or 0x59."""


def _by_mode(modes: Collection[Mode]) -> Mask:
    return np.array([number in modes for number in range(MODE_COUNT)])


HANDS_ON, NEEDS_POSITION, RETURNS, DRIFTS = map(_by_mode, (BY_HAND, POSITION_MODES, RETURNING, DRIFTING))
"""(MODE_COUNT,) by custom_mode: whether a mode belongs to these."""
GUIDED, LAND, BRAKE, CIRCLE = int(Mode.GUIDED), int(Mode.LAND), int(Mode.BRAKE), int(Mode.CIRCLE)
HOVER, VELOCITY, POSITION, TAKEOFF = map(int, Submode)
"""Numbers for columns: an enumeration's members are slow to find in every step."""


def find(number: float) -> Mode | None:
    """The mode with that number, of a command's parameter."""
    return Mode(int(number)) if number in set(Mode) else None
