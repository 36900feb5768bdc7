"""Settings of features, most with a link of their own. New: a class and a field of `FeatureSettings`."""

import re
from hashlib import sha256
from ipaddress import AddressValueError, IPv4Address
from pathlib import Path
from typing import Annotated, Final

from pydantic import BeforeValidator, Field, model_validator

from gcs.links.remote_id.settings import RemoteIdSettings
from gcs.links.settings import SerialPort, serial_port
from gcs.links.tak.settings import Geoid, TakReceiver
from gcs.links.targets.settings import TargetSettings, TrafficSource
from gcs.mavlink.lights import LightDriver
from gcs.model.errors import ConfigError
from gcs.model.frames import ShowFrame
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.traffic import Cylinder

_PORT_MAX: Final = 65535


class LightSettings(Settings):
    """How vehicles receive the colours of a show, of their battery and of `find` (docs/how-to/lights.md)."""

    driver: LightDriver = LightDriver.NONE
    """The message that sets a colour; `none`: no colours are sent."""
    rate_hz: Annotated[float, Field(ge=0.1, le=20)] = 4.0
    """Messages a second to one vehicle while its colour changes."""
    refresh_s: Positive = 2.0
    """An unchanged colour is repeated so often, in s."""
    battery: bool = True
    """Whether vehicles on the ground show green, amber or red, as their battery is."""
    find_s: Positive = 30.0
    """`find` blinks for so long, in s."""


_NTRIP: Final = re.compile(r"^ntrips?://[A-Za-z0-9.-]{1,253}:(?P<port>\d{1,5})/[\x21-\x7e]{1,100}$")
_PLAIN: Final = re.compile(r"^(tcp|udp)://[A-Za-z0-9.-]{1,253}:(?P<port>\d{1,5})$")


class RtkSettings(Settings):
    """Corrections from a base (docs/how-to/rtk.md)."""

    source: str
    """Base or caster: `ntrip://HOST:PORT/MOUNT`, `ntrips://`, `serial://DEVICE:BAUD`, `tcp://` or `udp://`."""
    user: str = ""
    """User name at the caster."""
    password_file: Path | None = None
    """File whose first line is the password."""
    required: bool = False
    """Whether a start is refused without recent corrections."""
    age_max_s: Annotated[float, Field(ge=1, le=600)] = 10.0
    """Corrections that are older count as stopped, in s."""

    @property
    def device(self) -> SerialPort:
        """Of a serial source. Raises: ConfigError for another one."""
        return serial_port(self.source)

    def login(self) -> str:
        """USER:PASSWORD, or empty. Raises: OSError when the file cannot be read."""
        written = "" if self.password_file is None else self.password_file.read_text()
        password = written.partition("\n")[0].strip()
        return f"{self.user}:{password}" if self.user else ""

    @model_validator(mode="after")
    def _check(self) -> "RtkSettings":
        if self.source.startswith("serial://"):
            try:
                serial_port(self.source)
            except ConfigError as error:
                raise ValueError(f"source: {error}") from None
            return self
        matched = _NTRIP.match(self.source) or _PLAIN.match(self.source)
        if matched is None or not 1 <= int(matched["port"]) <= _PORT_MAX:
            forms = (
                "ntrip://HOST:PORT/MOUNT, ntrips://, serial://DEVICE:BAUD, tcp://HOST:PORT or udp://HOST:PORT"
            )
            raise ValueError(f"source: {self.source}: {forms} is needed")
        return self


_MIDI_AT: Final = re.compile(
    r"^(?P<scheme>rtp-midi|udp-midi)://(?P<host>\d{1,3}(?:\.\d{1,3}){3}):(?P<port>\d{1,5})$"
)
_MIDI_PORT: Final = re.compile(r"^(?P<scheme>midi)://(?P<path>/[^:]+)$")
_SOUND: Final = re.compile(r"^(?P<scheme>ltc)://(?P<path>/[^:]+):(?P<rate>\d{1,6})$")
_TIMECODE_FORMS: Final = "rtp-midi://IP:PORT, udp-midi://IP:PORT, midi:///DEVICE or ltc:///PIPE:SAMPLES_PER_S"
_LABEL: Final = r"^([01]\d|2[0-3]):[0-5]\d:[0-5]\d(:[0-2]\d)?$"
_SAMPLES_MIN, _SAMPLES_MAX = 8_000, 192_000


