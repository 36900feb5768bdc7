"""Sources of targets and what they receive, for tests."""

import asyncio
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import common

from gcs.links.intake import Intake
from gcs.links.targets import mavlink
from gcs.links.targets.mavlink import TELEMETRY, TargetReports
from gcs.links.targets.settings import MavlinkSource
from gcs.model.target_fix import TargetFix

LATITUDE, LONGITUDE = 473_977_420, 85_455_940


def source(port: int = 14560, system_id: int = 7, track: str = "") -> MavlinkSource:
    return MavlinkSource(kind="mavlink", at=f"udp://127.0.0.1:{port}", system_id=system_id, track=track)


def packed(*messages: Any, system_id: int = 7, component_id: int = 1) -> bytes:
    mav = common.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
    return b"".join(bytes(message.pack(mav)) for message in messages)


def position(
    boot_ms: int = 5000,
    latitude: int = LATITUDE,
    longitude: int = LONGITUDE,
    altitude_mm: int = 488_000,
    velocity: tuple[int, int, int] = (100, -200, 30),
) -> Any:
    return common.MAVLink_global_position_int_message(
        boot_ms, latitude, longitude, altitude_mm, 0, *velocity, 9000
    )


def followed(
    stamp_ms: int = 5000,
    capabilities: int = 3,
    velocity: tuple[float, float, float] = (1.0, -2.0, 0.25),
    spread: tuple[float, float, float] = (2.0, 3.0, 0.0),
    altitude_m: float = 488.0,
) -> Any:
    nothing = [0.0, 0.0, 0.0]
    return common.MAVLink_follow_target_message(
        stamp_ms, capabilities, LATITUDE, LONGITUDE, altitude_m, list(velocity), nothing,
        [1.0, *nothing], nothing, list(spread), 0,
    )  # fmt: skip


def aircraft(
    icao: int = 0x4CA1B2,
    flags: int = 0x8F,
    altitude_type: int = 1,
    course: int = 9000,
    climb: int = 150,
    age_s: int = 1,
) -> Any:
    return common.MAVLink_adsb_vehicle_message(
        icao, LATITUDE, LONGITUDE, altitude_type, 900_000, course, 5000, climb, b"SWR1", 0, age_s, flags, 0
    )


def vessel(mmsi: int = 211_234_560, flags: int = 7, age_s: int = 3, latitude: int = LATITUDE) -> Any:
    return common.MAVLink_ais_vessel_message(
        mmsi, latitude, LONGITUDE, 18_000, 17_000, 400, 0, 0, 0, 10, 10, 2, 2, b"", b"ANNA", age_s, flags
    )


def taken(
    *datagrams: bytes, track: str = "", every_s: float = 0.25
) -> tuple[list[TargetFix], TargetReports, float]:
    """What the source's reports are of these datagrams, the reports, and the time of the last."""
    reports, now_s, fixes = TargetReports(source(track=track), 0.0), 0.0, []
    for datagram in datagrams:
        now_s += every_s
        fixes += reports.take(datagram, now_s)
    return fixes, reports, now_s


class Listening:
    """The source as it runs in a flight, with what it reports."""

    def __init__(self, of: MavlinkSource) -> None:
        self.fixes: list[TargetFix] = []
        self.reasons: list[str] = []
        self.intake = Intake("target", TELEMETRY)
        self._source = of

    async def while_(self, story: Callable[[], Any]) -> None:
        receiving = asyncio.create_task(
            mavlink.keep_receiving(self._source, self.fixes.append, self.reasons.append, self.intake)
        )
        try:
            await story()
            assert not receiving.done(), receiving
        finally:
            receiving.cancel()
