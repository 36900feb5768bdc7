"""Settings of targets and of their sources. No I/O."""

from pathlib import Path
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field

from gcs.links.settings import Reachable
from gcs.links.tak.settings import Geoid, TakAddress, TakPlace
from gcs.model.settings import NotNegative, Positive, Settings

_UDP: Final = r"^udp://[A-Za-z0-9.-]{1,253}:\d{1,5}$"
_SERIAL: Final = r"^serial:///?[^:]{1,200}:\d{1,8}$"
_STREAMS: Final = r"^(udp|tcp)://[A-Za-z0-9.-]{1,253}:\d{1,5}$"

Endpoint: TypeAlias = Annotated[str, Field(pattern=f"{_STREAMS}|{_SERIAL}"), Reachable]
"""`udp://` an address to receive at, `tcp://` one to connect to, or `serial://DEVICE:BAUD`."""


class NmeaSource(Settings):
    """A GNSS receiver that speaks NMEA 0183."""

    kind: Literal["nmea"]
    """`nmea`"""
    at: Endpoint
    """`udp://HOST:PORT` to receive at, `tcp://HOST:PORT` to connect to, or `serial://DEVICE:BAUD`."""


class GpsdSource(Settings):
    """A receiver behind gpsd."""

    kind: Literal["gpsd"]
    """`gpsd`"""
    at: Annotated[str, Field(pattern=r"^tcp://[A-Za-z0-9.-]{1,253}:\d{1,5}$"), Reachable] = (
        "tcp://127.0.0.1:2947"
    )
    """Where gpsd listens, `tcp://HOST:PORT`."""
    device: Annotated[str, Field(max_length=200)] = ""
    """The receiver that counts, as gpsd names it; empty: each."""


class CotTracks(TakPlace):
    """All tracks in Cursor on Target, as TAK sends them."""

    kind: Literal["cot"]
    """`cot`"""
    at: TakAddress
    """`udp://HOST:PORT` to receive at, also a multicast group; `tcp://` or `tls://` a server."""
    geoid_m: Geoid | None = None
    """Height of the geoid above the WGS84 ellipsoid there, in m; without it heights do not count."""


class CotSource(CotTracks):
    """A track in Cursor on Target, as TAK sends it."""

    track: Annotated[str, Field(max_length=100)]
    """The uid or callsign of the track."""


class MavlinkTracks(Settings):
    """MAVLink systems that are listened to, and never commanded, and what they report by ADS-B and AIS."""

    kind: Literal["mavlink"]
    """`mavlink`"""
    at: Annotated[str, Field(pattern=_UDP), Reachable]
    """`udp://HOST:PORT` to receive at."""


class MavlinkSource(MavlinkTracks):
    """A MAVLink system that is listened to, and never commanded."""

    system_id: Annotated[int, Field(ge=1, le=255)]
    """The system that is followed; for ADS-B and AIS the one that reports them."""
    track: Annotated[str, Field(pattern=r"^([0-9A-Fa-f]{6}|[0-9]{9})?$")] = ""
    """An ICAO address (ADS-B), 6 hexadecimal digits, or an MMSI (AIS), 9 digits; empty: the system itself."""


class PathSource(Settings):
    """A recorded track, played as if it were live: for rehearsals."""

    kind: Literal["path"]
    """`path`"""
    file: Path
    """A CSV, a GPX, or a telemetry log (`.tlog`)."""
    system_id: Annotated[int, Field(ge=0, le=255)] = 0
    """Of a telemetry log: the system that moves; 0: the first one with a position."""
    repeat: bool = True
    """Whether it begins anew at its end."""


class RestSource(Settings):
    """Reports by `POST /api/v1/targets/NAME/report`."""

    kind: Literal["rest"]
    """`rest`"""


TargetSource: TypeAlias = Annotated[
    NmeaSource | GpsdSource | CotSource | MavlinkSource | PathSource | RestSource,
    Field(discriminator="kind"),
]


class TargetSettings(Settings):
    """A target that the formation can follow, and where reports of it come from (docs/how-to/targets.md)."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]{1,32}$")]
    """Its name, for `gcs target select`."""
    sources: Annotated[tuple[TargetSource, ...], Field(min_length=1, max_length=4)]
    """Where reports of it come from, the best first; another is used while the best is silent."""
    deviation_m: Positive = 3.0
    """Standard deviation of a report along each axis, where its source does not say, in m."""
    delay_s: NotNegative = 0.0
    """How late reports arrive where their source has no clock that can be used, in s."""
    coast_s: Positive = 5.0
    """Without reports the estimate is followed for so long, in s; then the formation holds."""
    coast_steady_s: NotNegative = 12.0
    """One that has moved alike for longer: as long again, at most so long, in s; not one with a clearance."""
    clearance_m: NotNegative = 0.0
    """No vehicle comes nearer to it, sideways and in height, in m; 0: vehicles may."""
    height: Literal["ground", "reported"] = "ground"
    """Whether it is on the ground, at the origin's height, or as high as its sources report."""


TrafficSource: TypeAlias = Annotated[MavlinkTracks | CotTracks, Field(discriminator="kind")]
