"""The Python client against the server, over real TCP."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from gcs.api.app import create_app
from gcs.client import Client
from gcs.model.errors import CommandError, GcsError, InvalidError, LinkError, RefusedError, UnknownError
from gcs.service import Outcome
from gcs.shows import load, shipped
from tests.support.api_background import in_background
from tests.support.api_fake_service import FakeService
from tests.support.show_files import FIGURES

pytestmark = pytest.mark.usefixtures("patient_api")

BOX: dict[str, Any] = {
    "x_m": 50.0,
    "y_m": 0.0,
    "half_length_x_m": 2.0,
    "half_length_y_m": 3.0,
    "height_m": 15.0,
}


@contextmanager
def client_of(service: FakeService) -> Iterator[Client]:
    """The synchronous client, with the server on a loop in another thread."""
    with (
        in_background(create_app(service)) as port,
        Client(f"http://127.0.0.1:{port}", timeout_s=30.0) as client,
    ):
        yield client


def is_healthy(service: FakeService, client: Client) -> bool:
    """Asked right after a tick: again when the machine stood still in between."""
    for _ in range(20):
        service.tick()
        with suppress(LinkError):
            return client.health().alive
    return False


def test_the_client_calls_everything() -> None:
    service = FakeService()
    with client_of(service) as client:
        assert is_healthy(service, client)
        assert client.fleet().origin.heading_deg == 90.0
        assert [each.id for each in client.vehicles()] == ["d1", "d2", "d3"]
        assert client.vehicle("d2").system_id == 2
        assert client.stations() == []
        service.join_site(("north", "south", "west"))
        service.lead = "south"
        service.tick()
        assert [each.name for each in client.stations() if each.leads] == ["south"]
        assert [each.name for each in client.take_lead() if each.leads] == ["north"]
        assert client.vehicle("d3").station == "west"
        service.join_site(())
        assert client.show().phase == "idle"
        assert list(client.start(["d1", "d2"]).outcomes) == ["d1", "d2"]
        service.fly()
        assert client.pause().action == "show pause"
        assert client.resume().action == "show resume"
        assert client.stop().action == "show stop"
        assert client.abort().action == "show abort"
        assert client.command("d1", "hold").outcomes["d1"].outcome == "pending"
        assert client.change_formation(radius_m=12.0, height_m=30.0).radius_m == 12.0
        assert client.formation().height_m == 30.0
        assert client.set_target(3.0, 4.0, velocity_x_m_s=0.5).velocity_east_m_s == pytest.approx(0.5)
        assert client.set_target_geodetic(47.3977, 8.5456).x_m == pytest.approx(0.0, abs=1e-6)
        assert client.target().velocity_x_m_s == 0.0
        assert client.change_orbit(radius_m=5.0, speed_m_s=1.0, direction="clockwise").speed_m_s == 1.0
        assert client.orbit().direction == "clockwise"
        assert client.change_yaw(policy="fixed", heading_deg=45.0).heading_deg == pytest.approx(45.0)
        assert client.yaw().policy == "fixed"
        made = client.add_obstacle(**BOX)
        assert client.add_obstacle(**BOX, obstacle_id="tower").id == "tower"
        assert client.change_obstacle("tower", **{**BOX, "height_m": 9.0}).height_m == 9.0
        assert client.obstacle("tower").height_m == 9.0
        assert [box.id for box in client.obstacles()] == [made.id, "tower"]
        client.remove_obstacle("tower")
        assert [box.id for box in service.plan.current.obstacles] == [made.id]


@pytest.mark.usefixtures("prompt_checks")
def test_client_uploads_checks_and_selects_shows(tmp_path: Path) -> None:
    service = FakeService(folder=tmp_path)
    lighthouse = next(path for path in shipped() if path.stem == "lighthouse")
    model = load(lighthouse).show
    with client_of(service) as client:
        shows = client.shows
        assert shows.upload("lighthouse", lighthouse).size_bytes == lighthouse.stat().st_size
        assert shows.upload("short", "about: nothing else").name == "short"
        assert [each.name for each in shows.stored()] == ["lighthouse", "short"]
        assert shows.text("short") == "about: nothing else"
        assert shows.check("short").state == "waiting"
        found = shows.wait_for_check("short", timeout_s=60)
        assert (found.state, found.good) == ("done", False)
        assert "origin" in " ".join(problem.text for problem in found.problems)
        shows.remove("short")
        with pytest.raises(UnknownError, match="no show 'short'"):
            shows.text("short")
        answer = {**FIGURES, "good": True, "problems": [], "model": model.model_dump(mode="json")}
        service.shows.found("lighthouse", lighthouse.read_bytes(), answer)
        with pytest.raises(RefusedError, match="was checked with the hash"):
            shows.select("lighthouse", "0" * 64)
        assert shows.select("lighthouse", model.digest).name == "lighthouse"
        assert shows.seek("up the tower").cue == "up the tower"
        ahead_s = time.time() + 60.0
        assert client.start(["d1"], show_hash=model.digest, at_unix_time_s=ahead_s).outcome == "pending"
        service.tick()
        assert client.show().start_unix_time_s == pytest.approx(ahead_s)
        service.reset()
        shows.deselect()
        assert client.show().selected is None


def test_client_waits_for_a_command_and_names_late_vehicles() -> None:
    service = FakeService()
    with client_of(service) as client:
        command = client.start()
        with pytest.raises(CommandError, match=r"show start not done after 0\.3 s by d1, d2, d3"):
            client.wait_for(command.id, timeout_s=0.3)
        timer = threading.Timer(0.3, service.finish, (command.id, Outcome.FAILED, "no GPS"))
        timer.start()
        ended = client.wait_for(command.id, timeout_s=30)
        timer.join()
        assert (ended.outcome, ended.outcomes["d1"].reason) == ("failed", "no GPS")


def test_the_client_raises_what_the_service_raised() -> None:
    service = FakeService()
    with client_of(service) as client:
        with pytest.raises(InvalidError) as small:
            client.change_formation(radius_m=1.0)
        assert (small.value.field, small.value.value) == ("radius_m", 1.0)
        assert small.value.allowed == "at least 5.2 m for 3 vehicles"
        with pytest.raises(InvalidError) as no_number:
            client.set_target(float("nan"), float("inf"))
        assert (no_number.value.field, no_number.value.value) == ("x_m", "NaN")
        assert "y_m = Infinity" in no_number.value.__notes__[0]
        with pytest.raises(RefusedError, match="not possible while the show is idle"):
            client.pause()
        with pytest.raises(UnknownError, match=r"d9/\.\./d1"):
            client.vehicle("d9/../d1")
        with pytest.raises(UnknownError):
            client.command("d1", "dance")
        service.control_alive = False
        service.tick()
        with pytest.raises(LinkError, match="no setpoints are sent"):
            client.health()
        with pytest.raises(GcsError, match="larger than") as large:
            client.start(["d1"] * 20_000)
        assert type(large.value) is GcsError


def test_client_reports_no_answer_or_another_program() -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    with Client(f"http://127.0.0.1:{port}") as client, pytest.raises(LinkError, match="no answer from"):
        client.fleet()


@pytest.mark.parametrize("answer", ["HTTP/1.1 404 Not Found", "HTTP/1.1 200 OK"])
@pytest.mark.parametrize("body", ["html", "\x1b" + "[" * 9999])
def test_client_refuses_another_service(answer: str, body: str) -> None:
    def other() -> None:
        connection, _ = listener.accept()
        with connection:
            connection.recv(65536)
            head = f"{answer}\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n"
            connection.sendall((head + body).encode())

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=other)
        thread.start()
        url = f"http://127.0.0.1:{listener.getsockname()[1]}"
        with (
            Client(url) as client,
            pytest.raises(LinkError, match=r"does not understand|not as this service"),
        ):
            client.fleet()
        thread.join(30)
    assert not thread.is_alive()
