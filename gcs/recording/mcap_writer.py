"""Writes flight data into MCAP.

Once a second a chunk is closed and written, completely or not at all, so that the file is readable up to
its last second however the process ends. A disk error ends the file; when the disk works again, a new file
begins.
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from math import isfinite
from pathlib import Path
from time import monotonic
from typing import IO, Any, Final, NamedTuple, cast

import numpy as np
from mcap.writer import Writer

from gcs.links.disk_writer import DiskWriter, WholeFile
from gcs.recording import mcap_layout as layout
from gcs.recording.mcap_layout import SCHEMAS, SHOW, as_json, stamp
from gcs.recording.sample import RecordedElsewhere, Sample
from gcs.service import FleetView
from gcs.service.features import Features, TrackView

CHUNK_S: Final = 1.0
WAITING_MAX: Final = 400
"""Samples of 20 s: the longest delay of the disk without loss."""

STATUS_S: Final = 5.0  # repeated without a change, for readers that begin in the middle
LED_S: Final = 1.0  # likewise, while a written show or a target changes the plan
SCENE_S: Final = 0.5
FEATURES_S: Final = 0.2  # what features report, such as where targets are, at most so often


class LogLine(NamedTuple):
    """One event, for the file's log."""

    unix_s: float
    level: str
    event: str
    detail: str


class FlightFile(DiskWriter[tuple[Sample | LogLine, int]]):
    """`flight.mcap` in a folder, and `flight-2.mcap` and so on after a disk error."""

    def __init__(self, folder: Path, about: Mapping[str, str]) -> None:
        """Opens nothing yet. `about` becomes the file's metadata."""
        super().__init__(folder, "ticks of flight data", WAITING_MAX)
        self._folder = folder
        self._about = dict(about)
        self._file: _OpenFile | None = None
        self._number = 0

    def add(self, what: Sample | LogLine) -> None:
        """Queue a sample or event. Callable on any thread; takes a microsecond."""
        with self._changed:
            if isinstance(what, Sample):
                self._number += 1  # dropped samples count as well, so that a reader detects them
            self.put([(what, self._number)])

    def _count(self, items: Sequence[tuple[Sample | LogLine, int]]) -> int:
        return sum(isinstance(what, Sample) for what, _ in items)

    def _write(self, batch: Sequence[tuple[Sample | LogLine, int]]) -> None:
        try:
            if self._file is None:
                if not self._count(batch):
                    return
                self._file = _OpenFile(_free_name(self._folder), self._about)
            for what, number in batch:
                self._file.add(what, number)
            self._file.flush()
        except OSError:
            if self._file is not None:
                self._file.abandon()
                self._file = None
            raise

    def _end(self) -> None:
        if self._file is not None:
            self._file.finish()
            self._file = None


class _OpenFile:
    """One file that is being written."""

    def __init__(self, path: Path, about: Mapping[str, str]) -> None:
        """Raises: OSError."""
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._output = WholeFile(path)
        self._writer = Writer(cast("IO[bytes]", self._output))  # it uses only write, tell and flush
        self._writer.start(layout.PROFILE)
        self._writer.add_metadata(layout.PROFILE, dict(about))
        self._channel: dict[str, int] = {}
        for topic, (name, schema) in SCHEMAS.items():
            schema_id = self._writer.register_schema(
                name, "jsonschema", json.dumps({"title": name, **schema}).encode()
            )
            self._channel[topic] = self._writer.register_channel(topic, "json", schema_id)
        self._flush_due_s = monotonic()
        self._status_due_s = self._scene_due_s = self._features_due_s = -1.0
        self._status: tuple[object, ...] = ()
        self._elsewhere: RecordedElsewhere | None = None  # that was written last
        self._features: Features | None = None  # likewise

    def add(self, what: Sample | LogLine, number: int | None = None) -> None:
        """Add one sample, or event, to the chunk; `number` replaces the sample's own."""
        if isinstance(what, LogLine):
            self._add("/log", what.unix_s, layout.log_message(*what))
            return
        view = what.view
        unix_s, time_s = view.unix_time_s, view.time_s
        reasons = view.rows.reasons, None if what.elsewhere is None else what.elsewhere.reasons
        desired = what.reported, view.start_unix_time_s, what.control
        status = (layout.recorded_show(what), view.reason, *desired, *reasons, view.alarms)
        if time_s >= self._status_due_s or status != self._status:
            again_s = STATUS_S if view.selected is None and not what.followed else LED_S
            self._status, self._status_due_s = status, time_s + again_s
            self._add("/fleet/status", unix_s, layout.status_message(what))
        if time_s >= self._scene_due_s:
            self._scene_due_s = time_s + SCENE_S
            self._add("/fleet/scene", unix_s, scene_message(what))
            self._add("/tf", unix_s, layout.transform_message(unix_s))
        if what.elsewhere is not None and what.elsewhere is not self._elsewhere:
            self._elsewhere = what.elsewhere
            rows = layout.rows_elsewhere(what)
            self._add("/fleet/elsewhere", unix_s, layout.vehicles_message(unix_s, rows))
        if time_s >= self._features_due_s and view.features != self._features:
            self._features, self._features_due_s = view.features, time_s + FEATURES_S
            self._add("/fleet/features", unix_s, layout.FEATURES.dump_json(view.features))
        self._add("/fleet/vehicles", unix_s, layout.vehicles_message(unix_s, layout.own_rows(what)))
        self._add("/fleet/tick", unix_s, layout.tick_message(what, number))

    def _add(self, topic: str, unix_s: float, data: bytes) -> None:
        when = layout.nanoseconds(unix_s)
        self._writer.add_message(self._channel[topic], when, data, when)

    def flush(self) -> None:
        """Close the chunk and write it, once a second. Raises: OSError."""
        if monotonic() >= self._flush_due_s:
            self._flush_due_s = monotonic() + CHUNK_S
            self._writer.flush()
            # each chunk can be read without those before
            self._status_due_s, self._elsewhere, self._features = -1.0, None, None

    def finish(self) -> None:
        """Write the last chunk and the index. Raises: OSError."""
        try:
            self._writer.finish()
            self._output.flush()
        finally:
            self._output.close()

    def abandon(self) -> None:
        """Leave the file as it is on the disk: whole chunks, and no index."""
        with suppress(OSError):
            self._output.close()