class TimecodeSettings(Settings):
    """Timecode that written shows follow (docs/how-to/timecode.md)."""

    source: str
    """Where it arrives: `rtp-midi://`, `udp-midi://`, `midi://` a device, or `ltc://` a pipe of sound."""
    starts_at: Annotated[str, Field(pattern=_LABEL)] = "00:00:00:00"
    """The timecode at which a show begins, as HH:MM:SS or HH:MM:SS:FF."""
    delay_s: Annotated[float, Field(ge=-10, le=10)] = 0.0
    """The show runs so much later than the timecode, in s."""
    freewheel_s: Annotated[float, Field(ge=0.1, le=10)] = 1.0
    """A drop-out of up to this long is flown through, in s."""
    jump_max_s: Annotated[float, Field(ge=0.2, le=60)] = 5.0
    """The show follows a jump of the timecode up to this, and stands at a wider one, in s."""
    catch_up: Annotated[float, Field(ge=0.02, le=0.25)] = 0.1
    """Share by which a show may run faster or slower to reach its timecode."""

    @property
    def scheme(self) -> str:
        return self.source.partition(":")[0]

    @property
    def path(self) -> str:
        """Path of a device or a pipe; empty for an address."""
        matched = _MIDI_PORT.match(self.source) or _SOUND.match(self.source)
        return "" if matched is None else matched["path"]

    @property
    def address(self) -> tuple[str, int]:
        """IP address and port to receive at. Raises: ConfigError for a device or a pipe."""
        matched = _MIDI_AT.match(self.source)
        if matched is None:
            raise ConfigError(f"{self.source} is no address")
        return matched["host"], int(matched["port"])

    @property
    def sample_rate_hz(self) -> float:
        """Of sound. Raises: ConfigError for another source."""
        matched = _SOUND.match(self.source)
        if matched is None:
            raise ConfigError(f"{self.source} is no sound")
        return float(matched["rate"])

    @model_validator(mode="after")
    def _check(self) -> "TimecodeSettings":
        at, sound = _MIDI_AT.match(self.source), _SOUND.match(self.source)
        if at is not None:
            try:
                IPv4Address(at["host"])
            except AddressValueError:
                raise ValueError(f"source: {self.source}: {at['host']} is no IP address") from None
            last = int(at["port"]) + (at["scheme"] == "rtp-midi")  # sessions use two ports
            if not 1 < last <= _PORT_MAX:
                raise ValueError(f"source: {self.source}: a port up to {_PORT_MAX} is needed")
        elif sound is not None:
            if not _SAMPLES_MIN <= int(sound["rate"]) <= _SAMPLES_MAX:
                raise ValueError(
                    f"source: {self.source}: {_SAMPLES_MIN} to {_SAMPLES_MAX} samples a second are needed"
                )
        elif not _MIDI_PORT.match(self.source):
            raise ValueError(f"source: {self.source}: {_TIMECODE_FORMS} is needed")
        return self


class MannedArea(Settings):
    """The space around the formation in which a manned aircraft is an emergency."""

    radius_m: Positive = 1000.0
    """How far from the formation, over the ground, in m."""
    height_m: Positive = 150.0
    """How far above or below it, in m; an aircraft without a known height counts as at its height."""


class TrafficSettings(Cylinder):
    """Other traffic that vehicles keep clear of (docs/how-to/targets.md)."""

    sources: Annotated[tuple[TrafficSource, ...], Field(min_length=1, max_length=4)]
    """Where tracks are reported."""
    own: Annotated[tuple[Annotated[str, Field(max_length=40)], ...], Field(max_length=256)] = ()
    """Tracks that are vehicles of this show: ICAO addresses, MMSI, uids; its MAVLink systems are known."""
    delay_s: NotNegative = 0.0
    """How late reports of a source without a clock arrive, in s."""
    forgotten_s: Positive = 15.0
    """A track without a report for so long is forgotten, in s; a vessel after 200 s."""
    manned: MannedArea = MannedArea()
    """Where manned aircraft are an emergency; what follows is `failsafes.manned_aircraft`."""


def _as_receiver(value: object) -> object:
    """Accept a URL for a receiver without further settings."""
    return {"at": value} if isinstance(value, str) else value


