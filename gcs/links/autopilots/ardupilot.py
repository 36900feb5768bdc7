"""ArduCopter: each habit was measured on 4.1-dev (docs/how-to/ardupilot.md), parameters by version are data.

Its modes have no sub mode. Taking off and following setpoints are both GUIDED, which is OFFBOARD here. HOLD
is BRAKE, which stops in half the way of a setpoint at rest. LOITER, POSHOLD, ALT_HOLD and CIRCLE are never
ordered: without a transmitter they sink at 2.4 m/s.
"""

from collections.abc import Mapping
from math import isfinite, nan
from types import MappingProxyType
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.links.autopilots.fence_habits import FenceHabits
from gcs.links.autopilots.profile import CommandLong, Single, Step
from gcs.links.autopilots.versions import Release, load
from gcs.links.link import Command, ParameterValue, Verb
from gcs.mavlink.codec import ARM_DISARM, FLOAT, INT32
from gcs.mavlink.framing import EKF_STATUS_REPORT, GEOFENCE
from gcs.mavlink.kernels import Whole
from gcs.model.response import Response
from gcs.model.setpoint_loss import WithoutSetpoints
from gcs.model.state import Landed, Mask, Mode

_SET_MODE: Final = int(dialect.MAV_CMD_DO_SET_MODE)
_CUSTOM: Final = float(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)

_GUIDED: Final = int(dialect.COPTER_MODE_GUIDED)
_BRAKE: Final = int(dialect.COPTER_MODE_BRAKE)
_RTL: Final = int(dialect.COPTER_MODE_RTL)
_LAND: Final = int(dialect.COPTER_MODE_LAND)

_MODES: Final = MappingProxyType(
    {
        _GUIDED: Mode.OFFBOARD,
        _BRAKE: Mode.HOLD,
        _RTL: Mode.RETURN,
        int(dialect.COPTER_MODE_SMART_RTL): Mode.RETURN,
        _LAND: Mode.LAND,
        int(dialect.COPTER_MODE_ALT_HOLD): Mode.POSITION,
        int(dialect.COPTER_MODE_LOITER): Mode.POSITION,
        int(dialect.COPTER_MODE_POSHOLD): Mode.POSITION,
    }
)

_COMMANDS: Final = MappingProxyType(
    {
        Verb.STANDBY: CommandLong(_SET_MODE, (_CUSTOM, float(_GUIDED))),
        Verb.ARM: CommandLong(ARM_DISARM, (1.0,)),
        Verb.DISARM: CommandLong(ARM_DISARM, (0.0,)),
        Verb.HOLD: CommandLong(_SET_MODE, (_CUSTOM, float(_BRAKE))),
        Verb.OFFBOARD: CommandLong(_SET_MODE, (_CUSTOM, float(_GUIDED))),
        Verb.RETURN: CommandLong(_SET_MODE, (_CUSTOM, float(_RTL))),
        Verb.LAND: CommandLong(_SET_MODE, (_CUSTOM, float(_LAND))),
    }
)

_ESTIMATES: Final = (
    dialect.EKF_ATTITUDE
    | dialect.EKF_VELOCITY_HORIZ
    | dialect.EKF_VELOCITY_VERT
    | dialect.EKF_POS_HORIZ_REL
    | dialect.EKF_POS_HORIZ_ABS
)
_AT_REST_ONLY: Final = dialect.EKF_CONST_POS_MODE
_ESTIMATOR_HZ: Final = 2.0

_NOT_KNOWN: Final = frozenset({31, 83, 105, 111, 132, 141, 230, 331})
"""Messages that are requested of other autopilots, and that it does not know or was not tried with. It
refuses such a request with a STATUSTEXT; what it is not asked for it does not send.
"""

_STANDS_M_S: Final = 0.2

VERSIONS: Final = load("ardupilot")

FLIES_ON, FLIES_ON_S = "GUID_TIMEOUT", VERSIONS.least_default("GUID_TIMEOUT")
"""How long it flies on with its last setpoint; 4.0 has no such parameter, and the same time."""

ACCELERATION: Final = "WP_ACC"
"""It stops within v^2 / (2 a) + 0.45 v (all of 15 recorded stops, from 2 to 10 m/s, a from 1 to 5 m/s^2)."""

UPRIGHT_ACCELERATION, UPRIGHT_ACCELERATION_4_0 = "WP_ACC_Z", "PILOT_ACC_Z"
"""The same up and down; the second in 4.0 (habit 47)."""

ACCELERATION_LEAST_M_S2: Final = 0.5
"""Least possible value of the parameters."""

ACCELERATION_MIN_M_S2: Final = 2.5
"""Least value that is demanded: with 1 it needs 13 m from 5 m/s."""

SWINGS_S: Final = 0.45

RAMP_SHARE: Final = 0.8
"""Of its acceleration that is counted on: a vehicle that turns while it brakes has the rest for the turn."""

LOOP_SHARE: Final = 1.0 / 3.0
"""Of the inner loop's gains. With all of it, or with any trim, it swings about its setpoint when links are
late: it integrates velocity and position errors itself (decision 0049).
"""


_FENCE: Final = FenceHabits(
    title="ArduCopter",
    since=Release(4, 1),
    corners_max=MappingProxyType({Release(4, 0): 84}),
    checked_s=1.0,
    head_corners=0.625,
    polygon_corners=0.25,
)
"""Room is that of a board with 672 bytes for it: 5 for the head, 2 for a polygon, 8 for a corner. A breach is
noticed in a loop of 3.3 Hz, and at 25 Hz from 4.6 on; its documentation says 1 Hz, which is counted on.
"""


