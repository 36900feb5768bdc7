"""The README's session, pasted as it stands there, against processes of their own."""

import json
import os
import re
import signal
import subprocess
from pathlib import Path

import httpx

from gcs.config import schema as configuration
from tests.support.processes import SOON_S, last_truths, session_of

README = Path(__file__).parents[2] / "README.md"
SHIPPED_ADDRESS = "http://127.0.0.1:8000"


def session() -> str:
    """The README's two blocks of the third terminal."""
    first, stop = re.findall(r"```sh\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    return f"{first}{stop}"


def open_api(address: str) -> httpx.Client:
    return httpx.Client(base_url=f"{address}/api/v1", timeout=30.0)


def test_readme_sets_parameters_before_the_service_runs() -> None:
    text = README.read_text(encoding="utf-8")
    apply = text.index("gcs params apply --config configs/px4-sitl.yaml")
    assert text.index("gcs sim --count 4 --ports px4") < apply
    assert apply < text.index("gcs serve --config configs/px4-sitl.yaml")


def test_the_readme_session_flies_pasted_at_once(tmp_path: Path) -> None:
    config = configuration.load(configuration.find("px4-sitl"))
    assert len(config.ids) == 4  # as many as the README's fake fleet has
    flown = session_of("px4-sitl", tmp_path, "--count", "4", height_m=20.0)
    with flown as (address, service), open_api(address) as api:
        assert session().count(SHIPPED_ADDRESS) == 1
        pasted = subprocess.run(
            ["/bin/bash", "-e", "-c", session().replace(SHIPPED_ADDRESS, address)],
            cwd=README.parent,
            env={**os.environ, "GCS_URL": address},
            capture_output=True,
            timeout=2 * SOON_S,
            check=False,
            text=True,
        )
        assert pasted.returncode == 0, pasted.stdout + pasted.stderr
        answers = [json.loads(line) for line in pasted.stdout.splitlines() if line.startswith(("{", "["))]
        start, show, formation, orbit, target, tower, fleet, _, stop = answers
        assert "o1 start: done" in pasted.stdout
        assert (start["action"], start["outcome"]) == ("start", "pending")
        assert show["phase"] in {"assembling", "running"}
        assert (formation["radius_m"], orbit["radius_m"], target["velocity_x_m_s"]) == (12.0, 15.0, 0.5)
        assert (tower["x_m"], len(fleet["vehicles"]), stop["action"]) == (60.0, 4, "stop")
        assert all(vehicle["armed"] for vehicle in api.get("/vehicles").json())
        service.send_signal(signal.SIGINT)
        assert service.wait(2 * SOON_S) == 0
        for vehicle in last_truths(tmp_path / "truth.jsonl"):
            assert vehicle["landed"], "whoever stops the service on the way home waits for the landing"
            assert not vehicle["armed"]
