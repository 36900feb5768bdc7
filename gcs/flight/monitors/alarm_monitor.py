"""Collects the conditions that an operator should know, five times a second, and maintains the alarms.

Rounds without a condition are cheap: whole columns are compared, not single vehicles.
"""

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from gcs.control import Tick
from gcs.estimation.pad_places import SETTLES_S
from gcs.failsafe.autopilot_failsafe import ADVICE_TO_MANY, TERMINATED, TEXTS_COUNT_S, FailsafeCause
from gcs.failsafe.autopilots.texts import Meaning, meaning_of
from gcs.failsafe.policy import Action, Cause
from gcs.failsafe.triggers import OF_THE_SHOW
from gcs.flight.monitors.accuracy_alarms import BLIND, NO_FIX, AccuracyAlarms
from gcs.flight.monitors.ground_alarms import GroundAlarms
from gcs.flight.monitors.space_alarms import SpaceAlarms, of_routes, of_the_centre, of_ways
from gcs.flight.state.flight import FLIES, NOT_CHOSEN, Flight
from gcs.flight.state.vehicle import Vehicle
from gcs.model.interrupted_flight import InterruptedFlight
from gcs.model.lifecycle import GROUNDED, ON_THE_GROUND, Phase, ShowPhase
from gcs.model.state import StatusText
from gcs.service import CALLER, ActiveFailsafe, Outcome
from gcs.service.alarm_book import AlarmBook, Change, ChangeKind
from gcs.service.alarms import Alarm, AlarmCause, AlarmSeverity, Condition, Limit, beyond

log = logging.getLogger(__name__)

PERIOD_S: Final = 0.2
"""Interval between two rounds."""

BEFORE_ASSEMBLING: Final = frozenset({ShowPhase.COUNTDOWN, ShowPhase.PREFLIGHT, ShowPhase.ARMING})

POOR_LINK: Final = Limit(on=0.7, off=0.85)
"""Share of the requested position messages that arrive."""

LEVEL: Final = {
    AlarmSeverity.EMERGENCY: logging.ERROR,
    AlarmSeverity.WARNING: logging.WARNING,
    AlarmSeverity.CAUTION: logging.WARNING,
    AlarmSeverity.INFORMATION: logging.INFO,
}

OF_FAILSAFE: Final = {
    Cause.LOW_BATTERY: AlarmCause.LOW_BATTERY,
    Cause.CRITICAL_BATTERY: AlarmCause.CRITICAL_BATTERY,
    Cause.BAD_POSITION: AlarmCause.BAD_POSITION,
    Cause.FENCE: AlarmCause.OUTSIDE_FENCE,
    Cause.WIND: AlarmCause.WIND,
    Cause.LINKS_LATE: AlarmCause.LINKS_LATE,
    Cause.VEHICLES_LOST: AlarmCause.VEHICLES_LOST,
    Cause.TARGET_STALE: AlarmCause.TARGET_STALE,
    Cause.SERVICE_LATE: AlarmCause.SERVICE_LATE,
}
"""Lost vehicles are seen by their phase; what the service does about them is the failsafe's alarm. Manned
aircraft are alarmed of by what receives them.
"""

WAIT_FOR_A_COMMAND: Final = (
    "[It waits|They wait] for a command: take-over or bring-home for all, take-control for"
    " [this one|some of them]."
)
"""Advice where a stall or restart of this service explains the mode: the vehicles themselves are in order."""

SENDS_NOTHING: Final = "The service sends nothing to [it|them]."

KEEP_CLEAR: Final = "Other vehicles keep clear of where [it was|they were]."

NEXT_START: Final = "[It stays|They stay] on the ground until the next start."

FLOWN_ON: Final = "[It is|They are] flown on."

SHOW_FOLLOWS: Final = {
    Action.RE_FORM: "Formation closes the gap.",
    Action.HOLD_TARGET: "The target stays where it was.",
    Action.PAUSE: "The show is paused.",
    Action.DESCEND: "The formation flies on lower, and stays there.",
    Action.RETURN: "The show comes home.",
    Action.LAND: "The show lands.",
}

