"""One of four vehicles reports a position kilometres away for a while: it is not led, the others fly on."""

import numpy as np
import pytest

from gcs.estimation.fleet_state import Table
from gcs.model.frames import ShowFrame
from gcs.model.plan import Formation
from gcs.model.state import Array, FleetState
from tests.support.control_flight import TICK_S, Flight, Sample, closest_m_and_violations
from tests.support.reported import reported

FRAME = ShowFrame(47.0, 8.0, 400.0)
IDS = ("d1", "d2", "d3", "d4")
JUMP_M = (5000.0, 0.0, 0.0)


class ReceivedFlight(Flight):
    """A flight that believes what a `Table` makes of the telemetry."""

    def __init__(self) -> None:
        self._table = Table(IDS, FRAME)
        self._received: FleetState | None = None
        self.jump_m = np.zeros((4, 3))
        super().__init__(4, Formation(8.0, 20.0))

    def receive(self) -> None:
        """Before every tick: the newest message of every vehicle."""
        latitude, longitude, altitude = FRAME.geodetic(self.bodies.position_m + self.jump_m)
        self._received = self._table.state(
            [
                reported(
                    IDS,
                    self.time_s,
                    latitude_deg=latitude,
                    longitude_deg=longitude,
                    altitude_amsl_m=altitude,
                    velocity_ned_m_s=self.bodies.velocity_m_s,
                )
            ],
            self.time_s,
        )
        self.age_s = self._received.age_s.copy()

    @property
    def believed_m(self) -> Array:
        """(n, 3) as the table says."""
        return super().believed_m if self._received is None else self._received.position_m

    @property
    def believed_m_s(self) -> Array:
        """(n, 3) as the table says."""
        return super().believed_m_s if self._received is None else self._received.velocity_m_s


@pytest.fixture(scope="module")
def describe() -> tuple[list[Sample], list[Sample], list[Sample]]:
    """Before, while and after the second of them is told to be 5 km away, for four seconds."""
    flight = ReceivedFlight()
    before = flight.run(15.0, flight.receive)
    flight.jump_m[1] = JUMP_M
    wrong = flight.run(4.0, flight.receive)
    flight.jump_m[1] = 0.0
    return before, wrong, flight.run(10.0, flight.receive)


def test_not_commanded_while_its_position_is_wrong(
    describe: tuple[list[Sample], list[Sample], list[Sample]],
) -> None:
    assert {sample.tick.setpoints.ids for sample in describe[1]} == {("d1", "d3", "d4")}


def test_other_vehicles_are_not_pulled_along(
    describe: tuple[list[Sample], list[Sample], list[Sample]],
) -> None:
    before, wrong, _ = describe
    assert np.linalg.norm(wrong[-1].center_m - before[-1].center_m) < 0.5
    for sample in wrong:
        off_m = np.linalg.norm(sample.position_m[[0, 2, 3]] - sample.center_m, axis=1)
        assert off_m.max() < 10.0
        assert sample.position_m[:, :2].max() < 20.0


def test_plausible_again_it_is_commanded_at_once(
    describe: tuple[list[Sample], list[Sample], list[Sample]],
) -> None:
    after = describe[2]
    assert all(sample.tick.setpoints.ids == IDS for sample in after)
    assert after[-1].time_s - after[0].time_s == pytest.approx(10.0 - TICK_S)
    radius_m = np.linalg.norm(after[-1].position_m - after[-1].center_m, axis=1)
    assert radius_m == pytest.approx(np.full(4, 8.0), abs=0.5)


def test_floor_holds_while_a_position_is_wrong(
    describe: tuple[list[Sample], list[Sample], list[Sample]],
) -> None:
    assert closest_m_and_violations([*describe[1], *describe[2]])[1] == 0
