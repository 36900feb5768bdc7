"""What one station knows of the others: their vehicles at the time of a tick, and the lead's formation."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.control.inputs import FormationState
from gcs.control.others import Others
from gcs.estimation.fleet_state import FORWARD_MAX_S
from gcs.formation.law import turned
from gcs.model.errors import LinkError
from gcs.model.lifecycle import Phase
from gcs.model.state import Array, VehicleId
from gcs.planning.lost_space import ALIKE_M_S, STOP_S, expected_drift, silent_segments_m, swept_segments_m
from gcs.stations.delays import Delays
from gcs.stations.lead import Lead
from gcs.stations.messages import (
    PHASE_CODE,
    Codes,
    Echo,
    FormationMessage,
    SlotsMessage,
    StateBatch,
    site_number,
)

KILLED: Final = PHASE_CODE[Phase.KILLED]
WITHOUT_LINK: Final = (PHASE_CODE[Phase.LOST], KILLED)
"""Phases of vehicles that their own station does not command, and whose space others keep clear."""

LOST_S: Final = 0.5
"""A station without a batch for this time is lost: its vehicles are without control until they are seen."""


@dataclass(frozen=True, slots=True)
class StationFleet:
    """The vehicles of one station, in the order of their rows."""

    ids: tuple[VehicleId, ...]
    charge: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class WithoutControl:
    """What vehicles do that no station commands; as configured for the whole site."""

    action: str = "return"  # see `swept_segments_m`
    return_height_m: float = 30.0
    takeoff_height_m: float = 10.0
    noticed_s: float = 1.0  # COM_OF_LOSS_T
    silence_s: float = 2.0  # a vehicle is lost after it
    watchdog_s: float = 0.2  # how long setpoints outlive their tick
    telemetry_age_max_s: float = 0.5  # a vehicle with an older position is not commanded

    @property
    def drift_s(self) -> float:
        """How long a vehicle without commands may keep its last velocity, its stop included."""
        return self.watchdog_s + self.noticed_s + STOP_S


@dataclass(slots=True)
class Station:
    """The newest that arrived of one other station. Times are those of the own clock."""

    number: int  # place among the site's stations
    rows: slice  # of its vehicles among the others'
    batch: StateBatch | None = None
    arrived_s: float = -np.inf
    made_s: float = -np.inf  # of the batch, as far as the delay is known


@dataclass(slots=True)
class _Led:
    """The newest messages of the lead."""

    message: FormationMessage | None = None
    made_s: float = -np.inf
    place: dict[int, tuple[float, Array]] = field(default_factory=dict)  # by station: made when, (n, 3)


class Site:
    """The stations of one site, as one of them knows them."""

    def __init__(self, own: str, fleets: Mapping[str, StationFleet], without_control: WithoutControl) -> None:
        """`fleets`: all stations in the site's order, `own` among them."""
        names = list(fleets)
        self.own, self.number = own, names.index(own)
        self.names = tuple(names)
        self.site = site_number({name: fleet.ids for name, fleet in fleets.items()})
        self.lead = Lead(own, self.names)
        self.delays = Delays(len(names))
        self.refused = 0  # messages that are damaged, of another version, or of another site
        self._without_control = without_control
        self._sequence = 0
        self._led = _Led()
        self.stations: dict[str, Station] = {}
        others = [(name, fleet) for name, fleet in fleets.items() if name != own]
        begin = 0
        for name, fleet in others:
            self.stations[name] = Station(names.index(name), slice(begin, begin + len(fleet.ids)))
            begin += len(fleet.ids)
        self._own_count = len(fleets[own].ids)
        self.ids: tuple[VehicleId, ...] = tuple(one for _, fleet in others for one in fleet.ids)
        self._charge = np.array([charge for _, fleet in others for charge in fleet.charge])
        k = self.count = len(self.ids)
        self._position_m, self._velocity_m_s = np.full((k, 3), np.nan), np.full((k, 3), np.nan)
        self._desired_m_s = np.full((k, 3), np.nan)
        self._uncertainty_m = np.zeros(k)
        self._measured_s, self._made_s = np.full(k, -np.inf), np.full(k, -np.inf)
        self.phases: Codes = np.full(k, PHASE_CODE[Phase.OFFLINE], np.uint8)  # places in PHASES
        self._airborne, self._formed = np.zeros(k, np.bool_), np.zeros(k, np.bool_)
        self._slot_stays = np.zeros(k, np.bool_)
        self.home_m = np.full((k, 3), np.nan)
        self._swept: dict[int, Array] = {}  # of rows whose paths do not change any more

    # received

    def receive(self, sender: str, topic: str, payload: bytes, arrived_s: float) -> None:
        """Take the newest message of a topic; one that is not valid is counted and dropped."""
        station = self.stations.get(sender)
        if station is None:
            self.refused += 1
            return
        try:
            if topic == "states":
                self._take_batch(station, StateBatch.decode(payload), arrived_s)
            elif topic == "formation":
                self._take_formation(station, FormationMessage.decode(payload), arrived_s)
            elif topic.startswith("slots."):
                self._take_slots(
                    station, topic.removeprefix("slots."), SlotsMessage.decode(payload), arrived_s
                )
        except LinkError:
            self.refused += 1

    def _take_batch(self, station: Station, batch: StateBatch, arrived_s: float) -> None:
        rows = station.rows
        if batch.site != self.site or len(batch.position_m) != rows.stop - rows.start:
            raise LinkError("a batch of another site")
        self.lead.observe(batch.term, batch.lead)
        for echo in batch.echoes:
            if echo.station == self.number:
                self.delays.echoed(station.number, echo.sequence, echo.held_s, arrived_s)
        made_s = arrived_s - self.delays.one_way_s(station.number)
        station.batch, station.arrived_s, station.made_s = batch, arrived_s, made_s
        known = np.isfinite(batch.position_m).all(axis=1)
        at = np.flatnonzero(known) + rows.start
        self._position_m[at] = batch.position_m[known]
        self._velocity_m_s[at] = batch.velocity_m_s[known]
        self._desired_m_s[at] = batch.desired_m_s[known]
        self._made_s[rows] = made_s
        self._measured_s[rows] = made_s - batch.age_s
        self._uncertainty_m[rows] = batch.uncertainty_m
        self.phases[rows] = batch.phases
        self._airborne[rows], self._formed[rows] = batch.airborne, batch.formed
        self._slot_stays[rows] = batch.slot_stays
        for row in [row for row in self._swept if rows.start <= row < rows.stop]:
            if self.phases[row] not in WITHOUT_LINK:
                del self._swept[row]

    def _take_formation(self, station: Station, message: FormationMessage, arrived_s: float) -> None:
        self._check_lead(station, message.site, message.term, message.lead)
        self._led.message = message
        self._led.made_s = arrived_s - self.delays.one_way_s(station.number)

    def _take_slots(self, station: Station, name: str, message: SlotsMessage, arrived_s: float) -> None:
        self._check_lead(station, message.site, message.term, message.lead)
        count = self._own_count if name == self.own else 0
        if name in self.stations:
            rows = self.stations[name].rows
            count = rows.stop - rows.start
        if len(message.place) != count or name not in self.names:
            raise LinkError(f"slots for {len(message.place)} vehicles of {name}")
        made_s = arrived_s - self.delays.one_way_s(station.number)
        self._led.place[self.names.index(name)] = made_s, message.place

    def _check_lead(self, station: Station, site: int, term: int, lead: int) -> None:
        """Raises: LinkError unless the message is of this site, and of the lead that is obeyed."""
        if site != self.site or lead != station.number:
            raise LinkError("a message of another site, or in the name of another station")
        self.lead.observe(term, lead)
        if not self.lead.obeys(term, lead):
            raise LinkError(f"station {self.names[lead]} does not lead")

    # known

    def lost(self, now_s: float) -> list[str]:
        """Stations of which nothing has arrived for LOST_S, and something had before."""
        return [
            name
            for name, station in self.stations.items()
            if station.batch is not None and now_s - station.arrived_s > LOST_S
        ]

    def present(self, now_s: float) -> list[str]:
        """Other stations of which something has arrived within LOST_S."""
        return [name for name, station in self.stations.items() if now_s - station.arrived_s <= LOST_S]

    def others(self, now_s: float) -> Others:
        """All vehicles of the other stations at `now_s`."""
        age_s = now_s - self._measured_s
        forward_s = np.clip(now_s - self._made_s, 0.0, FORWARD_MAX_S)
        forward_s = np.where(np.isfinite(forward_s), forward_s, 0.0)
        fresh = age_s <= self._without_control.telemetry_age_max_s
        present = np.zeros(self.count, np.bool_)
        pace = 1.0
        for name in self.present(now_s):
            station = self.stations[name]
            present[station.rows] = True
            if station.batch is not None:
                pace = min(pace, station.batch.pace)
        without = (self._airborne & ~fresh) | np.isin(self.phases, WITHOUT_LINK)
        without &= np.isfinite(self._position_m[:, 0])
        paths, owners, drift = self._paths(np.flatnonzero(without), age_s)
        return Others(
            self.ids,
            self._position_m + forward_s[:, None] * self._velocity_m_s,
            self._velocity_m_s.copy(),
            self._uncertainty_m.copy(),
            self._charge.copy(),
            self._airborne.copy(),
            self._formed & fresh & present,
            self._slot_stays.copy(),
            paths,
            owners,
            drift,
            pace,
        )

    def formation(self, now_s: float, silent_s: float) -> FormationState | None:
        """The lead's formation at `now_s`, rows: the own vehicles, then the others'.

        None: this station leads, or nothing has arrived of the lead for `silent_s`.
        """
        led = self._led
        if self.lead.leads or led.message is None or now_s - led.made_s > silent_s:
            return None
        if not self.lead.obeys(led.message.term, led.message.lead):
            return None
        message, place = led.message, np.full((self._own_count + self.count, 3), np.nan)
        for number, (made_s, slots) in led.place.items():
            name = self.names[number]
            rows = slice(0, self._own_count)
            if name != self.own:
                theirs = self.stations[name].rows
                rows = slice(theirs.start + self._own_count, theirs.stop + self._own_count)
            place[rows] = turned(slots, message.spin_rad_s * max(now_s - made_s, 0.0))
        age_s = max(now_s - led.made_s, 0.0)
        center = None if message.center is None else message.center.later(age_s)
        return FormationState(center, message.radius_m, message.spin_rad_s, message.sides, place)

    def plan_version(self) -> int | None:
        """Version of the plan that the lead flies; None: not known."""
        return None if self._led.message is None else self._led.message.plan

    def _paths(
        self, rows: NDArray[np.intp], age_s: Array
    ) -> tuple[Array, NDArray[np.intp], tuple[Array, Array] | None]:
        """(m, 2, 3) paths of vehicles without control, (m,) their rows, and where they drift now."""
        if len(rows) == 0:
            return np.zeros((0, 2, 3)), np.zeros(0, np.intp), None
        found: list[Array] = []
        owners: list[int] = []
        for row in rows.tolist():
            for path_m in self._paths_of(row, float(age_s[row])):
                found.append(path_m)
                owners.append(row)
        drifts = np.zeros(self.count, np.bool_)
        drifts[rows] = self.phases[rows] != KILLED
        expected_m_s = np.where(np.isfinite(self._desired_m_s), self._desired_m_s, self._velocity_m_s)
        drift = expected_drift(
            self._position_m, expected_m_s, age_s, drifts, noticed_s=self._without_control.noticed_s
        )
        return np.array(found).reshape(-1, 2, 3), np.array(owners, dtype=np.intp), drift

    def _paths_of(self, row: int, silent_s: float) -> Array:
        """(m, 2, 3) of one vehicle."""
        kept = self._swept.get(row)
        if kept is not None:
            return kept
        alone, phase = self._without_control, self.phases[row]
        position_m, home_m = self._position_m[row], self.home_m[row]
        home = home_m if np.isfinite(home_m).all() else None
        moves_m_s = [self._velocity_m_s[row]]
        desired_m_s = self._desired_m_s[row]
        if phase != KILLED and np.isfinite(desired_m_s).all():
            differs = np.linalg.norm(desired_m_s - moves_m_s[0]) > ALIKE_M_S
            moves_m_s = [desired_m_s, moves_m_s[0]] if differs else [desired_m_s]
        if silent_s < alone.silence_s and phase not in WITHOUT_LINK:
            parts = [
                silent_segments_m(
                    position_m,
                    each_m_s,
                    home,
                    alone.action,
                    alone.return_height_m,
                    silent_s=silent_s,
                    noticed_s=alone.noticed_s,
                    drift_s=alone.drift_s,
                )
                for each_m_s in moves_m_s
            ]
            return np.concatenate(parts)
        killed = phase == KILLED
        parts = [
            swept_segments_m(
                position_m,
                each_m_s,
                home,
                "land" if killed else alone.action,
                alone.return_height_m,
                climbing_to_m=None if killed else alone.takeoff_height_m,
                drift_s=alone.drift_s,
            )
            for each_m_s in moves_m_s
        ]
        self._swept[row] = swept = np.concatenate(parts)
        return swept

    # sent

    def next_sequence(self, now_s: float) -> tuple[int, tuple[Echo, ...]]:
        """Number of the next batch, and the echoes that it carries."""
        self._sequence += 1
        self.delays.sent(self._sequence, now_s)
        echoes = tuple(
            Echo(station.number, station.batch.sequence, now_s - station.arrived_s)
            for station in self.stations.values()
            if station.batch is not None and now_s - station.arrived_s <= LOST_S
        )
        return self._sequence, echoes
