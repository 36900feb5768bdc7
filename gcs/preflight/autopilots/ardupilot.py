"""ArduCopter's parameters that decide whether losing the ground station is safe. Pure.

One table, as for PX4: the requirement, its reason, and what `gcs params apply` sets, in names and units of
4.7. Earlier ones: `gcs/links/autopilots/versions`. Without setpoints it flies on, stops, and hovers in GUIDED
without end: the action is that of its failsafe for lost heartbeats, which counts those of one station only.
"""

from math import ceil
from typing import Final

from gcs.config.sections import OperationSettings
from gcs.control import ControlSettings
from gcs.links.autopilots.ardupilot import (
    ACCELERATION,
    ACCELERATION_MIN_M_S2,
    FLIES_ON,
    FLIES_ON_S,
    SWINGS_S,
    UPRIGHT_ACCELERATION,
    UPRIGHT_ACCELERATION_4_0,
)
from gcs.planning.lost_space import AUTO_CRUISE_M_S
from gcs.preflight.autopilots.common import (
    WIDEST,
    highest_wall_m,
    least_tilt_deg,
    own_fence_m,
    own_fence_reasons,
)
from gcs.preflight.requirement import Equipment, Requirement

HEARTBEAT_ACTIONS: Final = {"hold": (0, 7), "return": (1,), "land": (5,), "descend": (5,)}
"""Values of FS_GCS_ENABLE: 0 hovers on, 1 RTL, 5 LAND, 7 BRAKE."""

COMMANDED_MODES: Final = 1 << 4 | 1 << 12
"""In FLTMODE_GCSBLOCK: GUIDED and BRAKE. It has no bits for RTL and LAND."""

UNSTABILISED: Final = 1 << 4 | 1 << 5  # GUID_OPTIONS: of the position, of the velocity
CONTINUES: Final = 1 << 1 | 1 << 2  # FS_OPTIONS: in AUTO without a station, in GUIDED without a transmitter
GOES_ON_BY_HAND: Final = 16  # FS_OPTIONS, as delivered: in modes that a pilot flies, without a station
LOW_BATTERY_ACTIONS: Final = (1, 2, 3, 4)  # BATT_FS_LOW_ACT: LAND, RTL, SMART_RTL or RTL, SMART_RTL or LAND
RADIO_ACTIONS: Final = (1, 2, 3, 4, 5)  # FS_THR_ENABLE
FENCE_STOPS: Final = 4  # FENCE_ACTION: BRAKE
FENCE_WALLS: Final = (3, 7)  # FENCE_TYPE: height and circle; polygons besides
OBEYS_NOTHING_BEYOND, ANY_INCLUSION = 1, 2  # bits of FENCE_OPTIONS
ENFORCES_ARMING: Final = (1, 3, 5, 7)  # DID_OPTIONS with bit 0, whatever bits 1 and 2 are
ABOVE_HOME: Final = 1  # FENCE_ALT_MAX_TP
ARMED_AT_LEAST_S, ARMED_AT_MOST_S = 5, 30
"""Of DISARM_DELAY: the take-off follows the arming at once, but later where the link loses messages."""

JERK_MIN_M_S3: Final = 5.0


def requirements(
    operation: OperationSettings,
    control: ControlSettings,
    return_height_m: float,
    station_id: int,
    equipment: Equipment = Equipment(),  # noqa: B008 (a tuple)
) -> tuple[Requirement, ...]:
    """Return the requirements of a vehicle that returns at that height, for a station of that system id."""
    return (
        *_losing_us(operation, station_id),
        *_its_return(return_height_m),
        *_its_own_failsafes(operation),
        *_speeds(control),
        *_last_wall(operation, control, equipment),
        *_identified(equipment),
    )


