"""The service is stopped for seconds while it flies, as a swapping machine stops it, and goes on."""

import os
import signal
from pathlib import Path
from time import sleep

import pytest

from gcs.config.schema import Config
from gcs.model.errors import RefusedError
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, flying_config, last_truths, proper, service, vehicles, wait_until

COUNT = 3
LOSS_S = 2.5
"""Without setpoints for so long the vehicles hold by their own failsafe."""

STOPPED_S = 6.0


def config_of(port_base: int) -> Config:
    return flying_config(COUNT, port_base, silence_s=20.0, setpoint_loss_s=LOSS_S)


@pytest.mark.soak
def test_stopped_service_reports_losses_and_one_command_returns(tmp_path: Path) -> None:
    base = free_ports(COUNT)
    config = config_of(base)
    with (
        vehicles(COUNT, base, tmp_path, *proper(config), "--noise", "0"),
        service(config, tmp_path / "service") as (client, process),
    ):
        wait_until("ready", SOON_S, lambda: all(vehicle.ready for vehicle in client.vehicles()))
        client.start()
        wait_until("running", SOON_S, lambda: client.show().phase == "running")
        os.kill(process.pid, signal.SIGSTOP)
        sleep(STOPPED_S)
        os.kill(process.pid, signal.SIGCONT)
        wait_until("uncontrolled", SOON_S, lambda: client.show().phase == "uncontrolled")
        fleet = client.fleet()
        assert (fleet.counts.airborne, fleet.counts.uncontrolled) == (COUNT, COUNT)
        assert fleet.show.reason.startswith(
            "3 vehicles airborne, not under this station's control: the service"
        )
        assert "stalled for" in fleet.show.reason
        assert {"pause", "stop", "abort"} <= set(fleet.show.possible)
        assert fleet.interrupted is not None
        assert set(fleet.interrupted.offers) == {"take-over", "bring-home"}
        with pytest.raises(RefusedError, match="a start needs all vehicles on the ground"):
            client.start()
        command = client.wait_for(client.stop().id, SOON_S)
        assert {part.outcome for part in command.outcomes.values()} == {"done"}
        wait_until("landed", SOON_S, lambda: client.show().phase == "landed")
        assert client.fleet().counts.airborne == 0
    assert [(truth["landed"], truth["armed"]) for truth in last_truths(tmp_path / "truth.jsonl")] == [
        (True, False)
    ] * COUNT
