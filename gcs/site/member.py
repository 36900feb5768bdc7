"""A station as a member of its site: what it receives from and sends to the others, once a tick."""

import logging
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import nan
from typing import Any, Final

import numpy as np
from pydantic_core import from_json

from gcs.bus import Bus
from gcs.config.schema import Config
from gcs.control.inputs import FormationState
from gcs.control.others import Others
from gcs.flight.state.elsewhere import Elsewhere, Returning
from gcs.flight.state.flight import Flight
from gcs.links.intake import Intake
from gcs.model.errors import GcsError, LinkError
from gcs.model.interrupted_flight import Offer
from gcs.model.lifecycle import AIRBORNE, ON_THE_GROUND, Phase, ShowPhase
from gcs.model.plan import plan_of
from gcs.model.state import Array, Mask, VehicleId
from gcs.preflight.go import digest
from gcs.preflight.vehicles import Placed
from gcs.site.absences import Absences
from gcs.site.agreement import NAMES_MAX, rules_of, why_others
from gcs.site.configured_stations import SiteRoles, station_fleets, without_control
from gcs.site.led_show import PARTS, SHOW, ShowTraffic
from gcs.site.requests import REQUEST, Refusal, ShowRequest
from gcs.site.returns import SiteReturns
from gcs.site.sender import NOT_CHECKED, WHY_LENGTH, SiteSender
from gcs.stations.letters import Letters
from gcs.stations.messages import PHASE_CODE, PHASES
from gcs.stations.publishing import FORMATION, SLOTS, STATES, VELOCITIES
from gcs.stations.recognition import may_be_valid
from gcs.stations.reported_vehicles import Rows
from gcs.stations.return_messages import ReturnMessage
from gcs.stations.site import Site

log = logging.getLogger(__name__)

CHANGED_AGAIN_S: Final = 2.0
"""A follower shows its own change of the plan until the lead confirms it, for this time at most."""

OF_VEHICLES: Final = frozenset({STATES, FORMATION, "homes"})
"""Topics that the site takes; slots and velocities as well."""

ARRIVES_WITHIN_S: Final = 0.1
"""The times of a repeated plan differ by up to this much: by the ticks that collect it, and by delays."""


@dataclass(frozen=True, slots=True)
class Membership:
    """Which station this is, of which site, and the bus to the others."""

    station: str
    site: Config
    bus: Bus
    session: int  # a number that no earlier process of this station had


@dataclass(slots=True)
class StationTexts:
    """The newest texts of another station."""

    why_not_ready: str = NOT_CHECKED
    reasons: Mapping[VehicleId, str] | None = None
    offers: tuple[Offer, ...] = ()  # of its interrupted flight
    rules: Mapping[str, str] | None = None  # see `rules_of`; None: not reported yet
    parameters: str = ""  # hash of its vehicles' parameters; empty: none were read


