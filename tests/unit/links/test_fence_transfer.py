"""A fence goes to one vehicle and comes back, whatever that vehicle answers; in virtual time."""

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

import async_solipsism
import numpy as np
import pytest

from gcs.links.fence_transfer import LONGEST_S, QUIET_S, TRIES, FenceTransfers
from gcs.links.send_budget import Budget
from gcs.mavlink import codec, fences
from gcs.mavlink.codec import COMPONENT_ID, SYSTEM_ID, Records, records
from gcs.mavlink.fences import FENCE, FenceVertex, vertices_of
from gcs.mavlink.kernels import COMPONENT, LENGTH, MESSAGE, PAYLOAD, Whole
from gcs.model.errors import CommandError
from gcs.model.polygon_fence import PolygonFence
from tests.support.site_fences import square

VERTICES = vertices_of(PolygonFence((square(50.0), square(5.0, inclusion=False))))
COUNT = len(VERTICES)

Answers = Callable[["Vehicle", int, Any], None]


class Vehicle:
    """Row 0, which answers as a test says; what it receives is kept."""

    def __init__(self, answers: Answers) -> None:
        loop = asyncio.get_running_loop()
        self.sent: list[tuple[float, int, Any]] = []
        self.kept: list[FenceVertex] = []
        self.answers, self.clock = answers, loop.time
        self.transfers = FenceTransfers(
            np.array([11, 12]), self.receive, Budget(100_000.0), loop.time, SYSTEM_ID, COMPONENT_ID
        )

    def receive(self, message_id: int, messages: Records, rows: Whole) -> None:
        assert rows.tolist() == [0]
        assert int(messages["target_system"][0]) == 11
        self.sent.append((self.clock(), message_id, messages[0].copy()))
        asyncio.get_running_loop().call_later(0.01, self.answers, self, message_id, messages[0].copy())

    def answer(
        self, message_id: int, *, to: tuple[int, int] = (SYSTEM_ID, COMPONENT_ID), **fields: Any
    ) -> None:
        opaque_id = fields.pop("opaque_id", 0)
        message = records(message_id, 1)
        for name, value in {"mission_type": FENCE, **fields}.items():
            message[name] = value
        message["target_system"], message["target_component"] = to
        frames = codec.encode(message_id, message, np.zeros(1, np.uint8), system_id=11, component_id=1)
        data = frames.data[0, : frames.length[0]].copy()
        found = codec.find(data, np.zeros(1, np.int64), np.array([len(data)])).frames
        if opaque_id:  # behind the known fields, which end in the mission's type
            payload = data[10:15].tobytes() + opaque_id.to_bytes(4, "little")
            data = np.frombuffer(bytearray(data[:10].tobytes() + payload), np.uint8)
            found = found.copy()
            found[0, LENGTH] = len(payload)
        self.transfers.listener.offer(data, found, np.zeros(1, np.int64), np.zeros(1))

    def ids(self) -> list[int]:
        return [message_id for _, message_id, _ in self.sent]


def properly(vehicle: Vehicle, message_id: int, message: Any) -> None:
    """Ask for each item, and acknowledge; then send them back."""
    if message_id == fences.MISSION_COUNT:
        vehicle.kept = []
        if not message["count"]:
            vehicle.answer(fences.MISSION_ACK)
        else:
            vehicle.answer(fences.MISSION_REQUEST, seq=0)
    elif message_id == fences.MISSION_ITEM_INT:
        vertex = fences.vertex_of(message)
        assert vertex is not None
        vehicle.kept.append(vertex)
        if len(vehicle.kept) < COUNT:
            vehicle.answer(fences.MISSION_REQUEST_INT, seq=len(vehicle.kept))
        else:
            vehicle.answer(fences.MISSION_ACK)
    elif message_id == fences.MISSION_REQUEST_LIST:
        vehicle.answer(fences.MISSION_COUNT, count=len(vehicle.kept))
    elif message_id == fences.MISSION_REQUEST_INT:
        send_item(vehicle, int(message["seq"]), vehicle.kept)


def send_item(
    vehicle: Vehicle, sequence: int, vertices: Sequence[FenceVertex], as_number: int | None = None
) -> None:
    vertex = vertices[sequence]
    vehicle.answer(
        fences.MISSION_ITEM_INT,
        seq=sequence if as_number is None else as_number,
        command=vertex.command,
        param1=vertex.corners,
        x=vertex.latitude_e7,
        y=vertex.longitude_e7,
    )


def run(answers: Answers, main: Callable[[Vehicle], Coroutine[None, None, None]]) -> None:
    async def begin() -> None:
        await main(Vehicle(answers))

    with asyncio.Runner(loop_factory=async_solipsism.EventLoop) as runner:
        runner.run(begin())


