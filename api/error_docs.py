"""Common parts of routes: names in paths, documentation of errors and of the token, refusal of bodies."""

from typing import Annotated, Any, Final

from fastapi import Depends, Path
from fastapi.security import HTTPBearer
from starlette.requests import Request

from gcs.api.schemas import fleet as schemas
from gcs.api.schemas.requests import NAME_MAX
from gcs.model.errors import InvalidError

MEANING: Final = {
    400: "The body cannot be read.",
    401: "No token, or one that is not known.",
    403: "A token without the role for this, a foreign web page, or a host name that is not accepted.",
    404: "No such thing.",
    408: "The body did not come in time.",
    409: "Proper, but not now; `detail` says why and what to do.",
    413: "The body is too large.",
    415: "The body is compressed (`Content-Encoding`), which is not accepted.",
    429: "Too many calls; `Retry-After` says when to come again.",
    422: "Bad input; `problems` names each field, its value and what is allowed.",
    500: "A bug of this service.",
    503: "Control is not alive, or too many connections are open; `detail` says why.",
}


def errors(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """OpenAPI documentation of the errors that a route may return."""
    return {status: {"model": schemas.ErrorBody, "description": MEANING[status]} for status in statuses}


async def _no_body(request: Request) -> None:
    """Refuse a body of a command without parameters: the caller expects an effect that the command lacks."""
    body = await request.body()
    if body.strip() not in (b"", b"{}", b"null"):
        raise InvalidError("body", body.decode(errors="replace"), "empty: this request has no fields")


TOKEN: Final = [Depends(HTTPBearer(auto_error=False, description="See `gcs token create`."))]
NO_BODY: Final = [Depends(_no_body)]
READ: Final = errors(422)
WRITE: Final = errors(400, 408, 413, 415, 422)
COMMAND: Final = WRITE | errors(409, 503)

VehicleId = Annotated[str, Path(max_length=NAME_MAX, examples=["d1"])]
ObstacleId = Annotated[str, Path(max_length=NAME_MAX, examples=["tower"])]
CommandId = Annotated[str, Path(max_length=NAME_MAX)]
AlarmId = Annotated[str, Path(max_length=NAME_MAX)]
"""Names in paths, bounded as in bodies."""