def _losing_us(operation: OperationSettings, station_id: int) -> tuple[Requirement, ...]:
    action, loss_s = operation.setpoint_loss_action, operation.setpoint_loss_s
    choices, later_s = HEARTBEAT_ACTIONS[action], ceil(loss_s) + 1
    ours = "its failsafe for lost heartbeats counts those of this system id only: this station's"
    alone = "above 0 it counts the heartbeats of further stations, and does not notice that ours ended"
    does = f"what it does without our heartbeats: operation.setpoint_loss_action is {action}"
    if action == "hold":
        does += ", so it follows its setpoints, and hovers where these end as well"
    until = "without heartbeats until it does that: later than for setpoints, but not never"
    on = "that it flies on without setpoints: operation.setpoint_loss_s"
    lacking = (
        f"it flies on for {FLIES_ON_S:g} s after its last setpoint (operation.setpoint_loss_s is {loss_s:g}),"
        " and then hovers without end unless its heartbeat failsafe acts"
    )
    steered = "with these it does not hold the position or velocity of its setpoints"
    acts = "with these its failsafes for lost heartbeats and transmitters do nothing"
    obeys = "with these it refuses the modes that this station commands"
    return (
        Requirement("MAV_GCS_SYSID", station_id, ours, choices=(station_id,)),
        Requirement("MAV_GCS_SYSID_HI", 0, alone, choices=(0, station_id)),
        Requirement("FS_GCS_ENABLE", choices[0], does, choices=choices),
        Requirement("FS_GCS_TIMEOUT", float(max(5, later_s)), until, least=later_s, most=60.0),
        Requirement(FLIES_ON, loss_s, on, least=min(0.5, loss_s), most=loss_s, alike=True, lacking=lacking),
        Requirement("FS_OPTIONS", GOES_ON_BY_HAND, acts, without=CONTINUES),
        Requirement("GUID_OPTIONS", 0, steered, without=UNSTABILISED),
        Requirement("FLTMODE_GCSBLOCK", 0, obeys, without=COMMANDED_MODES),
    )


def _its_return(height_m: float) -> tuple[Requirement, ...]:
    returns = (
        "above home at which it returns, each vehicle higher than the one before it in the list:"
        " operation.return_height_m and return_layer_m"
    )
    no_cone = "else it returns lower near home, through the heights of others"
    climbs = "else it climbs first, into the heights of others"
    above = "heights of return count from home, as those of the others do"
    lands = "at home it lands, and does not hover"
    cruises = "on its way home: the space closed to others counts on no more; 0 is WP_SPD"
    return (
        Requirement("RTL_ALT_M", height_m, returns, least=height_m - 0.5, most=height_m + 0.5),
        Requirement("RTL_CONE_SLOPE", 0.0, no_cone, choices=(0,)),
        Requirement("RTL_CLIMB_MIN_M", 0.0, climbs, choices=(0,)),
        Requirement("RTL_ALT_TYPE", 0, above, choices=(0,)),
        Requirement("RTL_ALT_FINAL_M", 0.0, lands, choices=(0,)),
        Requirement("RTL_SPEED_MS", AUTO_CRUISE_M_S, cruises, least=1.0, most=AUTO_CRUISE_M_S),
    )


def _its_own_failsafes(operation: OperationSettings) -> tuple[Requirement, ...]:
    checked = "its own checks before arming, all of them"
    low, critical = "on a low battery it comes down", "on a critical battery it lands where it is"
    blind = "without a position it lands"
    guesses = "without a position it would return by dead reckoning, across the ways of others"
    waits = "after which it disarms on the ground; 0: never"
    flown = (
        "where a pilot may take over (operation.pilot_takes_over) it must notice the loss of the transmitter"
    )
    alone = (
        "without transmitters (operation.pilot_takes_over is false) this failsafe would refuse every start"
    )
    radio = RADIO_ACTIONS if operation.pilot_takes_over else (0,)
    why = flown if operation.pilot_takes_over else alone
    never = "and {} are 0, so its action for a {} battery never comes: set one for its battery"
    return (
        Requirement("ARMING_SKIPCHK", 0, checked, choices=(0,)),
        Requirement("FS_THR_ENABLE", radio[0], why, choices=radio),
        Requirement("FS_EKF_ACTION", 1, blind, choices=(1, 3)),
        Requirement("FS_DR_ENABLE", 1, guesses, choices=(0, 1)),
        Requirement("BATT_FS_LOW_ACT", 2, low, choices=LOW_BATTERY_ACTIONS),
        Requirement("BATT_FS_CRT_ACT", 1, critical, choices=(1,)),
        *(
            Requirement(
                f"BATT_{level}_VOLT",
                0.0,
                "",
                least=0.1,
                risk=never.format(f"BATT_{level}_MAH", word),
                unless=f"BATT_{level}_MAH",
            )
            for level, word in (("LOW", "low"), ("CRT", "critical"))
        ),
        Requirement("DISARM_DELAY", 10, waits, least=ARMED_AT_LEAST_S, most=ARMED_AT_MOST_S),
    )