DRAWN_FOLLOWS: Final = "The others fly on as drawn, and keep clear of it."

BATTERIES: Final = (AlarmCause.LOW_BATTERY, AlarmCause.CRITICAL_BATTERY)

GOES_ON: Final = {
    FailsafeCause.POSITION_LOSS: (AlarmCause.BAD_POSITION,),
    FailsafeCause.LOW_BATTERY: BATTERIES,
    FailsafeCause.CRITICAL_BATTERY: BATTERIES,
}
"""Alarms that are not over when the autopilot's own failsafe acts: its alarm has the same cause."""

KILL_OUTCOMES: Final = {
    Outcome.PENDING: "motors are being stopped on command",
    Outcome.FAILED: "motors were not seen to stop; commanded",
}

VEHICLES_FOLLOW: Final = {
    Action.HOLD: "[It leaves the formation and holds|They leave the formation and hold].",
    Action.RETURN: "[It comes|They come] home.",
    Action.LAND: "[It lands|They land].",
}


@dataclass(frozen=True, slots=True)
class Findings:
    """Conditions at one tick that are found outside the flight state."""

    failsafes: Sequence[ActiveFailsafe] = ()
    landings: Sequence[Condition] = ()  # vehicles that come down and get no lower
    obstacles_wait: Sequence[str] = ()  # why obstacles of the show have not appeared yet
    not_recorded: Sequence[str] = ()
    failed_links: Mapping[str, str] = field(default_factory=dict)  # reason by name of the link
    interrupted: InterruptedFlight | None = None
    return_problem: str = ""  # why the vehicles return without a common plan
    clock_doubt: str = ""  # why a show may begin at a wrong time
    not_ready: str = ""  # why a start that is counted down would be refused now
    supervisor: str = ""  # why this service is no longer restarted
    notes: Sequence[str] = ()  # notices for as long as this service runs


def accuracy_alarms_of(flight: Flight) -> AccuracyAlarms:
    return AccuracyAlarms(
        flight.newest,
        flight.vehicles,
        flight.show,
        flight.in_force,
        flight.config,
        flight.table,
        flight.heights,
        flight.in_formation_m,
        lambda: flight.control_now,
    )


