"""ArduCopter's parameters that decide whether losing the ground station is safe. Pure.

One table, as for PX4: the requirement, its reason, and what `gcs params apply` sets. Names and defaults are
those of ArduCopter 4.1, with the names of later versions where they differ (docs/how-to/ardupilot.md).
Without setpoints it flies on, stops, and hovers in GUIDED without end: the action is that of its failsafe for
lost heartbeats, which counts those of one station only.
"""

from math import ceil
from typing import Final

from gcs.config.sections import OperationSettings
from gcs.control import ControlSettings
from gcs.links.autopilots.ardupilot import (
    ACCELERATION,
    ACCELERATION_MIN_CM_S2,
    FLIES_ON,
    FLIES_ON_S,
    SWINGS_S,
)
from gcs.planning.lost_space import AUTO_CRUISE_M_S
from gcs.preflight.autopilots.common import WIDEST, least_tilt_deg, own_fence_m, own_fence_reasons
from gcs.preflight.requirement import Requirement

HEARTBEAT_ACTIONS: Final = {"hold": (0, 7), "return": (1,), "land": (5,), "descend": (5,)}
"""Values of FS_GCS_ENABLE: 0 hovers on, 1 RTL, 5 LAND, 7 BRAKE (of later versions)."""

LOW_BATTERY_ACTIONS: Final = (1, 2, 3, 4)  # BATT_FS_LOW_ACT: LAND, RTL, SMART_RTL or RTL, SMART_RTL or LAND
RADIO_ACTIONS: Final = (1, 2, 3, 4, 5)  # FS_THR_ENABLE
FENCE_STOPS: Final = 4  # FENCE_ACTION: BRAKE
FENCE_WALLS: Final = (3, 7)  # FENCE_TYPE: height and circle; polygons besides
CM: Final = 100
ARMED_AT_LEAST_S, ARMED_AT_MOST_S = 5, 30
"""Of DISARM_DELAY: the take-off follows the arming at once, but later where the link loses messages."""

JERK_MIN_M_S3: Final = 5.0
RETURNS_CM_S: Final = int(AUTO_CRUISE_M_S * CM)


def requirements(
    operation: OperationSettings, control: ControlSettings, return_height_m: float, station_id: int
) -> tuple[Requirement, ...]:
    """Return the requirements of a vehicle that returns at that height, for a station of that system id."""
    return (
        *_losing_us(operation, return_height_m, station_id),
        *_its_own_failsafes(operation),
        *_speeds(control),
        *_last_wall(operation, control),
    )


def _losing_us(operation: OperationSettings, height_m: float, station_id: int) -> tuple[Requirement, ...]:
    action, loss_s = operation.setpoint_loss_action, operation.setpoint_loss_s
    choices, later_s = HEARTBEAT_ACTIONS[action], ceil(loss_s) + 1
    ours = "its failsafe for lost heartbeats counts those of this system id only: this station's"
    does = f"what it does without our heartbeats: operation.setpoint_loss_action is {action}"
    if action == "hold":
        does += ", so it follows its setpoints, and hovers where these end as well"
    until = "seconds without heartbeats until it does that: later than for setpoints, but not never"
    on = "seconds that it flies on without setpoints: operation.setpoint_loss_s"
    lacking = (
        f"it flies on for {FLIES_ON_S:g} s after its last setpoint (operation.setpoint_loss_s is {loss_s:g}),"
        " and then hovers without end unless its heartbeat failsafe acts"
    )
    returns = (
        "cm above home at which it returns, each vehicle higher than the one before it in the list:"
        " operation.return_height_m and return_layer_m"
    )
    height_cm = round(height_m * CM)
    no_cone = "else it returns lower near home, through the heights of others"
    lands = "cm: at home it lands, and does not hover"
    cruises = "cm/s on its way home: the space closed to others counts on no more; 0 is WPNAV_SPEED"
    own_id = Requirement("MAV_GCS_SYSID", station_id, ours, choices=(station_id,))
    return (
        Requirement("SYSID_MYGCS", station_id, ours, choices=(station_id,), otherwise=own_id),
        Requirement("FS_GCS_ENABLE", choices[0], does, choices=choices),
        Requirement("FS_GCS_TIMEOUT", float(max(5, later_s)), until, least=later_s, most=60.0, lacking=""),
        Requirement(FLIES_ON, loss_s, on, least=min(0.5, loss_s), most=loss_s, alike=True, lacking=lacking),
        Requirement("RTL_ALT", height_cm, returns, least=height_cm - 50, most=height_cm + 50),
        Requirement("RTL_CONE_SLOPE", 0.0, no_cone, choices=(0,)),
        Requirement("RTL_ALT_FINAL", 0, lands, choices=(0,)),
        Requirement("RTL_SPEED", RETURNS_CM_S, cruises, least=100, most=RETURNS_CM_S),
    )


