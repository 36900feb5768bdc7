"""The flags beside a vehicle's phase change by a table and two rules."""

from dataclasses import asdict

import pytest

from gcs.flight.state.flags import KEPT, Flags
from gcs.model.lifecycle import Phase

ALL = Flags(*(True,) * 5)


@pytest.mark.parametrize("phase", Phase)
@pytest.mark.parametrize("before", Phase)
def test_a_change_keeps_only_what_the_table_keeps(before: Phase, phase: Phase) -> None:
    left = ALL.after(before, phase, only_link_lost=True)
    expected = {name for name, phases in KEPT.items() if phase in phases}
    assert {name for name, holds in asdict(left).items() if holds} == expected


@pytest.mark.parametrize("before", Phase)
def test_a_pilot_is_in_control_unless_only_the_link_was_lost(before: Phase) -> None:
    assert Flags().after(before, Phase.PILOT, only_link_lost=False).pilot_in_control
    assert not ALL.after(before, Phase.PILOT, only_link_lost=True).pilot_in_control


@pytest.mark.parametrize("phase", [Phase.LOST, Phase.PILOT])
def test_only_a_vehicle_of_the_formation_rejoins(phase: Phase) -> None:
    lost = Flags().after(Phase.FORMATION, phase, only_link_lost=True)
    assert lost.rejoins
    assert lost.after(phase, Phase.LOST, only_link_lost=True).rejoins
    assert not lost.after(phase, Phase.HOLD, only_link_lost=True).rejoins
    assert not Flags().after(Phase.RETURN, phase, only_link_lost=True).rejoins