@dataclass(eq=False)
class AlarmMonitor:
    """Maintains the alarms of one flight, on the event loop only. Implements `gcs.service.Alarms`."""

    flight: Flight

    def __post_init__(self) -> None:
        vehicles = self.flight.vehicles
        self._alarm_book = AlarmBook(lambda name: name in vehicles and vehicles[name].phase in GROUNDED)
        self._due_s = -np.inf
        self._poor = np.zeros(len(self.flight.vehicles), np.bool_)
        flight = self.flight
        self._space = SpaceAlarms(flight.newest, flight.in_force, flight.vehicles)
        self._ground = GroundAlarms(flight.newest, flight.in_force, flight.vehicles)
        self._accuracy = accuracy_alarms_of(flight)
        self._texts: Sequence[Sequence[StatusText]] = ()  # as of the last round, and the urgent ones of these
        self._urgent: list[tuple[int, StatusText]] = []

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        return self._alarm_book.alarms

    def is_due(self, now_s: float) -> bool:
        return now_s >= self._due_s

    def look(self, tick: Tick, findings: Findings) -> None:
        now_s = self.flight.newest.state.time_s
        self._due_s = now_s + PERIOD_S
        conditions = [
            *self._of_vehicles(findings.failsafes),
            *self._space.of_distances(tick),
            *self._space.of_obstacles(),
            *self._space.of_the_target(),
            *self._ground.conditions(),
            *findings.landings,
            *of_the_centre(tick),
            *of_routes(tick, self.flight.newest.state.ids + tick.elsewhere),
            *of_ways(tick, self.flight.newest.state.ids + tick.elsewhere),
            *self._accuracy.of_positions(findings.failsafes),
            *self._accuracy.of_the_radius(),
            *self._accuracy.of_authority(tick),
            *self._accuracy.of_heights(),
            *self._of_texts(),
            *_of_failsafes(findings.failsafes),
            *self._of_links(findings),
            *self._of_features(findings.failsafes),
            *self._of_intakes(),
            *self._of_the_ground(),
            *_of_the_service(findings),
        ]
        for change in self._alarm_book.look(conditions, now_s, self.flight.unix_s()):
            _log_change(change)

    def acknowledge(self, alarm_id: str) -> Alarm:
        acknowledged = {alarm.id: alarm.acknowledged_by for alarm in self.alarms}
        alarm = self._alarm_book.acknowledge(alarm_id, CALLER.get(), self.flight.unix_s())
        if acknowledged[alarm_id] is None:
            reported = {"alarm": alarm.id, "by": alarm.acknowledged_by, "text": alarm.text}
            log.info("alarm_acknowledged", extra=reported)
        return alarm

    def acknowledge_all(self) -> tuple[Alarm, ...]:
        open_ids = [alarm.id for alarm in self.alarms if alarm.acknowledged_by is None]
        return tuple(map(self.acknowledge, open_ids))

    def _of_vehicles(self, failsafes: Sequence[ActiveFailsafe]) -> Iterator[Condition]:
        vehicles = self.flight.vehicles.values()
        phases = [vehicle.phase for vehicle in vehicles]
        if not {Phase.LOST, Phase.PILOT, Phase.KILLED}.intersection(phases):
            return
        lost = next((each for each in failsafes if each.cause == Cause.VEHICLE_LOST), None)
        follows = "" if lost is None else self._without_lost(Action(lost.action))
        named = () if lost is None else lost.vehicles
        for vehicle in vehicles:
            ids = (vehicle.id,)
            if vehicle.phase is Phase.LOST:
                command_id = lost.command_id if lost is not None and vehicle.id in named else None
                consequence = follows if vehicle.id in named else ""
                cause = AlarmCause.VEHICLE_LOST
                yield Condition(cause, vehicle.reason, ids, consequence, command_id=command_id)
            elif vehicle.phase is Phase.PILOT:
                because, _, advice = vehicle.reason.removeprefix(f"{vehicle.id} ").partition(". ")
                if vehicle.cause in {None, FailsafeCause.UNKNOWN}:
                    why = because.removesuffix(".")  # the cause's advice says what to do
                    advice = BLIND if self.flight.newest.state.doubtful[vehicle.row] else ""
                    yield Condition(AlarmCause.OUTSIDE_CONTROL, why, ids, SENDS_NOTHING, advice)
                    continue
                if vehicle.cause is FailsafeCause.POSITION_LOSS:
                    because += f": {NO_FIX}" if self.flight.newest.state.doubtful[vehicle.row] else ""
                critical = vehicle.cause is FailsafeCause.CRITICAL_BATTERY
                severity = AlarmSeverity.EMERGENCY if critical else None
                to_do = f"[{advice}|{ADVICE_TO_MANY.get(advice, advice)}]" if advice else WAIT_FOR_A_COMMAND
                goes_on = GOES_ON.get(vehicle.cause, ())
                cause = AlarmCause.OWN_FAILSAFE
                yield Condition(cause, because, ids, SENDS_NOTHING, to_do, severity, replaces=goes_on)
            elif vehicle.phase is Phase.KILLED:
                yield self._of_a_kill(vehicle)

    def _without_lost(self, action: Action) -> str:
        """What the show does without lost vehicles: a drawn one has no gap to close."""
        show_run = self.flight.show.run
        is_drawn = show_run is not None and show_run.goals is not None
        return DRAWN_FOLLOWS if is_drawn and action is Action.RE_FORM else SHOW_FOLLOWS[action]

    def _of_a_kill(self, vehicle: Vehicle) -> Condition:
        """Distinguish a kill that has not taken effect from one that has, and both from a termination."""
        if vehicle.cause is FailsafeCause.TERMINATION:
            return Condition(AlarmCause.TERMINATED, TERMINATED, (vehicle.id,), KEEP_CLEAR)
        kills = (command for command in self.flight.book.newest() if command.action == "kill")
        command = next((command for command in kills if vehicle.id in command.outcomes), None)
        because, command_id = "motors stopped on command", None
        if command is not None:
            outcome, command_id = command.outcomes[vehicle.id].outcome, command.id
            because = f"{KILL_OUTCOMES.get(outcome, because)} by {command.by}"
        return Condition(AlarmCause.KILLED, because, (vehicle.id,), KEEP_CLEAR, command_id=command_id)

    def _of_texts(self) -> Iterator[Condition]:
        """Yield what autopilots of flying vehicles ask of the operator in their texts."""
        flight, texts = self.flight, self.flight.newest.telemetry.texts
        if texts is not self._texts:
            self._texts = texts
            newest = ((row, text) for row, own in enumerate(texts) for text in own)
            self._urgent = [each for each in newest if meaning_of(each[1].text) is Meaning.LAND_NOW]
        for row, text in self._urgent:
            vehicle, age_s = flight.vehicles.rows[row], flight.newest.state.time_s - text.time_s
            if vehicle.phase in FLIES and age_s <= TEXTS_COUNT_S:
                words = text.text.rstrip(".")
                yield Condition(AlarmCause.LAND_NOW, f'"{words}"', (vehicle.id,), about=words)

    def _of_features(self, failsafes: Sequence[ActiveFailsafe]) -> Iterator[Condition]:
        gives_way = next((each for each in failsafes if each.cause == Cause.MANNED_AIRCRAFT), None)
        instant = self.flight.instant
        for feature in self.flight.features:
            for each in feature.conditions(instant):
                if each.cause is AlarmCause.TRAFFIC_MANNED and gives_way is not None:
                    follows, command_id = SHOW_FOLLOWS[Action(gives_way.action)], gives_way.command_id
                    yield replace(each, consequence=follows, command_id=command_id)
                else:
                    yield each

    def _of_intakes(self) -> Iterator[Condition]:
        for intake in self.flight.intakes:
            if why := intake.why_over(self.flight.newest.state.time_s):
                yield Condition(AlarmCause.INPUT_FLOODED, why, about=intake.name)

    def _of_links(self, findings: Findings) -> Iterator[Condition]:
        flight = self.flight
        for name, why in findings.failed_links.items():
            yield Condition(AlarmCause.LINK_FAILED, why, about=name)
        yield from flight.elsewhere.hooks.conditions()
        for link in flight.links:
            for vehicle_id, why in link.conflicts.items():
                yield Condition(AlarmCause.DUPLICATE_SYSTEM_ID, why, (vehicle_id,))
        for vehicle_id, lacks in flight.newest.without_heartbeat.items():
            yield Condition(AlarmCause.NO_HEARTBEAT, lacks, (vehicle_id,), FLOWN_ON)
        share = flight.link_quality.share
        self._poor = beyond(self._poor, share, POOR_LINK)
        for row in self._poor.nonzero()[0].tolist():
            vehicle = flight.vehicles.rows[row]
            if vehicle.phase in FLIES:
                because = f"{share[row]:.0%} of [its|their] positions arrive"
                yield Condition(AlarmCause.POOR_LINK, because, (vehicle.id,))

    def _of_the_ground(self) -> Iterator[Condition]:
        flight = self.flight
        for vehicle_id, changed in flight.changed_parameters.items():
            for name, text in changed.items():
                yield Condition(AlarmCause.PARAMETER_CHANGED, text, (vehicle_id,), about=name)
        stays = flight.not_flying
        for vehicle_id, reason in stays.items():
            because = reason.removeprefix(f"{vehicle_id}: ")
            severity = (
                None if vehicle_id in flight.excluded or reason == NOT_CHOSEN else AlarmSeverity.CAUTION
            )
            advice = "" if vehicle_id in flight.excluded else NEXT_START
            yield Condition(AlarmCause.NOT_FLYING, because, (vehicle_id,), "", advice, severity)
        if Phase.OFFLINE in flight.vehicles.phases:
            for vehicle in flight.vehicles.in_phase(Phase.OFFLINE):
                if vehicle.id not in stays and flight.elsewhere.owned[vehicle.row]:
                    yield Condition(AlarmCause.SILENT, vehicle.reason, (vehicle.id,))
        if flight.show.phase in ON_THE_GROUND:
            yield from self._of_the_pads()
        if flight.columns and flight.show.phase in BEFORE_ASSEMBLING:
            yield Condition(AlarmCause.STACKED, flight.columns)

    def _of_the_pads(self) -> Iterator[Condition]:
        """Yield vehicles that are to fly, and are reported elsewhere than where they stood ready."""
        flight, moved = self.flight, self.flight.places.found
        for row in np.flatnonzero(np.isfinite(moved.since_s)).tolist():
            vehicle = flight.vehicles.rows[row]
            if vehicle.phase is Phase.STANDBY and vehicle.id not in flight.excluded:
                by, ago = moved.in_words(row, flight.newest.state.time_s)
                back = f"moved away {ago}, and back for less than {SETTLES_S:g} s"
                because = f"moved by {by}, {ago}" if moved.away[row] else back
                yield Condition(AlarmCause.MOVED_ON_PAD, because, (vehicle.id,))


