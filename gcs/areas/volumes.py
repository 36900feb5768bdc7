"""How large contingency volume and ground risk buffer must be: by the authorities, and by this fleet. Pure.

Sources of the formulas: LBA, Dimensioning of Flight Geography, Contingency Volume and Ground Risk Buffer,
revision 1.7 of 2024-11-26, for multirotors, as its public calculators quote it (the document itself was not
at hand); EASA, guidelines on VLOS, issue 03 of 2025-07-17, for the distance at which a vehicle can be seen.

Ours counts what the formulas leave out: an autopilot flies on with its last setpoint until it notices that
its station is lost, it stops as its parameters have it, and wind carries what falls.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, isfinite, radians, sqrt, tan
from typing import Final, TypeAlias

import numpy as np

from gcs.areas.site import AreaKind, FlightSite, SiteArea, frame_at, polygon_m
from gcs.model.setpoint_loss import WithoutSetpoints

GRAVITY_M_S2: Final = 9.81
LBA: Final = "LBA rev. 1.7"
EASA_VLOS: Final = "EASA VLOS issue 03"
DIMENSIONS_OF_FLIGHT: Final = 3.0
"""Characteristic dimensions that a flight geography has room for, in each direction."""

GPS_M, POSITION_M, MAP_M, BAROMETER_M = 3.0, 3.0, 1.0, 1.0
"""Errors of the receiver, of keeping the position, of the map and of the barometric height, by LBA."""

REACTION_S: Final = 1.0
UPWARD_SHARE: Final = 0.7
"""Of the speed, upwards, while a pilot reacts: a climb at 45 degrees."""

SIGMAS: Final = 3.0
GUST_S: Final = 1.0
DRAG_PER_S: Final = 0.2
"""A gust pushes a vehicle so long before its autopilot has answered, with so much of the wind's speed each
second: the drag of real quadrotors in `gcs.simulation.rehearsal`.
"""

SPARE_M: Final = 0.1
"""Derived areas are so much wider: corners are rounded, and outlines simplified by half of it."""

MITRE: Final = 2.0
"""Corners of derived areas reach no farther than twice the distance."""

GroundReach: TypeAlias = Callable[[float, float], float]
"""How far from its place on the ground a vehicle may fall, in m, from a height in m and with a level speed in
m/s; half of the vehicle included.
"""


@dataclass(frozen=True, slots=True)
class Term:
    """One summand of a distance."""

    name: str
    value_m: float
    formula: str  # with the numbers
    source: str


@dataclass(frozen=True, slots=True)
class Extent:
    """A distance, and what it is made of."""

    what: str
    terms: tuple[Term, ...]

    @property
    def value_m(self) -> float:
        return sum(term.value_m for term in self.terms)


@dataclass(frozen=True, slots=True)
class FleetKind:
    """What of the vehicles of one autopilot decides how large the volumes must be."""

    autopilot: str
    vehicles: int
    speed_m_s: float  # greatest, level
    climb_m_s: float  # greatest
    dimension_m: float  # greatest extent of a vehicle
    tilt_deg: float  # greatest
    tilt_source: str
    setpoint_timeout_s: float  # a setpoint leaves so long after its tick
    loss: WithoutSetpoints
    loss_source: str
    fence_period_s: float  # at which the autopilot looks at its own fence; 0: at each turn of its loop
    reaction_s: float  # of a stop, as the safety filter counts it
    deceleration_m_s2: float
    error_m: float  # standard deviation of the position, level
    error_source: str
    wind_m_s: float


@dataclass(frozen=True, slots=True)
class Volumes:
    """What one computation demands for one autopilot."""

    method: str
    autopilot: str
    contingency: Extent  # around the flight geography
    contingency_height: Extent  # above it
    ground_risk: Extent  # around the contingency volume
    others: tuple[Extent, ...] = ()  # further distances, for comparison

    @property
    def extents(self) -> tuple[Extent, ...]:
        return self.contingency, self.contingency_height, self.ground_risk, *self.others


def authority_volumes(kind: FleetKind, flight_height_m: float, contingency_top_m: float = 0.0) -> Volumes:
    """The authorities' formulas for a flight geography of this height above the origin.

    `contingency_top_m`, in m above the origin, is what a site draws. A fall begins there where that is higher
    than what is needed: up there is where vehicles may be.
    """
    v, tilt = kind.speed_m_s, kind.tilt_deg
    rise_m = UPWARD_SHARE * v * REACTION_S
    stop_m = v**2 / (2.0 * GRAVITY_M_S2 * tan(radians(tilt)))
    contingency = Extent(
        "contingency volume, sideways",
        (
            Term("receiver", GPS_M, "S_GPS", LBA),
            Term("position keeping", POSITION_M, "S_Pos", LBA),
            Term("map", MAP_M, "S_K", LBA),
            Term("pilot reacts", v * REACTION_S, f"S_RZ = {v:g} m/s x {REACTION_S:g} s", LBA),
            Term("stop", stop_m, f"S_CM = {v:g}^2 / (2 g tan {tilt:g} deg), {kind.tilt_source}", LBA),
        ),
    )
    height = Extent(
        "contingency volume, upwards",
        (
            Term("height error", BAROMETER_M, "H_baro", LBA),
            Term("pilot reacts", rise_m, f"H_RZ = 0.7 x {v:g} m/s x {REACTION_S:g} s", LBA),
            Term("climb without thrust", v**2 / (2.0 * GRAVITY_M_S2), f"H_CM = {v:g}^2 / (2 g)", LBA),
        ),
    )
    top_m = max(flight_height_m + height.value_m, contingency_top_m)
    half = Term("half a vehicle", kind.dimension_m / 2.0, f"{kind.dimension_m:g} m / 2", LBA)
    way_m = v * sqrt(2.0 * top_m / GRAVITY_M_S2)
    ballistic = Term("ballistic fall", way_m, f"{v:g} m/s x sqrt(2 x {top_m:.1f} m / g)", LBA)
    as_high = Term("as wide as high", top_m, f"H_CV = {top_m:.1f} m", LBA)
    others = (
        Extent("ground risk buffer, 1:1 rule", (as_high, half)),
        Extent("flight geography, least extent", (_least_extent(kind),)),
        Extent("visual line of sight, at most", _seen_until(kind)),
    )
    ground = Extent("ground risk buffer", (ballistic, half))
    return Volumes("authorities", kind.autopilot, contingency, height, ground, others)


def _least_extent(kind: FleetKind) -> Term:
    size_m = DIMENSIONS_OF_FLIGHT * kind.dimension_m
    return Term("three vehicles", size_m, f"3 x {kind.dimension_m:g} m", LBA)


def _seen_until(kind: FleetKind) -> tuple[Term, ...]:
    seen_m = 327.0 * kind.dimension_m
    return (
        Term("size", seen_m, f"327 x {kind.dimension_m:g} m", EASA_VLOS),
        Term("multirotor", 20.0, "20 m", EASA_VLOS),
    )


def fleet_volumes(
    kind: FleetKind, flight_height_m: float, ground_reach_m: GroundReach, contingency_top_m: float = 0.0
) -> Volumes:
    """What this fleet's own numbers demand; heights as for `authority_volumes`."""
    contingency = Extent(
        "contingency volume, sideways",
        (
            *_without_station(kind, kind.speed_m_s),
            *_fence_period(kind),
            _stop(kind, kind.speed_m_s),
            _error(kind),
            _gust(kind),
        ),
    )
    height = Extent(
        "contingency volume, upwards",
        (
            *_without_station(kind, kind.climb_m_s),
            _stop(kind, kind.climb_m_s),
            Term("height error", SIGMAS * kind.error_m, f"3 x {kind.error_m:g} m", kind.error_source),
        ),
    )
    top_m = max(flight_height_m + height.value_m, contingency_top_m)
    reach_m = ground_reach_m(top_m, kind.speed_m_s)
    fall = f"from {top_m:.1f} m at {kind.speed_m_s:g} m/s in {kind.wind_m_s:g} m/s of wind"
    ground = Extent(
        "ground risk buffer",
        (Term("fall with drag and wind", reach_m, f"{fall}, half a vehicle included", "gcs.safety.impact"),),
    )
    return Volumes("this fleet", kind.autopilot, contingency, height, ground)


