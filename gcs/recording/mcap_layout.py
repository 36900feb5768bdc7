"""Layout of flight data in the MCAP file: topics, schemas, and the bytes of each message.

Everything is JSON with a JSON schema. Messages that Foxglove can draw have its schema names
(`foxglove.PointCloud` and so on); a vehicle is a point with further packed numeric fields, so that a thousand
cost as little as ten. The rest has this project's schemas (`gcs.Tick`, `gcs.Status`).
"""

import json
from base64 import b64decode, b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from types import MappingProxyType
from typing import Any, Final
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter
from pydantic_core import to_json

from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Plan
from gcs.model.state import Array, Mask, Mode, VehicleId
from gcs.model.vehicle_columns import RECORDED
from gcs.recording.sample import Sample
from gcs.service import SelectedShow, TickView
from gcs.service.alarms import Alarm
from gcs.service.features import Features
from gcs.service.vehicle_table import VehicleTable

VERSION: Final = 5
READABLE: Final = ("4", "5")
"""Versions; 4 has the same messages, and programs that read its points by fixed places."""

CHECKSUM: Final = "crc32"
PROFILE: Final = "formation-gcs"
SHOW, MAP = "show", "map"

PHASES: Final = tuple(Phase)
MODES: Final = tuple(Mode)
_PHASE_NUMBER: Final = {phase: number for number, phase in enumerate(PHASES)}
_MODE_NUMBER: Final = {mode: number for number, mode in enumerate(MODES)}

POSITION: Final = ("x", "y", "z")  # show frame, m
VELOCITY: Final = ("velocity_x_m_s", "velocity_y_m_s", "velocity_z_m_s")
SETPOINT: Final = ("setpoint_x_m_s", "setpoint_y_m_s", "setpoint_z_m_s")  # NaN: none
COLOUR: Final = ("red", "green", "blue", "alpha")
"""Colour that the show sets on a vehicle; alpha 0: none. Foxglove draws fields of these names."""

VEHICLE: Final = np.dtype(
    [
        *((name, "<f4") for name in (*POSITION, *VELOCITY, *SETPOINT)),
        *((name, "<f4") for name in RECORDED.values()),
        ("phase", "u1"),  # indices of the names in the file's metadata
        ("mode", "u1"),
        ("landed", "u1"),  # MAV_LANDED_STATE
        ("armed", "u1"),
        ("ready", "u1"),
        *((name, "u1") for name in COLOUR),
    ]
)
"""One vehicle in `/fleet/vehicles` and `/fleet/elsewhere`."""

_BLOCKS: Final = np.dtype(
    [
        *((name, "<f4", 3) for name in ("position", "velocity", "setpoint")),
        ("numbers", "<f4", len(RECORDED)),
        *((name, "u1") for name in ("phase", "mode", "landed", "armed", "ready")),
        ("colour", "u1", 3),
        ("alpha", "u1"),
    ]
)
"""The same bytes as `VEHICLE` with vectors, and all numbers, as one column: each that is set costs time."""


@dataclass(frozen=True, slots=True)
class TickMessage:
    """What changes in every tick, of `/fleet/tick`; the vehicles are in `/fleet/vehicles`."""

    time_s: float  # monotonic clock
    number: int  # of the samples passed to the record, from 1
    center_m: tuple[float, float, float] | None
    center_velocity_m_s: tuple[float, float, float] | None
    radius_m: float | None
    target_m: tuple[float, float]
    minimum_separation_m: float | None
    control_alive: bool
    setpoints_sent: int
    timing: TickView
    limited_by: dict[VehicleId, str]


@dataclass(frozen=True, slots=True)
class RecordedLimits:
    """The limits that applied, of `/fleet/status`: the service's, or the selected show's."""

    safety: dict[str, Any]  # as `gcs.safety.filter.SafetySettings.model_validate` takes it
    acceleration_max_m_s2: float


@dataclass(frozen=True, slots=True)
class StatusMessage:
    """What changes seldom, of `/fleet/status`."""

    show: ShowPhase
    reason: str
    plan: Plan
    selected: SelectedShow | None
    start_unix_time_s: float | None
    reasons: list[str]  # of the vehicles' phases
    alarms: tuple[Alarm, ...]
    limits: RecordedLimits | None


TICK: Final = TypeAdapter(TickMessage)
STATUS: Final = TypeAdapter(StatusMessage)
FEATURES: Final = TypeAdapter(Features)
"""What features report, of `/fleet/features`."""

_FOXGLOVE: Final = resources.files("gcs.recording").joinpath("foxglove_schemas.json").read_text("utf-8")
_OWN: Final[dict[str, TypeAdapter[Any]]] = {"gcs.Tick": TICK, "gcs.Status": STATUS, "gcs.Features": FEATURES}
_BY_NAME: Final = json.loads(_FOXGLOVE) | {name: kind.json_schema() for name, kind in _OWN.items()}