def _free_name(folder: Path) -> Path:
    """Return an unused name in a folder to which no other process writes."""
    for turn in range(1, 10_000):
        path = folder / ("flight.mcap" if turn == 1 else f"flight-{turn}.mcap")
        if not path.exists():
            return path
    raise FileExistsError(f"{folder}: too many files")


LABELS_MAX: Final = 64
"""More names than that would cover the fleet."""

LIFETIME: Final = {"sec": 2, "nsec": 0}
TARGET_HEIGHT_M: Final = 2.0
_UPRIGHT: Final = {"x": 0, "y": 0, "z": 0, "w": 1}
_BLUE: Final = {"r": 0.2, "g": 0.5, "b": 1.0, "a": 0.12}
_RED: Final = {"r": 0.9, "g": 0.2, "b": 0.1, "a": 0.9}
_ORANGE: Final = {"r": 1.0, "g": 0.6, "b": 0.1, "a": 0.3}
_GREY: Final = {"r": 0.6, "g": 0.6, "b": 0.6, "a": 0.6}
_WHITE: Final = {"r": 1.0, "g": 1.0, "b": 1.0, "a": 1.0}
_PRIMITIVES: Final = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")


def scene_message(sample: Sample) -> bytes:
    """Message of `/fleet/scene`. An entity disappears when it is not sent again."""
    view = sample.view
    plan, time_s = view.plan, view.time_s
    post = {
        "pose": _pose(*plan.target.position_m(time_s), -TARGET_HEIGHT_M / 2.0),
        "size": _xyz(1.0, 1.0, TARGET_HEIGHT_M),
        "bottom_scale": 1.0,
        "top_scale": 1.0,
        "color": _RED,
    }
    entities = [_entity(view, "target", cylinders=[post])]
    if view.center_m is not None and view.radius_m is not None:
        width_m = 2.0 * view.radius_m
        size = _xyz(width_m, width_m, width_m)
        sphere = {"pose": _pose(*view.center_m), "size": size, "color": _BLUE}
        entities.append(_entity(view, "formation", spheres=[sphere]))
    for box in plan.obstacles:
        x_m, y_m = box.position_m(time_s)
        size = _xyz(2.0 * box.half_length_x_m, 2.0 * box.half_length_y_m, box.height_m)
        cube = {"pose": _pose(x_m, y_m, -box.height_m / 2.0), "size": size, "color": _GREY}
        entities.append(_entity(view, f"obstacle {box.id}", cubes=[cube]))
    traffic = () if view.features.traffic is None else view.features.traffic.nearest
    entities += [
        _entity(view, f"traffic {track.id}", cylinders=[_cylinder(view, track)])
        for track in traffic
        if track.near or track.evaded
    ]
    names = layout.recorded_ids(sample)
    if len(names) <= LABELS_MAX:
        rows = np.concatenate([layout.own_rows(sample), layout.rows_elsewhere(sample)])
        places_m = layout.vectors(rows, layout.POSITION).tolist()
        entities.append(_entity(view, "names", texts=_names(names, places_m)))
    return as_json({"deletions": [], "entities": entities})


def _cylinder(view: FleetView, track: TrackView) -> dict[str, Any]:
    """The cylinder around a track; one without a known height stands on the ground."""
    traffic, height_m = view.features.traffic, track.height_m
    radius_m, tall_m = (0.0, 0.0) if traffic is None else (traffic.radius_m, 2.0 * traffic.half_height_m)
    place_m = track.x_m, track.y_m, -(tall_m / 2.0 if height_m is None else height_m)
    size = _xyz(2.0 * radius_m, 2.0 * radius_m, tall_m)
    return {"pose": _pose(*place_m), "size": size, "bottom_scale": 1.0, "top_scale": 1.0, "color": _ORANGE}


def _entity(view: FleetView, name: str, **primitives: object) -> dict[str, Any]:
    named = {"timestamp": stamp(view.unix_time_s), "frame_id": SHOW, "id": name}
    kept = {"lifetime": LIFETIME, "frame_locked": True, "metadata": []}
    return {**named, **kept, **{kind: [] for kind in _PRIMITIVES}, **primitives}


def _names(ids: Sequence[str], places_m: Sequence[Sequence[float]]) -> list[dict[str, Any]]:
    drawn = {"billboard": True, "font_size": 14.0, "scale_invariant": True, "color": _WHITE}
    return [
        {"pose": _pose(*place_m), **drawn, "text": name}
        for name, place_m in zip(ids, places_m, strict=True)
        if all(map(isfinite, place_m))
    ]


def _pose(x_m: float, y_m: float, z_m: float) -> dict[str, Any]:
    return {"position": _xyz(x_m, y_m, z_m), "orientation": _UPRIGHT}


def _xyz(x: float, y: float, z: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}
