"""What is left out for a thousand vehicles a tick changes nothing that anybody sees."""

import asyncio
import time
from copy import deepcopy
from itertools import product

import numpy as np
import pytest

from gcs.config.schema import find, load
from gcs.flight.state.vehicle import Vehicle, VehicleStatus
from gcs.links.command_protocol import CommandProtocol
from gcs.links.link_set import SetpointRouting
from gcs.links.sender import SetpointBatch
from gcs.model.lifecycle import Phase
from gcs.model.state import Landed, Mode, Setpoints
from gcs.service import Latest
from tests.support.silent_link import SilentLink

OURS = (frozenset[Mode](), frozenset({Mode.OFFBOARD}), frozenset({Mode.TAKEOFF, Mode.HOLD}))


@pytest.mark.parametrize("modes", OURS)
def test_calm_vehicle_has_telemetry_that_changes_nothing(modes: frozenset[Mode]) -> None:
    for phase, mode, armed, landed in product(Phase, Mode, (True, False), Landed):
        vehicle = Vehicle("a", 0, 1, "one", phase=phase, modes=modes)
        if vehicle.is_calm(mode, armed=armed) and not (phase is Phase.STANDBY and armed):
            before = deepcopy(vehicle.phase)
            assert not vehicle.observe(VehicleStatus(False, mode, armed, landed))
            assert vehicle.phase is before


def test_batch_is_split_among_links_without_mixing() -> None:
    shares = SetpointRouting([SilentLink(("a", "c")), SilentLink(("b",)), SilentLink(("d",))])
    for ids in (("a", "b", "c"), ("b", "c"), ("b", "c"), ()):
        batch = Setpoints(1.0, ids, np.arange(3.0 * len(ids)).reshape(-1, 3), np.arange(float(len(ids))))
        parts = shares.of(batch)
        assert [part.ids for part in parts] == [
            tuple(name for name in ids if name in of) for of in ("ac", "b", "d")
        ]
        for part in parts:
            rows = [ids.index(name) for name in part.ids]
            assert part.yaw_rad.tolist() == rows
            assert part.velocity_m_s.tolist() == batch.velocity_m_s[rows].tolist()


class NotingLink(SilentLink):
    """Open and connected; notes the order in which setpoints leave."""

    def __init__(
        self, ids: tuple[str, ...], now_s: float, arrived_s: tuple[float, ...], left: list[str]
    ) -> None:
        super().__init__(ids)
        self._protocol = CommandProtocol(self._vehicles, self._latch, self._clock)
        self._telemetry.life_time_s[:] = self._telemetry.heartbeat_time_s[:] = now_s
        self._telemetry.position_time_s[:] = np.add(now_s, arrived_s)
        self._snapshot_before_s = now_s - 1.0
        self._left = left

    def _send_setpoints(self, desired: SetpointBatch) -> None:
        self._left += [self.ids[row] for row in desired.rows.tolist()]


def test_setpoints_for_the_oldest_samples_leave_first() -> None:
    left: list[str] = []
    now_s = time.monotonic()
    north = NotingLink(("a", "b", "c", "d"), now_s, (-0.01, -0.03, -2.0, -0.02), left)
    south = NotingLink(("e", "f", "g", "h"), now_s, (-0.05, -0.04, -0.008, -0.009), left)
    links = SetpointRouting([north, south])
    ids = (*north.ids, *south.ids)
    links.send(Setpoints(time.monotonic(), ids, np.zeros((8, 3)), np.zeros(8)))
    assert left == ["e", "f", "b", "d", "a", "c", "h", "g"]  # c has no new sample
    left.clear()
    links.send(Setpoints(time.monotonic(), ("b",), np.zeros((1, 3)), np.zeros(1)))
    assert left == ["b"]
    left.clear()
    links.send(Setpoints(time.monotonic(), (), np.zeros((0, 3)), np.zeros(0)))
    assert left == []


def test_lazy_value_is_computed_once_on_first_use() -> None:
    made: list[int] = []

    def make() -> int:
        made.append(1)
        return 7

    async def main() -> None:
        latest = Latest(0)
        values = latest.values()
        assert await anext(values) == 0
        latest.promise(make)
        assert made == []
        assert [await anext(values), latest.value, latest.value] == [7, 7, 7]
        assert made == [1]
        latest.promise(make)
        latest.promise(lambda: 3)
        assert (latest.value, made) == (3, [1])

    asyncio.run(main())


def test_a_thousand_vehicles_in_four_namespaces_have_own_names() -> None:
    config = load(find("large"))
    assert len(config.ids) == 1000
    assert config.ids[:2] == ("a1", "a2")
    assert config.ids[-1] == "d250"
