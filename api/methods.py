"""HEAD and OPTIONS for every path, and the methods of a path."""

from collections.abc import Awaitable, Callable, Sequence
from typing import Final

from starlette.responses import Response
from starlette.routing import BaseRoute, Match
from starlette.types import ASGIApp, Message, Receive, Scope, Send

METHODS: Final = ("DELETE", "GET", "HEAD", "OPTIONS", "PATCH", "POST", "PUT")
EVERYTHING: Final = "*"
"""Target of an OPTIONS request for the whole service (RFC 9110, 7.1)."""


def allowed(routes: Sequence[BaseRoute], scope: Scope) -> list[str]:
    """Methods of the request's path, as in the header `Allow`; empty when no route has that path."""
    if scope["path"] == EVERYTHING:
        return list(METHODS)
    found = {
        method
        for method in METHODS
        for route in routes
        if route.matches({**scope, "type": "http", "method": method})[0] is Match.FULL
    }
    if not found:
        return []
    return sorted(found | {"OPTIONS"} | ({"HEAD"} if "GET" in found else set()))


class Methods:
    """ASGI middleware directly around the routes: HEAD is GET without the body, OPTIONS names the methods."""

    def __init__(self, app: ASGIApp, routes: Callable[[], Sequence[BaseRoute]]) -> None:
        """`routes` returns the routes of the app, which may still grow."""
        self._app = app
        self._routes = routes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer OPTIONS, convert HEAD to GET, and pass on all other methods."""
        method = scope.get("method")
        if method == "OPTIONS" and (names := allowed(self._routes(), scope)):
            await Response(status_code=204, headers={"Allow": ", ".join(names)})(scope, receive, send)
        elif method == "HEAD" and "GET" in allowed(self._routes(), scope):
            await self._app({**scope, "method": "GET"}, receive, _without_body(send))
        else:
            await self._app(scope, receive, send)


def _without_body(send: Send) -> Callable[[Message], Awaitable[None]]:
    async def head(message: Message) -> None:
        await send({**message, "body": b""} if message["type"] == "http.response.body" else message)

    return head
