"""What each feature beside the formation reports: for displays, metrics, frames and `gcs status`.

A feature is one class here and one field of `Features`; REST, metrics and `gcs status` follow from them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from math import hypot, isnan, nan
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import Field

from gcs.model.settings import PUBLISHED, Measured
from gcs.model.traffic import KIND_IN_WORDS, TrackKind, distance_in_words
from gcs.service.feature_view import Described, FeatureView, Line
from gcs.service.go import GoView

NO_LABEL: Final[tuple[int, ...]] = (255, 255, 255, 255)


def _speed(x_m_s: float | None, y_m_s: float | None) -> float | None:
    return None if x_m_s is None or y_m_s is None else hypot(x_m_s, y_m_s)


def _number_of(degrees: float | None) -> str:
    return "?" if degrees is None or isnan(degrees) else f"{round(degrees) % 360:03d}"


def _number(value: float | None) -> str:
    return "?" if value is None or isnan(value) else f"{value:.1f}"


@dataclass(frozen=True, slots=True)
class CorrectionsView(FeatureView):
    """Corrections for RTK, from a base to all vehicles."""

    __pydantic_config__ = PUBLISHED

    source: Annotated[str, Field(examples=["ntrip://192.0.2.7:2101/BASE"])]
    age_s: Annotated[
        Measured, Described("Since the newest arrived; null: none has.", "gcs_corrections_age_seconds")
    ]
    problem: Annotated[str, Described("Why there are no recent ones; empty while there are.")]
    base_latitude_deg: Annotated[Measured, Field(description="As the base reports; null: not yet.")]
    base_longitude_deg: Measured
    base_height_m: Annotated[Measured, Field(description="Above the ellipsoid.")]
    messages: Annotated[
        int, Described("RTCM messages that arrived from the base.", "gcs_corrections_received")
    ]
    received_bytes: Annotated[int, Described("Bytes of these.", "gcs_corrections_received_bytes")]
    sent: Annotated[int, Described("Messages that left, summed over the links.", "gcs_corrections_sent")]
    dropped: Annotated[
        int, Described("Too old, too many, or longer than MAVLink can carry.", "gcs_corrections_dropped")
    ]

    def line(self, unix_time_s: float) -> Line:  # noqa: ARG002
        yield (self.problem, "bad") if self.problem else (f"{_number(self.age_s)} s old", "")
        if self.base_latitude_deg is not None and self.base_longitude_deg is not None:
            yield f", base at {self.base_latitude_deg:.7f}, {self.base_longitude_deg:.7f}", ""
            yield f", {_number(self.base_height_m)} m above the ellipsoid", ""


TimecodeState: TypeAlias = Literal["none", "running", "dropped-out", "stopped", "lost", "refused"]


@dataclass(frozen=True, slots=True)
class TimecodeView(FeatureView):
    """The timecode that shows follow."""

    __pydantic_config__ = PUBLISHED

    source: Annotated[str, Field(examples=["rtp-midi://0.0.0.0:5004"])]
    followed: Annotated[bool, Field(description="false: an operator has shows run by this station's clock.")]
    state: Annotated[
        TimecodeState,
        Described(
            "How it is. stopped: its source says so. lost: nothing arrives any more."
            " refused: it has jumped to where the show does not follow.",
            "gcs_timecode_state",
            moves=False,
        ),
    ]
    label: Annotated[
        str, Described("Where it is, or stands; empty: nowhere yet."), Field(examples=["01:00:02:12"])
    ]
    frame_rate: Annotated[str, Field(examples=["25"])]
    age_s: Annotated[
        Measured,
        Described("Since the newest reading that was followed; null: none.", "gcs_timecode_age_seconds"),
    ]
    behind_s: Annotated[
        Measured,
        Described(
            "By how much the show is behind it; null while the show does not follow.",
            "gcs_timecode_behind_seconds",
        ),
    ]
    slope: Annotated[Measured, Described("How fast it runs by this station's clock; 1 at its rate.")]
    tempo: Annotated[
        Measured, Described("How fast the show runs; 0: it stands still; null: none.", "gcs_show_tempo")
    ]
    problem: Annotated[str, Field(description="Why the show waits or stands still; empty: it does not.")]
    readings: Annotated[int, Described("Readings that arrived.", "gcs_timecode_readings")]
    garbage: Annotated[int, Described("Messages that make no sense.", "gcs_timecode_garbage")]
    dropped: Annotated[int, Described("Dropped unread: too many, or too long.", "gcs_timecode_dropped")]
    frozen_since_unix_time_s: Annotated[
        float | None,
        Field(
            description="Since when a running show stands still, or comes to rest, because the timecode does;"
            " null: it does not. `state` and `problem` say why."
        ),
    ] = None

    def line(self, unix_time_s: float) -> Line:
        yield f"{self.label or 'none yet'} {self.frame_rate} {self.state}, {self.source}", ""
        if not self.followed:
            yield ", not followed: shows run by this station's clock", ""
            return
        if self.frozen_since_unix_time_s is not None:
            yield f", SHOW FROZEN for {unix_time_s - self.frozen_since_unix_time_s:.0f} s", "urgent"
        if self.behind_s is not None:
            off = f", show {1e3 * self.behind_s:+.0f} ms behind, tempo {self.tempo or 0.0:.3f}"
            yield off, ""
        if self.problem:
            yield f", {self.problem}", "bad"


@dataclass(frozen=True, slots=True)
class LightsView(FeatureView):
    """Colours for the vehicles' own lights, summed over the links."""

    __pydantic_config__ = PUBLISHED

    driver: Annotated[
        str,
        Described("lights.driver; none: none are sent.", "gcs_lights", moves=False),
        Field(examples=["led-control"]),
    ]
    sent: Annotated[int, Described("Colours that left.", "gcs_lights_sent")]
    dropped: Annotated[
        int, Described("Colours replaced before they left, for the rate.", "gcs_lights_dropped")
    ]

    def line(self, unix_time_s: float) -> Line:  # noqa: ARG002
        if self.driver != "none":
            yield f"{self.driver}  {self.sent} colours sent, {self.dropped} dropped by the rate", ""


