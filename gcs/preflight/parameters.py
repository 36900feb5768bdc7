"""Autopilot parameters that decide whether losing the ground station is safe. Pure.

One table: the requirement, its reason, and what `gcs params apply` sets. The names and defaults are PX4
v1.16's (docs/FACTS.md, section 3).
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import atan, ceil, degrees, inf, isfinite
from typing import Final

from gcs.config.schema import Config
from gcs.config.sections import OperationSettings
from gcs.control import ControlSettings
from gcs.links import ParameterValue
from gcs.model.preflight_report import Check, State
from gcs.model.state import VehicleId
from gcs.planning.lost_space import STOP_S
from gcs.preflight.vehicles import PAD_HEIGHT_MAX_M

SETPOINT_LOSS_ACTIONS: Final = {"descend": 0, "return": 3, "land": 4, "hold": 5}
"""Values of COM_OBL_RC_ACT; 0 is POSITION, in which a vehicle without a pilot descends."""

DATA_LINK_LOSS_ACTIONS: Final = {"descend": (0,), "return": (0, 2), "land": (0, 3), "hold": (0, 1)}
"""Values of NAV_DLL_ACT that do nothing beyond what the setpoint-loss action already does."""

NO_MANUAL_CONTROL: Final = 4  # COM_RC_IN_MODE
STICKS_TAKE_OVER: Final = 3  # COM_RC_OVERRIDE: bit 0 in the automatic modes, bit 1 in OFFBOARD
FENCE_HOLDS: Final = 2  # GF_ACTION
GRAVITY_M_S2: Final = 9.80665
TILT_RESERVE: Final = 2.0
"""Multiple of the commanded acceleration: the rest is for wind and drag."""

WIDEST: Final = 2.0
"""A fence farther away than this multiple of the needed distance protects nothing."""

MEND: Final = "to mend its parameters, stop the service and run: gcs params apply --config FILE"

NEARLY: Final = 1e-4
"""Relative tolerance: parameters are single precision."""


@dataclass(frozen=True, slots=True)
class Requirement:
    """A parameter's requirement: within its bounds, one of `choices` if any, none of `barred`."""

    name: str
    set_to: ParameterValue  # by `gcs params apply`; an int for an INT32
    why: str
    least: float = -inf
    most: float = inf
    choices: tuple[int, ...] = ()
    barred: tuple[int, ...] = ()

    def holds(self, value: ParameterValue) -> bool:
        if not isfinite(value) or value in self.barred:
            return False
        if self.choices:
            return value in self.choices
        slack = NEARLY * max(1.0, abs(value))
        return self.least - slack <= value <= self.most + slack

    @property
    def desired(self) -> str:
        if self.choices:
            return " or ".join(str(choice) for choice in self.choices)
        if self.barred:
            return f"not {' nor '.join(str(number) for number in self.barred)}"
        if isfinite(self.least) and isfinite(self.most):
            return f"{self.least:g} to {self.most:g}"
        return f"at least {self.least:g}" if isfinite(self.least) else f"at most {self.most:g}"


def requirements(
    operation: OperationSettings, control: ControlSettings, return_height_m: float
) -> tuple[Requirement, ...]:
    """Return the requirements of a vehicle that returns at that height (`Config.return_heights_m`)."""
    return (
        *_losing_us(operation, return_height_m),
        *_the_pilot(operation),
        *_speeds(control),
        *_last_wall(operation, control),
    )


