"""The tables: what they name leads on, what they do not name is refused with a reason."""

import pytest

from gcs.model.errors import RefusedError
from gcs.model.lifecycle import (
    AIRBORNE,
    FLOWN,
    IN_THE_AIR,
    NEXT,
    SHOW_NEXT,
    Event,
    Phase,
    ShowEvent,
    ShowPhase,
    advance,
    advance_show,
)


@pytest.mark.parametrize("phase", Phase)
def test_vehicle_follows_the_table_or_names_allowed_phases(phase: Phase) -> None:
    for event in Event:
        if (phase, event) in NEXT:
            assert advance(phase, event) is NEXT[phase, event]
            continue
        with pytest.raises(RefusedError) as refused:
            advance(phase, event)
        text = str(refused.value)
        assert text.startswith(f"'{event}' is not possible while {phase}; it is from ")
        assert all(known.value in text for known, what in NEXT if what is event)


@pytest.mark.parametrize("phase", ShowPhase)
def test_show_follows_the_table_or_names_allowed_phases(phase: ShowPhase) -> None:
    for event in ShowEvent:
        if (phase, event) in SHOW_NEXT:
            assert advance_show(phase, event) is SHOW_NEXT[phase, event]
            continue
        with pytest.raises(RefusedError) as refused:
            advance_show(phase, event)
        text = str(refused.value)
        assert text.startswith(f"'{event}' is not possible while the show is {phase}; it is from ")
        assert all(known.value in text for known, what in SHOW_NEXT if what is event)


def test_an_ordinary_flight_leads_from_standby_back_to_standby() -> None:
    phase = Phase.OFFLINE
    way = [Event.CONNECTED, Event.TAKE_OFF, Event.HOLD, Event.ENGAGE, Event.COME_HOME, Event.DESCEND]
    for event in [*way, Event.TOUCHED_DOWN]:
        phase = advance(phase, event)
    assert phase is Phase.STANDBY


def test_ordinary_show_goes_from_idle_to_landed_and_again() -> None:
    phase = ShowPhase.IDLE
    way = [ShowEvent.START, ShowEvent.CHECKED, ShowEvent.ALL_UP, ShowEvent.ASSEMBLED, ShowEvent.PAUSE]
    for event in [*way, ShowEvent.RESUME, ShowEvent.STOP, ShowEvent.ALL_DOWN]:
        phase = advance_show(phase, event)
    assert phase is ShowPhase.LANDED
    assert advance_show(phase, ShowEvent.START) is ShowPhase.PREFLIGHT


@pytest.mark.parametrize("phase", sorted(AIRBORNE))
def test_silent_in_the_air_is_lost_and_taken_over_is_piloted(
    phase: Phase,
) -> None:
    assert advance(phase, Event.SILENT) is Phase.LOST
    assert advance(phase, Event.TAKEN_OVER) is Phase.PILOT


@pytest.mark.parametrize("phase", sorted(set(Phase) - {Phase.OFFLINE, Phase.KILLED}))
def test_every_received_vehicle_can_be_killed(phase: Phase) -> None:
    assert advance(phase, Event.KILL) is Phase.KILLED


@pytest.mark.parametrize("phase", sorted(IN_THE_AIR))
def test_a_show_in_the_air_can_always_be_aborted(phase: ShowPhase) -> None:
    assert advance_show(phase, ShowEvent.ABORT) is ShowPhase.ABORTING


@pytest.mark.parametrize("phase", [Phase.PILOT, Phase.LOST, Phase.KILLED])
def test_no_event_leads_from_lost_or_killed_straight_to_flight(phase: Phase) -> None:
    """Pilot control, loss and kill never lead straight into a flown phase."""
    assert all(after not in FLOWN for (before, _), after in NEXT.items() if before is phase)


def test_only_vehicles_under_our_control_are_flown() -> None:
    assert FLOWN < AIRBORNE
    assert AIRBORNE.isdisjoint({Phase.PILOT, Phase.LOST, Phase.KILLED, Phase.OFFLINE, Phase.STANDBY})