@dataclass(frozen=True, slots=True)
class TargetView(FeatureView):
    """A target of the configuration, as its best source has it. Show frame."""

    __pydantic_config__ = PUBLISHED

    name: str
    source: Annotated[str, Field(description="Kind of the source that counts.", examples=["nmea"])]
    state: Annotated[
        Literal["none", "tracked", "coasting", "lost"],
        Described(
            "How well it is known. coasting: on its last motion. lost: the formation holds.",
            "gcs_target_state",
        ),
    ]
    why: Annotated[str, Field(description="Why it is not tracked; empty: it is.")]
    age_s: Annotated[
        Measured, Described("Of the newest report that is believed; null: none.", "gcs_target_age_seconds")
    ]
    rate_hz: Annotated[Measured, Field(description="Reports a second; null: not known.")]
    x_m: Annotated[Measured, Field(description="Where it is estimated now; null: nowhere yet.")]
    y_m: Measured
    velocity_x_m_s: Measured
    velocity_y_m_s: Measured
    deviation_m: Annotated[
        Measured,
        Described("Standard deviation of the estimate, along an axis.", "gcs_target_deviation_meters"),
    ]
    height_m: Annotated[Measured, Field(description="Above the show's origin; null: as on the ground.")]
    clearance_m: Annotated[float, Field(description="No vehicle comes nearer; 0: vehicles may.")]
    reports: Annotated[int, Field(description="Reports that were believed, of all its sources.")]
    refused: Annotated[int, Field(description="Reports that were not.")]


@dataclass(frozen=True, slots=True)
class TargetsView(FeatureView):
    """Targets that the formation can follow."""

    __pydantic_config__ = PUBLISHED

    selected: Annotated[
        str,
        Described("The one that is followed; empty: the target of the plan.", "gcs_target", moves=False),
    ]
    targets: Annotated[tuple[TargetView, ...], Described("All of the configuration.")]
    follows_m_s: Annotated[
        Measured, Described("The fastest target that the formation can follow; null: not known.")
    ] = None
    reach_m: Annotated[
        Measured, Described("How far from the show's origin a target can be followed; null: not known.")
    ] = None
    off_m: Annotated[
        Measured,
        Described(
            "How far the commanded centre is from the selected one, or from the orbit around it;"
            " null: no formation flies, or it is not known where the target is.",
            "gcs_target_distance_meters",
        ),
    ] = None

    def line(self, unix_time_s: float) -> Line:  # noqa: ARG002
        for target in self.targets:
            mark = "selected " if target.name == self.selected else ""
            yield f"{mark}{target.name} {target.state} ({target.source})", ""
            if target.name == self.selected and target.why:
                yield f": {target.why}", "urgent" if target.state == "lost" else "bad"
            yield " ", ""

    def table(self) -> Iterator[Sequence[str]]:
        yield (f"selected: {self.selected or 'none'}; the centre is {_number(self.off_m)} m off it",)
        reach = f"{_number(self.follows_m_s)} m/s, {_number(self.reach_m)} m from the show's origin"
        yield (f"can follow: {reach}",)
        yield "target", "state", "source", "age s", "x m", "y m", "speed m/s", "clearance m", "why"
        for each in self.targets:
            speed_m_s = _speed(each.velocity_x_m_s, each.velocity_y_m_s)
            numbers = each.age_s, each.x_m, each.y_m, speed_m_s, each.clearance_m
            yield each.name, each.state, each.source, *map(_number, numbers), each.why

    @property
    def parts(self) -> Sequence[FeatureView]:
        return [target for target in self.targets if target.name == self.selected]


