"""Tokens over real TCP and TLS: the stream, the client, the emergency lane."""

import asyncio
import json
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import pytest
import websockets
import yaml
from starlette.types import ASGIApp
from websockets.asyncio.client import connect
from websockets.typing import Subprotocol

from gcs.api.app import create_app
from gcs.api.auth.authorization import Authorization
from gcs.api.auth.middleware import EmergencyLane
from gcs.api.auth.tokens import Tokens, create_token, revoke_token
from gcs.api.server import serve
from gcs.cli.main import main
from gcs.client import Client
from gcs.config import schema as configuration
from gcs.model.errors import AccessError, ConfigError, LinkError
from gcs.model.lifecycle import ShowPhase
from gcs.service.access import Role, TlsSettings
from tests.support.api_fake_service import FakeService

pytestmark = pytest.mark.usefixtures("patient_api")

PEM = Path(__file__).parents[1] / "data" / "tls"
TLS = TlsSettings(certificate_file=PEM / "certificate.pem", key_file=PEM / "key.pem")


class Station:
    """A service with both listeners, and a token of each role."""

    def __init__(self, folder: Path) -> None:
        self.service = FakeService()
        self.file = folder / "tokens.json"
        self.token = {role: create_token(self.file, role.value, role) for role in Role}
        self.app = create_app(self.service, authorization=Authorization(Tokens(self.file)))
        self.port = self.lane_port = 0

    @asynccontextmanager
    async def serving(self, tls: TlsSettings | None = None) -> AsyncIterator[None]:
        loop = asyncio.get_running_loop()
        listening = [loop.create_future(), loop.create_future()]
        apps: list[ASGIApp] = [self.app, EmergencyLane(self.app, self.port)]
        tasks = [
            asyncio.create_task(serve(app, port=0, listening=ready, tls=tls))
            for app, ready in zip(apps, listening, strict=True)
        ]
        try:
            self.port, self.lane_port = await asyncio.wait_for(asyncio.gather(*listening), timeout=120)
            async with asyncio.timeout(240):
                yield
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.wait(tasks)


@pytest.fixture
def station(tmp_path: Path) -> Station:
    return Station(tmp_path)


def test_stream_accepts_a_token_as_header_or_subprotocol(station: Station) -> None:
    async def main() -> None:
        async with station.serving():
            url = f"ws://127.0.0.1:{station.port}/api/v1/stream"
            with pytest.raises(websockets.InvalidStatus) as refused:
                await connect(url)
            assert refused.value.response.status_code == 401
            assert "gcs token create" in json.loads(refused.value.response.body or b"")["detail"]
            token = station.token[Role.WATCH]
            async with connect(url, additional_headers={"Authorization": f"Bearer {token}"}) as viewer:
                assert json.loads(await viewer.recv())["access"] == "tokens"
            async with connect(
                url, subprotocols=[Subprotocol("gcs.v1"), Subprotocol(f"bearer.{token}")]
            ) as viewer:
                assert viewer.subprotocol == "gcs.v1"
                assert json.loads(await viewer.recv())["access"] == "tokens"

    asyncio.run(main())


def test_viewer_with_a_revoked_token_is_disconnected(station: Station) -> None:
    async def main() -> None:
        async with station.serving():
            url = f"ws://127.0.0.1:{station.port}/api/v1/stream?rate_hz=20"
            headers = {"Authorization": f"Bearer {station.token[Role.WATCH]}"}
            async with connect(url, additional_headers=headers) as viewer:
                revoke_token(station.file, "watch")
                with suppress(websockets.ConnectionClosed):
                    async for _ in viewer:  # those on their way
                        pass
                assert (viewer.close_code, viewer.close_reason) == (1008, "the token was revoked")

    asyncio.run(main())


