"""The common shape of every error response, and descriptions of invalid requests in the project's words."""

import json
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from math import isfinite, isnan
from typing import Any, Final

from starlette.responses import Response
from starlette.types import Receive, Scope, Send
from starlette.websockets import WebSocket

from gcs.api.schemas import reports, requests
from gcs.model.errors import cut, quoted

SECURITY_HEADERS: Final[Mapping[str, str]] = {
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
"""With these, no page of another site can frame or embed a response, and browsers do not guess its type."""

ERROR_HEADERS: Final = {**SECURITY_HEADERS, "Cache-Control": "no-store"}

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


def error_response(status: int, detail: str, problems: Sequence[reports.FieldProblem] = ()) -> Response:
    """Make an error response in the common shape, in plain ASCII, so that no received text can break it."""
    body = {
        "detail": detail if len(detail) <= DETAIL_MAX else detail[:DETAIL_MAX] + "…",
        "problems": [problem.model_dump() for problem in problems],
    }
    text = json.dumps(body, allow_nan=False, ensure_ascii=True)
    return Response(text, status_code=status, media_type="application/json", headers=ERROR_HEADERS)


def invalid_response(problems: Sequence[reports.FieldProblem]) -> Response:
    detail = "; ".join(f"{problem.field} = {_text(problem.value)}: {problem.allowed}" for problem in problems)
    return error_response(HTTPStatus.UNPROCESSABLE_ENTITY, detail, problems)


def from_pydantic(error: dict[str, Any]) -> reports.FieldProblem:
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
    return reports.FieldProblem(field=cut(field), value=echo(value), allowed=allowed)


async def refuse(response: Response, scope: Scope, receive: Receive, send: Send) -> None:
    """Send the response to a request, or to the handshake of a WebSocket."""
    if scope["type"] == "websocket":
        await receive()  # ASGI: the connect message comes before any response
        await WebSocket(scope, receive, send).send_denial_response(response)
    else:
        await response(scope, receive, send)
