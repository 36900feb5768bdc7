"""The API's end of the service port: a `Service` with answers from control's process.

A call blocks until control has answered, which it does between two ticks. When it does not within
`ANSWER_S`, the call fails, and control is silent until it sends anything again, as it does with every tick.
Meanwhile commands fail after `GRACE_S`, and displays keep at once what they have: the view, and the events.
"""

import asyncio
import pickle
import select
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from itertools import count
from typing import Any, Final, cast

from pydantic_core import to_json

from gcs.model.errors import LinkError
from gcs.service.commands import CALLER
from gcs.service.event_log import LogEvent
from gcs.service.interface import (
    Alarms,
    Call,
    CommandRecords,
    Commands,
    Go,
    PlanChanges,
    Player,
    Preflight,
    Recovery,
    Shows,
    SiteFile,
    Stations,
)
from gcs.service.remote.messages import (
    LENGTH_BYTES,
    METHODS,
    REQUEST_MAX_BYTES,
    Answer,
    Hello,
    Method,
    framed,
)
from gcs.service.snapshots import FleetView, FlightMarks, Latest

ANSWER_S: Final = 2.0
"""Longest wait for control: longer than it takes for any answer, and than a machine stands still."""

KILL_S: Final = 0.8
"""Longest wait with a kill, which is then sent without control."""

GRACE_S: Final = 0.5
"""Longest wait for a silent control, which may just be going on: some ticks."""

FILES_S: Final = 30.0
"""Longest wait for an answer that needs a disk."""

ALWAYS_S: Final = 1e9

BEAT_S: Final = 1.0

PIECE_BYTES: Final = 1 << 18

ENDED: Final = "control has ended"
NO_ANSWER: Final = "control does not answer: look at the state before this is tried again"


class Line:
    """Requests and answers over one socket. Used on one thread."""

    def __init__(self, line: socket.socket, answer_s: float = ANSWER_S) -> None:
        line.setblocking(False)
        self._socket = line
        self._answer_s = answer_s
        self._received = bytearray()
        self._unsent = bytearray()
        self._numbers = count(1)
        self._answers: dict[int, Answer | None] = {}  # of calls that wait; None: not come yet
        self._futures: dict[int, asyncio.Future[Any]] = {}
        self._is_silent = False
        self.on_change: Callable[[], None] = lambda: None

    def hello(self) -> Hello:
        """Wait for the first message, however long that takes. Raises: LinkError when the line is closed."""
        while (content := self._pop()) is None:
            self._wait(None, select.POLLIN)
            self._take()
        return cast("Hello", pickle.loads(content))  # noqa: S301 (of control, which is trusted)

    def tell(self, method: Method, *given: Any, **named: Any) -> None:
        """Send a request without an answer, to be executed however late; lost while control is silent."""
        with suppress(LinkError):
            self._send(0, method, ALWAYS_S, given, named)

    def wait_while_silent(self) -> None:
        """Give a silent control the time to go on. Raises: LinkError when it does not."""
        until_s = time.monotonic() + GRACE_S
        while self._is_silent:
            self._wait(until_s, select.POLLIN)
            self.receive()

    def call(self, method: Method, *given: Any, **named: Any) -> Any:
        """Return the answer. Raises: LinkError without one; the answer's own error."""
        number = next(self._numbers)
        deadline_s = self._send(number, method, self._answer_s, given, named)
        if method is METHODS["commands.kill"]:
            deadline_s = min(deadline_s, time.monotonic() + KILL_S)
        self._answers[number] = None
        try:
            while (answer := self._answers[number]) is None:
                self._wait(deadline_s, select.POLLIN)
                self.receive()
        finally:
            del self._answers[number]
        return _value(answer)

    async def call_async(self, method: Method, *given: Any, **named: Any) -> Any:
        """As `call`, for what control itself waits for; meanwhile others may call."""
        number = next(self._numbers)
        self._send(number, method, FILES_S, given, named)
        self._futures[number] = future = asyncio.get_running_loop().create_future()
        try:
            async with asyncio.timeout(FILES_S):
                return _value(await future)
        except TimeoutError:
            raise LinkError(NO_ANSWER) from None
        finally:
            del self._futures[number]

    def receive(self) -> None:
        """Take what has arrived, without waiting. Raises: LinkError when the line is closed."""
        self._take()
        while (content := self._pop()) is not None:
            self._is_silent = False
            if content:
                self._note(pickle.loads(content))  # noqa: S301 (of control, which is trusted)
            else:
                self.on_change()

    def _note(self, answer: Answer) -> None:
        """Late answers, for which no call waits any more, are dropped."""
        if answer.id in self._answers:
            self._answers[answer.id] = answer
        elif (future := self._futures.get(answer.id)) is not None and not future.done():
            future.set_result(answer)

    def _send(
        self, number: int, method: Method, within_s: float, given: Sequence[Any], named: dict[str, Any]
    ) -> float:
        """Returns: the deadline. Raises: LinkError."""
        if self._is_silent:
            self.receive()
        if self._is_silent:
            raise LinkError(NO_ANSWER)
        now_s = time.monotonic()
        head = {
            "id": number,
            "method": f"{method.role}.{method.name}",
            "caller": CALLER.get(),
            "deadline_s": now_s + within_s,
        }
        content = to_json(head) + b"\n" + method.packed(*given, **named)
        if len(content) > REQUEST_MAX_BYTES:
            raise LinkError(f"a request of {len(content)} bytes: at most {REQUEST_MAX_BYTES}")
        self._unsent += framed(content)
        self._flush(now_s + self._answer_s)
        return now_s + within_s

    def _flush(self, until_s: float) -> None:
        """Raises: LinkError; what is unsent then precedes the next request."""
        while self._unsent:
            try:
                del self._unsent[: self._socket.send(self._unsent)]
            except BlockingIOError:
                self._wait(until_s, select.POLLOUT | select.POLLIN)
                self.receive()  # control reads nothing while its own messages are not read
            except OSError:
                raise LinkError(ENDED) from None

    def _wait(self, until_s: float | None, events: int) -> None:
        """Raises: LinkError when nothing can be done until then."""
        poll = select.poll()
        poll.register(self._socket, events)
        left_s = None if until_s is None else max(0.0, until_s - time.monotonic())
        if not poll.poll(None if left_s is None else 1e3 * left_s):
            self._is_silent = True
            raise LinkError(NO_ANSWER)

    def _take(self) -> None:
        try:
            piece = self._socket.recv(PIECE_BYTES)
        except BlockingIOError:
            return
        except OSError:
            piece = b""
        if not piece:
            raise LinkError(ENDED)
        self._received += piece

    def _pop(self) -> bytes | None:
        """Return the content of the next message; None: it is not complete yet."""
        end = LENGTH_BYTES + int.from_bytes(self._received[:LENGTH_BYTES])
        if len(self._received) < max(end, LENGTH_BYTES):
            return None
        content = bytes(self._received[LENGTH_BYTES:end])
        del self._received[:end]
        return content


