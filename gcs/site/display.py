"""What displays and the record get of a whole site: the own vehicles, then those of the other stations."""

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gcs.config.schema import Config
from gcs.control import Tick
from gcs.flight.monitors.snapshots import finite
from gcs.model.lifecycle import GROUNDED, Phase
from gcs.model.state import Array, Landed
from gcs.model.vehicle_columns import unknown
from gcs.recording.mcap_layout import packed_state
from gcs.recording.sample import RecordedElsewhere
from gcs.service import BusView, FleetView, StationView
from gcs.site.member import SiteMember
from gcs.site.sender import EXPLAINED
from gcs.stations.messages import MODES, PHASES, numbers_of

RECORDED_S: Final = 1.0
"""Interval at which the vehicles of other stations are recorded: their own stations record every tick."""

_PHASES: Final = np.array([*PHASES], object)
_MODES: Final = np.array([*MODES], object)
_GROUNDED: Final = np.array([phase in GROUNDED for phase in PHASES])
_EXPLAINED: Final = np.array([phase in EXPLAINED | {Phase.STANDBY} for phase in PHASES])  # or excluded
"""By the number of a phase, or mode, on the wire."""

_LANDED: Final = np.array([Landed.ON_GROUND, Landed.IN_AIR], object)


class SiteDisplay:
    """Shows one station's knowledge of the site. Used on the event loop only."""

    def __init__(self, member: SiteMember, site_config: Config) -> None:
        self._member, ids = member, member.site.ids
        system_ids = {vehicle.id: vehicle.system_id for vehicle in site_config.fleet}
        link_of = {vehicle.id: link.name for link in site_config.links for vehicle in link.fleet}
        autopilots = site_config.autopilots
        self._system_ids = [system_ids[name] for name in ids]  # (k,) of the others' vehicles
        self._links = [link_of[name] for name in ids]
        self._autopilots = [autopilots[name] for name in ids]
        self._reasons: list[str] = []  # of the others' vehicles
        self._reasons_of: tuple[object, ...] = ()  # what decided them
        self._recorded: RecordedElsewhere | None = None  # the newest
        self._record_due_s = 0.0

    def stations(self) -> tuple[StationView, ...]:
        """Every station of the site, in its order."""
        member = self._member
        site, now_s = member.site, member.flight.newest.state.time_s
        here = set(member.present())
        owners = site.owners
        views = []
        for number, name in enumerate(site.names):
            own = name == site.own
            station = None if own else site.stations[name]
            silent_s = 0.0 if station is None else now_s - station.arrived_s
            views.append(
                StationView(
                    name,
                    own=own,
                    leads=name == site.lead.name,
                    received=own or name in here,
                    silent_s=silent_s if np.isfinite(silent_s) else None,
                    show=member.flight.show.phase if own else member.show_of(name),
                    vehicles=int(site.owned.sum()) if own else owners.count(name),
                    delay_s=0.0 if own else site.delays.one_way_s(number),
                    term=site.lead.term,
                    offers=member.sender.offers if own else member.texts[name].offers,
                )
            )
        return tuple(views)

    def whole(self, own: FleetView, result: Tick) -> FleetView:
        """The same view with the vehicles of all stations; those of silent ones keep their last values."""
        member = self._member
        site, others = member.site, member.others
        rows = own.rows
        n, k = len(rows.ids), site.count
        reported = site.known
        latitude_deg, longitude_deg, altitude_m = member.flight.config.frame.geodetic(others.position_m)
        whole = replace(rows, stations=[site.own] * n).followed_by(
            {
                "ids": site.ids,
                "system_ids": self._system_ids,
                "links": self._links,
                "autopilots": self._autopilots,
                "phases": _PHASES[site.phases].tolist(),
                "reasons": self._reasons_newest(),
                "modes": _MODES[reported.modes].tolist(),
                "armed": reported.armed.tolist(),
                "landed": _LANDED[others.airborne.astype(np.intp)].tolist(),
                "ready": reported.ready.tolist(),
                "position_m": others.position_m,
                "velocity_m_s": others.velocity_m_s,
                "setpoint_m_s": reported.setpoint_m_s,
                **self._numbers(own.time_s),
                "latitude_deg": latitude_deg,
                "longitude_deg": longitude_deg,
                "altitude_amsl_m": altitude_m,
                "limited_by": [""] * k,
                "colour": np.zeros((k, 3), np.uint8),
                "lit": np.zeros(k, np.bool_),
                "homes_m": site.homes_m,
                "stations": site.owners,
            }
        )
        shown = site.shown
        table = whole if len(shown) == n + k else whole.of(shown)
        elsewhere = np.full(len(shown) - n, np.nan)
        changed: dict[str, Any] = {"rows": table, "stations": self.stations(), "show": member.show}
        changed["bus"] = self._bus()
        changed["minimum_separation_m"] = finite(result.minimum_separation_m)
        if (estimates := own.estimates) is not None:  # of the own vehicles only
            low_s, empty_s = np.append(estimates.low_s, elsewhere), np.append(estimates.empty_s, elsewhere)
            changed["estimates"] = replace(estimates, low_s=low_s, empty_s=empty_s)
        return replace(own, **changed)

    def recorded(self) -> RecordedElsewhere:
        """The vehicles of the other stations for the flight data, anew every RECORDED_S.

        They cost a fraction of their view. Where this station receives some of them as well, they are of
        this tick.
        """
        member, before = self._member, self._recorded
        site, shown, now_s = member.site, member.site.shown, member.flight.newest.state.time_s
        twice = len(shown) < len(site.own_ids) + site.count
        if before is not None and not twice and before.show is member.show and now_s < self._record_due_s:
            return before
        self._record_due_s = now_s + RECORDED_S - 1e-3
        others, reported = member.others, site.known
        columns: dict[str, NDArray[Any]] = {
            "phase": site.phases,
            "mode": reported.modes,
            "landed": np.where(others.airborne, Landed.IN_AIR, Landed.ON_GROUND),
            "armed": reported.armed,
            "ready": reported.ready,
        }
        vectors = others.position_m, others.velocity_m_s, reported.setpoint_m_s
        rows = packed_state(*vectors, self._numbers(now_s), columns)
        reasons = self._reasons_newest()
        self._recorded = RecordedElsewhere(site.ids, rows, reasons, shown if twice else None, member.show)
        return self._recorded

    def _numbers(self, now_s: float) -> dict[str, Array]:
        """(k,) each: what is known of the numbers of the other stations' vehicles."""
        site, others = self._member.site, self._member.others
        age_s = now_s - site.known.measured_s
        return {
            **unknown(site.count),
            **numbers_of(site.known.numbers),
            "yaw_rad": site.known.yaw_rad,
            "position_age_s": age_s,
            "heartbeat_age_s": age_s,
            "uncertainty_m": others.uncertainty_m,
        }

    def _bus(self) -> BusView:
        """Totals of this station's bus."""
        counters = self._member.bus.counters
        refused = counters.refused + self._member.site.refused
        return BusView(counters.sent, counters.sent_bytes, counters.received, refused)

    def _reasons_newest(self) -> list[str]:
        """(k,) why each vehicle of the other stations has its phase; the same list until that changes."""
        member = self._member
        site, here = member.site, member.present()
        infos = tuple(member.texts.values())  # replaced, never changed
        state = (site.phases.tobytes(), site.owner.tobytes(), tuple(here), infos)
        if state != self._reasons_of:
            self._reasons_of, self._reasons = state, self._reasons_now(frozenset(here))
        return self._reasons

    def _reasons_now(self, here: frozenset[str]) -> list[str]:
        site, texts = self._member.site, self._member.texts
        usual = [
            (f"flown by station {name}", "on the ground")
            if name in here or name == site.own
            else (f"station {name} is not received",) * 2
            for name in site.names
        ]
        usual.append(("not received yet",) * 2)
        grounded, explained = _GROUNDED[site.phases], _EXPLAINED[site.phases]
        reasons: list[str] = np.array(usual, object)[site.owner, grounded.astype(np.intp)].tolist()
        owners = site.owners
        for row in np.flatnonzero(explained).tolist():
            info = texts.get(owners[row])
            if info is not None and info.reasons is not None:
                reasons[row] = info.reasons.get(site.ids[row]) or reasons[row]
        return reasons
