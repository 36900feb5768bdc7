"""Section 5 of the article as figures: paths, distances, radii, and the orbit around the target."""

from itertools import combinations

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
from gcs.simulation.scenario import ArticleFlight
from gcs.simulation.trace import Record

SHOWN_S = 12.0
"""Time span of horizontal paths in figures: at the end, or before and after the obstacle."""

SNAPSHOTS = 5


def draw_article(page: Figure, record: Record, flight: ArticleFlight) -> None:
    """Draw all plots of one flight on the page."""
    grid = page.add_gridspec(3, 2, width_ratios=(1.1, 1.0), height_ratios=(1.1, 1.0, 1.0))
    _assembly(page.add_subplot(grid[0, 0], projection="3d"), record)
    _from_above(page.add_subplot(grid[1:, 0]), record, flight)
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


def _from_above(axes: Axes, record: Record, flight: ArticleFlight) -> None:
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