@dataclass(frozen=True, slots=True)
class TrackView:
    """One track of other traffic. Show frame."""

    __pydantic_config__ = PUBLISHED

    id: Annotated[str, Field(examples=["3C6444"])]
    kind: Annotated[TrackKind, Field(description="An aircraft that does not say counts as manned.")]
    x_m: float
    y_m: float
    height_m: Annotated[Measured, Field(description="Above the show's origin; null: not known.")]
    velocity_x_m_s: float
    velocity_y_m_s: float
    climb_m_s: Measured
    deviation_m: Annotated[float, Field(description="Standard deviation of its place, along an axis.")]
    age_s: Annotated[float, Field(description="Of its newest report.")]
    away_m: Annotated[
        float, Field(description="From the side of the formation, now; 0: over, under or within it.")
    ]
    nearest_m: Annotated[float, Field(description="The same when it is nearest, if both go straight on.")]
    nearest_s: Annotated[float, Field(description="When that is, in s from now.")]
    evaded: Annotated[bool, Field(description="Whether vehicles keep clear of it now.")]
    near: Annotated[bool, Field(description="Whether operators are alarmed of it.")]


@dataclass(frozen=True, slots=True)
class TrafficView(FeatureView):
    """Other traffic: aircraft, vessels, vehicles that are not of this show."""

    __pydantic_config__ = PUBLISHED

    known: Annotated[
        float, Described("Tracks that are known; at most 128, the nearest.", "gcs_traffic_tracks")
    ]
    near: Annotated[float, Described("Tracks that come near the formation.", "gcs_traffic_near", moves=False)]
    manned: Annotated[
        float, Described("Manned aircraft that are too near.", "gcs_traffic_manned", moves=False)
    ]
    problem: Annotated[str, Described("Why traffic is not known; empty: its sources report.", moves=False)]
    reports: Annotated[int, Described("Reports that were believed.", "gcs_traffic_reports")]
    refused: Annotated[int, Described("Reports that were late, repeated or far off.", "gcs_traffic_refused")]
    radius_m: Annotated[float, Field(description="Of the cylinder around each track.")]
    half_height_m: Annotated[float, Field(description="Half of its height.")]
    nearest: Annotated[tuple[TrackView, ...], Described("The nearest 64, the nearest first.")]

    @staticmethod
    def none() -> "TrafficView":
        """Of a service that has no source of it."""
        return TrafficView(0, 0, 0, "no source: add traffic to the configuration", 0, 0, 0.0, 0.0, ())

    def line(self, unix_time_s: float) -> Line:  # noqa: ARG002
        if self.problem:
            yield f"NOT KNOWN: {self.problem} ", "bad"
        yield f"{self.known:g} tracks", ""
        for track in self.nearest:
            if track.near:
                where = distance_in_words(track.away_m, track.nearest_m, track.nearest_s)
                text = f", {KIND_IN_WORDS[track.kind]} {track.id}, {where}"
                yield text, "urgent" if track.kind == "manned" else "bad"

    def table(self) -> Iterator[Sequence[str]]:
        if self.problem:
            yield (f"NOT KNOWN: {self.problem}",)
        yield (f"{self.known:g} tracks, {self.near:g} come near, {self.manned:g} manned too near",)
        yield "track", "kind", "away m", "nearest m", "in s", "height m", "speed m/s", "age s", "is"
        for each in self.nearest:
            speed_m_s = _speed(each.velocity_x_m_s, each.velocity_y_m_s)
            away_m, nearest_m = max(each.away_m, 0.0), max(each.nearest_m, 0.0)  # less: within its cylinder
            numbers = away_m, nearest_m, each.nearest_s, each.height_m, speed_m_s, each.age_s
            words = [word for word, holds in (("near", each.near), ("evaded", each.evaded)) if holds]
            yield each.id, each.kind, *map(_number, numbers), " ".join(words)


