"""PX4's parameters that decide whether losing the ground station is safe. Pure.

One table: the requirement, its reason, and what `gcs params apply` sets. In which versions each counts is in
`gcs/links/autopilots/versions/px4.toml`.
"""

from math import ceil
from typing import Final

from gcs.config.sections import OperationSettings
from gcs.control import ControlSettings
from gcs.links.autopilots.px4 import LOSS_TIME
from gcs.model.setpoint_loss import STOP_S
from gcs.planning.lost_space import AUTO_CRUISE_M_S
from gcs.preflight.autopilots.common import (
    WIDEST,
    highest_wall_m,
    least_tilt_deg,
    own_fence_m,
    own_fence_reasons,
)
from gcs.preflight.requirement import Equipment, Requirement

SETPOINT_LOSS_ACTIONS: Final = {"descend": 0, "return": 3, "land": 4, "hold": 5}
"""Values of COM_OBL_RC_ACT; 0 is POSITION, in which a vehicle without a pilot descends."""

DATA_LINK_LOSS_ACTIONS: Final = {"descend": (0,), "return": (0, 2), "land": (0, 3), "hold": (0, 1)}
"""Values of NAV_DLL_ACT that do nothing beyond what the setpoint-loss action already does."""

WITHOUT_STICKS_LANDS: Final = 3  # NAV_RCL_ACT: LAND
LANDS_WITHIN_S: Final = 5.0
LOW_BATTERY_ACTIONS: Final = (3, 2)  # COM_LOW_BAT_ACT: RETURN and later LAND, LAND; 0 only warns
NO_MANUAL_CONTROL: Final = 4  # COM_RC_IN_MODE
STICKS_TAKE_OVER: Final = 3  # COM_RC_OVERRIDE: bit 0 in the automatic modes, bit 1 in OFFBOARD
OVERRIDE_SPEEDS_PER_S: Final = (0.1, 3.0)  # MAN_OVERRIDE_SPD; negative: never, and 0 by noise
FENCE_HOLDS: Final = 2  # GF_ACTION
ODID_REFUSES: Final = 2  # COM_ARM_ODID; 3 to 5 of 1.18 bring it down in flight as well


def requirements(
    operation: OperationSettings,
    control: ControlSettings,
    return_height_m: float,
    station_id: int = 0,
    equipment: Equipment = Equipment(),  # noqa: B008 (a tuple)
) -> tuple[Requirement, ...]:
    """Return the requirements of a vehicle that returns at that height (`Config.return_heights_m`)."""
    return (
        *_losing_us(operation),
        *_its_return(return_height_m),
        *_its_own_habits(),
        *_the_pilot(operation),
        *_speeds(control),
        *_last_wall(operation, control, equipment),
        *_identified(equipment),
    )


def _losing_us(operation: OperationSettings) -> tuple[Requirement, ...]:
    action, loss_s = operation.setpoint_loss_action, operation.setpoint_loss_s
    number, after = SETPOINT_LOSS_ACTIONS[action], DATA_LINK_LOSS_ACTIONS[action]
    later_s = ceil(loss_s) + 1
    does = f"what it does without setpoints: operation.setpoint_loss_action is {action}"
    until = "without setpoints until it does that: operation.setpoint_loss_s; it flies on meanwhile"
    unlinked = "what it does when our heartbeats alone cease: nothing, or what it does for want of setpoints"
    unlinked_until = "without heartbeats until it does that: later than for setpoints, but not never"
    sticks = "with COM_OBL_RC_ACT 0 it does this without setpoints and without a transmitter; 3 is LAND"
    return (
        Requirement("COM_OBL_RC_ACT", number, does, choices=(number,)),
        Requirement(LOSS_TIME, loss_s, until, least=min(0.5, loss_s), most=loss_s, alike=True),
        *(
            [Requirement("NAV_RCL_ACT", WITHOUT_STICKS_LANDS, sticks, choices=(WITHOUT_STICKS_LANDS,))]
            if action == "descend"
            else []
        ),
        Requirement("NAV_DLL_ACT", after[0], unlinked, choices=after),
        Requirement("COM_DL_LOSS_T", max(10, later_s), unlinked_until, least=later_s, most=60.0),
    )


