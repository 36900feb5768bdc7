"""Layout of flight data in the MCAP file: topics, schemas, and the bytes of each message.

Everything is JSON with a JSON schema. Messages that Foxglove can draw have its schema names
(`foxglove.PointCloud` and so on); a vehicle is a point with further packed numeric fields, so that a thousand
cost as little as ten. The rest has this project's schemas (`gcs.Tick`, `gcs.Status`).
"""

import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import isfinite
from typing import Any, Final
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from gcs.model.lifecycle import Phase
from gcs.model.state import Mask, Mode
from gcs.recording.sample import Sample
from gcs.service.vehicle_table import VehicleTable

VERSION: Final = 2
UNCHECKED: Final = "1"  # metadata without a checksum, vehicles without lights
CHECKSUM: Final = "crc32"
PROFILE: Final = "formation-gcs"
SHOW, MAP = "show", "map"

TIMING: Final = ("rate_hz", "count", "missed", "duration_p50_ms", "duration_p99_ms", "lateness_p99_ms")
"""Recorded fields of a `TickView`; counts for metrics are not recorded."""

PHASES: Final = tuple(Phase)
MODES: Final = tuple(Mode)
_PHASE_NUMBER: Final = {phase: number for number, phase in enumerate(PHASES)}
_MODE_NUMBER: Final = {mode: number for number, mode in enumerate(MODES)}

POSITION: Final = ("x", "y", "z")  # show frame, m
VELOCITY: Final = ("velocity_x_m_s", "velocity_y_m_s", "velocity_z_m_s")
SETPOINT: Final = ("setpoint_x_m_s", "setpoint_y_m_s", "setpoint_z_m_s")  # NaN: none
_FIRST: Final[list[tuple[str, str]]] = [
    *((name, "<f4") for name in (*POSITION, *VELOCITY, *SETPOINT)),
    ("yaw_rad", "<f4"),  # from the show's x axis
    ("position_age_s", "<f4"),
    ("position_uncertainty_m", "<f4"),
    ("heartbeat_age_s", "<f4"),
    ("battery_remaining", "<f4"),
    ("phase", "u1"),  # indices of the names in the file's metadata
    ("mode", "u1"),
    ("landed", "u1"),  # MAV_LANDED_STATE
    ("armed", "u1"),
    ("ready", "u1"),
]
LIGHT: Final = ("red", "green", "blue", "alpha")
"""Light that the show sets on a vehicle; alpha 0: none. Foxglove draws fields of these names."""

VEHICLE: Final = np.dtype([*_FIRST, *((name, "u1") for name in LIGHT)])
"""One vehicle in `/fleet/vehicles`."""

ROWS: Final[dict[str, np.dtype[np.void]]] = {UNCHECKED: np.dtype(_FIRST), str(VERSION): VEHICLE}
"""The same, by the version of the file."""

_BLOCKS: Final = np.dtype(
    [
        *((name, "<f4", 3) for name in ("position", "velocity", "setpoint")),
        *((name, kind) for name, kind in _FIRST[9:]),
        ("light", "u1", 3),
        ("alpha", "u1"),
    ]
)
"""The same bytes as `VEHICLE` with vectors as one column: each column that is set costs time."""


def _object(**properties: object) -> dict[str, object]:
    return {"type": "object", "properties": properties}


def _list(item: object) -> dict[str, object]:
    return {"type": "array", "items": item}