@dataclass(frozen=True, slots=True)
class TakReceiverView:
    """Where tracks are sent."""

    __pydantic_config__ = PUBLISHED

    at: Annotated[str, Field(examples=["udp://239.2.3.1:6969"])]
    problem: Annotated[str, Field(description="Why they do not leave; empty: they do.")]
    sent: Annotated[int, Field(description="Events that left.")]
    dropped: Annotated[int, Field(description="Events that did not: none waits.")]


@dataclass(frozen=True, slots=True)
class TakView(FeatureView):
    """The vehicles and the formation's centre as tracks of TAK, once a second."""

    __pydantic_config__ = PUBLISHED

    callsign: Annotated[str, Field(description="Of the centre; those of the vehicles begin with it.")]
    vehicles: Annotated[
        float, Described("Vehicles of this station with a place that is believed.", "gcs_tak_vehicles")
    ]
    missing: Annotated[
        str,
        Described("Those that are not sent: silent, or their place is not believed.", moves=False),
        Field(examples=["d3, d4"]),
    ]
    sent: Annotated[int, Described("Events that left, to all receivers.", "gcs_tak_sent")]
    dropped: Annotated[int, Described("Events that did not.", "gcs_tak_dropped")]
    receivers: Annotated[tuple[TakReceiverView, ...], Described("All of the configuration.")]

    def line(self, unix_time_s: float) -> Line:  # noqa: ARG002
        yield f"{self.vehicles:g} vehicles", ""
        if self.missing:
            yield f", without {self.missing}", "bad"
        for receiver in self.receivers:
            yield f", {receiver.at}", ""
            if receiver.problem:
                yield f" NOT SENT: {receiver.problem}", "bad"


@dataclass(frozen=True, slots=True)
class SiteFileView(FeatureView):
    """The file of the site, beside the site that is in force."""

    __pydantic_config__ = PUBLISHED

    hash: Annotated[str, Field(description="SHA-256 of the areas that are in force.")]
    version: Annotated[str, Field(description="Of the file as read or written last; empty: not yet.")]
    pending: Annotated[str, Field(description="Why no start is possible; empty: the file is in force.")]

    def line(self, unix_time_s: float) -> Line:  # noqa: ARG002
        if self.pending:
            yield self.pending, "bad"
        else:
            yield f"in force: {self.hash[:12]}", ""


@dataclass(frozen=True, slots=True)
class FencesView(FeatureView):
    """The site's fence in the autopilots."""

    __pydantic_config__ = PUBLISHED

    polygons: Annotated[int, Described("Areas that vehicles stay in, and stay out of.", moves=False)]
    corners: Annotated[int, Described("Of all areas.", moves=False)]
    verified: Annotated[
        float, Described("Vehicles that have exactly this fence.", "gcs_fences_verified", moves=False)
    ]
    missing: Annotated[
        str,
        Described("Those that do not, and why; empty: all have it.", moves=False),
        Field(examples=["d3: it has another fence: 12 corners, 16 are needed"]),
    ]
    breached: Annotated[
        str, Described("Vehicles that report a breach of their own fence; empty: none.", moves=False)
    ]

    def line(self, unix_time_s: float) -> Line:  # noqa: ARG002
        yield f"{self.verified:g} vehicles have the site's fence, {self.corners} corners", ""
        if self.missing:
            yield f"; {self.missing}", "bad"
        if self.breached:
            yield f"; BREACHED: {self.breached}", "urgent"


