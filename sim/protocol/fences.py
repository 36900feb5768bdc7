"""The fence of one fake vehicle by MAVLink's mission protocol: received, kept and sent again. Sans-I/O.

As PX4's mavlink_mission.cpp and geofence.cpp, and ArduPilot's MissionItemProtocol and AC_PolyFence_loader, do
it. Only polygons: circles and return points are refused, as unsupported.
"""

import struct
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from enum import Enum, auto
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common

from gcs.sim.protocol.frames import Message
from gcs.sim.vehicle.polygons import Area

FENCE = common.MAV_MISSION_TYPE_FENCE
INCLUSION = common.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
EXCLUSION = common.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
FRAMES = frozenset(
    {
        common.MAV_FRAME_GLOBAL,
        common.MAV_FRAME_GLOBAL_INT,
        common.MAV_FRAME_GLOBAL_RELATIVE_ALT,
        common.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    }
)
MESSAGES = (
    "MISSION_COUNT",
    "MISSION_ITEM_INT",
    "MISSION_REQUEST_LIST",
    "MISSION_REQUEST",
    "MISSION_REQUEST_INT",
    "MISSION_ACK",
    "MISSION_CLEAR_ALL",
)
CORNERS_MIN = 3


class Item(NamedTuple):
    """One corner as received."""

    frame: int
    command: int
    autocontinue: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float

    @property
    def corners(self) -> int:
        """Corners of its polygon, as the autopilots round it."""
        return int(self.params[0] + 0.5)


class CountWithId(common.MAVLink_mission_count_message):  # type: ignore[misc]
    """MISSION_COUNT with the extension `opaque_id`, which pymavlink does not know."""

    def __init__(self, *fields: int, opaque_id: int) -> None:
        super().__init__(*fields)
        self._opaque_id = opaque_id

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """The frame."""
        known = (self.count, self.target_system, self.target_component, self.mission_type)
        payload = self.unpacker.pack(*known) + struct.pack("<I", self._opaque_id)
        return bytes(self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1))


class Transfer(Enum):
    """What is under way."""

    IDLE = auto()
    RECEIVES = auto()
    SENDS = auto()


def areas_of(items: Sequence[Item]) -> list[Area]:
    """The polygons of a valid fence."""
    areas, at = list[Area](), 0
    while at < len(items):
        corners = items[at : at + items[at].corners]
        at += len(corners)
        deg = np.array([(each.x, each.y) for each in corners], np.float64) * 1e-7
        areas.append(Area(corners[0].command == INCLUSION, deg))
    return areas