def commands_over_the_lane(station: Station) -> None:
    url, lane = f"http://127.0.0.1:{station.port}", f"http://127.0.0.1:{station.lane_port}"
    with Client(lane, token=station.token[Role.EMERGENCY]) as client:
        assert client.stop().by == "emergency"
    with Client(url, token=station.token[Role.OPERATE], emergency_url=lane) as client:
        assert client.abort().by == "operate"
        assert client.fleet().access == "tokens"
    with Client(url, token=station.token[Role.EMERGENCY], emergency_url="http://127.0.0.1:9") as client:
        assert client.confirm_kill(client.arm_kill(["d1"]).code).outcomes.keys() == {"d1"}
    with Client(url, token=station.token[Role.WATCH], emergency_url=lane) as client:
        with pytest.raises(
            AccessError, match="watch may not: this needs a token of role operate or emergency"
        ):
            client.arm_kill(["d2"])
        with pytest.raises(AccessError, match="role operate"):
            client.start()
    with Client(url) as client, pytest.raises(AccessError, match="gcs token create"):
        client.fleet()


def test_client_sends_emergencies_on_their_lane(
    station: Station,
) -> None:
    async def main() -> None:
        async with station.serving():
            station.service.fly()
            await asyncio.to_thread(commands_over_the_lane, station)

    asyncio.run(main())
    assert station.service.show is ShowPhase.ABORTING


def over_tls(station: Station) -> str:
    url, token = f"https://127.0.0.1:{station.port}", station.token[Role.WATCH]
    with Client(url, token=token, ca_file=TLS.certificate_file) as client:
        phase = client.show().phase
    with Client(url, token=token) as client, pytest.raises(LinkError, match="certificate verify failed"):
        client.show()
    plain = Client(f"http://127.0.0.1:{station.port}", token=token)
    with plain as client, pytest.raises(LinkError, match="no answer"):
        client.show()
    return phase


def test_with_a_certificate_only_tls_is_served(station: Station) -> None:
    async def main() -> str:
        async with station.serving(TLS):
            return await asyncio.to_thread(over_tls, station)

    assert asyncio.run(main()) == "idle"


@pytest.mark.parametrize(
    ("certificate", "key", "stated"),
    [
        ("none.pem", "key.pem", "none.pem: there is no such file"),
        ("certificate.pem", "README.md", "no PEM certificate and its key"),
        ("key.pem", "certificate.pem", "no PEM certificate and its key"),
    ],
)
def test_invalid_certificate_is_reported_before_listening(
    station: Station, certificate: str, key: str, stated: str
) -> None:
    tls = TlsSettings(certificate_file=PEM / certificate, key_file=PEM / key)
    with pytest.raises(ConfigError, match=stated):
        asyncio.run(serve(station.app, port=0, tls=tls))


def test_invalid_trusted_certificates_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no PEM certificate"):
        Client(ca_file=tmp_path / "none.pem")


@pytest.mark.usefixtures("logging_restored")
@pytest.mark.parametrize("taken", ["port", "emergency_port"])
def test_serve_names_the_port_that_is_taken(
    taken: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        ports = {"port": 0, "emergency_port": 0, taken: other.getsockname()[1]}
        raw = yaml.safe_load(configuration.find("demo").read_text()) | {"api": ports}
        file = tmp_path / "config.yaml"
        file.write_text(yaml.safe_dump(raw))
        assert main(["serve", "--config", str(file), "--quiet"]) == 1
    assert f"api.{taken}: port {ports[taken]} is in use on 127.0.0.1" in capsys.readouterr().err


@pytest.mark.usefixtures("logging_restored")
@pytest.mark.parametrize(
    ("access", "stated"),
    [
        ({"tokens_file": "none.json"}, "none.json: the tokens cannot be read"),
        ({"tls": {"certificate_file": "none.pem", "key_file": "none.pem"}}, "access.tls: none.pem"),
    ],
)
def test_serve_names_the_file_that_is_missing(
    access: dict[str, object], stated: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    raw = yaml.safe_load(configuration.find("demo").read_text()) | {"access": access, "api": {"port": 0}}
    file = tmp_path / "config.yaml"
    file.write_text(yaml.safe_dump(raw))
    assert main(["serve", "--config", str(file), "--quiet"]) == 1
    assert stated in capsys.readouterr().err
