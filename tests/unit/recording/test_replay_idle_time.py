"""A replay jumps over the time in which nothing flies; in virtual time."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import async_solipsism
import pytest

from gcs.config import schema as configuration
from gcs.model.lifecycle import ShowPhase
from gcs.recording import mcap_layout as layout
from gcs.recording.audit import AuditTrail
from gcs.recording.audit_database import Journal
from gcs.recording.audit_reader import AUDIT
from gcs.recording.mcap_reader import FlightData
from gcs.recording.mcap_writer import _OpenFile
from gcs.recording.replay.service import Replay
from gcs.service.flight_marks import KEPT_S
from tests.support.record_samples import sample

BEGAN_S = 1.7e9 + 100.0
TAKES_OFF_S, LANDS_S, ENDS_S = 30.0, 40.0, 80.0


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half a minute on the ground, ten seconds in the air, forty on the ground."""
    folder = tmp_path_factory.mktemp("record") / "s1"
    folder.mkdir()
    about = layout.about(
        "s1",
        configuration.load(configuration.find("demo")).model_dump_json(),
        {
            "d1": (1, "a"),
            "d2": (2, "a"),
        },
    )
    made = _OpenFile(folder / "flight.mcap", about)
    for tick in range(round(ENDS_S * 5)):
        at_s = tick / 5
        show = ShowPhase.RUNNING if TAKES_OFF_S <= at_s < LANDS_S else ShowPhase.IDLE
        made.add(sample(time_s=100.0 + at_s, show=show))
        if tick % 20 == 19:
            made.flush()
    made.finish()
    journal = Journal(folder.parent / AUDIT)
    journal.open()
    audit = AuditTrail(journal, "s1", {"d1": (1, "a"), "d2": (2, "a")})
    audit.begin(folder, "{}")
    for at_s, was, phase in ((TAKES_OFF_S, "idle", "running"), (LANDS_S, "running", "landed")):
        audit.event(BEGAN_S + at_s, "info", "show_phase", None, {"was": was, "phase": phase, "reason": ""})
    journal.close()
    return made.path


def played(flight: Path, story: Callable[[Replay], Awaitable[None]]) -> list[float]:
    """Positions of every state that was shown."""
    seen_s: list[float] = []

    async def main() -> None:
        replay = Replay(FlightData(flight), 1.0)

        async def watch() -> None:
            async for view in replay.view.values():
                seen_s.append(view.unix_time_s - BEGAN_S)  # noqa: PERF401 - it never ends by itself

        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(replay.run()), group.create_task(watch())]
            await story(replay)
            for task in tasks:
                task.cancel()

    with asyncio.Runner(loop_factory=async_solipsism.EventLoop) as runner:
        runner.run(main())
    return seen_s


def test_idle_time_is_skipped_during_playback(flight: Path) -> None:
    async def story(replay: Replay) -> None:
        await asyncio.sleep(LANDS_S - TAKES_OFF_S + 2 * KEPT_S + 3.0)
        assert replay.playback.ended
        assert replay.playback.position_s == pytest.approx(ENDS_S, abs=0.3)

    seen_s = played(flight, story)
    begins_s, ends_s = TAKES_OFF_S - KEPT_S, LANDS_S + KEPT_S
    skipped = [at_s for at_s in seen_s if 0.3 < at_s < begins_s - 0.1 or ends_s + 0.3 < at_s < ENDS_S - 0.3]
    assert skipped == []
    assert len([at_s for at_s in seen_s if begins_s <= at_s <= ends_s]) > 70  # and what flies is all shown


def test_idle_time_can_be_played_on_request_or_by_seeking(flight: Path) -> None:
    async def story(replay: Replay) -> None:
        replay.change(paused=True, position_s=10.0)
        await asyncio.sleep(5.0)
        assert replay.playback.position_s == pytest.approx(10.0, abs=0.3)
        replay.change(skips_idle=False, paused=False)
        await asyncio.sleep(5.0)
        assert replay.playback.position_s == pytest.approx(15.0, abs=0.5)
        replay.change(skips_idle=True)
        await asyncio.sleep(1.0)
        assert replay.playback.position_s >= TAKES_OFF_S - KEPT_S

    played(flight, story)