class Fences(ABC):
    """Fence of one vehicle; `in_force` are the areas that it keeps to.

    Attributes:
        items: as stored: they survive a reboot.
        in_force: those of the stored areas that are flown.
    """

    most_items: int
    asks_again_s: float
    gives_up_s: float

    def __init__(
        self, reply: Callable[[Message], None], send_text: Callable[[int, str], None], active: set["Fences"]
    ) -> None:
        """`active` holds the fences that a step must ask for what is due."""
        self._reply, self._send_text, self._active = reply, send_text, active
        self.items: tuple[Item, ...] = ()
        self.in_force: tuple[Area, ...] = ()
        self._state = Transfer.IDLE
        self._partner = (0, 0)
        self._received: list[Item] = []
        self._count = self._next = 0
        self._received_s = self._sent_s = 0.0

    @abstractmethod
    def fits(self, item: Item) -> int:
        """MAV_MISSION_RESULT of one item."""

    @abstractmethod
    def keep(self, items: tuple[Item, ...]) -> int:
        """Store a whole fence, or none. Returns: MAV_MISSION_RESULT."""

    @abstractmethod
    def request(self, sequence: int) -> Message:
        """The message that asks for an item."""

    @property
    def identity(self) -> int:
        """Of the stored fence; 0: it has none."""
        return 0

    def receive(self, message: Message, now_s: float) -> None:
        """Take one of MESSAGES; those of missions and rally points are answered as of an empty list."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if message.mission_type != FENCE:
            self._receive_other(message, sender)
            return
        getattr(self, f"_{message.get_type().lower()}")(message, sender, now_s)
        if self._state is Transfer.IDLE:
            self._active.discard(self)
        else:
            self._active.add(self)

    def pass_time(self, now_s: float) -> None:
        """Ask again, or give up."""
        if self._state is Transfer.RECEIVES and now_s - self._sent_s > self.asks_again_s:
            self._ask(now_s)
        elif self._state is not Transfer.IDLE and now_s - self._received_s > self.gives_up_s:
            self.give_up()
            self._end()

    def reload(self) -> None:
        """End what is under way, as a reboot does; what is stored stays."""
        self._end()

    @abstractmethod
    def give_up(self) -> None:
        """Say that a transfer has ended without an end."""

    def _end(self) -> None:
        self._state = Transfer.IDLE
        self._received = []
        self._active.discard(self)

    def _ack(self, to: tuple[int, int], result: int, mission_type: int = FENCE) -> None:
        self._reply(common.MAVLink_mission_ack_message(*to, result, mission_type))

    def _receive_other(self, message: Message, sender: tuple[int, int]) -> None:
        if message.get_type() == "MISSION_REQUEST_LIST":
            self._reply(common.MAVLink_mission_count_message(*sender, 0, message.mission_type))
        elif message.get_type() in {"MISSION_COUNT", "MISSION_CLEAR_ALL"}:
            self._ack(sender, common.MAV_MISSION_UNSUPPORTED, message.mission_type)

    def _ask(self, now_s: float) -> None:
        self._sent_s = now_s
        self._reply(self.request(self._next))

    # one message each

    @abstractmethod
    def may_begin(self, sender: tuple[int, int]) -> int:
        """MAV_MISSION_RESULT for a MISSION_COUNT while something is under way."""

    def _mission_count(self, message: Message, sender: tuple[int, int], now_s: float) -> None:
        if (result := self.may_begin(sender)) != common.MAV_MISSION_ACCEPTED:
            self._ack(sender, result)
            return
        self._received_s = now_s
        if message.count > self.most_items:
            self._ack(sender, common.MAV_MISSION_NO_SPACE)
            self._end()
            return
        if message.count == 0:
            self._ack(sender, self.keep(()))
            self._end()
            return
        self._state, self._partner = Transfer.RECEIVES, sender
        self._received, self._count, self._next = [], message.count, 0
        self._ask(now_s)

    def _mission_item_int(self, message: Message, sender: tuple[int, int], now_s: float) -> None:
        if self._state is not Transfer.RECEIVES or sender != self._partner:
            self.unasked(message, sender)
            return
        self._received_s = now_s
        if message.seq != self._next:
            return
        params = (message.param1, message.param2, message.param3, message.param4)
        place = (message.x, message.y, message.z)
        item = Item(message.frame, message.command, message.autocontinue, params, *place)
        result = self.fits(item)
        if result == common.MAV_MISSION_ACCEPTED:
            self._received.append(item)
            self._next += 1
            if self._next < self._count:
                self._ask(now_s)
                return
            result = self.keep(tuple(self._received))
        self._end()
        self._ack(sender, result)

    @abstractmethod
    def unasked(self, message: Message, sender: tuple[int, int], /) -> None:
        """Answer an item that was not asked for."""

    def _mission_request_list(self, _message: Message, sender: tuple[int, int], now_s: float) -> None:
        if self._state is Transfer.RECEIVES:
            return
        self._received_s = now_s
        self._state, self._partner = Transfer.SENDS, sender
        fields = (*sender, len(self.items), FENCE)
        if self.identity:
            self._reply(CountWithId(*fields, opaque_id=self.identity))
        else:
            self._reply(common.MAVLink_mission_count_message(*fields))

    def _mission_request_int(self, message: Message, sender: tuple[int, int], now_s: float) -> None:
        if self._state is not Transfer.SENDS or sender != self._partner:
            return
        self._received_s = now_s
        if message.seq >= len(self.items):
            self._ack(sender, common.MAV_MISSION_INVALID_SEQUENCE)
            self._end()
            return
        item = self.items[message.seq]
        about = (message.seq, common.MAV_FRAME_GLOBAL_INT, item.command, 0, item.autocontinue)
        corner = (float(item.corners), 0.0, 0.0, 0.0, item.x, item.y, 0.0)
        self._reply(common.MAVLink_mission_item_int_message(*sender, *about, *corner, FENCE))

    _mission_request = _mission_request_int

    def _mission_ack(self, _message: Message, sender: tuple[int, int], _now_s: float) -> None:
        if self._state is Transfer.SENDS and sender == self._partner:
            self._end()

    def _mission_clear_all(self, _message: Message, sender: tuple[int, int], _now_s: float) -> None:
        busy = self._state is not Transfer.IDLE
        self._ack(sender, common.MAV_MISSION_ERROR if busy else self.keep(()))


OF_PX4 = 64
FEWER_OF_PX4, SINCE_ALL = 63, (1, 15)
"""Items before 1.15, which keeps the first place for itself, and has no `fence_id` either."""
NO_HOME = "Geofence invalid, doesn't contain Home position"
NOT_HERE = "Geofence invalid, doesn't contain current vehicle position"
CRITICAL = 2


class Px4Fences(Fences):
    """PX4's: an area without home in it is stored, and acknowledged, but not flown: only a text says so."""

    asks_again_s, gives_up_s = 0.5, 5.0

    def __init__(
        self,
        reply: Callable[[Message], None],
        send_text: Callable[[int, str], None],
        active: set[Fences],
        release: tuple[int, int],
        must_contain: Callable[[], list[tuple[str, tuple[float, float]]]],
    ) -> None:
        """`must_contain`: places by latitude and longitude, each with the text of an area without it."""
        super().__init__(reply, send_text, active)
        self._has_id = release >= SINCE_ALL
        self.most_items = OF_PX4 if self._has_id else FEWER_OF_PX4
        self._must_contain = must_contain
        self._integers = False  # it asks in floats until it has received an integer item
        self._crc = 0

    @property
    def identity(self) -> int:
        """CRC-32 over the items, as they were received."""
        return self._crc if self._has_id else 0

    def fits(self, item: Item) -> int:
        """By `parse_mavlink_mission_item`."""
        self._integers = True
        if item.frame not in FRAMES:
            return int(common.MAV_MISSION_UNSUPPORTED_FRAME)
        if item.command not in {INCLUSION, EXCLUSION}:
            return int(common.MAV_MISSION_UNSUPPORTED)
        good = item.corners >= CORNERS_MIN
        return int(common.MAV_MISSION_ACCEPTED if good else common.MAV_MISSION_ERROR)

    def keep(self, items: tuple[Item, ...]) -> int:
        """One that equals the stored one is not loaded again."""
        if (crc := _crc_of(items)) != self._crc:
            self.items, self._crc = items, crc
            self.in_force = tuple(area for area in areas_of(items) if self._is_flown(area))
        return int(common.MAV_MISSION_ACCEPTED)

    def reload(self) -> None:
        """At boot there is no home yet: all areas are flown."""
        super().reload()
        self._integers = False
        self.in_force = tuple(areas_of(self.items))

    def _is_flown(self, area: Area) -> bool:
        texts = [text for text, at_deg in self._must_contain() if not area.allows(at_deg)]
        for text in texts:
            self._send_text(CRITICAL, f"{text}\t")
        return not texts

    def request(self, sequence: int) -> Message:
        """In integers, once it has received some."""
        form = common.MAVLink_mission_request_message
        if self._integers:
            form = common.MAVLink_mission_request_int_message
        return form(*self._partner, sequence, FENCE)

    def may_begin(self, sender: tuple[int, int]) -> int:
        """The same station may repeat it before the first item has arrived."""
        again = self._state is Transfer.RECEIVES and sender == self._partner and self._next == 0
        free = self._state is Transfer.IDLE or again
        return int(common.MAV_MISSION_ACCEPTED if free else common.MAV_MISSION_ERROR)

    def unasked(self, message: Message, sender: tuple[int, int]) -> None:
        """The last one again: our acknowledgement was lost."""
        last = self._state is Transfer.IDLE and message.seq + 1 == self._next == self._count > 0
        self._ack(sender, common.MAV_MISSION_ACCEPTED if last else common.MAV_MISSION_ERROR)

    def give_up(self) -> None:
        """By a text."""
        self._send_text(CRITICAL, "Operation timeout\t")


