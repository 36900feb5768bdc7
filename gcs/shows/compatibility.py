"""Whether a show fits the service that is to fly it: it must fly as it was checked. Pure."""

from collections.abc import Iterator
from math import hypot

import numpy as np

from gcs.config.sections import OperationSettings
from gcs.control import ControlSettings
from gcs.model.frames import ShowFrame
from gcs.shows.format import Show
from gcs.shows.validation import Flaw

ORIGIN_WITHIN_M = 0.5
"""Tolerance against the service's own origin: more is another field, or a mistake."""

HEADING_WITHIN_DEG = 0.1


def misfits(
    show: Show, frame: ShowFrame, control: ControlSettings, operation: OperationSettings, vehicles: int
) -> list[Flaw]:
    """Return all reasons why a service with so many vehicles would not fly the show as checked."""
    return [
        *_origin(show, frame),
        *_limits(show, control),
        *_take_off(show, operation),
        *_vehicles(show, vehicles),
    ]


def _origin(show: Show, frame: ShowFrame) -> Iterator[Flaw]:
    origin = show.origin
    away_m = frame.position_m(
        np.array([origin.latitude_deg]),
        np.array([origin.longitude_deg]),
        np.array([origin.altitude_amsl_m]),
    )[0]
    sideways_m, up_m = hypot(float(away_m[0]), float(away_m[1])), abs(float(away_m[2]))
    if not max(sideways_m, up_m) <= ORIGIN_WITHIN_M:
        yield Flaw(
            ("origin",),
            f"origin: {sideways_m:.1f} m sideways and {up_m:.1f} m in height from the service's show_frame;"
            f" at most {ORIGIN_WITHIN_M:g} m",
        )
    turned_deg = abs((origin.heading_deg - frame.heading_deg + 180.0) % 360.0 - 180.0)
    if turned_deg > HEADING_WITHIN_DEG:
        text = f"origin.heading_deg = {origin.heading_deg:g}: the service's is {frame.heading_deg:g}"
        yield Flaw(("origin", "heading_deg"), text)


def _limits(show: Show, control: ControlSettings) -> Iterator[Flaw]:
    """Yield the service's limits that are narrower than those that the show was checked with."""
    limits, fence, law, safety = show.limits, show.fence, control.law, control.safety
    at_most = (
        ("limits.speed_max_m_s", limits.speed_max_m_s, safety.limits.horizontal_m_s),
        ("limits.climb_max_m_s", limits.climb_max_m_s, safety.limits.up_m_s),
        ("limits.sink_max_m_s", limits.sink_max_m_s, safety.limits.down_m_s),
        ("limits.formation_speed_max_m_s", limits.formation_speed_max_m_s, law.center_speed_max_m_s),
        ("limits.formation_climb_max_m_s", limits.formation_climb_max_m_s, law.climb_max_m_s),
        (
            "limits.formation_acceleration_max_m_s2",
            limits.formation_acceleration_max_m_s2,
            law.center_acceleration_max_m_s2,
        ),
        ("limits.radius_rate_max_m_s", limits.radius_rate_max_m_s, control.radius_rate_m_s),
        ("fence.height_max_m", fence.height_max_m, safety.fence.height_max_m),
        ("fence.distance_max_m", fence.distance_max_m, safety.fence.distance_max_m),
    )
    for key, value, most in at_most:
        if value > most:
            yield Flaw(key.split("."), f"{key} = {value:g}: at most the service's {most:g}")
    at_least = (
        ("limits.separation_min_m", limits.separation_min_m, safety.floor.horizontal_m),
        ("fence.height_min_m", fence.height_min_m, safety.fence.height_min_m),
    )
    for key, value, least in at_least:
        if value < least:
            yield Flaw(key.split("."), f"{key} = {value:g}: at least the service's {least:g}")


def _take_off(show: Show, operation: OperationSettings) -> Iterator[Flaw]:
    for key in ("takeoff_height_m", "takeoff_stagger_s"):
        asked, given = getattr(show.fleet, key), getattr(operation, key)
        if asked != given:
            text = f"fleet.{key} = {asked:g}: the service's operation.{key} is {given:g}"
            yield Flaw(("fleet", key), text)


def _vehicles(show: Show, vehicles: int) -> Iterator[Flaw]:
    asked = show.fleet.vehicles
    if asked > vehicles:
        yield Flaw(("fleet", "vehicles"), f"fleet.vehicles = {asked}: the service has {vehicles}")
