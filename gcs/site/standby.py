"""A standby: receives another station's vehicles, and takes them over when that station is lost.

Two stations never send setpoints to one vehicle. The standby takes the ownership, with a higher epoch, once
the owner's lease and watchdog must have ended, and commands HOLD. It sends setpoints of its own only after
FENCED_S, by which an owner that is alive but cut off has had its vehicles hold as well; and an owner that
stood still sends nothing until its standby has answered it.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from gcs.flight.maneuvers.maneuvers import Maneuvers
from gcs.flight.state.newest import Newest
from gcs.flight.state.refusals import Refusals
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import AIRBORNE, GROUNDED, Event, Phase, ShowPhase
from gcs.service import CommandRecord, Outcome
from gcs.service.commands import CommandLog
from gcs.site.absences import FENCED_S
from gcs.site.member import SiteMember

log = logging.getLogger(__name__)

TAKE_OVER: Final = "take-over"
"""Name of the command that flies on with a lost station's vehicles."""

SPARE_S: Final = 0.05
"""The owner counts as lost this long after its lease and its watchdog have ended."""

NO_SETPOINTS_S: Final = 2.0
"""After the loss of the owner, the standby sends no setpoints for FENCED_S, a command, and a reserve."""

LONG_TICK_S: Final = 0.1
"""Of a longer pause of this station itself, only this much counts as silence of another."""


