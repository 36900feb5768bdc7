"""Messages that a ground station sends by itself: setpoints and its heartbeat."""

from typing import Final

from pymavlink.dialects.v20 import development as dialect

from gcs.mavlink.codec import Records, records
from gcs.mavlink.framing import HEARTBEAT
from gcs.mavlink.kernels import Whole
from gcs.model.state import Array

SETPOINT: Final = 84  # SET_POSITION_TARGET_LOCAL_NED
VELOCITY_AND_YAW: Final = 0x9C7
"""Type mask: velocity and yaw count; the same as MAVSDK's."""

_AUTOPILOT_COMPONENT: Final = 1


def setpoint_messages(
    system_ids: Whole, velocity_ned_m_s: Array, yaw_rad: Array, *, time_s: float
) -> Records:
    """Setpoint messages, one for each vehicle.

    Args:
        system_ids: (n,).
        velocity_ned_m_s: (n, 3).
        yaw_rad: (n,) clockwise from north, within [-pi, pi).
        time_s: of our clock.
    """
    messages = records(SETPOINT, len(system_ids))
    messages["time_boot_ms"] = int(time_s * 1e3) & 0xFFFFFFFF
    messages["target_system"], messages["target_component"] = system_ids, _AUTOPILOT_COMPONENT
    messages["coordinate_frame"] = dialect.MAV_FRAME_LOCAL_NED
    messages["type_mask"] = VELOCITY_AND_YAW
    for axis, field in enumerate(("vx", "vy", "vz")):
        messages[field] = velocity_ned_m_s[:, axis]
    messages["yaw"] = yaw_rad
    return messages


def heartbeats(count: int) -> Records:
    """`count` heartbeats of a ground station."""
    messages = records(HEARTBEAT, count)
    messages["type"], messages["autopilot"] = dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID
    messages["system_status"], messages["mavlink_version"] = dialect.MAV_STATE_ACTIVE, 3
    return messages
