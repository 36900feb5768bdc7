"""The simulator link of the fake fleet carries the true states, as PX4's SIH does."""

import json
from itertools import pairwise
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common

from tests.integration.test_sim_radio import ear, running
from tests.support.machine import free_ports


def test_the_simulator_link_carries_the_true_states(tmp_path: Path) -> None:
    base, file = free_ports(4), tmp_path / "truth.jsonl"
    options = ["--count", "2", "--port-base", str(base), "--spacing", "7", "--truth", str(file)]
    with ear(base + 3) as second, running(*options, "--simulator-link", str(base + 2)):
        decoder = common.MAVLink(None)
        messages = [decoder.parse_char(second.recv(1000)) for _ in range(5)]
    truth = json.loads(file.read_text(encoding="utf-8").splitlines()[0])["vehicles"][1]
    for message in messages:
        assert (message.get_type(), message.get_srcSystem()) == ("HIL_STATE_QUATERNION", 2)
        assert message.lat * 1e-7 == pytest.approx(truth["latitude_deg"], abs=2e-7)
        assert message.lon * 1e-7 == pytest.approx(truth["longitude_deg"], abs=2e-7)
        assert message.alt * 1e-3 == pytest.approx(truth["altitude_amsl_m"], abs=0.002)
    times_s = [message.time_usec * 1e-6 for message in messages]
    assert [b - a for a, b in pairwise(times_s)] == pytest.approx([0.04] * 4, abs=0.011)
