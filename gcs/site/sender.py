"""What a station sends the other stations of its site: its state once a tick, and what else is due."""

import json
import logging
from collections.abc import Callable, Mapping, Sequence
from math import inf, nan
from operator import is_
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gcs.bus import Bus
from gcs.bus.interface import PAYLOAD_MAX
from gcs.control import Tick
from gcs.flight.monitors.snapshots import measured
from gcs.flight.state.flight import Flight
from gcs.flight.state.start_hashes import parameters_hash
from gcs.links import ParameterValue
from gcs.model.interrupted_flight import Offer
from gcs.model.lifecycle import Phase
from gcs.model.plan import Plan, plan_json
from gcs.model.state import Array, Mask, Mode
from gcs.model.vehicle_columns import SENT
from gcs.planning.return_paths.paths import ReturnPaths
from gcs.site.agreement import rules_of
from gcs.site.led_show import ShowTraffic
from gcs.stations.letters import Letters
from gcs.stations.messages import MODE_CODE, PHASE_CODE, Codes, encode_homes
from gcs.stations.publishing import STATES, FormationMessages, Reported, batch
from gcs.stations.reported_vehicles import Rows
from gcs.stations.return_messages import ReturnMessage, in_parts
from gcs.stations.site import Site

log = logging.getLogger(__name__)

SLOWLY_S: Final = 0.5
"""Interval between two messages of what rarely changes: the plan, pads, texts."""

UNCHANGED_S: Final = 2.0
"""The same message of what rarely changes is sent again after this time."""

TEXTS_MAX: Final = 200
"""Vehicles of which reasons are sent: those in a phase that needs an explanation."""

RETURNS_OF_A_TERM: Final = 10_000
RETURN_SENT_S: Final = 4.0
"""The paths of a return are repeated for this time."""

WHY_LENGTH: Final = 400
NOT_CHECKED: Final = "it has not reported yet whether its vehicles are ready"

EXPLAINED: Final = frozenset({Phase.LOST, Phase.PILOT, Phase.KILLED, Phase.OFFLINE})


