"""Sites for tests: places in metres north and east of an origin, as areas on the globe."""

from collections.abc import Sequence

import numpy as np

from gcs.areas.site import AreaKind, FlightSite, GeodeticCorner, SiteArea
from gcs.model.frames import ShowFrame

ORIGIN = ShowFrame(47.397742, 8.545594, 488.0)
"""That of the shipped demo."""

Metres = Sequence[tuple[float, float]]

ELL: Metres = ((-40, -40), (-40, 110), (35, 110), (35, 35), (110, 35), (110, -40))
"""Concave: two arms of a field, 75 m wide."""

AUDIENCE: Metres = ((120, 120), (120, 160), (160, 160), (160, 120))


def places(ring_m: Metres, frame: ShowFrame = ORIGIN) -> tuple[GeodeticCorner, ...]:
    """Corners (x, y) of a show frame by latitude and longitude, as autopilots round them."""
    level = np.array([(x_m, y_m, 0.0) for x_m, y_m in ring_m])
    latitude, longitude, _ = frame.geodetic(level)
    return tuple(zip(np.round(latitude, 7).tolist(), np.round(longitude, 7).tolist(), strict=True))


def area(
    kind: AreaKind,
    ring_m: Metres,
    heights_m: tuple[float, float | None] = (0.0, None),
    name: str = "",
    frame: ShowFrame = ORIGIN,
) -> SiteArea:
    return SiteArea(kind, name or str(kind), places(ring_m, frame), *heights_m)


def geography(ring_m: Metres = ELL, top_m: float = 45.0) -> SiteArea:
    return area(AreaKind.FLIGHT_GEOGRAPHY, ring_m, (0.0, top_m))


def field(*more: SiteArea, top_m: float = 45.0) -> FlightSite:
    """The L-shaped field with its audience, and more areas."""
    people = area(AreaKind.AUDIENCE, AUDIENCE)
    return FlightSite("corner field", (geography(top_m=top_m), people, *more))


def grown(ring_m: Metres, by_m: float) -> Metres:
    """The L wider on all sides."""
    signs = ((-1, -1), (-1, 1), (1, 1), (1, 1), (1, 1), (1, -1))
    return tuple(
        (x_m + by_m * sign_x, y_m + by_m * sign_y)
        for (x_m, y_m), (sign_x, sign_y) in zip(ring_m, signs, strict=True)
    )


CONTINGENCY = area(AreaKind.CONTINGENCY, grown(ELL, 16.0), (0.0, 60.0))
GROUND_RISK = area(AreaKind.GROUND_RISK, grown(ELL, 60.0))
