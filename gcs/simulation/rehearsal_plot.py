"""Draws a show: its paths in the colours of the lights, and the timeline of the cues."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from mpl_toolkits.mplot3d.axes3d import Axes3D

from gcs.model.state import Array
from gcs.simulation.record import Record
from gcs.simulation.rehearsal import Rehearsal
from gcs.simulation.rehearsal_verdict import Verdict, judge

NIGHT = "#0b0e16"
GREY = "#8a93a6"
DRAWN_PATHS = 40
STRIDE = 8
"""Ticks between two points of a path."""

NAMED_CUES = 14
"""Number of cue names that fit side by side."""


def draw(flight: Rehearsal, record: Record, file: Path) -> Verdict:
    """Draw a show into `file`. Returns: the verdict of `gcs show check`."""
    verdict = judge(flight, record)
    page = Figure(figsize=(13.0, 9.0), layout="constrained", facecolor="white")
    grid = page.add_gridspec(4, 2, width_ratios=(1.35, 1.0))
    _sky(page.add_subplot(grid[:3, 0], projection="3d"), flight, record)
    _ground(page.add_subplot(grid[:2, 1]), flight, record)
    below = [page.add_subplot(grid[row, 1]) for row in (2, 3)]
    _sizes(below[0], flight, record)
    _separation(below[1], flight, record, verdict)
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


def _separation(axes: Axes, flight: Rehearsal, record: Record, verdict: Verdict) -> None:
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