class SiteSender:
    """Used on the event loop only; nothing here waits."""

    def __init__(
        self, flight: Flight, site: Site, bus: Bus, letters: Mapping[str, Letters], shows: ShowTraffic
    ) -> None:
        self.flight, self.site, self.bus = flight, site, bus
        self.plan_version = 0  # of the plan that is flown
        self.offers: tuple[Offer, ...] = ()  # of this station's interrupted flight
        self._letters, self._shows = letters, shows
        self._formation = FormationMessages(site)
        self._messages: dict[str, bytes] = {}  # of this tick, by topic
        self._columns: dict[str, tuple[Sequence[Any], NDArray[Any]]] = {}  # what changes rarely, encoded
        self._homes: tuple[list[Array | None], bytes] | None = None  # pads, and the same encoded
        self._sent_texts: dict[str, bytes] = {}  # newest message of what rarely changes, by topic
        self._again_s: dict[str, float] = {}  # when it is sent again, unchanged
        self._sent_plan: Plan | None = None
        self._plan_due_s = self._slow_due_s = self._return_due_s = 0.0
        self._applied: dict[str, int] = {}  # newest change of each station that this lead has applied
        self._why_not_ready = NOT_CHECKED  # why this station could not start now; empty: it could
        self._ready_when_checked: tuple[bool, ...] = ()
        self._checked_s = -inf
        self._rules = rules_of(flight.config)
        self._parameters: tuple[list[Mapping[str, ParameterValue]], str] = [], ""  # as read, and their hash
        self._planned = 0  # returns that this station planned
        self._return_s = nan  # time in the plan of the present return, as flown
        self._return_parts: list[tuple[str, bytes]] = []
        self._return_until_s = 0.0

    def publish(self, result: Tick, *, all_up: bool, leads: bool) -> None:
        """Send this tick's state, and what else is due; called once a tick, after the setpoints.

        Args:
            result: of the tick.
            all_up: no vehicle climbs, or waits for its turn.
            leads: send formation, plan and show as well.
        """
        flight, site, now_s = self.flight, self.site, self.flight.newest.state.time_s
        memory = result.memory
        reported = self._reported(all_up=all_up)
        tasks = flight.last_tasks
        made = batch(site, flight.seen(), tasks, flight.newest.traits.uncertainty_m, memory, reported)
        if now_s >= self._slow_due_s:
            self._slow_due_s = now_s + SLOWLY_S
            self._send_anew("homes", self._encoded_homes())
            self._send_anew("info", self._info_now())
        self._send(STATES, made.encode())
        if leads:
            for topic, payload in self._formation.of_tick(now_s, memory, reported):
                self._send(topic, payload)
            self._publish_plan(now_s)
            for topic, payload in self._shows.messages(now_s):
                self._send(topic, payload)
        else:
            self._formation.forget()
        for name, letters in self._letters.items():
            if (due := letters.payload(now_s)) is not None:
                self._send(f"letters.{name}", due)
        if now_s >= self._return_due_s and now_s < self._return_until_s:
            self._return_due_s = now_s + SLOWLY_S
            for topic, payload in self._return_parts:
                self._send(topic, payload)
        self.bus.publish(self._messages)
        self._messages = {}

    def _encoded_homes(self) -> bytes:
        """Pads of the vehicles; encoded again only when one of them took off from another."""
        home_m = [vehicle.home_m for vehicle in self.flight.vehicles.values()]
        if self._homes is None or not all(map(is_, home_m, self._homes[0])):
            nowhere = np.full(3, nan)
            encoded = encode_homes(np.array([nowhere if pad_m is None else pad_m for pad_m in home_m]))
            self._homes = home_m, encoded
        return self._homes[1]

    def _send_anew(self, topic: str, payload: bytes) -> None:
        """Send what has changed; the same again for stations that missed it."""
        now_s = self.flight.newest.state.time_s
        if self._sent_texts.get(topic) == payload and now_s < self._again_s.get(topic, -inf):
            return
        self._sent_texts[topic], self._again_s[topic] = payload, now_s + UNCHANGED_S
        self._send(topic, payload)

    def _send(self, topic: str, payload: bytes) -> None:
        if len(payload) > PAYLOAD_MAX:
            why = f"{len(payload)} bytes where {PAYLOAD_MAX} are possible"
            log.warning("not_published", extra={"topic": topic, "reason": why})
        else:
            self._messages[topic] = payload

    def _publish_plan(self, now_s: float) -> None:
        plan = self.flight.in_force.plan
        if plan is not self._sent_plan:
            self.plan_version += 1
            self._sent_plan, self._plan_due_s = plan, 0.0
        if now_s >= self._plan_due_s:
            self._plan_due_s = now_s + SLOWLY_S
            about = {
                "term": self.site.lead.term,
                "version": self.plan_version,
                "applied": self._applied,
            }
            text = f'{json.dumps(about)[:-1]},"plan":{plan_json(plan.moved(-now_s))}}}'
            self._send("plan", text.encode())

    def _info_now(self) -> bytes:
        vehicles = [vehicle for vehicle in self.flight.vehicles.values() if vehicle.phase in EXPLAINED]
        reasons = {vehicle.id: vehicle.reason[:150] for vehicle in vehicles[:TEXTS_MAX]}
        excluded = list(self.flight.excluded.items())[: TEXTS_MAX - len(reasons)]
        reasons |= {name: str(exclusion)[:150] for name, exclusion in excluded if name not in reasons}
        why = self._why_not_ready[:WHY_LENGTH]
        texts = {"why_not_ready": why, "offers": self.offers, "reasons": reasons}
        return json.dumps(texts | {"rules": self._rules, "parameters": self.parameters_hash()}).encode()

    def parameters_hash(self) -> str:
        """Of this station's vehicles; computed again only when those of one of them were read again."""
        values = list(self.flight.parameters.values())
        if len(values) != len(self._parameters[0]) or not all(map(is_, values, self._parameters[0])):
            read = parameters_hash([*self.flight.vehicles], self.flight.parameters)
            self._parameters = values, read
        return self._parameters[1]

    def _reported(self, *, all_up: bool) -> Reported:
        flight, telemetry, numbers = (
            self.flight,
            self.flight.newest.telemetry,
            measured(self.flight.newest, self.flight.link_quality),
        )
        ready = self._column("ready", telemetry.ready, _mask)
        checked = self._column("checked", self._ready_when_checked or (False,), _mask)
        return Reported(
            self._column("phase", flight.vehicles.phases, _phase_codes),
            self._column("mode", telemetry.mode, _mode_codes),
            self._column("armed", telemetry.armed, _mask),
            ready & checked,
            [numbers[name] for name in SENT],
            flight.show.phase,
            all_up,
            self.plan_version,
            self._return_s,
        )

    def _column(
        self, name: str, values: Sequence[Any], encode: Callable[[Sequence[Any]], NDArray[Any]]
    ) -> NDArray[Any]:
        """The values as an array: the same one while they are the same object."""
        kept = self._columns.get(name)
        if kept is None or kept[0] is not values:
            kept = self._columns[name] = values, encode(values)
        return kept[1]

    # notes

    def is_check_due(self, every_s: float, least_s: float) -> bool:
        """Whether readiness must be checked again; after `least_s` where a vehicle became ready."""
        since_s = self.flight.newest.state.time_s - self._checked_s
        changed = self.flight.newest.telemetry.ready != self._ready_when_checked
        return since_s >= every_s or (changed and since_s >= least_s)

    def note_checked(self, why_not_ready: str) -> None:
        """Note why this station's vehicles could not start now; empty: they could.

        A vehicle is published as ready only after a check that saw it ready.
        """
        if why_not_ready != self._why_not_ready:
            self._slow_due_s = 0.0
        self._why_not_ready = why_not_ready
        self._ready_when_checked = tuple(self.flight.newest.telemetry.ready)
        self._checked_s = self.flight.newest.state.time_s

    def note_applied(self, station: str, number: int) -> None:
        """Note, as the lead, that a station's change of the plan is in force, or was refused."""
        self._applied[station] = number
        self._plan_due_s = 0.0

    def note_return(self, time_s: float) -> None:
        """Note the time in the plan of the return, for the other stations."""
        self._return_s = time_s

    def publish_paths(self, paths: ReturnPaths, rows: Rows, home_m: Array) -> None:
        """Send (j,) vehicles, the last of the plan, their paths home."""
        site, first = self.site, len(paths.over_s) - len(rows)
        self._planned += 1
        number = site.lead.term * RETURNS_OF_A_TERM + self._planned
        planned = ~np.isin(np.arange(len(paths.over_s)), paths.unplanned)
        self._return_parts = []
        for name, station in site.stations.items():
            of_station = {row: at for at, row in enumerate(station.rows.tolist())}
            mine = np.array([at for at, row in enumerate(rows.tolist()) if row in of_station], dtype=np.intp)
            station_of = np.array([of_station[row] for row in rows[mine].tolist()], dtype=np.intp)
            at = mine + first
            whole = ReturnMessage(
                number,
                station_of,
                paths.drawn_m[at],
                paths.path_m[at],
                home_m[mine],
                paths.over_s[at],
                paths.down_s[at],
                planned[at],
            )
            for part, message in enumerate(in_parts(whole)):
                self._return_parts.append((f"return.{name}.{part}", message.encode()))
        self._return_until_s = self.flight.newest.state.time_s + RETURN_SENT_S
        self._return_due_s = 0.0


def _phase_codes(phases: Sequence[Phase]) -> Codes:
    return np.array([PHASE_CODE[phase] for phase in phases], np.uint8)


def _mode_codes(modes: Sequence[Mode]) -> Codes:
    return np.array([MODE_CODE[mode] for mode in modes], np.uint8)


def _mask(flags: Sequence[bool]) -> Mask:
    return np.array(flags, np.bool_)
