"""Phases of a vehicle and of the show, as tables. A transition that no table contains is refused."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final, TypeVar

from gcs.model.errors import RefusedError

P = TypeVar("P", bound=StrEnum)
E = TypeVar("E", bound=StrEnum)


class Phase(StrEnum):
    """Phase of one vehicle."""

    __hash__ = str.__hash__  # Enum's own is written in Python, and a tick hashes thousands of times

    OFFLINE = "offline"  # no telemetry, and not known to be in the air
    STANDBY = "standby"  # telemetry received, on the ground
    TAKEOFF = "takeoff"  # the autopilot climbs, straight up
    HOLD = "hold"  # in the air, the autopilot holds position
    FORMATION = "formation"  # flown by the law
    RETURN = "return"  # flown home by the service
    LANDING = "landing"  # descends at its landing site
    LOST = "lost"  # was in the air, then silent: nothing is sent
    PILOT = "pilot"  # under pilot control: nothing is sent
    KILLED = "killed"  # motors were stopped on command


class Event(StrEnum):
    """What can happen to one vehicle."""

    CONNECTED = "connected"  # telemetry is fresh, on the ground
    CONNECTED_IN_AIR = "received in the air"
    SILENT = "silent"
    TAKE_OFF = "take off"
    HOLD = "hold"
    ENGAGE = "engage"  # OFFBOARD accepted, the law flies it
    COME_HOME = "come home"
    DESCEND = "descend"
    TOUCHED_DOWN = "touched down"
    TAKEN_OVER = "taken over"
    TAKE_CONTROL = "take control"
    KILL = "kill"
    CONFIRMED_DOWN = "confirmed down"
    RELEASED = "released"  # another station has taken it over
    PAUSE = "pause"  # on its way home or down: stops in place, still flown by the service


AIRBORNE: Final = frozenset({Phase.TAKEOFF, Phase.HOLD, Phase.FORMATION, Phase.RETURN, Phase.LANDING})
"""Phases in which the service is responsible for a vehicle in the air."""

FLOWN: Final = frozenset({Phase.FORMATION, Phase.RETURN, Phase.LANDING})
"""Phases in which the tick may send setpoints."""

GROUNDED: Final = frozenset({Phase.OFFLINE, Phase.STANDBY})
"""Phases in which a vehicle is not in the air, as far as is known."""

NEXT: Final[dict[tuple[Phase, Event], Phase]] = {
    (phase, event): after
    for event, after, phases in (
        (Event.CONNECTED, Phase.STANDBY, {Phase.OFFLINE, Phase.LOST}),
        (Event.CONNECTED_IN_AIR, Phase.PILOT, {Phase.OFFLINE, Phase.STANDBY}),  # until hand-over
        (Event.SILENT, Phase.OFFLINE, {Phase.STANDBY}),
        (Event.SILENT, Phase.LOST, AIRBORNE | {Phase.PILOT}),
        (Event.TAKE_OFF, Phase.TAKEOFF, {Phase.STANDBY}),
        (Event.HOLD, Phase.HOLD, AIRBORNE - {Phase.HOLD} | {Phase.LOST}),
        (Event.ENGAGE, Phase.FORMATION, {Phase.HOLD}),
        (Event.COME_HOME, Phase.RETURN, AIRBORNE - {Phase.TAKEOFF}),
        (Event.DESCEND, Phase.LANDING, AIRBORNE - {Phase.LANDING}),
        (Event.TOUCHED_DOWN, Phase.STANDBY, AIRBORNE | {Phase.PILOT}),
        (Event.TAKEN_OVER, Phase.PILOT, AIRBORNE | {Phase.LOST}),
        (Event.TAKE_CONTROL, Phase.HOLD, {Phase.PILOT}),
        (Event.KILL, Phase.KILLED, set(Phase) - {Phase.OFFLINE}),  # also repeatedly
        (Event.CONFIRMED_DOWN, Phase.OFFLINE, {Phase.LOST, Phase.KILLED}),
        (Event.PAUSE, Phase.FORMATION, {Phase.RETURN, Phase.LANDING}),
        (Event.RELEASED, Phase.OFFLINE, set(Phase)),
    )
    for phase in phases
}


def advance(phase: Phase, event: Event) -> Phase:
    """The phase after `event`. Raises: RefusedError when the table does not contain the pair."""
    return _next(NEXT, phase, event, "")


def _next(table: Mapping[tuple[P, E], P], phase: P, event: E, subject: str) -> P:
    try:
        return table[phase, event]
    except KeyError:
        possible = ", ".join(sorted({earlier.value for earlier, what in table if what is event}))
        raise RefusedError(
            f"'{event}' is not possible while {subject}{phase}; it is from {possible}"
        ) from None


class ShowPhase(StrEnum):
    """Phase of the show."""

    __hash__ = str.__hash__  # Enum's own is written in Python, and a tick hashes thousands of times

    IDLE = "idle"
    COUNTDOWN = "countdown"  # on the ground, until a start at a clock time
    PREFLIGHT = "preflight"
    ARMING = "arming"  # arming and taking off, one after the other
    ASSEMBLING = "assembling"
    RUNNING = "running"
    PAUSED = "paused"
    RETURNING = "returning"
    ABORTING = "aborting"
    LANDED = "landed"
    UNCONTROLLED = "uncontrolled"  # something is airborne, and none of it is under this station's control


class ShowEvent(StrEnum):
    """What can happen to the show."""

    START = "start"
    SCHEDULE = "schedule"  # a start at a clock time
    CHECKED = "checked"
    CHECK_FAILED = "check failed"
    ALL_UP = "all up"
    ASSEMBLED = "assembled"
    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"
    ABORT = "abort"
    ALL_DOWN = "all down"
    TAKEN_ON = "taken on"  # an airborne vehicle came under control while no show flies
    CONTROL_LOST = "control lost"  # something is airborne, and none of it is under this station's control
    NEVER_FLEW = "never flew"  # vehicles that were airborne without a show of this station have landed


ON_THE_GROUND: Final = frozenset({ShowPhase.IDLE, ShowPhase.COUNTDOWN, ShowPhase.LANDED})
"""No vehicle flies or is about to arm."""

IN_THE_AIR: Final = frozenset(
    {ShowPhase.ARMING, ShowPhase.ASSEMBLING, ShowPhase.RUNNING, ShowPhase.PAUSED, ShowPhase.RETURNING}
)

ANYTHING_FLIES: Final = IN_THE_AIR | {ShowPhase.ABORTING, ShowPhase.UNCONTROLLED}
"""Something may be airborne: PAUSE, STOP and ABORT are accepted in all of these."""

_NO_SHOW: Final = frozenset({ShowPhase.IDLE, ShowPhase.LANDED})

SHOW_NEXT: Final[dict[tuple[ShowPhase, ShowEvent], ShowPhase]] = {
    (phase, event): after
    for event, after, phases in (
        (ShowEvent.SCHEDULE, ShowPhase.COUNTDOWN, _NO_SHOW),
        (ShowEvent.START, ShowPhase.PREFLIGHT, ON_THE_GROUND),
        (ShowEvent.CHECKED, ShowPhase.ARMING, {ShowPhase.PREFLIGHT}),
        (ShowEvent.CHECK_FAILED, ShowPhase.IDLE, {ShowPhase.COUNTDOWN, ShowPhase.PREFLIGHT}),
        (ShowEvent.ALL_UP, ShowPhase.ASSEMBLING, {ShowPhase.ARMING}),
        (ShowEvent.ASSEMBLED, ShowPhase.RUNNING, {ShowPhase.ASSEMBLING}),
        (ShowEvent.PAUSE, ShowPhase.PAUSED, IN_THE_AIR | {ShowPhase.ABORTING}),
        (ShowEvent.PAUSE, ShowPhase.UNCONTROLLED, {ShowPhase.UNCONTROLLED}),  # until one is under control
        (ShowEvent.RESUME, ShowPhase.ASSEMBLING, {ShowPhase.PAUSED}),
        # from ARMING: airborne, but no vehicle could join
        (ShowEvent.TAKEN_ON, ShowPhase.PAUSED, _NO_SHOW | {ShowPhase.ARMING, ShowPhase.UNCONTROLLED}),
        (ShowEvent.STOP, ShowPhase.RETURNING, ANYTHING_FLIES),
        (ShowEvent.STOP, ShowPhase.IDLE, {ShowPhase.COUNTDOWN}),
        (ShowEvent.ABORT, ShowPhase.ABORTING, ANYTHING_FLIES),
        (ShowEvent.ABORT, ShowPhase.IDLE, {ShowPhase.COUNTDOWN, ShowPhase.PREFLIGHT}),
        (ShowEvent.ALL_DOWN, ShowPhase.LANDED, ANYTHING_FLIES),
        (ShowEvent.CONTROL_LOST, ShowPhase.UNCONTROLLED, ANYTHING_FLIES | _NO_SHOW),
        (ShowEvent.NEVER_FLEW, ShowPhase.IDLE, {ShowPhase.UNCONTROLLED}),
    )
    for phase in phases
}


def advance_show(phase: ShowPhase, event: ShowEvent) -> ShowPhase:
    """The show's phase after `event`. Raises: RefusedError when the table does not contain the pair."""
    return _next(SHOW_NEXT, phase, event, "the show is ")
