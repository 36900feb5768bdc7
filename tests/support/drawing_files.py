"""Builds files of drawn shows by hand, entry by entry: what other programs write, and what is broken."""

import io
import json
import zipfile
from base64 import b64encode
from collections.abc import Mapping
from typing import Any


def zipped(entries: Mapping[str, object], compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Return an archive; bytes and texts as they are, everything else as JSON."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", compression) as archive:
        for name, entry in entries.items():
            raw = entry if isinstance(entry, bytes | str) else json.dumps(entry)
            archive.writestr(name, raw)
    return content.getvalue()


def skyc(*drones: Mapping[str, Any], **show: Any) -> dict[str, Any]:
    """Return the entries of a compiled show; each drone is its settings."""
    swarm = {"drones": [{"type": "generic", "settings": dict(drone)} for drone in drones]}
    return {"show.json": {"version": 1, "swarm": swarm, **show}}


def flight(*points: Any, **more: Any) -> dict[str, Any]:
    """Return a drone's settings with a trajectory of these points."""
    return {"trajectory": {"version": 1, "points": list(points), **more}}


def light(*code: int) -> dict[str, Any]:
    """Return a light program of these bytes."""
    return {"version": 1, "data": b64encode(bytes(code)).decode()}


HOVER = flight([0, [0, 0, 0], []], [10, [0, 0, 5], []])
