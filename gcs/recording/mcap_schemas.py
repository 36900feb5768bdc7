"""The JSON schema of every topic; schemas that Foxglove draws have its names and fields."""

from typing import Final


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