def _its_return(height_m: float) -> tuple[Requirement, ...]:
    returns = (
        "above home at which it returns, each vehicle higher than the one before it in the list:"
        " operation.return_height_m and return_layer_m"
    )
    no_cone = "else it returns lower near home, through the heights of others"
    direct = "else it returns by a mission or to another place: the space closed round it is straight"
    lands = "for which it hovers at home before it lands; -1: without end"
    cruises = "on its way home: the space closed to others counts on no more"
    cruise_m_s = AUTO_CRUISE_M_S
    return (
        Requirement("RTL_RETURN_ALT", height_m, returns, least=height_m - 0.5, most=height_m + 0.5),
        Requirement("RTL_CONE_ANG", 0, no_cone, choices=(0,)),
        Requirement("RTL_TYPE", 0, direct, choices=(0,)),
        Requirement("RTL_LAND_DELAY", 0.0, lands, least=0.0, most=LANDS_WITHIN_S),
        Requirement("MPC_XY_CRUISE", cruise_m_s, cruises, least=1.0, most=cruise_m_s),
    )


def _its_own_habits() -> tuple[Requirement, ...]:
    low = "on a low battery it comes down; 0, as delivered, only warns"
    blind = "it must not be armed without a position"
    holds = "after its take-off it holds, and begins no mission"
    return (
        Requirement("COM_LOW_BAT_ACT", LOW_BATTERY_ACTIONS[0], low, choices=LOW_BATTERY_ACTIONS),
        Requirement("COM_ARM_WO_GPS", 0, blind, choices=(0,)),
        Requirement("COM_TAKEOFF_ACT", 0, holds, choices=(0,)),
    )


def _identified(equipment: Equipment) -> tuple[Requirement, ...]:
    if not equipment.remote_id:
        return ()
    arms = "it must not be armed without a transponder for Remote ID: remote_id.require"
    return (Requirement("COM_ARM_ODID", ODID_REFUSES, arms, choices=(ODID_REFUSES,)),)


def _the_pilot(operation: OperationSettings) -> tuple[Requirement, ...]:
    if not operation.pilot_takes_over:
        return ()
    inputs = tuple(mode for mode in range(9) if mode != NO_MANUAL_CONTROL)
    able = "a pilot must be able to take over: 4 shuts them out"
    sticks = "moving the sticks takes control of the vehicle, in OFFBOARD too (operation.pilot_takes_over)"
    by_modes = Requirement("COM_RC_OVERRIDE", STICKS_TAKE_OVER, sticks, choices=(STICKS_TAKE_OVER,))
    least_per_s, most_per_s = OVERRIDE_SPEEDS_PER_S
    return (
        Requirement("COM_RC_IN_MODE", 0, able, choices=inputs),
        Requirement("MAN_OVERRIDE_SPD", 1.0, sticks, least=least_per_s, most=most_per_s, otherwise=by_modes),
    )


def _speeds(control: ControlSettings) -> tuple[Requirement, ...]:
    limits, stop_m_s2 = control.safety.limits, control.safety.braking.deceleration_m_s2
    tilt_deg = least_tilt_deg(control)
    clipped = "below, the autopilot clips setpoints axis by axis, which bends them"
    stops = "control.safety.braking counts on vehicles that stop so hard"
    tilts = "control.acceleration_max_m_s2, and as much again against the wind"
    return (
        Requirement("MPC_XY_VEL_MAX", max(12.0, limits.horizontal_m_s), clipped, least=limits.horizontal_m_s),
        Requirement("MPC_Z_VEL_MAX_UP", max(3.0, limits.up_m_s), clipped, least=limits.up_m_s),
        Requirement("MPC_Z_VEL_MAX_DN", max(1.5, limits.down_m_s), clipped, least=limits.down_m_s),
        Requirement("MPC_ACC_HOR", max(3.0, stop_m_s2), stops, least=stop_m_s2),
        Requirement("MPC_ACC_UP_MAX", max(4.0, stop_m_s2), stops, least=stop_m_s2),
        Requirement("MPC_ACC_DOWN_MAX", max(3.0, stop_m_s2), stops, least=stop_m_s2),
        Requirement("MPC_TILTMAX_AIR", max(45.0, tilt_deg), tilts, least=tilt_deg, most=89.0),
    )


def _last_wall(
    operation: OperationSettings, control: ControlSettings, equipment: Equipment
) -> tuple[Requirement, ...]:
    """Return the requirements of the autopilot's own fence."""
    wide_m, tall_m = own_fence_m(operation, control, operation.setpoint_loss_s + STOP_S)
    holds = "beyond its own fence it holds: the last wall"
    if equipment.polygons:
        holds += ", and that of the uploaded polygons"
    far, high = own_fence_reasons(operation)
    highest_m = highest_wall_m(tall_m, equipment.top_m)
    return (
        Requirement("GF_ACTION", FENCE_HOLDS, holds, choices=(FENCE_HOLDS,)),
        Requirement("GF_MAX_HOR_DIST", wide_m, far, least=wide_m, most=WIDEST * wide_m),
        Requirement("GF_MAX_VER_DIST", tall_m, high, least=tall_m, most=highest_m),
    )
