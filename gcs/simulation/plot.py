"""A flight as a figure: paths, distances, radius, shape; section 5 of the article; a show with its lights."""

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle
from matplotlib.patches import Ellipse as Outline
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from mpl_toolkits.mplot3d.axes3d import Axes3D
from numpy.typing import ArrayLike, NDArray

from gcs.formation.laws.protocol import GoalShape
from gcs.formation.obstacles import Ellipse
from gcs.model.plan import Obstacle
from gcs.model.state import Array
from gcs.simulation.article import TETRAHEDRON_EDGE
from gcs.simulation.metrics import SETTLED_ENERGY, goal_of, report, shape_over_time
from gcs.simulation.record import FlightRecord
from gcs.simulation.rehearsal import Rehearsal
from gcs.simulation.scenario import ArticleFlight
from gcs.simulation.verdict import Verdict, judge

SHOWN_PATHS = 60
ALL = slice(None)

SNAPSHOTS = 5
"""Times at which moving boxes, or the article's formation, are drawn from above."""

UNDER_WAY_M_S = 0.5
"""Moving boxes are drawn while a vehicle is faster than this."""

AROUND_M = 25.0
"""Seen from above around the vehicles' paths."""


def draw(record: FlightRecord, file: Path) -> dict[str, object]:
    """Draw the flight into `file`. Returns: the figures of the flight."""
    figures = report(record)
    page = Figure(figsize=(11.0, 8.0), layout="constrained")
    if isinstance(record.scenario.flight, ArticleFlight):
        draw_article(page, record, record.scenario.flight)
    else:
        _draw_flight(page, record)
    law = f", law {record.law}" if record.law else ""
    page.suptitle(f"{record.scenario.name}{law}, {record.count} vehicles, seed {record.seed}")
    page.savefig(file, dpi=130)
    return figures


def _draw_flight(page: Figure, record: FlightRecord) -> None:
    grid = page.add_gridspec(3, 2, width_ratios=(1.25, 1.0))
    boxed = any(record.boxes)  # then the view from above says most
    split = 1 if boxed else 2
    _paths(page.add_subplot(grid[:split, 0], projection="3d"), record)
    _from_above(page.add_subplot(grid[split:, 0]), record)
    _separation(page.add_subplot(grid[0, 1]), record, record.time_s)
    radius, shape = page.add_subplot(grid[1, 1]), page.add_subplot(grid[2, 1])
    if any(rows.any() for rows in record.formed):
        distance_m = np.linalg.norm(record.path_m - np.array(record.center_m)[:, None], axis=2)
        distance_m = np.where(np.array(record.formed), distance_m, np.nan)
        radius.plot(record.time_s, record.radius_m, "k--", linewidth=0.8, label="commanded")
        _band(radius, record.time_s, distance_m, "Distance from the commanded centre")
        if goal_of(record) is GoalShape.SPHERE:
            _shape(shape, record)
        else:
            _held_back(shape, record)
    else:
        left_m = np.linalg.norm(record.path_m - record.goal_m, axis=2)
        _band(radius, record.time_s, left_m, "Way left to the goal")
        _held_back(shape, record)


def _rows(record: FlightRecord, most: int = SHOWN_PATHS) -> NDArray[np.intp]:
    """At most so many vehicles, evenly spread."""
    return np.unique(np.linspace(0, record.count - 1, min(record.count, most)).astype(int))


def _colours(count: int, name: str = "viridis") -> list[str]:
    return [mpl.colors.to_hex(colour) for colour in mpl.colormaps[name](np.linspace(0.0, 0.9, count))]


def _paths(axes: Axes3D, record: FlightRecord, from_m: Array | float = 0.0) -> None:
    """Draw the true paths; relative to `from_m` (ticks, 1, 3), if given."""
    rows = _rows(record)
    shown_m = (record.path_m - from_m) * (1.0, 1.0, -1.0)
    for row, colour in zip(rows, _colours(len(rows)), strict=True):
        axes.plot(*shown_m[:, row].T, color=colour, linewidth=0.6, alpha=0.8)
        axes.scatter(*shown_m[-1, row], color=colour, s=16)
    axes.set(xlabel="x, m", ylabel="y, m", zlabel="height, m", title="Paths (true positions)")
    axes.set_aspect("equal")