def test_a_fence_goes_there_and_comes_back() -> None:
    async def main(vehicle: Vehicle) -> None:
        await vehicle.transfers.upload(0, VERTICES, anew=True)
        assert vehicle.ids()[:3] == [fences.MISSION_COUNT, fences.MISSION_COUNT, fences.MISSION_ITEM_INT]
        assert [int(message["count"]) for _, _, message in vehicle.sent[:2]] == [0, COUNT]
        assert tuple(vehicle.kept) == VERTICES
        stored = await vehicle.transfers.read(0, VERTICES)
        assert (stored.items, stored.vertices, stored.same) == (COUNT, VERTICES, True)
        assert not vehicle.transfers.awaited

    run(properly, main)


def test_one_moved_corner_is_another_fence() -> None:
    async def main(vehicle: Vehicle) -> None:
        await vehicle.transfers.upload(0, VERTICES, anew=False)
        vehicle.kept[5] = vehicle.kept[5]._replace(longitude_e7=vehicle.kept[5].longitude_e7 + 1)
        stored = await vehicle.transfers.read(0, VERTICES)
        assert (stored.items, stored.same) == (COUNT, False)

    run(properly, main)


def test_an_identity_spares_the_reading() -> None:
    def answers(vehicle: Vehicle, message_id: int, _: Any) -> None:
        if message_id == fences.MISSION_REQUEST_LIST:
            vehicle.answer(fences.MISSION_COUNT, count=COUNT, opaque_id=fences.fence_id(VERTICES))

    async def main(vehicle: Vehicle) -> None:
        assert (await vehicle.transfers.read(0, VERTICES)).same
        assert vehicle.ids() == [fences.MISSION_REQUEST_LIST, fences.MISSION_ACK]
        assert int(vehicle.sent[-1][2]["type"]) == fences.CANCELLED

    run(answers, main)


def test_lost_messages_are_sent_again() -> None:
    lost = {1, 4, 5, 9}

    def answers(vehicle: Vehicle, message_id: int, message: Any) -> None:
        if len(vehicle.sent) not in lost:
            properly(vehicle, message_id, message)

    async def main(vehicle: Vehicle) -> None:
        await vehicle.transfers.upload(0, VERTICES, anew=False)
        assert tuple(vehicle.kept) == VERTICES
        assert len(vehicle.sent) == 1 + COUNT + len(lost)
        assert vehicle.clock() < 1.0 + QUIET_S * len(lost)

    run(answers, main)


def test_silence_ends_with_how_far_it_came() -> None:
    def answers(vehicle: Vehicle, message_id: int, message: Any) -> None:
        if len(vehicle.sent) <= 4:
            properly(vehicle, message_id, message)

    async def main(vehicle: Vehicle) -> None:
        with pytest.raises(CommandError, match=f"TIMEOUT after 4 of {COUNT} items"):
            await vehicle.transfers.upload(0, VERTICES, anew=False)
        assert vehicle.clock() < 1.0 + TRIES * QUIET_S

    run(answers, main)


def ignored(vehicle: Vehicle, *_: Any) -> None:
    """To another station, of a mission, and what was never asked for."""
    vehicle.answer(fences.MISSION_ACK, type=4, to=(255, 190))
    vehicle.answer(fences.MISSION_ACK, type=4, mission_type=0)
    vehicle.answer(fences.MISSION_REQUEST, seq=0, to=(SYSTEM_ID, 1))
    send_item(vehicle, 0, VERTICES)
    vehicle.answer(fences.MISSION_COUNT, count=65535)


def asks_for_ever(vehicle: Vehicle, *_: Any) -> None:
    vehicle.answer(fences.MISSION_REQUEST_INT, seq=0)


def asks_beyond(vehicle: Vehicle, *_: Any) -> None:
    vehicle.answer(fences.MISSION_REQUEST_INT, seq=COUNT)


def accepts_at_once(vehicle: Vehicle, message_id: int, _: Any) -> None:
    if message_id == fences.MISSION_COUNT:
        vehicle.answer(fences.MISSION_ACK)


def no_space(vehicle: Vehicle, *_: Any) -> None:
    vehicle.answer(fences.MISSION_ACK, type=4)


def busy(vehicle: Vehicle, *_: Any) -> None:
    vehicle.answer(fences.MISSION_ACK, type=1)


