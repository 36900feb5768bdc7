"""Junk on the bus must not take the place of a valid message."""

import pytest

from gcs.model.lifecycle import ShowPhase
from gcs.stations.messages import FormationMessage, SlotsMessage, VelocitiesMessage, encode_homes
from gcs.stations.recognition import may_be_valid
from tests.unit.stations.test_messages import batch

SITE = batch(3).head.site

VALID = {
    "states": batch(3).encode(),
    "formation": FormationMessage(SITE, 1, 0, 1, ShowPhase.RUNNING, None, 5.0, 0.0, {}).encode(),
    "slots.south": SlotsMessage(SITE, 1, 0, batch(3).position_m).encode(),
    "velocities.south": VelocitiesMessage(SITE, 1, 0, batch(3).velocity_m_s).encode(),
    "homes": encode_homes(batch(3).position_m),
    "letters.south": b"{}",
}


@pytest.mark.parametrize("topic", VALID)
def test_message_of_the_site_is_recognised_by_its_topic(topic: str) -> None:
    assert may_be_valid(topic, VALID[topic], SITE)
    of_others = {other: payload for other, payload in VALID.items() if other != topic}
    assert not [other for other, payload in of_others.items() if may_be_valid(topic, payload, SITE)]


@pytest.mark.parametrize("topic", [*VALID, "return.south.0", "weather", ""])
@pytest.mark.parametrize("junk", [b"", b"\x00", b"\xff" * 500, b"{", b"[]"])
def test_junk_is_not_recognised(topic: str, junk: bytes) -> None:
    assert not may_be_valid(topic, junk, SITE)


@pytest.mark.parametrize("topic", ["states", "formation", "slots.south", "velocities.south"])
def test_message_of_another_site_is_not_recognised(topic: str) -> None:
    assert not may_be_valid(topic, VALID[topic], SITE + 1)
