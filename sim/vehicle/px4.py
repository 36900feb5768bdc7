"""PX4's flight modes, and their encoding in a HEARTBEAT."""

from __future__ import annotations

from enum import Enum

import numpy as np

ARMED, MANUAL_INPUT, STABILIZE, GUIDED, AUTO, CUSTOM = 128, 64, 16, 8, 4, 1


class Mode(Enum):
    """A mode: PX4's main and sub mode, and the base_mode bits that go with them."""

    MANUAL = (1, 0, MANUAL_INPUT | CUSTOM)
    ALTITUDE = (2, 0, MANUAL_INPUT | STABILIZE | CUSTOM)
    POSITION = (3, 0, MANUAL_INPUT | STABILIZE | CUSTOM)
    TAKEOFF = (4, 2, STABILIZE | GUIDED | AUTO | CUSTOM)
    HOLD = (4, 3, STABILIZE | GUIDED | AUTO | CUSTOM)
    RETURN = (4, 5, STABILIZE | GUIDED | AUTO | CUSTOM)
    LAND = (4, 6, STABILIZE | GUIDED | AUTO | CUSTOM)
    OFFBOARD = (6, 0, STABILIZE | CUSTOM)
    STABILIZED = (7, 0, MANUAL_INPUT | STABILIZE | CUSTOM)

    @property
    def custom_mode(self) -> int:
        """The HEARTBEAT's custom_mode field."""
        return self.value[0] << 16 | self.value[1] << 24

    @property
    def base_mode(self) -> int:
        """The HEARTBEAT's base_mode field while disarmed."""
        return self.value[2]

    @property
    def number(self) -> int:
        """The mode in an array of modes."""
        return NUMBERS[self]

    @property
    def title(self) -> str:
        """The name PX4 uses in texts."""
        return self.name.capitalize()

    @staticmethod
    def find(main: int, sub: int) -> Mode | None:
        """The mode that DO_SET_MODE requests, or None."""
        for mode in Mode:
            if mode.value[0] == main and mode.value[1] == sub:
                return mode
        return None


MODES = tuple(Mode)
NUMBERS = {mode: number for number, mode in enumerate(MODES)}
CUSTOM_MODES = np.array([mode.custom_mode for mode in MODES], dtype=np.uint32)
BASE_MODES = np.array([mode.base_mode for mode in MODES], dtype=np.uint8)
NEEDS_PILOT = frozenset({Mode.MANUAL, Mode.ALTITUDE, Mode.POSITION, Mode.STABILIZED})
PREVENTS_ARMING = frozenset({Mode.LAND, Mode.RETURN})
# COM_OBL_RC_ACT to the mode flown after setpoints are lost; 6 and 7 stop the motors instead.
OFFBOARD_LOSS_MODE = {
    0: Mode.POSITION,
    1: Mode.ALTITUDE,
    2: Mode.MANUAL,
    3: Mode.RETURN,
    4: Mode.LAND,
    5: Mode.HOLD,
}
# NAV_DLL_ACT to the mode flown after the last ground station is lost; 5 and 6 stop the motors instead.
STATION_LOSS_MODE = {1: Mode.HOLD, 2: Mode.RETURN, 3: Mode.LAND}