def _crc_of(items: Sequence[Item]) -> int:
    """NuttX's `crc32part`: not inverted, from 0."""
    crc = 0
    for each in items:
        head = struct.pack("<BHB4f", each.frame, each.command, each.autocontinue, *each.params)
        crc = zlib.crc32(head + struct.pack("<iif", each.x, each.y, each.z), crc ^ 0xFFFFFFFF) ^ 0xFFFFFFFF
    return crc


OF_ARDUPILOT = 84
WITHOUT_POLYGONS = "4.0."
"""It has them by an older protocol only; the recorded build of 4.1 is newer than the change."""
WARNING = 4
STORAGE_BYTES = 8 * OF_ARDUPILOT
HEAD_BYTES, AREA_BYTES, CORNER_BYTES = 4, 2, 8


class ArduPilotFences(Fences):
    """ArduPilot's: stored as a whole once all items have arrived, and flown as stored."""

    most_items = OF_ARDUPILOT
    asks_again_s, gives_up_s = 1.0, 8.0

    def __init__(
        self,
        reply: Callable[[Message], None],
        send_text: Callable[[int, str], None],
        active: set[Fences],
        software: str,
    ) -> None:
        super().__init__(reply, send_text, active)
        self._knows = not software.startswith(WITHOUT_POLYGONS)

    def receive(self, message: Message, now_s: float) -> None:
        """4.0 has polygons by another protocol only."""
        if message.mission_type == FENCE and not self._knows:
            sender = (message.get_srcSystem(), message.get_srcComponent())
            self._ack(sender, common.MAV_MISSION_UNSUPPORTED)
            return
        super().receive(message, now_s)

    def fits(self, item: Item) -> int:
        """By `convert_MISSION_ITEM_INT_to_AC_PolyFenceItem`."""
        if item.frame not in FRAMES:
            return int(common.MAV_MISSION_UNSUPPORTED_FRAME)
        if item.command not in {INCLUSION, EXCLUSION}:
            return int(common.MAV_MISSION_UNSUPPORTED)
        good = item.params[0] <= 255
        return int(common.MAV_MISSION_ACCEPTED if good else common.MAV_MISSION_INVALID_PARAM1)

    def keep(self, items: tuple[Item, ...]) -> int:
        """By `write_fence`."""
        problem = _flaw(items)
        if problem:
            self._send_text(WARNING, problem)
            return int(common.MAV_MISSION_ERROR)
        self.items, self.in_force = items, tuple(areas_of(items))
        return int(common.MAV_MISSION_ACCEPTED)

    def request(self, sequence: int) -> Message:
        """Always by the older message."""
        return common.MAVLink_mission_request_message(*self._partner, sequence, FENCE)

    def may_begin(self, sender: tuple[int, int]) -> int:
        """The same station may begin anew."""
        others = self._state is Transfer.RECEIVES and sender != self._partner
        return int(common.MAV_MISSION_DENIED if others else common.MAV_MISSION_ACCEPTED)

    def unasked(self, _message: Message, _sender: tuple[int, int]) -> None:
        """Say that nothing was asked for."""
        self._send_text(WARNING, "invalid receive")

    def give_up(self) -> None:
        """By a text."""
        self._send_text(WARNING, "Fence upload timeout")


def _flaw(items: Sequence[Item]) -> str:
    """What `validate_fence` or the storage refuses, in ArduPilot's words; empty: nothing."""
    at, size = 0, HEAD_BYTES + 1
    while at < len(items):
        first = items[at]
        count = int(first.params[0])
        if count < CORNERS_MIN:
            return f"Invalid vertex count ({count})"
        of_it = items[at : at + count]
        if any(each.command != first.command for each in of_it):
            return f"Received incorrect vertex type (want={first.command})"
        if any(int(each.params[0]) != count for each in of_it):
            return f"Unexpected vertex count want={count}"
        if any(abs(each.x) > 90e7 or abs(each.y) > 180e7 for each in of_it):
            return "Bad lat or lon"
        if len(of_it) < count:
            return "Incorrect item count"
        at += count
        size += AREA_BYTES + CORNER_BYTES * count
    return "Fence exceeds storage size" if size > STORAGE_BYTES else ""
