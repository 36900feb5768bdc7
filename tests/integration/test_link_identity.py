"""Both transports: a vehicle keeps its link when its port changes, and companions give it nothing."""

import asyncio
import logging
from typing import Any

import pytest
from pymavlink.dialects.v20 import common as dialect

from gcs.links import Verb
from gcs.model.state import Mode
from tests.support.link_bench import AnyLink, Ticks, a_link, do, ready, running, until
from tests.support.link_peer import Peer
from tests.support.machine import free_ports
from tests.support.wire_bench import a_socket

pytestmark = pytest.mark.usefixtures("transport")

CHANGES = 20
COMPANION = 191


def setpoints(peer: Peer) -> int:
    return len(peer.messages("SET_POSITION_TARGET_LOCAL_NED"))


def is_at(link: AnyLink, peer: Peer) -> bool:
    address = link.addresses.get("v1")
    return address is not None and address.port == peer.port


def test_setpoints_follow_a_port_that_changes_twenty_times(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        port = free_ports()
        link = a_link(port, [1])
        with Peer(port, 1) as peer:
            async with running(link):
                await ready(link)
                ticks = Ticks(link, "v1")
                async with ticks.running():
                    await do(link, Verb.ARM, "v1")
                    await ticks.offboard()
                    await asyncio.sleep(1.0)  # how often it sends is known by then: a change in the first
                    # 0.1 s is a duplicate, until the old port has been silent for 3 s
                    for _ in range(CHANGES):
                        peer.line.lose()
                        peer.line.restore()  # from another port, at once
                        await until(lambda: is_at(link, peer))
                        peer.received.clear()
                        await until(lambda: setpoints(peer) > 5)
                        assert link.conflicts == {}
                assert link.snapshot().mode == (Mode.OFFBOARD,)
        moved = [record for record in caplog.records if record.msg == "vehicle_moved"]
        assert len(moved) == CHANGES

    caplog.set_level(logging.INFO)
    asyncio.run(main())
    assert not [record for record in caplog.records if record.msg == "duplicate_system_id"]


def lies() -> list[Any]:
    """Messages of a component that would change a vehicle's state if they were believed."""
    return [
        dialect.MAVLink_heartbeat_message(18, 12, 0x81, 4 << 16 | 6 << 24, 6, 3),
        dialect.MAVLink_global_position_int_message(0, 480000000, 90000000, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_battery_status_message(0, 0, 0, 0, [3000] * 10, -1, -1, -1, 2),
        dialect.MAVLink_extended_sys_state_message(0, 2),
        dialect.MAVLink_command_ack_message(400, 4, 0, 0, 0, 0),
    ]


def test_a_companion_received_first_shuts_out_no_autopilot(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        port = free_ports()
        link = a_link(port, [1])
        packer = dialect.MAVLink(None, srcSystem=1, srcComponent=COMPANION)

        async def speak(sender: Any) -> None:
            while True:
                for message in lies():
                    sender.sendto(message.pack(packer), ("127.0.0.1", port))
                await asyncio.sleep(0.02)

        with a_socket() as sender:
            async with running(link):
                speaking = asyncio.create_task(speak(sender))
                await until(lambda: link.without_autopilot)
                with Peer(port, 1) as peer:
                    await ready(link)
                    await do(link, Verb.ARM, "v1")
                    newest = link.snapshot()
                    assert newest.latitude_deg == pytest.approx([47.4])
                    assert newest.battery_remaining == pytest.approx([0.8])
                    assert (newest.mode, peer.armed) == ((Mode.HOLD,), True)
                    assert (link.conflicts, link.without_autopilot) == ({}, {})
                    await do(link, Verb.DISARM, "v1")
                speaking.cancel()

    caplog.set_level(logging.INFO)
    asyncio.run(main())
    assert not [record for record in caplog.records if record.msg == "duplicate_system_id"]