SCHEMAS: Final[dict[str, tuple[str, dict[str, object]]]] = {
    topic: (name, _BY_NAME[name])
    for topic, name in (
        ("/fleet/vehicles", "foxglove.PointCloud"),
        ("/fleet/elsewhere", "foxglove.PointCloud"),
        ("/fleet/tick", "gcs.Tick"),
        ("/fleet/status", "gcs.Status"),
        ("/fleet/scene", "foxglove.SceneUpdate"),
        ("/tf", "foxglove.FrameTransform"),
        ("/log", "foxglove.Log"),
        ("/fleet/features", "gcs.Features"),
    )
}
"""Topic: name of the schema, and the schema."""

TOPICS: Final = dict(enumerate(SCHEMAS, start=1))
"""Topics by channel number, the same in every file: for a file with a damaged first chunk."""

_FORMATS: Final = {7: "<f4", 1: "u1"}  # by foxglove.NumericType
_FIELDS: Final = [
    {"name": name, "offset": offset, "type": 1 if kind == np.dtype("u1") else 7}
    for name, (kind, offset) in ((name, VEHICLE.fields[name][:2]) for name in VEHICLE.names or ())  # type: ignore[index]
]
_NUMBERS: Final = frozenset(RECORDED.values())
_AT_ORIGIN: Final = {"position": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
_CLOUD: Final = json.dumps(
    {"frame_id": SHOW, "pose": _AT_ORIGIN, "point_stride": VEHICLE.itemsize, "fields": _FIELDS}
)[1:-1].encode()
_INTO_MAP: Final = {
    "parent_frame_id": MAP,
    "child_frame_id": SHOW,
    "translation": {"x": 0, "y": 0, "z": 0},
    "rotation": {"x": 1, "y": 0, "z": 0, "w": 0},
}


def about(
    session: str,
    config_json: str,
    vehicles: Mapping[str, tuple[int, str]],
    autopilots: Mapping[str, str] = MappingProxyType({}),
    elsewhere: int = 0,
    site_hash: str = "",
) -> dict[str, str]:
    """Return the file's metadata: the meaning of its numbers, and everything that does not change.

    Args:
        session: name.
        config_json: the configuration.
        vehicles: system id and link of each, in the order of the rows.
        autopilots: name of each, where known.
        elsewhere: so many vehicles at the end are in `/fleet/elsewhere`.
        site_hash: of the areas that were flown in; empty: the configuration names no site.
    """
    values = {
        "version": str(VERSION),
        "elsewhere": str(elsewhere),
        "session": session,
        "config": config_json,
        "vehicles": json.dumps([[name, system_id, link] for name, (system_id, link) in vehicles.items()]),
        "phases": json.dumps([phase.value for phase in PHASES]),
        "modes": json.dumps([mode.value for mode in MODES]),
    }
    if site_hash:
        values["site_hash"] = site_hash
    if autopilots:
        values["autopilots"] = json.dumps([autopilots[name] for name in vehicles])
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
    return packed_state(
        rows.position_m,
        rows.velocity_m_s,
        rows.setpoint_m_s,
        {name: getattr(rows, name) for name in RECORDED},
        {
            "phase": np.fromiter(map(_PHASE_NUMBER.__getitem__, rows.phases), np.uint8, count),
            "mode": np.fromiter(map(_MODE_NUMBER.__getitem__, rows.modes), np.uint8, count),
            "landed": np.fromiter(rows.landed, np.uint8, count),
            "armed": np.fromiter(rows.armed, np.bool_, count),
            "ready": np.fromiter(rows.ready, np.bool_, count),
            "colour": rows.colour,
            "alpha": np.where(rows.lit, 255, 0),
        },
    )


def packed_state(
    position_m: Array,
    velocity_m_s: Array,
    setpoint_m_s: Array,
    numbers: Mapping[str, Array],
    columns: Mapping[str, NDArray[Any]],
) -> NDArray[np.void]:
    """(n,) Rows of VEHICLE.

    Args:
        position_m: (n, 3) show frame, as both velocities.
        velocity_m_s: (n, 3) measured.
        setpoint_m_s: (n, 3) commanded.
        numbers: (n,) each, at least those of `RECORDED`.
        columns: (n,) each, the rest by their names; `colour` (n, 3). One that is not given is 0.
    """
    table = np.zeros(len(position_m), _BLOCKS)
    table["position"], table["velocity"], table["setpoint"] = position_m, velocity_m_s, setpoint_m_s
    table["numbers"].T[:] = [numbers[name] for name in RECORDED]
    for name, values in columns.items():
        table[name] = values
    return table.view(VEHICLE)


def own_rows(sample: Sample) -> NDArray[np.void]:
    """(n,) Rows of VEHICLE of the vehicles on the station's own links, as their own station sees them."""
    rows, elsewhere = packed(sample.view.rows), sample.elsewhere
    if elsewhere is None or elsewhere.shown is None:
        return rows
    return np.concatenate([rows, elsewhere.rows])[elsewhere.shown[: len(rows)]]


def rows_elsewhere(sample: Sample) -> NDArray[np.void]:
    """Rows of VEHICLE of the vehicles that only other stations receive."""
    elsewhere = sample.elsewhere
    if elsewhere is None:
        return np.zeros(0, VEHICLE)
    if elsewhere.shown is None:
        return elsewhere.rows
    own = len(sample.view.rows.ids)
    return elsewhere.rows[elsewhere.shown[own:] - own]


def _of_all(sample: Sample, own: Sequence[str], elsewhere: Sequence[str]) -> list[str]:
    """A column of text: the own vehicles, then those elsewhere."""
    both = [*own, *elsewhere]
    if sample.elsewhere is None or sample.elsewhere.shown is None:
        return both
    return [both[row] for row in sample.elsewhere.shown.tolist()]


def recorded_ids(sample: Sample) -> list[VehicleId]:
    """Names of the own vehicles, then of those elsewhere."""
    return _of_all(sample, sample.view.rows.ids, () if sample.elsewhere is None else sample.elsewhere.ids)


def recorded_reasons(sample: Sample) -> list[str]:
    """Reasons of the own vehicles, then of those elsewhere."""
    elsewhere = () if sample.elsewhere is None else sample.elsewhere.reasons
    return _of_all(sample, sample.view.rows.reasons, elsewhere)


def recorded_show(sample: Sample) -> ShowPhase:
    """Phase of the whole show."""
    return sample.view.show if sample.elsewhere is None else sample.elsewhere.show


def vehicles_message(unix_s: float, rows: NDArray[np.void]) -> bytes:
    """Return a message of `/fleet/vehicles` or `/fleet/elsewhere`, of rows of VEHICLE."""
    when, data = stamp(unix_s), b64encode(rows.tobytes())
    times = when["sec"], when["nsec"]
    return b'{"timestamp":{"sec":%d,"nsec":%d},%s,"data":"%s"}' % (*times, _CLOUD, data)


def rows_of(message: bytes) -> NDArray[np.void]:
    """(n,) Rows of VEHICLE in a message; a number that its points do not have is NaN.

    Raises: KeyError, TypeError or ValueError where it is no such message.
    """
    cloud = json.loads(message)
    data, fields = b64decode(cloud["data"]), cloud["fields"]
    if fields == _FIELDS:
        return np.frombuffer(data, VEHICLE)
    formats = [_FORMATS[field["type"]] for field in fields]
    names, offsets = [field["name"] for field in fields], [field["offset"] for field in fields]
    point: Any = {"names": names, "formats": formats, "offsets": offsets, "itemsize": cloud["point_stride"]}
    points: NDArray[np.void] = np.frombuffer(data, np.dtype(point))
    rows = np.empty(len(points), VEHICLE)
    for name in VEHICLE.names or ():
        rows[name] = np.nan if name in _NUMBERS and name not in names else points[name]
    return rows


def tick_message(sample: Sample, number: int | None = None) -> bytes:
    """Return a message of `/fleet/tick`; `number` replaces the sample's own."""
    view = sample.view
    limited = zip(view.rows.ids, view.rows.limited_by, strict=True)
    return to_json(
        TickMessage(
            view.time_s,
            sample.number if number is None else number,
            view.center_m,
            view.center_velocity_m_s,
            view.radius_m,
            view.target_m,
            view.minimum_separation_m,
            view.control_alive,
            view.setpoints_sent,
            view.tick,
            {name: why for name, why in limited if why},
        )
    )


def status_message(sample: Sample) -> bytes:
    view, control, limits = sample.view, sample.control, None
    if control is not None:
        limits = RecordedLimits(control.safety.model_dump(mode="json"), control.acceleration_max_m_s2)
    return to_json(
        StatusMessage(
            recorded_show(sample),
            view.reason,
            view.plan,
            view.selected,
            view.start_unix_time_s,
            recorded_reasons(sample),
            view.alarms,
            limits,
        )
    )


def transform_message(unix_s: float) -> bytes:
    """Return a message of `/tf`: the show frame has z down; `map` is the same with z up, as in viewers."""
    return as_json({"timestamp": stamp(unix_s), **_INTO_MAP})


_LEVELS: Final = {"debug": 1, "info": 2, "warning": 3, "error": 4, "critical": 5}


def log_message(unix_s: float, level: str, event: str, detail: str) -> bytes:
    message = {"level": _LEVELS.get(level, 0), "message": f"{event} {detail}", "name": event}
    return as_json({"timestamp": stamp(unix_s), **message, "file": "", "line": 0})


def as_json(value: Any) -> bytes:
    """Encode as compact JSON. Raises: ValueError for NaN, which JSON does not have."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode()


def vectors(table: NDArray[np.void], names: Sequence[str]) -> NDArray[np.float32]:
    """(..., 3) POSITION, VELOCITY or SETPOINT of VEHICLE rows (...)."""
    return np.stack([table[name] for name in names], axis=-1)


def colours(table: NDArray[np.void]) -> tuple[NDArray[np.uint8], Mask]:
    """(n, 3) Red, green, blue, and (n,) whether one was set."""
    colour = np.stack([table[name] for name in COLOUR[:3]], axis=-1)
    lit: Mask = table[COLOUR[3]] > 0
    return colour, lit