@dataclass(eq=False)
class Standby:
    """What a station does for those that it stands by for, and for its own standbys. Used once a tick."""

    newest: Newest
    vehicles: FlightVehicles
    show: ShowState
    book: CommandLog
    refusals: Refusals
    maneuvers: Maneuvers
    member: SiteMember
    lease_s: float
    setpoint_timeout_s: float
    rejoins: bool

    taken: dict[str, float] = field(default_factory=dict)  # stations taken over, and when each was lost
    _silent_s: dict[str, float] = field(default_factory=dict)
    _looked_s: float | None = None
    _held: set[str] = field(default_factory=set)  # vehicles that were commanded to hold
    _fenced: bool = False
    _joining: set[str] = field(default_factory=set)  # vehicles that go back into formation
    _wants_resume: bool = False
    _rejoined: set[str] = field(default_factory=set)  # vehicles that went back by themselves

    @property
    def lost_after_s(self) -> float:
        """Silence of an owner after which it is taken over."""
        return self.lease_s + self.setpoint_timeout_s + SPARE_S

    def look(self, now_s: float) -> bool:
        """Take over what is due. Returns: whether the show is to be resumed now."""
        step_s = 0.0 if self._looked_s is None else min(now_s - self._looked_s, LONG_TICK_S)
        self._looked_s = now_s
        self._mind_own_standbys(now_s)
        for name in self.member.roles.stands_by_for:
            arrived_s = self.member.site.stations[name].arrived_s
            silent_s = self._silent_s.get(name, 0.0) + step_s if now_s - arrived_s > step_s else 0.0
            self._silent_s[name] = silent_s
            if silent_s > self.lost_after_s and self.member.ids_of(name, *AIRBORNE):
                self._take(name, now_s)
            elif name in self.taken and name in self.member.present():
                self._give_back(name)
        self._hold()
        if self.rejoins:
            self._rejoin_by_itself(now_s)
        return self._joined()

    # of others

    def _take(self, name: str, now_s: float) -> None:
        site = self.member.site
        ids = site.take_over(name)
        for vehicle_id in ids:
            vehicle = self.vehicles[vehicle_id]
            vehicle.home_m = site.known_home_m(vehicle.row)
            vehicle.reason = f"taken over from station {name}"
        if ids:
            self.taken[name] = now_s
            log.error("station_taken_over", extra={"other": name, "vehicles": len(ids)})

    def _give_back(self, name: str) -> None:
        """Leave the vehicles of a station that is there again to it, once all are on the ground."""
        vehicles = [self.vehicles[vehicle_id] for vehicle_id in self.member.roles.stands_by_for[name]]
        if all(vehicle.phase in GROUNDED and not self.maneuvers.running(vehicle) for vehicle in vehicles):
            del self.taken[name]
            ids = {vehicle.id for vehicle in vehicles}
            self._held, self._rejoined = self._held - ids, self._rejoined - ids
            self.member.site.give_back(ids)
            log.warning("station_given_back", extra={"other": name, "vehicles": len(ids)})

    def _of_taken(self) -> list[Vehicle]:
        return [
            self.vehicles[vehicle_id]
            for name in self.taken
            for vehicle_id in self.member.roles.stands_by_for[name]
        ]

    def _hold(self) -> None:
        """Have vehicles that were taken over hold, unless a person or their own failsafe has them."""
        for vehicle in self._of_taken() if self.taken else ():
            if vehicle.id in self._held or vehicle.phase is not Phase.PILOT:
                continue
            self._held.add(vehicle.id)  # once: a later mode is the decision of a pilot or of the autopilot
            if not (self.refusals.why_never(vehicle) or self.refusals.why_not_touching_down(vehicle)):
                self.maneuvers.start(vehicle, self.maneuvers.take_control, lambda _outcome, _reason: None)

    def _rejoin_by_itself(self, now_s: float) -> None:
        for name, taken_s in self.taken.items():
            if now_s - taken_s > NO_SETPOINTS_S and not self._joining:
                waiting = [vehicle for vehicle in self._holding(name) if vehicle.id not in self._rejoined]
                if waiting:
                    self._rejoined |= {vehicle.id for vehicle in waiting}
                    self.join(waiting, None)

    def _holding(self, name: str) -> list[Vehicle]:
        vehicles = [self.vehicles[vehicle_id] for vehicle_id in self.member.roles.stands_by_for[name]]
        return [
            vehicle
            for vehicle in vehicles
            if vehicle.phase is Phase.HOLD and not self.maneuvers.running(vehicle)
        ]

    def go_on(self, name: str) -> CommandRecord:
        """Fly on with a lost station's vehicles, on an operator's command. Raises: RefusedError."""
        if name not in self.member.roles.stands_by_for:
            names = ", ".join(self.member.roles.stands_by_for) or "none"
            raise RefusedError(f"this station is no standby for {name}; it is for: {names}")
        now_s = self.newest.state.time_s
        if name not in self.taken:
            raise RefusedError(f"station {name} is not lost: stop it there first")
        left_s = NO_SETPOINTS_S - (now_s - self.taken[name])
        if left_s > 0.0:
            raise RefusedError(f"station {name} may still send setpoints: again in {left_s:.1f} s")
        waiting = self._holding(name)
        if not waiting:
            raise RefusedError(f"no vehicle of station {name} holds here")
        record = self.book.open(TAKE_OVER, [vehicle.id for vehicle in waiting], {})
        self.join(waiting, record)
        return record

    def join(self, vehicles: Sequence[Vehicle], record: CommandRecord | None) -> None:
        """Have vehicles join the formation, and resume the show when they have."""
        lead = self.member.site.lead
        if not self.member.lead_is_here:
            log.warning("lead_taken", extra={"term": lead.take(), "by": "standby"})
        for vehicle in vehicles:
            self._joining.add(vehicle.id)

            def done(outcome: Outcome, reason: str, name: str = vehicle.id) -> None:
                self._joining.discard(name)
                if record is not None:
                    self.book.close(record.id, name, outcome, reason)

            self.maneuvers.start(vehicle, self.maneuvers.join, done)
        self._wants_resume = True

    def _joined(self) -> bool:
        if not self._wants_resume or self._joining:
            return False
        self._wants_resume = False
        return self.show.phase is ShowPhase.PAUSED and bool(self.vehicles.in_phase(Phase.FORMATION))

    # the own vehicles

    def release(self) -> None:
        """Stop what flies vehicles that another station owns now: before the setpoints of this tick."""
        owned = self.member.owned
        if owned.all():
            return
        for vehicle in self.vehicles.values():
            if not owned[vehicle.row] and vehicle.phase is not Phase.OFFLINE:
                self.maneuvers.stop(vehicle, "another station flies it now")
                vehicle.apply(Event.RELEASED, "flown by another station")

    def _mind_own_standbys(self, now_s: float) -> None:
        """Have the own vehicles hold while this station is cut off from a standby: it may take them over."""
        if not self.member.may_send:  # and it may have taken them already
            return
        stations = self.member.site.stations
        cut = [
            name
            for name in self.member.standbys
            if stations[name].batch is not None
            and now_s - stations[name].arrived_s > FENCED_S
            and not self.member.ended(name)
        ]
        if not cut:
            self._fenced = False
            return
        if self._fenced:
            return
        self._fenced = True
        flown = self.vehicles.in_phase(*(AIRBORNE - {Phase.HOLD, Phase.TAKEOFF}))
        flown = [vehicle for vehicle in flown if not vehicle.flags.handed_over]
        log.error("standby_not_received", extra={"other": cut[0], "vehicles": len(flown)})
        for vehicle in flown:
            self.maneuvers.start(vehicle, self.maneuvers.hold, lambda _outcome, _reason: None)
