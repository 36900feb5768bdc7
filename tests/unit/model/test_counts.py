"""Where vehicles are counted: by the phase and by what the autopilot says of the ground."""

import math

import pytest

from gcs.model.lifecycle import AIRBORNE, Phase
from gcs.model.state import Counts, Landed, Whereabouts, counts_of, whereabouts

CONTROLLED, UNCONTROLLED, UNKNOWN, ON_GROUND, OFFLINE = Whereabouts


@pytest.mark.parametrize("phase", sorted(AIRBORNE))
def test_controlled_vehicle_is_airborne_only_above_the_ground(phase: Phase) -> None:
    def where(landed: Landed) -> Whereabouts:
        return whereabouts(phase, landed, armed=True, heartbeat_age_s=0.5)

    assert where(Landed.ON_GROUND) is ON_GROUND
    assert {where(landed) for landed in set(Landed) - {Landed.ON_GROUND}} == {CONTROLLED}


@pytest.mark.parametrize(
    ("phase", "landed", "armed", "age_s", "where"),
    [
        (Phase.OFFLINE, Landed.IN_AIR, True, math.inf, OFFLINE),
        (Phase.STANDBY, Landed.ON_GROUND, False, 0.5, ON_GROUND),
        (Phase.LOST, Landed.IN_AIR, True, 60.0, UNKNOWN),
        (Phase.PILOT, Landed.IN_AIR, True, 0.5, UNCONTROLLED),
        (Phase.PILOT, Landed.UNKNOWN, True, 0.5, UNCONTROLLED),
        (Phase.PILOT, Landed.ON_GROUND, True, 0.5, ON_GROUND),
        (Phase.KILLED, Landed.IN_AIR, True, 0.5, UNCONTROLLED),
        (Phase.KILLED, Landed.IN_AIR, False, 0.5, UNKNOWN),
        (Phase.KILLED, Landed.ON_GROUND, False, 0.5, ON_GROUND),
        (Phase.KILLED, Landed.ON_GROUND, False, 60.0, UNKNOWN),
    ],
)
def test_vehicle_not_under_control_counts_as_last_known(
    phase: Phase, landed: Landed, *, armed: bool, age_s: float, where: Whereabouts
) -> None:
    assert whereabouts(phase, landed, armed=armed, heartbeat_age_s=age_s) is where


def test_the_counts_add_up_to_the_fleet() -> None:
    phases = [Phase.FORMATION, Phase.TAKEOFF, Phase.LOST, Phase.PILOT, Phase.OFFLINE, Phase.STANDBY]
    landed = [Landed.IN_AIR, Landed.ON_GROUND, Landed.IN_AIR, Landed.IN_AIR, Landed.UNKNOWN, Landed.ON_GROUND]
    counts = counts_of(phases, landed, [True] * 6, [0.5] * 6)
    assert counts == Counts(controlled=1, uncontrolled=1, unknown=1, on_ground=2, offline=1)
    assert counts.airborne == 2
