"""A site in the show frame: what the safety filter, and all that asks the fence, keep of it. Pure."""

from math import hypot
from typing import Final

import numpy as np

from gcs.areas.site import INSIDE, AreaKind, FlightSite, SiteArea, corners_m
from gcs.model.errors import SiteError
from gcs.model.frames import ShowFrame
from gcs.model.polygon_fence import KeptArea, PolygonFence
from gcs.safety.fenced_areas import AREAS_MAX, FencedArea
from gcs.safety.walls import Fence

ORIGIN_WITHIN_M: Final = 10_000.0
"""The origin of the show frame lies no farther from the flight geography."""


def fenced_area(area: SiteArea, frame: ShowFrame) -> FencedArea:
    """An area as the safety filter keeps it.

    The fence itself has the least height of flight; closed space that begins on the ground has none.
    """
    ring_m = tuple((x_m, y_m) for x_m, y_m in corners_m(frame, area).tolist())
    inside = area.kind is AreaKind.FLIGHT_GEOGRAPHY
    least_m = None if inside or area.height_min_m <= 0.0 else area.height_min_m
    return FencedArea(corners_m=ring_m, inside=inside, height_min_m=least_m, height_max_m=area.height_max_m)


def controlled_ground(site: FlightSite, frame: ShowFrame) -> FencedArea | None:
    """Where vehicles may fall: the ground risk buffer with all that lies inside; None: it is not drawn."""
    ground = site.of(AreaKind.GROUND_RISK)
    if not ground:
        return None
    ring_m = corners_m(frame, ground[0]).tolist()
    return FencedArea(corners_m=tuple((x_m, y_m) for x_m, y_m in ring_m))


def uploaded_fence(site: FlightSite) -> PolygonFence:
    """What the autopilots keep by themselves."""
    return PolygonFence(tuple(KeptArea(area.kind in INSIDE, area.corners) for area in site.uploaded))


def fence_within(site: FlightSite, frame: ShowFrame, fence: Fence) -> Fence:
    """Return the fence within the site: its areas before those of the fence, its heights where narrower.

    Raises: SiteError when the site is elsewhere, or has too many areas.
    """
    _check_place(site, frame)
    areas = [*(fenced_area(area, frame) for area in site.fenced), *fence.areas]
    if len(areas) > AREAS_MAX:
        more = f" and {len(fence.areas)} of the fence" if fence.areas else ""
        text = f"{len(site.fenced)} areas{more} are to be kept in flight: at most {AREAS_MAX}"
        raise SiteError(f"site '{site.name}'", f"{text}; draw one area round several")
    within = site.flight_geography
    low_m, high_m = max(fence.height_min_m, within.height_min_m), min(fence.height_max_m, within.top_m)
    if not low_m < high_m:
        text = f"{within.label} ends at {within.top_m:g} m, the fence begins at {fence.height_min_m:g} m"
        raise SiteError(f"site '{site.name}'", f"{text}: no height is left to fly at")
    ground = controlled_ground(site, frame) or fence.controlled_ground
    changes = {"height_min_m": low_m, "height_max_m": high_m, "areas": tuple(areas)}
    return Fence.model_validate({**dict(fence), **changes, "controlled_ground": ground})


def _check_place(site: FlightSite, frame: ShowFrame) -> None:
    away_m = _nearest_m(site, frame)
    if away_m <= ORIGIN_WITHIN_M:
        return
    turned = _swapped(frame)
    swapped = turned is not None and _nearest_m(site, turned) <= ORIGIN_WITHIN_M
    why = ": latitude and longitude of one of them are swapped" if swapped else ": it is another field's site"
    text = f"it is {away_m / 1000.0:.0f} km from the origin of the show frame{why}"
    raise SiteError(f"site '{site.name}'", f"{text}; at most {ORIGIN_WITHIN_M / 1000.0:g} km")


def _nearest_m(site: FlightSite, frame: ShowFrame) -> float:
    """How far the nearest corner of the flight geography lies from the origin, through the Earth."""
    latitude, longitude = np.array(site.flight_geography.corners).T
    place_m = frame.position_m(latitude, longitude, np.full(len(latitude), frame.altitude_amsl_m))
    return min(hypot(*each_m) for each_m in place_m.tolist())


def _swapped(frame: ShowFrame) -> ShowFrame | None:
    if abs(frame.longitude_deg) > 90.0:
        return None
    return ShowFrame(frame.longitude_deg, frame.latitude_deg, frame.altitude_amsl_m, frame.heading_deg)
