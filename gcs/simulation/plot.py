"""A flight as a figure: paths, distances, radius, shape; section 5 of the article; a show with its lights."""

from itertools import combinations
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from matplotlib.patches import Ellipse as Outline
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from mpl_toolkits.mplot3d.axes3d import Axes3D
from numpy.typing import NDArray

from gcs.formation.obstacles import Ellipse
from gcs.model.plan import Obstacle
from gcs.model.state import Array
from gcs.simulation.article import TETRAHEDRON_EDGE
from gcs.simulation.metrics import SETTLED_ENERGY, report, shape_over_time
from gcs.simulation.record import Record
from gcs.simulation.rehearsal import Rehearsal
from gcs.simulation.rehearsal_verdict import Verdict, judge
from gcs.simulation.scenario import ArticleFlight

SHOWN_PATHS = 60
COLOURS = "viridis"

SNAPSHOTS = 5
"""Times at which moving boxes, or the article's formation, are drawn from above."""

UNDER_WAY_M_S = 0.5
"""Moving boxes are drawn while a vehicle is faster than this."""

AROUND_M = 25.0
"""Seen from above around the vehicles' paths."""


def draw(record: Record, file: Path) -> dict[str, object]:
    """Draw the flight into `file`. Returns: the figures of the flight."""
    figures = report(record)
    page = Figure(figsize=(11.0, 8.0), layout="constrained")
    if isinstance(record.scenario.flight, ArticleFlight):
        draw_article(page, record, record.scenario.flight)
    else:
        _draw_flight(page, record)
    page.suptitle(f"{record.scenario.name}, {record.count} vehicles, seed {record.seed}")
    page.savefig(file, dpi=130)
    return figures


def _draw_flight(page: Figure, record: Record) -> None:
    grid = page.add_gridspec(3, 2, width_ratios=(1.25, 1.0))
    boxed = any(record.boxes)  # then the view from above says most
    split = 1 if boxed else 2
    _paths(page.add_subplot(grid[:split, 0], projection="3d"), record)
    _from_above(page.add_subplot(grid[split:, 0]), record)
    _separation(page.add_subplot(grid[0, 1]), record)
    radius, shape = page.add_subplot(grid[1, 1]), page.add_subplot(grid[2, 1])
    if any(rows.any() for rows in record.formed):
        _radius(radius, record)
        _shape(shape, record)
    else:
        _way_left(radius, record)
        _limited(shape, record)


def _shown(record: Record) -> tuple[np.ndarray, list[tuple[int, tuple[float, float, float, float]]]]:
    path_m = record.path_m
    rows = np.unique(np.linspace(0, record.count - 1, min(record.count, SHOWN_PATHS)).astype(int))
    colours = mpl.colormaps[COLOURS](np.linspace(0.0, 0.95, len(rows)))
    return path_m, [(int(row), tuple(colour)) for row, colour in zip(rows, colours, strict=True)]


def _paths(axes: Axes3D, record: Record) -> None:
    path_m, rows = _shown(record)
    for row, colour in rows:
        x, y, z = path_m[:, row].T
        axes.plot(x, y, -z, color=colour, linewidth=0.6, alpha=0.8)
        axes.scatter(x[-1], y[-1], -z[-1], color=colour, s=12)
    axes.set(xlabel="x, m", ylabel="y, m", zlabel="height, m", title="Paths (true positions)")
    axes.set_aspect("equal")


def _from_above(axes: Axes, record: Record) -> None:
    path_m, rows = _shown(record)
    for row, colour in rows:
        axes.plot(path_m[:, row, 1], path_m[:, row, 0], color=colour, linewidth=0.6, alpha=0.8)
    center_m, target_m = np.array(record.center_m), np.array(record.target_m)
    if np.isfinite(center_m).any():
        axes.plot(target_m[:, 1], target_m[:, 0], "k*", markersize=7, label="target", zorder=4)
        axes.plot(center_m[:, 1], center_m[:, 0], "r-", linewidth=1.2, label="centre")
        axes.legend(loc="best", fontsize=7)
    axes.set(xlabel="y, m", ylabel="x, m", title="From above", aspect="equal")
    _boxes_over_time(axes, record, path_m)


