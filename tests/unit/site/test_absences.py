"""Whether another station's process has ended, by when its connection closed."""

import pytest

from gcs.site.absences import Absences
from gcs.stations.site import Site, StationFleet
from gcs.stations.space_without_control import WithoutControl

TICK_S, RECEIVED_S = 0.1, 0.05


@pytest.mark.parametrize(
    ("closed_after_s", "ours_age_s", "late_s", "ended"),
    [
        (TICK_S, RECEIVED_S, 0.0, True),
        (3 * TICK_S, RECEIVED_S, 0.0, True),
        (10 * TICK_S, RECEIVED_S, 0.0, False),  # as over a cut bus
        (TICK_S, 0.9, 0.0, False),  # it does not receive this station, and may have closed the connection
        (TICK_S, RECEIVED_S, 0.6, False),  # this station stood still: when it closed is not known
    ],
)
def test_a_process_has_ended_if_its_connection_closes_at_once(
    closed_after_s: float, ours_age_s: float, late_s: float, ended: bool
) -> None:
    fleets = {name: StationFleet((name[0],), (1.0,)) for name in ("north", "south")}
    site = Site("north", fleets, WithoutControl())
    absences, south = Absences(site, ["south"], 0.45), site.stations["south"]
    for tick in range(5):
        south.arrived_s, south.ours_age_s = tick * TICK_S, ours_age_s
        absences.look({"south"}, tick * TICK_S)
    assert not absences.ended("south")
    newest_s = south.arrived_s + late_s
    for tick in range(1, 15):
        now_s = newest_s + tick * TICK_S
        absences.look({"south"} if tick * TICK_S < closed_after_s - 1e-6 else (), now_s)
    assert absences.ended("south") is ended
