"""Messages of the service port between the API's process and control, and the table of what may be asked.

A message is its length in four bytes, then its content. A request is two lines of JSON: what is asked
(`Request`), and the arguments. An answer is a pickle of `Answer`; a message without content says that the
view has changed.
"""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol, get_type_hints

from pydantic import BaseModel, ConfigDict, ValidationError, create_model
from pydantic_core import to_json

from gcs.model.errors import GcsError, InvalidError, LinkError
from gcs.model.frames import ShowFrame
from gcs.service import interface
from gcs.service.snapshots import FleetView

LENGTH_BYTES: Final = 4

REQUEST_MAX_BYTES: Final = 256 * 1024
"""The largest is a show of 64 KiB, in base64, or a few thousand names."""

CHANGED: Final = bytes(LENGTH_BYTES)
"""The message that says that the view has changed."""


class Viewing(Protocol):
    """The newest state, as `Latest` has it."""

    @property
    def value(self) -> FleetView: ...


class ApiWatch(Protocol):
    """What the API's process reports of itself."""

    def listens(self) -> None:
        """Both listeners answer."""

    def beat(self) -> None:
        """Its event loop runs."""


ROLES: Final[Mapping[str, type]] = {
    "view": Viewing,
    "audit": interface.Audit,
    "plan": interface.PlanChanges,
    "commands": interface.Commands,
    "stations": interface.Stations,
    "command_log": interface.CommandRecords,
    "recovery": interface.Recovery,
    "shows": interface.Shows,
    "site": interface.SiteFile,
    "player": interface.Player,
    "preflight": interface.Preflight,
    "go": interface.Go,
    "alarms": interface.Alarms,
    "events": interface.Events,
    "api": ApiWatch,
}
"""Every role of the port, and the protocol that says what it can be asked."""


@dataclass(frozen=True, slots=True)
class Method:
    """A method of a role, or a property, which has no arguments."""

    role: str
    name: str
    is_property: bool
    is_async: bool
    signature: inspect.Signature
    arguments: type[BaseModel]

    def packed(self, *given: Any, **named: Any) -> bytes:
        """Arguments as JSON. Raises: TypeError if they do not fit."""
        return to_json(self.signature.bind(*given, **named).arguments, bytes_mode="base64")

    def unpacked(self, text: bytes) -> inspect.BoundArguments:
        """Raises: InvalidError if they do not fit."""
        try:
            arguments = self.arguments.model_validate_json(text, strict=True)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            field = ".".join(map(str, first["loc"])) or self.name
            raise InvalidError(field, first["input"], first["msg"]) from None
        given = {name: getattr(arguments, name) for name in arguments.model_fields_set}
        return self.signature.bind(**given)


def _methods() -> dict[str, Method]:
    return {
        f"{role}.{name}": _method(role, name, member)
        for role, protocol in ROLES.items()
        for name, member in vars(protocol).items()
        if not name.startswith("_") and (isinstance(member, property) or inspect.isfunction(member))
    }


def _method(role: str, name: str, member: property | Callable[..., Any]) -> Method:
    if isinstance(member, property):
        nothing = create_model(name, __config__=_EXACT)
        return Method(role, name, True, False, inspect.Signature(), nothing)
    hints = get_type_hints(member, include_extras=True)
    parameters = [*inspect.signature(member).parameters.values()][1:]  # without self
    fields: dict[str, Any] = {
        each.name: (hints[each.name], ... if each.default is inspect.Parameter.empty else each.default)
        for each in parameters
    }
    model = create_model(f"{role}.{name}", __config__=_EXACT, **fields)
    is_async = inspect.iscoroutinefunction(member)
    return Method(role, name, False, is_async, inspect.Signature(parameters), model)


_EXACT: Final = ConfigDict(extra="forbid", val_json_bytes="base64", protected_namespaces=())

METHODS: Final = _methods()
"""All that can be asked, by role and name."""


class Request(BaseModel):
    """The first line of a request."""

    model_config = ConfigDict(strict=True, extra="forbid")

    id: int  # above 0; 0: no answer is wanted
    method: str
    caller: str
    deadline_s: float  # monotonic clock: no answer is waited for after that


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to the request of that id."""

    id: int
    value: Any = None
    error: GcsError | None = None


@dataclass(frozen=True, slots=True)
class Hello:
    """The first message to a client."""

    frame: ShowFrame
    view: FleetView
    why_not_kept: str  # of the shows
    has_stations: bool
    settings: Any  # of the client's process


def framed(content: bytes) -> bytes:
    """A message with its length."""
    return len(content).to_bytes(LENGTH_BYTES) + content


def request_of(content: bytes) -> tuple[Request, bytes]:
    """The request, and its arguments still as JSON. Raises: LinkError."""
    head, _, arguments = content.partition(b"\n")
    try:
        request = Request.model_validate_json(head)
    except ValidationError as error:
        raise LinkError(f"no request: {error.errors(include_url=False)[0]['msg']}") from None
    if request.method not in METHODS:
        raise LinkError(f"no request: there is no {request.method[:80]!r}")
    return request, arguments