def _lines_from_above(axes: Axes, record: FlightRecord, ticks: slice = ALL, **look: Any) -> None:
    """Draw the paths in these ticks, x ahead, and the target."""
    rows, path_m = _rows(record), record.path_m[ticks]
    for row, colour in zip(rows, _colours(len(rows)), strict=True):
        axes.plot(path_m[:, row, 1], path_m[:, row, 0], color=colour, **look)
    target_m = np.array(record.target_m)[ticks]
    if np.isfinite(record.center_m).any():
        axes.plot(target_m[:, 1], target_m[:, 0], "k--", linewidth=0.8)
        axes.plot(target_m[-1, 1], target_m[-1, 0], "k*", markersize=9, label="target", zorder=4)
        axes.legend(loc="best", fontsize=7)
    axes.set(xlabel="y, m", ylabel="x, m", title="From above", aspect="equal")


def _from_above(axes: Axes, record: FlightRecord) -> None:
    path_m, center_m = record.path_m, np.array(record.center_m)
    axes.plot(center_m[:, 1], center_m[:, 0], "r-", linewidth=1.2, label="centre")
    _lines_from_above(axes, record, linewidth=0.6, alpha=0.8)
    _boxes_over_time(axes, record, path_m)
    _site(axes, record)


def _site(axes: Axes, record: FlightRecord) -> None:
    """Draw the areas of the fence, closed space with its heights, and the controlled ground."""
    fence = record.scenario.control.safety.fence
    for area in fence.areas:
        ring = [(y_m, x_m) for x_m, y_m in area.corners_m]
        if area.inside:
            axes.add_patch(Polygon(ring, fill=False, edgecolor="C3"))
            continue
        axes.add_patch(Polygon(ring, facecolor="C3", alpha=0.35))
        if area.height_max_m is not None:
            axes.annotate(f"{area.height_max_m:.0f} m", ring[0], color="C3", fontsize=7)
    if fence.controlled_ground is not None:
        ring = [(y_m, x_m) for x_m, y_m in fence.controlled_ground.corners_m]
        axes.add_patch(Polygon(ring, fill=False, edgecolor="C1", linestyle="--"))


def _boxes_over_time(axes: Axes, record: FlightRecord, path_m: Array) -> None:
    """Draw standing boxes; moving ones, and the formation's section, at a few times in a colour for each."""
    spread_m = np.linalg.norm(np.diff(path_m, axis=0), axis=2).max(axis=1)
    under_way = np.flatnonzero(spread_m * record.scenario.world.tick_rate_hz > UNDER_WAY_M_S)
    first, last = (int(under_way[0]), int(under_way[-1])) if len(under_way) else (0, len(path_m) - 1)
    ticks = np.linspace(first, last, SNAPSHOTS).astype(int)
    moving = {box.id for box in record.boxes[-1] if box.speed_m_s}
    for box in record.boxes[-1]:
        if box.id not in moving:
            axes.add_patch(_rectangle(box, color="0.6"))
    if not moving:
        return
    low_m, high_m = path_m[..., :2].min(axis=(0, 1)) - AROUND_M, path_m[..., :2].max(axis=(0, 1)) + AROUND_M
    axes.set(xlim=(low_m[1], high_m[1]), ylim=(low_m[0], high_m[0]))
    for tick, colour in zip(ticks, mpl.colormaps["plasma"](np.linspace(0.0, 0.85, SNAPSHOTS)), strict=True):
        when = f"{record.time_s[tick]:.0f} s"
        for box in record.boxes[tick]:
            if box.id in moving:
                axes.add_patch(_rectangle(box, fill=False, edgecolor=colour, linewidth=1.5))
                axes.annotate(when, (box.y_m, box.x_m), color=colour, fontsize=7, ha="center", clip_on=True)
        x_m, y_m = record.center_m[tick][:2]
        axes.add_patch(
            Circle((y_m, x_m), record.radius_m[tick], fill=False, edgecolor=colour, linestyle="--")
        )
        axes.annotate(when, (y_m, x_m), color=colour, fontsize=7, ha="center", clip_on=True)


