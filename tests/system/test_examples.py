"""The programs in docs/examples, one after the other against one station with the fake fleet."""

import runpy
import signal
import sys
from pathlib import Path

import pytest

from gcs.config.schema import Config
from tests.support.machine import free_ports
from tests.support.processes import SOON_S, flying_config, proper, service, vehicles, wait_until

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
COUNT = 3


@pytest.mark.soak
def test_the_examples_run_against_one_station(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def output_of(name: str, argument: str) -> str:
        """What the program `name` prints."""
        monkeypatch.setattr(sys, "argv", [name, argument])
        runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
        return capsys.readouterr().out

    port_base, port = free_ports(COUNT), free_ports(2)
    flown = flying_config(COUNT, port_base, silence_s=5.0)
    higher = {"formation": {"radius_m": 15.0, "height_m": 20.0}}  # an example makes the radius 14 m
    config = Config.model_validate(flown.model_dump() | higher | {"api": {"port": port}})
    url, folder = f"http://127.0.0.1:{port}", tmp_path / "record"
    run = {path.stem for path in EXAMPLES.glob("*.py")} - {"formation_env"}  # it needs no station
    with vehicles(COUNT, port_base, tmp_path, *proper(config)), service(config, folder) as (client, process):
        wait_until("ready", SOON_S, lambda: all(each.ready for each in client.vehicles()))

        assert "start done d1 d2 d3" in output_of("hello_formation", url)
        assert client.formation().radius_m == 14.0

        assert output_of("orbit_moving_target", url).count("target at") == 3
        assert client.orbit().direction == "clockwise"
        assert client.target().velocity_y_m_s == 0.5

        assert "at 60.0 0.0 m, 40.0 m high" in output_of("add_obstacle", url)
        assert client.obstacles() == []

        wait_until("assembled", SOON_S, lambda: client.show().phase == "running")
        lines = output_of("watch_stream", url).splitlines()
        assert len(lines) == 5
        assert all("running" in line and "'d3': 'formation'" in line for line in lines)

        for _ in range(2):  # the second one does not wait for the landing
            process.send_signal(signal.SIGINT)
        process.wait(SOON_S)
        (flight,) = folder.glob("*/flight.mcap")
        figures = output_of("analyse_record", str(flight))
        assert "closest pair" in figures
    assert run == {"hello_formation", "orbit_moving_target", "add_obstacle", "watch_stream", "analyse_record"}
