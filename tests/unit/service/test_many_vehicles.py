"""What is left out for a thousand vehicles a tick changes nothing that anybody sees."""

import asyncio
from copy import deepcopy
from itertools import product

import numpy as np
import pytest

from gcs.config.schema import find, load
from gcs.flight.vehicle import Vehicle, VehicleStatus
from gcs.links.link_set import SetpointRouting
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