def _boxes_over_time(axes: Axes, record: Record, path_m: Array) -> None:
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


def _separation(axes: Axes, record: Record) -> None:
    closest_m = np.where(np.array(record.closest_m) < 1e6, record.closest_m, np.nan)
    axes.plot(record.time_s, closest_m, color="C0", linewidth=1.0, label="closest pair")
    axes.axhline(record.floor_m, color="C3", linewidth=1.0, linestyle="--", label="floor")
    top_m = float(np.nanmax(closest_m)) if np.isfinite(closest_m).any() else 1.0
    axes.set(ylabel="m, floor's metric", title="Separation", ylim=(0.0, 1.1 * max(top_m, record.floor_m)))
    axes.legend(loc="best", fontsize=7)


def _radius(axes: Axes, record: Record) -> None:
    bands = np.full((len(record.time_s), 3), np.nan)
    for t, position_m in enumerate(record.position_m):
        rows = record.formed[t]
        if rows.any() and np.isfinite(record.center_m[t]).all():
            distance_m = np.linalg.norm(position_m[rows] - record.center_m[t], axis=1)
            bands[t] = distance_m.min(), float(np.median(distance_m)), distance_m.max()
    axes.fill_between(record.time_s, bands[:, 0], bands[:, 2], color="C0", alpha=0.25, label="all drones")
    axes.plot(record.time_s, bands[:, 1], color="C0", linewidth=1.0, label="median")
    axes.plot(record.time_s, record.radius_m, "k--", linewidth=0.8, label="commanded")
    axes.set(ylabel="m", title="Distance from the commanded centre")
    axes.legend(loc="best", fontsize=7)


def _shape(axes: Axes, record: Record) -> None:
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


def _way_left(axes: Axes, record: Record) -> None:
    left_m = np.linalg.norm(record.path_m - record.goal_m, axis=2)
    quantiles = np.percentile(left_m, [0, 50, 100], axis=1)
    axes.fill_between(record.time_s, quantiles[0], quantiles[2], color="C0", alpha=0.25, label="all drones")
    axes.plot(record.time_s, quantiles[1], color="C0", linewidth=1.0, label="median")
    axes.set(ylabel="m", title="Way left to the goal")
    axes.legend(loc="best", fontsize=7)


def _limited(axes: Axes, record: Record) -> None:
    axes.plot(record.time_s, record.limited, color="C1", linewidth=1.0)
    axes.set(xlabel="time, s", ylabel="vehicles", title="Held back by the filter")


SHOWN_S = 12.0
"""Time span of horizontal paths in figures: at the end, or before and after the obstacle."""


def draw_article(page: Figure, record: Record, flight: ArticleFlight) -> None:
    """Draw all plots of one flight on the page."""
    grid = page.add_gridspec(3, 2, width_ratios=(1.1, 1.0), height_ratios=(1.1, 1.0, 1.0))
    _assembly(page.add_subplot(grid[0, 0], projection="3d"), record)
    _article_from_above(page.add_subplot(grid[1:, 0]), record, flight)
    edges, radii, orbit = (page.add_subplot(grid[row, 1]) for row in range(3))
    _edges(edges, record, flight)
    _radii(radii, record, flight)
    _orbit(orbit, record, flight)
    for axes in (edges, radii, orbit):
        axes.set_xlim(0.0, record.time_s[-1])
        axes.grid(alpha=0.25)


def _colours(record: Record) -> list[tuple[float, float, float, float]]:
    return [tuple(colour) for colour in mpl.colormaps["viridis"](np.linspace(0.0, 0.9, record.count))]


