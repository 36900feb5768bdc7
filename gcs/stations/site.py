"""What one station knows of the others: their vehicles at the time of a tick, and the lead's formation."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gcs.control.inputs import FormationState
from gcs.control.others import Others
from gcs.formation.law import turned
from gcs.model.errors import LinkError
from gcs.model.state import Array, Mask, VehicleId, freeze
from gcs.stations.delays import Delays
from gcs.stations.lead import SiteLead
from gcs.stations.messages import (
    EPOCH_MAX,
    BatchHead,
    Codes,
    Echo,
    FormationMessage,
    SlotsMessage,
    VelocitiesMessage,
    decode_batch,
    decode_homes,
    site_number,
)
from gcs.stations.reported_vehicles import (
    HAS_NO_LINK,
    NO_STATION,
    ReportedVehicles,
    Rows,
    at_time,
    take,
)
from gcs.stations.space_without_control import SpaceWithoutControl, WithoutControl

LOST_S: Final = 0.5
"""A station without a batch for this time is lost: its vehicles are without control until they are seen."""


LED_S: Final = 0.25
"""Velocities that the lead computes for all are flown for this time; then the vehicles hold."""

SHARES_S: Final = 0.3
"""Two stations count on each other's share of keeping apart while each has a batch of the other no older than
this; else each gives way completely.
"""


@dataclass(frozen=True, slots=True)
class StationFleet:
    """The vehicles of one station, in the order of its rows: its own, then those that it stands by for."""

    ids: tuple[VehicleId, ...]
    charge: tuple[float, ...]
    standby: int = 0  # so many at the end are another station's until this one takes them over


@dataclass(slots=True)
class Station:
    """The newest that arrived of one other station. Times are those of the own clock."""

    number: int  # place among the site's stations
    rows: Rows  # (m,) of its vehicles among the others'
    batch: BatchHead | None = None
    arrived_s: float = -np.inf
    made_s: float = -np.inf  # of the batch, as far as the delay is known
    ours_age_s: float = np.inf  # of the own newest batch that it had then
    homes: tuple[bytes, bytes] = (
        b"",
        b"",
    )  # the newest message of homes, and the owners of these vehicles then


@dataclass(slots=True)
class _Led:
    """The newest messages of the lead."""

    message: FormationMessage | None = None
    made_s: float = -np.inf
    place: dict[int, tuple[float, Array]] = field(default_factory=dict)  # by station: made when, (m, 3)
    at_rest: Array | None = None  # (n + k, 3) all of them, while none arrives and nothing spins
    velocity_m_s: tuple[float, Array] | None = None  # made when, (n, 3) of the own vehicles


class Site:
    """The stations of one site, as one of them knows them.

    Attributes:
        ids: (k,) vehicles of the other stations, each once.
        known: what they report, rows of `ids`; to be read only.
        home_m: (k, 3) where they took off, show frame; NaN: not known.
        homes_m: (k,) the same, one by one; None: not known.
        owned: (n,) which of the own rows this station flies.
        epochs: (n,) of that ownership; a setpoint of an older epoch never leaves.
    """

    def __init__(self, own: str, fleets: Mapping[str, StationFleet], without_control: WithoutControl) -> None:
        """`fleets`: all stations in the site's order, `own` among them."""
        names = list(fleets)
        self.own, self.number = own, names.index(own)
        self.names = tuple(names)
        self._owner_names = np.array([*names, ""], object)  # by number: the last of NO_STATION
        self.site = site_number({name: fleet.ids for name, fleet in fleets.items()})
        self.lead = SiteLead(own, self.names)
        self.delays = Delays(len(names))
        self.refused = 0  # messages that are damaged, of another version, or of another site
        self._without_control = without_control
        self.sequence = 0
        self._led = _Led()
        others = {name: fleet for name, fleet in fleets.items() if name != own}
        charge = {
            vehicle_id: share
            for fleet in others.values()
            for vehicle_id, share in zip(fleet.ids, fleet.charge, strict=True)
        }
        self.ids: tuple[VehicleId, ...] = tuple(charge)
        row_of = {name: row for row, name in enumerate(self.ids)}
        self.stations = {
            name: Station(
                names.index(name), np.array([row_of[vehicle_id] for vehicle_id in fleet.ids], dtype=np.intp)
            )
            for name, fleet in others.items()
        }
        self._charge = np.array(list(charge.values()))
        freeze(self._charge, (len(charge),), "charge")
        mine = fleets[own]
        self.own_ids = mine.ids
        n, k = len(mine.ids), len(self.ids)
        self.count = k
        self._home_count = n - mine.standby
        self.owned = np.arange(n) < self._home_count
        self.epochs = self.owned.astype(np.uint8)
        shared = [(row, row_of[name]) for row, name in enumerate(mine.ids) if name in row_of]
        self._own_rows = np.array([row for row, _ in shared], dtype=np.intp)  # that others know as well
        self._their_rows = np.array([row for _, row in shared], dtype=np.intp)  # the same vehicles
        self._all_rows = np.arange(n + k)
        self._only_elsewhere = n + np.setdiff1d(np.arange(k), self._their_rows)
        self.known = ReportedVehicles.unknown(k)
        self.home_m = np.full((k, 3), np.nan)
        self._uncontrolled = SpaceWithoutControl(self.ids, self.known, self.home_m, without_control)
        self.homes_m: list[Array | None] = [None] * k

    # received

    def receive(self, sender: str, topic: str, payload: bytes, arrived_s: float) -> None:
        """Take the newest message of a topic; one that is not valid is counted and dropped."""
        station = self.stations.get(sender)
        if station is None:
            self.refused += 1
            return
        try:
            if topic == "states":
                self._take_batch(station, payload, arrived_s)
            elif topic == "formation":
                self._take_formation(station, FormationMessage.decode(payload), arrived_s)
            elif topic == "homes":
                self._take_homes(station, payload)
            elif topic.startswith("slots."):
                self._take_slots(
                    station, topic.removeprefix("slots."), SlotsMessage.decode(payload), arrived_s
                )
            elif topic == f"velocities.{self.own}":
                self._take_velocities(station, VelocitiesMessage.decode(payload), arrived_s)
        except LinkError:
            self.refused += 1

    def _take_batch(self, station: Station, payload: bytes, arrived_s: float) -> None:
        batch, wire = decode_batch(payload)
        if batch.site != self.site or len(wire) != len(station.rows):
            raise LinkError("a batch of another site")
        self.lead.observe(batch.term, batch.lead)
        station.ours_age_s = np.inf
        for echo in batch.echoes:
            if echo.station == self.number:
                station.ours_age_s = echo.held_s
                self.delays.echoed(station.number, echo.sequence, echo.held_s, arrived_s)
        made_s = arrived_s - self.delays.one_way_s(station.number)
        station.batch, station.arrived_s, station.made_s = batch, arrived_s, made_s
        reported = self.known
        take(reported, station.rows, wire, station.number, made_s)
        if len(self._own_rows):
            lost = reported.epochs[self._their_rows] > self.epochs[self._own_rows]
            self.owned[self._own_rows[lost]] = False
            self._take_back()
        self._uncontrolled.forget_seen(arrived_s)

    def _take_back(self) -> None:
        """Own again the vehicles of this station that a standby has given back."""
        back = ~self.owned[self._own_rows] & (self._own_rows < self._home_count)
        back &= (self.known.owner[self._their_rows] == NO_STATION) & (
            self.known.epochs[self._their_rows] < EPOCH_MAX
        )
        rows = self._own_rows[back]
        self.epochs[rows] = self.known.epochs[self._their_rows[back]] + 1
        self.owned[rows] = True

    def _take_homes(self, station: Station, payload: bytes) -> None:
        home_m = decode_homes(payload)
        if len(home_m) != len(station.rows):
            raise LinkError(f"homes of {len(home_m)} vehicles")
        owner = self.known.owner[station.rows]
        if station.homes == (newest := (payload, owner.tobytes())):
            return  # they come again and again
        station.homes = newest
        changed = np.isin(owner, (NO_STATION, station.number)) & np.isfinite(home_m[:, 0])
        changed &= (self.home_m[station.rows] != home_m).any(axis=1)
        rows = station.rows[changed]
        self.home_m[rows] = home_m[changed]
        for row, one_m in zip(rows.tolist(), home_m[changed], strict=True):
            self.homes_m[row] = one_m

    def _take_formation(self, station: Station, message: FormationMessage, arrived_s: float) -> None:
        self._check_lead(station, message.site, message.term, message.lead)
        self._led.message = message
        self._led.made_s = arrived_s - self.delays.one_way_s(station.number)

    def _take_slots(self, station: Station, name: str, message: SlotsMessage, arrived_s: float) -> None:
        self._check_lead(station, message.site, message.term, message.lead)
        count = len(self.own_ids) if name == self.own else 0
        if name in self.stations:
            count = len(self.stations[name].rows)
        if len(message.place) != count or name not in self.names:
            raise LinkError(f"slots for {len(message.place)} vehicles of {name}")
        made_s = arrived_s - self.delays.one_way_s(station.number)
        self._led.place[self.names.index(name)] = made_s, message.place
        self._led.at_rest = None

    def _take_velocities(self, station: Station, message: VelocitiesMessage, arrived_s: float) -> None:
        self._check_lead(station, message.site, message.term, message.lead)
        if len(message.velocity_m_s) != len(self.own_ids):
            raise LinkError(f"velocities for {len(message.velocity_m_s)} vehicles of {self.own}")
        made_s = arrived_s - self.delays.one_way_s(station.number)
        self._led.velocity_m_s = made_s, message.velocity_m_s

    def _check_lead(self, station: Station, site: int, term: int, lead: int) -> None:
        """Raises: LinkError unless the message is of this site, and of the lead that is obeyed."""
        if site != self.site or lead != station.number:
            raise LinkError("a message of another site, or in the name of another station")
        self.lead.observe(term, lead)
        if not self.lead.obeys(term, lead):
            raise LinkError(f"station {self.names[lead]} does not lead")

    # known

    @property
    def phases(self) -> Codes:
        """(k,) Places in PHASES."""
        return self.known.phases

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
        """All vehicles of the other stations at `now_s`: once a tick."""
        reported, age_max_s = self.known, self._without_control.telemetry_age_max_s
        here = np.zeros(len(self.names) + 1, np.bool_)  # the last: no station flies it
        shares, pace = here.copy(), 1.0
        for name in self.present(now_s):
            station = self.stations[name]
            here[station.number] = True
            shares[station.number] = max(now_s - station.arrived_s, station.ours_age_s) <= SHARES_S
            if station.batch is not None:
                pace = min(pace, station.batch.pace)
        age_s = now_s - reported.measured_s
        self._uncontrolled.note(age_s, now_s, ~here[reported.owner])
        position_m, uncertainty_m, unfiltered_m_s, filtered_m_s, airborne, formed, without = at_time(
            reported, self._mine, here, shares, now_s, age_max_s
        )
        paths, owners, drift = self._uncontrolled.paths(np.flatnonzero(without), age_s)
        return Others(
            self.ids,
            position_m,
            reported.velocity_m_s.copy(),
            unfiltered_m_s,
            filtered_m_s,
            uncertainty_m,
            self._charge,
            airborne,
            formed,
            reported.slot_stays.copy(),
            paths,
            owners,
            drift,
            pace,
        )

    @property
    def _mine(self) -> Mask:
        """(k,) those that this station flies itself."""
        mine = np.zeros(self.count, np.bool_)
        mine[self._their_rows] = self.owned[self._own_rows]
        return mine

    def _without(self, now_s: float) -> Mask:
        """(k,) those without control."""
        no_station = np.zeros(len(self.names) + 1, np.bool_)
        age_max_s = self._without_control.telemetry_age_max_s
        return at_time(self.known, self._mine, no_station, no_station, now_s, age_max_s)[-1]

    def lost_rows(self, now_s: float) -> Rows:
        """Those without control that are lost, and not only silent: with their station at once."""
        rows: Rows = np.flatnonzero(self._without(now_s))
        if len(rows) == 0:
            return rows
        age_s = now_s - self.known.measured_s[rows]
        lost = HAS_NO_LINK[self.phases[rows]] | (age_s >= self._without_control.silence_s)
        lost |= np.isin(self.known.owner[rows], [self.stations[name].number for name in self.lost(now_s)])
        return rows[lost]

    def closed(self, now_s: float) -> tuple[Array, Rows]:
        """(m, 2, 3) all paths that lost vehicles may take until they are seen again, and (m,) their rows."""
        return self._uncontrolled.closed(self.lost_rows(now_s))

    def formation(self, now_s: float, silent_s: float) -> FormationState | None:
        """The lead's formation at `now_s`, rows: the own vehicles, then the others'.

        None: this station leads, or nothing has arrived of the lead for `silent_s`.
        """
        led = self._led
        if self.lead.leads or led.message is None or now_s - led.made_s > silent_s:
            return None
        if not self.lead.obeys(led.message.term, led.message.lead):
            return None
        message, place = led.message, led.at_rest
        if place is None or message.spin_rad_s:
            place = self._placed(message.spin_rad_s, now_s)
            led.at_rest = None if message.spin_rad_s else place
        age_s = max(now_s - led.made_s, 0.0)
        center = None if message.center is None else message.center.later(age_s)
        led_m_s = self._led_m_s(now_s)
        return FormationState(center, message.radius_m, message.spin_rad_s, message.sides, place, led_m_s)

    def _led_m_s(self, now_s: float) -> Array | None:
        """(n + k, 3) velocities of the own vehicles that the lead computed; None: none that count."""
        newest = self._led.velocity_m_s
        if newest is None or now_s - newest[0] > LED_S:
            return None
        led_m_s = np.full((len(self.own_ids) + self.count, 3), np.nan)
        led_m_s[: len(self.own_ids)] = newest[1]
        return led_m_s

    def _placed(self, spin_rad_s: float, now_s: float) -> Array:
        """(n + k, 3) the newest slots of all vehicles, turned on to `now_s`."""
        n = len(self.own_ids)
        place = np.full((n + self.count, 3), np.nan)
        for number, (made_s, slots) in self._led.place.items():
            name = self.names[number]
            rows = np.arange(n) if name == self.own else self.stations[name].rows + n
            has_slot = np.isfinite(slots[:, 0])
            turn_rad = spin_rad_s * max(now_s - made_s, 0.0)
            place[rows[has_slot]] = turned(slots[has_slot], turn_rad) if turn_rad else slots[has_slot]
        return place

    def plan_version(self) -> int | None:
        """Version of the plan that the lead flies; None: not known."""
        return None if self._led.message is None else self._led.message.plan

    # ownership

    @property
    def shown(self) -> Rows:
        """Rows of a display, each vehicle once: of the n own rows and the k others' after them."""
        if len(self._own_rows) == 0:
            return self._all_rows
        n = len(self.own_ids)
        rows = self._all_rows[:n].copy()
        elsewhere = ~self.owned[self._own_rows]
        rows[self._own_rows[elsewhere]] = n + self._their_rows[elsewhere]
        return np.concatenate([rows, self._only_elsewhere])

    def known_home_m(self, row: int) -> Array | None:
        """(3,) where the vehicle of an own row took off, as its station reported it."""
        at = np.flatnonzero(self._own_rows == row)
        if len(at) == 0 or not np.isfinite(self.home_m[self._their_rows[at[0]]]).all():
            return None
        return np.asarray(self.home_m[self._their_rows[at[0]]].copy())

    @property
    def owner(self) -> Rows:
        """(k,) Number of the station that flies each of the others' vehicles; NO_STATION: none is known."""
        return self.known.owner

    @property
    def owners(self) -> list[str]:
        """(k,) Name of that station; empty: none is known."""
        names: list[str] = self._owner_names[self.known.owner].tolist()
        return names

    def take_over(self, station: str) -> list[VehicleId]:
        """Own from now on the vehicles of that station that this one stands by for. Returns: them."""
        taken = np.isin(self.known.owner[self._their_rows], (NO_STATION, self.names.index(station)))
        rows = self._own_rows[taken & ~self.owned[self._own_rows]]
        before = np.zeros(len(self.own_ids), np.uint8)
        before[self._own_rows] = self.known.epochs[self._their_rows]
        self.epochs[rows] = np.minimum(np.maximum(self.epochs[rows], before[rows]), EPOCH_MAX - 1) + 1
        self.owned[rows] = True
        at = self._their_rows[np.isin(self._own_rows, rows)]
        self.known.owner[at], self.known.epochs[at] = (
            self.number,
            self.epochs[self._own_rows[np.isin(self._own_rows, rows)]],
        )
        return [self.own_ids[row] for row in rows.tolist()]

    def give_back(self, ids: Collection[VehicleId]) -> None:
        """Own these no longer, although no other station claims them: their station owns them again."""
        rows = np.array([row for row, name in enumerate(self.own_ids) if name in ids], dtype=np.intp)
        self.owned[rows] = False

    # sent

    def next_sequence(self, now_s: float) -> tuple[int, tuple[Echo, ...]]:
        """Number of the next batch, and the echoes that it carries."""
        self.sequence += 1
        self.delays.sent(self.sequence, now_s)
        echoes = tuple(
            Echo(station.number, station.batch.sequence, now_s - station.arrived_s)
            for station in self.stations.values()
            if station.batch is not None and now_s - station.arrived_s <= LOST_S
        )
        return self.sequence, echoes