def _without_station(kind: FleetKind, speed_m_s: float) -> tuple[Term, ...]:
    """How far a vehicle flies on when its station dies, until it begins to stop."""
    sent_s, on_s = kind.setpoint_timeout_s, kind.loss.flies_on_s
    return (
        Term(
            "last setpoint sent",
            speed_m_s * sent_s,
            f"{speed_m_s:g} m/s x {sent_s:g} s",
            "setpoint_timeout_s",
        ),
        Term("flies on", speed_m_s * on_s, f"{speed_m_s:g} m/s x {on_s:g} s", kind.loss_source),
    )


def _stop(kind: FleetKind, speed_m_s: float) -> Term:
    """As the autopilot's parameters say; else the longer of its lag and the safety filter's braking."""
    lag = f"{speed_m_s:g} m/s x {kind.loss.lag_s:g} s"
    by_filter_m = speed_m_s * kind.reaction_s + speed_m_s**2 / (2.0 * kind.deceleration_m_s2)
    stop_m = speed_m_s * kind.loss.stop_s(speed_m_s)
    if isfinite(kind.loss.deceleration_m_s2):
        words = f"{lag} + {speed_m_s:g}^2 / (2 x {kind.loss.deceleration_m_s2:g})"
    elif stop_m > by_filter_m:
        words = lag
    else:
        stop_m = by_filter_m
        words = (
            f"{speed_m_s:g} m/s x {kind.reaction_s:g} s + {speed_m_s:g}^2 / (2 x {kind.deceleration_m_s2:g})"
        )
    return Term("stop", stop_m, words, "control.safety.braking, parameters")