def _assembly(axes: Axes3D, record: Record) -> None:
    """Plot paths relative to the centre, and the final polyhedron."""
    offset_m = (record.path_m - np.array(record.center_m)[:, None]) * (1.0, 1.0, -1.0)
    for row, colour in enumerate(_colours(record)):
        axes.plot(*offset_m[:, row].T, color=colour, linewidth=0.5, alpha=0.7)
        axes.scatter(*offset_m[0, row], color=colour, s=14, marker="x")
        axes.scatter(*offset_m[-1, row], color=colour, s=24)
    last_m = offset_m[-1]
    edges = [(last_m[i], last_m[j]) for i, j in combinations(range(record.count), 2)]
    axes.add_collection3d(Line3DCollection(edges, colors="0.25", linewidths=1.0))
    axes.set(xlabel="x, m", ylabel="y, m", zlabel="up, m", title="Relative to the centre: x start, o end")
    axes.set_aspect("equal")


def _shown_ticks(record: Record, flight: ArticleFlight) -> NDArray[np.intp]:
    """The last `SHOWN_S`; with an obstacle the ticks around the time of the nearest approach to it."""
    rate_hz = record.scenario.world.tick_rate_hz
    half, last = round(SHOWN_S * rate_hz / 2), len(record.time_s)
    middle = last - half
    if flight.boxes:
        box = flight.boxes[0]
        away_m = np.linalg.norm(record.path_m[:, :, :2] - (box.x_m, box.y_m), axis=2).min(axis=1)
        middle = int(np.argmin(away_m))
    return np.arange(max(0, middle - half), min(last, middle + half))


def _article_from_above(axes: Axes, record: Record, flight: ArticleFlight) -> None:
    ticks = _shown_ticks(record, flight)
    path_m = record.path_m[ticks]
    for row, colour in enumerate(_colours(record)):
        axes.plot(path_m[:, row, 1], path_m[:, row, 0], color=colour, linewidth=1.0)
    for tick in np.linspace(0, len(ticks) - 1, SNAPSHOTS).astype(int):
        place_m = path_m[tick]
        for i, j in combinations(range(record.count), 2):
            axes.plot(place_m[[i, j], 1], place_m[[i, j], 0], color="0.4", linewidth=0.6)
        axes.scatter(place_m[:, 1], place_m[:, 0], color=_colours(record), s=10, zorder=3)
    for box in record.boxes[-1]:
        _box(axes, box)
    target_m = np.array(record.target_m)[ticks]
    axes.plot(target_m[:, 1], target_m[:, 0], "k--", linewidth=0.8)
    axes.plot(target_m[-1, 1], target_m[-1, 0], "k*", markersize=9, label="target")
    axes.legend(loc="best", fontsize=7)
    first_s, last_s = record.time_s[ticks[0]], record.time_s[ticks[-1]]
    axes.set(
        xlabel="y, m", ylabel="x, m", title=f"From above, {first_s:.0f} to {last_s:.0f} s", aspect="equal"
    )
    axes.grid(alpha=0.25)


def _box(axes: Axes, box: Obstacle) -> None:
    axes.add_patch(_rectangle(box, color="0.6"))
    ellipse = Ellipse.around(box, margin_m=0.0, headroom_m=0.0)
    size = 2 * ellipse.semi_y_m, 2 * ellipse.semi_x_m
    axes.add_patch(Outline((ellipse.y_m, ellipse.x_m), *size, fill=False, color="C3", label="ellipse"))


def _edges(axes: Axes, record: Record, flight: ArticleFlight) -> None:
    path_m = record.path_m
    pairs = list(combinations(range(record.count), 2))
    for (i, j), colour in zip(
        pairs, mpl.colormaps["plasma"](np.linspace(0.0, 0.85, len(pairs))), strict=True
    ):
        away_m = np.linalg.norm(path_m[:, i] - path_m[:, j], axis=1)
        axes.plot(record.time_s, away_m, color=colour, linewidth=0.8, label=f"{i + 1}-{j + 1}")
    edge_m = TETRAHEDRON_EDGE * flight.parameters.radius_m
    axes.axhline(edge_m, color="k", linestyle="--", linewidth=0.8, label="1.633 r_d")
    axes.set(ylabel="m", title="Distances between the drones", ylim=(0.0, None))
    axes.legend(loc="lower right", fontsize=6, ncols=4)