@pytest.mark.parametrize(
    ("answers", "words", "most"),
    [
        (ignored, "TIMEOUT after 0", TRIES),
        (asks_for_ever, "asks without end, for 1 of 8", 4 * COUNT + 4 * TRIES + 1),
        (asks_beyond, "asks for item 8, and there are 8", 1),
        (accepts_at_once, "TIMEOUT after 0", TRIES),
        (no_space, "it answers: no space", 1),
        (busy, "it answers: an error, or it is busy", 3),
    ],
)
def test_an_upload_ends_whatever_is_answered(answers: Answers, words: str, most: int) -> None:
    async def main(vehicle: Vehicle) -> None:
        with pytest.raises(CommandError, match=words):
            await vehicle.transfers.upload(0, VERTICES, anew=False)
        assert len(vehicle.sent) <= most
        assert vehicle.clock() < LONGEST_S
        assert not vehicle.transfers.awaited

    run(answers, main)


def test_a_fence_of_65535_items_is_not_read() -> None:
    def answers(vehicle: Vehicle, message_id: int, _: Any) -> None:
        if message_id == fences.MISSION_REQUEST_LIST:
            vehicle.answer(fences.MISSION_COUNT, count=65535)

    async def main(vehicle: Vehicle) -> None:
        stored = await vehicle.transfers.read(0, VERTICES)
        assert (stored.items, stored.vertices, stored.same) == (65535, None, False)
        assert vehicle.ids() == [fences.MISSION_REQUEST_LIST, fences.MISSION_ACK]

    run(answers, main)


def test_items_in_a_wrong_order_are_not_believed() -> None:
    def answers(vehicle: Vehicle, message_id: int, message: Any) -> None:
        vehicle.kept = list(VERTICES)
        if message_id == fences.MISSION_REQUEST_INT:
            send_item(vehicle, 0, VERTICES, as_number=int(message["seq"]) + 1)
        else:
            properly(vehicle, message_id, message)

    async def main(vehicle: Vehicle) -> None:
        with pytest.raises(CommandError, match="TIMEOUT at item 0"):
            await vehicle.transfers.read(0, VERTICES)
        assert vehicle.clock() < LONGEST_S

    run(answers, main)


def test_a_refusal_ends_the_reading() -> None:
    def answers(vehicle: Vehicle, *_: Any) -> None:
        vehicle.answer(fences.MISSION_ACK, type=3)

    async def main(vehicle: Vehicle) -> None:
        with pytest.raises(CommandError, match="it answers: unsupported"):
            await vehicle.transfers.read(0, VERTICES)

    run(answers, main)


def test_a_flood_of_unasked_items_does_not_stop_an_upload() -> None:
    def answers(vehicle: Vehicle, message_id: int, message: Any) -> None:
        for _ in range(200):
            send_item(vehicle, 1, VERTICES)
        properly(vehicle, message_id, message)

    async def main(vehicle: Vehicle) -> None:
        await vehicle.transfers.upload(0, VERTICES, anew=False)
        assert tuple(vehicle.kept) == VERTICES
        assert vehicle.clock() < 1.0

    run(answers, main)


def test_a_closed_link_ends_what_is_under_way() -> None:
    async def main(vehicle: Vehicle) -> None:
        waiting = asyncio.create_task(vehicle.transfers.upload(0, VERTICES, anew=False))
        await asyncio.sleep(0.1)
        vehicle.transfers.close()
        with pytest.raises(CommandError, match="the link was closed"):
            await waiting

    run(lambda *_: None, main)


def test_a_small_budget_is_kept() -> None:
    async def main(vehicle: Vehicle) -> None:
        rate = 200.0
        vehicle.transfers.budget.bytes_per_s = rate
        await vehicle.transfers.upload(0, VERTICES, anew=False)
        size = sum(message.dtype.itemsize + codec.HEADER_LENGTH for _, _, message in vehicle.sent)
        assert vehicle.clock() > size / rate - 0.5

    run(properly, main)


def test_the_identity_in_mission_current_is_kept() -> None:
    async def main(vehicle: Vehicle) -> None:
        assert vehicle.transfers.reported_id.tolist() == [-1, -1]
        payload = bytes(10) + (0xDEADBEEF).to_bytes(4, "little") + bytes(4)
        data = np.frombuffer(bytearray(payload), np.uint8)
        frame = np.zeros((1, 16), np.int64)
        frame[0, [LENGTH, PAYLOAD]] = len(payload), 0
        frame[0, [MESSAGE, COMPONENT]] = fences.MISSION_CURRENT, 1
        vehicle.transfers.listener.take(data, frame, np.array([1]), np.zeros(1))
        assert vehicle.transfers.reported_id.tolist() == [-1, 0xDEADBEEF]

    run(lambda *_: None, main)
