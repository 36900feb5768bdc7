"""What a source lacks: each reason once, and none beside fixes."""

import asyncio
from collections.abc import Iterable

import async_solipsism

from gcs.links.targets.cot import CotStream
from gcs.links.targets.gpsd import GpsdStream
from gcs.links.targets.receive import FIXES_MAX, TargetStream, _Reports
from gcs.model.target_fix import TargetFix
from tests.support.target_bytes import cot, tpv

SKY = b'{"class":"SKY","device":"/dev/ttyUSB0","satellites":[{"PRN":1}]}\r\n'


def reasons(
    stream: TargetStream, pieces: Iterable[tuple[float, bytes]]
) -> tuple[list[tuple[float, str]], int]:
    """When and what is reported of pieces that arrive at virtual times, and how many fixes there were."""
    given: list[tuple[float, str]] = []
    fixes: list[TargetFix] = []

    async def main() -> None:
        clock = asyncio.get_running_loop().time
        begin_s = clock()
        reports = _Reports(fixes.append, lambda why: given.append((round(clock() - begin_s, 3), why)))
        feed = reports.begin(stream)
        for at_s, piece in pieces:
            await asyncio.sleep(begin_s + at_s - clock())
            feed(piece)

    with asyncio.Runner(loop_factory=async_solipsism.EventLoop) as runner:
        runner.run(main())
    return given, len(fixes)


def test_a_source_that_sends_no_place_is_named() -> None:
    given, _ = reasons(GpsdStream(), [(float(at), SKY) for at in range(20)])
    assert given == [(15.0, "no fix for 15 s")]


def test_a_reason_lasts_until_a_fix_and_is_given_once() -> None:
    lost = [(float(at), tpv(mode=1) if at % 2 else SKY) for at in range(1, 20)]
    given, count = reasons(GpsdStream(), [*lost, (20.0, tpv())])
    assert given == [(1.0, "no fix: mode 1 of /dev/ttyUSB0"), (20.0, "")]
    assert count == 1


def test_beside_fixes_nothing_else_is_said() -> None:
    pieces = [(0.5 * at, cot() if at % 2 else cot()[:-9] + b"</event>") for at in range(1, 20)]
    assert reasons(CotStream("BOAT"), pieces) == ([], 10)
    silent = [
        (1.0, cot()),
        (2.9, cot("X2", "OTHER")),
        (4.0, b"<event x></event>" * 9),
        (17.0, cot("X2", "OTHER")),
    ]
    given, _ = reasons(CotStream("BOAT"), silent)
    assert given == [(17.0, "no fix for 15 s")], "others of the network go on"


def test_of_many_fixes_at_once_the_newest_are_given() -> None:
    every = b"".join(tpv(time=f"2026-11-29T12:{at:02d}:00Z") for at in range(60))
    assert reasons(GpsdStream(), [(0.0, every)]) == ([], FIXES_MAX)
