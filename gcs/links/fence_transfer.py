"""Uploads fences, and reads them back, by MAVLink's mission protocol: tasks of the loop, no threads.

One transfer at a time for each vehicle, some at a time for each link, all within what features may send.
Whatever a vehicle answers, a transfer ends: what it may ask, repeat and leave out is bounded.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from gcs.links.command_protocol import CLOSED, TIMEOUT
from gcs.links.link_intake import newest_of_each
from gcs.links.listening import FrameListener
from gcs.links.send_budget import Budget
from gcs.mavlink import codec, fences
from gcs.mavlink.codec import HEADER_LENGTH, Records
from gcs.mavlink.fences import FenceVertex
from gcs.mavlink.framing import COMMAND_LONG
from gcs.mavlink.kernels import MESSAGE, Bytes, Whole
from gcs.model.errors import CommandError
from gcs.model.state import Array

AT_ONCE: Final = 16
"""Vehicles of a link at the same time: autopilots give up where the next item is late by seconds."""

QUIET_S: Final = 0.7
"""Without an answer for so long what was sent last is sent again; autopilots ask again themselves."""

TRIES: Final = 6
BUSY_TRIES, BUSY_S = 3, 1.5
"""An upload that is refused for now: PX4 gives up what another station began after 5 s."""

LONGEST_S: Final = 60.0
"""Of one transfer."""

WAITING_MAX: Final = 32
"""Answers of one vehicle that wait to be read; what is more is dropped."""

ROOM_S: Final = 0.02
"""Period of asking for room."""

READ_MAX: Final = 255
"""Items that are read of a vehicle; one that has more has another fence."""


class StoredFence(NamedTuple):
    """What a vehicle has."""

    items: int
    vertices: tuple[FenceVertex, ...] | None  # None: not read, or not all of them are corners
    same: bool  # as expected, by its identity or by every corner


class _Answer(NamedTuple):
    """One message of a vehicle, to us."""

    message_id: int
    fields: Records
    opaque_id: int


class _Inbox(asyncio.Queue["_Answer | None"]):
    """Answers that wait for one transfer, of the kinds that it asks for; None: the link was closed."""

    def __init__(self, *wants: int) -> None:
        super().__init__(WAITING_MAX)
        self._wants = frozenset(wants)

    def accepts(self, message_id: int) -> bool:
        return message_id in self._wants and not self.full()


@dataclass(eq=False)
class FenceTransfers:
    """Transfers of one link; rows as on the link.

    Attributes:
        reported_id: (n,) `fence_id` of each vehicle's MISSION_CURRENT, -1: none received.
        home_deg: (n, 2) latitude and longitude of each vehicle's HOME_POSITION, NaN: none received.
    """

    system_ids: Whole  # (n,)
    send: Callable[[int, Records, Whole], object]
    budget: Budget
    clock: Callable[[], float]
    station_id: int
    component_id: int
    reported_id: Whole = field(init=False)
    home_deg: Array = field(init=False)
    _inboxes: dict[int, "_Inbox"] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.reported_id = np.full(len(self.system_ids), -1, np.int64)
        self.home_deg = np.full((len(self.system_ids), 2), np.nan)
        self._locks: dict[int, asyncio.Lock] = {}
        self._at_once = asyncio.Semaphore(AT_ONCE)

    @property
    def awaited(self) -> bool:
        return bool(self._inboxes)

    def close(self) -> None:
        """End all that is under way."""
        for inbox in self._inboxes.values():
            while inbox.full():
                inbox.get_nowait()
            inbox.put_nowait(None)

    @property
    def listener(self) -> FrameListener:
        """What reads the answers."""
        component = codec.AUTOPILOT_COMPONENT
        return FrameListener(range(component, component + 1), fences.READ, self._take)

    def _take(self, data: Bytes, frames: Whole, rows: Whole, _time_s: Array) -> None:
        newest = newest_of_each(rows)
        for frame, row in zip(frames[newest], rows[newest].tolist(), strict=True):
            message_id, inbox = int(frame[MESSAGE]), self._inboxes.get(row)
            if message_id == fences.MISSION_CURRENT:
                self.reported_id[row] = fences.reported_fence_id(data, frame)
            elif message_id == fences.HOME_POSITION:
                home = codec.decode(message_id, data, frame[np.newaxis])[0]
                self.home_deg[row] = home["latitude"] * 1e-7, home["longitude"] * 1e-7
            elif inbox is not None and inbox.accepts(message_id):
                self._take_answer(data, frame, message_id, inbox)

    def _take_answer(self, data: Bytes, frame: Whole, message_id: int, inbox: "_Inbox") -> None:
        """Pass on what is addressed to us, and about a fence."""
        fields = codec.decode(message_id, data, frame[np.newaxis])
        is_ours = codec.answers(fields, self.station_id, self.component_id)[0]
        if is_ours and int(fields["mission_type"][0]) == fences.FENCE:
            is_count = message_id == fences.MISSION_COUNT
            opaque_id = fences.opaque_id(data, frame) if is_count else 0
            inbox.put_nowait(_Answer(message_id, fields[0], opaque_id))

    def ask_home(self, row: int) -> None:
        """Ask for HOME_POSITION, if there is room."""
        if self.budget.left_bytes(self.clock()) > 0:
            message = fences.home_request(int(self.system_ids[row]))
            self.send(COMMAND_LONG, message, np.array([row]))
            self.budget.spend(message.itemsize + HEADER_LENGTH)

    async def upload(self, row: int, vertices: Sequence[FenceVertex], *, anew: bool) -> None:
        """Send a fence. Returns once the vehicle has acknowledged all of it.

        Args:
            row: of the vehicle.
            vertices: none: it is to have no fence.
            anew: first let it have none; PX4 loads a fence that equals the last one not again.

        Raises: CommandError with what the vehicle answers, or TIMEOUT.
        """
        async with self._transfer(row, _Inbox(*fences.REQUESTS, fences.MISSION_ACK)) as inbox:
            for left in reversed(range(BUSY_TRIES)):
                try:
                    if anew:
                        await self._upload(row, (), inbox)
                    await self._upload(row, vertices, inbox)
                except _BusyError as error:
                    if not left:
                        raise CommandError(str(error)) from None
                    await asyncio.sleep(BUSY_S)
                else:
                    return

    async def read(self, row: int, expected: Sequence[FenceVertex]) -> StoredFence:
        """Compare the vehicle's fence with the expected one. Raises: CommandError, as `upload`."""
        wants = fences.MISSION_COUNT, fences.MISSION_ITEM_INT, fences.MISSION_ACK
        async with self._transfer(row, _Inbox(*wants)) as inbox:
            first = await self._ask(row, fences.MISSION_REQUEST_LIST, 0, inbox)
            count, system_id = int(first.fields["count"]), int(self.system_ids[row])
            by_identity = first.opaque_id != 0 and first.opaque_id == fences.fence_id(expected)
            if count != len(expected) or by_identity or count > READ_MAX:
                await self._send(row, fences.MISSION_ACK, fences.ack_message(system_id, fences.CANCELLED))
                return StoredFence(count, None, count == len(expected) and by_identity)
            read: list[FenceVertex | None] = []
            for sequence in range(count):
                item = await self._ask(row, fences.MISSION_REQUEST_INT, sequence, inbox)
                read.append(fences.vertex_of(item.fields))
            await self._send(row, fences.MISSION_ACK, fences.ack_message(system_id, fences.ACCEPTED))
            corners = tuple(vertex for vertex in read if vertex is not None)
            whole = corners if len(corners) == count else None
            return StoredFence(count, whole, whole == tuple(expected))

    async def _upload(self, row: int, vertices: Sequence[FenceVertex], inbox: "_Inbox") -> None:
        """One attempt. Raises: CommandError, _BusyError."""
        system_id, count = int(self.system_ids[row]), len(vertices)
        items = fences.item_messages(system_id, vertices)
        newest = fences.MISSION_COUNT, fences.count_message(system_id, count)
        sent = quiet = 0
        await self._send(row, *newest)
        for _ in range(4 * count + 4 * TRIES):
            answer = await _next(inbox)
            if answer is None:
                quiet += 1
                if quiet >= TRIES:
                    raise CommandError(f"{TIMEOUT} after {sent} of {count} items")
                await self._send(row, *newest)
            elif answer.message_id in fences.REQUESTS:
                sequence, quiet = int(answer.fields["seq"]), 0
                if sequence >= count:
                    raise CommandError(f"it asks for item {sequence}, and there are {count}")
                sent = max(sent, sequence + 1)
                newest = fences.MISSION_ITEM_INT, items[sequence : sequence + 1]
                await self._send(row, *newest)
            elif answer.message_id == fences.MISSION_ACK:
                if (result := int(answer.fields["type"])) != fences.ACCEPTED:
                    _refuse(result)
                if sent == count:
                    return
        raise CommandError(f"it asks without end, for {sent} of {count} items so far")

    async def _ask(self, row: int, message_id: int, sequence: int, inbox: "_Inbox") -> _Answer:
        """Ask for the list, or an item of it, until it is there. Raises: CommandError."""
        system_id, is_list = int(self.system_ids[row]), message_id == fences.MISSION_REQUEST_LIST
        message = (
            fences.request_list_message(system_id) if is_list else fences.request_message(system_id, sequence)
        )
        desired = fences.MISSION_COUNT if is_list else fences.MISSION_ITEM_INT
        for _ in range(TRIES):
            await self._send(row, message_id, message)
            for _ in range(WAITING_MAX):
                answer = await _next(inbox)
                if answer is None:
                    break
                if answer.message_id == desired and (is_list or int(answer.fields["seq"]) == sequence):
                    return answer
                if answer.message_id == fences.MISSION_ACK and int(answer.fields["type"]) != fences.ACCEPTED:
                    raise CommandError(f"it answers: {_in_words(int(answer.fields['type']))}")
        raise CommandError(TIMEOUT if is_list else f"{TIMEOUT} at item {sequence}")

    async def _send(self, row: int, message_id: int, message: Records) -> None:
        """Send one message as soon as there is room."""
        while self.budget.left_bytes(self.clock()) <= 0:  # noqa: ASYNC110 (time gives room, no event)
            await asyncio.sleep(ROOM_S)
        self.send(message_id, message, np.array([row]))
        self.budget.spend(message.itemsize + HEADER_LENGTH)

    @asynccontextmanager
    async def _transfer(self, row: int, inbox: "_Inbox") -> "AsyncIterator[_Inbox]":
        """Wait for the vehicle's turn. Raises: CommandError when it takes too long."""
        async with self._locks.setdefault(row, asyncio.Lock()), self._at_once:
            self._inboxes[row] = inbox
            try:
                async with asyncio.timeout(LONGEST_S):
                    yield inbox
            except TimeoutError:
                raise CommandError(f"{TIMEOUT} after {LONGEST_S:g} s") from None
            finally:
                del self._inboxes[row]


class _BusyError(Exception):
    """The vehicle refuses for now, or for good: it has one answer for both."""


def _refuse(result: int) -> None:
    """Raises: _BusyError where it may be another answer later; else CommandError."""
    text = f"it answers: {_in_words(result)}"
    if result in {fences.ERROR, fences.DENIED}:
        raise _BusyError(text)
    raise CommandError(text)


def _in_words(result: int) -> str:
    return fences.RESULTS.get(result, f"result {result}")


async def _next(inbox: "_Inbox") -> _Answer | None:
    """The next answer; None: none within QUIET_S. Raises: CommandError when the link is closed."""
    try:
        async with asyncio.timeout(QUIET_S):
            answer = await inbox.get()
    except TimeoutError:
        return None
    if answer is None:
        raise CommandError(CLOSED)
    return answer