def _fence_period(kind: FleetKind) -> tuple[Term, ...]:
    if not kind.fence_period_s:
        return ()
    way_m = kind.speed_m_s * kind.fence_period_s
    words = f"{kind.speed_m_s:g} m/s x {kind.fence_period_s:g} s"
    return (Term("fence breach noticed", way_m, words, f"own fence of {kind.autopilot}"),)


def _error(kind: FleetKind) -> Term:
    return Term("position error", SIGMAS * kind.error_m, f"3 x {kind.error_m:g} m", kind.error_source)


def _gust(kind: FleetKind) -> Term:
    pushed_m = 0.5 * DRAG_PER_S * kind.wind_m_s * GUST_S**2
    words = f"1/2 x {DRAG_PER_S:g}/s x {kind.wind_m_s:g} m/s x ({GUST_S:g} s)^2"
    return Term("gust", pushed_m, words, "wind that is configured, drag of quadrotors")


# beside what is drawn


@dataclass(frozen=True, slots=True)
class Comparison:
    """What a site has, and what a computation demands."""

    what: str
    method: str
    autopilot: str
    needed_m: float
    drawn_m: float | None  # None: not drawn

    @property
    def spare_m(self) -> float | None:
        """How much larger the site is; negative: so much is missing."""
        return None if self.drawn_m is None else self.drawn_m - self.needed_m


def drawn_m(site: FlightSite) -> dict[str, float | None]:
    """Least widths of what the site has around its flight geography: sideways, upwards, on the ground."""
    inner = site.flight_geography
    contingency, ground = site.of(AreaKind.CONTINGENCY), site.of(AreaKind.GROUND_RISK)
    frame = frame_at(inner.corners[0])

    def apart_m(small: SiteArea, large: Sequence[SiteArea]) -> float | None:
        if not large:
            return None
        return float(polygon_m(frame, large[0]).exterior.distance(polygon_m(frame, small)))

    above_m = contingency[0].top_m - inner.top_m if contingency else None
    return {
        "contingency volume, sideways": apart_m(inner, contingency),
        "contingency volume, upwards": above_m,
        "ground risk buffer": apart_m(contingency[0] if contingency else inner, ground),
    }


def compared(site: FlightSite, volumes: Sequence[Volumes]) -> list[Comparison]:
    """Each distance that each computation demands, beside what is drawn."""
    has_m = drawn_m(site)
    return [
        Comparison(extent.what, each.method, each.autopilot, extent.value_m, has_m[extent.what])
        for each in volumes
        for extent in (each.contingency, each.contingency_height, each.ground_risk)
    ]


def derived(site: FlightSite, volumes: Sequence[Volumes]) -> FlightSite:
    """The site with a contingency volume and a ground risk buffer as wide as the widest computation demands.

    Both are the flight geography grown; corners keep their number where they can (mitres). Heights follow.

    Raises: SiteError when the grown areas meet an audience, for example.
    """
    inner = site.flight_geography
    side_m = max(each.contingency.value_m for each in volumes)
    up_m = max(each.contingency_height.value_m for each in volumes)
    ground_m = max(each.ground_risk.value_m for each in volumes)
    areas = (
        inner,
        _grown(inner, AreaKind.CONTINGENCY, side_m, inner.top_m + up_m),
        _grown(inner, AreaKind.GROUND_RISK, side_m + SPARE_M + ground_m, None),
        *site.of(AreaKind.AUDIENCE, AreaKind.NO_FLY),
    )
    return FlightSite(site.name, areas)


def _grown(area: SiteArea, kind: AreaKind, by_m: float, top_m: float | None) -> SiteArea:
    """The area, wider by `by_m` on every side, in centimetres upwards."""
    frame = frame_at(area.corners[0])
    grown = polygon_m(frame, area).buffer(by_m + SPARE_M, join_style="mitre", mitre_limit=MITRE)
    ring_m = np.array([(x, y, 0.0) for x, y in list(grown.exterior.simplify(SPARE_M / 2.0).coords)[:-1]])
    latitude, longitude, _ = frame.geodetic(ring_m)
    corners = tuple(zip(np.round(latitude, 7).tolist(), np.round(longitude, 7).tolist(), strict=True))
    top_cm = None if top_m is None else ceil(100.0 * top_m)
    return SiteArea(kind, str(kind), corners, area.height_min_m, None if top_cm is None else top_cm / 100.0)
