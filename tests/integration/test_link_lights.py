"""Colours over real UDP: the fake vehicles write what they received into their truth file."""

import asyncio
import time
from pathlib import Path

import numpy as np
import pytest

from gcs.links.features import LightSettings
from gcs.links.lights import LightSender
from gcs.links.mavsdk.link import MavsdkLink
from gcs.links.native.link import NativeLink
from gcs.links.settings import Listen
from gcs.mavlink.lights import LightDriver
from gcs.model.frames import ShowFrame
from tests.support.link_bench import AnyLink, Ticks, ready, running
from tests.support.machine import free_ports
from tests.support.processes import last_truths, vehicles

COUNT, RATE_HZ, LASTS_S = 12, 4.0, 5.0


def a_link(kind: type[AnyLink], port: int) -> AnyLink:
    vehicles = {f"d{system_id}": system_id for system_id in range(1, COUNT + 1)}
    place, frame = Listen("127.0.0.1", port, COUNT), ShowFrame(47.397742, 8.545594, 488.0)
    return kind("bench", vehicles, place, frame)


async def shine(link: AnyLink, driver: LightDriver) -> tuple[int, list[int]]:
    """Change every colour at 4 Hz beside setpoints. Returns: colours that left, the last ones as 0xRRGGBB."""
    sender = LightSender(LightSettings(driver=driver, rate_hz=RATE_HZ), link.outbox, link.budget)
    async with running(link):
        await ready(link)
        async with Ticks(link, *link.ids).running():
            began_s = time.monotonic()
            while (passed_s := time.monotonic() - began_s) < LASTS_S + 0.5:  # the last one for longer
                colour = np.full((COUNT, 3), int(min(passed_s, LASTS_S) * RATE_HZ) + 1, np.uint8)
                colour[:, 2] = np.arange(COUNT)
                if (reached := link.reached()) is not None:
                    sender.send(colour, reached[1], reached[0])
                await asyncio.sleep(0.05)
            await asyncio.sleep(0.3)
    return sender.sent, [int.from_bytes(bytes(each), "big") for each in colour]


@pytest.mark.keeps("NativeLink-led-control", "MavsdkLink-actuator")
@pytest.mark.parametrize("driver", [each for each in LightDriver if each is not LightDriver.NONE])
@pytest.mark.parametrize("kind", [NativeLink, MavsdkLink])
def test_fake_vehicles_show_the_colours_sent(
    kind: type[AnyLink], driver: LightDriver, tmp_path: Path
) -> None:
    with vehicles(COUNT, port := free_ports(COUNT), tmp_path):
        sent, last = asyncio.run(shine(a_link(kind, port), driver))
    truths = last_truths(tmp_path / "truth.jsonl")
    received = sum(int(str(each["lights_received"])) for each in truths)
    print(f"{kind.__name__} {driver}: {received} of {sent} received, {sent / COUNT / LASTS_S:.2f} Hz")  # noqa: T201
    assert received >= 0.95 * sent
    assert [int(str(each["light"])[1:], 16) for each in truths] == last
