"""HTTP requests of the client, which raise the errors that the service raised."""

from __future__ import annotations

import inspect
import json
import re
import ssl
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, Final, TypeVar, cast, get_type_hints
from urllib.parse import quote

import httpx

from gcs.model import errors
from gcs.model.errors import ConfigError, GcsError, InvalidError, LinkError, visible


class Deferred:
    """Proxy of a module, which is imported at the first access to one of its names.

    For type checkers, import the module itself under `TYPE_CHECKING`.
    """

    __slots__ = ("_name",)

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self._name), name)


if TYPE_CHECKING:
    import pydantic
else:
    pydantic = Deferred("pydantic")

F = TypeVar("F", bound=Callable[..., Any])

URGENT: Final = frozenset(
    {"pause", "stop", "abort", "bring-home", "hold", "return", "land", "kill", "confirm", "acknowledge"}
)
"""Last words of the paths whose POST goes to the emergency listener, if there is one."""

ANSWER_MAX_BYTES: Final = 64 << 20
"""Longest body of an answer; that of the largest drawing has 8 MiB."""

CONNECT_S: Final = 2.0
"""Longest time to connect; after it an emergency call tries the other listener."""

RAISED: Final[dict[int, type[GcsError]]] = {
    httpx.codes.UNAUTHORIZED: errors.AccessError,
    httpx.codes.FORBIDDEN: errors.AccessError,
    httpx.codes.TOO_MANY_REQUESTS: errors.AccessError,
    httpx.codes.CONFLICT: errors.RefusedError,
    httpx.codes.NOT_FOUND: errors.UnknownError,
    httpx.codes.SERVICE_UNAVAILABLE: LinkError,
}


def part(name: str) -> str:
    return quote(name, safe="")


class Exchange:
    """Connections to one service: the main listener, and the emergency listener if its URL is known."""

    def __init__(
        self, url: str, token: str | None, emergency_url: str | None, ca_file: Path | None, timeout_s: float
    ) -> None:
        """Raises: ConfigError for an invalid certificate file or URL."""
        headers = {"Accept-Encoding": "identity"}
        if token is not None:
            headers["Authorization"] = f"Bearer {token}"
        try:
            trusted = None if ca_file is None else ssl.create_default_context(cafile=str(ca_file))
        except OSError as error:  # includes SSLError
            raise ConfigError(f"{ca_file}: no PEM certificate: {error}") from None
        timeout = httpx.Timeout(timeout_s, connect=min(timeout_s, CONNECT_S))

        def client(to: str) -> httpx.Client:
            # reading the usual certificates takes 20 ms, which a call without TLS need not wait for
            without_tls = to.lower().startswith("http:")
            verify = trusted or (ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT) if without_tls else True)
            # proxies of the environment do not apply: the station is on this machine or the field's network
            try:
                return httpx.Client(
                    base_url=to, timeout=timeout, trust_env=False, headers=headers, verify=verify
                )
            except (httpx.InvalidURL, UnicodeError) as error:
                raise ConfigError(f"{to}: no URL, or no token: {error}") from None

        self._http = client(url)
        self._lane = None if emergency_url is None else client(emergency_url)

    def close(self) -> None:
        self._http.close()
        if self._lane is not None:
            self._lane.close()

    def call(
        self,
        method: str,
        path: str,
        declared: Callable[..., Any] | None = None,
        body: dict[str, Any] | bytes | None = None,
        bytes_are: str = "application/yaml",
    ) -> Any:
        """Call a path; an urgent call tries the emergency listener first.

        Args:
            method: of HTTP.
            path: with its query.
            declared: a function whose annotation says what the answer is; None: bytes.
            body: sent as JSON if it is a dict.
            bytes_are: media type of a body of bytes.

        Raises: LinkError without an answer that can be understood, else the error that the service raised.
        """
        urgent = method == "POST" and path.rpartition("/")[2] in URGENT
        # not httpx's own JSON, which raises for NaN; the service refuses NaN with the field's name
        content = json.dumps(body).encode() if isinstance(body, dict) else body
        media_type = "application/json" if isinstance(body, dict) else bytes_are
        headers = {} if body is None else {"Content-Type": media_type}
        for http in (self._lane, self._http) if urgent and self._lane is not None else (self._http,):
            try:
                with http.stream(method, path, content=content, headers=headers) as answer:
                    received = _received(answer)
                break
            except httpx.HTTPError as error:  # no answer from the lane: try the main listener
                failure = error
        else:
            cause = str(failure) or type(failure).__name__
            raise LinkError(f"no answer from {self._http.base_url}: {cause}") from failure
        if declared is None and answer.is_success:
            return received
        received = _visible(received)
        if not answer.is_success:
            raise _error(answer, received)
        kind = get_type_hints(declared)["return"]  # only now: it loads every schema of the API
        try:
            return None if kind is NoneType else pydantic.TypeAdapter(kind).validate_json(received)
        except pydantic.ValidationError as error:
            raise LinkError(f"{path} answered what this client does not understand") from error