def _speeds(control: ControlSettings) -> tuple[Requirement, ...]:
    limits, stop_m_s2 = control.safety.limits, control.safety.braking.deceleration_m_s2
    tilt_deg, level_m_s2 = least_tilt_deg(control), max(ACCELERATION_MIN_M_S2, stop_m_s2)
    stops = "control.safety.braking counts on vehicles that stop so hard, and it swings beyond"
    clipped = "it clips setpoints to it"
    slowly = "with less it begins to brake later"
    tilts = "control.acceleration_max_m_s2, and as much again against the wind"
    level, up, down = limits.horizontal_m_s, limits.up_m_s, limits.down_m_s
    upright_m_s2 = max(2.5, stop_m_s2)
    return (
        Requirement(ACCELERATION, level_m_s2, stops, least=level_m_s2),
        Requirement(UPRIGHT_ACCELERATION, upright_m_s2, stops, least=stop_m_s2),
        Requirement(UPRIGHT_ACCELERATION_4_0, upright_m_s2, stops, least=stop_m_s2),
        Requirement("PSC_NE_JERK", JERK_MIN_M_S3, slowly, least=JERK_MIN_M_S3),
        Requirement("PSC_D_JERK", JERK_MIN_M_S3, slowly, least=JERK_MIN_M_S3),
        Requirement("WP_SPD", max(5.0, level), clipped, least=level),
        Requirement("WP_SPD_UP", max(2.5, up), clipped, least=up),
        Requirement("WP_SPD_DN", max(1.5, down), clipped, least=down),
        Requirement("PILOT_SPD_UP", max(2.5, up), clipped, least=up),
        Requirement("PILOT_SPD_DN", max(1.5, down), f"{clipped}; 0 is PILOT_SPEED_UP", least=down, also=(0,)),
        Requirement("ATC_ANGLE_MAX", max(45.0, tilt_deg), tilts, least=tilt_deg, most=80.0),
        Requirement("PSC_ANGLE_MAX", 0.0, f"{tilts}; 0: no further limit", least=tilt_deg, also=(0,)),
    )


def _identified(equipment: Equipment) -> tuple[Requirement, ...]:
    if not equipment.remote_id:
        return ()
    passes = (
        "it serves the transponder for Remote ID: remote_id.require; its firmware must be built with that"
    )
    arms = (
        "bit 0: it must not be armed without a transponder for Remote ID (remote_id.require);"
        " listed as soon as DID_ENABLE is 1"
    )
    return (
        Requirement("DID_ENABLE", 1, passes, choices=(1,)),
        Requirement("DID_OPTIONS", ENFORCES_ARMING[0], arms, choices=ENFORCES_ARMING),
    )


def _last_wall(
    operation: OperationSettings, control: ControlSettings, equipment: Equipment
) -> tuple[Requirement, ...]:
    brakes_m_s2, fastest_m_s = ACCELERATION_MIN_M_S2, control.safety.limits.horizontal_m_s
    on_s = FLIES_ON_S + SWINGS_S + fastest_m_s / (2.0 * brakes_m_s2)
    wide_m, tall_m = own_fence_m(operation, control, on_s)
    far, high = own_fence_reasons(operation)
    highest_m = highest_wall_m(tall_m, equipment.top_m)
    wall, stops = "its own fence is the last wall", "beyond its own fence it stops: the last wall"
    bends = "it may bend velocities at its own fence (1), but not elsewhere: nothing reports that it does"
    obeys = "else it refuses commands of this station beyond its fence"
    above = "the height of its fence counts from home"
    walls: tuple[int, ...] = FENCE_WALLS
    without = OBEYS_NOTHING_BEYOND
    if equipment.polygons:
        wall += ", with the uploaded polygons"
        obeys += ", and with bit 1 one of several inclusion areas is enough"
        walls, without = FENCE_WALLS[1:], without | ANY_INCLUSION
    return (
        Requirement("FENCE_ENABLE", 1, wall, choices=(1,)),
        Requirement("FENCE_AUTOENABLE", 0, f"{wall}, also while it lands", choices=(0, 3)),
        Requirement("FENCE_OPTIONS", 0, obeys, without=without),
        Requirement("FENCE_TYPE", walls[0], wall, choices=walls),
        Requirement("FENCE_ACTION", FENCE_STOPS, stops, choices=(FENCE_STOPS,)),
        Requirement("FENCE_RADIUS", wide_m, far, least=wide_m, most=WIDEST * wide_m),
        Requirement("FENCE_ALT_MAX", tall_m, high, least=tall_m, most=highest_m),
        Requirement("FENCE_ALT_MAX_TP", ABOVE_HOME, above, choices=(ABOVE_HOME,)),
        Requirement("AVOID_ENABLE", 1, bends, choices=(0, 1)),
    )
