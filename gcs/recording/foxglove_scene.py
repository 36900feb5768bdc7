"""The scene around the vehicles for Foxglove's 3D panel: sphere, target, obstacles, names."""

from typing import Any, Final

import numpy as np

from gcs.model.state import Mask
from gcs.recording.mcap_layout import SHOW, as_json, stamp
from gcs.recording.sample import Sample

LABELS_MAX: Final = 64
"""More names than that would cover the fleet."""

LIFETIME: Final = {"sec": 2, "nsec": 0}
TARGET_HEIGHT_M: Final = 2.0
_UPRIGHT: Final = {"x": 0, "y": 0, "z": 0, "w": 1}
_BLUE: Final = {"r": 0.2, "g": 0.5, "b": 1.0, "a": 0.12}
_RED: Final = {"r": 0.9, "g": 0.2, "b": 0.1, "a": 0.9}
_GREY: Final = {"r": 0.6, "g": 0.6, "b": 0.6, "a": 0.6}
_WHITE: Final = {"r": 1.0, "g": 1.0, "b": 1.0, "a": 1.0}
_PRIMITIVES: Final = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")


def scene_message(sample: Sample) -> bytes:
    """Message of `/fleet/scene`. An entity disappears when it is not sent again."""
    plan, time_s = sample.plan, sample.fleet.time_s
    entities = [_entity(sample, "target", cylinders=[_target(*plan.target.position_m(time_s))])]
    if sample.center_m is not None and sample.radius_m is not None:
        entities.append(_entity(sample, "formation", spheres=[_sphere(sample.center_m, sample.radius_m)]))
    for box in plan.obstacles:
        x_m, y_m = box.position_m(time_s)
        size = _xyz(2.0 * box.half_length_x_m, 2.0 * box.half_length_y_m, box.height_m)
        cube = {"pose": _pose(x_m, y_m, -box.height_m / 2.0), "size": size, "color": _GREY}
        entities.append(_entity(sample, f"obstacle {box.id}", cubes=[cube]))
    if len(sample.fleet.ids) <= LABELS_MAX:
        entities.append(_entity(sample, "names", texts=_names(sample)))
    return as_json({"deletions": [], "entities": entities})


def _entity(sample: Sample, name: str, **primitives: object) -> dict[str, Any]:
    nothing: dict[str, object] = {kind: [] for kind in _PRIMITIVES}
    return {
        "timestamp": stamp(sample.unix_time_s),
        "frame_id": SHOW,
        "id": name,
        "lifetime": LIFETIME,
        "frame_locked": True,
        "metadata": [],
        **nothing,
        **primitives,
    }


def _target(x_m: float, y_m: float) -> dict[str, Any]:
    return {
        "pose": _pose(x_m, y_m, -TARGET_HEIGHT_M / 2.0),
        "size": _xyz(1.0, 1.0, TARGET_HEIGHT_M),
        "bottom_scale": 1.0,
        "top_scale": 1.0,
        "color": _RED,
    }


def _sphere(center_m: tuple[float, float, float], radius_m: float) -> dict[str, Any]:
    width_m = 2.0 * radius_m
    return {"pose": _pose(*center_m), "size": _xyz(width_m, width_m, width_m), "color": _BLUE}


def _names(sample: Sample) -> list[dict[str, Any]]:
    known: Mask = np.asarray(np.isfinite(sample.fleet.position_m).all(axis=1))
    return [
        {
            "pose": _pose(*place_m),
            "billboard": True,
            "font_size": 14.0,
            "scale_invariant": True,
            "color": _WHITE,
            "text": name,
        }
        for name, place_m, is_known in zip(
            sample.fleet.ids, sample.fleet.position_m.tolist(), known.tolist(), strict=True
        )
        if is_known
    ]


def _pose(x_m: float, y_m: float, z_m: float) -> dict[str, Any]:
    return {"position": _xyz(x_m, y_m, z_m), "orientation": _UPRIGHT}


def _xyz(x: float, y: float, z: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}
