"""The OpenAPI document, and what routes declare in it: names in paths, errors, the token, bodies."""

from http import HTTPStatus
from typing import Annotated, Any, Final

from fastapi import Depends, FastAPI, Path
from fastapi.security import HTTPBearer
from starlette.requests import Request

from gcs.api.schemas import reports
from gcs.api.schemas.requests import NAME_MAX
from gcs.model.errors import InvalidError

DESCRIPTION: Final = """
Fly a formation: start and stop the show; change formation, target, orbit and obstacles in flight. Or fly a
written show: upload it, check it, select it, start it by the hash that its check reports.

Lengths are in metres. Positions are in the show frame (x along the show's heading, y to its right, heights
positive up) or in latitude and longitude. Headings are in degrees clockwise from north. Commands answer 202
with a command record; its outcome is at `/api/v1/commands/{id}`. `/api/v1/stream?rate_hz=10` is a WebSocket
that sends what `/api/v1/fleet` answers, always the newest state. `/api/v1/stream/console` sends binary frames
for displays, and `/api/v1/status` whenever it changes (docs/stream.md). Where several stations fly one
formation, each shows the vehicles of all and accepts commands for all; `/api/v1/stations` lists the stations.
Where commands are recorded, the answer leaves after the record is written; with the header `X-Recorded: no`
it was not written, and `alarms` say why.
"""

MEANING: Final = {
    400: "The body cannot be read.",
    401: "No token, or one that is not known.",
    403: "A token without the role for this, a foreign web page, or a host name that is not accepted.",
    404: "No such thing.",
    408: "The body did not come in time.",
    409: "Proper, but not now; `detail` says why and what to do.",
    413: "The body is too large.",
    415: "The body is compressed (`Content-Encoding`), which is not accepted.",
    429: "Too many calls; `Retry-After` says when to retry.",
    422: "Bad input; `problems` names each field, its value and what is allowed.",
    500: "A bug of this service.",
    503: "Control is not alive, or too many connections are open; `detail` says why.",
}


def errors(*statuses: int) -> dict[int | str, dict[str, Any]]:
    return {status: {"model": reports.ErrorBody, "description": MEANING[status]} for status in statuses}


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


def command(*statuses: int, status: int = HTTPStatus.OK, no_body: bool = False) -> dict[str, Any]:
    """Options of a route that changes something; it may also return the errors `statuses`."""
    responses, dependencies = COMMAND | errors(*statuses), NO_BODY if no_body else None
    return {"status_code": status, "responses": responses, "dependencies": dependencies}


VehicleId = Annotated[str, Path(max_length=NAME_MAX, examples=["d1"])]
StationName = Annotated[str, Path(max_length=NAME_MAX, examples=["north"])]
ObstacleId = Annotated[str, Path(max_length=NAME_MAX, examples=["tower"])]
CommandId = Annotated[str, Path(max_length=NAME_MAX)]
AlarmId = Annotated[str, Path(max_length=NAME_MAX)]
"""Names in paths, bounded as in bodies."""


class DescribedApp(FastAPI):
    """FastAPI whose OpenAPI document demands a token only where the service demands one."""

    def __init__(self, demands_tokens: bool) -> None:
        super().__init__(
            title="Formation ground station",
            version="1",
            description=DESCRIPTION,
            servers=[{"url": "/", "description": "The service that answers with this document."}],
            docs_url=None,  # FastAPI's page loads scripts from the internet, which a field may not have
            redoc_url=None,
            redirect_slashes=False,
            generate_unique_id_function=lambda route: route.name,
            responses=errors(401, 403, 429, 500, 503),
        )
        self._asks_for_tokens = demands_tokens

    def openapi(self) -> dict[str, Any]:
        if self.openapi_schema is None:
            document = super().openapi()
            if not self._asks_for_tokens:
                document.get("components", {}).pop("securitySchemes", None)
                for methods in document["paths"].values():
                    for operation in methods.values():
                        operation.pop("security", None)
            _share_errors(document)
            self.openapi_schema = document
        return self.openapi_schema


def _share_errors(document: dict[str, Any]) -> None:
    """Declare each error once; every operation refers to it. In full they are a third of the document."""
    shared: dict[str, Any] = {}
    for methods in document["paths"].values():
        for operation in methods.values():
            for status, response in operation["responses"].items():
                name = f"Error{status}"
                if int(status) >= HTTPStatus.BAD_REQUEST and response == shared.setdefault(name, response):
                    operation["responses"][status] = {"$ref": f"#/components/responses/{name}"}
    document["components"]["responses"] = shared