def _of_failsafes(failsafes: Sequence[ActiveFailsafe]) -> Iterator[Condition]:
    for each in failsafes:
        cause, action = Cause(each.cause), Action(each.action)
        follows = (SHOW_FOLLOWS if cause in OF_THE_SHOW else VEHICLES_FOLLOW).get(action, "")
        if each.command_id is None:  # what goes on already is as severe
            follows = ""
        if (shown := OF_FAILSAFE.get(cause)) is not None:
            yield Condition(shown, each.reason, each.vehicles, follows, command_id=each.command_id)


def _of_the_service(findings: Findings) -> Iterator[Condition]:
    if findings.interrupted is not None:
        yield _of_the_interruption(findings.interrupted)
    if findings.return_problem:
        consequence = "Each vehicle flies home by itself; the safety filter keeps them apart."
        yield Condition(AlarmCause.RETURN_UNPLANNED, findings.return_problem, consequence=consequence)
    if findings.obstacles_wait:
        yield Condition(AlarmCause.OBSTACLE_WAITS, "; ".join(findings.obstacles_wait))
    if findings.not_ready:
        yield Condition(AlarmCause.START_NOT_READY, findings.not_ready)
    if findings.clock_doubt:
        yield Condition(AlarmCause.CLOCK_DOUBTFUL, findings.clock_doubt)
    if findings.not_recorded:
        yield Condition(AlarmCause.RECORD_FAILS, "; ".join(findings.not_recorded))
    if findings.supervisor:
        yield Condition(AlarmCause.SUPERVISOR_GONE, findings.supervisor)
    for note in findings.notes:
        yield Condition(AlarmCause.SERVICE_NOTE, note, about=note)


