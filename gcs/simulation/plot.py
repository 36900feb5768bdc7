"""A flight as a figure for a paper: paths, distances, radius and shape over time."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from mpl_toolkits.mplot3d.axes3d import Axes3D

from gcs.simulation.metrics import SETTLED_ENERGY, report, shape_over_time
from gcs.simulation.paper_figures import draw_article
from gcs.simulation.scenario import ArticleFlight
from gcs.simulation.trace import Record

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
        axes.plot(target_m[:, 1], target_m[:, 0], "k--", linewidth=0.8, label="target")
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