def _radii(axes: Axes, record: Record, flight: ArticleFlight) -> None:
    radius_m = np.linalg.norm(record.path_m - np.array(record.center_m)[:, None], axis=2)
    for row, colour in enumerate(_colours(record)):
        axes.plot(record.time_s, radius_m[:, row], color=colour, linewidth=0.8, label=f"drone {row + 1}")
    axes.axhline(flight.parameters.radius_m, color="k", linestyle="--", linewidth=0.8, label="r_d")
    axes.set(ylabel="m", title="Distance from the formation's centre", ylim=(0.0, None))
    axes.legend(loc="lower right", fontsize=6, ncols=3)


def _orbit(axes: Axes, record: Record, flight: ArticleFlight) -> None:
    from_target_m = record.path_m[:, :, :2].mean(axis=1) - np.array(record.target_m)
    axes.plot(record.time_s, np.hypot(*from_target_m.T), color="C0", linewidth=0.9, label="drones' centroid")
    axes.axhline(flight.orbit.radius_m, color="k", linestyle="--", linewidth=0.8, label="r_orbit")
    axes.set(
        xlabel="time, s", ylabel="m", title="Distance from the target, over the ground", ylim=(0.0, None)
    )
    axes.legend(loc="lower right", fontsize=7)


NIGHT = "#0b0e16"
GREY = "#8a93a6"
DRAWN_PATHS = 40
STRIDE = 8
"""Ticks between two points of a path."""

NAMED_CUES = 14
"""Number of cue names that fit side by side."""


def draw_show(flight: Rehearsal, record: Record, file: Path) -> Verdict:
    """Draw a show into `file`. Returns: the verdict of `gcs show check`."""
    verdict = judge(flight, record)
    page = Figure(figsize=(13.0, 9.0), layout="constrained", facecolor="white")
    grid = page.add_gridspec(4, 2, width_ratios=(1.35, 1.0))
    _sky(page.add_subplot(grid[:3, 0], projection="3d"), flight, record)
    _ground(page.add_subplot(grid[:2, 1]), flight, record)
    below = [page.add_subplot(grid[row, 1]) for row in (2, 3)]
    _sizes(below[0], flight, record)
    _show_separation(below[1], flight, record, verdict)
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


def _show_s(flight: Rehearsal, record: Record) -> Array:
    """(ticks,) the show's time; below 0 before its start."""
    return np.array(record.time_s) - (flight.began_s or 0.0)


def _strokes(flight: Rehearsal, record: Record) -> tuple[Array, Array]:
    """Path segments (k, 2, 3) during the timeline, show frame, and their colours (k, 3) from 0 to 1."""
    show_s = _show_s(flight, record)
    ticks = np.flatnonzero((show_s >= 0.0) & (show_s <= flight.timeline.duration_s))[::STRIDE]
    rows = np.unique(np.linspace(0, record.count - 1, min(record.count, DRAWN_PATHS)).astype(int))
    path_m = record.path_m[ticks][:, rows]
    colour = np.array([flight.timeline.colours_at(float(show_s[tick]))[rows] for tick in ticks[:-1]]) / 255.0
    pieces_m = np.stack([path_m[:-1], path_m[1:]], axis=2)
    return pieces_m.reshape(-1, 2, 3), colour.reshape(-1, 3)


