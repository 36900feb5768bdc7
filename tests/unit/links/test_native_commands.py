"""One vehicle is told something, and answers, or not; in virtual time."""

import asyncio
from collections.abc import Callable, Coroutine

import async_solipsism
import numpy as np
import pytest

from gcs.links.autopilots import DEFAULT
from gcs.links.own_commands import ANSWER_S, TRIES, OwnCommands
from gcs.mavlink.codec import COMPONENT_ID, SYSTEM_ID, Records, records
from gcs.mavlink.framing import COMMAND_ACK
from gcs.mavlink.kernels import Whole
from gcs.model.errors import CommandError

ARM = 400
DENIED, IN_PROGRESS = 2, 5


class Bench:
    """Commands to the vehicles with system ids 11 and 12 in rows 0 and 1, and what left."""

    def __init__(self) -> None:
        self.sent: list[tuple[float, int, Records]] = []
        self.commands = OwnCommands(np.array([11, 12]), (DEFAULT, DEFAULT), self.tell)
        self.open = True

    def tell(self, message_id: int, messages: Records, rows: Whole) -> None:
        self.sent.append((asyncio.get_running_loop().time(), message_id, messages.copy()))

    def may_leave(self) -> None:
        if not self.open:
            raise CommandError("killed meanwhile")

    def ack(self, row: int, command: int, result: int = 0, to: tuple[int, int] = (0, 0)) -> None:
        reported = records(COMMAND_ACK, 1)
        reported["command"], reported["result"] = command, result
        reported["target_system"], reported["target_component"] = to
        self.commands.take_acks(np.array([row]), reported)


def run(main: Callable[[Bench], Coroutine[None, None, None]]) -> None:
    with asyncio.Runner(loop_factory=async_solipsism.EventLoop) as runner:
        runner.run(main(Bench()))


def test_command_is_repeated_until_answered_with_its_count() -> None:
    async def main(bench: Bench) -> None:
        asyncio.get_running_loop().call_later(1.2, bench.ack, 0, ARM)
        await bench.commands.command(0, ARM, (1.0,), bench.may_leave)
        assert [time_s for time_s, *_ in bench.sent] == pytest.approx([0.0, ANSWER_S, 2 * ANSWER_S])
        assert [int(message["confirmation"][0]) for *_, message in bench.sent] == [0, 1, 2]
        assert {int(message["target_system"][0]) for *_, message in bench.sent} == {11}
        assert not bench.commands.awaited

    run(main)


def test_only_the_same_vehicle_answers_the_same_command() -> None:
    async def main(bench: Bench) -> None:
        loop = asyncio.get_running_loop()
        loop.call_later(0.1, bench.ack, 1, ARM)
        loop.call_later(0.2, bench.ack, 0, ARM + 1)
        with pytest.raises(CommandError, match="TIMEOUT"):
            await bench.commands.command(0, ARM, (1.0,), bench.may_leave)
        assert len(bench.sent) == TRIES

    run(main)


@pytest.mark.parametrize("to", [(255, 190), (255, 0), (SYSTEM_ID, 191), (0, 191)])
def test_an_answer_to_another_sender_is_not_ours(to: tuple[int, int]) -> None:
    async def main(bench: Bench) -> None:
        loop = asyncio.get_running_loop()
        loop.call_later(0.1, bench.ack, 0, ARM, DENIED, to)
        loop.call_later(0.2, bench.ack, 0, ARM, 0, (SYSTEM_ID, COMPONENT_ID))
        await bench.commands.command(0, ARM, (1.0,), bench.may_leave)
        assert loop.time() == pytest.approx(0.2)

    run(main)


@pytest.mark.parametrize("to", [(SYSTEM_ID, COMPONENT_ID), (SYSTEM_ID, 0), (0, 0)])
def test_an_answer_to_us_or_to_an_unknown_sender_is_ours(to: tuple[int, int]) -> None:
    async def main(bench: Bench) -> None:
        asyncio.get_running_loop().call_later(0.1, bench.ack, 0, ARM, DENIED, to)
        with pytest.raises(CommandError, match="COMMAND_DENIED"):
            await bench.commands.command(0, ARM, (1.0,), bench.may_leave)

    run(main)


def test_a_value_sent_to_another_station_fails_no_setting() -> None:
    async def main(bench: Bench) -> None:
        loop = asyncio.get_running_loop()
        loop.call_later(0.1, bench.commands.take_value, 0, "COM_OF_LOSS_T", 1.0)
        loop.call_later(0.2, bench.commands.take_value, 0, "COM_OF_LOSS_T", 0.5)
        await bench.commands.set_parameter(0, "COM_OF_LOSS_T", 0.5, bench.may_leave)
        assert len(bench.sent) == 2

    run(main)


def test_a_refusal_has_a_name_and_progress_is_waited_for() -> None:
    async def main(bench: Bench) -> None:
        loop = asyncio.get_running_loop()
        loop.call_later(0.1, bench.ack, 0, ARM, IN_PROGRESS)
        loop.call_later(3.0, bench.ack, 0, ARM, DENIED)
        with pytest.raises(CommandError, match="COMMAND_DENIED"):
            await bench.commands.command(0, ARM, (1.0,), bench.may_leave)
        assert (len(bench.sent), loop.time()) == (1, 3.0)

    run(main)


def test_nothing_leaves_after_a_kill_and_waiting_ends_at_once() -> None:
    async def main(bench: Bench) -> None:
        waiting = asyncio.create_task(bench.commands.command(0, ARM, (1.0,), bench.may_leave))
        other = asyncio.create_task(bench.commands.command(1, ARM, (1.0,), bench.may_leave))
        await asyncio.sleep(0.1)
        bench.open = False
        assert bench.commands.fail(lambda row: row == 0, "killed meanwhile") == 1
        bench.ack(1, ARM)
        await other
        with pytest.raises(CommandError, match="killed meanwhile"):
            await waiting
        with pytest.raises(CommandError, match="killed meanwhile"):
            await bench.commands.command(0, ARM, (1.0,), bench.may_leave)
        assert len(bench.sent) == 2

    run(main)


def test_parameter_is_set_by_type_and_confirmed_by_readback() -> None:
    async def main(bench: Bench) -> None:
        whole = float(np.array([5], np.int32).view(np.float32)[0])
        loop = asyncio.get_running_loop()
        loop.call_later(0.1, bench.commands.take_value, 0, "COM_OBL_RC_ACT", 5)
        await bench.commands.set_parameter(0, "COM_OBL_RC_ACT", 5, bench.may_leave)
        (_, _, message), *_ = bench.sent
        assert (int(message["param_type"][0]), float(message["param_value"][0])) == (6, whole)
        loop.call_later(0.1, bench.commands.take_value, 0, "COM_OF_LOSS_T", 0.3)
        assert await bench.commands.get_parameter(0, "COM_OF_LOSS_T", bench.may_leave) == pytest.approx(0.3)
        loop.call_later(0.1, bench.commands.take_value, 0, "COM_OF_LOSS_T", 1.0)
        with pytest.raises(CommandError, match="reports 1"):
            await bench.commands.set_parameter(0, "COM_OF_LOSS_T", 0.5, bench.may_leave)

    run(main)


def test_closing_ends_waiting_commands() -> None:
    async def main(bench: Bench) -> None:
        waiting = asyncio.create_task(bench.commands.get_parameter(0, "ANY", bench.may_leave))
        await asyncio.sleep(0.1)
        bench.commands.close()
        with pytest.raises(CommandError, match="closed"):
            await waiting

    run(main)