def _of_the_interruption(flight: InterruptedFlight) -> Condition:
    what = "" if flight.written is None else f" {flight.written.name!r} (cue {flight.written.cue!r})"
    absent = [f"{name}: {vehicle.text}." for name, vehicle in flight.vehicles.items() if not vehicle.waits]
    consequence = " ".join([*absent, *(f"{problem}." for problem in flight.problems)])
    because, offers = f"{flight.cause} while the show{what} was", " or ".join(flight.offers)
    if flight.show is not ShowPhase.COUNTDOWN:
        advice = f"Command {offers}." if offers else ""
        return Condition(AlarmCause.INTERRUPTED, f"{because} {flight.show}", (), consequence, advice)
    consequence = f"It does not start by itself. {consequence}".strip()
    because, advice = f"{because} counted down", "Start it again when all is clear."
    return Condition(AlarmCause.INTERRUPTED, because, (), consequence, advice, AlarmSeverity.CAUTION)


def _log_change(change: Change) -> None:
    alarm = change.alarm
    about = {"alarm": alarm.id, "severity": alarm.severity.value, "cause": alarm.cause.value}
    about["text"] = alarm.text
    if change.kind is ChangeKind.ENDED:
        log.info("alarm_over", extra=about)
    else:
        log.log(LEVEL[alarm.severity], "alarm", extra={**about, "vehicles": list(alarm.vehicles)})