def _sky(axes: Axes3D, flight: Rehearsal, record: Record) -> None:
    pieces_m, colour = _strokes(flight, record)
    up_m = pieces_m * (1.0, 1.0, -1.0)
    swapped_m = up_m[:, :, [1, 0, 2]]  # y to the right, x away from the reader
    axes.add_collection3d(Line3DCollection(swapped_m, colors=_visible(colour), linewidths=0.7, alpha=0.75))
    last_m = record.path_m[np.searchsorted(_show_s(flight, record), flight.timeline.duration_s) - 1]
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


def _ground(axes: Axes, flight: Rehearsal, record: Record) -> None:
    show = flight.loaded.show
    pieces_m, colour = _strokes(flight, record)
    lines = pieces_m[:, :, [1, 0]]
    axes.add_collection(LineCollection(list(lines), colors=_visible(colour), linewidths=0.5, alpha=0.6))
    center_m = np.array(record.center_m)
    axes.plot(center_m[:, 1], center_m[:, 0], color="black", linewidth=1.0, label="centre")
    times_s = np.arange(0.0, flight.timeline.duration_s, 0.5).tolist()
    target_m = np.array([flight.timeline.plan_at(t).target.position_m(t) for t in times_s])
    axes.plot(
        target_m[:, 1], target_m[:, 0], "C3--", marker="x", markevery=[0, -1], linewidth=1.0, label="target"
    )
    axes.plot(show.pads_m[:, 1], show.pads_m[:, 0], ".", color=GREY, markersize=3, label="pads")
    for _, boxes in flight.timeline.obstacles:
        for box in boxes:
            corner = box.y_m - box.half_length_y_m, box.x_m - box.half_length_x_m
            axes.add_patch(Rectangle(corner, 2 * box.half_length_y_m, 2 * box.half_length_x_m, color="0.5"))
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


def _sizes(axes: Axes, flight: Rehearsal, record: Record) -> None:
    show_s = _show_s(flight, record)
    height_m = -record.path_m[:, :, 2]
    axes.fill_between(
        show_s, height_m.min(axis=1), height_m.max(axis=1), color="C0", alpha=0.25, label="heights"
    )
    running = (show_s >= 0.0) & (show_s <= flight.timeline.duration_s)
    radius_m = np.where(running, record.radius_m, np.nan)
    axes.plot(show_s, radius_m, color="C1", linewidth=1.2, label="radius")
    spin = [float(np.degrees(flight.timeline.spin_rad_s.value(float(t))[0])) for t in show_s]
    if np.any(spin):
        axes.plot(show_s, np.where(running, spin, np.nan), color="C2", linewidth=1.0, label="spin, deg/s")
    axes.set(ylabel="m", title="Heights of the vehicles, radius")
    axes.legend(loc="upper right", fontsize=7)


def _show_separation(axes: Axes, flight: Rehearsal, record: Record, verdict: Verdict) -> None:
    show_s = _show_s(flight, record)
    closest_m = np.where(np.array(record.closest_m) < 1e6, record.closest_m, np.nan)
    axes.plot(show_s, closest_m, color="C0", linewidth=1.0, label="closest pair")
    axes.axhline(verdict.floor_m, color="C3", linestyle="--", linewidth=1.0, label="floor")
    axes.set(xlabel="time of the show, s", ylabel="m", title="Separation", ylim=(0.0, None))
    axes.legend(loc="upper right", fontsize=7)


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
    for one in played:
        axes.axvline(one.at_s, color=GREY, linewidth=0.6, linestyle=":")
    axes.axvline(flight.timeline.duration_s, color=GREY, linewidth=0.6)
    for one in played[:: max(1, -(-len(played) // NAMED_CUES))] if named else ():
        axes.annotate(
            one.cue.cue,
            (one.at_s, 0.04),
            xycoords=("data", "axes fraction"),
            rotation=90,
            fontsize=7,
            ha="left",
            va="bottom",
            color="white",
            bbox={"facecolor": NIGHT, "alpha": 0.5, "pad": 1.0, "linewidth": 0.0},
        )
