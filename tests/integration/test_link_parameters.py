"""Parameters through the production links, with the fake autopilot as its own process on the other side."""

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from gcs.links.autopilots.versions import Version
from gcs.model.errors import CommandError, UnknownError
from tests.support.link_bench import AnyLink, a_link, is_open, running, until
from tests.support.machine import free_ports
from tests.support.started import DEVNULL, Started

pytestmark = pytest.mark.usefixtures("transport")


@contextmanager
def simulator(first_port: int) -> Iterator[None]:
    words = ("--count", "2", "--port-base", str(first_port), "--quirk", "late-ready=off")
    process = Started("gcs.sim", *words, "--param", "MPC_XY_VEL_MAX=7.5", stdout=DEVNULL)
    try:
        yield
    finally:
        process.terminate()
        process.wait(60)


def with_two(story: Callable[[AnyLink], Awaitable[None]]) -> None:
    async def main(link: AnyLink) -> None:
        async with running(link):
            await until(lambda: np.isfinite(link.snapshot().heartbeat_time_s).all())
            await story(link)

    port = free_ports(2)
    with simulator(port):
        asyncio.run(main(a_link(port, [1, 2], port_count=2)))


def test_integer_and_float_parameters_reach_only_their_vehicle() -> None:
    async def story(link: AnyLink) -> None:
        names = ("COM_OBL_RC_ACT", "MPC_XY_VEL_MAX")
        assert dict(await link.read_parameters("v1", names)) == {names[0]: 0, names[1]: 7.5}
        await link.set_parameter("v1", "COM_OBL_RC_ACT", 5)
        await link.set_parameter("v1", "MPC_XY_VEL_MAX", 9.25)
        read = await link.read_parameters("v1", names)
        assert dict(read) == {names[0]: 5, names[1]: 9.25}
        assert [type(value) for value in read.values()] == [int, float]
        assert dict(await link.read_parameters("v2", names)) == {names[0]: 0, names[1]: 7.5}

    with_two(story)


def test_parameter_that_cannot_be_read_or_set_gives_a_reason() -> None:
    async def story(link: AnyLink) -> None:
        async def unread() -> None:
            nothing_such = r"v1: parameter NO_SUCH: no answer; there is no such parameter"
            with pytest.raises(CommandError, match=nothing_such):
                await link.read_parameters("v1", ("NO_SUCH",))

        async def unset() -> None:
            with pytest.raises(CommandError, match="v2: parameter NO_SUCH: "):
                await link.set_parameter("v2", "NO_SUCH", 1)
            with pytest.raises(CommandError, match="v2: parameter COM_OBL_RC_ACT: "):
                await link.set_parameter("v2", "COM_OBL_RC_ACT", 0.5)  # it is a whole number

        await asyncio.gather(unread(), unset())  # each waits in vain for an answer
        with pytest.raises(UnknownError, match="v9 is not on link bench"):
            await link.read_parameters("v9", ("COM_OBL_RC_ACT",))

    with_two(story)


def test_closed_link_and_unknown_vehicle_are_reported() -> None:
    async def main() -> None:
        link = a_link(free_ports(1), [1])
        with pytest.raises(CommandError, match="v1: its parameters cannot be read: link bench is not open"):
            await link.read_parameters("v1", ("COM_OBL_RC_ACT",))
        async with running(link):
            await until(lambda: is_open(link))
            with pytest.raises(CommandError, match="v1: COM_OBL_RC_ACT cannot be set: never received"):
                await link.set_parameter("v1", "COM_OBL_RC_ACT", 5)

    asyncio.run(main())


def test_version_of_each_autopilot_is_received() -> None:
    async def story(link: AnyLink) -> None:
        await until(lambda: all(link.snapshot().version))
        assert [str(Version.of(each)) for each in link.snapshot().version] == ["1.16.1"] * 2

    with_two(story)