def _rectangle(box: Obstacle, **look: Any) -> Rectangle:
    corner = (box.y_m - box.half_length_y_m, box.x_m - box.half_length_x_m)
    return Rectangle(corner, 2 * box.half_length_y_m, 2 * box.half_length_x_m, **look)


def _over_time(
    axes: Axes,
    time_s: ArrayLike,
    lines: Sequence[tuple[str, ArrayLike, str]],
    title: str,
    *,
    limit: tuple[str, float] | None = None,
) -> None:
    """Draw lines of a length in m, each with label and colour, and a limit with its label."""
    for label, values, colour in lines:
        axes.plot(time_s, values, color=colour, linewidth=1.0, label=label)
    if limit is not None:
        axes.axhline(limit[1], color="C3", linewidth=1.0, linestyle="--", label=limit[0])
        axes.set_ylim(0.0, None)
    axes.set(ylabel="m", title=title)
    axes.legend(loc="best", fontsize=7, ncols=1 + len(lines) // 4)


def _band(axes: Axes, time_s: ArrayLike, values_m: Array, title: str) -> None:
    """Draw the median and the extremes of (ticks, n) values, NaN where there is none."""
    measured = np.isfinite(values_m).any(axis=1)
    low, middle, high = np.full((3, len(values_m)), np.nan)
    low[measured], high[measured] = (
        np.nanmin(values_m[measured], axis=1),
        np.nanmax(values_m[measured], axis=1),
    )
    middle[measured] = np.nanmedian(values_m[measured], axis=1)
    axes.fill_between(time_s, low, high, color="C0", alpha=0.25, label="all vehicles")
    _over_time(axes, time_s, [("median", middle, "C0")], title)


def _separation(axes: Axes, record: FlightRecord, time_s: ArrayLike) -> None:
    closest_m = np.where(np.array(record.closest_m) < 1e6, record.closest_m, np.nan)
    limit = "floor", record.floor_m
    _over_time(axes, time_s, [("closest pair", closest_m, "C0")], "Separation (floor's metric)", limit=limit)


def _shape(axes: Axes, record: FlightRecord) -> None:
    shape = shape_over_time(record)
    axes.semilogy(
        record.time_s, np.maximum(shape.energy_ratio - 1.0, 1e-6), color="C0", label="energy ratio - 1"
    )
    axes.axhline(SETTLED_ENERGY - 1.0, color="C0", linestyle="--", linewidth=0.8)
    nearest = axes.twinx()
    nearest.plot(record.time_s, shape.nearest_ratio, color="C1", linewidth=1.0)
    nearest.set_ylabel("nearest ratio", color="C1")
    nearest.set_ylim(0.0, 1.1)
    axes.set(xlabel="time, s", ylabel="energy ratio - 1", title="Shape against the best known")


def _held_back(axes: Axes, record: FlightRecord) -> None:
    axes.plot(record.time_s, record.limited, color="C1", linewidth=1.0)
    axes.set(xlabel="time, s", ylabel="vehicles", title="Held back by the filter")


SHOWN_S = 12.0
"""Time span of horizontal paths in figures: at the end, or before and after the obstacle."""


def draw_article(page: Figure, record: FlightRecord, flight: ArticleFlight) -> None:
    grid = page.add_gridspec(3, 2, width_ratios=(1.1, 1.0), height_ratios=(1.1, 1.0, 1.0))
    _assembly(page.add_subplot(grid[0, 0], projection="3d"), record)
    _article_from_above(page.add_subplot(grid[1:, 0]), record, flight)
    path_m, time_s, pairs = record.path_m, record.time_s, list(combinations(range(record.count), 2))
    edges = [
        (f"{i + 1}-{j + 1}", np.linalg.norm(path_m[:, i] - path_m[:, j], axis=1), colour)
        for (i, j), colour in zip(pairs, _colours(len(pairs), "plasma"), strict=True)
    ]
    away_m = np.linalg.norm(path_m - np.array(record.center_m)[:, None], axis=2)
    radii = [
        (f"drone {row + 1}", away_m[:, row], colour) for row, colour in enumerate(_colours(record.count))
    ]
    rho_m = np.linalg.norm(path_m[:, :, :2].mean(axis=1) - np.array(record.target_m), axis=1)
    radius_m = flight.parameters.radius_m
    around = [("drones' centroid", rho_m, "C0")]
    shown = (
        (edges, "Distances between the drones", ("1.633 r_d", TETRAHEDRON_EDGE * radius_m)),
        (radii, "Distance from the formation's centre", ("r_d", radius_m)),
        (around, "Distance from the target, over the ground", ("r_orbit", flight.orbit.radius_m)),
    )
    for row, (lines, title, limit) in enumerate(shown):
        axes = page.add_subplot(grid[row, 1])
        _over_time(axes, time_s, lines, title, limit=limit)
        axes.set_xlim(0.0, time_s[-1])
        axes.grid(alpha=0.25)
    axes.set_xlabel("time, s")


def _assembly(axes: Axes3D, record: FlightRecord) -> None:
    """Plot paths relative to the centre, and the final polyhedron."""
    center_m = np.array(record.center_m)[:, None]
    _paths(axes, record, center_m)
    last_m = (record.path_m[-1] - center_m[-1]) * (1.0, 1.0, -1.0)
    edges = [(last_m[i], last_m[j]) for i, j in combinations(range(record.count), 2)]
    axes.add_collection3d(Line3DCollection(edges, colors="0.25", linewidths=1.0))
    axes.set(zlabel="up, m", title="Relative to the centre; o: end")


def _shown_ticks(record: FlightRecord, flight: ArticleFlight) -> slice:
    """The last `SHOWN_S`; with an obstacle the ticks around the time of the nearest approach to it."""
    rate_hz = record.scenario.world.tick_rate_hz
    half, last = round(SHOWN_S * rate_hz / 2), len(record.time_s)
    middle = last - half
    if flight.boxes:
        box = flight.boxes[0]
        away_m = np.linalg.norm(record.path_m[:, :, :2] - (box.x_m, box.y_m), axis=2).min(axis=1)
        middle = int(np.argmin(away_m))
    return slice(max(0, middle - half), min(last, middle + half))


def _article_from_above(axes: Axes, record: FlightRecord, flight: ArticleFlight) -> None:
    ticks = _shown_ticks(record, flight)
    for box in record.boxes[-1]:
        axes.add_patch(_rectangle(box, color="0.6"))
        ellipse = Ellipse.around(box, margin_m=0.0, headroom_m=0.0)
        size = 2 * ellipse.semi_y_m, 2 * ellipse.semi_x_m
        axes.add_patch(Outline((ellipse.y_m, ellipse.x_m), *size, fill=False, color="C3", label="ellipse"))
    _lines_from_above(axes, record, ticks, linewidth=1.0)
    path_m, shown_s = record.path_m[ticks], record.time_s[ticks]
    for tick in np.linspace(0, len(path_m) - 1, SNAPSHOTS).astype(int):
        for i, j in combinations(range(record.count), 2):
            axes.plot(path_m[tick, [i, j], 1], path_m[tick, [i, j], 0], color="0.4", linewidth=0.6)
        axes.scatter(path_m[tick, :, 1], path_m[tick, :, 0], color=_colours(record.count), s=10, zorder=3)
    axes.set_title(f"From above, {shown_s[0]:.0f} to {shown_s[-1]:.0f} s")
    axes.grid(alpha=0.25)


NIGHT = "#0b0e16"
GREY = "#8a93a6"
DRAWN_PATHS = 40
STRIDE = 8
"""Ticks between two points of a path."""

NAMED_CUES = 14
"""Number of cue names that fit side by side."""


def draw_show(flight: Rehearsal, file: Path) -> Verdict:
    """Draw a show into `file`. Returns: the verdict of `gcs show check`."""
    verdict = judge(flight)
    page = Figure(figsize=(13.0, 9.0), layout="constrained", facecolor="white")
    grid = page.add_gridspec(4, 2, width_ratios=(1.35, 1.0))
    _sky(page.add_subplot(grid[:3, 0], projection="3d"), flight)
    _ground(page.add_subplot(grid[:2, 1]), flight)
    below = [page.add_subplot(grid[row, 1]) for row in (2, 3)]
    _sizes(below[0], flight)
    _separation(below[1], flight.record, _show_s(flight))
    below[1].set_xlabel("time of the show, s")
    _lights(page.add_subplot(grid[3, 0]), flight)
    for axes in below:
        _cues(axes, flight, named=False)
    good = "good to fly" if verdict.good else f"{len(verdict.problems)} problems"
    page.suptitle(
        f"{verdict.show}: {verdict.vehicles} vehicles, {verdict.show_s:g} s, battery"
        f" {verdict.battery_need:.0%}, closest {verdict.separation_min_m:.1f} m: {good}"
    )
    page.savefig(file, dpi=110)
    return verdict


def _show_s(flight: Rehearsal) -> Array:
    """(ticks,) the show's time; below 0 before its start."""
    return np.array(flight.record.time_s) - (flight.began_s or 0.0)


def _strokes(flight: Rehearsal) -> tuple[Array, Array]:
    """Path segments (k, 2, 3) during the timeline, show frame, and their colours (k, 3) from 0 to 1."""
    show_s = _show_s(flight)
    ticks = np.flatnonzero((show_s >= 0.0) & (show_s <= flight.timeline.duration_s))[::STRIDE]
    rows = _rows(flight.record, DRAWN_PATHS)
    path_m = flight.record.path_m[ticks][:, rows]
    colour = np.array([flight.timeline.colours_at(float(show_s[tick]))[rows] for tick in ticks[:-1]]) / 255.0
    pieces_m = np.stack([path_m[:-1], path_m[1:]], axis=2)
    return pieces_m.reshape(-1, 2, 3), colour.reshape(-1, 3)


def _sky(axes: Axes3D, flight: Rehearsal) -> None:
    pieces_m, colour = _strokes(flight)
    up_m = pieces_m * (1.0, 1.0, -1.0)
    swapped_m = up_m[:, :, [1, 0, 2]]  # y to the right, x away from the reader
    axes.add_collection3d(Line3DCollection(swapped_m, colors=_visible(colour), linewidths=0.7, alpha=0.75))
    last_m = flight.record.path_m[np.searchsorted(_show_s(flight), flight.timeline.duration_s) - 1]
    axes.scatter(last_m[:, 1], last_m[:, 0], -last_m[:, 2], color="black", s=9, depthshade=False)
    low_m, high_m = swapped_m.reshape(-1, 3).min(axis=0), swapped_m.reshape(-1, 3).max(axis=0)
    low_m[2] = 0.0
    for box in flight.loaded.timeline.obstacles:
        for each in box[1]:
            dx, dy = 2 * each.half_length_y_m, 2 * each.half_length_x_m
            corner = each.y_m - dx / 2, each.x_m - dy / 2, 0.0
            axes.bar3d(*corner, dx, dy, each.height_m, color="0.6", alpha=0.25)
    axes.set(
        xlim=(low_m[0], high_m[0]),
        ylim=(low_m[1], high_m[1]),
        zlim=(low_m[2], high_m[2]),
        xlabel="y, m",
        ylabel="x, m",
        zlabel="height, m",
        title="Paths in the colours of the lights; dots: where the timeline ends",
    )
    axes.set_aspect("equal")


def _visible(colour: Array) -> Array:
    """(k, 3) colours, darkened where they would not be visible on white."""
    bright = colour.min(axis=1, keepdims=True)
    return np.asarray(np.where(bright > 0.75, 0.7 * colour, colour))


def _ground(axes: Axes, flight: Rehearsal) -> None:
    show = flight.loaded.show
    pieces_m, colour = _strokes(flight)
    lines = pieces_m[:, :, [1, 0]]
    axes.add_collection(LineCollection(list(lines), colors=_visible(colour), linewidths=0.5, alpha=0.6))
    center_m = np.array(flight.record.center_m)
    if np.isfinite(center_m).any():  # else drawn from beginning to end: no formation has a centre or a target
        axes.plot(center_m[:, 1], center_m[:, 0], color="black", linewidth=1.0, label="centre")
        times_s = np.arange(0.0, flight.timeline.duration_s, 0.5).tolist()
        target_m = np.array([flight.timeline.plan_at(t).target.position_m(t) for t in times_s])
        axes.plot(target_m[:, 1], target_m[:, 0], "C3x--", markevery=[0, -1], linewidth=1.0, label="target")
    axes.plot(show.pads_m[:, 1], show.pads_m[:, 0], ".", color=GREY, markersize=3, label="pads")
    for _, boxes in flight.timeline.obstacles:
        for box in boxes:
            axes.add_patch(_rectangle(box, color="0.5"))
            axes.annotate(box.id, (box.y_m, box.x_m), fontsize=7, ha="center", va="center")
    fence_m = show.fence.distance_max_m
    axes.add_patch(Circle((0.0, 0.0), fence_m, fill=False, color="C3", linestyle=":"))
    north_rad = -np.radians(show.origin.heading_deg)
    tip = 0.82 * fence_m * np.sin(north_rad), 0.82 * fence_m * np.cos(north_rad)
    tail = 0.68 * fence_m * np.sin(north_rad), 0.68 * fence_m * np.cos(north_rad)
    axes.annotate(
        "N", tip, tail, arrowprops={"arrowstyle": "->", "color": GREY}, color=GREY, ha="center", va="center"
    )
    axes.set(
        xlim=(-1.05 * fence_m, 1.05 * fence_m),
        ylim=(-1.05 * fence_m, 1.05 * fence_m),
        xlabel="y, m",
        ylabel="x, m (the show's heading is up)",
        title="From above, inside the fence",
        aspect="equal",
    )
    axes.legend(loc="upper right", fontsize=7)


def _sizes(axes: Axes, flight: Rehearsal) -> None:
    show_s = _show_s(flight)
    height_m = -flight.record.path_m[:, :, 2]
    running = (show_s >= 0.0) & (show_s <= flight.timeline.duration_s)
    spin = [float(np.degrees(flight.timeline.spin_rad_s.value(float(t))[0])) for t in show_s]
    formed = running & np.isfinite(np.array(flight.record.center_m)).all(axis=1)
    title = "Heights of the vehicles"
    if formed.any():
        title += ", radius"
        radius_m = np.where(formed, flight.record.radius_m, np.nan)
        axes.plot(show_s, radius_m, color="C1", linewidth=1.2, label="radius")
    if np.any(spin):
        axes.plot(show_s, np.where(running, spin, np.nan), color="C2", linewidth=1.0, label="spin, deg/s")
    _band(axes, show_s, height_m, title)


def _lights(axes: Axes, flight: Rehearsal) -> None:
    """Plot one row per vehicle with its light over time, and the cues' names."""
    duration_s = flight.timeline.duration_s
    times_s = np.linspace(0.0, duration_s, 600)
    colour = np.array([flight.timeline.colours_at(float(t)) for t in times_s]).transpose(1, 0, 2)
    count = colour.shape[0]
    axes.imshow(colour, aspect="auto", extent=(0.0, duration_s, count + 0.5, 0.5), interpolation="nearest")
    axes.set(xlabel="time of the show, s", ylabel="vehicle", title="Lights and cues")
    _cues(axes, flight, named=True)


def _cues(axes: Axes, flight: Rehearsal, *, named: bool) -> None:
    played = flight.timeline.played
    for cue in played:
        axes.axvline(cue.at_s, color=GREY, linewidth=0.6, linestyle=":")
    axes.axvline(flight.timeline.duration_s, color=GREY, linewidth=0.6)
    for cue in played[:: max(1, -(-len(played) // NAMED_CUES))] if named else ():
        axes.annotate(
            cue.cue.cue,
            (cue.at_s, 0.04),
            xycoords=("data", "axes fraction"),
            rotation=90,
            fontsize=7,
            ha="left",
            va="bottom",
            color="white",
            bbox={"facecolor": NIGHT, "alpha": 0.5, "pad": 1.0, "linewidth": 0.0},
        )
