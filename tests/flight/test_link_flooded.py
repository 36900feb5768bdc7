"""A stranger floods the link of vehicles in formation, in their names and otherwise: none leaves it."""

from collections.abc import Sequence
from itertools import cycle, islice

import numpy as np
import pytest

from gcs.links.endpoints.ports import Datagrams, host_number, source_of
from gcs.links.intake import TURN_S
from gcs.mavlink.kernels import LONGEST_FRAME
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service.alarms import AlarmCause
from gcs.testing.virtual_show import VirtualShow, fly, show_config
from tests.support.floods import FLOODS

pytestmark = pytest.mark.soak

COUNT, PER_S, FLOOD_S, NAMED_S = 6, 3000, 2.5, 2.0
KINDS = ("heartbeats", "texts", "beginnings", "cut")
STRANGER = source_of(host_number("192.0.2.9"), 4711, 0)


def arrive(show: VirtualShow, flood: Sequence[bytes]) -> None:
    length = np.array([len(datagram) for datagram in flood])
    data = np.frombuffer(bytearray(b"".join(bytes(LONGEST_FRAME) + each for each in flood)), np.uint8)
    start = np.cumsum(length + LONGEST_FRAME) - length
    source, time_s = np.full(len(flood), STRANGER), np.full(len(flood), show.now_s)
    show.link._inbox.take(Datagrams(data, start, length, source, time_s, LONGEST_FRAME))


def named(show: VirtualShow) -> bool:
    texts = [
        alarm.text for alarm in show.view.alarms if alarm.cause is AlarmCause.INPUT_FLOODED and alarm.lasts
    ]
    assert all(text.startswith("Input link ") and "from 192.0.2.9:4711" in text for text in texts)
    return bool(texts)


def test_a_flooded_link_loses_no_vehicle() -> None:
    async def story(show: VirtualShow) -> None:
        await show.start()
        await show.reach(ShowPhase.RUNNING)
        for kind in KINDS:
            flood = list(islice(cycle(FLOODS[kind](range(1, COUNT + 1))), round(PER_S * TURN_S)))
            began_s = show.now_s
            while show.now_s < began_s + FLOOD_S:
                arrive(show, flood)
                await show.wait(TURN_S)
                assert named(show) or show.now_s < began_s + NAMED_S
            track = show.track.between(began_s)
            for name in show.config.ids:
                assert set(track.phases(name)) == {Phase.FORMATION}, kind
                assert track.setpoints_per_s(name) > 19.0, kind
        await show.wait(4.0)
        assert not named(show)

    fly(story, show_config(COUNT))
