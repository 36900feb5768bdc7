"""Requests and answers between two stations: repeated until they are received, each taken once, in order."""

import json
from collections import deque
from dataclasses import dataclass, field
from typing import Any, Final

from pydantic_core import from_json

from gcs.model.errors import LinkError

EXPIRES_S: Final = 4.0
"""A request that is not received by then is dropped: so late a command is not expected any more."""

AGAIN_S: Final = 0.1
"""Interval between two repetitions of what is not received yet."""

WAITING_MAX: Final = 200
SIZE_MAX: Final = 50_000
"""Bytes of one message."""


@dataclass(slots=True)
class _Item:
    number: int
    expires_s: float
    body: str  # JSON


@dataclass(slots=True)
class Letters:
    """What one station sends another, and has received from it. Times are those of the own clock."""

    session: int  # of this station's process: numbers begin anew with it
    _items: deque[_Item] = field(default_factory=deque)
    _number: int = 0
    _their_session: int = -1
    _received: int = 0  # number of the newest that was taken, of that session
    _due_s: float = -1.0
    _answers: bool = False  # they wait for an acknowledgement

    def post(self, body: dict[str, Any], now_s: float) -> None:
        """Send `body`, a JSON object. Raises: LinkError when it is too large, or too many wait."""
        text = json.dumps(body, separators=(",", ":"))
        if len(text) > SIZE_MAX - 200:
            raise LinkError(f"a request of {len(text)} characters: at most {SIZE_MAX - 200}")
        if len(self._items) >= WAITING_MAX:
            raise LinkError(f"{WAITING_MAX} requests are not received yet")
        self._number += 1
        self._items.append(_Item(self._number, now_s + EXPIRES_S, text))
        self._due_s = now_s

    def payload(self, now_s: float) -> bytes | None:
        """What is to be published now; None: nothing."""
        while self._items and self._items[0].expires_s < now_s:
            self._items.popleft()
        if now_s < self._due_s or not (self._items or self._answers):
            return None
        self._due_s, self._answers = now_s + AGAIN_S, False
        parts, size = [], 200
        for item in self._items:
            size += len(item.body) + 20
            if size > SIZE_MAX:
                break
            parts.append(f"[{item.number},{item.body}]")
        head = f'"session":{self.session},"of":{self._their_session},"received":{self._received}'
        return f'{{{head},"items":[{",".join(parts)}]}}'.encode()

    def take(self, payload: bytes, now_s: float) -> list[dict[str, Any]]:
        """Note what arrived. Returns: the new bodies, oldest first. Raises: LinkError for other bytes."""
        if len(payload) > SIZE_MAX:
            raise LinkError(f"letters of {len(payload)} bytes")
        try:
            read = from_json(payload)
            session, of, received = (int(read[key]) for key in ("session", "of", "received"))
            items = [(int(number), dict(body)) for number, body in read["items"]]
        except (KeyError, TypeError, ValueError, OverflowError):
            raise LinkError("letters that are no JSON of the expected form") from None
        if of == self.session:
            while self._items and self._items[0].number <= received:
                self._items.popleft()
        if session != self._their_session:
            self._their_session, self._received = session, 0
            if items:  # the first that is not received: those before it have expired
                self._received = items[0][0] - 1
        bodies = []
        for number, body in items:
            if number > self._received:
                self._received = number
                bodies.append(body)
        if items:
            self._answers, self._due_s = True, min(self._due_s, now_s)
        return bodies
