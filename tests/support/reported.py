"""Telemetry of vehicles that fly as commanded, for tests that care about a few of its columns."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gcs.model.state import Array, Landed, Mode, Telemetry


def reported(ids: Sequence[str], time_s: float | Array = 0.0, **columns: Any) -> Telemetry:
    """What n armed vehicles in OFFBOARD report, received at `time_s` (n,), but for the values in `columns`.

    A float holds for every vehicle.
    """
    n, unknown = len(ids), np.nan
    usual: dict[str, Any] = {
        **dict.fromkeys(("position_time_s", "heartbeat_time_s", "life_time_s"), time_s),
        **dict.fromkeys(("latitude_deg", "longitude_deg", "altitude_amsl_m", "yaw_deg"), 0.0),
        **dict.fromkeys(("clock_base_s", "round_trip_s", "position_late_s"), 0.0),
        "position_clock_s": np.nan,
        **dict.fromkeys(("horizontal_accuracy_m", "vertical_accuracy_m", "gnss_altitude_amsl_m"), unknown),
        "velocity_ned_m_s": np.zeros((n, 3)),
        "attitude_rad": np.zeros((n, 3)),
        "attitude_time_s": time_s,
        "battery_remaining": 1.0,
        "armed": (True,) * n,
        "mode": (Mode.OFFBOARD,) * n,
        "in_failsafe": (False,) * n,
        "landed": (Landed.IN_AIR,) * n,
        "ready": (True,) * n,
        "reboot_count": (0,) * n,
        "position_resets": (0,) * n,
        "fix_type": 3.0,
        "unhealthy_sensors": np.zeros(n, np.int64),
        "texts": ((),) * n,
        "version": (0,) * n,
    }
    own: dict[str, Any] = {}  # copies: `Telemetry` makes its arrays read-only
    for name, value in (usual | columns).items():
        own[name] = np.full(n, value) if isinstance(value, float) else value
        own[name] = own[name].copy() if isinstance(value, np.ndarray) else own[name]
    return Telemetry(ids=tuple(ids), **own)