def _losing_us(operation: OperationSettings, height_m: float) -> tuple[Requirement, ...]:
    action, loss_s = operation.setpoint_loss_action, operation.setpoint_loss_s
    number, after = SETPOINT_LOSS_ACTIONS[action], DATA_LINK_LOSS_ACTIONS[action]
    later_s = ceil(loss_s) + 1
    does = f"what it does without setpoints: operation.setpoint_loss_action is {action}"
    until = "seconds without setpoints until it does that: operation.setpoint_loss_s; it flies on meanwhile"
    unlinked = "what it does when our heartbeats cease: nothing, or what it did for want of setpoints"
    unlinked_until = "seconds without heartbeats until it does that: later than for setpoints, but not never"
    returns = (
        "metres above home at which it returns, each vehicle higher than the one before it in the list:"
        " operation.return_height_m and return_layer_m"
    )
    no_cone = "else it returns lower near home, through the heights of others"
    return (
        Requirement("COM_OBL_RC_ACT", number, does, choices=(number,)),
        Requirement("COM_OF_LOSS_T", loss_s, until, least=min(0.5, loss_s), most=loss_s),
        Requirement("NAV_DLL_ACT", after[0], unlinked, choices=after),
        Requirement("COM_DL_LOSS_T", max(10, later_s), unlinked_until, least=later_s, most=60.0),
        Requirement("RTL_RETURN_ALT", height_m, returns, least=height_m - 0.5, most=height_m + 0.5),
        Requirement("RTL_CONE_ANG", 0, no_cone, choices=(0,)),
    )


def _the_pilot(operation: OperationSettings) -> tuple[Requirement, ...]:
    if not operation.pilot_takes_over:
        return ()
    inputs = tuple(mode for mode in range(9) if mode != NO_MANUAL_CONTROL)
    able = "a pilot must be able to take over: 4 shuts them out"
    sticks = "moving the sticks takes control of the vehicle, in OFFBOARD too (operation.pilot_takes_over)"
    return (
        Requirement("COM_RC_IN_MODE", 0, able, choices=inputs),
        Requirement("COM_RC_OVERRIDE", STICKS_TAKE_OVER, sticks, choices=(STICKS_TAKE_OVER,)),
    )


def _speeds(control: ControlSettings) -> tuple[Requirement, ...]:
    limits, stop_m_s2 = control.safety.limits, control.safety.braking.deceleration_m_s2
    tilt_deg = float(ceil(degrees(atan(TILT_RESERVE * control.acceleration_max_m_s2 / GRAVITY_M_S2))))
    clipped = "below, the autopilot clips setpoints axis by axis, which bends them"
    stops = "m/s^2: control.safety.braking counts on vehicles that stop so hard"
    tilts = "degrees: control.acceleration_max_m_s2, and as much again against the wind"
    return (
        Requirement("MPC_XY_VEL_MAX", max(12.0, limits.horizontal_m_s), clipped, least=limits.horizontal_m_s),
        Requirement("MPC_Z_VEL_MAX_UP", max(3.0, limits.up_m_s), clipped, least=limits.up_m_s),
        Requirement("MPC_Z_VEL_MAX_DN", max(1.5, limits.down_m_s), clipped, least=limits.down_m_s),
        Requirement("MPC_ACC_HOR", max(3.0, stop_m_s2), stops, least=stop_m_s2),
        Requirement("MPC_ACC_UP_MAX", max(4.0, stop_m_s2), stops, least=stop_m_s2),
        Requirement("MPC_ACC_DOWN_MAX", max(3.0, stop_m_s2), stops, least=stop_m_s2),
        Requirement("MPC_TILTMAX_AIR", max(45.0, tilt_deg), tilts, least=tilt_deg, most=89.0),
    )


