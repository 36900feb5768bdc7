"""Modes, arming and take-off of one vehicle with ArduCopter, and its texts."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from gcs.sim.autopilots.ardupilot import prearm
from gcs.sim.autopilots.ardupilot.modes import (
    BY_HAND,
    IMPOSSIBLE_IN_AIR,
    OF_PILOT,
    POSITION_MODES,
    Mode,
    Phase,
    Submode,
    find,
)
from gcs.sim.autopilots.ardupilot.parameters import Parameters
from gcs.sim.autopilots.ardupilot.power import Batteries
from gcs.sim.autopilots.ardupilot.state import ArduState
from gcs.sim.autopilots.ardupilot.texts import refusal_text
from gcs.sim.vehicle.commander import Result
from gcs.sim.vehicle.dynamics import Array
from gcs.sim.vehicle.state import Stuck

CRITICAL, WARNING, INFO = 2, 4, 6  # MAV_SEVERITY
SPOOL_UP_S = 0.4  # from NAV_TAKEOFF until it lifts off
ALIGNED_AFTER_S = 3.5  # habit 31
SINKS_AFTER_S = 4.0  # habit 51: LAND of a failsafe
FORCE_ARM, FORCE_DISARM = 2989, 21196  # param2 of COMPONENT_ARM_DISARM


@dataclass(eq=False)
class Commander:
    """One row of the fleet's state, and the texts that its transitions produce."""

    state: ArduState
    row: int
    parameters: Parameters
    batteries: Batteries
    send_text: Callable[[int, str], None]  # takes a MAV_SEVERITY and a text
    changed: Callable[[], None]  # sends a HEARTBEAT out of turn
    set_home: Callable[[], None]
    firmware_release: tuple[int, int]
    stuck: Stuck = Stuck.NO

    @property
    def mode(self) -> Mode:
        return Mode(int(self.state.mode[self.row]))

    @property
    def armed(self) -> bool:
        return bool(self.state.armed[self.row])

    @property
    def landed(self) -> bool:
        return bool(self.state.landed[self.row])

    def reasons(self) -> list[str]:
        """Why it would not arm now; see `prearm.reasons`."""
        return prearm.reasons(self.state, self.row, self.parameters, self.batteries)

    def arm(self, *, force: bool = False) -> Result:
        """Start the motors; the present place becomes home. Each reason against it is a text (habit 22)."""
        state, row = self.state, self.row
        if state.armed[row]:
            return Result.ACCEPTED
        reasons = self.reasons()
        if prearm.STARTING in reasons if force else reasons:
            self.send_reasons(reasons)
            return Result.FAILED
        self.send_text(INFO, "Arming motors")
        state.armed[row], state.armed_s[row] = True, state.now_s
        state.submode[row], state.lift_at_s[row] = Submode.HOVER, math.inf
        state.goal_yaw_rad[row] = math.nan
        self.set_home()
        return Result.ACCEPTED

    def send_reasons(self, reasons: list[str]) -> None:
        """Send the texts "PreArm: ..."."""
        for text in reasons:
            self.send_text(CRITICAL, f"PreArm: {text}")

    def disarm(self, *, force: bool = False) -> Result:
        """Stop the motors; in the air only when forced (habit 56)."""
        if not self.armed:
            return Result.ACCEPTED
        if not (self.landed or force):
            return Result.FAILED
        self.stop()
        return Result.ACCEPTED

    def stop(self) -> None:
        """Stop the motors. The mode stays (habit 30); HEARTBEAT shows it in its turn (habit 24)."""
        state, row = self.state, self.row
        state.armed[row] = False
        state.lift_at_s[row] = state.aligned_at_s[row] = math.inf
        state.submode[row] = Submode.HOVER
        self.send_text(INFO, "Disarming motors")

    def change_mode(self, number: float) -> Result:
        """Change the mode as commanded; disarmed any is accepted (habits 12, 13)."""
        if self.stuck is not Stuck.NO:
            return Result.ACCEPTED if self.stuck is Stuck.SAYS_YES else Result.UNSUPPORTED
        mode = find(number)
        if mode is None:
            self.send_text(WARNING, "No such mode")
            return Result.UNSUPPORTED
        if self.armed and mode in IMPOSSIBLE_IN_AIR:
            if mode is Mode.FOLLOW:
                self.send_text(WARNING, "Set FOLL_ENABLE = 1")
            if self.firmware_release < (4, 1):
                self.send_text(WARNING, f"Flight mode change failed {mode.name}")
            else:
                self.send_text(WARNING, refusal_text(self.firmware_release, mode.name, "init failed"))
            return Result.UNSUPPORTED
        if self.armed and mode in POSITION_MODES and not self.state.position_ok[self.row]:
            self.send_text(WARNING, refusal_text(self.firmware_release, mode.name, "requires position"))
            return Result.UNSUPPORTED
        self.state.commanded_s[self.row] = self.state.now_s
        self.fly(mode)
        return Result.ACCEPTED

    def fly(self, mode: Mode, *, sinks_after_s: float = 0.0) -> None:
        """Fly that mode from now on, whatever requested it; a repetition changes nothing."""
        state, row = self.state, self.row
        if state.mode[row] == mode:
            return
        state.mode[row] = state.intended[row] = mode
        state.phase[row] = Phase.CLIMB
        state.submode[row], state.lift_at_s[row] = Submode.HOVER, math.inf
        state.sink_after_s[row] = state.now_s + sinks_after_s
        state.goal_yaw_rad[row] = math.nan
        self.changed()

    def take_off(self, height_m: float, here_m: Array) -> Result:
        """Climb to a height above home, in GUIDED, armed and on the ground (habits 26, 27).

        Args:
            height_m: above home.
            here_m: (3,), the present place, local NED.
        """
        state, row = self.state, self.row
        down_m = float(state.home_m[row, 2]) - height_m
        able = state.armed[row] and state.landed[row] and state.mode[row] == Mode.GUIDED
        if not (able and down_m < float(here_m[2])):
            return Result.FAILED
        state.goal_m[row] = (here_m[0], here_m[1], down_m)
        state.submode[row] = Submode.TAKEOFF
        state.lift_at_s[row] = state.now_s + SPOOL_UP_S
        state.aligned_at_s[row] = state.now_s + ALIGNED_AFTER_S
        return Result.ACCEPTED

    def fly_to(self, place_m: Array) -> None:
        """GUIDED: fly to a place (3,), local NED, without end (habit 42)."""
        self.state.goal_m[self.row] = place_m
        self.state.submode[self.row] = Submode.POSITION

    def fail_safe(self, mode: Mode | None) -> None:
        """Fly that mode by a failsafe; on the ground disarm instead. None: only report it."""
        state, row = self.state, self.row
        if mode is None or not state.armed[row]:
            return
        if state.landed[row]:
            self.stop()
            return
        if mode in POSITION_MODES and not state.position_ok[row]:
            mode = Mode.LAND
        if state.mode[row] != Mode.LAND:  # a landing is never ended
            self.fly(mode, sinks_after_s=SINKS_AFTER_S)

    def take_over(self, mode: str, *, by_sticks: bool) -> bool:
        """Let a pilot fly it; GUIDED, RTL and LAND do not end by moving the sticks."""
        if by_sticks and self.mode not in BY_HAND:
            return False
        self.fly(OF_PILOT[mode])
        return True

    def terminate(self) -> bool:
        """Stop the motors, as its kill does; False where it is not armed."""
        was_armed = self.armed
        self.disarm(force=True)
        return was_armed

    def doubt_compass(self) -> bool:
        """PX4's text is unknown here. Returns: False."""
        return False

    def release(self) -> None:
        """Let it hold where it was flown by hand: BRAKE, for LOITER descends without a transmitter."""
        if self.state.piloted[self.row] and self.mode in BY_HAND:
            self.fly(Mode.BRAKE)
