"""A flight as a moving picture, faster than it was: vehicles, their trails, boxes, target; or as a still."""

from io import BytesIO
from pathlib import Path
from typing import Final, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from mpl_toolkits.mplot3d.axes3d import Axes3D
from numpy.typing import NDArray
from PIL import Image

from gcs.model.plan import DEFAULT_LAW, Obstacle
from gcs.model.state import Array
from gcs.simulation.metrics import report
from gcs.simulation.record import FlightRecord

FRAMES_MAX, FRAMES_HZ = 120, 12.5
TRAIL_S: Final = 2.5
NEAR_M: Final = 90.0
"""Flights that stay within so much are shown as a whole; else the picture moves with the vehicles."""
TURNS_DEG: Final = 25.0
AROUND: Final = 1.1
NIGHT, GROUND, BOX, TARGET = "#0b0e16", "#2a3142", "#8a93a6", "#ffd166"
DPI, COLOURS = 72, 64


class Shot(NamedTuple):
    """What all pictures of a flight have in common."""

    record: FlightRecord
    up_m: Array  # (ticks, n, 3): y to the right, x away from the reader, height
    middle_m: Array  # (ticks, 3) of the picture
    half_m: float  # half of its width
    height_m: float  # of the picture
    ticks: NDArray[np.intp]  # (frames,)
    trail: int  # ticks
    colours: Array  # (n, 4)


def animate(
    record: FlightRecord,
    file: Path,
    *,
    frames: int = FRAMES_MAX,
    frames_hz: float = FRAMES_HZ,
    dpi: int = DPI,
) -> dict[str, object]:
    """Draw the flight into `file`, a GIF of at most so many frames. Returns: the figures of the flight.

    All frames have one palette, and no dither: then most of a frame is as in the one before it.
    """
    shot = _shot(record, frames)
    page, axes = _page(6.0, 4.4)
    pictures = []
    for frame in range(len(shot.ticks)):
        _draw(axes, shot, frame)
        page.savefig(drawn := BytesIO(), dpi=dpi, facecolor=NIGHT)
        pictures.append(Image.open(drawn).convert("RGB"))
    sampled = np.vstack([np.asarray(pictures[each]) for each in (0, len(pictures) // 2, -1)])
    palette = Image.fromarray(sampled).quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
    first, *others = (each.quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures)
    lasts_ms = round(1e3 / frames_hz)
    first.save(file, save_all=True, append_images=others, duration=lasts_ms, loop=0)
    return report(record)


def still(record: FlightRecord, file: Path) -> None:
    """Draw the end of the flight into `file`, a small PNG, with the whole paths."""
    shot = _shot(record, whole=True)._replace(trail=len(record.time_s))
    page, axes = _page(4.4, 3.2)
    _draw(axes, shot, len(shot.ticks) - 1)
    page.savefig(file, dpi=DPI, facecolor=NIGHT)


def _page(width_in: float, height_in: float) -> tuple[Figure, Axes3D]:
    page = Figure(figsize=(width_in, height_in), facecolor=NIGHT)
    page.set_layout_engine("none")  # whatever a caller's rcParams say
    where = (-0.16, -0.18, 1.32, 1.34)
    return page, page.add_axes(where, projection="3d", facecolor=NIGHT, computed_zorder=False)


def _shot(record: FlightRecord, frames: int = FRAMES_MAX, *, whole: bool = False) -> Shot:
    path_m = record.path_m[..., [1, 0, 2]] * (1.0, 1.0, -1.0)
    rate_hz = record.scenario.world.tick_rate_hz
    stride = max(round(rate_hz / FRAMES_HZ), -(-len(path_m) // frames))
    low_m, high_m = np.nanmin(path_m, axis=(0, 1)), np.nanmax(path_m, axis=(0, 1))
    half_m = float((high_m - low_m).max()) / 2.0
    height_m = max(AROUND * float(high_m[2]), half_m / 2.0, 5.0)
    middle_m = np.broadcast_to((*((low_m + high_m)[:2] / 2.0), height_m / 2.0), (len(path_m), 3))
    if 2.0 * half_m > NEAR_M and not whole:
        middle_m = np.nanmean(path_m, axis=1)
        half_m = float(np.nanmax(np.abs(path_m - middle_m[:, None])))
        height_m = 2.0 * AROUND * half_m
    half_m, count = max(AROUND * half_m, 5.0), max(path_m.shape[1] - 1, 1)
    return Shot(
        record,
        path_m,
        middle_m,
        half_m,
        height_m,
        np.arange(0, len(path_m), stride),
        round(TRAIL_S * rate_hz),
        mpl.colormaps["cool"](np.arange(path_m.shape[1]) / count),
    )


def _draw(axes: Axes3D, shot: Shot, frame: int) -> None:
    record, tick = shot.record, int(shot.ticks[frame])
    here_m, (x_m, y_m, z_m), half_m = shot.up_m[tick], shot.middle_m[tick], shot.half_m
    axes.clear()
    axes.set_axis_off()
    low_m, top_m = max(0.0, z_m - shot.height_m / 2.0), max(shot.height_m, z_m + shot.height_m / 2.0)
    axes.set(xlim=(x_m - half_m, x_m + half_m), ylim=(y_m - half_m, y_m + half_m), zlim=(low_m, top_m))
    axes.set_box_aspect((2.0 * half_m, 2.0 * half_m, top_m - low_m), zoom=1.05)
    axes.view_init(elev=18.0, azim=-70.0 + TURNS_DEG * frame / len(shot.ticks))
    across_m = np.linspace(-half_m, half_m, 7)
    lines = [((x_m + a, y_m - half_m, low_m), (x_m + a, y_m + half_m, low_m)) for a in across_m]
    lines += [((x_m - half_m, y_m + a, low_m), (x_m + half_m, y_m + a, low_m)) for a in across_m]
    axes.add_collection3d(Line3DCollection(lines, colors=GROUND, linewidths=0.6))
    for box in record.boxes[tick]:
        _put_box(axes, box, low_m)
    if low_m == 0.0 and np.isfinite(record.center_m[tick]).all():
        target_y_m, target_x_m = record.target_m[tick][1], record.target_m[tick][0]
        axes.scatter(target_y_m, target_x_m, 0.0, color=TARGET, marker="*", s=40)
    trail_m = shot.up_m[max(0, tick - shot.trail) : tick + 1].transpose(1, 0, 2)
    if trail_m.shape[1] > 1:
        axes.add_collection3d(
            Line3DCollection(list(trail_m), colors=shot.colours, linewidths=0.8, alpha=0.45)
        )
    if low_m == 0.0:
        axes.scatter(here_m[:, 0], here_m[:, 1], 0.0, color=BOX, s=3, alpha=0.35, depthshade=False)
    axes.scatter(*here_m.T, color=shot.colours, s=max(4.0, 26.0 - 0.1 * len(here_m)), depthshade=False)
    law = "" if record.law in {None, DEFAULT_LAW} else f", law {record.law}"
    text = f"{record.scenario.name}{law}, {record.count} vehicles, {record.time_s[tick]:.0f} s"
    axes.text2D(0.5, 0.15, text, transform=axes.transAxes, color="white", ha="center", fontsize=9)


def _put_box(axes: Axes3D, box: Obstacle, low_m: float) -> None:
    corner = box.y_m - box.half_length_y_m, box.x_m - box.half_length_x_m, low_m
    size = 2.0 * box.half_length_y_m, 2.0 * box.half_length_x_m, max(box.height_m - low_m, 0.0)
    axes.bar3d(*corner, *size, color=BOX, alpha=0.35, edgecolor=BOX, linewidth=0.4)
