"""What `gcs serve` starts the API's process with: settings that go down its line at the start."""

from dataclasses import dataclass
from pathlib import Path

from gcs.service.access import AccessSettings
from gcs.service.map_settings import MapSettings


@dataclass(frozen=True, slots=True)
class ApiProcessSettings:
    """Settings of the API, its console and its log."""

    host: str
    lane_port: int  # on which the emergency listener listens
    access: AccessSettings
    map: MapSettings | None
    log_level: int
    station: str | None  # None: one station flies all vehicles
    record: Path | None
    links: str  # of the configuration, as JSON: for a kill without control
