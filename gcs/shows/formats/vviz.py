"""Writes VVIZ 1.0, the visualisation format of Verge that Finale 3D imports: JSON, not for flying.

Axes are x right, y up, z ahead ("ogl"): y, -z and x of the show frame. Positions are differences to the
sample before, colours have the number of frames since the sample before.
Source: docs.verge.aero, "VVIZ Format"; finale3d.com, "Drone show file format specification (vviz)".
"""

import json
from typing import Any, Final

import numpy as np

from gcs.model.state import Array
from gcs.shows.drawn import DrawnShow
from gcs.shows.formats.csv_show import sample_times_s

POSITION_HZ: Final = 5.0
COLOUR_HZ: Final = 20.0


def write_vviz(show: DrawnShow) -> bytes:
    """Return the show as VVIZ, positions rounded to 1 mm."""
    times_s = sample_times_s(show, POSITION_HZ)
    positions_m = np.round(show.trajectories.positions_m(times_s)[:, :, [1, 2, 0]] * (1.0, -1.0, 1.0), 3)
    document = {
        "version": "1.0",
        "performanceName": show.title,
        "coordinateFrame": "ogl",
        "defaultPositionRate": POSITION_HZ,
        "defaultColorRate": COLOUR_HZ,
        "timeOffsetSecs": 0.0,
        "performances": [
            {
                "id": row,
                "agentDescription": _path(positions_m[:, row]),
                "payloadDescription": [{"id": 0, "type": "Light", "payloadActions": _actions(show, row)}],
            }
            for row in range(len(show))
        ],
    }
    return json.dumps(document, separators=(",", ":")).encode()


def _path(positions_m: Array) -> dict[str, Any]:
    home_m = positions_m[0].tolist()
    steps_m = np.round(np.diff(positions_m, axis=0, prepend=positions_m[:1]), 3).tolist()
    traversal = [{"dx": x_m, "dy": y_m, "dz": z_m} for x_m, y_m, z_m in steps_m]
    return dict(zip(("homeX", "homeY", "homeZ"), home_m, strict=True)) | {"agentTraversal": traversal}


def _actions(show: DrawnShow, row: int) -> list[dict[str, int]]:
    """Return a vehicle's colours at the frames about each change of its program; viewers fade between."""
    program = show.lights.of_vehicle(row)
    last = int(np.ceil(max(show.duration_s, program.times_s[-1]) * COLOUR_HZ))
    changes = program.times_s * COLOUR_HZ
    frames = np.unique(np.concatenate([[0.0, last], np.floor(changes - 1e-6), np.ceil(changes - 1e-6)]))
    frames = frames[(frames >= 0.0) & (frames <= last)].astype(int)
    colours = show.lights.colours_at(frames / COLOUR_HZ, np.full(len(frames), row)).tolist()
    gaps = np.diff(frames, prepend=0).tolist()
    return [
        {"r": red, "g": green, "b": blue} | ({"frames": gap} if gap else {})
        for (red, green, blue), gap in zip(colours, gaps, strict=True)
    ]
