"""The common shape of every error response, and descriptions of invalid requests in the project's words."""

import json
from collections.abc import Sequence
from http import HTTPStatus
from math import isfinite, isnan
from typing import Any, Final

from starlette.responses import Response

from gcs.api.schemas import fleet as schemas
from gcs.api.schemas import requests
from gcs.api.security_headers import HEADERS
from gcs.model.errors import cut, quoted

ERROR_HEADERS: Final = {**HEADERS, "Cache-Control": "no-store"}

DETAIL_MAX: Final = 4000
"""Most characters of one error's text, however many fields are wrong."""

KINDS: Final = {
    "bool_type": "true or false",
    "dict_type": "a JSON object",
    "list_type": "a list",
    "model_attributes_type": "a JSON object",
    "model_type": "a JSON object",
    "none_required": "null",
    "tuple_type": "a list",
}
"""Description of what is allowed, in terms of JSON, by pydantic's error type."""


def echo(value: object) -> str | int | float | bool | None:
    """Return a received value as short JSON."""
    if isinstance(value, float) and not isfinite(value):
        return "NaN" if isnan(value) else "Infinity" if value > 0 else "-Infinity"
    if value is None or isinstance(value, bool | float):
        return value
    if isinstance(value, int) and value.bit_length() < 54:  # exact in every JSON parser
        return value
    return cut(_text(value))


def _text(value: object) -> str:
    """Format a value as JSON; text without quotes."""
    if isinstance(value, str):
        return value
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if value is None or isinstance(value, bool | int | float | dict | list):
        return json.dumps(value, ensure_ascii=False, default=quoted)
    return quoted(value)


def error_response(status: int, detail: str, problems: Sequence[schemas.Problem] = ()) -> Response:
    """Make an error response in the common shape, in plain ASCII, so that no received text can break it."""
    body = {
        "detail": detail if len(detail) <= DETAIL_MAX else detail[:DETAIL_MAX] + "…",
        "problems": [problem.model_dump() for problem in problems],
    }
    text = json.dumps(body, allow_nan=False, ensure_ascii=True)
    return Response(text, status_code=status, media_type="application/json", headers=ERROR_HEADERS)


def invalid_response(problems: Sequence[schemas.Problem]) -> Response:
    """Make the response to invalid fields: 422."""
    detail = "; ".join(f"{problem.field} = {_text(problem.value)}: {problem.allowed}" for problem in problems)
    return error_response(HTTPStatus.UNPROCESSABLE_ENTITY, detail, problems)


def from_pydantic(error: dict[str, Any]) -> schemas.Problem:
    """Convert one error of pydantic."""
    kind, value = error["type"], error["input"]
    path = [str(part) for part in error["loc"][1:]]
    if len(path) > 1 and path[0] in requests.TARGET_FRAMES:  # the tag of the union, not a field
        path = path[1:]
    field = ".".join(path) or "body"
    allowed = KINDS.get(kind) or error["msg"].removeprefix("Input should be ")
    if kind == "json_invalid":
        field, value, allowed = "body", None, f"JSON; at character {path[0]}: {error['ctx']['error']}"
    elif kind == "missing":
        value, allowed = None, "required" if path else "a JSON object, which is required"
    elif kind == "extra_forbidden":
        allowed = "not a field of this request"
    elif field == "body" and not isinstance(value, dict):
        allowed = "a JSON object, sent as Content-Type: application/json"
    return schemas.Problem(field=cut(field), value=echo(value), allowed=allowed)
