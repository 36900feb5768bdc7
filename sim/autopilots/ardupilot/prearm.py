"""Why ArduCopter does not arm: the checks before arming, each with its text (habits 20 to 22)."""

from gcs.sim.autopilots.ardupilot.modes import ARMABLE, NEEDS_POSITION, Mode
from gcs.sim.autopilots.ardupilot.parameters import Parameters
from gcs.sim.autopilots.ardupilot.power import Batteries
from gcs.sim.autopilots.ardupilot.state import ArduState

YAW_AFTER_S, ATTITUDE_AFTER_S = 4.04, 5.1  # habit 19
RADIO_LOST_AFTER_S = 0.5
HDOP_SCALE = 100
FS_THR_LOW = 910  # PWM
FS_THR_BELOW_MIN = 10
SENSOR_NAMES = {0x1: "Gyros", 0x2: "Accels", 0x4: "Compass", 0x8: "Barometer", 0x20: "GPS", 0x200000: "AHRS"}
"""Bits of MAV_SYS_STATUS_SENSOR."""

NOT_ARMABLE = "Mode not armable"
STARTING = "EKF attitude is bad"
NO_POSITION = "Need Position Estimate"


def radio_is_lost(state: ArduState, row: int, parameters: Parameters) -> bool:
    """Whether the transmitter has been lost long enough for a failsafe (habit 54)."""
    lost_s = state.now_s - float(state.radio_lost_s[row])
    return bool(parameters["FS_THR_ENABLE"]) and lost_s >= RADIO_LOST_AFTER_S


def _of_start(state: ArduState, row: int) -> list[str]:
    """Reasons of a vehicle that has just started (habits 19, 22)."""
    since_s = state.now_s - float(state.boot_s[row])
    if state.now_s >= state.ready_at_s[row] or since_s >= ATTITUDE_AFTER_S:
        return []
    if since_s < YAW_AFTER_S:
        return [STARTING, "EKF2: unknown initialization failure"]
    return ["EKF2 still initialising", STARTING, "EKF2 still initialising"]


def _of_parameters(p: Parameters) -> list[str]:
    """Reasons that follow from the parameters alone."""
    problems = []
    if not p["FRAME_CLASS"]:
        problems.append("Check firmware or FRAME_CLASS")
    if not 1000 <= p["ANGLE_MAX"] <= 8000:
        problems.append("Check ANGLE_MAX")
    if not any(p[f"COMPASS_OFS_{axis}"] for axis in "XYZ"):
        problems += 2 * ["Compass not calibrated"]
    if not any(p[f"INS_ACCOFFS_{axis}"] for axis in "XYZ"):
        problems.append("3D Accel calibration needed")
    if p["FENCE_ENABLE"] and p["FENCE_MARGIN"] > p["FENCE_RADIUS"]:
        problems.append("FENCE_MARGIN is less than FENCE_RADIUS")
    throttle_min = p["RC3_MIN"] - FS_THR_BELOW_MIN
    if p["FS_THR_ENABLE"] and not FS_THR_LOW <= p["FS_THR_VALUE"] <= throttle_min:
        problems.append("Check FS_THR_VALUE")
    if p["FS_THR_ENABLE"] and p["FS_THR_VALUE"] > p["RC3_MIN"]:
        problems.append("Throttle below Failsafe")
    return problems


def _enforces_remote_id(parameters: Parameters) -> bool:
    """Whether it does not arm without its transponder: bit 0 of DID_OPTIONS, from 4.3."""
    if not parameters.listed.knows("DID_OPTIONS") or not parameters["DID_ENABLE"]:
        return False
    return bool(int(parameters["DID_OPTIONS"]) & 1)


def reasons(state: ArduState, row: int, parameters: Parameters, batteries: Batteries) -> list[str]:
    """The texts without "PreArm: ", in the order in which they are sent; empty: it would arm.

    ARMING_CHECK 0 lifts all but those of the start, the position and the failsafes.
    """
    problems = _of_start(state, row)
    if Mode(int(state.mode[row])) not in ARMABLE:
        problems.append(NOT_ARMABLE)
    if NEEDS_POSITION[state.mode[row]] and not state.position_ok[row]:
        problems.append(NO_POSITION)
    if parameters["ARMING_CHECK"]:
        problems += _of_parameters(parameters) + batteries.reasons(row)
        if state.position_ok[row] and parameters["GPS_HDOP_GOOD"] < HDOP_SCALE * state.hdop[row]:
            problems.append("High GPS HDOP")
        unhealthy = int(state.unhealthy_sensors[row])
        problems += [f"{name} not healthy" for bit, name in SENSOR_NAMES.items() if unhealthy & bit]
        if state.breach[row]:
            problems.append("vehicle outside fence")
    if state.odid_reasons[row] and _enforces_remote_id(parameters):
        problems.append(f"OpenDroneID: {state.odid_reasons[row]}")
    if state.radio_failsafe[row] or radio_is_lost(state, row, parameters):
        problems.append("Radio failsafe on")
    if state.battery_failsafe[row]:
        problems.append("Battery failsafe")
    return problems
