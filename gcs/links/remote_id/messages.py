"""Messages of Remote ID as records. No I/O.

Source: https://mavlink.io/en/services/opendroneid.html. Altitudes count from the WGS84 ellipsoid, times from
2019. Only OPEN_DRONE_ID_SYSTEM carries the area of a swarm: SYSTEM_UPDATE has the operator's place alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Final

import numpy as np

from gcs.links.remote_id.settings import CATEGORIES, IDENTITIES, BasicId, RemoteIdSettings
from gcs.mavlink.codec import Records, addressed, text_field
from gcs.mavlink.kernels import Whole
from gcs.model.state import Array

BASIC_ID: Final = 12900
SELF_ID: Final = 12903
SYSTEM: Final = 12904
OPERATOR_ID: Final = 12905
ARM_STATUS: Final = 12918
SYSTEM_UPDATE: Final = 12919

TRANSPONDERS: Final = range(236, 239)
"""MAV_COMP_ID_ODID_TXRX_1 to _3."""
TRANSPONDER_TYPE: Final = 34  # MAV_TYPE_ODID

ANY_COMPONENT: Final = 0
UNKNOWN_ALTITUDE_M: Final = -1000.0
EPOCH_UNIX_S: Final = 1_546_300_800
"""2019-01-01, 0 h UTC."""

FIXED_PLACE, LIVE_PLACE = 2, 1  # MAV_ODID_OPERATOR_LOCATION_TYPE
EUROPEAN: Final = 1  # MAV_ODID_CLASSIFICATION_TYPE_EU
MULTIROTOR: Final = 2  # MAV_ODID_UA_TYPE
RADIUS_MAX_M: Final = 0xFFFF


@dataclass(frozen=True, slots=True)
class Operator:
    """Where the operator is; NaN: not known."""

    latitude_deg: float
    longitude_deg: float
    altitude_ellipsoid_m: float
    live: bool  # by a receiver

    @property
    def located(self) -> bool:
        return isfinite(self.latitude_deg) and isfinite(self.longitude_deg)


@dataclass(frozen=True, slots=True, eq=False)
class SwarmArea:
    """Where the vehicles of a show are, as each of n vehicles reports it."""

    count: int
    radius_m: Array  # (n,) farthest horizontal distance of any vehicle of the swarm from this one
    ceiling_m: float  # above the ellipsoid; NaN: not known
    floor_m: float


def _place(operator: Operator, unix_s: float) -> Mapping[str, float | int]:
    """Fields of the operator; 0: its place, or the time, is not known."""
    altitude_m = operator.altitude_ellipsoid_m
    seconds = int(unix_s - EPOCH_UNIX_S) if isfinite(unix_s) else 0
    return {
        "operator_latitude": round(operator.latitude_deg * 1e7) if operator.located else 0,
        "operator_longitude": round(operator.longitude_deg * 1e7) if operator.located else 0,
        "operator_altitude_geo": altitude_m if isfinite(altitude_m) else UNKNOWN_ALTITUDE_M,
        "timestamp": max(0, min(seconds, 0xFFFFFFFF)),
    }


def system_messages(
    system_ids: Whole,
    rows: Whole,
    settings: RemoteIdSettings,
    operator: Operator,
    area: SwarmArea,
    unix_s: float,
) -> Records:
    """(k,) OPEN_DRONE_ID_SYSTEM to these rows of the area, which have these system ids (k,)."""
    european = settings.category != "undeclared"
    return addressed(
        SYSTEM,
        system_ids,
        target_component=ANY_COMPONENT,
        operator_location_type=LIVE_PLACE if operator.live else FIXED_PLACE,
        classification_type=EUROPEAN if european else 0,
        category_eu=CATEGORIES[settings.category],
        class_eu=settings.class_eu if european else 0,
        area_count=area.count,
        area_radius=np.minimum(np.ceil(area.radius_m[rows]), RADIUS_MAX_M),
        area_ceiling=area.ceiling_m if isfinite(area.ceiling_m) else UNKNOWN_ALTITUDE_M,
        area_floor=area.floor_m if isfinite(area.floor_m) else UNKNOWN_ALTITUDE_M,
        **_place(operator, unix_s),
    )


def update_messages(system_ids: Whole, operator: Operator, unix_s: float) -> Records:
    """(k,) OPEN_DRONE_ID_SYSTEM_UPDATE: half as long."""
    place = _place(operator, unix_s)
    return addressed(SYSTEM_UPDATE, system_ids, target_component=ANY_COMPONENT, **place)


def operator_id_message(operator_id: str) -> Records:
    """(1,) To all systems."""
    text = text_field(operator_id, 20)
    return addressed(OPERATOR_ID, np.zeros(1, np.int64), target_component=ANY_COMPONENT, operator_id=text)


def self_id_message(description: str) -> Records:
    """(1,) To all systems."""
    text = text_field(description, 23)
    return addressed(SELF_ID, np.zeros(1, np.int64), target_component=ANY_COMPONENT, description=text)


def basic_id_message(system_id: int, identity: BasicId) -> Records:
    return addressed(
        BASIC_ID,
        np.array([system_id]),
        target_component=ANY_COMPONENT,
        id_type=IDENTITIES[identity.kind],
        ua_type=MULTIROTOR,
        uas_id=text_field(identity.id, 20),
    )
