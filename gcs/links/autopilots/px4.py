"""PX4: its habits were measured on v1.16 (docs/FACTS.md, section 3), parameters by version are data."""

from collections.abc import Mapping
from math import inf, nan
from types import MappingProxyType
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import development as dialect

from gcs.links.autopilots.fence_habits import FenceHabits
from gcs.links.autopilots.profile import CommandLong, SetParameter, Single, Step
from gcs.links.autopilots.versions import Release, load
from gcs.links.link import Command, ParameterValue, Verb
from gcs.mavlink.codec import ARM_DISARM, FLOAT, INT32
from gcs.mavlink.kernels import Whole
from gcs.model.response import Response
from gcs.model.setpoint_loss import WithoutSetpoints
from gcs.model.state import Landed, Mask, Mode

TAKEOFF_HEIGHT: Final = "MIS_TAKEOFF_ALT"

LOSS_TIME, LOSS_TIME_S = "COM_OF_LOSS_T", 1.0
"""How long it flies on with its last setpoint, and the default."""

_LOSS_ACTIONS: Final = MappingProxyType({0: "descend", 3: "return", 4: "land", 5: "hold"})
"""By COM_OBL_RC_ACT; its other values are those of pilots, or stop the motors."""

_SET_MODE: Final = int(dialect.MAV_CMD_DO_SET_MODE)
_CUSTOM: Final = float(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
_FROM_HERE: Final = (nan,) * 7  # at its position, with the configured parameters

_MODES: Final = MappingProxyType(
    {
        (3, 0): Mode.POSITION,
        (4, 1): Mode.READY,
        (4, 2): Mode.TAKEOFF,
        (4, 3): Mode.HOLD,
        (4, 5): Mode.RETURN,
        (4, 6): Mode.LAND,
        (6, 0): Mode.OFFBOARD,
        (10, 0): Mode.TERMINATED,
    }
)
"""By main and sub mode."""

_HOLD: Final = CommandLong(_SET_MODE, (_CUSTOM, 4.0, 3.0))

_COMMANDS: Final = MappingProxyType(
    {
        Verb.STANDBY: _HOLD,
        Verb.ARM: CommandLong(ARM_DISARM, (1.0,)),
        Verb.DISARM: CommandLong(ARM_DISARM, (0.0,)),
        Verb.TAKEOFF: CommandLong(int(dialect.MAV_CMD_NAV_TAKEOFF), _FROM_HERE),
        Verb.HOLD: _HOLD,
        Verb.OFFBOARD: CommandLong(_SET_MODE, (_CUSTOM, 6.0, 0.0)),
        Verb.RETURN: CommandLong(_SET_MODE, (_CUSTOM, 4.0, 5.0)),
        Verb.LAND: CommandLong(int(dialect.MAV_CMD_NAV_LAND), _FROM_HERE),
    }
)

_WHOLE: Final = MappingProxyType(
    {
        int(dialect.MAV_PARAM_TYPE_UINT8): np.uint32,
        int(dialect.MAV_PARAM_TYPE_INT8): np.int32,
        int(dialect.MAV_PARAM_TYPE_UINT16): np.uint32,
        int(dialect.MAV_PARAM_TYPE_INT16): np.int32,
        int(dialect.MAV_PARAM_TYPE_UINT32): np.uint32,
        INT32: np.int32,
    }
)


_FENCE: Final = FenceHabits(
    title="PX4",
    since=Release(1, 14),
    corners_max=MappingProxyType({Release(1, 14): 63, Release(1, 15): 64}),
    checked_s=0.2,
    loads_anew=True,
    refuses="Geofence invalid",
)
"""An area without home in it is stored and acknowledged, and then not flown: only a text says so
(`Geofence::_updateFence`). All areas must hold at once.
"""


class Px4:
    """An `Autopilot`."""

    name: Final = "px4"
    title: Final = "PX4"
    number: Final = int(dialect.MAV_AUTOPILOT_PX4)
    component_parameter: Final = "MAV_COMP_ID"
    versions: Final = load("px4")
    takeoff_ends_with_setpoints: Final = False
    stops_on_setpoint_only: Final = False
    health_by_mavsdk: Final = True
    falls_on_ground: Final = False
    complains: Final = ("Preflight Fail: ", inf)  # sent when they change
    fence: Final = _FENCE
    modes: Final[Mapping[Verb, frozenset[Mode]]] = MappingProxyType(
        {
            Verb.STANDBY: frozenset({Mode.HOLD}),
            Verb.TAKEOFF: frozenset({Mode.TAKEOFF, Mode.HOLD}),  # it changes to HOLD by itself at the top
            Verb.HOLD: frozenset({Mode.HOLD}),
            Verb.OFFBOARD: frozenset({Mode.OFFBOARD}),
            Verb.LAND: frozenset({Mode.LAND}),
            Verb.RETURN: frozenset({Mode.RETURN}),
        }
    )

    def mode(self, custom_mode: int) -> Mode:
        """Main mode << 16 | sub mode << 24."""
        return _MODES.get((custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF), Mode.OTHER)

    def steps(self, command: Command) -> tuple[Step, ...]:
        step = _COMMANDS[command.verb]
        if command.verb is Verb.TAKEOFF:
            return SetParameter(TAKEOFF_HEIGHT, float(command.height_m)), step
        return (step,)

    def rests_in(self, mode: Mode) -> bool:
        """After a landing it reverts to OFFBOARD, in which it does not pass its checks."""
        return mode is not Mode.OFFBOARD

    def climb_ended(self, mode: Mode, landed: Landed, up_m_s: float) -> bool:
        return mode is Mode.HOLD

    def ready(self, custom_mode: Whole, estimator_flags: Whole) -> Mask:
        return np.ones(len(custom_mode), np.bool_)

    def beyond_fence(self, unhealthy_sensors: int) -> bool:
        """Its texts say so, with a failsafe."""
        return False

    def without_setpoints(
        self,
        action: str,
        loss_s: float,
        parameters: Mapping[str, ParameterValue],
    ) -> WithoutSetpoints:
        """COM_OF_LOSS_T, then the mode of COM_OBL_RC_ACT. Not read: the longer of configured and default."""
        unread_s = max(loss_s, LOSS_TIME_S)
        return WithoutSetpoints(
            flies_on_s=float(parameters.get(LOSS_TIME, unread_s)),
            action=_LOSS_ACTIONS.get(int(parameters.get("COM_OBL_RC_ACT", -1)), action),
            return_height_m=float(parameters.get("RTL_RETURN_ALT", nan)),
        )

    def response(self, parameters: Mapping[str, ParameterValue]) -> Response:
        """The gains of `control` were found for it."""
        return Response()

    def streams_hz(self, desired_hz: Mapping[int, float]) -> Mapping[int, float]:
        return desired_hz

    def encoded(self, value: ParameterValue) -> tuple[Single, int]:
        """Integers bytewise."""
        if isinstance(value, int):
            return np.array([value], np.int32).view(np.float32), INT32
        return np.array([value], np.float32), FLOAT

    def decoded(self, value: Single, kind: int) -> ParameterValue:
        whole = _WHOLE.get(kind)
        return float(value[0]) if whole is None else int(value.view(whole)[0])