def _last_wall(operation: OperationSettings, control: ControlSettings) -> tuple[Requirement, ...]:
    """Return the requirements of the autopilot's own fence.

    It is a cylinder round each vehicle's own home, where it was armed; the service's fence is centred on the
    show's origin. A vehicle at the service's fence, opposite its pad, is farther from home by the distance of
    its pad from the origin. It may also overshoot by the distance it flies until it has noticed and stopped.
    """
    fence, limits, pads_m = control.safety.fence, control.safety.limits, operation.pads_within_m
    on_s = operation.setpoint_loss_s + STOP_S
    wide_m = float(ceil(fence.distance_max_m + pads_m + limits.horizontal_m_s * on_s))
    highest_m = max(fence.height_max_m, operation.return_height_m)
    tall_m = float(ceil(highest_m + PAD_HEIGHT_MAX_M + limits.up_m_s * on_s))
    holds = "beyond its own fence it holds: the last wall"
    wall = "m from its own start: the service's fence, and room for"
    far = f"{wall} pads {pads_m:g} m from the origin (operation.pads_within_m) and its stop"
    high = f"{wall} pads {PAD_HEIGHT_MAX_M:g} m below the origin and its stop"
    return (
        Requirement("GF_ACTION", FENCE_HOLDS, holds, choices=(FENCE_HOLDS,)),
        Requirement("GF_MAX_HOR_DIST", wide_m, far, least=wide_m, most=WIDEST * wide_m),
        Requirement("GF_MAX_VER_DIST", tall_m, high, least=tall_m, most=WIDEST * tall_m),
    )


def requirements_of(config: Config) -> dict[VehicleId, tuple[Requirement, ...]]:
    """Return the requirements of each vehicle: their heights of return differ."""
    heights_m = config.return_heights_m.tolist()
    at_height = {
        height_m: requirements(config.operation, config.control, height_m) for height_m in set(heights_m)
    }
    return dict(zip(config.ids, map(at_height.__getitem__, heights_m), strict=True))


def settings_of(config: Config) -> dict[str, ParameterValue | list[ParameterValue]]:
    """Return what `gcs params apply` would set, of simulated vehicles: a value of all, or one of each."""
    settings: dict[str, ParameterValue | list[ParameterValue]] = {}
    for same in zip(*requirements_of(config).values(), strict=True):
        values = [requirement.set_to for requirement in same]
        settings[same[0].name] = values[0] if len(set(values)) == 1 else values
    return settings


def broken(
    needed: Sequence[Requirement], values: Mapping[str, ParameterValue]
) -> list[tuple[Requirement, ParameterValue | None]]:
    """Return the requirements that `values` do not meet, with the value; None if it is missing."""
    return [
        (requirement, values.get(requirement.name))
        for requirement in needed
        if requirement.name not in values or not requirement.holds(values[requirement.name])
    ]


GROUPS: Final = {"MPC_": "speed limits", "GF_": "own fence"}
"""Names of checks by prefix of the parameter; all others have the parameter's name."""

OTHERS: Final = "parameters"


def parameter_checks(
    needed: Sequence[Requirement], read: Mapping[str, ParameterValue] | None, problem: str | None
) -> list[Check]:
    """Return the parameter checks of one vehicle, with the command that fixes failures.

    A show needs no more than the service: its limits and its fence are within the service's. `read` is None
    while the values are not known, for the reason `problem` after a failed attempt.
    """
    if read is None:
        text = f"parameters not read yet{f': {problem}' if problem else '; it is being asked'}"
        return [Check(OTHERS, State.UNKNOWN, limit=f"{len(needed)} hold", problem=text, to_do="wait")]
    checks = [_wrong(requirement, value) for requirement, value in broken(needed, read)]
    wrong = {check.name for check in checks}
    for name, count in Counter(group_of(requirement.name) for requirement in needed).items():
        if name not in wrong:
            checks.append(Check(name, State.PASS, count, "parameters", f"{count} hold"))
    return checks


@cache
def group_of(name: str) -> str:
    return next((group for start, group in GROUPS.items() if name.startswith(start)), OTHERS)


def _wrong(requirement: Requirement, value: ParameterValue | None) -> Check:
    found = "not there" if value is None else f"{value:g}"
    return Check(
        group_of(requirement.name),
        State.FAIL,
        None if value is None or not isfinite(value) else float(value),
        "",
        f"{requirement.name}: {requirement.desired}",
        f"{requirement.name} is {found}, {requirement.desired} is needed ({requirement.why})",
        MEND,
    )
