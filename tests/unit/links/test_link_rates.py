import pytest
from pymavlink.dialects.v20 import common as dialect

from gcs.links.settings import StreamSettings
from gcs.links.stream_rates import Rates, desired
from gcs.links.telemetry import VehicleTelemetry
from gcs.mavlink.framing import split

DESIRED = {33: 20.0, 147: 0.5, 30: 0.0}
ALL = list(DESIRED.items())
(BEAT,) = split(
    bytes(dialect.MAVLink_heartbeat_message(2, 12, 1, 0, 4, 3).pack(dialect.MAVLink(None, 1, 1)))
).frames


class Vehicle:
    """Sends at some rates; time passes with `run`."""

    def __init__(self) -> None:
        self.telemetry = VehicleTelemetry()
        self.rates = Rates(DESIRED, [1])
        self.now_s = 100.0
        self.sends_hz = dict(DESIRED)
        self.speaks = True
        self._sent = dict.fromkeys(DESIRED, 0.0)

    def run(self, seconds: float) -> list[tuple[int, float]]:
        asked: list[tuple[int, float]] = []
        for _ in range(round(seconds / 0.05)):
            self.now_s += 0.05
            if self.speaks:
                self.telemetry.take(BEAT, self.now_s)
                for message_id, rate_hz in self.sends_hz.items():
                    self._sent[message_id] += rate_hz * 0.05
                    self.telemetry.counts[message_id] = int(self._sent[message_id])
            asked += self.rates.due(1, self.telemetry, self.now_s)
        return asked


def test_streams_are_requested_once_after_the_first_message() -> None:
    vehicle = Vehicle()
    vehicle.speaks = False
    assert vehicle.run(10.0) == []
    vehicle.speaks = True
    assert vehicle.run(300.0) == ALL


def test_restart_or_silence_requests_streams_again() -> None:
    vehicle = Vehicle()
    assert vehicle.run(2.0) == ALL
    vehicle.telemetry.connection_count += 1
    assert vehicle.run(2.0) == ALL
    vehicle.speaks = False
    vehicle.run(5.0)
    vehicle.speaks = True
    assert vehicle.run(2.0) == ALL


def test_unobserved_silence_is_noticed_afterwards() -> None:
    vehicle = Vehicle()
    assert vehicle.run(2.0) == ALL
    vehicle.now_s += 3.1  # nothing looked meanwhile
    assert vehicle.run(2.0) == ALL


@pytest.mark.parametrize(("message_id", "rate_hz"), [(33, 60.0), (33, 0.0), (30, 20.0)])
def test_wrong_rate_is_requested_again_at_growing_intervals(message_id: int, rate_hz: float) -> None:
    vehicle = Vehicle()
    vehicle.sends_hz[message_id] = rate_hz
    assert vehicle.run(2.0) == ALL
    again = vehicle.run(30.0)
    assert set(again) == {(message_id, DESIRED[message_id])}
    assert 2 <= len(again) <= 4
    assert len(vehicle.run(600.0)) <= 12
    vehicle.sends_hz = dict(DESIRED)
    vehicle.run(130.0)
    assert vehicle.run(600.0) == []


def test_positions_are_requested_at_ten_hertz_by_default() -> None:
    assert desired(StreamSettings())[33] == 10.0
    assert desired(StreamSettings(position_hz=4.0))[33] == 4.0
    rates_hz = desired(StreamSettings(others_hz=2.0))
    assert (rates_hz[30], rates_hz[245], rates_hz[1]) == (2.0, 5.0, 2.0)


def test_reset_counter_stream_is_always_requested() -> None:
    assert desired(StreamSettings())[331] == 1.0
