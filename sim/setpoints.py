"""SET_POSITION_TARGET_LOCAL_NED as PX4 reads it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from sim.mavlink import Message

Triple: TypeAlias = tuple[float, float, float]

LOCAL_NED, BODY_NED = 1, 8  # MAV_FRAME
IGNORE_YAW, IGNORE_YAW_RATE = 0x400, 0x800
NOTHING: Triple = (math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class Setpoint:
    """An order. NaN stands for what was ignored; local NED, metres, radians."""

    position_m: Triple = NOTHING
    velocity_m_s: Triple = NOTHING
    acceleration_m_s2: Triple = NOTHING
    yaw_rad: float = math.nan
    yaw_rate_rad_s: float = math.nan

    @property
    def commands_something(self) -> bool:
        """Whether PX4 counts it as a sign of life: any axis of anything is given."""
        return any(not math.isnan(v) for v in (*self.position_m, *self.velocity_m_s, *self.acceleration_m_s2))

    @property
    def can_be_flown(self) -> bool:
        """Whether PX4 follows it: each axis has something, and north and east come in pairs."""
        kinds = (self.position_m, self.velocity_m_s, self.acceleration_m_s2)
        paired = all(math.isnan(north) == math.isnan(east) for north, east, _ in kinds)
        return paired and all(any(not math.isnan(given[axis]) for given in kinds) for axis in range(3))


def read(message: Message, yaw_rad: float) -> Setpoint | None:
    """Turn the message into local NED, or None for a frame that PX4 refuses.

    A body frame (8) is turned by the vehicle's yaw; its position is not supported by PX4 and dropped.
    """
    mask = int(message.type_mask)
    position_m = _given(mask, 0, (message.x, message.y, message.z))
    velocity_m_s = _given(mask, 3, (message.vx, message.vy, message.vz))
    acceleration_m_s2 = _given(mask, 6, (message.afx, message.afy, message.afz))
    yaw = math.nan if mask & IGNORE_YAW else float(message.yaw)
    if message.coordinate_frame == BODY_NED:
        position_m = NOTHING
        velocity_m_s, acceleration_m_s2 = _turned(velocity_m_s, yaw_rad), _turned(acceleration_m_s2, yaw_rad)
        yaw += yaw_rad
    elif message.coordinate_frame != LOCAL_NED:
        return None
    return Setpoint(
        position_m=position_m,
        velocity_m_s=velocity_m_s,
        acceleration_m_s2=acceleration_m_s2,
        yaw_rad=_finite(yaw),
        yaw_rate_rad_s=math.nan if mask & IGNORE_YAW_RATE else _finite(message.yaw_rate),
    )


def _given(mask: int, first_bit: int, values: Triple) -> Triple:
    first, second, third = (
        math.nan if mask >> (first_bit + axis) & 1 else _finite(value) for axis, value in enumerate(values)
    )
    return first, second, third


def _finite(value: float) -> float:
    """Infinity is as unusable as NaN."""
    return value if math.isfinite(value) else math.nan


def _turned(vector: Triple, yaw_rad: float) -> Triple:
    forward, right, down = vector
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return cos * forward - sin * right, sin * forward + cos * right, down