@dataclass(frozen=True, slots=True)
class RemoteIdView(FeatureView):
    """Remote ID: the operator's place and the swarm's area, sent to all transponders, and how these are."""

    __pydantic_config__ = PUBLISHED

    operator_id: Annotated[str, Described("As its authority issued it; empty: none is sent.", moves=False)]
    operator_latitude_deg: Annotated[Measured, Field(description="null: not known.")]
    operator_longitude_deg: Measured
    operator_altitude_ellipsoid_m: Annotated[Measured, Field(description="Above the WGS84 ellipsoid.")]
    area_count: Annotated[
        float, Described("Vehicles of the swarm: those in the air, lost ones too.", "gcs_remote_id_vehicles")
    ]
    area_radius_m: Annotated[
        float,
        Described("The greatest that a vehicle reports.", "gcs_remote_id_radius_meters"),
    ]
    area_ceiling_m: Annotated[Measured, Described("Of the swarm, above the WGS84 ellipsoid.")]
    area_floor_m: Annotated[Measured, Described("The same of its lowest vehicle.")]
    ready: Annotated[
        float, Described("Vehicles with a transponder that is ready.", "gcs_remote_id_ready", moves=False)
    ]
    missing: Annotated[str, Described("Those without one, and why; empty: all have one.", moves=False)]
    problem: Annotated[str, Described("Why not everything is sent; empty: it is.", moves=False)]
    sent: Annotated[int, Described("Messages that left.", "gcs_remote_id_sent")]

    def line(self, unix_time_s: float) -> Line:  # noqa: ARG002
        yield f"{self.area_count:g} vehicles within {self.area_radius_m:.0f} m", ""
        yield f", {self.ready:g} transponders ready", ""
        if self.missing:
            yield f"; {self.missing}", "bad"
        if self.problem:
            yield f"; {self.problem}", "bad"


@dataclass(frozen=True, slots=True)
class WindView(FeatureView):
    """The wind as the vehicles' tilts show it."""

    __pydantic_config__ = PUBLISHED

    speed_m_s: Annotated[Measured, Described("Over the last seconds; null: not known.", "gcs_wind_m_s")]
    from_deg: Annotated[Measured, Described("Where it comes from, clockwise from north.")]
    deviation_m_s: Annotated[
        Measured, Described("Standard deviation of the estimate; null: nothing is measured.")
    ]
    with_gusts_m_s: Annotated[
        Measured,
        Described(
            "What its gusts reach: two standard deviations more, of the wind and of the estimate.",
            "gcs_wind_with_gusts_m_s",
        ),
    ]
    at_least_m_s: Annotated[float, Described("What it surely has, also where it is not known.")]
    allowed_m_s: Annotated[float, Described("The least limit with gusts of the settings.", moves=False)]
    greatest_m_s: Annotated[
        Measured, Described("Greatest with gusts since the vehicles took off.", "gcs_wind_greatest_m_s")
    ]
    drag_per_s: Annotated[Measured, Described("Drag of the vehicles by their mass, as it is believed now.")]
    vehicles: Annotated[int, Described("Vehicles that it is measured of.")]
    why_unknown: Annotated[str, Described("Why the wind is not known; empty: it is.")]

    @property
    def text(self) -> str:
        """What is measured, in words."""
        if self.speed_m_s is None or isnan(self.speed_m_s):
            return f"not known: {self.why_unknown}"
        measured = f"{self.speed_m_s:.1f} m/s from {_number_of(self.from_deg)} degrees"
        return f"{measured} (+-{_number(self.deviation_m_s)}), gusts to {_number(self.with_gusts_m_s)}"

    def line(self, unix_time_s: float) -> Line:  # noqa: ARG002
        if not self.vehicles and self.greatest_m_s is None:
            return
        reached = max(self.at_least_m_s, self.with_gusts_m_s or 0.0)
        yield f"{self.text}, allowed {self.allowed_m_s:g}", "bad" if reached > self.allowed_m_s else ""
        if self.greatest_m_s is not None:
            yield f", greatest of this flight {self.greatest_m_s:.1f}", ""


@dataclass(frozen=True, slots=True)
class Features:
    """What each feature reports; null: it is not configured, or not in a replayed record."""

    __pydantic_config__ = PUBLISHED

    corrections: CorrectionsView | None = None
    timecode: TimecodeView | None = None
    targets: TargetsView | None = None
    traffic: TrafficView | None = None
    tak: TakView | None = None
    fences: FencesView | None = None
    remote_id: RemoteIdView | None = None
    lights: LightsView | None = None
    wind: WindView | None = None
    go: GoView | None = None
    site: SiteFileView | None = None

    @property
    def reporting(self) -> dict[str, FeatureView]:
        """Those that are there, by name."""
        views: dict[str, Any] = {each.name: getattr(self, each.name) for each in fields(self)}
        return {name: view for name, view in views.items() if view is not None}

    @property
    def show_clock(self) -> tuple[tuple[int, ...], float, float]:
        """Of the clock that the show follows: its label, by how much the show is behind, and its tempo."""
        view = self.timecode
        if view is None:
            return NO_LABEL, nan, nan
        label = tuple(map(int, view.label.split(":"))) if view.label else NO_LABEL
        behind_s, tempo = (nan if each is None else each for each in (view.behind_s, view.tempo))
        return label, behind_s, tempo
