"""A drawing of a site for `gcs site report`: areas from above, north, a scale, the origin; SVG. Pure."""

from collections.abc import Sequence
from html import escape
from math import floor, log10
from typing import Final

import numpy as np

from gcs.areas.site import AreaKind, FlightSite, SiteArea, corners_m
from gcs.model.frames import ShowFrame
from gcs.model.state import Array

SIZE: Final = 640.0
EDGE: Final = 36.0

COLOURS: Final = {
    AreaKind.GROUND_RISK: ("#fde3cf", "#c2571a"),
    AreaKind.CONTINGENCY: ("#fff3bf", "#b08900"),
    AreaKind.FLIGHT_GEOGRAPHY: ("#d3f0d5", "#1c7c2e"),
    AreaKind.NO_FLY: ("#f6c6c6", "#b3140c"),
    AreaKind.AUDIENCE: ("#cfe0fb", "#1d4fb3"),
}
"""Fill and outline, in the order in which areas are drawn."""


def drawn(site: FlightSite, frame: ShowFrame, pads_m: Array | None, paths_m: Sequence[Array]) -> str:
    """An SVG with north up.

    Args:
        site: its areas.
        frame: the show frame; its origin is marked.
        pads_m: (n, 2) start places, show frame; None: they are not known.
        paths_m: (k, 2) each, ways over the ground, show frame.
    """
    north = ShowFrame(frame.latitude_deg, frame.longitude_deg, frame.altitude_amsl_m)
    areas = [area for kind in COLOURS for area in site.of(kind)]
    rings = [corners_m(north, area) for area in areas]
    every_m = np.concatenate([*rings, np.zeros((1, 2))])
    low_m, high_m = every_m.min(axis=0), every_m.max(axis=0)
    scale = (SIZE - 2.0 * EDGE) / float((high_m - low_m).max())
    height = 2.0 * EDGE + scale * float(high_m[0] - low_m[0])
    width = 2.0 * EDGE + scale * float(high_m[1] - low_m[1])

    def points(place_m: Array) -> str:
        x, y = EDGE + scale * (place_m[:, 1] - low_m[1]), EDGE + scale * (high_m[0] - place_m[:, 0])
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))

    shapes = [_shape(area, points(ring)) for area, ring in zip(areas, rings, strict=True)]
    dashed = 'fill="none" stroke="#444" stroke-width="1" stroke-dasharray="4 3"'
    shapes += [f'<polyline points="{points(_north_m(frame, path_m))}" {dashed}/>' for path_m in paths_m]
    if pads_m is not None:
        for place in points(_north_m(frame, pads_m)).split():
            x, y = place.split(",")
            shapes.append(f'<circle cx="{x}" cy="{y}" r="2.5" fill="#222"/>')
    x, y = points(np.zeros((1, 2))).split(",")
    cross = f'<path d="M{x} {y}m-6 0h12m-6 -6v12" stroke="#222" stroke-width="1.5" fill="none"/>'
    third_m = float((high_m - low_m).max()) / 3.0
    bar_m = 10.0 ** floor(log10(third_m))
    bar_m *= next(times for times in (5.0, 2.0, 1.0) if times * bar_m <= third_m)
    bar = (
        f'<path d="M{EDGE} {height - 14:.1f}h{scale * bar_m:.1f}" stroke="#222" stroke-width="2"/>'
        f'<text x="{EDGE + scale * bar_m + 6:.1f}" y="{height - 10:.1f}">{bar_m:g} m</text>'
        f'<path d="M{width - 20:.1f} 34V12l-5 9m5 -9l5 9" stroke="#222" stroke-width="1.5" fill="none"/>'
        f'<text x="{width - 24:.1f}" y="48">N</text>'
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" role="img"'
        f' aria-label="Map of the site {escape(site.name)}">{"".join(shapes)}{cross}{bar}</svg>'
    )


def _north_m(frame: ShowFrame, place_m: Array) -> Array:
    """(k, 2) Places of the show frame to north and east of its origin."""
    level = np.column_stack([place_m, np.zeros(len(place_m))])
    return frame.into_ned(level)[:, :2]


def _shape(area: SiteArea, points: str) -> str:
    fill, outline = COLOURS[area.kind]
    title = f"<title>{escape(area.label)}</title>"
    return f'<polygon points="{points}" fill="{fill}" stroke="{outline}" stroke-width="1.5">{title}</polygon>'


def legend() -> str:
    """What the colours mean."""
    return " ".join(
        f'<span class="key"><i style="background:{fill};border-color:{outline}"></i>{kind}</span>'
        for kind, (fill, outline) in reversed(COLOURS.items())
    )