def _its_own_failsafes(operation: OperationSettings) -> tuple[Requirement, ...]:
    checked = "its own checks before arming, all of them"
    skipped = Requirement("ARMING_SKIPCHK", 0, checked, choices=(0,))
    low, critical = "on a low battery it comes down", "on a critical battery it lands where it is"
    blind = "without a position it lands"
    waits = "seconds after which it disarms on the ground; 0: never"
    flown = (
        "where a pilot may take over (operation.pilot_takes_over) it must notice the loss of the transmitter"
    )
    alone = (
        "without transmitters (operation.pilot_takes_over is false) this failsafe would refuse every start"
    )
    radio = RADIO_ACTIONS if operation.pilot_takes_over else (0,)
    why = flown if operation.pilot_takes_over else alone
    delay_s = 10
    return (
        Requirement("ARMING_CHECK", 1, checked, choices=(1,), otherwise=skipped),
        Requirement("FS_THR_ENABLE", radio[0], why, choices=radio),
        Requirement("FS_EKF_ACTION", 1, blind, choices=(1, 3)),
        Requirement("BATT_FS_LOW_ACT", 2, low, choices=LOW_BATTERY_ACTIONS),
        Requirement("BATT_FS_CRT_ACT", 1, critical, choices=(1,)),
        Requirement("DISARM_DELAY", delay_s, waits, least=ARMED_AT_LEAST_S, most=ARMED_AT_MOST_S),
    )


def _speeds(control: ControlSettings) -> tuple[Requirement, ...]:
    limits, stop_m_s2 = control.safety.limits, control.safety.braking.deceleration_m_s2
    stop_cm_s2, tilt_cdeg = stop_m_s2 * CM, least_tilt_deg(control) * CM
    level_cm_s2 = max(ACCELERATION_MIN_CM_S2, stop_cm_s2)
    stops = "cm/s^2: control.safety.braking counts on vehicles that stop so hard, and it swings beyond"
    clipped = "cm/s: later versions clip setpoints to it"
    slowly = "m/s^3: with less it begins to brake later"
    tilts = "hundredths of degrees: control.acceleration_max_m_s2, and as much again against the wind"
    level, up, down = limits.horizontal_m_s * CM, limits.up_m_s * CM, limits.down_m_s * CM
    return (
        Requirement(ACCELERATION, level_cm_s2, stops, least=level_cm_s2),
        Requirement("PILOT_ACCEL_Z", ceil(max(250.0, stop_cm_s2)), stops, least=stop_cm_s2),
        Requirement("PSC_JERK_XY", JERK_MIN_M_S3, slowly, least=JERK_MIN_M_S3, lacking=""),
        Requirement("WPNAV_SPEED", max(500.0, level), clipped, least=level),
        Requirement("WPNAV_SPEED_UP", max(250.0, up), clipped, least=up),
        Requirement("WPNAV_SPEED_DN", max(150.0, down), clipped, least=down),
        Requirement("ANGLE_MAX", ceil(max(4500.0, tilt_cdeg)), tilts, least=tilt_cdeg, most=8000.0),
    )


def _last_wall(operation: OperationSettings, control: ControlSettings) -> tuple[Requirement, ...]:
    brakes_m_s2, fastest_m_s = ACCELERATION_MIN_CM_S2 / CM, control.safety.limits.horizontal_m_s
    on_s = FLIES_ON_S + SWINGS_S + fastest_m_s / (2.0 * brakes_m_s2)
    wide_m, tall_m = own_fence_m(operation, control, on_s)
    far, high = own_fence_reasons(operation)
    wall, stops = "its own fence is the last wall", "beyond its own fence it stops: the last wall"
    bends = "it may bend velocities at its own fence (1), but not elsewhere: nothing reports that it does"
    return (
        Requirement("FENCE_ENABLE", 1, wall, choices=(1,)),
        Requirement("FENCE_TYPE", FENCE_WALLS[0], wall, choices=FENCE_WALLS),
        Requirement("FENCE_ACTION", FENCE_STOPS, stops, choices=(FENCE_STOPS,)),
        Requirement("FENCE_RADIUS", wide_m, far, least=wide_m, most=WIDEST * wide_m),
        Requirement("FENCE_ALT_MAX", tall_m, high, least=tall_m, most=WIDEST * tall_m),
        Requirement("AVOID_ENABLE", 1, bends, choices=(0, 1)),
    )