class SiteMember(Elsewhere):
    """The vehicles of the other stations. Used on the event loop only; nothing here waits."""

    def __init__(self, flight: Flight, membership: Membership) -> None:
        super().__init__(len(flight.vehicles))
        self.flight, self.bus = flight, membership.bus
        site_config = membership.site
        self.site = site = Site(membership.station, station_fleets(site_config), without_control(site_config))
        self.bus.accepts = lambda topic, payload: may_be_valid(topic, payload, site.site)
        self.lead_silent_s = site_config.bus.lead_silent_s
        self.all_ids = site_config.ids
        self.roles = SiteRoles.of(site_config, membership.station)
        self.standbys = self.roles.standbys_of[membership.station]  # stations that take over from this one
        stall_s = site_config.bus.lease_s + site_config.setpoint_timeout_s
        self._absences = Absences(site, self.standbys, stall_s)
        self.letters = {name: Letters(membership.session) for name in self.site.stations}
        self.received: list[tuple[str, dict[str, Any]]] = []  # requests and answers of this tick
        self.texts: dict[str, StationTexts] = {name: StationTexts() for name in self.site.stations}
        self._rules = rules_of(flight.config)
        self.show_traffic = ShowTraffic(flight.show, flight.outside_clock, site, self.all_ids)
        self.sender = SiteSender(flight, site, self.bus, self.letters, self.show_traffic)
        self.returns = self._returns = SiteReturns(
            site, self, self.sender, lambda: flight.newest.state.time_s
        )
        self._changed_s = -np.inf  # when this station changed the lead's plan
        self._changes = 0  # of the plan, that this station asked of the lead
        self._plan_of: tuple[str, int, int] | None = None  # sender, term and version of the newest that came
        self._others: Others | None = None  # of this tick, as the next; None: not computed yet
        self._landing_m: Array | None = None
        self._counted: set[str] = set()  # other stations that counted down together with this one

    # received

    def receive(self, now_s: float) -> None:
        """Take what has arrived since the last tick."""
        site = self.site
        self.received = []
        for message in self.bus.newest():
            topic, sender, payload = message.topic, message.sender, message.payload
            try:
                if topic in OF_VEHICLES or topic.startswith((SLOTS, VELOCITIES)):
                    site.receive(sender, topic, payload, message.time_s)
                elif sender not in site.stations or site.stations[sender].batch is None:
                    site.refused += 1  # no station of this site, as far as its batches have shown
                elif topic == f"letters.{site.own}":
                    self.received += [(sender, body) for body in self.letters[sender].take(payload, now_s)]
                elif topic == "plan":
                    self._take_plan(sender, payload, message.time_s)
                elif topic in {SHOW, PARTS}:
                    self.show_traffic.take(sender, topic, payload, message.time_s)
                elif topic == "info":
                    self._take_info(sender, payload)
                elif topic.startswith(f"return.{site.own}.") and sender == site.lead.name:
                    self._returns.take(ReturnMessage.decode(payload))
            except LinkError:
                site.refused += 1
        self._others = self._landing_m = None
        self._absences.look(self.bus.present, now_s)
        self._note_countdowns()

    def _note_countdowns(self) -> None:
        if self.flight.show.phase is not ShowPhase.COUNTDOWN:
            self._counted.clear()
        elif counting := [name for name in self.present() if self.show_of(name) is ShowPhase.COUNTDOWN]:
            self._counted.update(counting)

    def _take_plan(self, sender: str, payload: bytes, arrived_s: float) -> None:
        site = self.site
        try:
            read = from_json(payload)
            term, version = int(read["term"]), int(read["version"])
            applied = {str(name): int(number) for name, number in read["applied"].items()}
            if not site.lead.obeys(term, site.names.index(sender)) or site.lead.leads:
                return
            plan = plan_of(read["plan"], arrived_s - site.delays.one_way_s(site.names.index(sender)))
        except (AttributeError, GcsError, KeyError, OverflowError, TypeError, ValueError):
            raise LinkError("a plan that cannot be read") from None
        self.sender.plan_version = version
        own_pending = (
            applied.get(site.own, 0) < self._changes and arrived_s - self._changed_s < CHANGED_AGAIN_S
        )
        if own_pending or plan == self.flight.in_force.plan:
            return
        # the same plan, moved by when it happened to arrive, is flown and recorded as it was
        before = self.flight.in_force.plan
        moved_s = abs(plan.target.time_s - before.target.time_s)
        flown, self._plan_of = self._plan_of, (sender, term, version)
        if flown != self._plan_of or moved_s > ARRIVES_WITHIN_S or not plan.differs_in_time_only(before):
            self.flight.in_force.plan = plan

    def _take_info(self, sender: str, payload: bytes) -> None:
        try:
            read = from_json(payload)
            reasons = {str(name)[:64]: str(text)[:300] for name, text in read["reasons"].items()}
            offers = tuple(Offer(offer) for offer in read["offers"])
            named = [*read["rules"].items()][:NAMES_MAX]
            rules = {str(name)[:64]: str(value)[:64] for name, value in named}
            why, parameters = str(read["why_not_ready"])[:WHY_LENGTH], str(read["parameters"])[:64]
            self.texts[sender] = StationTexts(why, reasons, offers, rules, parameters)
        except (AttributeError, KeyError, TypeError, ValueError):
            raise LinkError("texts that cannot be read") from None

    def ended(self, station: str) -> bool:
        """Whether the process of a station that is not received has ended, as far as the bus shows it."""
        return self._absences.ended(station)

    @property
    def may_send(self) -> bool:
        """Whether setpoints may leave: no standby may have taken the vehicles over meanwhile."""
        return self._absences.all_answered

    @property
    def alone(self) -> bool:
        return False

    @property
    def count(self) -> int:
        return self.site.count

    @property
    def owned(self) -> Mask:
        """(n,) own rows that this station flies."""
        return self.site.owned

    # known

    def present(self, now_s: float | None = None) -> list[str]:
        """Other stations that are received."""
        return self.site.present(self.flight.newest.state.time_s if now_s is None else now_s)

    @property
    def lost(self) -> dict[str, str]:
        """Stations that are not received any more, with what is known of their vehicles."""
        texts = {}
        for name in self.site.lost(self.flight.newest.state.time_s):
            flying = len(self.ids_of(name, *AIRBORNE))
            vehicles = "vehicle of it" if flying == 1 else "vehicles of it"
            texts[name] = f"{flying} {vehicles} in the air" if flying else "none of its vehicles in the air"
        return texts

    @property
    def shows_of_others_fly(self) -> bool:
        """Whether another station's show is in the air, while this one's is over or has not begun."""
        on_ground = self.flight.show.phase in ON_THE_GROUND | {ShowPhase.UNCONTROLLED}
        return on_ground and any(self.show_of(name) not in ON_THE_GROUND for name in self.present())

    @property
    def leads_now(self) -> bool:
        """Whether this station leads; one that was started again disturbs no flight of the others."""
        return self.site.lead.leads and not self.shows_of_others_fly

    @property
    def lead_is_here(self) -> bool:
        """Whether this station leads, or receives the one that does."""
        lead = self.site.lead
        return lead.leads or lead.name in self.present()

    @property
    def others(self) -> Others:
        """The other stations' vehicles at the time of this tick."""
        if self._others is None:
            self._others = self.site.others(self.flight.newest.state.time_s)
        return self._others

    def shared(self) -> FormationState | None:
        """The lead's formation at this tick; None: this station computes it."""
        formation = self.site.formation(self.flight.newest.state.time_s, self.lead_silent_s)
        return None if formation is None or formation.center is None else formation

    @property
    def show(self) -> ShowPhase:
        """Phase of the whole show: that of a received station, where this one's vehicles are down already."""
        own = self.flight.show.phase
        if own not in ON_THE_GROUND:
            return own
        shows = [self.show_of(name) for name in self.present()]
        return next((show for show in shows if show not in ON_THE_GROUND), own)

    def show_of(self, station: str) -> ShowPhase:
        """Phase of that station's show, as last received."""
        batch = self.site.stations[station].batch
        return ShowPhase.IDLE if batch is None else batch.show

    @property
    def all_up(self) -> bool:
        """Whether no vehicle of another station climbs, or waits for its turn."""
        batches = [self.site.stations[name].batch for name in self.present()]
        return all(batch.all_up for batch in batches if batch is not None)

    def why_not_start(self) -> str:
        """Why the other stations could not start now; empty when they can."""
        for name in self.site.stations:
            if name not in self.present():
                return f"station {name} is not received"
            if self.show_of(name) not in ON_THE_GROUND:
                return f"at station {name} the show is {self.show_of(name)}"
            if why := self._why_unlike(name) or self.texts[name].why_not_ready:
                return f"station {name}: {why}"
        return ""

    def _why_unlike(self, station: str) -> str:
        """How the rules of another station differ from this one's; empty: they do not."""
        their = self.texts[station].rules
        return NOT_CHECKED if their is None else why_others(self._rules, their)

    def why_apart(self) -> str:
        """As of `Elsewhere`: stations that are missing, that now have other rules, or count down no more."""
        here = self.present()
        for name in self.site.stations:
            why = self._why_unlike(name) if name in here else "it is not received"
            if why := why or self._why_not_counting(name):
                return f"a start needs every station: station {name}: {why}"
        return ""

    def _why_not_counting(self, station: str) -> str:
        """Why a station that counted down with this one will not start with it; empty: it will."""
        over = self.show_of(station) in ON_THE_GROUND - {ShowPhase.COUNTDOWN}
        ended = over and station in self._counted and self.flight.show.phase is ShowPhase.COUNTDOWN
        return "its countdown is over: it was started again, or refused; start all again" if ended else ""

    def why_other_request(self, station: str, request: ShowRequest) -> str:
        """Why a start that another station asks for is none of this one's; empty: it is.

        By the rules that the request carries: those of `why_apart` may be older.
        """
        if request.rules is None:
            return f"station {station} asks for a start and does not say by which site and rules"
        if why := why_others(self._rules, request.rules):
            return f"station {station} asks for a start: {why}"
        if request.parameters and request.parameters != self.sender.parameters_hash():
            own = self.site.own
            return f"the parameters of station {own} changed since the start was confirmed; propose it again"
        return ""

    def as_agreed(self, station: str, request: ShowRequest) -> ShowRequest:
        """The request for a start with what that station has to have in common with this one."""
        by_two = bool(request.confirmed_by)
        parameters = self.texts[station].parameters if by_two else ""
        return replace(request, rules=self._rules, parameters=parameters)

    def why_no_start(self) -> str:
        """As of `Elsewhere`: where this start is made, and what keeps another station from it."""
        go, lead = self.flight.config.go, self.site.lead
        if go is not None and go.confirmed_by_another and not lead.leads:
            return f"a start is proposed at the station that leads, {lead.name}"
        why = self.why_not_start()
        return f"a start needs every station: {why}" if why else ""

    @property
    def parameters_hash(self) -> str:
        read = {name: texts.parameters for name, texts in self.texts.items() if texts.parameters}
        return digest(read) if read else ""

    def ids_of(self, station: str, *phases: Phase) -> list[VehicleId]:
        """Vehicles that another station flies, in one of these phases; without phases all."""
        in_phase, owners = self._in_phase(phases or PHASES), self.site.owners
        return [self.site.ids[row] for row in np.flatnonzero(in_phase).tolist() if owners[row] == station]

    def excluded(self, station: str) -> Collection[VehicleId]:
        """Vehicles on the ground that operators of another station have taken out of the show."""
        return self.texts[station].reasons or ()

    def offering(self, offer: Offer) -> list[str]:
        """Other stations that offer this for an interrupted flight of theirs."""
        return [name for name in self.present() if offer in self.texts[name].offers]

    @property
    def taking_part(self) -> Mask:
        """(k,) vehicles of received stations that fly, or on the ground are to fly, with the formation."""
        flying = self.flight.show.phase not in ON_THE_GROUND
        phases = AIRBORNE if flying else {*AIRBORNE, Phase.STANDBY}
        return self._received & self._in_phase(phases)

    def uncertainty_m(self) -> Array:
        """(j,) of the vehicles that take part."""
        return np.asarray(self.others.uncertainty_m[self.taking_part])

    def formed_m(self) -> tuple[Array, Array]:
        """(j, 3) positions and (j,) charges of the others in formation."""
        others = self.others
        return others.position_m[others.formed], others.charge[others.formed]

    # for the flight

    def flown_by_others(self, *phases: Phase) -> Rows:
        """(j,) rows of the vehicles of received stations in one of these phases."""
        return np.flatnonzero(self._received & self._in_phase(phases))

    def _in_phase(self, phases: Collection[Phase]) -> Mask:
        """(k,) those in one of these phases."""
        meant = np.zeros(len(PHASES), np.bool_)
        meant[[PHASE_CODE[phase] for phase in phases]] = True
        return np.asarray(meant[self.site.phases])

    @property
    def _received(self) -> Mask:
        """(k,) those of stations that are received."""
        here = np.zeros(len(self.site.names) + 1, np.bool_)  # the last: no station flies it
        here[[self.site.stations[name].number for name in self.present()]] = True
        return np.asarray(here[self.site.owner])

    @property
    def lead_runs(self) -> bool:
        """Whether another station leads, is received, and has seen the whole formation assembled."""
        lead = self.site.lead
        return not lead.leads and self.lead_is_here and self.show_of(lead.name) is ShowPhase.RUNNING

    def closed(self) -> tuple[Array, Array]:
        """(m, 2, 3) paths of those that are lost, and (m,) the uncertainty of each."""
        segments_m, segments_of = self.site.closed(self.flight.newest.state.time_s)
        return segments_m, self.others.uncertainty_m[segments_of]

    def closing(self) -> frozenset[VehicleId]:
        """Those that are lost."""
        return frozenset(
            self.site.ids[row] for row in self.site.lost_rows(self.flight.newest.state.time_s).tolist()
        )

    def airborne_m(self) -> dict[VehicleId, tuple[Array, Array]]:
        """(3,) position and velocity of those in the air, show frame."""
        others = self.others
        rows = np.flatnonzero(others.airborne).tolist()
        return {others.ids[row]: (others.position_m[row], others.velocity_m_s[row]) for row in rows}

    def landing_m(self) -> Array:
        """(j, 2) where they stand on the ground, or come down."""
        if self._landing_m is None:
            self._landing_m = self._landing_now_m()
        return self._landing_m

    def _landing_now_m(self) -> Array:
        lands = ~self.others.airborne | (self.site.phases == PHASE_CODE[Phase.LANDING])
        places_m = self.others.position_m[lands, :2]
        return np.asarray(places_m[np.isfinite(places_m).all(axis=1)])

    def beside_pads_m(self, least_m: float) -> Array:
        """(j, 2) where they stand on the ground, farther than `least_m` from their pads."""
        away_m = np.linalg.norm((self.others.position_m - self.site.home_m)[:, :2], axis=1)
        return np.asarray(self.others.position_m[~self.others.airborne & (away_m > least_m), :2])

    def taken_m(self, besides: Returning) -> Array:
        """(j, 2) places where another vehicle must not land: pads and stands of all but `besides`."""
        home_m = self.site.home_m[:, :2].copy()
        home_m[besides.rows] = nan
        return np.concatenate([home_m[np.isfinite(home_m).all(axis=1)], self.landing_m()])

    def placed(self) -> Placed:
        """Vehicles that only other stations receive, for the distances between pads."""
        site, others = self.site, self.others
        owners, own = site.owners, set(site.own_ids)
        rows = [row for row, name in enumerate(owners) if name and site.ids[row] not in own]
        names = tuple(f"{site.ids[row]} of station {owners[row]}" for row in rows)
        return Placed(names, others.position_m[rows, :2], others.uncertainty_m[rows])

    @property
    def intakes(self) -> Sequence[Intake]:
        return self.bus.intakes

    @property
    def delay_s(self) -> float:
        """Greatest one-way delay of a received station."""
        numbers = [self.site.stations[name].number for name in self.present()]
        return max((self.site.delays.one_way_s(number) for number in numbers), default=0.0)

    # changes

    def post(self, station: str, body: dict[str, Any]) -> None:
        """Send a request or answer to one station. Raises: LinkError when too many wait."""
        self.letters[station].post(body, self.flight.newest.state.time_s)

    def refuse(self, station: str, refusal: Refusal) -> None:
        """Log why a change that a station asked for is not made, and have that station log it as well."""
        extra = {"other": self.site.own, "change": refusal.change, "by": refusal.by, "reason": refusal.reason}
        log.warning("refused_by_lead", extra=extra)
        with suppress(LinkError):  # as many wait as may: that station is hardly received
            self.post(station, REQUEST.dump_python(refusal, mode="json"))

    def note_change(self) -> int:
        """Note that this station asks the lead for a change of the plan. Returns: its number."""
        self._changes += 1
        self._changed_s = self.flight.newest.state.time_s
        return self._changes
