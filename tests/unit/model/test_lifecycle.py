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
def test_a_vehicle_goes_where_the_table_says_or_the_refusal_says_from_where_it_could(phase: Phase) -> None:
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
def test_the_show_goes_where_the_table_says_or_the_refusal_says_from_where_it_could(phase: ShowPhase) -> None:
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


def test_an_ordinary_show_leads_from_idle_to_landed_and_may_start_again() -> None:
    phase = ShowPhase.IDLE
    way = [ShowEvent.START, ShowEvent.CHECKED, ShowEvent.ALL_UP, ShowEvent.ASSEMBLED, ShowEvent.PAUSE]
    for event in [*way, ShowEvent.RESUME, ShowEvent.STOP, ShowEvent.ALL_DOWN]:
        phase = advance_show(phase, event)
    assert phase is ShowPhase.LANDED
    assert advance_show(phase, ShowEvent.START) is ShowPhase.PREFLIGHT


@pytest.mark.parametrize("phase", sorted(AIRBORNE))
def test_whoever_falls_silent_in_the_air_is_lost_and_whoever_is_taken_over_is_the_pilots(
    phase: Phase,
) -> None:
    assert advance(phase, Event.SILENT) is Phase.LOST
    assert advance(phase, Event.TAKEN_OVER) is Phase.PILOT


@pytest.mark.parametrize("phase", sorted(set(Phase) - {Phase.OFFLINE, Phase.KILLED}))
def test_everybody_who_is_received_can_be_killed(phase: Phase) -> None:
    assert advance(phase, Event.KILL) is Phase.KILLED


@pytest.mark.parametrize("phase", sorted(IN_THE_AIR))
def test_a_show_in_the_air_can_always_be_aborted(phase: ShowPhase) -> None:
    assert advance_show(phase, ShowEvent.ABORT) is ShowPhase.ABORTING


@pytest.mark.parametrize("phase", [Phase.PILOT, Phase.LOST, Phase.KILLED])
def test_nobody_leads_from_a_pilot_a_lost_or_a_killed_vehicle_straight_into_flight(phase: Phase) -> None:
    assert all(after not in FLOWN for (before, _), after in NEXT.items() if before is phase)


def test_only_what_the_service_answers_for_is_flown() -> None:
    assert FLOWN < AIRBORNE
    assert AIRBORNE.isdisjoint({Phase.PILOT, Phase.LOST, Phase.KILLED, Phase.OFFLINE, Phase.STANDBY})
