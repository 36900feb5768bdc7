"""System ids on one link: the vehicles' and our own; number of MAVSDK instances."""

from collections.abc import Collection, Mapping
from typing import Final

from gcs.model.errors import InvalidError
from gcs.model.state import VehicleId

SYSTEM_ID_MAX: Final = 250

VEHICLES_MAX: Final = 64
"""Per MAVSDK instance."""

INSTANCES_MAX: Final = 16
"""Per process; the 20th was measured to speak MAVLink 1."""

_MAVSDK_ID: Final = 245
_SPARE_ID: Final = 254  # 255 is used by most other stations


def station_id(vehicles: Collection[int]) -> int:
    """This station's own: MAVSDK's usual one, unless a vehicle has it."""
    return _SPARE_ID if _MAVSDK_ID in vehicles else _MAVSDK_ID


def instances(vehicle_count: int) -> int:
    """Number of MAVSDK instances for the vehicles of one link."""
    return -(-vehicle_count // VEHICLES_MAX)


def check(vehicles: Mapping[VehicleId, int]) -> None:
    """Raises: InvalidError for an id out of range or used twice."""
    owners: dict[int, VehicleId] = {}
    for vehicle_id, system_id in vehicles.items():
        if not 1 <= system_id <= SYSTEM_ID_MAX:
            raise InvalidError(f"vehicles.{vehicle_id}", system_id, f"1 to {SYSTEM_ID_MAX}")
        if system_id in owners:
            raise InvalidError(
                f"vehicles.{vehicle_id}", system_id, f"another system id: {owners[system_id]} has it"
            )
        owners[system_id] = vehicle_id
