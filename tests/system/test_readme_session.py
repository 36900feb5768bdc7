"""The README's session, command by command as it stands there, against processes of their own."""

import json
import re
import shlex
import signal
from pathlib import Path

import httpx

from tests.support.processes import SOON_S, last_truths, session_of, wait_until

README = Path(__file__).parents[2] / "README.md"


def session() -> list[tuple[str, str, object]]:
    """Method, path and body of every curl command in the README's session."""
    block = re.search(r"```sh\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert block is not None
    commands = []
    for line in block[1].splitlines():
        words = shlex.split(line, comments=True)
        if words[:1] != ["curl"]:
            continue
        method = words[words.index("-X") + 1] if "-X" in words else "GET"
        body = json.loads(words[words.index("-d") + 1]) if "-d" in words else None
        (path,) = (word.removeprefix("$api") for word in words if word.startswith("$api"))
        commands.append((method, path, body))
    return commands


def open_api(address: str) -> httpx.Client:
    return httpx.Client(base_url=f"{address}/api/v1", timeout=30.0)


def test_readme_sets_parameters_before_the_service_runs() -> None:
    text = README.read_text(encoding="utf-8")
    apply = text.index("gcs params apply --config configs/px4-sitl.yaml")
    assert text.index("gcs sim --count 4 --ports px4") < apply
    assert apply < text.index("gcs serve --config configs/px4-sitl.yaml")


def test_the_readme_session_flies(tmp_path: Path) -> None:
    commands = session()
    assert [command[:2] for command in commands][-1] == ("POST", "/show/stop")
    flown = session_of("px4-sitl", tmp_path, "--count", "4", height_m=20.0)
    with flown as (address, service), open_api(address) as api:

        def phase() -> str:
            return str(api.get("/show").json()["phase"])

        def grown() -> bool:
            return abs(float(api.get("/formation").json()["radius_now_m"]) - 12.0) < 0.1

        def ready() -> int:
            return sum(vehicle["ready"] for vehicle in api.get("/vehicles").json())

        wait_until("four ready", SOON_S, lambda: ready() == 4)
        for method, path, body in commands:
            answer = api.request(method, path, json=body)
            assert answer.is_success, f"{method} {path}: {answer.text}"
            if path == "/show/start":
                wait_until("running", SOON_S, lambda: phase() == "running")
            if path == "/target":
                wait_until("12 m", SOON_S, grown)
        outcomes = api.get("/commands/o1").json()["outcomes"]
        assert [outcomes[f"d{i}"]["outcome"] for i in range(1, 6)] == ["done"] * 4 + ["not-included"]
        assert any(vehicle["armed"] for vehicle in api.get("/vehicles").json())
        service.send_signal(signal.SIGINT)
        assert service.wait(2 * SOON_S) == 0
        for vehicle in last_truths(tmp_path / "truth.jsonl"):
            assert vehicle["landed"], "whoever stops the service on the way home waits for the landing"
            assert not vehicle["armed"]
