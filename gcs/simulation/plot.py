"""A flight as a figure for a paper: paths, distances, radius, shape; section 5 of the article."""

from itertools import combinations
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse as Outline
from matplotlib.patches import Rectangle
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from mpl_toolkits.mplot3d.axes3d import Axes3D
from numpy.typing import NDArray

from gcs.formation.obstacles import Ellipse
from gcs.model.plan import Obstacle
from gcs.simulation.article import TETRAHEDRON_EDGE
from gcs.simulation.metrics import SETTLED_ENERGY, report, shape_over_time
from gcs.simulation.record import Record
from gcs.simulation.scenario import ArticleFlight

SHOWN_PATHS = 60
COLOURS = "viridis"


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
    _paths(page.add_subplot(grid[:2, 0], projection="3d"), record)
    _from_above(page.add_subplot(grid[2, 0]), record)
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
    for box in record.boxes[-1]:
        corner = (box.y_m - box.half_length_y_m, box.x_m - box.half_length_x_m)
        size = 2 * box.half_length_y_m, 2 * box.half_length_x_m
        axes.add_patch(Rectangle(corner, *size, color="0.6"))
    target_m = np.array(record.target_m)
    if np.isfinite(np.array(record.center_m)).any():
        axes.plot(target_m[:, 1], target_m[:, 0], "k*", markersize=4, label="target")
        center_m = np.array(record.center_m)
        axes.plot(center_m[:, 1], center_m[:, 0], "r-", linewidth=1.2, label="centre")
        axes.legend(loc="best", fontsize=7)
    axes.set(xlabel="y, m", ylabel="x, m", title="From above", aspect="equal")


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


SNAPSHOTS = 5


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
    corner = (box.y_m - box.half_length_y_m, box.x_m - box.half_length_x_m)
    axes.add_patch(Rectangle(corner, 2 * box.half_length_y_m, 2 * box.half_length_x_m, color="0.6"))
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
