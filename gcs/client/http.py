"""Requests of the client and what they raise: the errors that the service raised itself."""

import json
import ssl
from pathlib import Path
from typing import Any, Final

import httpx

from gcs.model.errors import (
    AccessError,
    ConfigError,
    GcsError,
    InvalidError,
    LinkError,
    RefusedError,
    UnknownError,
)

CONNECT_S: Final = 2.0
"""Whoever listens takes a connection at once; so soon an emergency call tries the other way."""

RAISED: Final[dict[int, type[GcsError]]] = {
    httpx.codes.UNAUTHORIZED: AccessError,
    httpx.codes.FORBIDDEN: AccessError,
    httpx.codes.TOO_MANY_REQUESTS: AccessError,
    httpx.codes.CONFLICT: RefusedError,
    httpx.codes.NOT_FOUND: UnknownError,
    httpx.codes.SERVICE_UNAVAILABLE: LinkError,
}


class Exchange:
    """The way to one service: the one for everything, and where it is known that for emergency calls."""

    def __init__(
        self, url: str, token: str | None, emergency_url: str | None, ca_file: Path | None, timeout_s: float
    ) -> None:
        """Raises: ConfigError for a certificate file or a URL that is none."""
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        trusted = _trusted(ca_file)
        timeout = httpx.Timeout(timeout_s, connect=min(timeout_s, CONNECT_S))

        def way(to: str) -> httpx.Client:
            # Proxies of the environment are not for a station on the same machine or field network.
            try:
                return httpx.Client(
                    base_url=to, timeout=timeout, trust_env=False, headers=headers, verify=trusted
                )
            except (httpx.InvalidURL, UnicodeError) as error:
                raise ConfigError(f"{to}: no URL, or no token: {error}") from None

        self._http = way(url)
        self._lane = None if emergency_url is None else way(emergency_url)

    def close(self) -> None:
        """Close the connections."""
        self._http.close()
        if self._lane is not None:
            self._lane.close()

    def call(
        self, method: str, path: str, body: dict[str, Any] | bytes | None = None, *, urgent: bool = False
    ) -> bytes:
        """The body of the answer. What is `urgent` goes by the emergency lane first.

        `body` is sent as JSON, or as the YAML file that its bytes are.

        Raises: LinkError when nobody answers; else what the service raised.
        """
        # Not httpx's own JSON: it stumbles over NaN, which the service refuses with the field's name.
        content = json.dumps(body).encode() if isinstance(body, dict) else body
        kind = "application/json" if isinstance(body, dict) else "application/yaml"
        headers = {} if body is None else {"Content-Type": kind}
        for http in (self._lane, self._http) if urgent and self._lane is not None else (self._http,):
            try:
                answer = http.request(method, path, content=content, headers=headers)
                break
            except httpx.HTTPError as error:  # from the lane: then as everything else goes
                failure = error
        else:
            cause = str(failure) or type(failure).__name__
            raise LinkError(f"no answer from {self._http.base_url}: {cause}") from failure
        if not answer.is_success:
            raise _error(answer)
        return answer.content


def _error(answer: httpx.Response) -> GcsError:
    """The error that the service raised."""
    try:  # not by the wire's model: what it takes to load it is more than the rest of a command
        body = json.loads(answer.content)
        detail, problems = str(body["detail"]), list(body["problems"])
        first = problems[0] if problems else None
        invalid = first and InvalidError(str(first["field"]), first["value"], str(first["allowed"]))
    except (ValueError, TypeError, KeyError):
        return LinkError(f"{answer.url} answered {answer.status_code}, and not as this service does")
    if answer.status_code == httpx.codes.UNPROCESSABLE_ENTITY and isinstance(invalid, InvalidError):
        if len(problems) > 1:
            invalid.add_note(detail)
        return invalid
    return RAISED.get(answer.status_code, GcsError)(detail)


def _trusted(ca_file: Path | None) -> ssl.SSLContext | bool:
    if ca_file is None:
        return True
    try:
        return ssl.create_default_context(cafile=str(ca_file))
    except OSError as error:  # SSLError is one
        raise ConfigError(f"{ca_file}: no PEM certificate: {error}") from None
