"""Signatures on the wire: nothing unsigned comes in, nothing leaves without."""

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as dialect

from gcs.links.settings import Forward
from gcs.links.signing import Signing
from tests.support.link_bench import until
from tests.support.wire_bench import a_socket, arrived, beat, bench, command

KEY = bytes(range(32))


@pytest.fixture
def signing(tmp_path: Path) -> Iterator[Signing]:
    file = tmp_path / "key"
    file.write_bytes(KEY)
    file.chmod(0o600)
    made = Signing(file, 5)
    made.open()
    yield made
    made.close()


def a_packer(system_id: int, key: bytes = KEY) -> Any:
    packer = dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)
    packer.signing.secret_key = key
    packer.signing.sign_outgoing = True
    packer.signing.timestamp = int((1_790_000_000 - 1_420_070_400) * 1e5)
    return packer


def signed_beat(packer: Any) -> bytes:
    return bytes(dialect.MAVLink_heartbeat_message(2, 12, 0x81, 6 << 16, 4, 3).pack(packer))


def test_only_signed_frames_pass_and_each_refusal_logs_once(
    signing: Signing, caplog: pytest.LogCaptureFixture
) -> None:
    signing.signer.begin(0)

    async def main() -> None:
        async with bench(1, 2, signing=signing) as made:
            with a_socket() as vehicle:
                ground = ("127.0.0.1", made.port)
                packer = a_packer(1)
                packer.signing.timestamp = signing.signer.time
                good = signed_beat(packer)
                radio = dialect.MAVLink_radio_status_message(1, 1, 1, 1, 1, 1, 1)
                for data in (
                    beat(1),
                    beat(1),
                    signed_beat(a_packer(1, bytes(32))),
                    good,
                    good,
                    beat(2),
                    beat(9),
                    bytes(radio.pack(dialect.MAVLink(None, srcSystem=1, srcComponent=68))),
                ):
                    vehicle.sendto(data, ground)
                await until(lambda: made.counters.strangers == 1)
                await asyncio.sleep(0.05)
                counters = made.counters
                assert [frame.raw for frame in made.delivered] == [good]
                assert (counters.unsigned, counters.wrongly_signed, counters.replayed) == (3, 1, 1)
                made.send(command(1))
                receiver = a_packer(255)
                (message,) = receiver.parse_buffer(await arrived(vehicle))
                assert message.get_signed()
                made.link._send_kill(0)
                (message,) = receiver.parse_buffer(await arrived(vehicle))
                assert message.get_signed()
        causes = [vars(each)["cause"] for each in caplog.records if each.msg == "signature_refused"]
        assert sorted(causes) == ["replayed", "unsigned", "unsigned", "wrong"], "of one read, unsigned first"

    asyncio.run(main())


def test_another_station_must_sign_too(signing: Signing) -> None:
    async def main() -> None:
        with a_socket() as vehicle, a_socket() as station:
            forward = Forward(url=f"udp://127.0.0.1:{station.getsockname()[1]}", read_only=False)
            async with bench(1, signing=signing, forward=[forward]) as made:
                packer = a_packer(1)
                packer.signing.timestamp = signing.signer.time
                vehicle.sendto(signed_beat(packer), ("127.0.0.1", made.port))
                async with asyncio.timeout(120):
                    _, address = await asyncio.get_running_loop().sock_recvfrom(station, 2048)
                ground = ("127.0.0.1", address[1])
                station.sendto(command(1), ground)
                await until(lambda: made.counters.refused_from_others == 1)
                other = a_packer(255)
                other.signing.timestamp = signing.signer.time
                given = dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
                raw = bytes(given.pack(other))
                station.sendto(raw, ground)
                assert await arrived(vehicle) == raw, "signed by whoever sent it"

    asyncio.run(main())