def _value(answer: Answer) -> Any:
    if answer.error is not None:
        raise answer.error
    return answer.value


class _Role:
    """One role of the port: every method and property of its protocol asks control."""

    def __init__(self, line: Line, role: str, **properties: Any) -> None:
        """`properties`: those that never change."""
        self._line = line
        self._role = role
        vars(self).update(properties)

    def __getattr__(self, name: str) -> Any:
        method = METHODS.get(f"{self._role}.{name}")
        if method is None:
            raise AttributeError(name)
        if method.is_property:
            return self._ask(method)
        return partial(self._line.call_async if method.is_async else self._ask, method)

    def _ask(self, method: Method, *given: Any, **named: Any) -> Any:
        self._line.wait_while_silent()
        return self._line.call(method, *given, **named)


class _Audit:
    """Records in control's process. Implements `gcs.service.Audit`."""

    def __init__(self, line: Line) -> None:
        self._line = line

    def call(self, call: Call) -> None:
        self._line.tell(METHODS["audit.call"], call)

    async def kept(self) -> bool:
        try:
            async with asyncio.timeout(ANSWER_S):
                return bool(await self._line.call_async(METHODS["audit.kept"]))
        except (LinkError, TimeoutError):
            return False


class _Events:
    """The newest events, as far as control answers. Implements `gcs.service.interface.Events`."""

    def __init__(self, line: Line) -> None:
        self._line = line
        self._newest: Sequence[LogEvent] = ()

    def newest(self) -> Sequence[LogEvent]:
        with suppress(LinkError):
            self._newest = self._line.call(METHODS["events.newest"])
        return self._newest

    @property
    def marks(self) -> FlightMarks:
        return cast("FlightMarks", self._line.call(METHODS["events.marks"]))


class RemoteService:
    """The service in another process. Implements `gcs.service.Service`."""

    def __init__(self, line: socket.socket, answer_s: float = ANSWER_S) -> None:
        """Wait for control's first message. Raises: LinkError when control ends before."""
        self._socket = line
        self._line = Line(line, answer_s)
        hello = self._line.hello()
        self.settings = hello.settings
        self.frame = hello.frame
        self.replaying = None
        self.view = Latest(hello.view)
        self._newest = hello.view
        self._line.on_change = lambda: self.view.promise(self._fetched)
        self.audit = _Audit(self._line)
        self.events = _Events(self._line)
        self.shows = cast("Shows", _Role(self._line, "shows", why_not_kept=hello.why_not_kept))
        self.site = cast("SiteFile", _Role(self._line, "site"))
        self.stations = cast("Stations", _Role(self._line, "stations")) if hello.has_stations else None
        self.plan = cast("PlanChanges", _Role(self._line, "plan"))
        self.commands = cast("Commands", _Role(self._line, "commands"))
        self.command_log = cast("CommandRecords", _Role(self._line, "command_log"))
        self.recovery = cast("Recovery", _Role(self._line, "recovery"))
        self.player = cast("Player", _Role(self._line, "player"))
        self.preflight = cast("Preflight", _Role(self._line, "preflight"))
        self.go = cast("Go", _Role(self._line, "go"))
        self.alarms = cast("Alarms", _Role(self._line, "alarms"))

    def listens(self) -> None:
        """Report that the API answers."""
        self._line.tell(METHODS["api.listens"])

    async def run(self) -> None:
        """Receive control's messages, and send signs of life, until control ends."""
        loop = asyncio.get_running_loop()
        ended = loop.create_future()

        def receive() -> None:
            try:
                self._line.receive()
            except LinkError:
                loop.remove_reader(self._socket)
                ended.set_result(None)

        loop.add_reader(self._socket, receive)
        while not ended.done():
            self._line.tell(METHODS["api.beat"])
            await asyncio.wait((ended,), timeout=BEAT_S)

    def _fetched(self) -> FleetView:
        """The newest view; the last one when control does not answer, which its age then says."""
        with suppress(LinkError):
            self._newest = self._line.call(METHODS["view.value"])
        return self._newest
