"""How the errors that a route may answer are documented, and what commands without fields refuse."""

from typing import Any, Final

from fastapi import Depends
from starlette.requests import Request

from api import wire
from gcs.errors import InvalidError

MEANING: Final = {
    400: "The body cannot be read.",
    403: "A foreign web page, or a host name that is not this service's.",
    404: "No such thing.",
    409: "Proper, but not now; `detail` says why and what to do.",
    413: "The body is too large.",
    422: "Bad input; `problems` names each field, its value and what is allowed.",
    500: "A bug of this service.",
    503: "Control is not alive; `detail` says why.",
}


def errors(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """How the errors that a route may answer are documented."""
    return {status: {"model": wire.ErrorBody, "description": MEANING[status]} for status in statuses}


async def _no_body(request: Request) -> None:
    """Whoever sends details with a command that has none means something that would not happen."""
    body = await request.body()
    if body.strip() not in (b"", b"{}", b"null"):
        raise InvalidError("body", body.decode(errors="replace"), "empty: this request has no fields")


NO_BODY: Final = [Depends(_no_body)]
READ: Final = errors(422)
WRITE: Final = errors(400, 413, 422)
COMMAND: Final = WRITE | errors(409, 503)