class TakSettings(Settings):
    """Where the vehicles and the formation's centre are sent as tracks (docs/how-to/targets.md)."""

    to: Annotated[
        tuple[Annotated[TakReceiver, BeforeValidator(_as_receiver)], ...], Field(min_length=1, max_length=4)
    ]
    """Receivers of all tracks: a list of URLs, or of receivers with certificates."""
    callsign: Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]{1,32}$")]
    """Name of this show in TAK; its vehicles follow: `LUCERNE d1`. Shows that meet need different ones."""
    geoid_m: Geoid | None = None
    """Height of the geoid above the WGS84 ellipsoid there, in m; without it no heights are sent."""
    require_clock: bool = True
    """Whether nothing is sent while this computer's clock is not synchronised: its times would be wrong."""

    def uid(self, frame: ShowFrame) -> str:
        """Of the centre, with which those of the vehicles begin: the same at all stations of the show."""
        show = f"{self.callsign} {frame.latitude_deg:.6f} {frame.longitude_deg:.6f}"
        return f"gcs-{sha256(show.encode()).hexdigest()[:8]}"


class WeatherLimits(Settings):
    """Weather in which vehicles may start. What has a limit must be entered, or no start is possible."""

    wind_max_m_s: Positive | None = None
    """Most wind, in m/s; null: not asked for."""
    gust_max_m_s: Positive | None = None
    """Most gusts, in m/s; null: not asked for."""
    visibility_min_m: Positive | None = None
    """Least visibility, in m; null: not asked for."""
    kp_max: Annotated[float, Field(ge=0, le=9)] | None = None
    """Greatest Kp, the planetary index of geomagnetic activity; null: not asked for."""
    age_max_s: Annotated[float, Field(ge=60, le=86_400)] = 3600.0
    """An entry that is older counts as unknown, in s."""


class GoSettings(Settings):
    """What people must say before a start (docs/how-to/go.md)."""

    confirmed_by_another: bool = False
    """Whether a start is proposed by one token and confirmed by another; false: one person starts."""
    within_s: Annotated[float, Field(ge=10, le=600)] = 60.0
    """How long a proposed start waits for that, in s."""
    checklists: Path | None = None
    """File of checklists by role, whose open items block a start; null: there are none."""
    weather: WeatherLimits = WeatherLimits()
    """Limits of the weather that is entered."""


class WindSettings(Settings):
    """How the wind is measured in flight, from how vehicles tilt (docs/how-to/wind.md)."""

    drag_per_s: Annotated[float, Field(ge=0.05, le=3.0)] | None = None
    """Drag of a vehicle in flight by its mass, in 1/s: 0.1 to 0.4 of most; null: it is measured in flight."""


class StationInputs(Settings):
    """Inputs that each station of a site may have of its own."""

    timecode: TimecodeSettings | None = None
    """The timecode that shows follow; without it they run by this station's clock. Of a station: its own."""


class FeatureSettings(StationInputs):
    """The sections of a configuration that are those of features."""

    lights: LightSettings = LightSettings()
    """How the vehicles receive colours."""
    rtk: RtkSettings | None = None
    """Where corrections for RTK come from; without it none are sent."""
    targets: Annotated[tuple[TargetSettings, ...], Field(max_length=16)] = ()
    """Targets that the formation can follow (docs/how-to/targets.md)."""
    traffic: TrafficSettings | None = None
    """Other traffic that vehicles keep clear of; without it none is known (docs/how-to/targets.md)."""
    tak: TakSettings | None = None
    """Where the vehicles are sent as tracks of TAK; without it nowhere (docs/how-to/targets.md)."""
    remote_id: RemoteIdSettings | None = None
    """Remote ID; without it none is sent (docs/how-to/remote-id-and-fences.md)."""
    wind: WindSettings = WindSettings()
    """How the wind is measured in flight."""
    go: GoSettings | None = None
    """What people must say before a start: a second token, checklists, weather (docs/how-to/go.md)."""

    @model_validator(mode="after")
    def _check_names(self) -> "FeatureSettings":
        names = [target.name for target in self.targets]
        twice = next((name for name in names if names.count(name) > 1), "")
        if twice:
            raise ValueError(f"targets: {twice} is there twice; each needs a name of its own")
        return self
