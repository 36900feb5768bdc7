"""The app: every route, every error in one shape, OpenAPI at /docs."""

import json
import sys
from collections.abc import Sequence
from functools import cache
from http import HTTPStatus
from pathlib import Path
from typing import Final

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute

from gcs.api import console_files as page
from gcs.api import metrics
from gcs.api.auth.authorization import Authorization
from gcs.api.auth.middleware import AccessMiddleware, Audited
from gcs.api.context import Context
from gcs.api.errors import echo, error_response, from_pydantic, invalid_response
from gcs.api.map_tiles import GroundMap
from gcs.api.middleware import Methods, SecurityHeaders, allowed
from gcs.api.openapi import DescribedApp
from gcs.api.routes import commands, fleet, go, plan, shows, site, stations, stream, target_reports
from gcs.api.schemas import reports
from gcs.model.errors import GcsError, InvalidError, LinkError, RefusedError, UnknownError, cut
from gcs.service import Service

STATUS: Final[dict[type[GcsError], HTTPStatus]] = {
    InvalidError: HTTPStatus.UNPROCESSABLE_ENTITY,
    RefusedError: HTTPStatus.CONFLICT,
    UnknownError: HTTPStatus.NOT_FOUND,
    LinkError: HTTPStatus.SERVICE_UNAVAILABLE,
}


def create_app(
    service: Service,
    *,
    host_names: Sequence[str] = ("localhost",),
    authorization: Authorization | None = None,
    console: Path = page.DIST,
    ground: GroundMap | None = None,
) -> FastAPI:
    """Create the REST API, the stream and the operator's console over one service.

    Args:
        service: the port to the flight.
        host_names: host names that a browser may use, besides the service's IP addresses.
        authorization: rights and rates of callers; None: every caller has every right, without a rate limit.
        console: the folder of the built console.
        ground: the map that the console draws; None: only a grid.
    """
    authorization = authorization or Authorization()
    app = routed(demands_tokens=authorization.demands_tokens)
    app.include_router(page.routes(console, None if ground is None else ground.origin))
    app.state.context = Context(service, authorization, ground)
    app.add_middleware(Methods, routes=lambda: app.routes)
    app.add_middleware(AccessMiddleware, names=host_names, authorization=authorization)
    app.add_middleware(Audited, audit=service.audit)
    app.add_middleware(SecurityHeaders)  # the last added is the outermost
    app.add_exception_handler(GcsError, _on_gcs_error)
    app.add_exception_handler(RequestValidationError, _on_validation_error)
    app.add_exception_handler(HTTPException, _on_http_error)
    app.add_exception_handler(Exception, _on_bug)
    return app


def routed(*, demands_tokens: bool = True) -> FastAPI:
    """Create an app with every route for its OpenAPI document, without a service: no route can be called."""
    app = DescribedApp(demands_tokens)
    app.routes.extend(_routes())
    return app


@cache
def _routes() -> Sequence[BaseRoute]:
    """All but the console's, shared by all apps: FastAPI builds their models with the first request."""
    app = DescribedApp(demands_tokens=True)
    of_the_document = len(app.routes)
    app.include_router(fleet.health)
    app.include_router(metrics.router)
    routers = (
        fleet.api,
        commands.router,
        plan.router,
        go.router,
        stations.router,
        shows.selected,
        shows.files,
        shows.replay,
        site.router,
        stream.router,
        target_reports.router,
    )
    for router in routers:
        app.include_router(router, prefix="/api/v1")
    return app.routes[of_the_document:]


async def _on_gcs_error(_request: Request, error: Exception) -> Response:
    status = next((STATUS[kind] for kind in type(error).__mro__ if kind in STATUS), None)
    if status is None:  # a GcsError that no request can cause: a bug
        raise error
    if isinstance(error, InvalidError):
        problem = reports.FieldProblem(field=error.field, value=echo(error.value), allowed=error.allowed)
        return invalid_response([problem])
    return error_response(status, str(error))


async def _on_validation_error(_request: Request, error: Exception) -> Response:
    if not isinstance(error, RequestValidationError):
        raise error
    return invalid_response([from_pydantic(each) for each in error.errors()])


async def _on_http_error(request: Request, error: Exception) -> Response:
    if not isinstance(error, HTTPException):
        raise error
    path, names = cut(request.url.path), ""
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:  # Starlette names the methods of one route only
        names = ", ".join(allowed(request.app.routes, request.scope))
    details = {
        HTTPStatus.NOT_FOUND: f"there is no {path} here; /docs lists what there is",
        HTTPStatus.METHOD_NOT_ALLOWED: f"{cut(request.method)} is not possible on {path}: {names} are",
    }
    response = error_response(error.status_code, details.get(HTTPStatus(error.status_code), error.detail))
    response.headers.update(error.headers or {})
    if names:
        response.headers["Allow"] = names
    return response


async def _on_bug(_request: Request, _error: Exception) -> Response:
    """Answer an unexpected exception in the common error shape; the server raises it again and logs it."""
    return error_response(HTTPStatus.INTERNAL_SERVER_ERROR, "an error of this service; its log says more")


if __name__ == "__main__":  # prints the OpenAPI document, from which the console's types are generated
    sys.stdout.write(json.dumps(routed().openapi(), indent=1, sort_keys=True) + "\n")
