import numpy as np
import pytest

from gcs.links.mavsdk.link import MavsdkLink
from gcs.links.settings import Listen
from gcs.model.errors import InvalidError
from gcs.model.frames import ShowFrame
from gcs.model.state import Setpoints

LISTEN = Listen("127.0.0.1", 14540)
FRAME = ShowFrame(47.4, 8.5, 500.0)


@pytest.mark.parametrize("system_id", [0, -1, 251])
def test_impossible_system_id_is_refused(system_id: int) -> None:
    with pytest.raises(InvalidError, match=r"vehicles\.a"):
        MavsdkLink("one", {"a": system_id}, LISTEN, FRAME)


def test_two_vehicles_with_one_system_id_are_refused() -> None:
    with pytest.raises(InvalidError, match=r"vehicles\.b = 3.*a has it"):
        MavsdkLink("one", {"a": 3, "b": 3}, LISTEN, FRAME)


@pytest.mark.parametrize("setpoint_timeout_s", [0.0, -1.0, float("nan")])
def test_setpoint_watchdog_without_a_time_is_refused(setpoint_timeout_s: float) -> None:
    with pytest.raises(InvalidError, match="setpoint_timeout_s"):
        MavsdkLink("one", {"a": 3}, LISTEN, FRAME, setpoint_timeout_s=setpoint_timeout_s)


def test_closed_link_accepts_setpoints_and_sends_none() -> None:
    link = MavsdkLink("one", {"a": 3}, LISTEN, FRAME)
    link.send(Setpoints(0.0, ("a", "stranger"), np.zeros((2, 3)), np.zeros(2)))
    assert (link.name, link.ids, link.setpoints_sent) == ("one", ("a",), 0)
    assert link.conflicts == {}
    assert link.snapshot().ids == ("a",)
