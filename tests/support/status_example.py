"""A fleet of twenty with nearly every condition that `gcs status` can show."""

from typing import Any

from gcs.api.schemas import fleet as schemas
from gcs.model.state import Mode
from tests.support.api_fake_service import FakeService
from tests.support.api_harness import Api

PILOT = "its pilot flies it in POSCTL since 12:04:31"
NOT_ORDINARY: dict[str, dict[str, Any]] = {
    "d3": {"phase": "pilot", "mode": Mode.OTHER.value, "reason": PILOT},
    "d7": {"phase": "hold", "mode": Mode.HOLD.value, "reason": "its own failsafe: no setpoint for 1.2 s"},
    "d8": {"phase": "hold", "mode": Mode.HOLD.value, "reason": "its own failsafe: no setpoint for 1.2 s"},
    "d11": {"limited_by": "separation from d12"},
    "d14": {"phase": "return", "mode": Mode.RETURN.value, "battery": 0.19, "reason": "flies home"},
    "d17": {
        "phase": "lost",
        "mode": Mode.OFFBOARD.value,
        "reason": "no telemetry for 4.2 s; it was in the air",
        "position_age_s": 4.2,
        "battery": None,
        "link_quality": 0.0,
        "vx_m_s": None,
        "vy_m_s": None,
        "vup_m_s": None,
    },
}


def example_fleet(count: int = 20, name: str = "d{}") -> schemas.Fleet:
    """The answer of `GET /api/v1/fleet`."""
    service = FakeService(count)
    service.fly()
    service.tick()
    answered: dict[str, Any] = Api(service)("GET", "/api/v1/fleet").json()
    for index, vehicle in enumerate(answered["vehicles"]):
        vehicle.update({"limited_by": "", "battery": 0.82 - 0.005 * index, "position_age_s": 0.1})
        vehicle.update(
            {"reason": "flies with the formation", "link_quality": 0.99, "id": name.format(index + 1)}
        )
        vehicle["height_m"] = 24.0 + 0.7 * (index % 7)
        vehicle.update({"vx_m_s": 1.2, "vy_m_s": 0.6, "vup_m_s": 0.0})
        vehicle.update(NOT_ORDINARY.get(f"d{index + 1}", {}))
    answered["counts"] = {
        "airborne": 19,
        "controlled": 18,
        "uncontrolled": 1,
        "unknown": 1,
        "on_ground": 0,
        "offline": 0,
    }
    answered["severity"] = "warning"
    answered["alarms"] = [
        {
            "id": "vehicle-lost-1",
            "severity": "warning",
            "cause": "vehicle-lost",
            "text": "Vehicle d17 lost: no telemetry for 4.2 s. Formation closes the gap.",
            "advice": "Watch it; it comes back by itself when it is received again.",
            "vehicles": ["d17"],
            "since_unix_time_s": 1795350000.0,
            "raised_unix_time_s": 1795350000.0,
            "acknowledged_by": None,
            "acknowledged_unix_time_s": None,
            "ended_unix_time_s": None,
            "command_id": None,
        }
    ]
    return schemas.Fleet.model_validate(answered)