class Calls:
    """Methods that are calls of one service."""

    def __init__(self, exchange: Exchange) -> None:
        self._exchange = exchange


def calls(method: str, path: str, **renamed: str) -> Callable[[F], F]:
    """Make a call out of a method of `Calls` that only declares its parameters and its answer.

    Parameters that `path` names become parts of it. The others are the JSON body, without those that are
    None, under their own names or as `renamed`.
    """

    def decorated(declared: F) -> F:
        signature = inspect.signature(declared)

        @wraps(declared)
        def call(*arguments: Any, **options: Any) -> Any:
            bound = signature.bind(*arguments, **options)
            bound.apply_defaults()
            this, *names = bound.arguments
            fields = {name: bound.arguments[name] for name in names}
            to = path.format_map(
                {name: part(value) for name, value in fields.items() if isinstance(value, str)}
            )
            inside = [name for name in fields if f"{{{name}}}" not in path]
            body = {renamed.get(name, name): fields[name] for name in inside if fields[name] is not None}
            return bound.arguments[this]._exchange.call(method, to, declared, body if inside else None)  # noqa: SLF001

        return cast("F", call)

    return decorated


def _received(answer: httpx.Response) -> bytes:
    """Return the body as it was sent. Raises: LinkError when it is compressed or too long."""
    if answer.headers.get("Content-Encoding", "identity") != "identity":
        raise LinkError(f"{answer.url} answered with a compressed body, which was not asked for")
    body = bytearray()
    for piece in answer.iter_raw():
        body += piece
        if len(body) > ANSWER_MAX_BYTES:
            raise LinkError(f"{answer.url} answered with more than {ANSWER_MAX_BYTES} bytes")
    return bytes(body)


_MAY_BE_UNSEEN: Final = re.compile(rb"\\u[0-9a-fA-F]{4}|\xc2[\x80-\x9f]|\xe2[\x80\x81]|\x7f")


def _visible(received: bytes) -> bytes:
    """JSON whose texts have no control characters: strangers may have given them, and terminals obey them."""
    if not _MAY_BE_UNSEEN.search(received):
        return received
    try:
        return json.dumps(_visible_in(json.loads(received))).encode()
    except (ValueError, RecursionError):  # not JSON: whoever reads it says so
        return received


def _visible_in(value: Any) -> Any:
    if isinstance(value, str):
        return visible(value)
    if isinstance(value, dict):
        return {visible(name): _visible_in(part) for name, part in value.items()}
    return [_visible_in(part) for part in value] if isinstance(value, list) else value


def _error(answer: httpx.Response, received: bytes) -> GcsError:
    try:  # without the API's schema, whose import takes longer than the rest of a command
        body = json.loads(received)
        detail, problems = str(body["detail"]), list(body["problems"])
        first = problems[0] if problems else None
        invalid = first and InvalidError(str(first["field"]), first["value"], str(first["allowed"]))
    except (ValueError, TypeError, KeyError, RecursionError):
        return LinkError(f"{answer.url} answered {answer.status_code}, and not as this service does")
    if answer.status_code == httpx.codes.UNPROCESSABLE_ENTITY and isinstance(invalid, InvalidError):
        if len(problems) > 1:
            invalid.add_note(detail)
        return invalid
    return RAISED.get(answer.status_code, GcsError)(detail)