_NUMBER, _TEXT, _TRUTH = {"type": "number"}, {"type": "string"}, {"type": "boolean"}
_WHOLE: Final = {"type": "integer"}
_MAYBE: Final = {"type": ["number", "null"]}
_BYTES: Final = {"type": "string", "contentEncoding": "base64"}
_TIME: Final = {**_object(sec=_WHOLE, nsec=_WHOLE), "title": "time"}
_DURATION: Final = {**_object(sec=_WHOLE, nsec=_WHOLE), "title": "duration"}
_VECTOR: Final = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION: Final = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE: Final = _object(position=_VECTOR, orientation=_QUATERNION)
_COLOR: Final = _object(r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_SOLID: Final = _list(_object(pose=_POSE, size=_VECTOR, color=_COLOR))
_CYLINDERS: Final = _list(
    _object(pose=_POSE, size=_VECTOR, bottom_scale=_NUMBER, top_scale=_NUMBER, color=_COLOR)
)
_TEXTS: Final = _list(
    _object(pose=_POSE, billboard=_TRUTH, font_size=_NUMBER, scale_invariant=_TRUTH, color=_COLOR, text=_TEXT)
)
_OTHERS: Final = _list({"type": "object"})  # primitives that are not used
_ENTITY: Final = _object(
    timestamp=_TIME,
    frame_id=_TEXT,
    id=_TEXT,
    lifetime=_DURATION,
    frame_locked=_TRUTH,
    metadata=_list(_object(key=_TEXT, value=_TEXT)),
    arrows=_OTHERS,
    cubes=_SOLID,
    spheres=_SOLID,
    cylinders=_CYLINDERS,
    lines=_OTHERS,
    triangles=_OTHERS,
    texts=_TEXTS,
    models=_OTHERS,
)

SCHEMAS: Final[dict[str, tuple[str, dict[str, object]]]] = {
    "/fleet/vehicles": (
        "foxglove.PointCloud",
        _object(
            timestamp=_TIME,
            frame_id=_TEXT,
            pose=_POSE,
            point_stride=_WHOLE,
            fields=_list(_object(name=_TEXT, offset=_WHOLE, type=_WHOLE)),
            data=_BYTES,
        ),
    ),
    "/fleet/tick": (
        "gcs.Tick",
        _object(
            time_s=_NUMBER,
            number=_WHOLE,
            center_m=_list(_NUMBER),
            center_velocity_m_s=_list(_NUMBER),
            radius_m=_MAYBE,
            target_m=_list(_NUMBER),
            minimum_separation_m=_MAYBE,
            control_alive=_TRUTH,
            setpoints_sent=_WHOLE,
            timing=_object(
                rate_hz=_NUMBER,
                count=_WHOLE,
                missed=_WHOLE,
                duration_p50_ms=_MAYBE,
                duration_p99_ms=_MAYBE,
                lateness_p99_ms=_MAYBE,
            ),
            limited_by={"type": "object", "additionalProperties": _TEXT},
        ),
    ),
    "/fleet/status": (
        "gcs.Status",
        _object(
            show=_TEXT,
            reason=_TEXT,
            plan={"type": "object"},
            selected={"type": ["object", "null"]},
            start_unix_time_s=_MAYBE,
            reasons=_list(_TEXT),
            alarms=_list(
                _object(
                    id=_TEXT,
                    severity=_TEXT,
                    cause=_TEXT,
                    text=_TEXT,
                    advice=_TEXT,
                    vehicles=_list(_TEXT),
                    since_unix_s=_NUMBER,
                    raised_unix_s=_NUMBER,
                    command_id={"type": ["string", "null"]},
                    acknowledged_by={"type": ["string", "null"]},
                    acknowledged_unix_s=_MAYBE,
                    ended_unix_s=_MAYBE,
                )
            ),
            limits={"type": ["object", "null"]},
        ),
    ),
    "/fleet/scene": (
        "foxglove.SceneUpdate",
        _object(deletions=_list(_object(timestamp=_TIME, type=_WHOLE, id=_TEXT)), entities=_list(_ENTITY)),
    ),
    "/tf": (
        "foxglove.FrameTransform",
        _object(
            timestamp=_TIME,
            parent_frame_id=_TEXT,
            child_frame_id=_TEXT,
            translation=_VECTOR,
            rotation=_QUATERNION,
        ),
    ),
    "/log": (
        "foxglove.Log",
        _object(timestamp=_TIME, level=_WHOLE, message=_TEXT, name=_TEXT, file=_TEXT, line=_WHOLE),
    ),
}
"""Topic: name of the schema, and the schema."""

TOPICS: Final = dict(enumerate(SCHEMAS, start=1))
"""Topics by channel number, the same in every file: for a file with a damaged first chunk."""

_FLOAT32, _UINT8 = 7, 1  # foxglove.NumericType
_FIELDS: Final = [
    {"name": name, "offset": offset, "type": _UINT8 if kind == np.dtype("u1") else _FLOAT32}
    for name, (kind, offset) in ((name, VEHICLE.fields[name][:2]) for name in VEHICLE.names or ())  # type: ignore[index]
]
_AT_ORIGIN: Final = {"position": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
_CLOUD: Final = json.dumps(
    {"frame_id": SHOW, "pose": _AT_ORIGIN, "point_stride": VEHICLE.itemsize, "fields": _FIELDS}
)[1:-1]


def about(session: str, config_json: str, vehicles: Mapping[str, tuple[int, str]]) -> dict[str, str]:
    """Return the file's metadata: the meaning of its numbers, and everything that does not change.

    `vehicles`: system id and link of each, in the order of the rows.
    """
    values = {
        "version": str(VERSION),
        "session": session,
        "config": config_json,
        "vehicles": json.dumps([[name, system_id, link] for name, (system_id, link) in vehicles.items()]),
        "phases": json.dumps([phase.value for phase in PHASES]),
        "modes": json.dumps([mode.value for mode in MODES]),
    }
    return {**values, CHECKSUM: checksum(values)}


def checksum(metadata: Mapping[str, str]) -> str:
    """Checksum of the other metadata: MCAP has none, and a flipped bit in a limit would change the report."""
    values = {key: value for key, value in metadata.items() if key != CHECKSUM}
    return f"{crc32(json.dumps(values, sort_keys=True).encode()):08x}"


def nanoseconds(unix_s: float) -> int:
    return round(unix_s * 1e6) * 1000  # a float is no more precise than microseconds


def stamp(unix_s: float) -> dict[str, int]:
    second, nanosecond = divmod(nanoseconds(unix_s), 1_000_000_000)
    return {"sec": second, "nsec": nanosecond}


def packed(rows: VehicleTable) -> NDArray[np.void]:
    """(n,) Rows of VEHICLE."""
    count = len(rows.ids)
    table = np.zeros(count, _BLOCKS)
    table["position"], table["velocity"] = rows.position_m, rows.velocity_m_s
    table["setpoint"] = rows.setpoint_m_s
    table["yaw_rad"], table["position_age_s"] = rows.yaw_rad, rows.position_age_s
    table["position_uncertainty_m"] = rows.uncertainty_m
    table["heartbeat_age_s"], table["battery_remaining"] = rows.heartbeat_age_s, rows.battery_remaining
    table["phase"] = np.fromiter(map(_PHASE_NUMBER.__getitem__, rows.phases), np.uint8, count)
    table["mode"] = np.fromiter(map(_MODE_NUMBER.__getitem__, rows.modes), np.uint8, count)
    table["landed"] = np.fromiter(rows.landed, np.uint8, count)
    table["armed"] = np.fromiter(rows.armed, np.bool_, count)
    table["ready"] = np.fromiter(rows.ready, np.bool_, count)
    table["light"], table["alpha"] = rows.colour, np.where(rows.lit, 255, 0)
    return table.view(VEHICLE)


def vehicles_message(sample: Sample) -> bytes:
    when = stamp(sample.view.unix_time_s)
    data = b64encode(packed(sample.view.rows).tobytes())
    return b'{"timestamp":{"sec":%d,"nsec":%d},%s,"data":"%s"}' % (
        when["sec"],
        when["nsec"],
        _CLOUD.encode(),
        data,
    )


def tick_message(sample: Sample, number: int | None = None) -> bytes:
    """Return a message of `/fleet/tick`; `number` replaces the sample's own."""
    view = sample.view
    return as_json(
        {
            "time_s": view.time_s,
            "number": sample.number if number is None else number,
            "center_m": view.center_m,
            "center_velocity_m_s": view.center_velocity_m_s,
            "radius_m": view.radius_m,
            "target_m": view.target_m,
            "minimum_separation_m": view.minimum_separation_m,
            "control_alive": view.control_alive,
            "setpoints_sent": view.setpoints_sent,
            "timing": {name: known(getattr(view.tick, name)) for name in TIMING},
            "limited_by": {
                name: why for name, why in zip(view.rows.ids, view.rows.limited_by, strict=True) if why
            },
        }
    )


def status_message(sample: Sample) -> bytes:
    view, control, limits = sample.view, sample.control, None
    if control is not None:
        safety = control.safety.model_dump(mode="json")
        limits = {"safety": safety, "acceleration_max_m_s2": control.acceleration_max_m_s2}
    return as_json(
        {
            "show": view.show.value,
            "reason": view.reason,
            "plan": asdict(view.plan),
            "selected": None if view.selected is None else asdict(view.selected),
            "start_unix_time_s": view.start_unix_time_s,
            "reasons": view.rows.reasons,
            "alarms": [asdict(alarm) for alarm in view.alarms],
            "limits": limits,
        }
    )


def transform_message(unix_s: float) -> bytes:
    """Return a message of `/tf`: the show frame has z down; `map` is the same with z up, as in viewers."""
    return as_json(
        {
            "timestamp": stamp(unix_s),
            "parent_frame_id": MAP,
            "child_frame_id": SHOW,
            "translation": {"x": 0, "y": 0, "z": 0},
            "rotation": {"x": 1, "y": 0, "z": 0, "w": 0},
        }
    )


_LEVELS: Final = {"debug": 1, "info": 2, "warning": 3, "error": 4, "critical": 5}


def log_message(unix_s: float, level: str, event: str, detail: str) -> bytes:
    return as_json(
        {
            "timestamp": stamp(unix_s),
            "level": _LEVELS.get(level, 0),
            "message": f"{event} {detail}",
            "name": event,
            "file": "",
            "line": 0,
        }
    )


def known(value: float) -> float | None:
    """Return the value, or None if JSON cannot represent it."""
    return value if isfinite(value) else None


def as_json(value: Any) -> bytes:
    """Encode as compact JSON. Raises: ValueError for NaN, which JSON does not have."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode()


def vectors(table: NDArray[np.void], names: Sequence[str]) -> NDArray[np.float32]:
    """(..., 3) POSITION, VELOCITY or SETPOINT of VEHICLE rows (...)."""
    return np.stack([table[name] for name in names], axis=-1)


def lights(table: NDArray[np.void]) -> tuple[NDArray[np.uint8], Mask]:
    """(n, 3) Red, green, blue, and (n,) whether a light was set; none in files older than these columns."""
    if LIGHT[0] not in (table.dtype.names or ()):
        return np.zeros((len(table), 3), np.uint8), np.zeros(len(table), np.bool_)
    colour = np.stack([table[name] for name in LIGHT[:3]], axis=-1)
    lit: Mask = table[LIGHT[3]] > 0
    return colour, lit
