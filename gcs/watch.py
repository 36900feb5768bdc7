"""What the telemetry changes, and what then follows without an order."""

import numpy as np

from gcs.errand_tasks import Errand
from gcs.errands import Errands
from gcs.flight import Columns, Flight
from gcs.inspection import Inspection
from gcs.lifecycle import FLOWN, Event, Phase
from gcs.state import Array, Mask, Mode
from gcs.vehicle import Heard, Vehicle

BEATS_MAY_LACK_S = 1.5
"""Heartbeats come once a second, positions many times: one that is lost makes nobody silent. Who has been
silent is heard again with a fresh heartbeat only: an old one does not tell whether a pilot has taken over.
"""

TRY_AGAIN_S = 5.0
"""Between two attempts at something that the service does by itself."""


class Watch:
    """Keeps the phases true to what the vehicles say."""

    def __init__(self, flight: Flight, errands: Errands, inspection: Inspection, come_back: Errand) -> None:
        """`come_back` is for who was lost and is heard again."""
        self._flight = flight
        self._errands = errands
        self._inspection = inspection
        self._come_back = come_back
        self._calm: tuple[object, ...] | None = None  # in which nobody had to be looked at

    def look(self) -> None:
        """Once a tick: let the telemetry change phases, and end errands that no longer apply."""
        flight = self._flight
        silence_s = flight.config.operation.silence_s
        now_s, heard_of = flight.fleet.time_s, flight.newest()
        for row in np.flatnonzero(flight.reset_time_s == now_s).tolist():
            self._mind_reset(flight.at_row(row))
        known: Mask = np.asarray(np.isfinite(flight.fleet.position_m).all(axis=1))
        age_s: Array = now_s - np.minimum(heard_of.beat_s, heard_of.position_s)
        fresh: Mask = np.asarray(age_s <= silence_s)
        flight.note_seen(fresh & known)
        # A thousand vehicles are looked at in every tick: while nothing changes, all at once.
        vehicles = flight.vehicles.values()
        expected = [vehicle.phase for vehicle in vehicles], [vehicle.modes for vehicle in vehicles]
        state = (*expected, heard_of.mode, heard_of.armed)
        if fresh.all() and state == self._calm:
            return
        all_calm = True
        rows = zip(vehicles, fresh.tolist(), known.tolist(), heard_of.mode, heard_of.armed, strict=True)
        for vehicle, is_fresh, is_known, mode, armed in rows:
            if not (is_fresh and vehicle.is_calm(mode, armed=armed)):
                all_calm = False
                self._look_at(vehicle, heard_of, is_known=is_known)
        self._calm = state if all_calm else None

    def inspect(self) -> None:
        """Once a tick, later: begin to read the parameters that are to be read now."""
        self._inspection.watch(self._flight.newest())

    def _look_at(self, vehicle: Vehicle, heard_of: Columns, *, is_known: bool) -> None:
        """Let the telemetry of one vehicle change its phase."""
        flight, row = self._flight, vehicle.row
        silence_s = flight.config.operation.silence_s
        beats_may_lack_s = 0.0 if vehicle.phase in {Phase.OFFLINE, Phase.LOST} else BEATS_MAY_LACK_S
        beat_s = float(heard_of.beat_s[row]) + beats_may_lack_s
        age_s = flight.fleet.time_s - min(beat_s, float(heard_of.position_s[row]))
        if age_s <= silence_s and is_known:  # though a heartbeat lacks
            flight.note_seen(row)
        heard = Heard(age_s, heard_of.mode[row], heard_of.armed[row], heard_of.landed[row])
        lost_holds = flight.config.operation.setpoint_loss_action == "hold"
        if vehicle.observe(heard, silence_s, lost_holds=lost_holds):
            if vehicle.phase in {Phase.LOST, Phase.PILOT}:
                self._errands.stop(vehicle, f"{vehicle.id} is {vehicle.phase} now: {vehicle.reason}")
        elif self._errands.running(vehicle):
            return
        elif vehicle.phase is Phase.OFFLINE and flight.fleet.time_s - beat_s <= silence_s:
            vehicle.reason = "heard, but it has no position yet"
        elif vehicle.phase is Phase.LOST and age_s <= silence_s and heard.mode is not Mode.LAND:
            self._by_itself(vehicle, self._come_back)
        elif vehicle.phase is Phase.STANDBY and heard.mode is Mode.OFFBOARD and not heard.armed:
            self._by_itself(vehicle, self._errands.rest)
        elif vehicle.phase in FLOWN and not vehicle.handed_over and heard.mode is Mode.HOLD:
            vehicle.apply(Event.HOLD, "an order to hold that seemed to have failed came through")

    def _mind_reset(self, vehicle: Vehicle) -> None:
        """A position that jumped may be wrong now, or have been wrong before: stand still, with more room."""
        flight, positioning = self._flight, self._flight.config.positioning
        if vehicle.phase not in FLOWN:
            return
        reason = (
            f"its position jumped: it stands for {positioning.freeze_s:g} s,"
            f" and is given {positioning.reset_margin_m:g} m more room for {positioning.reset_margin_s:g} s"
        )
        vehicle.freeze(flight.position_m(vehicle), flight.fleet.time_s + positioning.freeze_s, reason)

    def _by_itself(self, vehicle: Vehicle, errand: Errand) -> None:
        """Do what nobody ordered: not recorded as an order, and not again at once when it fails."""
        if self._flight.fleet.time_s >= vehicle.try_again_s:
            vehicle.try_again_s = self._flight.fleet.time_s + TRY_AGAIN_S
            self._errands.start(vehicle, errand, lambda _outcome, _reason: None)
