"""Twenty vehicles behind one radio: set up, started and stopped by what a person types, over one UDP port."""

from pathlib import Path

import pytest

from gcs.client import Client
from tests.support.processes import SOON_S, last_truths, session_of, wait_until

COUNT = 20


@pytest.mark.soak
def test_twenty_behind_one_radio_are_set_up_flown_and_landed(tmp_path: Path) -> None:
    session = session_of("radio", tmp_path, "--count", str(COUNT), "--shared-port", height_m=23.0)
    with session as (address, _), Client(address, timeout_s=30.0) as client:

        def phases() -> set[str]:
            return {vehicle.phase for vehicle in client.vehicles()}

        wait_until("ready", SOON_S, lambda: all(vehicle.ready for vehicle in client.vehicles()))
        started = client.start()
        wait_until("all up", SOON_S, lambda: client.show().phase in {"assembling", "running"})
        assert phases() == {"formation"}
        outcomes = client.wait_for(started.id, SOON_S).outcomes
        assert [outcome.outcome for outcome in outcomes.values()] == ["done"] * COUNT
        stopped = client.wait_for(client.stop().id, SOON_S)
        assert stopped.outcome == "done"
        wait_until("landed", SOON_S, lambda: client.show().phase == "landed")
    truths = last_truths(tmp_path / "truth.jsonl")
    assert len(truths) == COUNT
    assert all(truth["landed"] and not truth["armed"] for truth in truths)