def _acceleration_m_s2(parameters: Mapping[str, ParameterValue], *names: str) -> float:
    """The least of those that were read; without any the least default of all versions."""
    read = [VERSIONS.read(name, parameters) for name in names]
    values = [value for value in read if value is not None]
    return min(values) if values else min(map(VERSIONS.least_default, names))


class ArduPilot:
    """An `Autopilot`."""

    name: Final = "ardupilot"
    title: Final = "ArduPilot"
    number: Final = int(dialect.MAV_AUTOPILOT_ARDUPILOTMEGA)
    component_parameter: Final = ""
    versions: Final = VERSIONS
    takeoff_ends_with_setpoints: Final = True
    stops_on_setpoint_only: Final = True
    health_by_mavsdk: Final = False
    falls_on_ground: Final = True
    complains: Final = ("PreArm: ", 65.0)  # every 30 s; one round may be lost
    fence: Final = _FENCE
    modes: Final[Mapping[Verb, frozenset[Mode]]] = MappingProxyType(
        {
            Verb.STANDBY: frozenset({Mode.OFFBOARD}),
            Verb.TAKEOFF: frozenset({Mode.OFFBOARD}),
            Verb.HOLD: frozenset({Mode.HOLD}),
            Verb.OFFBOARD: frozenset({Mode.OFFBOARD}),
            Verb.LAND: frozenset({Mode.LAND}),
            Verb.RETURN: frozenset({Mode.RETURN}),
        }
    )

    def mode(self, custom_mode: int) -> Mode:
        """The mode's number."""
        return _MODES.get(custom_mode, Mode.OTHER)

    def steps(self, command: Command) -> tuple[Step, ...]:
        """The take-off is to a height above home, which is where it was armed."""
        if command.verb is Verb.TAKEOFF:
            nothing = (0.0,) * 6
            return (CommandLong(int(dialect.MAV_CMD_NAV_TAKEOFF), (*nothing, float(command.height_m))),)
        return (_COMMANDS[command.verb],)

    def rests_in(self, mode: Mode) -> bool:
        """Its pre-arm check is that of the current mode: only in GUIDED does it speak of GUIDED."""
        return mode is Mode.OFFBOARD

    def climb_ended(self, mode: Mode, landed: Landed, up_m_s: float) -> bool:
        """It reports IN_AIR some 2 m below the height, and then rises to it."""
        return landed is Landed.IN_AIR and isfinite(up_m_s) and abs(up_m_s) < _STANDS_M_S

    def ready(self, custom_mode: Whole, estimator_flags: Whole) -> Mask:
        """In GUIDED, with an estimated position. In STABILIZE its check passes without one."""
        estimates = (estimator_flags & _ESTIMATES == _ESTIMATES) & (estimator_flags & _AT_REST_ONLY == 0)
        ready: Mask = (custom_mode == _GUIDED) & (estimator_flags >= 0) & estimates
        return ready

    def beyond_fence(self, unhealthy_sensors: int) -> bool:
        """No text does, and its state is not that of a failsafe."""
        return unhealthy_sensors >= 0 and unhealthy_sensors & GEOFENCE != 0

    def without_setpoints(
        self,
        action: str,
        loss_s: float,
        parameters: Mapping[str, ParameterValue],
    ) -> WithoutSetpoints:
        """It flies on, stops as for a setpoint at rest, and hovers in GUIDED until heartbeats are lost."""
        level_m_s2 = _acceleration_m_s2(parameters, ACCELERATION)
        return_height_m = VERSIONS.read("RTL_ALT_M", parameters)
        return WithoutSetpoints(
            flies_on_s=float(parameters.get(FLIES_ON, FLIES_ON_S)),
            lag_s=SWINGS_S,
            deceleration_m_s2=max(level_m_s2, ACCELERATION_LEAST_M_S2),
            action="land" if action == "descend" else action,
            changes_mode=False,
            return_height_m=nan if return_height_m is None else return_height_m,
        )

    def response(self, parameters: Mapping[str, ParameterValue]) -> Response:
        """A ramp, level and up and down: the gentlest one counts."""
        level_m_s2 = _acceleration_m_s2(parameters, ACCELERATION)
        upright_m_s2 = _acceleration_m_s2(parameters, UPRIGHT_ACCELERATION, UPRIGHT_ACCELERATION_4_0)
        least_m_s2 = max(min(level_m_s2, upright_m_s2), ACCELERATION_LEAST_M_S2)
        return Response(
            acceleration_m_s2=RAMP_SHARE * least_m_s2,
            swings_s=SWINGS_S,
            loop_share=LOOP_SHARE,
            lead_share=0.0,
            trim_share=0.0,
        )

    def streams_hz(self, desired_hz: Mapping[int, float]) -> Mapping[int, float]:
        offered = {message: rate_hz for message, rate_hz in desired_hz.items() if message not in _NOT_KNOWN}
        return {**offered, EKF_STATUS_REPORT: _ESTIMATOR_HZ}

    def encoded(self, value: ParameterValue) -> tuple[Single, int]:
        """The number itself; it converts to the type that the parameter has."""
        return np.array([value], np.float32), INT32 if isinstance(value, int) else FLOAT

    def decoded(self, value: Single, kind: int) -> ParameterValue:
        number = float(value[0])
        return number if kind == FLOAT or not isfinite(number) else int(number)
