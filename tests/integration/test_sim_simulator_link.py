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
        pairs = [decoder.parse_buffer(second.recv(1000)) for _ in range(5)]
    truth = json.loads(file.read_text(encoding="utf-8").splitlines()[0])["vehicles"][1]
    for message, clock in pairs:
        assert clock.get_type() == "HIL_ACTUATOR_CONTROLS"
        assert message.time_usec == 0, "PX4 v1.16 leaves it empty"
        assert (message.get_type(), message.get_srcSystem()) == ("HIL_STATE_QUATERNION", 2)
        assert message.lat * 1e-7 == pytest.approx(truth["latitude_deg"], abs=2e-7)
        assert message.lon * 1e-7 == pytest.approx(truth["longitude_deg"], abs=2e-7)
        assert message.alt * 1e-3 == pytest.approx(truth["altitude_amsl_m"], abs=0.002)
    times_s = [clock.time_usec * 1e-6 for _, clock in pairs]
    assert [b - a for a, b in pairwise(times_s)] == pytest.approx([0.04] * 4, abs=0.011)
